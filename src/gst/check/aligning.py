"""Best position of scans on a surface, between its elements, with its standard error.

The residuals between scans and surface are smooth, not white noise. Their number of independent
values is the number of waves on the area of the scans, down to the shortest wave. It follows from
the slopes of the residuals. The fit uses some of these values. The others determine the variance,
and the variance determines the covariance of position and rotation.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from gst.check.sliding import Template, sides_of, wrapped
from gstlib.surfaces.fitting import planes_over, residuals
from gstlib.surfaces.footprints import PatchPosition, spline_of
from gstlib.surfaces.grid import spacing_of

# Points along the side of a scan that are enough to refine its position.
_REFINED = 100
# Parameters of a plane. A plane and a scale are fitted to each scan, besides its position.
_OF_PLANE = 3
_FITTED = _OF_PLANE + 1
# Smallest sum of squares (mm²), for equal surfaces.
_LEAST_SQUARES = 1e-20
# Number of standard errors that contain 95 % of normal values.
_NORMAL = 1.96


class Fit:
    """Scans that are fitted to a surface together, at offsets (n, 2) from a common point, mm."""

    def __init__(
        self,
        surface: xr.DataArray,
        scans: Sequence[xr.DataArray],
        offsets: np.ndarray,
        mirrored: bool,
    ):
        side = min(min(sides_of(scan)) for scan in scans)
        self.surface = surface
        self.step = step = max(spacing_of(surface)[0], side / _REFINED)
        edge = max(step, surface.attrs.get("mesh_edge_mm", 0.0))
        self.points, self.heights, self.shapes = [], [], []
        for scan, (dv, du) in zip(scans, offsets, strict=True):
            template = Template(scan, edge)
            along = [
                np.arange(-side / 2 + step / 2, side / 2, step)
                for side in template.sides
            ]
            grid = np.meshgrid(*along, indexing="ij")
            v, u = (each.ravel() for each in grid)
            self.shapes.append(grid[0].shape)
            self.heights.append(template.at(v, u, mirrored))
            self.points.append((v + dv, u + (-du if mirrored else du)))

    def refined(self, start: PatchPosition, *, is_turned: bool = True) -> "Refined":
        """The best position near a start, with or without a change of the rotation."""
        away = max(np.hypot(v, u).max() for v, u in self.points)
        around = part_around(self.surface, start, away + 5 * self.step)
        spline = spline_of(around)
        planes = [planes_over(v, u) for v, u in self.points]
        columns = [*map(np.column_stack, zip(planes, self.heights, strict=True))]
        count = 3 if is_turned else 2

        def place_at(pose: np.ndarray) -> PatchPosition:
            y, x, *turn = map(float, pose)
            degrees = math.degrees(turn[0]) if turn else start.rotation_deg
            return PatchPosition(y, x, wrapped(degrees))

        def rest(pose: np.ndarray, fitted: list[np.ndarray]) -> list[np.ndarray]:
            """Heights of the surface under each scan, minus the fitted columns."""
            place = place_at(pose)
            under = (spline.ev(*place.points(v, u)) for v, u in self.points)
            return [*map(residuals, fitted, under)]

        pose = np.array([*start[:2], math.radians(start.rotation_deg)])[:count]
        fit = scipy.optimize.least_squares(
            lambda pose: np.concatenate(rest(pose, columns)),
            pose,
            x_scale=(self.step, self.step, 0.01)[:count],
        )
        parts_seen = rest(fit.x, planes)
        parts_own = [*map(residuals, planes, self.heights)]
        seen, own = np.concatenate(parts_seen), np.concatenate(parts_own)
        squares = float(own @ own)
        freedom = self._independent(rest(fit.x, columns)) - count
        return Refined(
            place_at(fit.x),
            correlation=_correlation(seen, own),
            each=np.array([*map(_correlation, parts_seen, parts_own)]),
            shape=np.linalg.pinv(fit.jac.T @ fit.jac),
            squares=float(fit.fun @ fit.fun),
            freedom=max(1.0, freedom - _FITTED * len(planes)),
            scale=float(seen @ own) / squares if squares > 0 else 0.0,
            own=squares,
        )

    def _independent(self, parts: Sequence[np.ndarray]) -> float:
        """Number of independent values in the residuals, as waves of equal power up to some k.

        On an area A this number is A k²/4π. The mean squared slope is k²/2 times the mean square.
        A fitted plane takes squares but hardly any slopes, so its parameters are subtracted.
        """
        slopes = squares = 0.0
        for part, shape in zip(parts, self.shapes, strict=True):
            gradient = (np.diff(part.reshape(shape), axis=axis) for axis in (0, 1))
            slopes += part.size * sum(float(np.mean(each**2)) for each in gradient)
            squares += float(part @ part)
        count = sum(part.size for part in parts)
        values = slopes / (2 * math.pi) * count / max(squares, _LEAST_SQUARES)
        return values - _OF_PLANE * len(parts)


class Refined(NamedTuple):
    """A position between the elements, with the quality of the fit."""

    place: PatchPosition
    correlation: float
    each: np.ndarray  # correlation of each single scan at this position
    shape: np.ndarray  # covariance of y, x and perhaps the rotation, over the variance
    squares: float  # sum of squared residuals, mm²
    freedom: float  # independent values minus fitted parameters
    scale: float  # ratio of the heights of the surface and of the scans
    own: float  # sum of squared heights of the scans without their planes, mm²

    def squares_with(self, scale: float) -> float:
        """The sum of squared residuals with another scale."""
        return self.squares + (self.scale - scale) ** 2 * self.own

    @property
    def variance(self) -> float:
        """Variance of an independent value times the number of points per such value, mm²."""
        return self.squares / self.freedom

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of y, x (mm) and rotation (radians); ±1.96 errors contain 95 %."""
        return self.variance * widened(self.freedom) ** 2 * self.shape


def widened(freedom: float) -> float:
    """Ratio of the 95 % limits of Student's t and the normal distribution."""
    return float(scipy.special.stdtrit(freedom, 0.975)) / _NORMAL


def part_around(
    surface: xr.DataArray, place: PatchPosition, half: float
) -> xr.DataArray:
    """The part of a surface around a position."""
    y, x = (slice(at - half, at + half) for at in place[:2])
    return surface.sel(y=y, x=x)


def _correlation(one: np.ndarray, other: np.ndarray) -> float:
    """Correlation of values with zero mean; 0 if one of them is flat."""
    length = math.sqrt(float(one @ one) * float(other @ other))
    return float(one @ other) / length if length > 0 else 0.0
