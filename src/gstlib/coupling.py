"""From the macroscale contact to the pressure that each patch carries.

The force on a patch is the sum of the macroscale contact forces in its footprint; elements cut by
the footprint's edge count by the share of their area inside. Footprints that tile a region thus
share out its force without loss, wherever they lie.
"""

# ASSUME: the x and y of a patch are those of its centre; the paper gives the place by its x and y.

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem import HalfSpace, Layer
from gstlib.surface import axis_coordinates, spacing_of

if TYPE_CHECKING:
    from scipy.interpolate import RectBivariateSpline

__all__ = [
    "Place",
    "footprint_weights",
    "half_extent",
    "moved",
    "on_patch",
    "outline",
    "patch_pressures",
    "places_of",
    "spline_of",
    "surroundings",
]


class Place(NamedTuple):
    """Where a scan lies on the square: its centre (mm) and its turn from x towards y."""

    y_mm: float
    x_mm: float
    rotation_deg: float

    def points(self, v: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places (y, x) on the square of points (v, u) from the scan's centre, mm."""
        turn = np.radians(self.rotation_deg)
        y = self.y_mm + np.cos(turn) * v + np.sin(turn) * u
        return y, self.x_mm + np.cos(turn) * u - np.sin(turn) * v


def places_of(patches: pd.DataFrame) -> dict[str, Place]:
    """Place of each patch, from ``patch, x_mm, y_mm, rotation_deg``."""
    rows = patches[["patch", "y_mm", "x_mm", "rotation_deg"]].itertuples(index=False)
    return {patch: Place(*map(float, place)) for patch, *place in rows}


def spline_of(field: xr.DataArray) -> "RectBivariateSpline":
    """Cubic spline of a field (y, x) through its element centres; it is constant beyond them."""
    from scipy.interpolate import RectBivariateSpline  # half a second, and rarely needed

    return RectBivariateSpline(field.y.values, field.x.values, field.values)


def on_patch(
    spline: "RectBivariateSpline", place: Place, shape: tuple[int, ...], size_mm: float
) -> np.ndarray:
    """A field of the square at the points, of this `shape`, of the scan that lies at a place."""
    v, u = (axis_coordinates(count, size_mm / count) - size_mm / 2 for count in shape)
    if place.rotation_deg == 0:  # many times as fast
        return spline(place.y_mm + v, place.x_mm + u)
    return spline.ev(*place.points(v[:, None], u))


def outline(place: Place, size_mm: float) -> np.ndarray:
    """Corners (4, 2), x and y (mm), of a square footprint; before a turn the lower left first."""
    v, u = size_mm / 2 * np.array([[-1, -1, 1, 1], [-1, 1, 1, -1]])
    return np.column_stack(place.points(v, u)[::-1])


def footprint_weights(
    grid: xr.DataArray | xr.Dataset, place: Place, size_mm: float
) -> np.ndarray:
    """Share (ny, nx), from 0 to 1, of each element's area inside a square footprint, exactly.

    `grid` is any variable on the grid, dims (..., y, x); `size_mm` is the footprint's side.
    """
    dy, dx = spacing_of(grid)
    if place.rotation_deg == 0:  # as exact, and a hundred times as fast
        overlap = []
        for at, step, centre in (("y", dy, place.y_mm), ("x", dx, place.x_mm)):
            low, high = grid[at].values - step / 2, grid[at].values + step / 2
            half = size_mm / 2
            inside = np.minimum(high, centre + half) - np.maximum(low, centre - half)
            overlap.append(np.clip(inside, 0, None))
        return np.outer(*overlap) / (dy * dx)
    import shapely

    y, x = np.meshgrid(grid.y.values, grid.x.values, indexing="ij")
    near = (abs(y - place.y_mm) < size_mm + dy) & (abs(x - place.x_mm) < size_mm + dx)
    y, x, weights = y[near], x[near], np.zeros(near.shape)
    elements = shapely.box(x - dx / 2, y - dy / 2, x + dx / 2, y + dy / 2)
    inside = shapely.intersection(elements, shapely.polygons(outline(place, size_mm)))
    weights[near] = shapely.area(inside) / (dy * dx)
    return weights


def half_extent(size_mm: float, rotation_deg: float | pd.Series) -> float | pd.Series:
    """How far a rotated footprint reaches from its centre along x and y, mm."""
    angle = np.radians(rotation_deg)
    return size_mm / 2 * (abs(np.cos(angle)) + abs(np.sin(angle)))


def moved(
    patches: pd.DataFrame,
    shift_mm: Sequence[float | np.ndarray] | np.ndarray,
    square: xr.DataArray | xr.Dataset,
    size_mm: float,
) -> pd.DataFrame:
    """The patches moved along x and y, all alike or each by itself; none leaves the square."""
    half = half_extent(size_mm, patches.rotation_deg)
    last = spacing_of(square)[0] * square.sizes["y"] - half
    x, y = (patches[name] + by for name, by in zip(("x_mm", "y_mm"), shift_mm, strict=True))
    return patches.assign(x_mm=x.clip(half, last), y_mm=y.clip(half, last))


def patch_pressures(
    pressure: xr.DataArray, patches: pd.DataFrame, *, size_mm: float
) -> pd.DataFrame:
    """Nominal pressure of each patch from the macroscale contact pressure.

    Parameters
    ----------
    pressure : (ny, nx) xarray.DataArray
        Contact pressure at the target, MPa, in the square's frame (mm).
    patches : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg``.
    size_mm : float
        Side of a patch.

    Returns
    -------
    pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg``; ``force_N``, the force on the footprint;
        ``pressure_MPa``, over its nominal area; ``peak_pressure_MPa``, largest pressure of an
        element in it.
    """
    area, values, rows = np.prod(spacing_of(pressure)), pressure.values, []
    for place in places_of(patches).values():
        weights = footprint_weights(pressure, place, size_mm)
        force = float((values * weights).sum() * area)
        peak = float(values[weights > 0].max(initial=0.0))
        rows.append((force, force / size_mm**2, peak))
    found = "force_N", "pressure_MPa", "peak_pressure_MPa"
    table = patches[["patch", "x_mm", "y_mm", "rotation_deg"]].reset_index(drop=True)
    return table.join(pd.DataFrame(rows, columns=found))


def surroundings(
    pressure: xr.DataArray,
    place: Place,
    shape: tuple[int, int],
    *,
    size_mm: float,
    contact_modulus_MPa: float,
    layer: Layer | None = None,
) -> np.ndarray:
    """Displacement of a patch by the macroscale pressures outside its outline.

    `pressure` (y, x) is the macroscale contact pressure, MPa; of an element that the edge cuts, the
    share of its area outside counts. A `layer` may be in front of the stone. The result is of
    `shape`, that of the scan, in mm, positive into the stone.
    """
    inside = footprint_weights(pressure, place, size_mm)
    square = HalfSpace(pressure.shape, spacing_of(pressure), contact_modulus_MPa, layer=layer)
    displaced = pressure.copy(data=square.displacement(pressure.values * (1 - inside)))
    return on_patch(spline_of(displaced), place, shape, size_mm)
