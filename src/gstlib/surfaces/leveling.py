"""The least-squares plane of a surface, and its removal."""

import math
from dataclasses import dataclass

import numpy as np
import xarray as xr

from gstlib.errors import InputError
from gstlib.surfaces.grid import spacing_of_heights

__all__ = ["Plane", "fit_plane", "remove_plane"]


@dataclass(frozen=True)
class Plane:
    """z = offset + slope_x (x - x̄) + slope_y (y - ȳ), with (x̄, ȳ) the centre of the surface.

    Attributes
    ----------
    offset : float
        Height at the centre of the surface, mm.
    slope_y, slope_x : float
        Rise per length along y and x.
    """

    offset: float
    slope_y: float
    slope_x: float

    @property
    def tilt_x_mrad(self) -> float:
        """Angle of the plane along x, mrad, positive if it rises with x."""
        return 1e3 * math.atan(self.slope_x)

    @property
    def tilt_y_mrad(self) -> float:
        """Angle of the plane along y, mrad, positive if it rises with y."""
        return 1e3 * math.atan(self.slope_y)

    def heights(self, surface: xr.DataArray) -> np.ndarray:
        """The plane's heights (ny, nx), mm, on the grid of `surface`."""
        y, x = _centred(surface)
        return self.offset + self.slope_y * y[:, None] + self.slope_x * x


def remove_plane(surface: xr.DataArray) -> tuple[xr.DataArray, Plane]:
    """Remove the least-squares plane of the measured heights from a surface.

    Parameters
    ----------
    surface : (ny, nx) xarray.DataArray
        Heights, mm. NaN are ignored.

    Returns
    -------
    level : (ny, nx) xarray.DataArray
        The surface minus its plane.
    plane : Plane

    Raises
    ------
    InputError
        Fewer than three points are measured, or they are all on one line.

    Examples
    --------
    >>> import gstlib, numpy as np
    >>> slope = gstlib.make_surface(0.002 * np.indices((20, 30))[1], spacing=0.1)
    >>> level, plane = gstlib.remove_plane(slope)
    >>> round(plane.tilt_x_mrad, 2), bool(abs(level).max() < 1e-12)
    (20.0, True)
    """
    spacing_of_heights(surface)  # refuses what is no surface
    heights, (y, x) = surface.values, _centred(surface)
    plane = fit_plane(heights, y, x, source=surface.attrs.get("file", "surface"))
    return surface.copy(data=heights - plane.heights(surface)), plane


def fit_plane(
    heights: np.ndarray, y: np.ndarray, x: np.ndarray, *, source: str = ""
) -> Plane:
    """The least-squares plane of the measured heights (ny, nx), mm.

    `y` (ny,) and `x` (nx,) are counted from the centre of the grid, mm. Errors name `source` if no
    plane can be fitted. See `remove_plane`.
    """
    used = np.isfinite(heights)
    count = int(used.sum())
    # Sums along rows and columns avoid a matrix of all the points. Centring on the fitted points
    # separates the two slopes from the offset, and keeps the sums free of cancellation.
    per_row = used.sum(axis=1)
    per_column = used.sum(axis=0)
    y_mean = _dot(per_row, y) / max(count, 1)
    x_mean = _dot(per_column, x) / max(count, 1)
    dy = y - y_mean
    dx = x - x_mean
    z_mean = heights[used].mean() if count else math.nan
    z = np.where(used, heights - z_mean, 0.0)
    yy = _dot(per_row, dy**2)
    xx = _dot(per_column, dx**2)
    dx_of_rows = np.where(used, dx, 0.0).sum(axis=1)
    xy = _dot(dy, dx_of_rows)
    determinant = yy * xx - xy**2
    if not determinant > 1e-12 * (yy + xx) ** 2:
        raise InputError(
            source,
            f"a plane cannot be fitted to {count} measured points on one line",
            "Measure the patch again.",
        )
    zy = _dot(dy, z.sum(axis=1))
    zx = _dot(dx, z.sum(axis=0))
    slope_y = (xx * zy - xy * zx) / determinant
    slope_x = (yy * zx - xy * zy) / determinant
    offset = z_mean - slope_y * y_mean - slope_x * x_mean
    return Plane(float(offset), float(slope_y), float(slope_x))


def _dot(one: np.ndarray, other: np.ndarray) -> float:
    """Σ one·other without BLAS, whose sums differ in their last bits from run to run."""
    return float(np.einsum("i,i->", one, other))


def _centred(surface: xr.DataArray) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates y and x (mm) from the centre of the grid."""
    y, x = surface.y.values, surface.x.values
    middle_y = (y[0] + y[-1]) / 2
    middle_x = (x[0] + x[-1]) / 2
    return y - middle_y, x - middle_x
