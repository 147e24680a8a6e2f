"""A generated specimen like the paper's: mesh, scans before and after use, and the truth.

It lets the whole study run, and every stage be scored, without measured files. A result of it is a
result about the software, never one about a stone.
"""

from gstlib.specimen.generate import generate_specimen
from gstlib.specimen.parameters import SpecimenParameters
from gstlib.specimen.score import score_truth
from gstlib.specimen.truth import true_patches, true_surface

__all__ = ["SpecimenParameters", "generate_specimen", "score_truth", "true_patches", "true_surface"]
