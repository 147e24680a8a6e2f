"""Positions on the square, their outlines, and the square's frame on the stone.

On the square, y comes before x everywhere, as rows come before columns.
"""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
import scipy
import xarray as xr
from numpy.typing import ArrayLike

from gstlib.errors import InputError
from gstlib.surfaces.grid import axis_coordinates, spacing_of, spacing_of_heights

if TYPE_CHECKING:
    import shapely

__all__ = [
    "PatchPosition",
    "area_weights",
    "check_size",
    "covered_areas",
    "footprint_weights",
    "half_extent",
    "moved",
    "on_patch",
    "outline",
    "overlap",
    "places_of",
    "rotated",
    "spline_of",
    "square_of",
    "with_t1",
]

# The position of T1 on T0 and its size, in the table of the patches.
_T1 = ["t1_y_um", "t1_x_um", "t1_rotation_deg", "t1_size_y_um", "t1_size_x_um"]

# Relative difference of a map's sides from the side of its footprint, beside the element by which a
# scan may differ if it is cut or made coarser at whole elements.
_SIZE_TOLERANCE = 0.01


def rotated(v: Any, u: Any, rotation_deg: float) -> tuple[Any, Any]:
    """Offsets along y and x of a point (v, u) on axes that are rotated from x towards y."""
    turn = np.radians(rotation_deg)
    cosine, sine = np.cos(turn), np.sin(turn)
    return cosine * v + sine * u, cosine * u - sine * v


class PatchPosition(NamedTuple):
    """Position of a scan on the square: its centre (mm) and its rotation from x towards y."""

    y_mm: float
    x_mm: float
    rotation_deg: float = 0.0

    @classmethod
    def from_dataset(cls, at: xr.Dataset) -> "PatchPosition":
        """The position of one patch, from its ``y_mm, x_mm, rotation_deg``."""
        return cls(*(float(at[name]) for name in cls._fields))

    def points(self, v: Any, u: Any) -> tuple[Any, Any]:
        """Coordinates (y, x) on the square of points (v, u) from the scan's centre, mm."""
        dy, dx = rotated(v, u, self.rotation_deg)
        return self.y_mm + dy, self.x_mm + dx

    def seen(self, y: Any, x: Any) -> tuple[Any, Any]:
        """Coordinates (v, u) from the scan's centre of points (y, x) on the square, mm."""
        return rotated(y - self.y_mm, x - self.x_mm, -self.rotation_deg)


def places_of(patches: pd.DataFrame) -> dict[str, PatchPosition]:
    """Position of each patch, from ``patch, x_mm, y_mm, rotation_deg``."""
    columns = patches[[*PatchPosition._fields]].astype(float)
    places = map(PatchPosition._make, columns.itertuples(index=False))
    return dict(zip(patches.patch, places, strict=True))


def spline_of(field: xr.DataArray) -> "scipy.interpolate.RectBivariateSpline":
    """Cubic spline of a field (y, x) through its element centres, constant beyond them.

    NaN is replaced by the nearest value.
    """
    spacing_of(field)  # refuses what is no surface
    values = field.values
    if (absent := np.isnan(values)).any():
        nearest = scipy.ndimage.distance_transform_edt(
            absent, return_distances=False, return_indices=True
        )
        values = values[tuple(nearest)]
    return scipy.interpolate.RectBivariateSpline(field.y.values, field.x.values, values)


def square_of(field: xr.DataArray | xr.Dataset, size_mm: float) -> Any:
    """The part of a field (..., y, x) of the face within the square of this side."""
    inside = {
        axis: ((field[axis] > 0) & (field[axis] < size_mm)).values for axis in "yx"
    }
    return field.isel(inside)


def on_patch(
    spline: "scipy.interpolate.RectBivariateSpline",
    place: PatchPosition,
    shape: tuple[int, ...],
    size_mm: float,
) -> np.ndarray:
    """A field of the square at the points, of this `shape`, of a scan at a position."""
    half = size_mm / 2
    v, u = (axis_coordinates(count, size_mm / count) - half for count in shape)
    if place.rotation_deg == 0:  # many times as fast
        return spline(place.y_mm + v, place.x_mm + u)
    return spline.ev(*place.points(v[:, None], u))


def check_size(height: xr.DataArray, size_mm: float, source: str) -> None:
    """Refuse a map (y, x) that is no square of this side, over which it would be stretched.

    Raises
    ------
    InputError
    """
    steps = np.array(spacing_of_heights(height))
    sides = np.array(height.shape) * steps
    if (abs(sides - size_mm) > _SIZE_TOLERANCE * size_mm + steps).any():
        raise InputError(
            source,
            f"the map is {sides[1]:.4g} × {sides[0]:.4g} mm, but its place is a square of "
            f"{size_mm:.4g} mm",
            "Cut the map to this square, or correct the side of a patch (patch_mm).",
        )


def outline(place: PatchPosition, size_mm: ArrayLike) -> np.ndarray:
    """Corners (4, 2), x and y (mm), of a footprint, the lower left first.

    `size_mm` is the side of the scan, or its extents along its y and x.
    """
    corners = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]])
    y, x = place.points(*(np.divide(size_mm, 2) * corners).T)
    return np.column_stack([x, y])


