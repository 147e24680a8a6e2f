"""A height map as a file holds it: what every reader of scans returns, in mm."""

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gstlib.errors import InputError

__all__ = ["SCAN_UNITS", "HeightMap", "Unsaid", "plain_text"]

# Length of each unit in mm.
SCAN_UNITS = {"m": 1e3, "mm": 1.0, "um": 1e-3, "nm": 1e-6}

_LONGEST_TEXT = 200


@dataclass(frozen=True)
class HeightMap:
    """Heights (ny, nx) mm, NaN where unmeasured; spacing (dy, dx) mm; what else the file tells."""

    heights: np.ndarray
    spacing: tuple[float, float]
    attrs: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Unsaid:
    """What the config says of files that do not say it themselves.

    Parameters
    ----------
    unit : str, optional
        One of `SCAN_UNITS`.
    spacing_mm : float, optional
        Distance of the points.
    """

    unit: str | None = None
    spacing_mm: float | None = None

    def unit_factor(self, path: Path) -> float:
        """Length of the file's unit in mm; InputError if the config does not say it either."""
        if self.unit is None:
            raise InputError(
                path,
                "the file does not say its unit of length",
                f"Set scans.unit in the config to one of {list(SCAN_UNITS)}.",
            )
        return SCAN_UNITS[self.unit]

    def spacing(self, path: Path) -> tuple[float, float]:
        """(dy, dx) in mm; InputError if the config does not say it either."""
        if self.spacing_mm is None:
            raise InputError(
                path,
                "the file does not say the spacing of its points",
                "Set scans.spacing_um in the config, or export the scan in a format that says it "
                "(.plu, .plux, .sur, .x3p, .al3d, ...).",
            )
        return self.spacing_mm, self.spacing_mm


def plain_text(value: object) -> str:
    """One short line of printable text, whatever bytes a file had in its place.

    >>> plain_text("DCM 3D\\x00\\n rev. 2")
    'DCM 3D rev. 2'
    """
    # lone surrogates and NUL cannot be stored as attributes of an HDF5 file
    text = str(value).encode("utf-8", "replace").decode("utf-8")
    text = "".join(c if c.isprintable() else " " for c in text[: 4 * _LONGEST_TEXT])
    return re.sub(r" +", " ", text).strip()[:_LONGEST_TEXT]
