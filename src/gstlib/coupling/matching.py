"""Where on a stone was a map taken? Scans are found on the mesh or on a larger map, by heights.

Heights are correlated at every shift, for turns all around and mirrored, too. A plane is removed
at each place from both (plane-free normalised correlation), so that tilt and form of the stone do
not matter. The sums over the window at every shift are correlations themselves, by the fast Fourier
transform (Lewis 1995, Vision Interface, 120). The best place is refined between the elements; its
error is that of the jackknife over blocks of the map.

A patch of 0.85 mm has too few waves that a mesh shows to be found anywhere (`match_map`). Several
are, whose distances the stage tells (`match_together`), or from a start by hand (`match_near`).
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from gstlib.preprocess.scans import interpolate_holes
from gstlib.surfaces.footprints import Place, rotated, spline_of
from gstlib.surfaces.grid import coarser, spacing_of
from gstlib.surfaces.leveling import remove_plane

__all__ = ["Match", "match_map", "match_near", "match_together"]

# Turns that are tried: a map of 2.5 mm that is turned by half a step too far is off by 50 µm at its
# corners, a quarter of the shortest waves that a mesh shows.
_TURNS = 72
# Fewest elements of the surface along a scan's side: fewer show no waves. More than the most tell
# nothing in a search; so many are enough to refine a place.
_FEWEST, _MOST, _REFINED = 12, 40, 100
# ASSUME: a map is found if it correlates by this much, and more than at any other place, turn or
# mirroring by this much, in Fisher's z (artanh r); several scans that the stage ties together, by
# the second. On their own synthetic stones maps lead by 1.0 or so, such scans by 0.8 to 1.1; on
# others by 0.14 and 0.12 at most (of 45 and 37).
_LEAST_CORRELATION, _LEAST_LEAD, _LEAST_LEAD_TOGETHER = 0.6, 0.35, 0.25
# The largest correlation whose z is used.
_ONE = 1 - 1e-9
# What is as near to the best place as this share of the map's shorter side, and is turned by no
# more than this (degrees), is the same match.
_SAME_PLACE, _SAME_TURN = 0.5, 20.0
# Blocks along a side, of which each is left out in turn for the error of the place.
_BLOCKS = 3
# Below this share of the largest spread of a window, it is flat: its correlation means nothing.
_FLAT = 1e-6
# How far places by hand may be off (mm, degrees), and the step of the turns that are tried.
_REACH, _STEP = 0.75, 3.0
_BY_HAND = np.arange(-12.0, 12.1, _STEP)
# Of scans near places by hand, what is nearer to the best than this share of their side is the same
# match.
_SAME_NEAR = 0.25
# ASSUME: a scan near its place by hand is found if it correlates by this much, and in Fisher's z
# clearly more than elsewhere and hardly less than the scans do in general; if it does not turn
# farther by itself (degrees), and if its heights are as high beside the mesh's as theirs, up to a
# factor. Of synthetic patches in their right places 93 % are found, of strangers' 3 %.
_LEAST_NEAR, _LEAST_LEAD_NEAR, _BELOW_OTHERS = 0.8, 0.2, 0.5
_MOST_TURNED, _MOST_HIGHER = 10.0, 1.4
# The blocks of a patch are no longer than the waves that a mesh shows, so the jackknife's errors
# are too small: on synthetic stones, by so much (benchmarks/finding.py).
_NEAR_ERRORS = 1.8


@dataclass(frozen=True)
class Match:
    """Where a scan lies on a surface, and how sure that is."""

    # Of the scan's centre; the scan is reversed first, if it is mirrored, then turned.
    place: Place
    mirrored: bool  # whether it is reversed along x
    inverted: bool  # whether its heights have the other sign, as those of a mould
    correlation: float  # of heights, a plane removed from each
    next_best: float  # correlation elsewhere, or otherwise turned or mirrored
    error_mm: float  # standard error of the place, along the axis where it is larger; a guide
    found: bool  # whether correlation and lead are those of a right match

    @property
    def strength(self) -> float:
        """The correlation in Fisher's z."""
        return math.atanh(min(self.correlation, _ONE))

    @property
    def lead(self) -> float:
        """Over the next best, in Fisher's z."""
        return self.strength - math.atanh(min(self.next_best, _ONE))

    def place_of(self, v: float, u: float) -> Place:
        """The place of what lies (v, u) along the axes of the scan from its centre, mm."""
        y, x = self.place.points(v, -u if self.mirrored else u)
        return Place(float(y), float(x), self.place.rotation_deg)

    def at(self, v: float, u: float) -> "Match":
        """The same of what lies (v, u) from the centre."""
        return replace(self, place=self.place_of(v, u))

    def carrying(self, inner: "Match", middle: Sequence[float]) -> "Match":
        """Where a scan lies that was found on this scan, whose middle is at (y, x) there, mm."""
        y, x, turn = inner.place
        place = self.place_of(y - middle[0], x - middle[1])
        turned = place.rotation_deg + (-turn if self.mirrored else turn)
        return replace(
            inner,
            place=place._replace(rotation_deg=(turned + 180) % 360 - 180),
            mirrored=self.mirrored != inner.mirrored,
            inverted=self.inverted != inner.inverted,
            error_mm=math.hypot(self.error_mm, inner.error_mm),
            found=self.found and inner.found,
        )

    def among(self, others: Iterable[float], count: int) -> "Match":
        """The same, of so many scans, with correlations that were reached elsewhere."""
        return _judged(replace(self, next_best=max([self.next_best, *others])), count)


