"""The coupling of the scales: what the macroscale contact gives to each patch.

The force on a patch is the sum of the macroscale contact forces in its footprint; elements cut by
the footprint's edge count by the share of their area inside. Footprints that tile a region thus
share out its force without loss, wherever they lie. The forces outside the footprint press the
patch down with its surroundings, and it tilts as the stone does. So does the whole square at the
scans' resolution in the face around it (`placed_faces` serves both).
"""

# ASSUME: the x and y of a patch are those of its centre; the paper gives the place by its x and y.

import pandas as pd
import xarray as xr

from gstlib.macroscale.ensemble import patch_means

__all__ = ["couple_scales", "patch_pressures"]


def patch_pressures(
    pressure: xr.DataArray, patches: pd.DataFrame, *, size_mm: float
) -> pd.DataFrame:
    """Nominal pressure of each patch from the macroscale contact pressure.

    Parameters
    ----------
    pressure : (ny, nx) xarray.DataArray
        Contact pressure at the target, MPa, in the square's frame (mm); the face may go beyond it.
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
    means, values = patch_means(pressure, patches, size_mm=size_mm), pressure.values.ravel()
    mean = means @ values
    peaks = [values[row.indices].max(initial=0.0) for row in means]
    table = patches[["patch", "x_mm", "y_mm", "rotation_deg"]].reset_index(drop=True)
    return table.assign(force_N=mean * size_mm**2, pressure_MPa=mean, peak_pressure_MPa=peaks)


def couple_scales(
    pressure: xr.DataArray,
    square_pressure: xr.DataArray,
    patches: pd.DataFrame,
    *,
    patch_mm: float,
) -> pd.DataFrame:
    """Pressure of each patch: the macroscale forces in its outline over its area (section 2.3).

    `pressure` (y, x), MPa, is that of the stone in equilibrium; `square_pressure` that of the
    square alone on its mean plane, the paper's; `patch_mm` is the side of a patch. The result is
    that of `patch_pressures` with ``square_pressure_MPa``, the pressure by the square alone.
    """
    pressures = patch_pressures(pressure, patches, size_mm=patch_mm)
    alone = patch_pressures(square_pressure, patches, size_mm=patch_mm)
    return pressures.assign(square_pressure_MPa=alone.pressure_MPa)
