"""Registration: shift and rotation of the second measurement of a patch against the first.

A new mould and a new scan shift T1 against T0 by up to a good part of the field. T1 is also turned
slightly, tilted, noisy, and worn. The coarse step (`gstlib.change.search`) searches for a shift at
which the details match. The fine step (`gstlib.change.refinement`) fits shift, rotation and tilt.
"""

import math
from dataclasses import asdict, dataclass

import numpy as np
import xarray as xr

from gstlib.change.poses import sample, spline
from gstlib.change.refinement import refine
from gstlib.change.search import (
    LEAST_ALONG,
    LEAST_CORRELATION,
    LEAST_OVERLAP,
    ROUNDING,
    Details,
    pearson,
)
from gstlib.errors import InputError
from gstlib.surfaces.fitting import robust_sigma
from gstlib.surfaces.grid import spacing_of
from gstlib.surfaces.leveling import remove_plane

__all__ = ["Registration", "apply_registration", "is_one_way", "is_other", "register"]

# The search uses grids on which reference and moving surface have at most this many elements a
# side. Its peak is accurate to a fraction of a coarse element, which the refinement corrects.
_SEARCH_SIZES = 256, 1024
# ASSUME: Change of dale depth by wear. Wear does not make the dales of a patch half or twice as
# deep. Reason: Wear removes summits, and hardly reaches the dales.
OTHER_HEIGHTS = 2.0


@dataclass(frozen=True)
class Registration:
    """Transformation of the moving surface onto the reference, and its quality.

    A point X (mm) of the moving surface is at c + R(rotation) (X - c) + shift on the reference,
    where c is the centre of the moving grid.
    """

    shift_x_mm: float  # to add to the coordinates of the moving surface
    shift_y_mm: float
    rotation_deg: float  # of the moving surface, x towards y
    overlap: float  # share of the reference's area that the moving surface covers
    correlation: (
        float  # Pearson's, of heights over the overlap, a plane removed from each
    )
    # Correlation of band-passed heights, without the long waves that match by chance.
    detail_correlation: float
    # Correlation of their slopes in the direction in which they correlate least: striae match only
    # along one direction.
    slope_correlation: float
    dale_depth_ratio: (
        float  # depth of the moving surface's dales over the reference's, band-passed
    )
    residual_mm: float  # robust standard deviation of the levelled height difference
    shift_x_error_mm: float  # standard errors in the middle of the overlap
    shift_y_error_mm: (
        float  # NaN if no slopes that both surfaces share determine the shift
    )
    t1_x_mm: float  # centre of the moving surface from the centre of the reference
    t1_y_mm: float
    t1_size_x_mm: float  # sides of the moving surface
    t1_size_y_mm: float
    # Shift (y, x) in elements, from corner to corner, and rotation in radians.
    pose: tuple[float, float, float]
    # Whether the details correlate well enough, in every direction, for a reliable result.
    is_reliable: bool

    def as_attrs(self) -> dict[str, float]:
        """Attributes for a file: lengths in µm, ``registration_found`` as 1 or 0."""
        attrs = asdict(self)
        del attrs["pose"]
        attrs["registration_found"] = int(attrs.pop("is_reliable"))
        return {
            name.replace("_mm", "_um"): value * 1e3 if name.endswith("_mm") else value
            for name, value in attrs.items()
        }