def match_map(surface: xr.DataArray, scan: xr.DataArray) -> Match:
    """Find a map of heights on a larger surface.

    Parameters
    ----------
    surface : (y, x) xarray.DataArray
        Heights of the stone from its mesh, mm, NaN where there is none, on elements no longer than
        half the mesh's edges; or those of a larger map.
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
    return match_together(surface, [scan], np.zeros((1, 1, 2)))[0]


def match_together(
    surface: xr.DataArray, scans: Sequence[xr.DataArray], readings: np.ndarray
) -> tuple[Match, int]:
    """Find scans whose distances are known, as if they were one map.

    Parameters
    ----------
    surface
        As in `match_map`.
    scans : sequence of (y, x) xarray.DataArray
        Heights, mm.
    readings : (k, n, 2) ndarray
        Of each reading of the stage, where the centres of the scans are from a common point, along
        the scans' own axes (y, x), mm.

    Returns
    -------
    match : Match
        That of the common point.
    reading : int
        Which reading it is.

    Raises
    ------
    ValueError
        As in `match_map`.
    """
    search, templates = _to_search(surface, scans)
    step = spacing_of(search)[0]
    image, peaks = _Image.of(search), dict[_Key, np.ndarray]()
    for pose, held in _held(image, templates, step, _all_around(templates, readings, step)):
        for number, reading in enumerate(readings):
            at = _elements(reading, pose, step)
            peaks[*pose, number] = _peaks(_correlation(held, at)) - [0, *at.min(axis=0)]
    key, best = _highest(peaks)
    mirrored, turn, number = key
    y, x = _middles(best[np.newaxis, 1:], search, templates)[0]
    fit = _Fit.of(surface, scans, readings[number], mirrored).refined(Place(y, x, turn))
    radius = _SAME_PLACE * min(min(each.sides) for each in templates) / step
    elsewhere = max(
        _elsewhere(found, best, radius if _is_same(key, other) else 0.0)
        for other, found in peaks.items()
    )
    inverted = bool(best[0] < 0)
    correlation = abs(fit.correlation)
    match = Match(
        fit.place, mirrored, inverted, correlation, elsewhere, fit.error_mm, found=True
    )
    return _judged(match, len(scans)), number


def match_near(
    surface: xr.DataArray, scans: Sequence[xr.DataArray], places: Sequence[Place]
) -> list[Match]:
    """Find scans near places by hand: within 0.75 mm, and turned by a common angle up to 12°.

    All are mirrored or none, and have heights of the same sign; they may be turned by half a turn.

    Parameters
    ----------
    surface, scans
        As in `match_together`.
    places : sequence of Place
        Where each lies, about.

    Raises
    ------
    ValueError
        As in `match_map`.
    """
    search, templates = _to_search(surface, scans)
    near = [_near(search, *each) for each in zip(templates, places, strict=True)]
    sums = {pose: _common([peaks[pose] for peaks in near]) for pose in near[0]}
    pose = max(sums, key=lambda each: sums[each])
    mirrored, sign, half, number = pose
    another = max(of for each, of in sums.items() if each[:3] != pose[:3])
    is_clear = sums[pose] - another >= _LEAST_LEAD / math.sqrt(len(scans))
    turn = 180 * half + _top(number, [sums[*pose[:3], n] for n in range(len(_BY_HAND))])
    snapped = []
    for peaks, template, scan, place in zip(near, templates, scans, places, strict=True):
        match = Match(place, mirrored, sign < 0, 0.0, 0.0, math.inf, found=False)
        own_turn, scale = math.inf, 1.0
        if len(there := peaks[pose]):
            best = there[there[:, 0].argmax()]
            fit = _Fit.of(surface, [scan], np.zeros((1, 2)), mirrored)
            start = Place(float(best[1]), float(best[2]), place.rotation_deg + turn)
            lies = fit.refined(start, is_turned=False)
            own_turn = fit.refined(lies.place).place.rotation_deg - lies.place.rotation_deg
            elsewhere = _elsewhere(there, best, _SAME_NEAR * min(template.sides))
            scale, fits = sign * lies.scale, (sign * lies.correlation, elsewhere)
            match = replace(match, place=lies.place, error_mm=_NEAR_ERRORS * lies.error_mm)
            match = replace(match, correlation=fits[0], next_best=fits[1])
        snapped.append((match, abs((own_turn + 180) % 360 - 180), math.log(max(scale, _FLAT))))
    usual = np.median([(match.strength, scale) for match, _, scale in snapped], axis=0)
    return [
        replace(
            match,
            found=is_clear
            and match.correlation >= _LEAST_NEAR
            and match.lead >= _LEAST_LEAD_NEAR
            and match.strength >= usual[0] - _BELOW_OTHERS
            and own_turn <= _MOST_TURNED
            and abs(scale - usual[1]) <= math.log(_MOST_HIGHER),
        )
        for match, own_turn, scale in snapped
    ]


def _near(
    search: xr.DataArray, template: "_Template", place: Place
) -> dict[tuple[bool, float, int, int], np.ndarray]:
    """Peaks (score, y, x) around a place, by mirroring, sign, half turn and number of the turn."""
    step = spacing_of(search)[0]
    part = _around(search, place, template.count(step) * step / 2 + _REACH + step)
    image, turns = _Image.of(part), place.rotation_deg + _BY_HAND
    found = {}
    for number, (pose, held) in enumerate(_held(image, [template], step, turns)):
        peaks = _peaks(_correlation(held, np.zeros((1, 2), int)))
        peaks[:, 1:] = _middles(peaks[:, 1:], part, [template])
        peaks = peaks[np.hypot(*(peaks[:, 1:] - place[:2]).T) <= _REACH]
        for sign in (1.0, -1.0):
            own = peaks[sign * peaks[:, 0] > 0] * [sign, 1, 1]
            found[pose[0], sign, number % 2, number // 4] = own
    return found


def _common(peaks: Sequence[np.ndarray]) -> float:
    """Mean over the scans of their highest scores, in Fisher's z."""
    tops = [min(each[:, 0].max(initial=0.0), _ONE) for each in peaks]
    return float(np.mean(np.arctanh(tops)))


