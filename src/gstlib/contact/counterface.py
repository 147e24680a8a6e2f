"""The active tool's own face, scanned as the patches were, and turned over onto one of them."""

from pathlib import Path

import numpy as np
import xarray as xr

from gstlib.errors import InputError
from gstlib.surfaces.grid import spacing_of

__all__ = ["check_grid", "turned_over"]

# Spacings come from the instruments' files: up to this relative difference they are the same.
_SAME_SPACING = 1e-6

# ASSUME: Counterface turned over and repeated. The counterface is turned over about the patch's y
# axis, so that the columns of its scan run against the patch's x. The same piece, neither shifted
# nor worn, is pressed on every patch. Reason: The paper's active tool is flat at both scales and
# needs no position.


def turned_over(
    counterface: xr.DataArray,
    patch: xr.DataArray,
    *,
    source: str | Path,
    patch_source: str | Path,
) -> xr.DataArray:
    """Heights of the active tool's face on a patch.

    `counterface` (ny, nx) contains its heights, mm, positive out of it, seen from above its face.
    The result is positive towards the patch, on the patch's grid: mirrored along x. `source` and
    `patch_source` are their files, for the error message.

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
    """Refuse a counterface whose points do not match those of a patch, as `turned_over` does.

    Each is given as ((ny, nx), (dy, dx)): shape and spacing, mm.
    """
    (shape, spacing), (patch_shape, patch_spacing) = counterface, patch
    if shape == patch_shape and np.allclose(
        spacing, patch_spacing, rtol=_SAME_SPACING, atol=0
    ):
        return
    own, other = (
        f"{n[1]} × {n[0]} points every {s[1]:g} × {s[0]:g} mm"
        for n, s in (counterface, patch)
    )
    raise InputError(
        source,
        f"the counterface has {own}, but {patch_source} has {other}",
        "Scan the counterface as the patches were scanned, or set counterface to null.",
    )
