"""Registration: how is the second measurement of a patch shifted and turned against the first?

With a new mould and a new scan, T1 is shifted against T0 by up to a good part of the field, turned
slightly, tilted, noisy, and worn. Coarse step: the shift is the peak of the normalised
cross-correlation over the overlap (scikit-image, after Padfield 2012, IEEE Trans. Image Process.
21:2706) of band-passed heights. The longest waves dominate a self-affine surface and match
anywhere within a field, so they are removed first. Fine step: Gauss-Newton least squares of the
height difference in shift, rotation and plane, coarse to fine, with Tukey's biweight so that worn
points do not pull (inverse-compositional alignment: Baker and Matthews 2004, Int. J. Comput. Vis.
56:221).

The fine step is the project's own: no library fits shift, rotation and tilt together and without
the worn points. SimpleITK, in a loop that removes the plane and masks outliers, comes close to its
error of 0.002 points at 16 times the CPU time; OpenCV and pystackreg err by more
(benchmarks/registration.py).

Within this module, a pose is (y, x, turn): shift in elements from the corner of the reference to
that of the moving surface, and rotation in radians.
"""

import math
from dataclasses import asdict, dataclass

import numpy as np
import scipy
import xarray as xr

from gstlib.errors import InputError
from gstlib.preprocess.outliers import MAD_TO_SIGMA
from gstlib.surfaces.grid import spacing_of
from gstlib.surfaces.leveling import remove_plane

__all__ = [
    "LEAST_POINTS",
    "Registration",
    "apply_registration",
    "least_squares",
    "register",
    "robust_sigma",
]

# The search runs on grids on which reference and moving surface have at most so many elements a
# side: its peak is accurate to a fraction of a coarse element, which the refinement corrects.
_SEARCH_SIZES = 256, 1024
# Band of the heights for the search: noise below this many elements is smoothed away, waves longer
# than this share of the field are removed.
_NOISE_ELEMENTS = 1.5
_LONGEST_FRACTION = 1 / 24
# The smaller the overlap, the more chance matches: smaller overlaps than this are not searched.
_LEAST_OVERLAP = 0.25
# Rotations (degrees) that the refinement may start from.
_TURNS = 0.0, -0.5, 0.5, -1.0, 1.0, -1.5, 1.5, -2.0, 2.0
# ASSUME: a registration is above the noise if the band-passed heights correlate by 0.5, and by
# 0.35 over the square root of the overlap: unrelated surfaces reach 0.2 over that root by chance,
# seldom 0.3.
_LEAST_CORRELATION = 0.5
_BEYOND_CHANCE = 0.35
# ASSUME: no wear makes the dales of a patch half or twice as deep.
_OTHER_HEIGHTS = 2.0
# Smoothing (standard deviation, elements) and stride of the levels of the refinement.
_LEVELS = (6.0, 4), (3.0, 3), (1.0, 2)
# Gauss-Newton steps below this many elements change nothing measurable.
_SMALLEST_STEP = 0.005
_STEPS_PER_LEVEL = 12
# Fewer points have no plane or pose that is worth fitting.
LEAST_POINTS = 100
# 95 % efficiency at the normal distribution (Holland and Welsch 1977).
_BIWEIGHT = 4.685
# Interpolation weights below this are rounding.
_ROUNDING = 1e-6


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
    detail_correlation: (
        float  # of band-passed heights, free of the long waves that match by chance
    )
    height_scale: float  # depth of the moving surface's dales over the reference's, band-passed
    residual_mm: float  # robust standard deviation of the levelled height difference
    found: bool  # whether the detail correlates well enough to believe the registration

    def as_attrs(self) -> dict[str, float]:
        """Attributes for a file: lengths in µm, `found` as 1 or 0."""
        attrs: dict[str, float] = {}
        for name, value in asdict(self).items():
            if name.endswith("_mm"):
                attrs[name.replace("_mm", "_um")] = value * 1e3
            elif name != "found":
                attrs[name] = value
        return attrs | {"registration_found": int(self.found)}


