"""Where things lie: places on the square, their outlines, and the square's frame on the stone.

On the square, y comes before x everywhere, as rows come before columns.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.surfaces.grid import axis_coordinates, spacing_of

if TYPE_CHECKING:
    import shapely

__all__ = [
    "PatchPosition",
    "area_weights",
    "covered_areas",
    "footprint_weights",
    "half_extent",
    "moved",
    "on_patch",
    "outline",
    "places_of",
    "rotated",
    "spline_of",
    "square_of",
    "with_t1",
]

# The place of T1 on T0 and its size, in the table of the patches.
_T1 = ["t1_y_um", "t1_x_um", "t1_rotation_deg", "t1_size_y_um", "t1_size_x_um"]


def rotated(v: Any, u: Any, rotation_deg: float) -> tuple[Any, Any]:
    """Offsets along y and x of what lies (v, u) along axes that are turned from x towards y."""
    turn = np.radians(rotation_deg)
    cosine, sine = np.cos(turn), np.sin(turn)
    return cosine * v + sine * u, cosine * u - sine * v


class PatchPosition(NamedTuple):
    """Where a scan lies on the square: its centre (mm) and its turn from x towards y."""

    y_mm: float
    x_mm: float
    rotation_deg: float = 0.0

    @classmethod
    def of(cls, at: xr.Dataset) -> "PatchPosition":
        """The place of one patch, from its ``y_mm, x_mm, rotation_deg``."""
        return cls(*(float(at[name]) for name in cls._fields))

    def points(self, v: Any, u: Any) -> tuple[Any, Any]:
        """Places (y, x) on the square of points (v, u) from the scan's centre, mm."""
        dy, dx = rotated(v, u, self.rotation_deg)
        return self.y_mm + dy, self.x_mm + dx

    def seen(self, y: Any, x: Any) -> tuple[Any, Any]:
        """Places (v, u) from the scan's centre of points (y, x) on the square, mm."""
        return rotated(y - self.y_mm, x - self.x_mm, -self.rotation_deg)


def places_of(patches: pd.DataFrame) -> dict[str, PatchPosition]:
    """Place of each patch, from ``patch, x_mm, y_mm, rotation_deg``."""
    rows = patches[["patch", "y_mm", "x_mm", "rotation_deg"]].itertuples(index=False)
    return {patch: PatchPosition(*map(float, place)) for patch, *place in rows}


def spline_of(field: xr.DataArray) -> "scipy.interpolate.RectBivariateSpline":
    """Cubic spline of a field (y, x) through its element centres; it is constant beyond them.

    Where the field is NaN, it takes the nearest value.
    """
    spacing_of(field)  # refuses what is no surface
    values = _filled(field.values)
    return scipy.interpolate.RectBivariateSpline(field.y.values, field.x.values, values)


def _filled(values: np.ndarray) -> np.ndarray:
    """Values (ny, nx), NaN replaced by the nearest ones."""
    if not (absent := np.isnan(values)).any():
        return values
    nearest = scipy.ndimage.distance_transform_edt(
        absent, return_distances=False, return_indices=True
    )
    return values[tuple(nearest)]


def square_of(field: xr.DataArray | xr.Dataset, size_mm: float) -> Any:
    """The part of a field (..., y, x) of the face that lies in the square of this side."""
    inside = {}
    for axis in "yx":
        along = field[axis].values
        inside[axis] = np.flatnonzero((along > 0) & (along < size_mm))
    return field.isel(inside)


def on_patch(
    spline: "scipy.interpolate.RectBivariateSpline",
    place: PatchPosition,
    shape: tuple[int, ...],
    size_mm: float,
) -> np.ndarray:
    """A field of the square at the points, of this `shape`, of the scan that lies at a place."""
    v, u = (axis_coordinates(count, size_mm / count) - size_mm / 2 for count in shape)
    if place.rotation_deg == 0:  # many times as fast
        return spline(place.y_mm + v, place.x_mm + u)
    return spline.ev(*place.points(v[:, None], u))


def outline(place: PatchPosition, size_mm: float | tuple[float, float]) -> np.ndarray:
    """Corners (4, 2), x and y (mm), of a footprint, the lower left first.

    `size_mm` is its side, or its extents along its own y and x.
    """
    signs = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1]])
    v, u = (signs * np.divide(size_mm, 2)).T
    y, x = place.points(v, u)
    return np.column_stack([x, y])


