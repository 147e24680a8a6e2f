"""The fit of scans to a surface: at every position, and then between the elements of the surface.

A plane is removed from both at each position (plane-free normalised correlation), so that tilt and
form have no effect. The sums over a window at every shift are correlations themselves. They are
computed by the fast Fourier transform (Lewis 1995, Vision Interface, 120).

The best position has a standard error. The residuals between scans and surface are smooth, not
white noise. Their number of independent values is the number of waves on the area of the scans,
down to the shortest wave. It follows from the slopes of the residuals. The fit uses some of these
values. The others determine the variance, and the variance determines the covariance of position
and rotation.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.change.search import pearson
from gstlib.preprocess.scans import interpolate_holes
from gstlib.surfaces.fitting import planes_over, residuals
from gstlib.surfaces.footprints import PatchPosition, rotated, spline_of
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

# Points along the side of a scan that are enough to refine its position.
_REFINED = 100
# Parameters of a plane. A plane and a scale are fitted to each scan, besides its position.
_OF_PLANE = 3
_FITTED = _OF_PLANE + 1
# Smallest sum of squares (mm²), for equal surfaces.
_LEAST_SQUARES = 1e-20
# Number of standard errors that contain 95 % of normal values.
_NORMAL = 1.96

# Highest peaks that are kept of each rotation, more than there can be within half a scan.
_MOST_PEAKS = 400
_PEAK = ["score", "y", "x", "mirrored", "turn", "reading"]


def sides_of(surface: xr.DataArray) -> tuple[float, float]:
    """Lengths of a surface along y and x, mm."""
    (ny, nx), (dy, dx) = surface.shape, spacing_of(surface)
    return ny * dy, nx * dx


def wrapped(turn: float) -> float:
    """An angle in degrees, as the same angle from -180 to below 180."""
    return (turn + 180) % 360 - 180


class Template:
    """A scan that can be interpolated on the grid of a surface, smooth like a mesh.

    `edge` is the length of the edges of the mesh, mm; `sides` are those of the scan along y and x.
    """

    def __init__(self, scan: xr.DataArray, edge: float):
        level = remove_plane(scan)[0]
        whole = interpolate_holes(level.values, np.isnan(level.values))
        self.spacing, self.sides = spacing_of(scan), sides_of(scan)
        sigma = np.divide(_SMOOTHED * edge, self.spacing)
        self.heights = scipy.ndimage.gaussian_filter(whole, sigma)

    def count(self, step: float) -> int:
        """Elements along a square window that contains the scan at every rotation."""
        return math.ceil(math.hypot(*self.sides) / step) | 1

    def at(self, v: np.ndarray, u: np.ndarray, mirrored: bool) -> np.ndarray:
        """Heights at positions relative to the centre, along the axes of the scan."""
        offsets = np.array([v, -u if mirrored else u])
        middle = np.subtract(self.heights.shape, 1) / 2
        places = (offsets.T / self.spacing + middle).T
        return scipy.ndimage.map_coordinates(
            self.heights, places, order=1, mode="nearest"
        )


class _Window(NamedTuple):
    """The surface under a window, at every position of the window."""

    covered: np.ndarray
    planes: np.ndarray  # (points, 3) an orthonormal basis of the planes
    # sums of squared heights minus their plane, NaN beside the stone
    squares: np.ndarray


class _Held(NamedTuple):
    """Sums of a scan and a surface without their planes, by the first element of the window."""

    products: np.ndarray
    own: float  # sum of squared heights of the scan
    under: np.ndarray  # sums of squared heights of the surface, NaN beside the stone


class Search:
    """Scans and the surface on which they are searched, with its transforms.

    `step` is the length of an element, mm, and `count` the number of elements along a window that
    contains each scan at every rotation.
    """

    def __init__(self, surface: xr.DataArray, templates: Sequence[Template]):
        self.surface, self.templates = surface, templates
        self.step = spacing_of(surface)[0]
        self.count = max(each.count(self.step) for each in templates)
        level = remove_plane(surface)[0].values
        absent = np.isnan(level)
        heights = np.where(absent, 0.0, level)
        fields = heights, heights**2, absent
        self._padded = [scipy.fft.next_fast_len(n, real=True) for n in level.shape]
        transforms = [scipy.fft.rfft2(field, self._padded) for field in fields]
        self._heights, self._squares, self._absent = transforms

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
        templates = [Template(scan, edge) for scan in scans]
        margin = max(each.count(times * step) for each in templates) // 2
        return cls(_with_margin(search, margin), templates)

    def peaks(self, turns: Iterable[float], readings: np.ndarray) -> pd.DataFrame:
        """The local maxima of the absolute correlation, at each turn, plus 180°, mirrored or not.

        `readings` (k, n, 2) are offsets of the scans from a common point, mm. A row has the
        ``score``, the common point (``y, x``, mm), and ``mirrored, turn, reading``.
        """
        peaks = [np.empty((0, len(_PEAK)))]
        kinds = {each.sides for each in self.templates}
        for turn in turns:
            # a rectangle covers the same elements if it is mirrored or rotated by 180°
            windows = {sides: self._window(turn, sides) for sides in kinds}
            for mirrored, whole in itertools.product((False, True), (turn, turn + 180)):
                held = [
                    self._held(each, mirrored, whole, windows[each.sides])
                    for each in self.templates
                ]
                for number, reading in enumerate(readings):
                    own = self._peaks_at(held, mirrored, whole, reading)
                    pose = np.tile([mirrored, whole, number], (len(own), 1))
                    peaks.append(np.hstack([own, pose]))
        return pd.DataFrame(np.vstack(peaks), columns=_PEAK)

    def _window(self, turn: float, sides: tuple[float, float]) -> _Window:
        """The window of a scan with these sides."""
        v, u = np.abs(self._offsets(turn))
        high, wide = sides
        covered = (v <= high / 2) & (u <= wide / 2)
        y, x = np.nonzero(covered)
        planes, _ = np.linalg.qr(planes_over(y, x).T)
        ones = np.ones(len(planes))
        squares = self._sums(self._squares, ones, covered)
        for plane in planes.T:
            squares -= self._sums(self._heights, plane, covered) ** 2
        absent = self._sums(self._absent, ones, covered)
        is_stone = (absent < 0.5) & (squares > _FLAT * squares.max(initial=0.0))
        return _Window(covered, planes, np.where(is_stone, squares, np.nan))

    def _held(
        self, template: Template, mirrored: bool, turn: float, window: _Window
    ) -> _Held:
        """The sums of a scan and the surface, at every position."""
        v, u = self._offsets(turn)[:, window.covered]
        heights = template.at(v, u, mirrored)
        flat = heights - window.planes @ (window.planes.T @ heights)
        products = self._sums(self._heights, flat, window.covered)
        return _Held(products, float(flat @ flat), window.squares)

    def _sums(
        self, transform: np.ndarray, values: np.ndarray, covered: np.ndarray
    ) -> np.ndarray:
        """Sums of transformed values times the values of a window, at every shift."""
        window = np.zeros(covered.shape)
        window[covered] = values
        # first along the few rows of the window
        rows_of = scipy.fft.rfft(window, self._padded[1])
        factor = np.conj(scipy.fft.fft(rows_of, self._padded[0], axis=0))
        sums = scipy.fft.irfft2(transform * factor, self._padded)
        rows, columns = np.maximum(np.subtract(self.surface.shape, self.count) + 1, 0)
        return sums[:rows, :columns]

    def _offsets(self, turn: float) -> np.ndarray:
        """Positions (v, u) of the elements of a window along the axes of a rotated scan, mm."""
        along = (np.arange(self.count) - (self.count - 1) / 2) * self.step
        return np.array(rotated(along[:, None], along[None, :], -turn))

    def _peaks_at(
        self, held: Sequence[_Held], mirrored: bool, turn: float, reading: np.ndarray
    ) -> np.ndarray:
        """Score and common point (k, 3) of scans that are at these offsets, highest peaks first."""
        v, u = reading.T
        places = rotated(v, -u if mirrored else u, turn)
        at = np.rint(np.transpose(places) / self.step).astype(int)
        score = _correlation(held, at - at.min(axis=0))
        size = np.fmax(np.abs(score), 0.0)  # NaN is no peak
        highest = scipy.ndimage.maximum_filter(size, 3, mode="constant")
        peaks = np.argwhere((size > 0) & (size == highest))
        order = np.argsort(-size[tuple(peaks.T)], kind="stable")
        peaks = peaks[order[:_MOST_PEAKS]]
        middle = peaks - at.min(axis=0) + (self.count - 1) / 2
        first = [float(self.surface[axis][0]) for axis in ("y", "x")]
        return np.column_stack([score[tuple(peaks.T)], middle * self.step + first])


def _with_margin(surface: xr.DataArray, count: int) -> xr.DataArray:
    """A surface with a margin of NaN, for windows that extend beyond their rotated scan."""
    # an odd reflection continues equal steps
    along = {
        axis: np.pad(surface[axis], count, mode="reflect", reflect_type="odd")
        for axis in ("y", "x")
    }
    return surface.pad(y=count, x=count).assign_coords(along)


def _correlation(held: Sequence[_Held], shifts: np.ndarray) -> np.ndarray:
    """Correlation of scans that are shifted from each other by (n, 2) elements, from 0 on."""
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
        planes = [planes_over(v, u).T for v, u in self.points]
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
            correlation=pearson(seen, own),
            each=np.array([*map(pearson, parts_seen, parts_own)]),
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
