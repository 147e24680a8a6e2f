"""Positions of scans on a mesh or on a larger map, found by their heights.

Heights are correlated at every shift and rotation, also mirrored. The best position is refined
between the elements, and its error is estimated (`gst.check.sliding`).

A mesh shows too few waves of a patch of 0.85 mm to find it anywhere on a stone (`match_map`).
Several patches can be found if the stage coordinates give their distances (`match_together`). A
single patch can be found near a position that was set by hand (`match_near`). It may fit at several
positions within half a millimetre. The residuals between scans and mesh are assumed to be normal,
with a variance common to all scans. This assumption gives each peak of the correlation a
probability. A scan is found only at a position that is nearly certain. Otherwise its alternatives
are listed.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gst.check.sliding import (
    Fit,
    Refined,
    Search,
    Template,
    part_around,
    widened,
    wrapped,
)
from gstlib.surfaces.footprints import PatchPosition

# Number of rotations that are tried. Half a step moves the corners of a map of 2.5 mm by 50 µm, a
# quarter of the shortest waves that a mesh shows.
_TURNS = 72
# ASSUME: Acceptance of a match. A map is located if it correlates by at least 0.6. It must also
# lead any other position, rotation or mirroring by 0.35 in Fisher's z (artanh r). Scans that are
# tied together by their stage coordinates need a lead of 0.2. Reason: `benchmarks/finding.py` lists
# the leads of scans on their own stones and on others.
_LEAST_CORRELATION, _LEAST_LEAD, _LEAST_LEAD_TOGETHER = 0.6, 0.35, 0.2
# ASSUME: Scans with wrong stage coordinates. A scan that is tied to others by stage coordinates was
# taken elsewhere under two conditions. At the position that follows, it correlates by less than
# 0.7, and its Fisher's z is lower by 0.6 than the z of the others. Reason: The other scans show how
# strongly scans of this stone correlate at their own positions.
_LEAST_OWN, _BELOW_TIED = 0.7, 0.6
# Larger correlations are replaced by this one, whose z is finite.
_ONE = 1 - 1e-9
# A position within this share of the shorter side of the map, and within this rotation (degrees),
# is the same match.
_SAME_PLACE, _SAME_TURN = 0.5, 20.0
# Largest error of positions by hand (mm), and the step of the rotations that are tried (degrees).
_REACH, _STEP = 0.75, 3.0
_BY_HAND = np.arange(-12.0, 12.1, _STEP)
# Number of peaks that are refined, and the distance (mm) below which two of them are the same.
_PEAKS, _SAME = 8, 0.05
# A scan is found if it is within this distance (mm) of the best position with this probability. One
# in twenty may be wrong.
_WRONG, _SURE = 0.1, 0.95
# Smallest probability of residuals that are as large as observed.
_LEAST_CHANCE = 0.01
# ASSUME: Acceptance of a position set by hand. A scan near a position set by hand was taken there
# under three conditions. It correlates by at least 0.8, and it turns by at most 10 degrees. Its
# heights relative to the mesh differ by a factor of at most 1.4 from the heights of the other
# scans. Reason: `benchmarks/finding.py` lists the scans that are accepted with these limits, at
# correct and at wrong positions.
_LEAST_NEAR, _MOST_TURNED, _MOST_HIGHER = 0.8, 10.0, 1.4
# Efficiency of the median of normal values, relative to their mean.
_MEDIAN_TELLS = 2 / math.pi

_POSE = ["mirrored", "inverted", "half", "number"]


@dataclass(frozen=True)
class Match:
    """The position of a scan on a surface, with its certainty."""

    # of the centre of the scan, which is mirrored first, if at all, and then rotated
    place: PatchPosition
    mirrored: bool  # whether it is reversed along x
    inverted: bool  # whether its heights have the opposite sign, as on a mould
    correlation: float  # of heights, a plane removed from each
    next_best: float  # correlation at another position, rotation or mirroring
    # covariance (3, 3) of y and x (mm) and the rotation (radians)
    covariance: np.ndarray = field(compare=False)
    is_found: bool  # whether correlation and lead are large enough
    # of scans that were found together: the correlation of each
    own: tuple[float, ...] = ()
    # Whether a scan was taken near here, but its exact position, or which of several positions is
    # right, is not certain; and the other positions.
    is_uncertain: bool = False
    alternatives: tuple[PatchPosition, ...] = ()

    @property
    def error_mm(self) -> float:
        """Standard error of the position, along the axis with the larger error."""
        return math.sqrt(self.covariance.diagonal()[:2].max())

    @property
    def lead(self) -> float:
        """Lead of the correlation over the next best, in Fisher's z."""
        own, other = (min(each, _ONE) for each in (self.correlation, self.next_best))
        return math.atanh(own) - math.atanh(other)

    def place_of(self, v: float, u: float) -> PatchPosition:
        """The position of a point at (v, u) from the centre, along the axes of the scan, mm."""
        y, x = self.place.points(v, -u if self.mirrored else u)
        return PatchPosition(float(y), float(x), self.place.rotation_deg)

    def at(self, v: float, u: float) -> "Match":
        """The match of a point at (v, u) from the centre, with the error due to the rotation."""
        place = self.place_of(v, u)
        lever = np.eye(3)
        lever[:2, 2] = place.x_mm - self.place.x_mm, self.place.y_mm - place.y_mm
        return replace(self, place=place, covariance=lever @ self.covariance @ lever.T)

    def each(self, offsets: np.ndarray) -> "list[Match]":
        """The matches of scans that were found together, at (n, 2) from their common point.

        A scan that does not fit there by itself shows another position, and is not found.
        """
        lying = (self.at(*map(float, offset)) for offset in offsets)
        return [
            match if fits else replace(match, correlation=own, is_found=False)
            for match, own, fits in zip(
                lying, self.own, _fitting(self.own), strict=True
            )
        ]

    def carrying(self, inner: "Match", middle: Sequence[float]) -> "Match":
        """The position of a scan that was found on this scan, whose centre is at `middle`, mm."""
        y, x, turn = inner.place
        there = self.at(y - middle[0], x - middle[1])
        way = -1 if self.mirrored else 1
        turned = there.place.rotation_deg + way * turn
        upright = PatchPosition(0.0, 0.0, there.place.rotation_deg)
        axes = np.diag([0.0, 0.0, way])
        axes[:2, :2] = upright.points(np.array([1, 0]), np.array([0, way]))
        return replace(
            inner,
            place=there.place._replace(rotation_deg=wrapped(turned)),
            mirrored=self.mirrored != inner.mirrored,
            inverted=self.inverted != inner.inverted,
            covariance=there.covariance + axes @ inner.covariance @ axes.T,
            is_found=self.is_found and inner.is_found,
        )

    def among(self, others: Iterable[float], count: int) -> "Match":
        """The match of `count` scans, in view of the correlations at other positions."""
        match = replace(self, next_best=max([self.next_best, *others]))
        least = _LEAST_LEAD if count == 1 else _LEAST_LEAD_TOGETHER
        is_right = match.correlation >= _LEAST_CORRELATION and match.lead >= least
        return replace(match, is_found=self.is_found and is_right)


