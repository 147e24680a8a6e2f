"""The coupling of the scales: macroscale contact pressures on each patch.

The force on a patch is the sum of the macroscale contact forces in its footprint. Elements that the
edge of the footprint cuts count by the fraction of their area inside. So footprints that tile a
region share its force without loss, wherever they lie. The forces outside the footprint displace
the patch with its surroundings, and it tilts with the stone. The whole square at the scans'
resolution is treated likewise in the face around it (`placed_faces` serves both).
"""

# ASSUME: Reference point of a patch. The x and y of a patch are the coordinates of its centre.
# Reason: The paper gives the position by x and y without naming the point.

import pandas as pd
import xarray as xr

from gstlib.macroscale.ensemble import patch_means
from gstlib.surfaces.footprints import with_t1

__all__ = ["couple_scales", "covered", "covered_pressures", "patch_pressures", "stated"]
__all__ += ["unseen"]


def patch_pressures(
    pressure: xr.DataArray, patches: pd.DataFrame, *, size_mm: float
) -> pd.DataFrame:
    """Nominal pressure of each patch from the macroscale contact pressure.

    Parameters
    ----------
    pressure : (ny, nx) xarray.DataArray
        Contact pressure at the target, MPa, in the frame of the square (mm). The face may be
        larger.
    patches : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg``.
    size_mm : float
        Side of a patch, mm.

    Returns
    -------
    pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg``; ``force_N``, the force on the footprint;
        ``pressure_MPa``, this force over the nominal area; ``peak_pressure_MPa``, the largest
        pressure of an element in the footprint.
    """
    table = patches[["patch", "x_mm", "y_mm", "rotation_deg"]].reset_index(drop=True)
    means, values = (
        patch_means(pressure, table, size_mm=size_mm),
        pressure.values.ravel(),
    )
    mean = means @ values
    peaks = [values[row.indices].max(initial=0.0) for row in means]
    return table.assign(
        force_N=mean * size_mm**2, pressure_MPa=mean, peak_pressure_MPa=peaks
    )


def couple_scales(
    pressure: xr.DataArray,
    square_pressure: xr.DataArray,
    patches: pd.DataFrame,
    *,
    patch_mm: float,
) -> pd.DataFrame:
    """Pressure of each patch: the macroscale forces in its outline over its area (section 2.3).

    `pressure` (y, x), MPa, belongs to the stone in equilibrium; `square_pressure` to the square
    alone on its mean plane, as in the paper. `patch_mm` is the side of a patch. The result is the
    table of `patch_pressures` with ``square_pressure_MPa``, the pressure by the square alone.

    Examples
    --------
    A patch of 0.5 mm carries 3 N of a pressure of 12 MPa at any rotation:

    >>> import gstlib
    >>> import numpy as np
    >>> pressure = gstlib.make_surface(np.full((20, 20), 12.0), 0.1)
    >>> place = {"patch": ["1"], "x_mm": 1.0, "y_mm": 0.8, "rotation_deg": 30.0}
    >>> table = gstlib.couple_scales(pressure, pressure, pd.DataFrame(place), patch_mm=0.5)
    >>> round(float(table.force_N[0]), 6)
    3.0
    """
    pressures = patch_pressures(pressure, patches, size_mm=patch_mm)
    alone = patch_pressures(square_pressure, patches, size_mm=patch_mm)
    return pressures.assign(square_pressure_MPa=alone.pressure_MPa)


def covered_pressures(
    pressures: pd.DataFrame,
    pressure: xr.DataArray,
    registration: pd.DataFrame,
    *,
    patch_mm: float,
) -> pd.DataFrame:
    """The table of pressures with ``covered_MPa``, over the area that T0 and T1 both cover.

    A measured loss refers to this area. Without a registered T1, it is the outline. `pressures` and
    `pressure` are as in `couple_scales`; `registration` is the table of this name, and has no rows
    without a T1. ``leave_one_out_MPa`` then refers to this area, too.
    """
    areas = with_t1(pressures, registration)
    over_area, over_outline = (
        patch_means(pressure, patches, size_mm=patch_mm) @ pressure.values.ravel()
        for patches in (areas, pressures)
    )
    table = pressures.assign(covered_MPa=over_area)
    if "leave_one_out_MPa" in table:
        moved = table.leave_one_out_MPa + over_area - over_outline
        table["leave_one_out_MPa"] = moved.clip(lower=0.0)
    return table


def covered(pressures: pd.DataFrame) -> pd.Series:
    """Pressures, MPa, over the areas of the measured losses, from the table ``patch_pressures``."""
    pressure: pd.Series = pressures.get("covered_MPa", pressures.pressure_MPa)
    return pressure


def unseen(pressures: pd.DataFrame) -> pd.Series:
    """Pressures, MPa, without influence of the patch's own wear, so that an answer is not circular.

    `pressures` is the table ``patch_pressures``, with ``leave_one_out_MPa`` if a load case was
    inferred (`gstlib.use.outcome.pressures_of_use`).
    """
    return _first_known(pressures, "leave_one_out_MPa")


def stated(pressures: pd.DataFrame) -> pd.Series:
    """Pressures, MPa, under the prior load case, without influence of any wear."""
    return _first_known(pressures, "stated_MPa")


def _first_known(pressures: pd.DataFrame, column: str) -> pd.Series:
    if column not in pressures:
        return covered(pressures)
    return pressures[column].fillna(covered(pressures))