def register(
    reference: xr.DataArray, moving: xr.DataArray, *, maximum_shift_mm: float
) -> Registration:
    """Register `moving` (T1) to `reference` (T0).

    Both are levelled heights (y, x) in mm, with the same spacing and without NaN; their shapes may
    differ: `moving` may be a larger map around the reference. It takes 90 to 250 bytes of memory a
    point of the larger one: 350 MB for 2048 × 2048 points. Shifts are found up to
    `maximum_shift_mm` along each axis, if at least a quarter of the field overlaps, and rotations
    up to a few degrees. The result is the best registration; its `found` says whether to believe
    it.

    Raises
    ------
    InputError
        The spacings differ, or matching heights differ by a factor of two.
    """
    spacing = spacing_of(reference)
    if not np.allclose(spacing, spacing_of(moving), rtol=1e-3):
        raise InputError(
            "T1",
            f"spacing (y, x) {spacing_of(moving)} mm differs from T0's {spacing} mm",
            "Resample one of the two surfaces to the other's spacing.",
        )
    h0, h1 = reference.values, moving.values
    factor = max(
        math.ceil(max(h.shape) / size) for h, size in zip((h0, h1), _SEARCH_SIZES, strict=True)
    )
    longest = math.ceil(max(h0.shape) / factor) * _LONGEST_FRACTION
    detail0, detail1 = (_detail(h, factor, longest) for h in (h0, h1))
    scale = np.array([factor, factor, 1.0])
    left = 1 - maximum_shift_mm / np.asarray(spacing) / h0.shape
    least = max(_LEAST_OVERLAP, float(np.prod(np.maximum(left, 0))))
    start = _search(detail0, detail1, least)
    quality, height_scale = _compare_details(detail0, detail1, start)
    # the refinement assumes comparable heights, and would only lead away
    if quality >= _LEAST_CORRELATION and max(height_scale, 1 / height_scale) > _OTHER_HEIGHTS:
        raise InputError(
            "T1",
            f"its dales match those of T0, but are {height_scale:.3g} times as deep: no wear does "
            "that",
            "Give both scans in one unit and with one height calibration, or leave t1 empty.",
        )
    pose = _refine(h0, h1, start * scale)
    quality, height_scale = _compare_details(detail0, detail1, pose / scale)
    on_grid = reference.copy(data=_sample(_spline(h1), pose, h0.shape))
    inside = np.isfinite(on_grid.values)
    flat0, flat1 = (
        remove_plane(h.where(inside))[0].values[inside] for h in (reference, on_grid)
    )
    beyond_chance = quality * math.sqrt(inside.sum() / min(h0.size, h1.size)) >= _BEYOND_CHANCE
    shift_y, shift_x = pose[:2] * spacing - _corner_offset(reference, moving)
    return Registration(
        shift_x_mm=float(shift_x),
        shift_y_mm=float(shift_y),
        rotation_deg=math.degrees(pose[2]),
        overlap=float(inside.mean()),
        correlation=_pearson(flat0, flat1),
        detail_correlation=quality,
        height_scale=height_scale,
        residual_mm=robust_sigma(flat1 - flat0),
        found=bool(quality >= _LEAST_CORRELATION and beyond_chance),
    )


def apply_registration(
    moving: xr.DataArray, marked: np.ndarray, registration: Registration, like: xr.DataArray
) -> tuple[xr.DataArray, np.ndarray]:
    """The moving surface, and its marked points, on the grid of the reference (`like`).

    Heights (mm) by cubic interpolation, NaN outside the overlap; a point is marked if any of its
    four neighbours in `marked` (filled points, for example) is.
    """
    shift = np.array([registration.shift_y_mm, registration.shift_x_mm])
    elements = (_corner_offset(like, moving) + shift) / spacing_of(like)
    pose = np.array([*elements, math.radians(registration.rotation_deg)])
    heights = _sample(_spline(moving.values), pose, like.shape)
    # ASSUME: of the sixteen points that cubic interpolation weighs, the four around dominate.
    weight = _sample(marked.astype(float), pose, like.shape, order=1)
    return like.copy(data=heights), weight > _ROUNDING


def least_squares(
    design: np.ndarray, values: np.ndarray, weight: np.ndarray | float = 1.0
) -> np.ndarray:
    """Coefficients (m,) of the rows of `design` (m, n) that best give `values` (n,)."""
    weighted = design * weight
    # einsum, not a product of matrices: BLAS adds up in an order that changes from run to run
    normal = np.einsum("ik,jk->ij", weighted, design)
    right = np.einsum("ik,k->i", weighted, values)
    return np.linalg.lstsq(normal, right, rcond=None)[0]


def _corner_offset(reference: xr.DataArray, moving: xr.DataArray) -> np.ndarray:
    """First coordinates (y, x) of the moving grid minus those of the reference, mm."""
    offset = [float(moving[axis][0]) - float(reference[axis][0]) for axis in "yx"]
    return np.array(offset)


def _detail(heights: np.ndarray, factor: int, longest: float) -> np.ndarray:
    """Heights on every `factor`-th element without waves longer than `longest` of these elements.

    They are clipped so that no spike dominates.
    """
    fine = scipy.ndimage.gaussian_filter(heights, max(_NOISE_ELEMENTS, factor / 2))
    coarse = fine[::factor, ::factor]
    detail = coarse - scipy.ndimage.gaussian_filter(coarse, longest)
    bound = 3 * robust_sigma(detail)
    return np.clip(detail, -bound, bound)


