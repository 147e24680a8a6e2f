"""Correlation between the heights of scans and of a surface, at every position of the scans.

A plane is removed from both at each position (plane-free normalised correlation), so that tilt and
form have no effect. The sums over a window at every shift are correlations themselves. They are
computed by the fast Fourier transform (Lewis 1995, Vision Interface, 120).
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from gstlib.preprocess.scans import interpolate_holes
from gstlib.surfaces.fitting import planes_over
from gstlib.surfaces.footprints import rotated
from gstlib.surfaces.grid import coarser, spacing_of
from gstlib.surfaces.leveling import remove_plane

# Elements of the surface along the side of a scan. Fewer show no waves. More than the largest
# number do not improve a search.
_FEWEST, _MOST = 12, 40
# A window is flat below this share of the largest spread, and its correlation is meaningless.
_FLAT = 1e-6

# ASSUME: Smoothing by the mesh. A mesh shows a stone as if smoothed by a Gaussian with a standard
# deviation of a third of an edge. Reason: This lies between photogrammetry with a sharp cut-off and
# photogrammetry that averages over its edges.
_SMOOTHED = 1 / 3

Pose = tuple[bool, float]  # mirrored, and turn in degrees


def sides_of(surface: xr.DataArray) -> tuple[float, float]:
    """Lengths of a surface along y and x, mm."""
    (ny, nx), (dy, dx) = surface.shape, spacing_of(surface)
    return ny * dy, nx * dx


def wrapped(turn: float) -> float:
    """An angle in degrees, as the same angle from -180 to below 180."""
    return (turn + 180) % 360 - 180


@dataclass(frozen=True)
class Search:
    """Scans and the surface on which they are searched, with its transforms."""

    surface: xr.DataArray
    templates: Sequence["Template"]
    step: float  # length of an element, mm
    count: int  # elements along a window that contains each scan at every rotation
    image: "_Image"

    @classmethod
    def of(cls, surface: xr.DataArray, scans: Sequence[xr.DataArray]) -> "Search":
        """A search on elements of a suitable length."""
        step = spacing_of(surface)[0]
        side = min(min(sides_of(scan)) for scan in scans)
        if side * math.sqrt(len(scans)) < _FEWEST * step:
            raise ValueError(
                f"a map of {side:.3g} mm has fewer than {_FEWEST} elements of {step:.3g} mm"
            )
        if np.isfinite(surface.values).sum() * step**2 < side**2:
            raise ValueError("the map does not fit on the surface")
        times = max(1, int(side / _MOST / step))
        search = coarser(surface, times) if times > 1 else surface
        edge = max(times * step, surface.attrs.get("mesh_edge_mm", 0.0))
        templates = [Template.smoothed(scan, edge) for scan in scans]
        margin = max(each.count(times * step) for each in templates) // 2
        return cls.on(_with_margin(search, margin), templates)

    @classmethod
    def on(cls, surface: xr.DataArray, templates: Sequence["Template"]) -> "Search":
        """A search on the elements of the surface."""
        step = spacing_of(surface)[0]
        count = max(each.count(step) for each in templates)
        return cls(surface, templates, step, count, _Image.transformed(surface))

    def slid(self, turns: Iterable[float]) -> Iterator[tuple[Pose, list["Held"]]]:
        """The sums of each scan: at each rotation, plus 180°, mirrored or not."""
        for turn in turns:
            # a rectangle covers the same elements if it is mirrored or rotated by 180°
            v, u = self._offsets(turn)
            windows = {}
            for high, wide in {each.sides for each in self.templates}:
                covered = (abs(v) <= high / 2) & (abs(u) <= wide / 2)
                windows[high, wide] = self.image.window(covered)
            for mirrored, whole in itertools.product((False, True), (turn, turn + 180)):
                offsets = self._offsets(whole)
                held = []
                for each in self.templates:
                    window = windows[each.sides]
                    v, u = offsets[:, window.covered]
                    heights = each.at(v, u, mirrored)
                    held.append(self.image.held_against(heights, window))
                yield (mirrored, whole), held

    def _offsets(self, turn: float) -> np.ndarray:
        """Positions (v, u) of the elements of a window along the axes of a rotated scan, mm."""
        along = (np.arange(self.count) - (self.count - 1) / 2) * self.step
        return np.array(rotated(along[:, None], along[None, :], -turn))

    def centres(self, at: np.ndarray) -> np.ndarray:
        """Centres (k, 2) of windows, mm, from their first elements (k, 2)."""
        first = [float(self.surface[axis][0]) for axis in ("y", "x")]
        return (at + (self.count - 1) / 2) * self.step + first


def _with_margin(surface: xr.DataArray, count: int) -> xr.DataArray:
    """A surface with a margin of NaN, for windows that extend beyond their rotated scan."""
    step = spacing_of(surface)[0]
    along = {}
    for axis in ("y", "x"):
        numbers = np.arange(-count, surface.sizes[axis] + count)
        along[axis] = numbers * step + float(surface[axis][0])
    return surface.pad(y=count, x=count).assign_coords(along)


def elements(reading: np.ndarray, pose: Pose, step: float) -> np.ndarray:
    """Offsets (n, 2) of scans at a pose from their common point, in elements."""
    mirrored, turn = pose
    v, u = np.transpose(reading)
    places = rotated(v, -u if mirrored else u, turn)
    return np.rint(np.transpose(places) / step).astype(int)


class Held(NamedTuple):
    """Sums of a scan and a surface without their planes, by the first element of the window."""

    products: np.ndarray
    own: float  # sum of squared heights of the scan
    under: np.ndarray  # sums of squared heights of the surface, NaN beside the stone


def correlation_of(held: Sequence[Held], at: np.ndarray) -> np.ndarray:
    """Correlation of scans that are shifted from each other by `at` (n, 2) elements."""
    shifts = at - at.min(axis=0)
    whole = held[0].products.shape
    rows, columns = np.maximum(np.subtract(whole, shifts.max(axis=0)), 0)
    products = np.zeros((rows, columns))
    under = np.zeros((rows, columns))
    for each, (row, column) in zip(held, shifts, strict=True):
        part = np.s_[row : row + rows, column : column + columns]
        products += each.products[part]
        under += each.under[part]
    own = sum(each.own for each in held)
    return products / np.sqrt(own * under if own > 0 else np.inf)


def peaks_of(score: np.ndarray) -> np.ndarray:
    """Scores, rows and columns (k, 3) of the local maxima of the absolute score."""
    size = np.fmax(np.abs(score), 0.0)  # NaN is no peak
    highest = scipy.ndimage.maximum_filter(size, 3, mode="constant")
    at = np.argwhere((size > 0) & (size == highest))
    return np.column_stack([score[tuple(at.T)], at])


@dataclass(frozen=True)
class Template:
    """A scan that can be interpolated on the grid of the surface, as smooth as the mesh."""

    heights: xr.DataArray  # without holes; coordinates relative to its centre
    sides: tuple[float, float]  # mm, along y and x

    @classmethod
    def smoothed(cls, scan: xr.DataArray, edge: float) -> "Template":
        """A scan, smoothed like a mesh with edges of this length (mm)."""
        dy, dx = spacing_of(scan)
        level = remove_plane(scan)[0]
        whole = interpolate_holes(level.values, np.isnan(level.values))
        sigma = _SMOOTHED * edge
        smooth = scipy.ndimage.gaussian_filter(whole, (sigma / dy, sigma / dx))
        centred = {axis: level[axis] - level[axis].mean() for axis in level.dims}
        return cls(level.copy(data=smooth).assign_coords(centred), sides_of(scan))

    def count(self, step: float) -> int:
        """Elements along a square window that contains the scan at every rotation."""
        return math.ceil(math.hypot(*self.sides) / step) | 1

    def at(self, v: np.ndarray, u: np.ndarray, mirrored: bool) -> np.ndarray:
        """Heights at positions relative to the centre, along the axes of the scan."""
        (dy, dx), heights = spacing_of(self.heights), self.heights
        u = -u if mirrored else u
        rows = (v - float(heights.y[0])) / dy
        columns = (u - float(heights.x[0])) / dx
        return scipy.ndimage.map_coordinates(
            heights.values, [rows, columns], order=1, mode="nearest"
        )


class _Window(NamedTuple):
    """The surface under a window, at every position of the window."""

    covered: np.ndarray
    planes: np.ndarray  # (points, 3) an orthonormal basis of the planes
    # sums of squared heights minus their plane, NaN beside the stone
    squares: np.ndarray


@dataclass(frozen=True)
class _Image:
    """The transforms of a surface, from which sums over windows are computed."""

    shape: tuple[int, ...]
    padded: tuple[int, ...]
    heights: np.ndarray  # transforms
    squares: np.ndarray
    absent: np.ndarray

    @classmethod
    def transformed(cls, surface: xr.DataArray) -> "_Image":
        level = remove_plane(surface)[0].values
        absent = np.isnan(level)
        heights = np.where(absent, 0.0, level)
        padded = tuple(scipy.fft.next_fast_len(n, real=True) for n in level.shape)
        transforms = (
            scipy.fft.rfft2(field, padded) for field in (heights, heights**2, absent)
        )
        return cls(level.shape, padded, *transforms)

    def _sums(
        self, transforms: Sequence[np.ndarray], values: np.ndarray, covered: np.ndarray
    ) -> list[np.ndarray]:
        """Sums of transformed values times the values of a window, at every shift."""
        window = np.zeros(covered.shape)
        window[covered] = values
        # first along the few rows of the window
        rows_of = scipy.fft.rfft(window, self.padded[1])
        factor = np.conj(scipy.fft.fft(rows_of, self.padded[0], axis=0))
        rows, columns = np.maximum(np.subtract(self.shape, covered.shape) + 1, 0)
        sums = (scipy.fft.irfft2(each * factor, self.padded) for each in transforms)
        return [each[:rows, :columns] for each in sums]

    def window(self, covered: np.ndarray) -> _Window:
        """A window that covers the elements of this mask."""
        y, x = np.nonzero(covered)
        planes, _ = np.linalg.qr(planes_over(y, x).T)
        ones = np.ones(len(planes))
        squares, absent = self._sums([self.squares, self.absent], ones, covered)
        for plane in planes.T:
            squares -= self._sums([self.heights], plane, covered)[0] ** 2
        is_stone = (absent < 0.5) & (squares > _FLAT * squares.max(initial=0.0))
        return _Window(covered, planes, np.where(is_stone, squares, np.nan))

    def held_against(self, heights: np.ndarray, window: _Window) -> "Held":
        """The sums of the heights (points,) of a scan and the surface, at every position."""
        flat = heights - window.planes @ (window.planes.T @ heights)
        products = self._sums([self.heights], flat, window.covered)[0]
        return Held(products, float(flat @ flat), window.squares)
