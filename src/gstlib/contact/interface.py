"""Two faces as they are pressed on each other."""

from dataclasses import dataclass, replace

import numpy as np
import xarray as xr

from gstlib.surfaces.grid import spacing_of, spacing_of_heights
from gstlib.surfaces.leveling import Plane

__all__ = ["LEVEL", "Interface"]

# Spacings come from coordinates: up to this relative difference they are the same.
_SAME_SPACING = 1e-6
# The plane of a surface that is not tilted.
LEVEL = Plane(0.0, 0.0, 0.0)


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
    plane: Plane = LEVEL
    surroundings: np.ndarray | None = None

    def __post_init__(self) -> None:
        shape, other_shape = self.height.shape, self.counterface.shape
        spacing, other_spacing = map(
            spacing_of_heights, (self.height, self.counterface)
        )
        is_alike = np.allclose(spacing, other_spacing, rtol=_SAME_SPACING, atol=0)
        if shape != other_shape or not is_alike:
            raise ValueError(
                f"the surface has {shape} elements of {spacing} mm and the counterface "
                f"{other_shape} of {other_spacing} mm: give both on one grid"
            )

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
        return self.height.copy(
            data=self.height.values + plane + self.counterface.values
        )

    @property
    def pressed(self) -> xr.DataArray:
        """Heights (mm) of the surface that touches a flat as the two faces touch each other.

        The heights `laid` minus the displacement by the surroundings.
        """
        laid = self.laid
        if self.surroundings is None:
            return laid
        return laid.copy(data=laid.values - self.surroundings)

    @property
    def covered(self) -> float:
        """Share of the elements where both faces are."""
        return float(np.isfinite(self.pressed.values).mean())

    @property
    def for_solver(self) -> tuple[np.ndarray, tuple[float, float]]:
        """Heights and spacing for `gstlib.bem`. Heights are −∞ where a face is missing."""
        heights = self.pressed
        missing = np.isnan(heights.values)
        return np.where(missing, -np.inf, heights.values), spacing_of(heights)

    def tilted(self, tilt: tuple[float, float]) -> "Interface":
        """The same, with the surface tilted further, by slopes along y and x."""
        slope_y = self.plane.slope_y + tilt[0]
        slope_x = self.plane.slope_x + tilt[1]
        plane = replace(self.plane, slope_y=slope_y, slope_x=slope_x)
        return replace(self, plane=plane)
