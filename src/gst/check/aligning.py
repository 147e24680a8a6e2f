"""Scans laid on a surface as well as they fit, between its elements, and how sure that is.

The residuals between scans and surface are smooth, and not white noise. They have as many
independent values as waves down to the shortest on the scans' area, and their slopes determine
these. The fit takes some of the values. The others give the variance, and this the covariance of
place and turn.
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

__all__ = ["Fit", "Refined", "part_around", "widened"]


# Points along a scan's side that are enough to refine its place.
_REFINED = 100
# Numbers of a plane; it and a scale are fitted to each scan, besides its place.
_OF_PLANE = 3
_FITTED = _OF_PLANE + 1
# mm², so that equal surfaces can be compared.
_LEAST_SQUARES = 1e-20
# The standard errors within which 95 % of normal values lie.
_NORMAL = 1.96


@dataclass(frozen=True)
class Fit:
    """Scans that are held against a surface together; `points` are theirs from a common point."""

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
        """The best place near another; perhaps without turning."""
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
            """Heights of the surface less those of each scan, without their planes and scales."""
            return np.concatenate([*map(residuals, columns, under(pose))])

        planes = [planes_over(v, u) for v, u in self.points]
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
        """Number of independent values in the residuals: waves of equal power, down to some k.

        On an area A they are A k²/4π, and the mean of their squared slopes is k²/2 of that of
        their squares. A plane that was taken has squares but hardly slopes, so it is counted once
        too often.
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
    """A place between the elements, how well scans fit there, and how sure that is."""

    place: PatchPosition
    correlation: float
    each: np.ndarray  # correlation of each scan by itself, there
    shape: np.ndarray  # covariance of y, x and perhaps the turn, over the variance
    squares: float  # sum of the squares of the residuals, mm²
    freedom: float  # independent values that are left after the fit
    scale: float  # heights of the surface beside those of the scans
    own: float  # sum of the squares of the scans' heights, without their planes, mm²

    def squares_with(self, scale: float) -> float:
        """The squares of the residuals with another scale."""
        return self.squares + (self.scale - scale) ** 2 * self.own

    @property
    def variance(self) -> float:
        """The variance of one independent value times how many points stand for it, mm²."""
        return self.squares / self.freedom

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of y, x (mm) and turn (radians), such that 95 % lie within ±1.96 errors."""
        return self.variance * widened(self.freedom) ** 2 * self.shape


def widened(freedom: float) -> float:
    """Student's t over the normal distribution, where 95 % of both lie within."""
    return float(scipy.special.stdtrit(freedom, 0.975)) / _NORMAL


def part_around(
    surface: xr.DataArray, place: PatchPosition, half: float
) -> xr.DataArray:
    """The part of a surface around a place."""
    y, x = (slice(at - half, at + half) for at in place[:2])
    return surface.sel(y=y, x=x)


def _correlation(one: np.ndarray, other: np.ndarray) -> float:
    """Correlation of values without their means, 0 if one is flat."""
    length = math.sqrt(float(one @ one) * float(other @ other))
    return float(one @ other) / length if length > 0 else 0.0
