"""From the macroscale contact to the pressure that each patch carries.

The force on a patch is the sum of the macroscale contact forces in its footprint; elements cut by
the footprint's edge count by the share of their area inside, so that footprints that tile a region
share its force out without loss, wherever they lie.
"""

# ASSUME: the x and y of a patch are those of its centre; the paper gives the place by its x and y.

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.surface import spacing_of

__all__ = ["footprint_weights", "patch_pressures", "select_patches", "shifted_places"]


def footprint_weights(
    grid: xr.DataArray | xr.Dataset, x: float, y: float, size: float, rotation_deg: float = 0.0
) -> np.ndarray:
    """Share of each element's area that lies inside a square footprint, exactly.

    Parameters
    ----------
    grid : xarray.DataArray or Dataset
        Anything on the grid, dims (..., y, x).
    x, y : float
        Centre of the footprint, mm.
    size : float
        Its side, mm.
    rotation_deg : float
        Its rotation about the normal, x towards y.

    Returns
    -------
    (ny, nx) ndarray
        From 0 (outside) to 1 (inside).
    """
    import shapely

    angle = np.radians(rotation_deg)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    corners = size / 2 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) @ turn.T + (x, y)
    footprint = shapely.polygons(corners)
    dy, dx = spacing_of(grid)
    rows, columns = (
        np.flatnonzero((centres + step / 2 > low) & (centres - step / 2 < high))
        for centres, step, low, high in (
            (grid.y.values, dy, corners[:, 1].min(), corners[:, 1].max()),
            (grid.x.values, dx, corners[:, 0].min(), corners[:, 0].max()),
        )
    )
    weights = np.zeros((grid.sizes["y"], grid.sizes["x"]))
    if len(rows) and len(columns):
        middle_y, middle_x = np.meshgrid(grid.y.values[rows], grid.x.values[columns], indexing="ij")
        elements = shapely.box(
            middle_x - dx / 2, middle_y - dy / 2, middle_x + dx / 2, middle_y + dy / 2
        )
        inside = shapely.area(shapely.intersection(elements, footprint))
        weights[np.ix_(rows, columns)] = inside / (dy * dx)
    return weights


def shifted_places(
    patches: pd.DataFrame, shift_um: Sequence[float], *, size_mm: float, square_mm: float
) -> pd.DataFrame:
    """The patch table with every patch shifted that has not been moved to where it was found.

    Parameters
    ----------
    patches : pandas.DataFrame
        ``x_mm, y_mm, rotation_deg``; ``place``, "found" for those that stay.
    shift_um : (x, y)
        One that would leave the square stays at its edge.
    size_mm, square_mm : float
        Sides of a patch and of the square.

    Returns
    -------
    pandas.DataFrame
        `patches` with ``place`` "shifted" where it is.
    """
    if not any(shift_um):
        return patches
    stays = patches.place == "found"
    angle = np.radians(patches.rotation_deg)
    half = size_mm / 2 * (abs(np.cos(angle)) + abs(np.sin(angle)))
    moved = {
        name: np.clip(patches[name] + shift * 1e-3, half, square_mm - half)
        for name, shift in zip(("x_mm", "y_mm"), shift_um, strict=True)
    }
    return patches.assign(
        **{name: patches[name].where(stays, values) for name, values in moved.items()},
        place=patches.place.where(stays, "shifted"),
    )


def patch_pressures(
    pressure: xr.DataArray, patches: pd.DataFrame, *, size_mm: float
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
    for patch in patches.itertuples(index=False):
        rotation = float(getattr(patch, "rotation_deg", 0.0))
        weights = footprint_weights(pressure, patch.x_mm, patch.y_mm, size_mm, rotation)
        force = float((values * weights).sum() * dy * dx)
        rows.append(
            {
                "patch": patch.patch,
                "x_mm": float(patch.x_mm),
                "y_mm": float(patch.y_mm),
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
    registration: pd.DataFrame | None,
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
    registration : pandas.DataFrame or None
        ``patch``, ``overlap`` (share of T0's area that T1 covers), ``correlation`` (NaN where T1
        was not found on T0); patches not in it have no T1 and are judged on their pressure alone.
    minimum_pressure_MPa : float
        A patch in the study carries more than 0 and at least this.
    minimum_overlap, minimum_correlation : float
        Asked of the registration of T1 to T0.

    Returns
    -------
    pandas.DataFrame
        `pressures` with ``in_study`` (bool) and ``reason`` (text, empty when in the study).
    """
    known = {} if registration is None else registration.set_index("patch").to_dict("index")
    reasons = []
    for row in pressures.itertuples(index=False):
        found = []
        if not row.pressure_MPa > 0:
            found.append("no macroscale contact")
        elif row.pressure_MPa < minimum_pressure_MPa:
            found.append(f"pressure {row.pressure_MPa:.3g} below {minimum_pressure_MPa:g} MPa")
        if row.patch in known:
            quality = known[row.patch]
            for name, least in (
                ("overlap", minimum_overlap),
                ("correlation", minimum_correlation),
            ):
                if math.isnan(quality[name]):
                    found.append("T1 was not found on T0")
                elif quality[name] < least:
                    found.append(f"T0/T1 {name} {quality[name]:.2f} below {least:.2f}")
        reasons.append("; ".join(found))
    return pressures.assign(in_study=[not text for text in reasons], reason=reasons)
