"""Best position of scans on a surface, between its elements, with its standard error.

The residuals between scans and surface are smooth, not white noise. Their number of independent
values is the number of waves on the area of the scans, down to the shortest wave. It follows from
the slopes of the residuals. The fit uses some of these values. The others determine the variance,
and the variance determines the covariance of position and rotation.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
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


@dataclass(frozen=True)
class Fit:
    """Scans that are fitted to a surface together; `points` are relative to a common point."""

    surface: xr.DataArray
    points: list[tuple[np.ndarray, np.ndarray]]  # (v, u) of each, mm
    heights: list[np.ndarray]
    shapes: list[tuple[int, int]]  # of their grids
    step: float

    @classmethod
    def on(
        cls,
        surface: xr.DataArray,
        scans: Sequence[xr.DataArray],
        reading: np.ndarray,
        mirrored: bool,
    ) -> "Fit":
        side = min(min(sides_of(scan)) for scan in scans)
        step = max(spacing_of(surface)[0], side / _REFINED)
        edge = max(step, surface.attrs.get("mesh_edge_mm", 0.0))
        points, heights, shapes = [], [], []
        for scan, (dv, du) in zip(scans, reading, strict=True):
            template = Template.smoothed(scan, edge)
            along = [
                np.arange(-side / 2 + step / 2, side / 2, step)
                for side in template.sides
            ]
            v, u = (each.ravel() for each in np.meshgrid(*along, indexing="ij"))
            shapes.append((len(along[0]), len(along[1])))
            heights.append(template.at(v, u, mirrored))
            points.append((v + dv, u + (-du if mirrored else du)))
        return cls(surface, points, heights, shapes, step)

    def refined(self, start: PatchPosition, *, is_turned: bool = True) -> "Refined":
        """The best position near a start, with or without a change of the rotation."""
        away = max(np.hypot(v, u).max() for v, u in self.points)
        around = part_around(self.surface, start, away + 5 * self.step)
        spline = spline_of(around)

        def at(pose: np.ndarray) -> PatchPosition:
            y, x, *turn = map(float, pose)
            degrees = math.degrees(turn[0]) if turn else start.rotation_deg
            return PatchPosition(y, x, wrapped(degrees))

        def under(pose: np.ndarray) -> Iterator[np.ndarray]:
            yield from (spline.ev(*at(pose).points(v, u)) for v, u in self.points)

        def residual(pose: np.ndarray) -> np.ndarray:
            """Heights of the surface minus the fitted scans, without the fitted planes."""
            return np.concatenate([*map(residuals, columns, under(pose))])

        planes = [planes_over(v, u).T for v, u in self.points]
        columns = [*map(np.column_stack, zip(planes, self.heights, strict=True))]
        count = 3 if is_turned else 2
        y, x, turn = start
        pose = np.array([y, x, math.radians(turn)])[:count]
        scale = (self.step, self.step, 0.01)[:count]
        fit = scipy.optimize.least_squares(residual, pose, x_scale=scale)
        parts_seen = [*map(residuals, planes, under(fit.x))]
        parts_own = [*map(residuals, planes, self.heights)]
        seen, own = np.concatenate(parts_seen), np.concatenate(parts_own)
        common, squares = float(seen @ own), float(own @ own)
        return Refined(
            at(fit.x),
            correlation=_correlation(seen, own),
            each=np.array([*map(_correlation, parts_seen, parts_own)]),
            shape=np.linalg.pinv(fit.jac.T @ fit.jac),
            squares=float(fit.fun @ fit.fun),
            freedom=max(
                1.0, self._independent(fit.fun) - _FITTED * len(self.points) - count
            ),
            scale=common / squares if squares > 0 else 0.0,
            own=squares,
        )

    def _independent(self, rest: np.ndarray) -> float:
        """Number of independent values in the residuals, as waves of equal power up to some k.

        On an area A this number is A k²/4π. The mean squared slope is k²/2 times the mean square.
        A fitted plane takes squares but hardly any slopes, so its parameters are subtracted.
        """
        slopes, ends = 0.0, np.cumsum([math.prod(shape) for shape in self.shapes])
        for part, shape in zip(np.split(rest, ends[:-1]), self.shapes, strict=True):
            field = part.reshape(shape)
            steps = (np.diff(field, axis=axis) for axis in (0, 1))
            slopes += len(part) * sum(float(np.mean(each**2)) for each in steps)
        squares = max(float(rest @ rest), _LEAST_SQUARES)
        values = slopes / (2 * math.pi) * len(rest) / squares
        return values - _OF_PLANE * len(self.shapes)


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