def match_map(surface: xr.DataArray, scan: xr.DataArray) -> Match:
    """Find a map of heights on a larger surface.

    Parameters
    ----------
    surface : (y, x) xarray.DataArray
        Heights of the stone from its mesh, mm, NaN beside the stone, on elements of at most half
        the edges of the mesh; or heights of a larger map.
    scan : (y, x) xarray.DataArray
        Heights of the map, mm, NaN where unmeasured.

    Returns
    -------
    Match
        The best position. ``is_found`` states whether it is reliable. A map of 2.5 mm on a face of
        17 mm with elements of 50 µm takes about 3 s and 90 MB.

    Raises
    ------
    ValueError
        The map has fewer than 12 elements of the surface along a side, or does not fit on it.
    """
    return match_together(surface, [scan], np.zeros((1, 1, 2)))[0]


def match_together(
    surface: xr.DataArray, scans: Sequence[xr.DataArray], readings: np.ndarray
) -> tuple[Match, int]:
    """Find scans with known distances, as if they were one map.

    Parameters
    ----------
    surface
        As in `match_map`.
    scans : sequence of (y, x) xarray.DataArray
        Heights, mm.
    readings : (k, n, 2) ndarray
        For each interpretation of the stage coordinates, the centres of the scans relative to a
        common point, along the axes of the scans (y, x), mm.

    Returns
    -------
    match : Match
        The match of the common point.
    reading : int
        The index of the interpretation that fits.

    Raises
    ------
    ValueError
        As in `match_map`.
    """
    search = Search.of(surface, scans)
    peaks = search.peaks(_all_around(search, readings), readings)
    if peaks.empty:
        raise ValueError("the map does not fit on the surface")
    scores = peaks.score.abs()
    best = peaks.loc[scores.idxmax()]
    mirrored, number = bool(best.mirrored), int(best.reading)
    start, offsets = PatchPosition(best.y, best.x, best.turn), readings[number]
    sign = np.sign(best.score)
    best_fit = fit = Fit(surface, scans, offsets, mirrored).refined(start)
    own = sign * fit.each
    if not (fits := _fitting(own)).all():
        kept = [scan for scan, fitting in zip(scans, fits, strict=True) if fitting]
        best_fit = Fit(surface, kept, offsets[fits], mirrored).refined(start)
    side = min(min(each.sides) for each in search.templates)
    is_same = (
        (peaks[["mirrored", "reading"]] == best[["mirrored", "reading"]]).all(axis=1)
        & (np.sign(peaks.score) == sign)
        & (np.hypot(peaks.y - best.y, peaks.x - best.x) < _SAME_PLACE * side)
        & (np.abs(wrapped(peaks.turn - best.turn)) <= _SAME_TURN)
    )
    match = Match(
        best_fit.place,
        mirrored,
        inverted=bool(sign < 0),
        correlation=abs(fit.correlation),
        next_best=0.0,
        covariance=best_fit.covariance,
        is_found=True,
        own=tuple(map(float, own)),
    )
    return match.among(scores[~is_same], len(scans)), number


