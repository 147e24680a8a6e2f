"""The search of a registration: the shift at which the details of two surfaces match.

The shift is the peak of the normalised cross-correlation over the overlap (scikit-image, after
Padfield 2012, IEEE Trans. Image Process. 21:2706) of band-passed heights. The longest waves
dominate a self-affine surface and match anywhere within a field, so they are removed first.

A striated face has details across its striae and hardly any along them, so it fits its copy at many
positions along the striae. The shift along a direction is reliable only if the slopes along this
direction correlate, too.
"""

import math
from typing import NamedTuple

import numpy as np
import scipy

from gstlib.change.poses import sample, turned
from gstlib.surfaces.filtering import smooth_rises
from gstlib.surfaces.fitting import robust_sigma

__all__ = [
    "LEAST_ALONG",
    "LEAST_CORRELATION",
    "LEAST_OVERLAP",
    "LEAST_POINTS",
    "ROUNDING",
    "Details",
    "Match",
    "pearson",
]

# Chance matches increase as the overlap decreases, so smaller overlaps are not searched. If the
# best match may be due to chance, only larger overlaps are searched.
LEAST_OVERLAP, _LARGE_OVERLAP = 0.25, 0.6
# Band of the heights for the search. Noise below this many elements is smoothed away, and waves
# longer than this fraction of the field are removed.
_NOISE_ELEMENTS = 1.5
_LONGEST_FRACTION = 1 / 24
# Rotations (degrees) from which the refinement may start.
_TURNS = 0.0, -0.5, 0.5, -1.0, 1.0, -1.5, 1.5, -2.0, 2.0
# ASSUME: Reliable registration. The band-passed heights must correlate by 0.5, and by 0.35 over the
# square root of the overlap. Reason: Unrelated surfaces reach 0.2 over this root by chance, and
# seldom 0.3.
LEAST_CORRELATION = 0.5
_BEYOND_CHANCE = 0.35
# ASSUME: Reliable shift along a direction. The slopes along this direction must also correlate, by
# at least 0.25. Reason: Striae match their copy anywhere along their direction.
LEAST_ALONG = 0.25
_SLOPE_SMOOTHING = 2.0
_EDGE = 6  # elements at the edges of a surface where slopes are not known
# Fewer points are not enough to fit a plane or a pose.
LEAST_POINTS = 100
# Interpolation weights, and slopes relative to the steepest ones, are rounding below this value.
ROUNDING = 1e-6
_TINY = float(np.finfo(float).tiny)


def _detail(heights: np.ndarray, longest: float) -> np.ndarray:
    """Heights without waves longer than `longest` elements, clipped so that no spike dominates."""
    detail = heights - scipy.ndimage.gaussian_filter(heights, longest)
    bound = 3 * robust_sigma(detail)
    return np.clip(detail, -bound, bound)


def _slopes(heights: np.ndarray) -> np.ndarray:
    """Slopes (y or x, rows, columns), shortened so that no spike dominates; NaN at the edges.

    Finite differences, clipped components and mirrored edges would all create slopes along striae
    that run between the axes.
    """
    rises = smooth_rises(heights, _SLOPE_SMOOTHING)
    steepness = np.hypot(*rises)
    bound = 3 * np.median(steepness)
    inner = np.s_[:, _EDGE:-_EDGE, _EDGE:-_EDGE]
    slopes = np.full_like(rises, np.nan)
    slopes[inner] = (rises * np.minimum(1, bound / np.maximum(steepness, _TINY)))[inner]
    return slopes


class Match(NamedTuple):
    """Agreement of the details of two surfaces at one pose."""

    pose: np.ndarray
    correlation: float
    overlap: float  # share of the smaller surface

    @property
    def strength(self) -> float:
        return self.correlation * math.sqrt(self.overlap)

    @property
    def is_beyond_chance(self) -> bool:
        return self.correlation >= LEAST_CORRELATION and self.strength >= _BEYOND_CHANCE