def _top(number: int, sums: Sequence[float]) -> float:
    """The turn (degrees) at which sums over the turns by hand are highest, by a parabola."""
    if not 0 < number < len(sums) - 1:
        return float(_BY_HAND[number])
    before, top, after = sums[number - 1 : number + 2]
    bend = before - 2 * top + after
    return float(_BY_HAND[number] + _STEP * (before - after) / (2 * bend or 1))


def _judged(match: Match, count: int) -> Match:
    """Whether so many scans are found, if nothing else spoke against it."""
    least = _LEAST_LEAD if count == 1 else _LEAST_LEAD_TOGETHER
    is_right = match.correlation >= _LEAST_CORRELATION and match.lead >= least
    return replace(match, found=match.found and is_right)


_Pose = tuple[bool, float]  # mirrored, and turn in degrees
_Key = tuple[bool, float, int]  # and the reading of the stage


def _to_search(
    surface: xr.DataArray, scans: Sequence[xr.DataArray]
) -> tuple[xr.DataArray, list["_Template"]]:
    """Surface and scans on elements that are long enough for a search."""
    step = spacing_of(surface)[0]
    side = min(
        n * d for scan in scans for n, d in zip(scan.shape, spacing_of(scan), strict=True)
    )
    if side * math.sqrt(len(scans)) < _FEWEST * step:
        raise ValueError(
            f"a map of {side:.3g} mm has fewer than {_FEWEST} elements of {step:.3g} mm"
        )
    if np.isfinite(surface.values).sum() * step**2 < side**2:
        raise ValueError("the map does not fit on the surface")
    times = max(1, int(side / _MOST / step))
    search = coarser(surface, times) if times > 1 else surface
    edge = max(times * step, surface.attrs.get("mesh_edge_mm", 0.0))
    return search, [_Template.of(scan, edge) for scan in scans]