def _fitting(own: Sequence[float] | np.ndarray) -> np.ndarray:
    """Mask of the scans that fit at the common position, by the correlation of each."""
    strength = np.arctanh(np.clip(own, -_ONE, _ONE))
    is_usual = strength >= np.median(strength) - _BELOW_TIED
    return is_usual | (np.asarray(own) >= _LEAST_OWN)


def _all_around(search: Search, readings: np.ndarray) -> np.ndarray:
    """Rotations over 180°, so close that half a step moves no scan by an element."""
    offsets = readings - readings.mean(axis=1, keepdims=True)
    apart = np.linalg.norm(offsets, axis=-1).max()
    radius = apart + max(math.hypot(*each.sides) / 2 for each in search.templates)
    count = max(_TURNS // 2, math.ceil(math.pi * radius / (2 * search.step)))
    return np.arange(count) * 180 / count


def match_near(
    surface: xr.DataArray,
    scans: Sequence[xr.DataArray],
    places: Sequence[PatchPosition],
) -> list[Match]:
    """Find scans within 0.75 mm of positions by hand, with a common rotation of up to 12°.

    Either all scans are mirrored or none, and all heights have the same sign. All scans may be
    rotated by 180°. A scan that fits nearly as well at several positions, or whose position is not
    exact, is not found. It is ``is_uncertain`` and has ``alternatives``.

    Parameters
    ----------
    surface, scans
        As in `match_together`.
    places : sequence of PatchPosition
        Approximate position of each scan.

    Raises
    ------
    ValueError
        As in `match_map`.
    """
    search = Search.of(surface, scans)
    near = [
        _near(search, template, place)
        for template, place in zip(search.templates, places, strict=True)
    ]
    tops = np.zeros((len(scans), 2, 2, 2, len(_BY_HAND)))
    for top, peaks in zip(tops, near, strict=True):
        np.maximum.at(top, tuple(peaks[_POSE].to_numpy(int).T), peaks.score.abs())
    common = np.arctanh(np.minimum(tops, _ONE)).mean(axis=0)
    pose = [*map(int, np.unravel_index(common.argmax(), common.shape))]
    mirrored, inverted, half, number = pose
    another, best = np.sort(common.max(axis=-1), axis=None)[-2:]
    is_clear = best - another >= _LEAST_LEAD / math.sqrt(len(scans))
    turn = 180 * half + float(_BY_HAND[number])
    alone = np.zeros((1, 2))
    fits = [Fit(surface, [scan], alone, bool(mirrored)) for scan in scans]
    sign = -1 if inverted else 1

    def lying(starts: Iterable[Sequence[PatchPosition]]) -> list[_Lying | None]:
        return [_lying(*each, sign) for each in zip(fits, places, starts, strict=True)]

    by_hand = lying(
        [
            PatchPosition(peak.y, peak.x, place.rotation_deg + turn)
            for peak in peaks[(peaks[_POSE] == pose).all(axis=1)].itertuples()
        ]
        for peaks, place in zip(near, places, strict=True)
    )
    off = _common_turn([each for each in by_hand if each])
    turned = lying(each.turned(off) if each else [] for each in by_hand)
    shared = _Shared.among([each for each in turned if each])
    nowhere = Match(
        places[0],
        bool(mirrored),
        bool(inverted),
        correlation=0.0,
        next_best=0.0,
        covariance=np.diag([math.inf] * 3),
        is_found=False,
    )
    return [
        shared.match(each, nowhere, is_clear) if each else replace(nowhere, place=place)
        for place, each in zip(places, turned, strict=True)
    ]


class _Lying(NamedTuple):
    """Possible positions of a scan with the common rotation, the best first."""

    fits: list[Refined]
    free: Refined  # the best one, refined with a rotation of its own

    def turned(self, off: float) -> list[PatchPosition]:
        """The positions, rotated further by an angle (degrees)."""
        return [PatchPosition(y, x, turn + off) for (y, x, turn), *_ in self.fits]

    @property
    def own_turn(self) -> float:
        """Difference between its own and the common rotation, degrees."""
        return wrapped(self.free.place.rotation_deg - self.fits[0].place.rotation_deg)

    @property
    def weight(self) -> float:
        """The weight of the scan for the common rotation: an inverse variance."""
        return 1 / max(float(self.free.shape[2, 2]), 1e-12)


def _lying(
    fit: Fit, by_hand: PatchPosition, starts: Sequence[PatchPosition], sign: float
) -> _Lying | None:
    """Refine a scan from several starts; None if it fits at none with heights of this sign."""
    fits: list[Refined] = []
    for start in starts[:_PEAKS]:
        refined = fit.refined(start, is_turned=False)
        is_near = _apart(refined.place, by_hand) <= _REACH
        is_new = all(_apart(refined.place, other.place) > _SAME for other in fits)
        if is_near and is_new and sign * refined.scale > 0:
            fits.append(refined)
    fits.sort(key=lambda refined: -abs(refined.correlation))
    return _Lying(fits, fit.refined(fits[0].place)) if fits else None


class _Shared(NamedTuple):
    """Properties of all scans together: variance of the residuals and scale of the heights."""

    variance: float  # of one independent value, as `Refined.variance`
    freedom: float  # degrees of freedom of this variance
    scale: float
    of_turn: float  # variance of the common rotation, radians²

    @classmethod
    def among(cls, lying: Sequence[_Lying]) -> "_Shared":
        if not lying:
            return cls(math.inf, 1.0, 1.0, math.inf)
        best = (each.fits[0] for each in lying)
        own = [(fit.squares, fit.freedom, fit.scale) for fit in best]
        squares, freedom, scale = np.median(own, axis=0)
        variance = squares / scipy.special.chdtri(freedom, 0.5)
        freedom = max(1.0, _MEDIAN_TELLS * freedom * len(lying))
        return cls(variance, freedom, scale, _error_of_turn(lying, variance) ** 2)

    def match(self, lying: _Lying, match: Match, is_clear: bool) -> Match:
        """The position of a scan, its likely alternatives, and whether it is found."""
        best, *others = lying.fits
        squares = np.array([fit.squares_with(self.scale) for fit in lying.fits])
        chances = self._chances(lying.fits, squares)
        ratio = squares[0] / best.freedom / self.variance
        chance = scipy.special.fdtrc(best.freedom, self.freedom, ratio)
        is_taken_here = (
            is_clear
            and abs(best.correlation) >= _LEAST_NEAR
            and chance >= _LEAST_CHANCE
            and abs(lying.own_turn) <= _MOST_TURNED
            and 1 / _MOST_HIGHER <= best.scale / self.scale <= _MOST_HIGHER
        )
        covariance = self._covariance(lying)
        variance = covariance.diagonal()[:2].sum()
        within = -math.expm1(-(_WRONG**2) / variance)
        is_sure = chances[0] * within >= _SURE
        is_likely = chances[1:] >= (1 - _SURE) / _PEAKS
        likely = (fit.place for fit in itertools.compress(others, is_likely))
        return replace(
            match,
            place=best.place,
            correlation=abs(best.correlation),
            next_best=max([abs(fit.correlation) for fit in others], default=0.0),
            covariance=covariance,
            is_found=is_taken_here and is_sure,
            is_uncertain=is_taken_here and not is_sure,
            alternatives=tuple(likely) if is_taken_here and not is_sure else (),
        )

    def _chances(self, fits: Sequence[Refined], squares: np.ndarray) -> np.ndarray:
        """The probability of each position: quality of the fit times width of the peak."""
        more = (squares - squares.min()) / (self.freedom * self.variance)
        widths = [np.linalg.slogdet(fit.shape)[1] for fit in fits]
        logarithm = -self.freedom / 2 * np.log1p(more) + np.array(widths) / 2
        return scipy.special.softmax(logarithm)

    def _covariance(self, lying: _Lying) -> np.ndarray:
        """Covariance of position and rotation; the position depends on the common rotation.

        A scan with larger residuals than the others has a larger error.
        """
        by_turn = np.append(lying.free.shape[:2, 2] * lying.weight, 1.0)
        covariance = self.of_turn * np.outer(by_turn, by_turn)
        best = lying.fits[0]
        covariance[:2, :2] += max(self.variance, best.variance) * best.shape
        return covariance * widened(self.freedom) ** 2


def _apart(one: PatchPosition, other: PatchPosition) -> float:
    return math.dist(one[:2], other[:2])


def _turns(lying: Sequence[_Lying]) -> np.ndarray:
    """The scans' own rotations (degrees), and their weights."""
    return np.transpose([(each.own_turn, each.weight) for each in lying])


def _error_of_turn(lying: Sequence[_Lying], variance: float) -> float:
    """Error of the common rotation (radians), from the fits or from the scatter of the scans."""
    turns, weights = _turns(lying)
    scatter = 0.0
    if len(turns) > 1:
        scatter = float(np.cov(np.radians(turns), aweights=weights, ddof=1))
    several = weights.sum() ** 2 / (weights**2).sum()
    return math.sqrt(max(variance / weights.sum(), scatter / several))


def _common_turn(lying: Sequence[_Lying]) -> float:
    """The weighted mean of the scans' own rotations, degrees."""
    if not lying:
        return 0.0
    turns, weights = _turns(lying)
    off = abs(turns - np.median(turns))
    # of two that differ more, both are as far from the median
    is_usual = off <= max(_MOST_TURNED, off.min())
    return float(np.average(turns[is_usual], weights=weights[is_usual]))


def _near(search: Search, template: Template, place: PatchPosition) -> pd.DataFrame:
    """Peaks within reach of a position, the highest of each pose first, with `_POSE`."""
    step = search.step
    half = template.count(step) * step / 2 + _REACH + step
    part = Search(part_around(search.surface, place, half), [template])
    peaks = part.peaks(place.rotation_deg + _BY_HAND, np.zeros((1, 1, 2)))
    off = np.hypot(peaks.y - place.y_mm, peaks.x - place.x_mm)
    turn = peaks.turn - place.rotation_deg
    peaks["inverted"], peaks["half"] = peaks.score < 0, turn > 90
    peaks["number"] = ((turn - 180 * peaks.half - _BY_HAND[0]) / _STEP).round()
    return peaks[off <= _REACH]
