"""Wear the square and its patches, and compare the loss with the measured one."""

from pathlib import Path

from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import read_table, studied_files, write_table
from gstlib.logs import patch_by_patch, run_script
from gstlib.provenance import provenance
from gstlib.study import predict_wear


