"""Taking a scan of the generated stone: where it is placed, what the instrument makes of it.

A placement has its centre in the square's frame; the scan's columns run along +x, its rows along +y
of a frame turned with it. What the instrument measures is a mould: heights inverted, the map
flipped along x. Masks and truths are kept as they lie on the stone, before the mould flips them.
"""

from dataclasses import dataclass

import numpy as np
import scipy.ndimage

from gstlib.errors import InputError
from gstlib.specimen.parameters import SpecimenParameters
from gstlib.specimen.randomness import smooth_field, stream
from gstlib.specimen.stone import Stone

__all__ = ["Placement", "Scan", "mould", "place_scans", "sample", "take_scan"]

# ASSUME: all errors of placing and measuring are independent and normal, spikes and unmeasured
# points fall anywhere; the paper gives no figures for them.

# Share of the T0 scan's area that a poorly overlapping T1 scan misses.
_POOR_MISSED = (0.4, 0.7)
# Points around a scan that the interpolation looks at.
_REACH = 16
# A spike is a point or a small blot: probability of 1, 2, ... points along its side.
_SPIKE_SIDES = (0.7, 0.2, 0.1)


@dataclass(frozen=True)
class Placement:
    """Where a scan lies: its centre (mm, the square's frame) and its turn from x towards y."""

    x_mm: float
    y_mm: float
    rotation_deg: float


@dataclass(frozen=True)
class Scan:
    """One scan as it lies on the stone, before the mould flips it.

    Attributes
    ----------
    height : (n, n) ndarray
        What the instrument reports, mm, NaN where unmeasured; with tilt, noise and spikes.
    outlier, unmeasured : (n, n) ndarray of bool
        Spikes among the measured points; points without a value.
    tilt_x_mrad, tilt_y_mrad : float
        Tilt with which the mould lay under the instrument: slope added along x and y.
    """

    height: np.ndarray
    outlier: np.ndarray
    unmeasured: np.ndarray
    tilt_x_mrad: float
    tilt_y_mrad: float


def place_scans(
    patch: str,
    nominal: Placement,
    parameters: SpecimenParameters,
    *,
    square_mm: float,
    poor_overlap: bool,
) -> dict[str, Placement]:
    """True places of the T0 and the T1 scan of a patch.

    T0 lies about its nominal place, T1 about T0. With `poor_overlap` T1 misses a good part of T0,
    along one edge, towards the middle of the square.
    """
    p = parameters
    generator = stream(p.seed, "placement", patch)
    error = generator.normal(0.0, p.placement_error_um * 1e-3, 2)
    move = generator.normal(0.0, p.relocation_error_um * 1e-3, 2)
    turns = generator.normal(0.0, p.rotation_error_deg, 2)
    missed = generator.uniform(*_POOR_MISSED)
    axis = generator.integers(2)
    t0 = Placement(
        nominal.x_mm + error[0], nominal.y_mm + error[1], nominal.rotation_deg + turns[0]
    )
    if poor_overlap:
        inwards = np.sign(square_mm / 2 - (t0.x_mm, t0.y_mm)[axis])
        move[axis] = (inwards or 1.0) * missed * p.scan_size_mm
    t1 = Placement(t0.x_mm + move[0], t0.y_mm + move[1], nominal.rotation_deg + turns[1])
    return {"T0": t0, "T1": t1}