class Details:
    """Band-passed heights of the reference and the moving surface, which the search compares.

    `longest` is the longest wave that they contain, in elements, of which every `factor`-th of
    `h0` and `h1` is used. `aspect` is the spacing along y over the spacing along x.
    """

    def __init__(self, h0: np.ndarray, h1: np.ndarray, aspect: float, factor: int):
        self.aspect = aspect
        self.longest = math.ceil(max(h0.shape) / factor) * _LONGEST_FRACTION
        shortest = max(_NOISE_ELEMENTS, factor / 2)
        smooth = (
            scipy.ndimage.gaussian_filter(heights, shortest) for heights in (h0, h1)
        )
        thinned = [heights[::factor, ::factor] for heights in smooth]
        self.reference, self.moving = (
            _detail(heights, self.longest) for heights in thinned
        )
        self.slopes = [*map(_slopes, thinned)]

    def common(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The heights of both surfaces over their overlap."""
        moved = sample(self.moving, pose, self.reference.shape, self.aspect, order=1)
        inside = np.isfinite(moved)
        return self.reference[inside], moved[inside]

    def match(self, pose: np.ndarray) -> Match:
        one, other = self.common(pose)
        overlap = one.size / min(self.reference.size, self.moving.size)
        return Match(pose, pearson(one, other), overlap)

    def dale_depth_ratio(self, pose: np.ndarray) -> float:
        """Ratio of dale depths, moving surface over reference. Wear affects summits, not dales."""
        one, other = self.common(pose)
        if not one.size:
            return math.nan
        is_low = one <= np.median(one)
        depths = (heights[is_low] - np.median(heights) for heights in (one, other))
        first, second = (float(np.mean(depth**2)) for depth in depths)
        return math.sqrt(second / first) if first > 0 else math.nan

    def search(self, least_overlap: float) -> Match:
        """The best match: the peak of the masked correlation at the best of a few rotations."""
        matches = []
        for overlap in sorted({least_overlap, max(least_overlap, _LARGE_OVERLAP)}):
            match = self._peak(self.reference, self.moving, overlap)
            if self.determine(match):
                return match
            matches.append(match)
        best = max(matches, key=lambda match: match.strength)
        if (
            best.is_beyond_chance
        ):  # striae that match: finer details show where along them
            _, direction = self.compare_slopes(best.pose)
            one, other = (
                np.nan_to_num(np.einsum("i,i...->...", direction, slopes))
                for slopes in self.slopes
            )
            match = self._peak(one, other, least_overlap)
            if self.determine(match):
                return match
        return best

    def determine(self, match: Match) -> bool:
        """Whether the details match beyond chance, in every direction."""
        return (
            match.is_beyond_chance and self.compare_slopes(match.pose)[0] >= LEAST_ALONG
        )

    def compare_slopes(self, pose: np.ndarray) -> tuple[float, np.ndarray]:
        """The least correlation of slopes along any direction, and this direction (y, x)."""
        first, second = self.slopes
        shape = self.reference.shape
        moved = [sample(slope, pose, shape, self.aspect, order=1) for slope in second]
        inside = np.isfinite(first[0] + moved[0])
        if inside.sum() < LEAST_POINTS:
            return 0.0, np.ones(2)
        rise_y, rise_x = (slope[inside] for slope in moved)
        other = turned(rise_y, rise_x, pose[2], 1 / self.aspect)
        both = np.concatenate([first[:, inside], other])
        both -= both.mean(axis=1, keepdims=True)
        products = np.einsum("ik,jk->ij", both, both)
        traces = []
        for own in (products[:2, :2], products[2:, 2:]):
            squares, directions = np.linalg.eigh(own)
            traces.append(np.trace(own))
            if not squares[0] > ROUNDING**2 * traces[-1]:
                return 0.0, directions[
                    :, 0
                ]  # the rest along this direction is rounding
        own = products[:2, :2] / traces[0] + products[2:, 2:] / traces[1]
        shared = products[:2, 2:] / math.sqrt(math.prod(traces))
        correlations, directions = scipy.linalg.eigh(shared + shared.T, own)
        return float(correlations[0]), directions[:, 0]

    def _peak(self, a: np.ndarray, b: np.ndarray, least_overlap: float) -> Match:
        """The best match among some rotations at the peak of the correlation."""
        # Imported here, because only registration needs it, and its import is slow.
        from skimage.registration import phase_cross_correlation

        shift, _, _ = phase_cross_correlation(
            a,
            b,
            reference_mask=np.isfinite(a),
            moving_mask=np.isfinite(b),
            overlap_ratio=least_overlap,
        )
        # scikit-image measures from centre to centre; the shift here is from corner to corner.
        shift = shift + np.subtract(a.shape, b.shape) / 2
        # Rotation about the middle of the moving surface or, beyond the reference, about the
        # nearest edge.
        middle = shift + np.subtract(b.shape, 1) / 2
        arm = np.clip(middle, 0, np.subtract(a.shape, 1)) - middle
        matches, (y, x) = [], arm
        for turn in np.radians(_TURNS):
            corner = shift + arm - turned(y, x, turn, self.aspect)
            matches.append(self.match(np.array([*corner, turn])))
        return max(matches, key=lambda match: match.correlation)


def pearson(a: np.ndarray, b: np.ndarray) -> float:
    if a.size < 3:
        return 0.0
    a, b = a - a.mean(), b - b.mean()
    scale = math.sqrt(float(np.sum(a * a)) * float(np.sum(b * b)))
    return float(np.sum(a * b)) / scale if scale > 0 else 0.0
