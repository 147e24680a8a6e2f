"""The active stone's own roughness: a scan of its face against every patch.

Only the gap between two faces enters a contact, so that two rough faces touch as their sum touches
a flat. The counterface is prepared as a patch is, and seen from above its own face; to press it on
a patch it is turned over.
"""

from pathlib import Path

import numpy as np
import xarray as xr

from gstlib.errors import InputError
from gstlib.surface import spacing_of

__all__ = ["check_grid", "turned_over"]

# Spacings come from the instruments' files: this much apart (relative), they are the same.
_SAME_SPACING = 1e-6

# ASSUME: the counterface is turned over about the patch's y axis, so that its scan's columns run
# against the patch's x; the same piece of it, neither shifted nor worn, lies on every patch; at
# the macroscale the active stone stays flat. The paper's active stone is flat at both scales.


def turned_over(
    counterface: xr.DataArray, patch: xr.DataArray, *, source: str | Path, patch_source: str | Path
) -> xr.DataArray:
    """Heights of the counterface where they lie over the elements of a patch.

    Parameters
    ----------
    counterface : (ny, nx) xarray.DataArray
        Its heights, mm, positive out of it, seen from above its own face.
    patch : (ny, nx) xarray.DataArray
        The patch that it is pressed on.
    source, patch_source : path
        Their files, for the error message.

    Returns
    -------
    (ny, nx) xarray.DataArray
        mm, positive towards the patch, on the patch's grid: mirrored along x.

    Raises
    ------
    InputError
        Number or spacing of the points are not the patch's.
    """
    grid, patch_grid = ((face.shape, spacing_of(face)) for face in (counterface, patch))
    check_grid(grid, patch_grid, source=source, patch_source=patch_source)
    return patch.copy(data=counterface.values[:, ::-1]).assign_attrs(
        units="mm", long_name="height of the counterface, turned over onto the patch"
    )


def check_grid(
    counterface: tuple, patch: tuple, *, source: str | Path, patch_source: str | Path
) -> None:
    """Refuse a counterface whose points do not lie over those of a patch.

    Parameters
    ----------
    counterface, patch : ((ny, nx), (dy, dx))
        Shape and spacing (mm) of each.
    source, patch_source : path
        Their files, for the error message.

    Raises
    ------
    InputError
        Number or spacing of the points are not the patch's.
    """
    (shape, spacing), (patch_shape, patch_spacing) = grids = counterface, patch
    if shape != patch_shape or not np.allclose(spacing, patch_spacing, rtol=_SAME_SPACING, atol=0):
        told = [f"{n[1]} × {n[0]} points every {s[1]:g} × {s[0]:g} mm" for n, s in grids]
        raise InputError(
            source,
            f"the counterface has {told[0]}, but {patch_source} has {told[1]}",
            "Scan the counterface as the patches were scanned, or set counterface to null.",
        )
