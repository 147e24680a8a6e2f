"""Registration: how is the second measurement of a patch shifted and turned against the first?

With a new mould and a new scan, T1 is shifted against T0 by up to a good part of the field, turned
slightly, tilted, noisy, and worn. Coarse step: the shift is the peak of the normalised
cross-correlation over the overlap (scikit-image, after Padfield 2012, IEEE Trans. Image Process.
21:2706) of band-passed heights. The longest waves dominate a self-affine surface and match
anywhere within a field, so they are removed first. Fine step: Gauss-Newton least squares of the
height difference in shift, rotation and plane, coarse to fine, with Tukey's biweight so that worn
points do not pull (inverse-compositional alignment: Baker and Matthews 2004, Int. J. Comput. Vis.
56:221). A level of the fine step that leaves the peak of the search is dropped.

A striated face has details across its striae and hardly any along them, so it fits its copy at
many places along the striae. The shift along a direction is known only if the slopes along this
direction correlate, too. The slopes that both surfaces share also give the standard errors of the
shift.

The fine step is the project's own: no library fits shift, rotation and tilt together and without
the worn points. SimpleITK, in a loop that removes the plane and masks outliers, comes close to its
error of 0.002 points at 16 times the CPU time; OpenCV and pystackreg err by more
(benchmarks/registration.py).

Within this module, a pose is (y, x, turn): shift in elements from the corner of the reference to
that of the moving surface, and rotation in radians.
"""

import math
from dataclasses import asdict, dataclass
from typing import NamedTuple, Self

import numpy as np
import scipy
import xarray as xr

from gstlib.errors import InputError
from gstlib.surfaces.fitting import least_squares, robust_sigma
from gstlib.surfaces.grid import spacing_of
from gstlib.surfaces.leveling import remove_plane

__all__ = [
    "LEAST_POINTS",
    "OTHER_HEIGHTS",
    "Registration",
    "apply_registration",
    "is_one_way",
    "is_other",
    "register",
]

# The search runs on grids on which reference and moving surface have at most so many elements a
# side: its peak is accurate to a fraction of a coarse element, which the refinement corrects.
_SEARCH_SIZES = 256, 1024
# Band of the heights for the search: noise below this many elements is smoothed away, waves longer
# than this share of the field are removed.
_NOISE_ELEMENTS = 1.5
_LONGEST_FRACTION = 1 / 24
# The smaller the overlap, the more chance matches: smaller overlaps than this are not searched. If
# the best match is one that chance may give, larger overlaps are searched alone.
_LEAST_OVERLAP, _LARGE_OVERLAP = 0.25, 0.6
# Rotations (degrees) that the refinement may start from.
_TURNS = 0.0, -0.5, 0.5, -1.0, 1.0, -1.5, 1.5, -2.0, 2.0
# ASSUME: a registration is above the noise if the band-passed heights correlate by 0.5, and by
# 0.35 over the square root of the overlap: unrelated surfaces reach 0.2 over that root by chance,
# seldom 0.3.
_LEAST_CORRELATION = 0.5
_BEYOND_CHANCE = 0.35
# ASSUME: a shift is known along a direction if the slopes along it, too, correlate beyond chance.
_LEAST_ALONG = 0.25
_SLOPE_SMOOTHING = 2.0
_AXES = (1, 0), (0, 1)  # orders of the derivatives along y and x
_EDGE = 6  # elements at the edges of a surface where slopes are not known
# Blocks along each side of the overlap, between which the standard errors of the shift are taken.
_BLOCKS = 8
# ASSUME: no wear makes the dales of a patch half or twice as deep.
OTHER_HEIGHTS = 2.0
# Smoothing (standard deviation, elements) and stride of the levels of the refinement.
_LEVELS = (6.0, 4), (3.0, 3), (1.0, 2)
# Gauss-Newton steps below this many elements change nothing measurable.
_SMALLEST_STEP = 0.005
_STEPS_PER_LEVEL = 12
# Reweighted fits of the plane of the residuals, for the standard errors of the shift.
_ERROR_STEPS = 3
# A level of the refinement is dropped if it lowers the correlation of the details by more than
# their interpolation does.
_LOWERED = 0.02
# Fewer points have no plane or pose that is worth fitting.
LEAST_POINTS = 100
# 95 % efficiency at the normal distribution (Holland and Welsch 1977).
_BIWEIGHT = 4.685
# Interpolation weights, and slopes beside the steepest ones, below this are rounding.
_ROUNDING = 1e-6
_TINY = float(np.finfo(float).tiny)