def with_t1(patches: pd.DataFrame, registration: pd.DataFrame) -> pd.DataFrame:
    """The patches with the place of T1 on T0; it is NaN where T1 was not found on T0.

    `registration` is the table of this name.
    """
    # patches have a turn, too
    of_t1 = registration.set_index("patch").rename(columns={"rotation_deg": "t1_rotation_deg"})
    of_t1 = of_t1.reindex(columns=["found", *_T1]).dropna()
    return patches.join(of_t1.loc[of_t1.found.astype(bool), _T1].astype(float), on="patch")


def covered_areas(patches: pd.DataFrame, size_mm: float) -> dict[str, "shapely.Polygon"]:
    """The area on the square that T0 and T1 of a patch both cover, by patch.

    `patches` is from `with_t1`, and `size_mm` is the side of T0. Patches without a known place of
    T1 are left out.
    """
    # ASSUME: the points of the two scans without a height of their own lie evenly over the area
    # that both cover, so that they change neither its mean loss nor its mean pressure.
    if not {*_T1} <= {*patches.columns}:
        return {}
    import shapely

    places, covered = places_of(patches), {}
    for patch, *of_t1 in patches[["patch", *_T1]].dropna().itertuples(index=False):
        v, u, turn, height, width = np.multiply(of_t1, (1e-3, 1e-3, 1, 1e-3, 1e-3))
        before = places[patch]
        after = PatchPosition(*before.points(v, u), before.rotation_deg + turn)
        t0, t1 = outline(before, size_mm), outline(after, (height, width))
        covered[patch] = shapely.Polygon(t0).intersection(shapely.Polygon(t1))
    return covered


def footprint_weights(grid: xr.DataArray, place: PatchPosition, size_mm: float) -> np.ndarray:
    """Share (ny, nx), from 0 to 1, of each element's area inside a square footprint, exactly.

    `grid` is any field on the grid, dims (..., y, x); `size_mm` is the footprint's side.
    """
    if place.rotation_deg != 0:
        import shapely

        return area_weights(grid, shapely.Polygon(outline(place, size_mm)))
    # as exact, and a hundred times as fast
    dy, dx = spacing_of(grid)
    half, overlap = size_mm / 2, []
    for at, step, centre in ((grid.y.values, dy, place.y_mm), (grid.x.values, dx, place.x_mm)):
        low, high = at - step / 2, at + step / 2
        inside = np.minimum(high, centre + half) - np.maximum(low, centre - half)
        overlap.append(np.clip(inside, 0, None))
    return np.outer(*overlap) / (dy * dx)


def area_weights(grid: xr.DataArray, area: "shapely.Polygon") -> np.ndarray:
    """Share (ny, nx), from 0 to 1, of each element's area inside a polygon (x, y), exactly."""
    import shapely

    dy, dx = spacing_of(grid)
    x_low, y_low, x_high, y_high = area.bounds
    near_y = (grid.y.values > y_low - dy) & (grid.y.values < y_high + dy)
    near_x = (grid.x.values > x_low - dx) & (grid.x.values < x_high + dx)
    near = np.ix_(near_y, near_x)
    y, x = np.meshgrid(grid.y.values[near_y], grid.x.values[near_x], indexing="ij")
    elements = shapely.box(x - dx / 2, y - dy / 2, x + dx / 2, y + dy / 2)
    weights = np.zeros((grid.sizes["y"], grid.sizes["x"]))
    weights[near] = shapely.area(shapely.intersection(elements, area)) / (dy * dx)
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
    """The patches moved along y and x, all alike or each by itself; none leaves the face.

    `face` is any field on it; `size_mm` is the side of a patch.
    """
    half = half_extent(size_mm, patches.rotation_deg.to_numpy())
    places = {}
    for name, by, axis, step in zip(
        ("y_mm", "x_mm"), shift_mm, "yx", spacing_of(face), strict=True
    ):
        along = face[axis].values
        first, last = along[0] - step / 2 + half, along[-1] + step / 2 - half
        places[name] = np.clip(patches[name].to_numpy() + by, first, last)
    return patches.assign(**places)