def _search(a: np.ndarray, b: np.ndarray, least_overlap: float) -> np.ndarray:
    """Pose of `b` on `a`: the peak of their masked correlation, and the best of a few rotations."""
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
    shift = np.asarray(shift, dtype=float) + np.subtract(a.shape, b.shape) / 2
    # turned about the middle of what moves or, if it lies beyond the reference, the nearest edge
    middle = shift + np.subtract(b.shape, 1) / 2
    arm = np.clip(middle, 0, np.subtract(a.shape, 1)) - middle
    poses = []
    y, x = arm
    for turn in np.radians(_TURNS):
        sine, cosine = math.sin(turn), math.cos(turn)
        turned = np.array([cosine * y + sine * x, cosine * x - sine * y])
        poses.append(np.array([*(shift + arm - turned), turn]))
    quality = [_compare_details(a, b, pose)[0] for pose in poses]
    return poses[int(np.argmax(quality))]


def _spline(heights: np.ndarray) -> np.ndarray:
    """Cubic spline coefficients: computed once for many samplings."""
    return scipy.ndimage.spline_filter(heights, order=3, mode="mirror")


def _sample(
    coefficients: np.ndarray,
    pose: np.ndarray,
    shape: tuple[int, ...],
    *,
    stride: int = 1,
    order: int = 3,
) -> np.ndarray:
    """The moving surface at every `stride`-th element of the reference; NaN outside."""
    centre_y, centre_x = ((count - 1) / 2 for count in coefficients.shape)
    y, x = np.ogrid[: shape[0] : stride, : shape[1] : stride]
    dy, dx = y - pose[0] - centre_y, x - pose[1] - centre_x
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    rows = cosine * dy - sine * dx + centre_y
    columns = sine * dy + cosine * dx + centre_x
    values = scipy.ndimage.map_coordinates(
        coefficients, [rows, columns], order=order, mode="mirror", prefilter=False
    )
    # elements extend half a spacing beyond their centres
    bottom, right = coefficients.shape[0] - 0.5, coefficients.shape[1] - 0.5
    inside_y = (rows >= -0.5) & (rows <= bottom)
    inside_x = (columns >= -0.5) & (columns <= right)
    return np.where(inside_y & inside_x, values, np.nan)


def _refine(h0: np.ndarray, h1: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Gauss-Newton on shift, rotation and plane, from smooth to fine."""
    pose = pose.copy()
    half = max(h0.shape) / 2
    plane = None
    for smoothing, stride in _LEVELS:
        smooth0 = scipy.ndimage.gaussian_filter(h0, smoothing)
        smooth1 = _spline(scipy.ndimage.gaussian_filter(h1, smoothing))
        slope_y, slope_x = (g[::stride, ::stride] for g in np.gradient(smooth0))
        y, x = stride * np.indices(slope_y.shape)
        for _ in range(_STEPS_PER_LEVEL):
            moved = _sample(smooth1, pose, h0.shape, stride=stride)
            inside = np.isfinite(moved)
            if inside.sum() < LEAST_POINTS:
                break  # the next level takes more points of the same overlap
            residual = (moved - smooth0[::stride, ::stride])[inside]
            dy = (y[inside] - pose[0] - (h1.shape[0] - 1) / 2) / half
            dx = (x[inside] - pose[1] - (h1.shape[1] - 1) / 2) / half
            gy, gx = slope_y[inside], slope_x[inside]
            design = np.stack([np.ones_like(dy), dy, dx, gy, gx, gy * dx - gx * dy])
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
    return pose


def _robust_fit(design: np.ndarray, values: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """Least squares with biweights of the residuals of the last plane, the first three rows."""
    left = values - np.einsum("i,ij->j", plane, design[:3])
    left -= np.median(left)
    bound = _BIWEIGHT * robust_sigma(left)
    weight = np.clip(1 - (left / bound) ** 2, 0, None) ** 2 if bound > 0 else 1.0
    return least_squares(design, values, weight)


def _compare_details(a: np.ndarray, b: np.ndarray, pose: np.ndarray) -> tuple[float, float]:
    """Correlation of band-passed heights over their overlap, and how much deeper dales are in `b`.

    Dales, since wear takes summits.
    """
    moved = _sample(b, pose, a.shape, order=1)
    inside = np.isfinite(moved)
    one, other = a[inside], moved[inside]
    if not one.size:
        return 0.0, math.nan
    low = one <= np.median(one)
    first, second = _depth_of_dales(one, low), _depth_of_dales(other, low)
    scale = math.sqrt(second / first) if first > 0 else math.nan
    return _pearson(one, other), scale


def _depth_of_dales(heights: np.ndarray, low: np.ndarray) -> float:
    """Mean square depth of the `low` points below the median."""
    depth = heights[low] - np.median(heights)
    return float(np.mean(depth**2))


def _pearson(a: np.ndarray, b: np.ndarray) -> float:
    if a.size < 3:
        return 0.0
    a, b = a - a.mean(), b - b.mean()
    squares = float(np.sum(a * a)), float(np.sum(b * b))
    scale = math.sqrt(squares[0] * squares[1])
    return float(np.sum(a * b)) / scale if scale > 0 else 0.0


def robust_sigma(values: np.ndarray) -> float:
    """Standard deviation of values, by their median absolute deviation."""
    return MAD_TO_SIGMA * float(np.median(np.abs(values - np.median(values))))
