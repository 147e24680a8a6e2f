"""What is pressed: two faces, and the load on them.

The active tool's own face, scanned as the patches were, is turned over onto one of them.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from gstlib.errors import InputError
from gstlib.surfaces.grid import spacing_of, spacing_of_heights
from gstlib.surfaces.leveling import Plane

__all__ = ["Interface", "Load", "check_grid", "turned_over"]

# Spacings come from the instruments' files: up to this relative difference they are the same.
_SAME_SPACING = 1e-6
# The plane of a surface that is not tilted.
_LEVEL = Plane(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Interface:
    """Two faces as they are pressed on each other.

    Attributes
    ----------
    height : (y, x) xarray.DataArray
        A levelled surface, mm, NaN where it is missing.
    counterface : (y, x) xarray.DataArray
        The face pressed on it, mm, positive towards it, as from `turned_over`. It is NaN where it
        is missing, and 0 for a flat.
    plane : Plane
        The plane on which the surface is placed. Only its slopes matter.
    surroundings : (ny, nx) ndarray or None
        Displacement (mm, into the stone) by pressures around it. None for a surface without
        surroundings.

    Examples
    --------
    A flat on a plane rises along it:

    >>> import numpy as np
    >>> import gstlib
    >>> flat = gstlib.Interface.on_flat(gstlib.make_surface(np.zeros((2, 3)), 0.1))
    >>> flat.tilted((0.0, 0.01)).pressed.values[0].round(4)
    array([-0.001,  0.   ,  0.001])
    """

    height: xr.DataArray
    counterface: xr.DataArray
    plane: Plane = _LEVEL
    surroundings: np.ndarray | None = None

    def __post_init__(self) -> None:
        grids = _grid_of(self.counterface), _grid_of(self.height)
        check_grid(*grids, source="counterface", patch_source="the surface")

    @classmethod
    def on_flat(cls, height: xr.DataArray) -> "Interface":
        """A surface under a flat."""
        return cls(height, xr.zeros_like(height))

    @classmethod
    def from_dataset(cls, stored: xr.Dataset) -> "Interface":
        """The interface in a dataset from `Contact.to_dataset`."""
        plane = Plane(0.0, float(stored.slope_y), float(stored.slope_x))
        around = stored.surroundings.values if bool(stored.placed) else None
        return cls(stored.height, stored.counterface, plane, around)

    @property
    def laid(self) -> xr.DataArray:
        """Heights (mm) of the surface on its plane, plus the heights of the face on it.

        Notes
        -----
        Only the gap between two faces enters a contact of half-spaces, so that heights add
        (Bemporad & Paggi, Int. J. Solids Struct. 69-70 (2015) 465).
        """
        plane = replace(self.plane, offset=0.0).heights(self.height)
        heights = self.height.values + plane + self.counterface.values
        return self.height.copy(data=heights)

    @property
    def pressed(self) -> xr.DataArray:
        """Heights (mm) of the surface that touches a flat as the two faces touch each other.

        The heights `laid` minus the displacement by the surroundings.
        """
        laid = self.laid
        around = 0.0 if self.surroundings is None else self.surroundings
        return laid.copy(data=laid.values - around)

    @property
    def covered(self) -> float:
        """Share of the elements where both faces are."""
        return float(np.isfinite(self.pressed.values).mean())

    @property
    def for_solver(self) -> tuple[np.ndarray, tuple[float, float]]:
        """Heights and spacing for `gstlib.bem`. Heights are −∞ where a face is missing."""
        heights = self.pressed
        return heights.fillna(-np.inf).values, spacing_of(heights)

    def tilted(self, tilt: tuple[float, float]) -> "Interface":
        """The same, with the surface tilted further, by slopes along y and x."""
        plane = self.plane
        slopes = plane.slope_y + tilt[0], plane.slope_x + tilt[1]
        return replace(self, plane=Plane(plane.offset, *slopes))


class Load(NamedTuple):
    """The load that presses two faces on each other.

    Attributes
    ----------
    mean_pressure : float
        MPa, over the nominal area.
    load_point : (float, float) or None
        Point (y, x), mm, on the surface, through which the force acts on a body that is free to
        tilt. If it is None, the plane is fixed.

    Examples
    --------
    >>> import numpy as np
    >>> import gstlib
    >>> square = gstlib.make_surface(np.zeros((50, 50)), 0.1)
    >>> round(gstlib.Load.of_force(550.0, square).mean_pressure, 3)
    22.0
    """

    mean_pressure: float
    load_point: tuple[float, float] | None = None

    @classmethod
    def of_force(
        cls,
        force_N: float,
        surface: xr.DataArray,
        load_point: tuple[float, float] | None = None,
    ) -> "Load":
        """A force (N) on a surface."""
        area = surface.size * float(np.prod(spacing_of(surface)))
        return cls(force_N / area, load_point)

    def from_corner(self, surface: xr.DataArray) -> tuple[float, float] | None:
        """The load point (y, x), mm, counted from the corner of the surface's grid."""
        if self.load_point is None:
            return None
        y, x = (
            along - (float(surface[axis][0]) - step / 2)
            for along, axis, step in zip(
                self.load_point, "yx", spacing_of(surface), strict=True
            )
        )
        return y, x


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
    grids = _grid_of(counterface), _grid_of(patch)
    check_grid(*grids, source=source, patch_source=patch_source)
    return patch.copy(data=counterface.values[:, ::-1]).assign_attrs(
        units="mm", long_name="height of the counterface, turned over onto the patch"
    )


def check_grid(
    counterface: tuple, patch: tuple, *, source: str | Path, patch_source: str | Path
) -> None:
    """Refuse a counterface whose points do not match those of a patch, as `turned_over` does.

    Each is given as ((ny, nx), (dy, dx)): shape and spacing, mm.
    """
    shapes, spacings = zip(counterface, patch, strict=True)
    is_alike = np.allclose(*spacings, rtol=_SAME_SPACING, atol=0)
    if is_alike and shapes[0] == shapes[1]:
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


def _grid_of(face: xr.DataArray) -> tuple:
    return face.shape, spacing_of_heights(face)
