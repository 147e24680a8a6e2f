"""Positions of scans on a mesh or on a larger map, found by their heights.

Heights are correlated at every shift and rotation, also mirrored (`gst.check.sliding`). The best
position is refined between the elements, and its error is estimated (`gst.check.aligning`).

A mesh shows too few waves of a patch of 0.85 mm to find it anywhere on a stone (`match_map`).
Several patches can be found if the stage coordinates give their distances (`match_together`). A
single patch can be found near a position that was set by hand (`gst.check.nearby`).
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import xarray as xr

from gst.check.aligning import Fit
from gst.check.sliding import Search, correlation_of, elements, peaks_of, wrapped
from gstlib.surfaces.footprints import PatchPosition

# Number of rotations that are tried. Half a step moves the corners of a map of 2.5 mm by 50 µm, a
# quarter of the shortest waves that a mesh shows.
_TURNS = 72
# ASSUME: Acceptance of a match. A map is located if it correlates by at least 0.6. It must also
# lead any other position, rotation or mirroring by 0.35 in Fisher's z (artanh r). Scans that are
# tied together by their stage coordinates need a lead of 0.2. Reason: `benchmarks/finding.py` lists
# the leads of scans on their own stones and on others.
_LEAST_CORRELATION, LEAST_LEAD, _LEAST_LEAD_TOGETHER = 0.6, 0.35, 0.2
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
    own: tuple[
        float, ...
    ] = ()  # of scans that were found together: the correlation of each
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
        matches = []
        for offset, own, fits in zip(
            offsets, self.own, _fitting(self.own), strict=True
        ):
            lies = self.at(*map(float, offset))
            matches.append(
                lies if fits else replace(lies, correlation=own, is_found=False)
            )
        return matches

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
        least = LEAST_LEAD if count == 1 else _LEAST_LEAD_TOGETHER
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
    search, peaks = Search.of(surface, scans), dict[_Key, np.ndarray]()
    for pose, held in search.slid(_all_around(search, readings)):
        for number, reading in enumerate(readings):
            at = elements(reading, pose, search.step)
            scores = peaks_of(correlation_of(held, at))
            peaks[*pose, number] = scores - [0, *at.min(axis=0)]
    key, best = _highest(peaks)
    mirrored, turn, number = key
    y, x = search.centres(best[1:])
    sign, at = np.sign(best[0]), readings[number]
    start = PatchPosition(y, x, turn)
    fit = Fit.on(surface, scans, at, mirrored).refined(start)
    own, best_fit = sign * fit.each, fit
    if not (fits := _fitting(own)).all():
        kept = [scan for scan, fitting in zip(scans, fits, strict=True) if fitting]
        best_fit = Fit.on(surface, kept, at[fits], mirrored).refined(start)
    side = min(min(each.sides) for each in search.templates)
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
    elsewhere = []
    for other, scores in peaks.items():
        away = _SAME_PLACE * side / search.step if _is_same(key, other) else 0.0
        elsewhere.append(_elsewhere(scores, best, away))
    return match.among(elsewhere, len(scans)), number


def _fitting(own: Sequence[float] | np.ndarray) -> np.ndarray:
    """Mask of the scans that fit at the common position, by the correlation of each."""
    strength = np.arctanh(np.clip(own, -_ONE, _ONE))
    is_usual = strength >= np.median(strength) - _BELOW_TIED
    return is_usual | (np.asarray(own) >= _LEAST_OWN)


_Key = tuple[bool, float, int]  # mirrored, rotation in degrees, index of the reading


def _all_around(search: Search, readings: np.ndarray) -> np.ndarray:
    """Rotations over 180°, so close that half a step moves no scan by an element."""
    offsets = readings - readings.mean(axis=1, keepdims=True)
    apart = np.linalg.norm(offsets, axis=-1).max()
    radius = apart + max(math.hypot(*each.sides) / 2 for each in search.templates)
    count = max(_TURNS // 2, math.ceil(math.pi * radius / (2 * search.step)))
    return np.arange(count) * 180 / count


def _highest(peaks: dict[_Key, np.ndarray]) -> tuple[_Key, np.ndarray]:
    """The key and the peak of the highest score."""
    tops = {}
    for key, own in peaks.items():
        if len(own):
            tops[key] = own[np.abs(own[:, 0]).argmax()]
    if not tops:
        raise ValueError("the map does not fit on the surface")
    key = max(tops, key=lambda each: abs(tops[each][0]))
    return key, tops[key]


def _elsewhere(peaks: np.ndarray, best: np.ndarray, radius: float) -> float:
    """The highest score beyond a radius around the best, or with the opposite sign."""
    far = np.hypot(*(peaks - best)[:, 1:].T) >= radius
    scores = peaks[:, 0]
    other = far | (np.sign(scores) != np.sign(best[0]))
    return float(np.abs(scores[other]).max(initial=0.0))


def _is_same(one: _Key, other: _Key) -> bool:
    """Whether two keys are the same match if they have the same position."""
    off = abs(wrapped(one[1] - other[1]))
    return one[0] == other[0] and one[2] == other[2] and off <= _SAME_TURN
