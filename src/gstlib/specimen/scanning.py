"""Scans of the synthetic stone: their positions, and the records of the instrument.

A position has its centre in the frame of the square. The columns of the scan run along +x and its
rows along +y of a frame that is turned with it. The instrument measures a mould, whose heights are
inverted and whose map is flipped along x. Truths are kept as on the stone, before the mould.
"""

import numpy as np
import scipy
import xarray as xr

from gstlib.errors import InputError
from gstlib.specimen.randomness import SpecimenParameters, smooth_field, stream
from gstlib.specimen.stone import Stone
from gstlib.surfaces.footprints import PatchPosition, rotated
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane

__all__ = ["place_again", "place_scans", "poor_overlaps", "sample", "take_scan"]

# ASSUME: Errors of scans. All errors of position and measurement are normal, and spikes and
# unmeasured points occur anywhere. Errors of points are independent by default. With lengths in the
# config, their correlation falls exponentially with distance, along scan lines and across. Reason:
# The paper does not give figures for them. On five of six measured repeats, the correlation of
# neighbours fits the length of correlation better by an exponential than by a Gaussian.

# R.m.s. rotation of a scan about its nominal rotation, and tilt of a mould along each axis, for
# careful handling.
_ROTATION_ERROR_DEG, _TILT_MRAD = 0.05, 3.0
# Fraction of the patches whose T1 scan is badly misplaced, as hard cases for registration. Fraction
# of the T0 scan's area that such a scan misses.
_POOR_FRACTION, _POOR_MISSED = 0.2, (0.4, 0.7)
# Number of points around a scan for the interpolation.
_REACH = 16
# A spike is a point or a small spot: probability of 1, 2, ... points along its side. It is higher
# than any wave of the detail, and its sign is random.
_SPIKE_SIDES, _SPIKE_HEIGHT_UM = (0.7, 0.2, 0.1), (15.0, 60.0)
_UNMEASURED_FRACTION = 0.01


def poor_overlaps(patches: list[str], seed: int) -> set[str]:
    """The patches whose T1 scan is badly misplaced: a fixed fraction, drawn at random."""
    names = sorted(patches)
    chosen = stream(seed, "poor overlap").permutation(len(names))
    return {names[i] for i in chosen[: round(_POOR_FRACTION * len(names))]}


def place_scans(
    patch: str,
    nominal: PatchPosition,
    parameters: SpecimenParameters,
    *,
    square_mm: float,
    poor_overlap: bool,
) -> tuple[PatchPosition, PatchPosition]:
    """True positions of a patch's T0 scan, near its nominal position, and of its T1 scan, near T0.

    With `poor_overlap`, T1 misses a good part of T0, along one edge, towards the middle of the
    square.
    """
    p = parameters
    generator = stream(p.seed, "placement", patch)
    error = generator.normal(0.0, p.placement_error_um * 1e-3, 2)
    move = generator.normal(0.0, p.relocation_error_um * 1e-3, 2)
    turns = nominal.rotation_deg + generator.normal(0.0, _ROTATION_ERROR_DEG, 2)
    missed = generator.uniform(*_POOR_MISSED)
    axis = generator.integers(2)
    # Errors and moves are drawn along x first.
    t0 = PatchPosition(nominal.y_mm + error[1], nominal.x_mm + error[0], turns[0])
    if poor_overlap:
        inwards = np.sign(square_mm / 2 - (t0.x_mm, t0.y_mm)[axis])
        move[axis] = (inwards or 1.0) * missed * p.scan_size_mm
    return t0, PatchPosition(t0.y_mm + move[1], t0.x_mm + move[0], turns[1])


def place_again(
    patch: str, t0: PatchPosition, parameters: SpecimenParameters
) -> PatchPosition:
    """True position of a second scan of a patch, with the error of a good T1."""
    generator = stream(parameters.seed, "repeat", patch)
    move_y, move_x = generator.normal(0.0, parameters.relocation_error_um * 1e-3, 2)
    turn = generator.normal(0.0, _ROTATION_ERROR_DEG)
    return PatchPosition(t0.y_mm + move_y, t0.x_mm + move_x, t0.rotation_deg + turn)


