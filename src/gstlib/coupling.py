"""From the macroscale contact to the pressure that each patch carries.

The force on a patch is the sum of the macroscale contact forces in its footprint; elements cut by
the footprint's edge count by the share of their area inside. Footprints that tile a region thus
share out its force without loss, wherever they lie.
"""

# ASSUME: the x and y of a patch are those of its centre; the paper gives the place by its x and y.

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.surface import spacing_of

__all__ = ["footprint_weights", "half_extent", "patch_pressures", "select_patches"]


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


def patch_pressures(
    pressure: xr.DataArray,
    patches: pd.DataFrame,
    *,
    size_mm: float,
    shift_um: Sequence[float] = (0.0, 0.0),
) -> pd.DataFrame:
    """Nominal pressure of each patch from the macroscale contact pressure.

    Parameters
    ----------
    pressure : (ny, nx) xarray.DataArray
        Contact pressure at the target, MPa, in the square's frame (mm).
    patches : pandas.DataFrame
        Patch table (`gstlib.io.patches.read_patches`).
    size_mm : float
        Side of a patch.
    shift_um : (x, y)
        Shift of all patches; one that would leave the square stays at its edge.

    Returns
    -------
    pandas.DataFrame
        ``patch, x_mm, y_mm``; ``place``, "nominal" or "shifted"; ``rotation_deg``; ``force_N``, the
        force on the footprint; ``pressure_MPa``, over its nominal area; ``contact_fraction``, share
        of that area in elements that are in contact; ``peak_pressure_MPa``, largest pressure of an
        element in it.
    """
    dy, dx = spacing_of(pressure)
    values, sides = pressure.values, (pressure.sizes["x"] * dx, pressure.sizes["y"] * dy)
    rows = []
    for patch in patches.itertuples(index=False):
        rotation = float(getattr(patch, "rotation_deg", 0.0))
        x, y = float(patch.x_mm), float(patch.y_mm)
        if any(shift_um):
            half = half_extent(size_mm, rotation)
            x, y = (
                float(np.clip(place + shift * 1e-3, half, side - half))
                for place, shift, side in zip((x, y), shift_um, sides, strict=True)
            )
        weights = footprint_weights(pressure, x, y, size_mm, rotation)
        force = float((values * weights).sum() * dy * dx)
        rows.append(
            {
                "patch": patch.patch,
                "x_mm": x,
                "y_mm": y,
                "place": "shifted" if any(shift_um) else "nominal",
                "rotation_deg": rotation,
                "force_N": force,
                "pressure_MPa": force / size_mm**2,
                "contact_fraction": float(weights[values > 0].sum() * dy * dx / size_mm**2),
                "peak_pressure_MPa": float(values[weights > 0].max(initial=0.0)),
            }
        )
    return pd.DataFrame(rows)


def select_patches(
    pressures: pd.DataFrame,
    registration: pd.DataFrame,
    *,
    minimum_pressure_MPa: float,
    minimum_overlap: float,
    minimum_correlation: float,
) -> pd.DataFrame:
    """Which patches go into the microscale study, by rule.

    Parameters
    ----------
    pressures : pandas.DataFrame
        From `patch_pressures`.
    registration : pandas.DataFrame
        ``patch, overlap`` (share of T0's area that T1 covers), ``correlation`` (NaN where T1 was
        not found on T0). Patches that it lacks have no T1: their pressure alone decides.
    minimum_pressure_MPa : float
        A patch in the study carries at least this, and more than 0.
    minimum_overlap, minimum_correlation : float
        Least values that the registration of T1 to T0 must reach.

    Returns
    -------
    pandas.DataFrame
        `pressures` with ``in_study`` (bool) and ``reason`` (text, empty when in the study).
    """
    known = registration.set_index("patch").to_dict("index")
    least = {"overlap": minimum_overlap, "correlation": minimum_correlation}
    reasons = []
    for row in pressures.itertuples(index=False):
        found = []
        if not row.pressure_MPa > 0:
            found.append("no macroscale contact")
        elif row.pressure_MPa < minimum_pressure_MPa:
            found.append(f"pressure {row.pressure_MPa:.3g} below {minimum_pressure_MPa:g} MPa")
        quality = known.get(row.patch, {})
        if any(math.isnan(quality.get(name, 1.0)) for name in least):
            found.append("T1 was not found on T0")
        found += [
            f"T0/T1 {name} {quality[name]:.2f} below {value:.2f}"
            for name, value in least.items()
            if quality and quality[name] < value
        ]
        reasons.append("; ".join(found))
    return pressures.assign(in_study=[not text for text in reasons], reason=reasons)
