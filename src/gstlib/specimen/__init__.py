"""A generated specimen like the paper's: mesh, scans before and after use, and the truth.

It lets the whole study run, and every stage be scored, without measured files. Its results tell
about the software, never about a stone.
"""

from gstlib.specimen.generate import Specimen, generate_specimen, make_specimens
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.specimen.stone import WEAR_PLACEMENTS

__all__ = [
    "WEAR_PLACEMENTS",
    "Specimen",
    "SpecimenParameters",
    "generate_specimen",
    "make_specimens",
]