@dataclass(frozen=True)
class Registration:
    """Transformation of the moving surface onto the reference, and its quality.

    A point X (mm) of the moving surface is at c + R(rotation) (X - c) + shift on the reference,
    where c is the centre of the moving grid.
    """

    shift_x_mm: float  # to add to the coordinates of the moving surface
    shift_y_mm: float
    rotation_deg: float  # of the moving surface, x towards y
    overlap: float  # share of the reference's area that the moving surface covers
    correlation: float  # Pearson's, of heights over the overlap, a plane removed from each
    # of band-passed heights, free of the long waves that match by chance
    detail_correlation: float
    # of their slopes, in the direction in which these correlate least: striae match along one alone
    slope_correlation: float
    height_scale: float  # depth of the moving surface's dales over the reference's, band-passed
    residual_mm: float  # robust standard deviation of the levelled height difference
    shift_x_error_mm: float  # standard errors in the middle of the overlap
    shift_y_error_mm: float  # NaN if no slopes that both surfaces share determine the shift
    found: bool  # whether the details correlate well enough, in every direction, to believe it

    def as_attrs(self) -> dict[str, float]:
        """Attributes for a file: lengths in µm, `found` as 1 or 0."""
        attrs = asdict(self)
        attrs["registration_found"] = int(attrs.pop("found"))
        return {
            name.replace("_mm", "_um"): value * 1e3 if name.endswith("_mm") else value
            for name, value in attrs.items()
        }


def register(
    reference: xr.DataArray, moving: xr.DataArray, *, maximum_shift_mm: float
) -> Registration:
    """Register `moving` (T1) to `reference` (T0).

    Both are levelled heights (y, x) in mm, with the same spacing and without NaN; their shapes may
    differ: `moving` may be a larger map around the reference. It takes 90 to 250 bytes of memory a
    point of the larger one: 350 MB for 2048 × 2048 points. Shifts are found up to
    `maximum_shift_mm` along each axis, if at least a quarter of the field overlaps, and rotations
    up to a few degrees. The result is the best registration; its `found` says whether to believe
    it. Surfaces whose heights differ by a factor of two (`OTHER_HEIGHTS`) are registered to an
    element only: the refinement compares heights.

    Raises
    ------
    InputError
        The spacings differ.
    """
    spacing = np.asarray(spacing_of(reference))
    if not np.allclose(spacing, spacing_of(moving), rtol=1e-3):
        raise InputError(
            "T1",
            f"spacing (y, x) {spacing_of(moving)} mm differs from T0's {spacing_of(reference)} mm",
            "Resample one of the two surfaces to the other's spacing.",
        )
    h0, h1 = reference.values, moving.values
    factor = max(
        math.ceil(max(h.shape) / size) for h, size in zip((h0, h1), _SEARCH_SIZES, strict=True)
    )
    aspect = float(spacing[0] / spacing[1])
    details = _Details.of(h0, h1, aspect, factor)
    left = 1 - maximum_shift_mm / spacing / h0.shape
    match = details.search(max(_LEAST_OVERLAP, float(np.prod(np.maximum(left, 0)))))
    errors, height_scale = np.full(2, math.nan), details.height_scale(match.pose)
    if not (match.is_beyond_chance and is_other(height_scale)):
        match, errors = _refine(h0, h1, details, match, factor)
        height_scale = details.height_scale(match.pose)
    slope_correlation, _ = details.compare_slopes(match.pose)
    pose = match.pose * (factor, factor, 1.0)
    on_grid = reference.copy(data=_sample(_spline(h1), pose, h0.shape, aspect))
    inside = np.isfinite(on_grid.values)
    flat0, flat1 = (
        remove_plane(h.where(inside))[0].values[inside] for h in (reference, on_grid)
    )
    shift_y, shift_x = pose[:2] * spacing - _corner_offset(reference, moving)
    error_y, error_x = errors * spacing
    return Registration(
        shift_x_mm=float(shift_x),
        shift_y_mm=float(shift_y),
        rotation_deg=math.degrees(pose[2]),
        overlap=float(inside.mean()),
        correlation=_pearson(flat0, flat1),
        detail_correlation=match.correlation,
        slope_correlation=slope_correlation,
        height_scale=height_scale,
        residual_mm=robust_sigma(flat1 - flat0),
        shift_x_error_mm=float(error_x),
        shift_y_error_mm=float(error_y),
        found=match.is_beyond_chance and slope_correlation >= _LEAST_ALONG,
    )