def _all_around(
    templates: Sequence["_Template"], readings: np.ndarray, step: float
) -> np.ndarray:
    """Turns over half a circle: half of the way between two moves no scan by an element."""
    apart = np.linalg.norm(readings - readings.mean(axis=1, keepdims=True), axis=-1).max()
    radius = apart + max(math.hypot(*each.sides) / 2 for each in templates)
    count = max(_TURNS // 2, math.ceil(math.pi * radius / (2 * step)))
    return np.arange(count) * 180 / count


def _held(
    image: "_Image", templates: Sequence["_Template"], step: float, turns: Iterable[float]
) -> Iterator[tuple[_Pose, list["_Held"]]]:
    """Each scan held against a surface, at each turn and half a turn on, mirrored or not."""
    count = _count(templates, step)
    for turn in turns:
        # half a turn later, and mirrored, too, a rectangle covers the same elements
        sides = {each.sides: each for each in templates}
        windows = {
            of: image.window(each.covered(turn, step, count)) for of, each in sides.items()
        }
        for mirrored, whole in itertools.product((False, True), (turn, turn + 180)):
            held = []
            for each in templates:
                window = windows[each.sides]
                heights = each.laid(mirrored, whole, step, count)[window.covered]
                held.append(image.held_against(heights, window))
            yield (mirrored, whole), held


def _count(templates: Sequence["_Template"], step: float) -> int:
    return max(each.count(step) for each in templates)


def _middles(
    at: np.ndarray, search: xr.DataArray, templates: Sequence["_Template"]
) -> np.ndarray:
    """The middles (k, 2) of windows, mm, from their first elements (k, 2)."""
    step = spacing_of(search)[0]
    first = [float(search[axis][0]) for axis in ("y", "x")]
    return (at + (_count(templates, step) - 1) / 2) * step + first


def _elements(reading: np.ndarray, pose: _Pose, step: float) -> np.ndarray:
    """By how many elements (n, 2) scans at a pose lie from their common point."""
    mirrored, turn = pose
    v, u = np.transpose(reading)
    return np.rint(np.transpose(rotated(v, -u if mirrored else u, turn)) / step).astype(int)


class _Held(NamedTuple):
    """A scan held against a surface, by the window's first element; without their planes."""

    products: np.ndarray
    own: float  # sum of the squares of the scan's heights
    under: np.ndarray  # that of the surface's, NaN where there is no stone


def _correlation(held: Sequence[_Held], at: np.ndarray) -> np.ndarray:
    """That of scans shifted by elements (n, 2) from each other; it begins where the first does."""
    shifts = at - at.min(axis=0)
    rows, columns = np.maximum(np.subtract(held[0].products.shape, shifts.max(axis=0)), 0)
    products, under = np.zeros((rows, columns)), np.zeros((rows, columns))
    for each, (row, column) in zip(held, shifts, strict=True):
        part = np.s_[row : row + rows, column : column + columns]
        products += each.products[part]
        under += each.under[part]
    own = sum(each.own for each in held)
    return products / np.sqrt(own * under if own > 0 else np.inf)


def _peaks(score: np.ndarray) -> np.ndarray:
    """Scores, rows and columns (k, 3) of those larger (in size) than their neighbours."""
    size = np.nan_to_num(np.abs(score))
    if not size.size:
        return np.empty((0, 3))
    at = np.argwhere((size > 0) & (size == scipy.ndimage.maximum_filter(size, 3)))
    return np.column_stack([score[tuple(at.T)], at])


def _highest(peaks: dict[_Key, np.ndarray]) -> tuple[_Key, np.ndarray]:
    """The key and the peak of the highest score."""
    tops = {
        key: found[np.abs(found[:, 0]).argmax()] for key, found in peaks.items() if len(found)
    }
    if not tops:
        raise ValueError("the map does not fit on the surface")
    key = max(tops, key=lambda each: abs(tops[each][0]))
    return key, tops[key]


def _elsewhere(peaks: np.ndarray, best: np.ndarray, radius: float) -> float:
    """The highest score that is farther from the best than a radius, or has the other sign."""
    far = np.hypot(*(peaks - best)[:, 1:].T) >= radius
    other = far | (np.sign(peaks[:, 0]) != np.sign(best[0]))
    return float(np.abs(peaks[other, 0]).max(initial=0.0))


def _is_same(one: _Key, other: _Key) -> bool:
    """Whether two are the same match if they are at the same place."""
    off = abs((one[1] - other[1] + 180) % 360 - 180)
    return one[0] == other[0] and one[2] == other[2] and off <= _SAME_TURN


def _around(surface: xr.DataArray, place: Place, half: float) -> xr.DataArray:
    """The part of a surface around a place."""
    y, x = (slice(at - half, at + half) for at in place[:2])
    return surface.sel(y=y, x=x)


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

    def _offsets(self, turn: float, step: float, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Places (v, u) of a window's elements along the axes of the turned map, mm."""
        along = (np.arange(count) - (count - 1) / 2) * step
        return rotated(along[:, None], along[None, :], -turn)

    def covered(self, turn: float, step: float, count: int) -> np.ndarray:
        """Which elements of a window the turned map covers."""
        v, u = self._offsets(turn, step, count)
        return (abs(v) <= self.sides[0] / 2) & (abs(u) <= self.sides[1] / 2)

    def laid(self, mirrored: bool, turn: float, step: float, count: int) -> np.ndarray:
        """Its heights on a window's elements."""
        return self.at(*self._offsets(turn, step, count), mirrored)

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
    squares: (
        np.ndarray
    )  # sums of those of heights less their plane; NaN where there is no stone


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
        return _Window(covered, planes, np.where(is_stone, squares, np.nan))

    def held_against(self, heights: np.ndarray, window: _Window) -> "_Held":
        """What a scan's heights (points,) have in common with the surface, wherever they lie."""
        flat = heights - window.planes @ (window.planes.T @ heights)
        (products,) = self._sums([self.heights], flat, window.covered)
        return _Held(products, float(flat @ flat), window.squares)


@dataclass(frozen=True)
class _Fit:
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
    ) -> "_Fit":
        sides = [
            n * d for scan in scans for n, d in zip(scan.shape, spacing_of(scan), strict=True)
        ]
        step = max(spacing_of(surface)[0], min(sides) / _REFINED)
        edge = max(step, surface.attrs.get("mesh_edge_mm", 0.0))
        points, heights, blocks = [], [], list[np.ndarray]()
        for scan, (dv, du) in zip(scans, reading, strict=True):
            template = _Template.of(scan, edge)
            along = [np.arange(-side / 2 + step / 2, side / 2, step) for side in template.sides]
            v, u = (each.ravel() for each in np.meshgrid(*along, indexing="ij"))
            blocks.append(_blocks(v, u) + _BLOCKS**2 * len(blocks))
            heights.append(template.at(v, u, mirrored))
            points.append((v + dv, u + (-du if mirrored else du)))
        return cls(surface, points, heights, np.concatenate(blocks), step)

    def refined(self, start: Place, *, is_turned: bool = True) -> "_Refined":
        """The best place near another; perhaps without turning."""
        reach = max(np.hypot(v, u).max() for v, u in self.points) + 5 * self.step
        spline = spline_of(_around(self.surface, start, reach))

        def at(pose: np.ndarray) -> Place:
            y, x, *turn = map(float, pose)
            degrees = math.degrees(turn[0]) if turn else start.rotation_deg
            return Place(y, x, (degrees + 180) % 360 - 180)

        def under(pose: np.ndarray) -> Iterator[np.ndarray]:
            yield from (spline.ev(*at(pose).points(v, u)) for v, u in self.points)

        def residual(pose: np.ndarray) -> np.ndarray:
            """Heights of the surface less those of each scan, without their planes and scales."""
            columns = (
                np.column_stack([_plane(v, u), heights])
                for (v, u), heights in zip(self.points, self.heights, strict=True)
            )
            return np.concatenate([*map(_less, columns, under(pose))])

        count = 3 if is_turned else 2
        pose = np.array([start.y_mm, start.x_mm, math.radians(start.rotation_deg)])[:count]
        scale = (self.step, self.step, 0.01)[:count]
        fit = scipy.optimize.least_squares(residual, pose, x_scale=scale)
        planes = [_plane(v, u) for v, u in self.points]
        seen, own = (
            np.concatenate([*map(_less, planes, of)]) for of in (under(fit.x), self.heights)
        )
        common, squares = float(seen @ own), float(own @ own)
        length = math.sqrt(float(seen @ seen) * squares)
        return _Refined(
            at(fit.x),
            correlation=common / length if length > 0 else 0.0,
            error_mm=_jackknife(fit.jac, fit.fun, self.blocks),
            scale=common / squares if squares > 0 else 0.0,
        )


class _Refined(NamedTuple):
    """A place between the elements, how well scans fit there, and the error of the place."""

    place: Place
    correlation: float
    error_mm: float
    scale: float  # heights of the surface beside those of the scans


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