def sample(
    field: np.ndarray,
    stone: Stone,
    place: PatchPosition,
    points: int,
    *,
    order: int,
    patch: str,
) -> np.ndarray:
    """A field on the grid of ``stone.detail``, sampled at the (points, points) of a scan.

    The `order` of the interpolating spline is 3 for heights, and 1 for fields that must not
    overshoot. A scan that extends beyond the grid raises an `InputError`.
    """
    steps = np.arange(points) - (points - 1) / 2
    start, end = stone.grid[[0, -1]]
    off_centre = np.stack(rotated(steps[:, None], steps, place.rotation_deg))
    centre = np.array([place.y_mm, place.x_mm])
    indices = ((centre - start) / stone.spacing)[:, None, None] + off_centre
    if indices.min() < 0 or indices.max() > len(field) - 1:
        raise InputError(
            f"patch {patch}",
            f"its scan about x {place.x_mm:.3f} mm, y {place.y_mm:.3f} mm sticks out of "
            f"the generated surface, {start:.3f} to {end:.3f} mm",
            "Move it inwards in the patch table.",
        )
    low = np.maximum(np.floor(indices.min(axis=(1, 2))).astype(int) - _REACH, 0)
    high = np.ceil(indices.max(axis=(1, 2))).astype(int) + _REACH + 1
    crop = field[tuple(map(slice, low, high))].astype(float)
    indices -= low[:, None, None]
    return scipy.ndimage.map_coordinates(crop, indices, order=order, mode="nearest")


def take_scan(
    true_height: np.ndarray, patch: str, epoch: str, parameters: SpecimenParameters
) -> tuple[xr.DataArray, dict[str, object]]:
    """Scan a mould of the true heights (n, n), mm.

    The scan is as read from its file, mm, NaN if unmeasured. The variables of the truth are the
    angles ``plane_x_mrad, plane_y_mrad`` and the masks ``outlier, unmeasured``, as on the stone.
    """
    p = parameters
    points = len(true_height)
    generator = stream(p.seed, "scan", patch, epoch)
    tilt_x, tilt_y = generator.normal(0.0, _TILT_MRAD * 1e-3, 2)
    steps = (np.arange(points) - (points - 1) / 2) * p.scan_spacing_mm
    height = true_height - true_height.mean() + tilt_y * steps[:, None] + tilt_x * steps
    height += _errors(generator, points, p)
    unmeasured = _blots(generator, points, p)
    spikes = _spikes(generator, points, p)
    height += spikes
    height[unmeasured] = np.nan

    _, plane = remove_plane(make_surface(true_height, p.scan_spacing_mm))
    truth = {
        "plane_x_mrad": np.arctan(plane.slope_x + tilt_x) * 1e3,
        "plane_y_mrad": np.arctan(plane.slope_y + tilt_y) * 1e3,
        "outlier": (("y", "x"), (spikes != 0) & ~unmeasured),
        "unmeasured": (("y", "x"), unmeasured),
    }
    # The mould inverts heights and flips the map. Files store single precision in µm, and readers
    # return seven digits of a spacing.
    stored_um = (-height[:, ::-1] * 1e3).astype(np.float32)
    read = stored_um.astype(float) * 1e-3
    spacing = float(f"{p.scan_spacing_mm:.7g}")
    return make_surface(read, spacing, long_name="height as measured"), truth


def _errors(
    generator: np.random.Generator, points: int, p: SpecimenParameters
) -> np.ndarray:
    """Errors of the instrument (points, points), mm, with one variance everywhere."""
    errors = generator.normal(0.0, p.noise_um * 1e-3, (points, points))
    lengths_um = p.noise_length_across_um, p.noise_length_along_um
    for lines, length_um in zip((errors, errors.T), lengths_um, strict=True):
        if length_um:
            correlation = np.exp(-p.scan_spacing_um / length_um)
            lines[1:] *= np.sqrt(1 - correlation**2)
            lines[:] = scipy.signal.lfilter([1.0], [1.0, -correlation], lines, axis=0)
    return errors


def _blots(
    generator: np.random.Generator, points: int, p: SpecimenParameters
) -> np.ndarray:
    """Unmeasured points, clustered in spots: the highest points of a smooth field."""
    field = smooth_field(generator, points, p.scan_spacing_um, p.unmeasured_size_um)
    count = round(_UNMEASURED_FRACTION * field.size)
    heights = field.ravel()
    high = np.flatnonzero(heights >= np.partition(heights, -count)[-count])
    # Among equally high points, the last ones count.
    by_height = high[np.argsort(heights[high], kind="stable")]
    unmeasured = np.zeros(field.shape, dtype=bool)
    unmeasured.flat[by_height[-count:]] = True
    return unmeasured


def _spikes(
    generator: np.random.Generator, points: int, p: SpecimenParameters
) -> np.ndarray:
    """Heights (mm) added by spikes: single points and small spots, up or down; 0 elsewhere."""
    heights = np.zeros((points, points))
    sides = np.arange(1, len(_SPIKE_SIDES) + 1)
    mean_area = float(np.dot(_SPIKE_SIDES, sides**2))
    count = generator.poisson(p.spike_fraction * points**2 / mean_area)
    rows, columns = generator.integers(0, points, (2, count))
    chosen = generator.choice(sides, count, p=_SPIKE_SIDES)
    sizes_um = generator.uniform(*_SPIKE_HEIGHT_UM, count)
    values = sizes_um * generator.choice([-1.0, 1.0], count) * 1e-3
    for row, column, side, value in zip(rows, columns, chosen, values, strict=True):
        heights[row : row + side, column : column + side] = value
    return heights