def apply_registration(
    moving: xr.DataArray, marked: np.ndarray, registration: Registration, like: xr.DataArray
) -> tuple[xr.DataArray, np.ndarray]:
    """The moving surface, and its marked points, on the grid of the reference (`like`).

    Heights (mm) by cubic interpolation, NaN outside the overlap; a point is marked if any of its
    four neighbours in `marked` (filled points, for example) is.
    """
    shift = np.array([registration.shift_y_mm, registration.shift_x_mm])
    dy, dx = spacing_of(like)
    elements = (_corner_offset(like, moving) + shift) / (dy, dx)
    pose = np.array([*elements, math.radians(registration.rotation_deg)])
    heights = _sample(_spline(moving.values), pose, like.shape, dy / dx)
    # ASSUME: of the sixteen points that cubic interpolation weighs, the four around dominate.
    weight = _sample(marked.astype(float), pose, like.shape, dy / dx, order=1)
    return like.copy(data=heights), weight > _ROUNDING


def is_one_way(detail_correlation: float, slope_correlation: float) -> bool:
    """Whether details match, but leave the shift along one direction open, as striae do."""
    return detail_correlation >= _LEAST_CORRELATION and slope_correlation < _LEAST_ALONG


def is_other(height_scale: float, times: float = OTHER_HEIGHTS) -> bool:
    """Whether one of two surfaces is more than so many times as high as the other."""
    return max(height_scale, 1 / height_scale) > times


def _corner_offset(reference: xr.DataArray, moving: xr.DataArray) -> np.ndarray:
    """First coordinates (y, x) of the moving grid minus those of the reference, mm."""
    return np.array([float(moving[axis][0]) - float(reference[axis][0]) for axis in "yx"])


def _detail(heights: np.ndarray, longest: float) -> np.ndarray:
    """Heights without waves longer than so many elements, clipped so that no spike dominates."""
    detail = heights - scipy.ndimage.gaussian_filter(heights, longest)
    bound = 3 * robust_sigma(detail)
    return np.clip(detail, -bound, bound)


def _slopes(heights: np.ndarray) -> np.ndarray:
    """Slopes (y or x, rows, columns), shortened so that no spike dominates; NaN at the edges.

    Finite differences, clipped components and mirrored edges would all show slopes along striae
    that run between the axes.
    """
    slopes = np.stack(
        [scipy.ndimage.gaussian_filter(heights, _SLOPE_SMOOTHING, order=axis) for axis in _AXES]
    )
    steepness = np.hypot(*slopes)
    bound = 3 * np.median(steepness)
    slopes *= np.minimum(1.0, bound / np.maximum(steepness, _TINY))
    edge = np.ones(heights.shape, dtype=bool)
    edge[_EDGE:-_EDGE, _EDGE:-_EDGE] = False
    return np.where(edge, np.nan, slopes)


class _Match(NamedTuple):
    """How well the details of two surfaces match at one pose."""

    pose: np.ndarray
    correlation: float
    overlap: float  # share of the smaller surface

    @property
    def strength(self) -> float:
        return self.correlation * math.sqrt(self.overlap)

    @property
    def is_beyond_chance(self) -> bool:
        return self.correlation >= _LEAST_CORRELATION and self.strength >= _BEYOND_CHANCE


