"""Write the HDF5 files of a study, with their origin."""

from pathlib import Path

import xarray as xr

from gstlib import __version__
from gstlib.io.store import write_dataset


def write_result(file: Path, dataset: xr.Dataset, step: str) -> None:
    """Write a result with the version and its step, whose record contains the rest."""
    origin = {"step": step, "gstlib_version": __version__}
    write_dataset(file, dataset, origin)
