"""Where on a stone was a map taken? A scan of some mm², such as an overview, is found on the mesh.

Its heights are correlated with those of the mesh at every shift, for turns all around and mirrored,
too. From map and mesh a plane is removed at each place (plane-free normalised correlation), so that
tilt and form of the stone do not matter. The sums over the window at every shift are correlations
themselves, by the fast Fourier transform (Lewis 1995, Vision Interface, 120). The best place is
refined between the elements; its error is that of the jackknife over blocks of the map.

A patch of 0.85 mm has too few waves that a mesh shows to be found anywhere: see
`gstlib.coupling.placement`.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from gstlib.preprocess.scans import interpolate_holes
from gstlib.surfaces.footprints import Place, rotated, spline_of
from gstlib.surfaces.grid import spacing_of
from gstlib.surfaces.leveling import remove_plane

__all__ = ["Match", "match_map"]

# Turns that are tried: a map of 2.5 mm that is turned by half a step too far is off by 50 µm at its
# corners, a quarter of the shortest waves that a mesh shows.
_TURNS = 72
# Fewest elements of the mesh along a map's side: fewer show no waves.
_FEWEST = 12
# ASSUME: a map is found if it correlates by this much, and more than at any other place, turn or
# mirroring by this much, in Fisher's z (artanh r). Maps of synthetic stones lead by three times as
# much or so, on their own stone, and by a third of it on others.
_LEAST_CORRELATION, _LEAST_LEAD = 0.6, 0.35
# The largest correlation whose z is used.
_ONE = 1 - 1e-9
# What is as near to the best place as this share of the map's shorter side, and is turned by no
# more than this (degrees), is the same match.
_SAME_PLACE, _SAME_TURN = 0.5, 20.0
# Blocks along a side, of which each is left out in turn for the error of the place.
_BLOCKS = 3
# Below this share of the largest spread of a window, it is flat: its correlation means nothing.
_FLAT = 1e-6


@dataclass(frozen=True)
class Match:
    """Where a map lies on a surface, and how sure that is."""

    place: (
        Place  # of the map's centre; the map is reversed first, if it is mirrored, then turned
    )
    mirrored: bool  # whether it is reversed along x
    correlation: float  # of heights, a plane removed from each
    next_best: float  # correlation elsewhere, or otherwise turned or mirrored
    error_mm: float  # standard error of the place, along the axis where it is larger; a guide
    found: bool  # whether correlation and lead are those of a right match


def match_map(surface: xr.DataArray, scan: xr.DataArray) -> Match:
    """Find a map of heights on a larger surface.

    Parameters
    ----------
    surface : (y, x) xarray.DataArray
        Heights of the stone from its mesh, mm, NaN where there is none, on elements no longer than
        half the mesh's edges.
    scan : (y, x) xarray.DataArray
        Heights of the map, mm, NaN where unmeasured.

    Returns
    -------
    Match
        The best place; its ``found`` says whether it is the right one. It takes some 3 s for a map
        of 2.5 mm on a face of 17 mm with elements of 50 µm, and keeps 90 MB of correlations.

    Raises
    ------
    ValueError
        The map has fewer than 12 elements of the surface along a side, or does not fit on it.
    """
    step = spacing_of(surface)[0]
    template = _Template.of(scan, max(step, surface.attrs.get("mesh_edge_mm", 0.0)))
    if min(template.sides) < _FEWEST * step:
        raise ValueError(
            f"a map of {min(template.sides):.3g} mm has fewer than {_FEWEST} elements of "
            f"{step:.3g} mm"
        )
    scores = _scores(_Image.of(surface), template, step)
    key, (row, column) = _best(scores)
    mirrored, turn = key
    middle = (template.count(step) - 1) / 2
    y, x = (
        (at + middle) * step + float(surface[axis][0])
        for at, axis in ((row, "y"), (column, "x"))
    )
    place, correlation, error_mm = _refined(surface, template, Place(y, x, turn), mirrored)
    radius = _SAME_PLACE * min(template.sides) / step
    elsewhere = _next_best(scores, key, (row, column), radius)
    lead = math.atanh(min(correlation, _ONE)) - math.atanh(min(elsewhere, _ONE))
    found = correlation >= _LEAST_CORRELATION and lead >= _LEAST_LEAD
    return Match(place, mirrored, correlation, elsewhere, error_mm, found)


def _scores(image: "_Image", template: "_Template", step: float) -> "dict[_Key, np.ndarray]":
    """Correlations at all places, by mirroring and turn; an error if the map fits nowhere."""
    scores: dict[_Key, np.ndarray] = {}
    for turn in np.arange(_TURNS // 2) * 360 / _TURNS:
        # half a turn later, and mirrored, too, a rectangle covers the same elements
        covered = template.covered(turn, step)
        window = image.window(covered)
        for mirrored, whole in itertools.product((False, True), (turn, turn + 180)):
            heights = template.laid(mirrored, whole, step)
            scores[mirrored, whole] = image.correlate(heights[covered], window)
    if not any(np.isfinite(score).any() for score in scores.values()):
        raise ValueError("the map does not fit on the surface")
    return scores


_Key = tuple[bool, float]  # mirrored, and turn in degrees


@dataclass(frozen=True)
class _Template:
    """A map that can be laid on the surface's grid, as smooth as the mesh."""

    heights: xr.DataArray  # without holes, its coordinates from its centre
    sides: tuple[float, float]  # mm, along y and x

    @classmethod
    def of(cls, scan: xr.DataArray, edge: float) -> "_Template":
        """A scan, as smooth as a mesh with edges of this length (mm)."""
        dy, dx = spacing_of(scan)
        level = remove_plane(scan)[0]
        whole = interpolate_holes(level.values, np.isnan(level.values))
        smooth = scipy.ndimage.gaussian_filter(whole, (edge / 2 / dy, edge / 2 / dx))
        centred = {axis: level[axis] - level[axis].mean() for axis in level.dims}
        ny, nx = scan.shape
        return cls(level.copy(data=smooth).assign_coords(centred), (ny * dy, nx * dx))

    def count(self, step: float) -> int:
        """Elements along a square window that holds the map, however it is turned."""
        return math.ceil(math.hypot(*self.sides) / step) | 1

    def _offsets(self, turn: float, step: float) -> tuple[np.ndarray, np.ndarray]:
        """Places (v, u) of a window's elements along the axes of the turned map, mm."""
        count = self.count(step)
        along = (np.arange(count) - (count - 1) / 2) * step
        return rotated(along[:, None], along[None, :], -turn)

    def covered(self, turn: float, step: float) -> np.ndarray:
        """Which elements of a window the turned map covers."""
        v, u = self._offsets(turn, step)
        return (abs(v) <= self.sides[0] / 2) & (abs(u) <= self.sides[1] / 2)

    def laid(self, mirrored: bool, turn: float, step: float) -> np.ndarray:
        """Its heights on a window's elements."""
        return self.at(*self._offsets(turn, step), mirrored)

    def at(self, v: np.ndarray, u: np.ndarray, mirrored: bool) -> np.ndarray:
        """Heights at places from its centre, along its own axes."""
        places = [
            (at - float(self.heights[axis][0])) / step
            for axis, at, step in zip(
                "yx", (v, -u if mirrored else u), spacing_of(self.heights), strict=True
            )
        ]
        return scipy.ndimage.map_coordinates(
            self.heights.values, places, order=1, mode="nearest"
        )