class _Details(NamedTuple):
    """Band-passed heights of the reference and the moving surface, which the search compares."""

    reference: np.ndarray
    moving: np.ndarray
    slopes: list[np.ndarray]  # of both, from `_slopes`
    aspect: float  # spacing along y over spacing along x
    longest: float  # longest wave that they contain, elements

    @classmethod
    def of(cls, h0: np.ndarray, h1: np.ndarray, aspect: float, factor: int) -> Self:
        longest = math.ceil(max(h0.shape) / factor) * _LONGEST_FRACTION
        smooth = (
            scipy.ndimage.gaussian_filter(h, max(_NOISE_ELEMENTS, factor / 2)) for h in (h0, h1)
        )
        thinned = [h[::factor, ::factor] for h in smooth]
        a, b = (_detail(h, longest) for h in thinned)
        return cls(a, b, [_slopes(h) for h in thinned], aspect, longest)

    def common(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The heights of both over their overlap."""
        moved = _sample(self.moving, pose, self.reference.shape, self.aspect, order=1)
        inside = np.isfinite(moved)
        return self.reference[inside], moved[inside]

    def match(self, pose: np.ndarray) -> _Match:
        one, other = self.common(pose)
        overlap = one.size / min(self.reference.size, self.moving.size)
        return _Match(pose, _pearson(one, other), overlap)

    def height_scale(self, pose: np.ndarray) -> float:
        """How much deeper dales are on what moves. Dales, since wear takes summits."""
        one, other = self.common(pose)
        if not one.size:
            return math.nan
        low = one <= np.median(one)
        first, second = (
            float(np.mean((heights[low] - np.median(heights)) ** 2)) for heights in (one, other)
        )
        return math.sqrt(second / first) if first > 0 else math.nan

    def search(self, least_overlap: float) -> _Match:
        """The best match: the peak of the masked correlation, and the best of a few rotations."""
        matches = []
        for overlap in sorted({least_overlap, max(least_overlap, _LARGE_OVERLAP)}):
            matches.append(self._turned(self._peak(self.reference, self.moving, overlap)))
            if self.determine(matches[-1]):
                return matches[-1]
        best = max(matches, key=lambda match: match.strength)
        if best.is_beyond_chance:  # striae that match: finer details show where along them
            _, direction = self.compare_slopes(best.pose)
            a, b = (np.nan_to_num(np.einsum("i,i...->...", direction, g)) for g in self.slopes)
            match = self._turned(self._peak(a, b, least_overlap))
            if self.determine(match):
                return match
        return best

    def determine(self, match: _Match) -> bool:
        """Whether the details match beyond chance, and in every direction."""
        return match.is_beyond_chance and self.compare_slopes(match.pose)[0] >= _LEAST_ALONG

    def compare_slopes(self, pose: np.ndarray) -> tuple[float, np.ndarray]:
        """The least correlation of slopes along any direction, and this direction (y, x)."""
        first, second = self.slopes
        moved = np.stack(
            [_sample(g, pose, first.shape[1:], self.aspect, order=1) for g in second]
        )
        inside = np.isfinite(first[0] + moved[0])
        one, other = first[:, inside], _turn_back(pose[2], self.aspect) @ moved[:, inside]
        if one.shape[1] < LEAST_POINTS:
            return 0.0, np.ones(2)
        one, other = (g - g.mean(axis=1, keepdims=True) for g in (one, other))
        products = [np.einsum("ik,jk->ij", g, g) for g in (one, other)]
        for product in products:
            flattest = np.linalg.eigh(product)[1][:, 0]
            if not flattest @ product @ flattest > _ROUNDING**2 * np.trace(product):
                return 0.0, flattest  # what is left along this direction is rounding
        own = sum(product / np.trace(product) for product in products) / 2
        shared = np.einsum("ik,jk->ij", one, other)
        shared /= math.sqrt(math.prod(np.trace(product) for product in products))
        correlations, directions = scipy.linalg.eigh((shared + shared.T) / 2, own)
        return float(correlations[0]), directions[:, 0]

    def _peak(self, a: np.ndarray, b: np.ndarray, least_overlap: float) -> np.ndarray:
        """The shift (y, x) at the peak of the correlation."""
        # here: only registration needs it, and its import is slow
        from skimage.registration import phase_cross_correlation

        shift, _, _ = phase_cross_correlation(
            a,
            b,
            reference_mask=np.ones(a.shape, dtype=bool),
            moving_mask=np.ones(b.shape, dtype=bool),
            overlap_ratio=least_overlap,
        )
        # scikit-image counts from centre to centre, the shift here is from corner to corner
        return np.asarray(shift, dtype=float) + np.subtract(a.shape, b.shape) / 2

    def _turned(self, shift: np.ndarray) -> _Match:
        """The best match at a shift of some rotations."""
        a, b = self.reference, self.moving
        # turned about the middle of the moving surface or, beyond the reference, the nearest edge
        middle = shift + np.subtract(b.shape, 1) / 2
        arm = np.clip(middle, 0, np.subtract(a.shape, 1)) - middle
        matches = []
        y, x = arm
        for turn in np.radians(_TURNS):
            sine, cosine = math.sin(turn), math.cos(turn)
            turned = cosine * y + sine * x / self.aspect, cosine * x - sine * y * self.aspect
            matches.append(self.match(np.array([*(shift + arm - turned), turn])))
        return max(matches, key=lambda match: match.correlation)


def _spline(heights: np.ndarray) -> np.ndarray:
    """Cubic spline coefficients: computed once for many samplings."""
    return scipy.ndimage.spline_filter(heights, order=3, mode="mirror")


def _sample(
    coefficients: np.ndarray,
    pose: np.ndarray,
    shape: tuple[int, ...],
    aspect: float,
    *,
    stride: int = 1,
    order: int = 3,
) -> np.ndarray:
    """The moving surface at every `stride`-th element of the reference; NaN outside.

    `aspect` is the spacing along y over that along x: surfaces turn in mm, not in elements.
    """
    y, x = np.ogrid[: shape[0] : stride, : shape[1] : stride]
    rows, columns = _on_moving(pose, y, x, coefficients.shape, aspect)
    values = scipy.ndimage.map_coordinates(
        coefficients, [rows, columns], order=order, mode="mirror", prefilter=False
    )
    # elements extend half a spacing beyond their centres
    bottom, right = coefficients.shape[0] - 0.5, coefficients.shape[1] - 0.5
    inside_y = (rows >= -0.5) & (rows <= bottom)
    inside_x = (columns >= -0.5) & (columns <= right)
    return np.where(inside_y & inside_x, values, np.nan)


def _on_moving(
    pose: np.ndarray, y: np.ndarray, x: np.ndarray, shape: tuple[int, ...], aspect: float
) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns on the moving surface, of that shape, of elements of the reference."""
    centre_y, centre_x = ((count - 1) / 2 for count in shape)
    dy, dx = y - pose[0] - centre_y, x - pose[1] - centre_x
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    rows = cosine * dy - sine / aspect * dx + centre_y
    return rows, sine * aspect * dy + cosine * dx + centre_x


def _turn_back(turn: float, aspect: float) -> np.ndarray:
    """Matrix that turns slopes (y, x) of the moving surface, per element, onto the reference."""
    cosine, sine = math.cos(turn), math.sin(turn)
    return np.array([[cosine, sine * aspect], [-sine / aspect, cosine]])


def _refine(
    h0: np.ndarray, h1: np.ndarray, details: _Details, start: _Match, factor: int
) -> tuple[_Match, np.ndarray]:
    """Gauss-Newton on shift, rotation and plane, from smooth to fine, about the search's peak.

    Long waves and worn points must not lead away from it: only levels count at which the details
    still match, within their longest wave. Returns also the standard errors (y, x) of the shift.
    """
    scale = np.array([factor, factor, 1.0])
    best, plane = start, None
    for smoothing, stride in _LEVELS:
        level = _Level.of(h0, h1, details.aspect, smoothing, stride)
        pose, level_plane = level.refined(best.pose * scale, plane)
        refined = details.match(pose / scale)
        is_near = _moved(start.pose, refined.pose, details) <= details.longest
        if is_near and refined.correlation >= best.correlation - _LOWERED:
            best, plane = refined, level_plane
    return best, level.errors(best.pose * scale)


def _moved(one: np.ndarray, other: np.ndarray, details: _Details) -> float:
    """How far (elements) the middle of the overlap at one pose is from that at another."""
    y, x = (
        np.array((max(0.0, at) + min(n0, at + n1) - 1) / 2)
        for at, n0, n1 in zip(
            one[:2], details.reference.shape, details.moving.shape, strict=True
        )
    )
    shape, aspect = details.moving.shape, details.aspect
    (row, column), (other_row, other_column) = (
        _on_moving(pose, y, x, shape, aspect) for pose in (one, other)
    )
    return float(np.hypot(other_row - row, other_column - column))


class _Level(NamedTuple):
    """Both surfaces, smoothed, on every `stride`-th element of the reference."""

    reference: np.ndarray
    moving: np.ndarray  # spline coefficients, on all of its elements
    slopes: np.ndarray  # (y or x, rows, columns), of the reference
    shape: tuple[int, ...]  # of the reference, with all elements
    aspect: float
    stride: int

    @classmethod
    def of(
        cls, h0: np.ndarray, h1: np.ndarray, aspect: float, smoothing: float, stride: int
    ) -> Self:
        smooth0, smooth1 = (scipy.ndimage.gaussian_filter(h, smoothing) for h in (h0, h1))
        slopes = np.stack([g[::stride, ::stride] for g in np.gradient(smooth0)])
        coarse = smooth0[::stride, ::stride]
        return cls(coarse, _spline(smooth1), slopes, h0.shape, aspect, stride)

    def refined(
        self, pose: np.ndarray, plane: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """A better pose, and the plane of the difference there, from those of the last level."""
        pose, half = pose.copy(), max(self.shape) / 2
        y, x = np.meshgrid(
            *(self.stride * np.arange(n) for n in self.reference.shape), indexing="ij"
        )
        for _ in range(_STEPS_PER_LEVEL):
            moved = _sample(self.moving, pose, self.shape, self.aspect, stride=self.stride)
            inside = np.isfinite(moved)
            if inside.sum() < LEAST_POINTS:
                break  # the next level takes more points of the same overlap
            residual = (moved - self.reference)[inside]
            dy = (y[inside] - pose[0] - (self.moving.shape[0] - 1) / 2) / half
            dx = (x[inside] - pose[1] - (self.moving.shape[1] - 1) / 2) / half
            gy, gx = self.slopes[:, inside]
            turn = gy * dx / self.aspect - gx * dy * self.aspect
            design = np.stack([np.ones_like(dy), dy, dx, gy, gx, turn])
            if plane is None:
                # the start of the robust fit: a plane by reweighted least squares
                plane = least_squares(design[:3], residual)
                for _ in range(_STEPS_PER_LEVEL):
                    plane = _robust_fit(design[:3], residual, plane)
            step = _robust_fit(design, residual, plane)
            plane = step[:3]
            pose += step[3:] / (1, 1, half)
            if np.abs(step[3:]).max() < _SMALLEST_STEP:
                break
        return pose, plane

    def errors(self, pose: np.ndarray) -> np.ndarray:
        """Standard errors (y, x) of the shift, elements; NaN if shared slopes do not determine it.

        The pull of the residuals on the shift scatters between blocks of the overlap, however far
        the errors of neighbouring points correlate within a block.
        """
        moved = _sample(self.moving, pose, self.shape, self.aspect, stride=self.stride)
        slopes = np.stack([np.gradient(self.reference), np.gradient(moved)]) / self.stride
        inside = np.isfinite(slopes).all(axis=(0, 1))
        if inside.sum() < LEAST_POINTS:
            return np.full(2, math.nan)
        first, second = slopes[:, :, inside]
        y, x = np.nonzero(inside)
        design = np.stack([np.ones(y.size), y / inside.shape[0], x / inside.shape[1]])
        residual = (moved - self.reference)[inside]
        plane = least_squares(design, residual)
        for _ in range(_ERROR_STEPS):
            plane = _robust_fit(design, residual, plane)
        left = residual - np.einsum("i,ij->j", plane, design)
        weight = _biweights(left - np.median(left))
        shared = np.einsum("ik,jk->ij", first * weight, second)
        shared = (shared + shared.T) / 2
        if not np.linalg.eigvalsh(shared)[0] > 0:
            return np.full(2, math.nan)
        block = _BLOCKS * (_BLOCKS * y // inside.shape[0]) + _BLOCKS * x // inside.shape[1]
        pulls = [np.bincount(block, weight * left * slope) for slope in (first + second) / 2]
        return np.sqrt(np.sum(np.linalg.solve(shared, pulls) ** 2, axis=1))


def _robust_fit(design: np.ndarray, values: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """Least squares with biweights of the residuals of the last plane, the first three rows."""
    left = values - np.einsum("i,ij->j", plane, design[:3])
    left -= np.median(left)
    return least_squares(design, values, _biweights(left))


def _biweights(left: np.ndarray) -> np.ndarray | float:
    """Tukey's weights of residuals."""
    bound = _BIWEIGHT * robust_sigma(left)
    return np.clip(1 - (left / bound) ** 2, 0, None) ** 2 if bound > 0 else 1.0


def _pearson(a: np.ndarray, b: np.ndarray) -> float:
    if a.size < 3:
        return 0.0
    a, b = a - a.mean(), b - b.mean()
    squares = float(np.sum(a * a)), float(np.sum(b * b))
    scale = math.sqrt(squares[0] * squares[1])
    return float(np.sum(a * b)) / scale if scale > 0 else 0.0