def register(
    reference: xr.DataArray, moving: xr.DataArray, *, maximum_shift_mm: float
) -> Registration:
    """Register `moving` (T1) to `reference` (T0).

    Both are levelled heights (y, x) in mm, with the same spacing and without NaN. Their shapes may
    differ: `moving` may be a larger map around the reference. It takes 90 to 250 bytes of memory a
    point of the larger one: 350 MB for 2048 × 2048 points. The search covers shifts up to
    `maximum_shift_mm` along each axis, if at least a quarter of the field overlaps, and rotations
    of a few degrees. The result is the best registration, and `is_reliable` shows whether it can be
    used. Surfaces whose heights differ by a factor of two (`OTHER_HEIGHTS`) are registered only to
    an element, because the refinement compares heights.

    Raises
    ------
    InputError
        The spacings differ.
    """
    spacing = np.array(spacing_of(reference))
    if not np.allclose(spacing, spacing_of(moving), rtol=1e-3):
        raise InputError(
            "T1",
            f"spacing (y, x) {spacing_of(moving)} mm differs from T0's {spacing_of(reference)} mm",
            "Resample one of the two surfaces to the other's spacing.",
        )
    h0, h1 = reference.values, moving.values
    factor = max(
        math.ceil(max(h.shape) / size)
        for h, size in zip((h0, h1), _SEARCH_SIZES, strict=True)
    )
    aspect = spacing[0] / spacing[1]
    details = Details(h0, h1, aspect, factor)
    left = np.maximum(1 - maximum_shift_mm / spacing / h0.shape, 0)
    match, errors = (
        details.search(max(LEAST_OVERLAP, float(np.prod(left)))),
        np.full(2, np.nan),
    )
    is_scaled = is_other(details.dale_depth_ratio(match.pose))
    if not (match.is_beyond_chance and is_scaled):
        match, errors = refine(h0, h1, details, match, factor)
    slope_correlation, _ = details.compare_slopes(match.pose)
    pose = match.pose * (factor, factor, 1.0)
    on_grid = reference.copy(data=sample(spline(h1), pose, h0.shape, aspect))
    inside = np.isfinite(on_grid.values)
    flat0, flat1 = (
        remove_plane(h.where(inside))[0].values[inside] for h in (reference, on_grid)
    )
    corners, middles = (
        [float(at(moving[axis]) - at(reference[axis])) for axis in "yx"]
        for at in (np.min, np.mean)
    )
    shift = pose[:2] * spacing - corners
    t1_y, t1_x = shift + middles
    t1_size_y, t1_size_x = np.multiply(spacing_of(moving), h1.shape)
    error_y, error_x = errors * spacing
    return Registration(
        shift_x_mm=shift[1],
        shift_y_mm=shift[0],
        rotation_deg=math.degrees(pose[2]),
        overlap=inside.mean(),
        correlation=pearson(flat0, flat1),
        detail_correlation=match.correlation,
        slope_correlation=slope_correlation,
        dale_depth_ratio=details.dale_depth_ratio(match.pose),
        residual_mm=robust_sigma(flat1 - flat0),
        shift_x_error_mm=error_x,
        shift_y_error_mm=error_y,
        t1_x_mm=t1_x,
        t1_y_mm=t1_y,
        t1_size_x_mm=t1_size_x,
        t1_size_y_mm=t1_size_y,
        pose=tuple(pose),
        is_reliable=match.is_beyond_chance and slope_correlation >= LEAST_ALONG,
    )


def apply_registration(
    moving: xr.DataArray,
    marked: np.ndarray,
    registration: Registration,
    like: xr.DataArray,
) -> tuple[xr.DataArray, np.ndarray]:
    """The moving surface, and its marked points, on the grid of the reference (`like`).

    Heights (mm) are interpolated cubically, and are NaN outside the overlap. A point is marked if
    any of its four neighbours in `marked` (filled points, for example) is marked.
    """
    dy, dx = spacing_of(like)
    pose, aspect = registration.pose, dy / dx
    heights = sample(spline(moving.values), pose, like.shape, aspect)
    # ASSUME: Marks after interpolation. A point is marked if one of the four points around it is.
    # Reason: Among the sixteen points of the cubic interpolation, these four have the largest
    # weights.
    weight = sample(marked.astype(float), pose, like.shape, aspect, order=1)
    return like.copy(data=heights), weight > ROUNDING


def is_one_way(detail_correlation: float, slope_correlation: float) -> bool:
    """Whether details match, but do not determine the shift along one direction, as with striae."""
    return detail_correlation >= LEAST_CORRELATION and slope_correlation < LEAST_ALONG


def is_other(dale_depth_ratio: float, times: float = OTHER_HEIGHTS) -> bool:
    """Whether the heights of two surfaces differ by more than this factor."""
    return max(dale_depth_ratio, 1 / dale_depth_ratio) > times