class _Window(NamedTuple):
    """What the surface is under a window, wherever it lies."""

    covered: np.ndarray
    planes: np.ndarray  # (points, 3) an orthonormal basis of the planes
    spread: (
        np.ndarray
    )  # root of the summed squares of heights less their plane; NaN where no stone


@dataclass(frozen=True)
class _Image:
    """A surface whose sums over windows are correlations."""

    shape: tuple[int, ...]
    padded: tuple[int, ...]
    heights: np.ndarray  # transforms
    squares: np.ndarray
    absent: np.ndarray

    @classmethod
    def of(cls, surface: xr.DataArray) -> "_Image":
        level = remove_plane(surface)[0].values
        absent = np.isnan(level)
        heights = np.where(absent, 0.0, level)
        padded = tuple(scipy.fft.next_fast_len(n, real=True) for n in level.shape)
        transforms = (scipy.fft.rfft2(of, padded) for of in (heights, heights**2, absent))
        return cls(level.shape, padded, *transforms)

    def _sums(
        self, transforms: Sequence[np.ndarray], values: np.ndarray, covered: np.ndarray
    ) -> list[np.ndarray]:
        """Sums of what was transformed times values of a window, by the window's first element."""
        window = np.zeros(covered.shape)
        window[covered] = values
        factor = np.conj(scipy.fft.rfft2(window, self.padded))
        rows, columns = (
            max(n - k + 1, 0) for n, k in zip(self.shape, covered.shape, strict=True)
        )
        return [
            scipy.fft.irfft2(of * factor, self.padded)[:rows, :columns] for of in transforms
        ]

    def window(self, covered: np.ndarray) -> _Window:
        """A window that covers these of its elements."""
        y, x = np.nonzero(covered)
        planes, _ = np.linalg.qr(_plane(y, x))
        squares, absent = self._sums([self.squares, self.absent], np.ones(len(planes)), covered)
        for plane in planes.T:
            squares -= self._sums([self.heights], plane, covered)[0] ** 2
        is_stone = (absent < 0.5) & (squares > _FLAT * squares.max(initial=0.0))
        return _Window(covered, planes, np.sqrt(np.where(is_stone, squares, np.nan)))

    def correlate(self, heights: np.ndarray, window: _Window) -> np.ndarray:
        """Plane-free correlation with heights (points,), NaN where there is no stone."""
        flat = heights - window.planes @ (window.planes.T @ heights)
        norm = np.linalg.norm(flat)
        (products,) = self._sums(
            [self.heights], flat / norm if norm > 0 else flat, window.covered
        )
        return products / window.spread


