"""Scans laid on a surface as well as they fit, between its elements, and how sure that is.

The error of a place is that of the jackknife over blocks of the scans.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from gstlib.coupling.sliding import Template, planes_over
from gstlib.surfaces.footprints import Place, spline_of
from gstlib.surfaces.grid import spacing_of

__all__ = ["Fit", "Refined", "part_around"]

# Points along a scan's side that are enough to refine its place.
_REFINED = 100
# Blocks along a side, of which each is left out in turn for the error of the place.
_BLOCKS = 3


@dataclass(frozen=True)
class Fit:
    """Scans that are held against a surface together; `points` are theirs from a common point."""

    surface: xr.DataArray
    points: list[tuple[np.ndarray, np.ndarray]]  # (v, u) of each, mm
    heights: list[np.ndarray]
    blocks: np.ndarray  # of all points
    step: float

    @classmethod
    def of(
        cls,
        surface: xr.DataArray,
        scans: Sequence[xr.DataArray],
        reading: np.ndarray,
        mirrored: bool,
    ) -> "Fit":
        sides = [
            n * d for scan in scans for n, d in zip(scan.shape, spacing_of(scan), strict=True)
        ]
        step = max(spacing_of(surface)[0], min(sides) / _REFINED)
        edge = max(step, surface.attrs.get("mesh_edge_mm", 0.0))
        points, heights, blocks = [], [], list[np.ndarray]()
        for scan, (dv, du) in zip(scans, reading, strict=True):
            template = Template.of(scan, edge)
            along = [np.arange(-side / 2 + step / 2, side / 2, step) for side in template.sides]
            v, u = (each.ravel() for each in np.meshgrid(*along, indexing="ij"))
            blocks.append(_blocks(v, u) + _BLOCKS**2 * len(blocks))
            heights.append(template.at(v, u, mirrored))
            points.append((v + dv, u + (-du if mirrored else du)))
        return cls(surface, points, heights, np.concatenate(blocks), step)

    def refined(self, start: Place, *, is_turned: bool = True) -> "Refined":
        """The best place near another; perhaps without turning."""
        reach = max(np.hypot(v, u).max() for v, u in self.points) + 5 * self.step
        spline = spline_of(part_around(self.surface, start, reach))

        def at(pose: np.ndarray) -> Place:
            y, x, *turn = map(float, pose)
            degrees = math.degrees(turn[0]) if turn else start.rotation_deg
            return Place(y, x, (degrees + 180) % 360 - 180)

        def under(pose: np.ndarray) -> Iterator[np.ndarray]:
            yield from (spline.ev(*at(pose).points(v, u)) for v, u in self.points)

        def residual(pose: np.ndarray) -> np.ndarray:
            """Heights of the surface less those of each scan, without their planes and scales."""
            columns = (
                np.column_stack([planes_over(v, u), heights])
                for (v, u), heights in zip(self.points, self.heights, strict=True)
            )
            return np.concatenate([*map(_less, columns, under(pose))])

        count = 3 if is_turned else 2
        pose = np.array([start.y_mm, start.x_mm, math.radians(start.rotation_deg)])[:count]
        scale = (self.step, self.step, 0.01)[:count]
        fit = scipy.optimize.least_squares(residual, pose, x_scale=scale)
        planes = [planes_over(v, u) for v, u in self.points]
        pairs = [[*map(_less, planes, of)] for of in (under(fit.x), self.heights)]
        seen, own = map(np.concatenate, pairs)
        common, squares = float(seen @ own), float(own @ own)
        return Refined(
            at(fit.x),
            correlation=_correlation(seen, own),
            each=np.array([*map(_correlation, *pairs)]),
            error_mm=_jackknife(fit.jac, fit.fun, self.blocks),
            scale=common / squares if squares > 0 else 0.0,
        )


class Refined(NamedTuple):
    """A place between the elements, how well scans fit there, and the error of the place."""

    place: Place
    correlation: float
    each: np.ndarray  # correlation of each scan by itself, there
    error_mm: float
    scale: float  # heights of the surface beside those of the scans


def part_around(surface: xr.DataArray, place: Place, half: float) -> xr.DataArray:
    """The part of a surface around a place."""
    y, x = (slice(at - half, at + half) for at in place[:2])
    return surface.sel(y=y, x=x)


def _less(columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values less what combinations of columns can give."""
    rest: np.ndarray = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    return rest


def _correlation(one: np.ndarray, other: np.ndarray) -> float:
    """That of values without their means; 0 if one is flat."""
    length = math.sqrt(float(one @ one) * float(other @ other))
    return float(one @ other) / length if length > 0 else 0.0


def _blocks(v: np.ndarray, u: np.ndarray) -> np.ndarray:
    """The number of the block that each point (v, u) lies in."""
    parts = [
        np.clip((_BLOCKS * (at / (2 * abs(at).max()) + 0.5)).astype(int), 0, _BLOCKS - 1)
        for at in (v, u)
    ]
    return _BLOCKS * parts[0] + parts[1]


def _jackknife(jacobian: np.ndarray, residual: np.ndarray, block: np.ndarray) -> float:
    """Standard error of a fitted place (y, x), the larger of the two, leaving out each block."""
    moved = [
        np.linalg.lstsq(jacobian[block != number], -residual[block != number], rcond=None)[0][
            :2
        ]
        for number in np.unique(block)
    ]
    covariance = (len(moved) - 1) * np.cov(moved, rowvar=False, bias=True)
    return float(np.sqrt(np.diag(covariance)).max())
