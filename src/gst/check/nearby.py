"""Positions of scans near positions that were set by hand, with their probabilities.

A mesh shows few waves of a scan of 0.85 mm, so the scan may fit at several positions within half a
millimetre. The residuals between scans and mesh are assumed to be normal, with a variance common to
all scans. This assumption gives each peak of the correlation a probability. A scan is found only at
a position that is nearly certain. Otherwise its alternatives are listed.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
import xarray as xr

from gst.check.aligning import Fit, Refined, part_around, widened
from gst.check.matching import LEAST_LEAD, Match
from gst.check.sliding import Search, Template, correlation_of, peaks_of, wrapped
from gstlib.surfaces.fitting import vertex
from gstlib.surfaces.footprints import PatchPosition

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

# mirrored, sign, half turns, and index of the rotation
_Pose = tuple[bool, float, int, int]


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
        As in `gst.check.matching.match_together`.
    places : sequence of PatchPosition
        Approximate position of each scan.

    Raises
    ------
    ValueError
        As in `gst.check.matching.match_map`.
    """
    search = Search.of(surface, scans)
    pairs = zip(search.templates, places, strict=True)
    near = [_near(search, *pair) for pair in pairs]
    sums = {pose: _common([peaks[pose] for peaks in near]) for pose in near[0]}
    pose = max(sums, key=lambda each: sums[each])
    mirrored, sign, half, number = pose
    laid = pose[:3]
    another = max(total for each, total in sums.items() if each[:3] != laid)
    is_clear = sums[pose] - another >= LEAST_LEAD / math.sqrt(len(scans))
    by_turn = [sums[mirrored, sign, half, n] for n in range(len(_BY_HAND))]
    turn = 180 * half + _top(number, by_turn)
    alone = np.zeros((1, 2))
    fits = [Fit.on(surface, [scan], alone, mirrored) for scan in scans]

    def lying(starts: Iterable[Sequence[PatchPosition]]) -> list[_Lying | None]:
        return [_lying(*each, sign) for each in zip(fits, places, starts, strict=True)]

    by_hand = lying(
        [PatchPosition(y, x, place.rotation_deg + turn) for _, y, x in peaks[pose]]
        for peaks, place in zip(near, places, strict=True)
    )
    off = _common_turn([each for each in by_hand if each])
    turned = lying(each.turned(off) if each else [] for each in by_hand)
    shared = _Shared.among([each for each in turned if each])
    anywhere = np.diag([math.inf] * 3)
    matches = []
    for place, each in zip(places, turned, strict=True):
        match = Match(place, mirrored, sign < 0, 0.0, 0.0, anywhere, is_found=False)
        matches.append(shared.match(each, match, is_clear) if each else match)
    return matches


class _Lying(NamedTuple):
    """Possible positions of a scan with the common rotation, the best first."""

    fits: list[Refined]
    free: Refined  # the best one, refined with a rotation of its own

    def turned(self, off: float) -> list[PatchPosition]:
        """The positions, rotated further by an angle (degrees)."""
        places = (fit.place for fit in self.fits)
        return [
            place._replace(rotation_deg=place.rotation_deg + off) for place in places
        ]

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


def _error_of_turn(lying: Sequence[_Lying], variance: float) -> float:
    """Error of the common rotation (radians), from the fits or from the scatter of the scans."""
    turns, weights = np.transpose(
        [(math.radians(each.own_turn), each.weight) for each in lying]
    )
    scatter = 0.0
    if len(turns) > 1:
        scatter = float(np.cov(turns, aweights=weights, ddof=1))
    several = weights.sum() ** 2 / (weights**2).sum()
    return math.sqrt(max(variance / weights.sum(), scatter / several))


def _common_turn(lying: Sequence[_Lying]) -> float:
    """The weighted mean of the scans' own rotations, degrees."""
    if not lying:
        return 0.0
    turns, weights = np.transpose([(each.own_turn, each.weight) for each in lying])
    is_usual = abs(turns - np.median(turns)) <= _MOST_TURNED
    return float(np.average(turns[is_usual], weights=weights[is_usual]))


def _near(
    search: Search, template: Template, place: PatchPosition
) -> dict[_Pose, np.ndarray]:
    """Peaks (score, y, x) around a position, by pose."""
    step = search.step
    half = template.count(step) * step / 2 + _REACH + step
    part = Search.on(part_around(search.surface, place, half), [template])
    by_pose = {}
    turns = place.rotation_deg + _BY_HAND
    for number, (pose, held) in enumerate(part.slid(turns)):
        peaks = peaks_of(correlation_of(held, np.zeros((1, 2), int)))
        peaks[:, 1:] = part.centres(peaks[:, 1:])
        off_y, off_x = (peaks[:, 1:] - place[:2]).T
        peaks = peaks[np.hypot(off_y, off_x) <= _REACH]
        for sign in (1.0, -1.0):
            key = pose[0], sign, number % 2, number // 4
            own = peaks[sign * peaks[:, 0] > 0] * [sign, 1, 1]
            by_pose[key] = own[np.argsort(-own[:, 0])]
    return by_pose


def _common(peaks: Sequence[np.ndarray]) -> float:
    """Mean of the highest scores of the scans, in Fisher's z."""
    tops = [each[:, 0].max(initial=0.0) for each in peaks]
    return float(np.mean(np.arctanh(np.minimum(tops, 1 - 1e-9))))


def _top(number: int, sums: Sequence[float]) -> float:
    """The rotation (degrees) with the highest sum, interpolated by a parabola."""
    if not 0 < number < len(sums) - 1:
        return float(_BY_HAND[number])
    return float(_BY_HAND[number] + vertex(sums[number - 1 : number + 2], _STEP))