def _best(scores: dict[_Key, np.ndarray]) -> tuple[_Key, tuple[int, int]]:
    """The key and the place (row, column) of the highest score."""
    tops = {key: np.nanmax(score, initial=-np.inf) for key, score in scores.items()}
    key = max(tops, key=lambda each: tops[each])
    row, column = np.unravel_index(np.nanargmax(scores[key]), scores[key].shape)
    return key, (int(row), int(column))


def _next_best(
    scores: dict[_Key, np.ndarray], best: _Key, at: tuple[int, int], radius: float
) -> float:
    """The highest score that is another match than the best."""
    highest = 0.0
    for (mirrored, turn), score in scores.items():
        other = score
        off = abs((turn - best[1] + 180) % 360 - 180)
        if mirrored == best[0] and off <= _SAME_TURN:
            y, x = np.ogrid[: score.shape[0], : score.shape[1]]
            other = np.where(np.hypot(y - at[0], x - at[1]) <= radius, np.nan, score)
        highest = max(highest, float(np.nanmax(other, initial=0.0)))
    return highest


def _refined(
    surface: xr.DataArray, template: _Template, place: Place, mirrored: bool
) -> tuple[Place, float, float]:
    """A place between the elements, the correlation there, and the error of the place (mm)."""
    spline, step = spline_of(surface), spacing_of(surface)[0]
    along = [np.arange(-side / 2 + step / 2, side / 2, step) for side in template.sides]
    v, u = np.meshgrid(*along, indexing="ij")
    v, u = v.ravel(), u.ravel()
    heights = template.at(v, u, mirrored)

    def residual(pose: np.ndarray) -> np.ndarray:
        """Heights of the surface less those of the map, without their plane and their scale."""
        y, x = Place(pose[0], pose[1], math.degrees(pose[2])).points(v, u)
        under: np.ndarray = spline.ev(y, x)
        return _less(np.column_stack([_plane(v, u), heights]), under)

    start = np.array([place.y_mm, place.x_mm, math.radians(place.rotation_deg)])
    fit = scipy.optimize.least_squares(residual, start, x_scale=(step, step, 0.01))
    y_mm, x_mm, turn = map(float, fit.x)
    error = _jackknife(fit.jac, fit.fun, _blocks(v, u))
    under = spline.ev(*Place(y_mm, x_mm, math.degrees(turn)).points(v, u))
    flat = _less(_plane(v, u), under)
    share = float((fit.fun**2).sum() / (flat**2).sum())
    sign = math.copysign(1.0, float(flat @ heights))
    degrees = (math.degrees(turn) + 180) % 360 - 180
    return Place(y_mm, x_mm, degrees), sign * math.sqrt(max(0.0, 1 - share)), error


def _less(columns: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values less what combinations of columns can give."""
    rest: np.ndarray = values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
    return rest


def _plane(v: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Rows of which combinations are planes over points (v, u)."""
    return np.stack([np.ones_like(v), v, u], axis=1)


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
