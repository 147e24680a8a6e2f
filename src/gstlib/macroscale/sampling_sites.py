"""Scan positions, chosen before any scan: the most exposed ones, and controls without exposure.

T0 has to be moulded before use, when only the mesh exists. A gesture on the mesh predicts where the
stones will rub. Its exposure gives positions of patches, and controls beside them.
"""

# ASSUME: Greedy choice of scan positions. Positions are chosen one after the other. Each is the
# most exposed position that does not overlap an earlier one. Positions are not rotated in the
# square, and their centres are at whole elements. Reason: One pass over the exposure is enough.
# Alternative: A joint choice, which may contain a little more exposure.
# ASSUME: Untouched in a finite number of poses. An element that the computed poses do not touch
# counts as never touched. Reason: Only a finite number of poses can be computed.

import logging
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.surfaces.footprints import overlap, square_of
from gstlib.surfaces.grid import spacing_of

__all__ = [
    "CONTROL",
    "COUNTS",
    "EXPOSED",
    "Concentration",
    "concentration",
    "propose_places",
]

_log = logging.getLogger(__name__)

EXPOSED, CONTROL = "exposed", "control"
# As many scans as a day at a microscope allows. A third of them are controls.
COUNTS = {EXPOSED: 8, CONTROL: 4}
# Why fewer fit.
_REASONS = {
    EXPOSED: "the rest of the square is not touched",
    CONTROL: "the rest is touched",
}
# Centres may differ from whole elements by rounding (mm).
_ROUNDING = 1e-9
# With a smaller share of the exposure inside, the stones rub beside the square.
_LEAST_INSIDE = 0.5
_COLUMNS = ["place", "kind", "x_mm", "y_mm", "exposure_N_per_mm", "touched"]


def propose_places(
    fields: xr.Dataset, *, size_mm: float, patch_mm: float
) -> pd.DataFrame:
    """Positions to scan in the square, with a warning if there are too few of a kind.

    Parameters
    ----------
    fields : xarray.Dataset
        ``exposure`` (N/mm) and ``touched`` (share of the poses) by element (y, x) of the face, from
        `gstlib.macroscale.gesture.exposure`.
    size_mm, patch_mm : float
        Sides of the square and of a patch.

    Returns
    -------
    pandas.DataFrame
        The table ``places.csv``: ``place, kind, x_mm, y_mm, exposure_N_per_mm`` (mean over the
        position) and ``touched`` (its highest value there). E1 is the most exposed. C1 is farthest
        from all touched elements.

    Examples
    --------
    A square of 5 mm that is rubbed in one spot, 0.8 mm wide about x 2 mm, y 3 mm:

    >>> import gstlib
    >>> field = gstlib.make_surface(np.zeros((50, 50)), 0.1)
    >>> spot = (abs(field.y - 3.0) < 0.4) & (abs(field.x - 2.0) < 0.4)
    >>> fields = xr.Dataset({"exposure": field + 40.0 * spot, "touched": field + spot})
    >>> places = gstlib.propose_places(fields, size_mm=5.0, patch_mm=0.8)
    >>> print(*places.iloc[0][["place", "x_mm", "y_mm"]])
    E1 2.0 3.0
    """
    element, _ = steps = spacing_of(fields)
    centres = _centres(element, size_mm, patch_mm)
    share_y, share_x = (
        overlap(fields[axis].values, step, centres[:, None], patch_mm) / patch_mm
        for axis, step in zip("yx", steps, strict=True)
    )
    share_y[share_y < _ROUNDING] = share_x[share_x < _ROUNDING] = 0
    within = share_y > 0, share_x > 0
    # By position: mean exposure, highest share of poses, and how far (mm) the next touched element
    # and the positions chosen before are.
    exposure = share_y @ fields.exposure.values @ share_x.T
    touched = _highest(fields.touched.values, *within)
    untouched = fields.touched.values == 0
    steps = scipy.ndimage.distance_transform_cdt(untouched, "chessboard")
    away = np.where(touched > 0, 0.0, -element * _highest(-steps, *within))

    left = {EXPOSED: exposure.copy(), CONTROL: away}
    rows = []
    for kind, count in COUNTS.items():
        for number in range(1, count + 1):
            at = np.unravel_index(left[kind].argmax(), exposure.shape)
            if left[kind][at] <= 0:
                _log.warning(
                    "%d of %d %s positions fit in the square, because %s. For more, make "
                    "square.size_mm larger or scans.size_mm smaller",
                    *(number - 1, count, kind, _REASONS[kind]),
                )
                break
            y_mm, x_mm = centres[list(at)]
            apart = np.maximum.outer(abs(centres - y_mm), abs(centres - x_mm))
            gaps = apart - patch_mm + _ROUNDING  # negative if they overlap
            left[EXPOSED][gaps < 0] = 0
            left[CONTROL] = np.minimum(left[CONTROL], gaps)
            place = f"{kind[0].upper()}{number}"
            rows.append((place, kind, x_mm, y_mm, exposure[at], touched[at]))
    return pd.DataFrame(rows, columns=_COLUMNS)


def _centres(element: float, size_mm: float, patch_mm: float) -> np.ndarray:
    """Centres (mm), along either axis, of the positions that fit in the square."""
    first = patch_mm / 2 - _ROUNDING
    last = size_mm - patch_mm / 2 + _ROUNDING
    steps = np.arange(np.ceil(first / element), np.floor(last / element) + 1)
    whole = steps * element
    # a patch as wide as the square has only one position
    return whole if len(whole) else np.array([size_mm / 2])


def _highest(
    values: np.ndarray, along_y: np.ndarray, along_x: np.ndarray
) -> np.ndarray:
    """Highest of the values (ny, nx) at each position, from its elements along both axes."""
    rows = np.stack([values[inside].max(axis=0) for inside in along_y])
    return np.stack([rows[:, inside].max(axis=1) for inside in along_x], axis=1)


class Concentration(NamedTuple):
    """How the exposure is spread.

    Attributes
    ----------
    in_square : float
        Share of the face's exposure in the square.
    half_area : float
        Smallest share of the square's area with half of the square's exposure.
    in_places, places_area : float
        Share of the square's exposure, and of its area, at the exposed positions.
    """

    in_square: float
    half_area: float
    in_places: float
    places_area: float


def concentration(
    fields: xr.Dataset, places: pd.DataFrame, *, size_mm: float, patch_mm: float
) -> Concentration:
    """Distribution of the exposure over face, square and positions from `propose_places`.

    Warns if most of it is beside the square.
    """
    inside = square_of(fields.exposure, size_mm).values
    in_square = float(inside.sum() / fields.exposure.sum())
    if in_square < _LEAST_INSIDE:
        _log.warning(
            "%.0f %% of the exposure lies outside the square, but positions are proposed only "
            "inside. Move square.points_mm there, or make square.size_mm larger",
            100 * (1 - in_square),
        )
    falling = np.sort(inside, axis=None)[::-1].cumsum()
    half = int(np.searchsorted(falling, falling[-1] / 2)) + 1
    proposed = places.exposure_N_per_mm[places.kind == EXPOSED]
    area = patch_mm**2 / size_mm**2
    of_places = float(proposed.sum() * area / inside.mean())
    return Concentration(in_square, half / inside.size, of_places, len(proposed) * area)