def with_t1(patches: pd.DataFrame, registration: pd.DataFrame) -> pd.DataFrame:
    """The patches with the position of T1 on T0, which is NaN if T1 was not located on T0.

    `registration` is the table of this name.
    """
    # patches have a turn, too
    of_t1 = registration.rename(columns={"rotation_deg": "t1_rotation_deg"})
    of_t1 = of_t1.set_index("patch").reindex(columns=["found", *_T1]).dropna()
    located = of_t1[of_t1.found.astype(bool)]
    return patches.join(located[_T1].astype(float), on="patch")


def covered_areas(
    patches: pd.DataFrame, size_mm: float
) -> dict[str, "shapely.Polygon"]:
    """The area on the square that T0 and T1 of a patch both cover, by patch.

    `patches` is from `with_t1`, and `size_mm` is the side of T0. Without a position of T1, it is
    the whole outline of the patch.
    """
    # ASSUME: Evenly spread points without a height. The points of T0 and T1 that were not measured
    # are evenly spread over the area that both scans cover. Reason: They then change neither the
    # mean loss nor the mean pressure of this area.
    import shapely

    places, areas = places_of(patches), {}
    for patch, place in places.items():
        areas[patch] = shapely.Polygon(outline(place, size_mm))
    of_t1 = patches.set_index("patch").reindex(columns=_T1).dropna()
    for patch, *row in of_t1.itertuples():
        v, u, turn, *sides = np.multiply(row, (1e-3, 1e-3, 1, 1e-3, 1e-3))
        before = places[patch]
        after = PatchPosition(*before.points(v, u), before.rotation_deg + turn)
        t1 = shapely.Polygon(outline(after, sides))
        areas[patch] = areas[patch].intersection(t1)
    return areas


def footprint_weights(
    grid: xr.DataArray, place: PatchPosition, size_mm: float
) -> np.ndarray:
    """Share (ny, nx), from 0 to 1, of each element's area inside a square footprint, exactly.

    `grid` is any field on the grid, dims (..., y, x), and `size_mm` is the side of the footprint.
    """
    import shapely

    return area_weights(grid, shapely.Polygon(outline(place, size_mm)))


def overlap(at: np.ndarray, step: float, centre: Any, size_mm: float) -> np.ndarray:
    """The length of each element, `at` its centre, within a side of a footprint."""
    half = size_mm / 2
    low = np.maximum(at - step / 2, centre - half)
    high = np.minimum(at + step / 2, centre + half)
    return np.clip(high - low, 0, None)


def area_weights(grid: xr.DataArray, area: "shapely.Polygon") -> np.ndarray:
    """Share (ny, nx), from 0 to 1, of each element's area inside a polygon (x, y), exactly."""
    import shapely

    dy, dx = spacing_of(grid)
    x_low, y_low, x_high, y_high = area.bounds
    height, width = y_high - y_low, x_high - x_low
    y, x = grid.y.values, grid.x.values
    if math.isclose(area.area, height * width):
        # an upright rectangle: as exact, and a hundred times as fast
        along_y = overlap(y, dy, (y_low + y_high) / 2, height)
        along_x = overlap(x, dx, (x_low + x_high) / 2, width)
        return np.outer(along_y, along_x) / (dy * dx)
    near_y = (y > y_low - dy) & (y < y_high + dy)
    near_x = (x > x_low - dx) & (x < x_high + dx)
    near = np.ix_(near_y, near_x)
    y, x = np.meshgrid(y[near_y], x[near_x], indexing="ij")
    elements = shapely.box(x - dx / 2, y - dy / 2, x + dx / 2, y + dy / 2)
    inside = shapely.intersection(elements, area)
    weights = np.zeros((grid.sizes["y"], grid.sizes["x"]))
    weights[near] = shapely.area(inside) / (dy * dx)
    return weights


def half_extent(size_mm: float, rotation_deg: Any) -> Any:
    """How far a rotated footprint reaches from its centre along x and y, mm."""
    angle = np.radians(rotation_deg)
    return size_mm / 2 * (abs(np.cos(angle)) + abs(np.sin(angle)))


def moved(
    patches: pd.DataFrame,
    shift_mm: Sequence[float | np.ndarray] | np.ndarray,
    face: xr.DataArray,
    size_mm: float,
) -> pd.DataFrame:
    """The patches moved along y and x, together or separately; they stay on the face.

    `face` is any field on the face, and `size_mm` is the side of a patch.
    """
    half = half_extent(size_mm, patches.rotation_deg.to_numpy())
    result = patches.copy()
    for axis, shift, step in zip("yx", shift_mm, spacing_of(face), strict=True):
        along = face[axis].values
        first = along[0] - step / 2 + half
        last = along[-1] + step / 2 - half
        place = patches[f"{axis}_mm"].to_numpy() + shift
        result[f"{axis}_mm"] = np.clip(place, first, last)
    return result
