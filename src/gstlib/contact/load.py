"""The load on two faces: a mean pressure, and the point through which it acts."""

from typing import NamedTuple

import numpy as np
import xarray as xr

from gstlib.surfaces.grid import spacing_of

__all__ = ["Load", "from_corner"]


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


def from_corner(
    place: tuple[float, float], surface: xr.DataArray
) -> tuple[float, float]:
    """A point (y, x), mm, on a surface, counted from the corner of its grid."""
    y, x = (
        along - (float(surface[axis][0]) - step / 2)
        for along, axis, step in zip(place, "yx", spacing_of(surface), strict=True)
    )
    return y, x
