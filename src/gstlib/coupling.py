"""From the macroscale contact to the pressure that each patch carries.

The force on a patch is the sum of the macroscale contact forces in its footprint; elements cut by
the footprint's edge count by the share of their area inside. Footprints that tile a region thus
share out its force without loss, wherever they lie.
"""

# ASSUME: the x and y of a patch are those of its centre; the paper gives the place by its x and y.

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from scipy.interpolate import RectBivariateSpline

from gstlib.bem import HalfSpace, Layer
from gstlib.surface import axis_coordinates, spacing_of

__all__ = [
    "Place",
    "footprint_weights",
    "half_extent",
    "on_patch",
    "patch_pressures",
    "places_of",
    "shifted",
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


def spline_of(field: xr.DataArray) -> RectBivariateSpline:
    """Cubic spline of a field (y, x) through its element centres; it is constant beyond them."""
    return RectBivariateSpline(field.y.values, field.x.values, field.values)


def on_patch(
    spline: RectBivariateSpline, place: Place, shape: tuple[int, ...], size_mm: float
) -> np.ndarray:
    """A field of the square at the points, of this `shape`, of the scan that lies at a place."""
    v, u = (axis_coordinates(count, size_mm / count) - size_mm / 2 for count in shape)
    if place.rotation_deg == 0:  # many times as fast
        return spline(place.y_mm + v, place.x_mm + u)
    return spline.ev(*place.points(v[:, None], u))


def footprint_weights(
    grid: xr.DataArray | xr.Dataset, x: float, y: float, size: float, rotation_deg: float = 0.0
) -> np.ndarray:
    """Share of each element's area that lies inside a square footprint, exactly.

    Parameters
    ----------
    grid : xarray.DataArray or Dataset
        Any variable on the grid, dims (..., y, x).
    x, y : float
        Centre of the footprint, mm.
    size : float
        Its side, mm.
    rotation_deg : float
        Its rotation about the normal, from x towards y.

    Returns
    -------
    (ny, nx) ndarray
        From 0 (outside) to 1 (inside).
    """
    if rotation_deg == 0:  # as exact, and a hundred times as fast
        overlap = []
        for at, step, centre in zip("yx", spacing_of(grid), (y, x), strict=True):
            low, high = grid[at].values - step / 2, grid[at].values + step / 2
            inside = np.minimum(high, centre + size / 2) - np.maximum(low, centre - size / 2)
            overlap.append(np.clip(inside, 0, None))
        return np.outer(*overlap) / np.prod(spacing_of(grid))
    import shapely

    angle = np.radians(rotation_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    corners = size / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ turn.T + (x, y)
    dy, dx = spacing_of(grid)
    at_y, at_x = np.meshgrid(grid.y.values, grid.x.values, indexing="ij")
    reach = half_extent(size, rotation_deg)
    near = (np.abs(at_y - y) < reach + dy / 2) & (np.abs(at_x - x) < reach + dx / 2)
    at_y, at_x = at_y[near], at_x[near]
    elements = shapely.box(at_x - dx / 2, at_y - dy / 2, at_x + dx / 2, at_y + dy / 2)
    weights = np.zeros(near.shape)
    inside = shapely.area(shapely.intersection(elements, shapely.polygons(corners)))
    weights[near] = inside / (dy * dx)
    return weights


def half_extent(size_mm: float, rotation_deg: float | pd.Series) -> float | pd.Series:
    """How far a rotated footprint reaches from its centre along x and y, mm."""
    angle = np.radians(rotation_deg)
    return size_mm / 2 * (abs(np.cos(angle)) + abs(np.sin(angle)))


def shifted(
    patches: pd.DataFrame,
    shift_um: Sequence[float],
    square: xr.DataArray | xr.Dataset,
    *,
    size_mm: float,
) -> pd.DataFrame:
    """The patch table with all patches shifted by (x, y), µm; none leaves the square.

    ``rotation_deg`` is 0 where the table has none.
    """
    table = patches.assign(rotation_deg=patches.get("rotation_deg", 0.0))
    if any(shift_um):
        half = half_extent(size_mm, table.rotation_deg)
        square_mm = spacing_of(square)[0] * square.sizes["y"]
        for name, shift in zip(("x_mm", "y_mm"), shift_um, strict=True):
            table[name] = (table[name] + shift * 1e-3).clip(half, square_mm - half)
    return table


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
        ``pressure_MPa``, over its nominal area; ``contact_fraction``, share of that area in
        elements that are in contact; ``peak_pressure_MPa``, largest pressure of an element in it.
    """
    dy, dx = spacing_of(pressure)
    values = pressure.values
    rows = []
    names = ["patch", "x_mm", "y_mm", "rotation_deg"]
    for patch, x, y, rotation in patches[names].itertuples(index=False):
        weights = footprint_weights(pressure, x, y, size_mm, rotation)
        force = float((values * weights).sum() * dy * dx)
        touching = float(weights[values > 0].sum() * dy * dx / size_mm**2)
        peak = float(values[weights > 0].max(initial=0.0))
        rows.append((patch, x, y, rotation, force, force / size_mm**2, touching, peak))
    found = "force_N", "pressure_MPa", "contact_fraction", "peak_pressure_MPa"
    return pd.DataFrame(rows, columns=[*names, *found])


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
    inside = footprint_weights(pressure, place.x_mm, place.y_mm, size_mm, place.rotation_deg)
    square = HalfSpace(pressure.shape, spacing_of(pressure), contact_modulus_MPa, layer=layer)
    displaced = pressure.copy(data=square.displacement(pressure.values * (1 - inside)))
    return on_patch(spline_of(displaced), place, shape, size_mm)