def sample(
    field: np.ndarray, stone: Stone, placement: Placement, points: int, *, order: int, patch: str
) -> np.ndarray:
    """A field on the stone's detail grid, at the points of a scan.

    Parameters
    ----------
    field : (m, m) ndarray
        On the grid of ``stone.detail``.
    stone : Stone
    placement : Placement
    points : int
        Points along each side of the scan, one spacing of the stone apart.
    order : int
        Of the interpolating spline: 3 for heights; 1 for what must not overshoot.
    patch : str
        For the message.

    Returns
    -------
    (points, points) ndarray

    Raises
    ------
    InputError
        The scan sticks out of the known surface.
    """
    turn = np.deg2rad(placement.rotation_deg)
    steps = np.arange(points) - (points - 1) / 2
    v, u = steps[:, None], steps[None, :]
    row = (placement.y_mm - stone.start) / stone.spacing + np.sin(turn) * u + np.cos(turn) * v
    column = (placement.x_mm - stone.start) / stone.spacing + np.cos(turn) * u - np.sin(turn) * v
    corners = np.array([[a.min(), a.max()] for a in (row, column)])
    if corners.min() < 0 or corners.max() > len(field) - 1:
        raise InputError(
            f"patch {patch}",
            f"its scan about x {placement.x_mm:.3f} mm, y {placement.y_mm:.3f} mm sticks out of "
            f"the generated surface, {stone.start:.3f} to {stone.grid()[-1]:.3f} mm",
            "Move it inwards in the patch table, or raise specimen.margin_mm.",
        )
    low = np.maximum(np.floor(corners[:, 0]).astype(int) - _REACH, 0)
    high = np.ceil(corners[:, 1]).astype(int) + _REACH + 1
    crop = field[low[0] : high[0], low[1] : high[1]].astype(float)
    return scipy.ndimage.map_coordinates(
        crop, [row - low[0], column - low[1]], order=order, mode="nearest"
    )


def take_scan(
    true_height: np.ndarray, patch: str, epoch: str, parameters: SpecimenParameters
) -> Scan:
    """What the instrument makes of the true heights (mm) at the points of a scan."""
    p = parameters
    points = len(true_height)
    generator = stream(p.seed, "scan", patch, epoch)
    tilt_x, tilt_y = generator.normal(0.0, p.tilt_mrad * 1e-3, 2)
    steps = (np.arange(points) - (points - 1) / 2) * p.scan_spacing_mm
    height = true_height - true_height.mean() + tilt_y * steps[:, None] + tilt_x * steps
    height += generator.normal(0.0, p.noise_um * 1e-3, height.shape)

    unmeasured = _blots(generator, points, p)
    spikes = _spikes(generator, points, p)
    height += spikes
    outlier = (spikes != 0) & ~unmeasured
    height[unmeasured] = np.nan
    return Scan(height, outlier, unmeasured, tilt_x * 1e3, tilt_y * 1e3)


def mould(height: np.ndarray) -> np.ndarray:
    """The map of the mould: heights inverted, flipped along x. Its own inverse."""
    return -height[:, ::-1]


def _blots(generator: np.random.Generator, points: int, p: SpecimenParameters) -> np.ndarray:
    """Unmeasured points, clustered in blots."""
    field = smooth_field(generator, points, p.scan_spacing_um, p.unmeasured_size_um)
    count = round(p.unmeasured_share * field.size)
    mask = np.zeros(field.size, dtype=bool)
    mask[np.argsort(field, axis=None, kind="stable")[field.size - count :]] = True
    return mask.reshape(field.shape)


def _spikes(generator: np.random.Generator, points: int, p: SpecimenParameters) -> np.ndarray:
    """Heights (mm) that spikes add: single points and small blots, up or down; 0 elsewhere."""
    heights = np.zeros((points, points))
    sides = np.arange(1, len(_SPIKE_SIDES) + 1)
    mean_area = float(np.dot(_SPIKE_SIDES, sides**2))
    count = generator.poisson(p.spike_share * points**2 / mean_area)
    rows, columns = generator.integers(0, points, (2, count))
    chosen = generator.choice(sides, count, p=_SPIKE_SIDES)
    low, high = p.spike_height_um
    values = generator.uniform(low, high, count) * generator.choice([-1.0, 1.0], count) * 1e-3
    for row, column, side, value in zip(rows, columns, chosen, values, strict=True):
        heights[row : row + side, column : column + side] = value
    return heights
