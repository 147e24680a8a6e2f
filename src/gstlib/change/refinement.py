"""The fine step of a registration: shift, rotation and plane together, and errors of the shift.

It is Gauss-Newton least squares of the height difference in shift, rotation and plane, coarse to
fine. Tukey's biweight reduces the influence of worn points (inverse-compositional alignment: Baker
and Matthews 2004, Int. J. Comput. Vis. 56:221). A level that leaves the peak of the search is
dropped. The slopes that both surfaces share give the standard errors of the shift.

The fine step is the project's own, because no library fits shift, rotation and tilt together and
without the worn points. SimpleITK, in a loop that removes the plane and masks outliers, comes close
to its error of 0.002 points at 16 times the CPU time. The errors of OpenCV and pystackreg are
larger (benchmarks/registration.py).
"""

import math

import numpy as np
import scipy

from gstlib.change.poses import on_moving, sample, spline
from gstlib.change.search import LEAST_POINTS, Details, Match
from gstlib.surfaces.fitting import least_squares, planes_over, robust_sigma

__all__ = ["refine"]

# Blocks along each side of the overlap, for the standard errors of the shift.
_BLOCKS = 8
# Smoothing (standard deviation, elements) and stride of the levels of the refinement.
_LEVELS = (6.0, 4), (3.0, 3), (1.0, 2)
# Smaller Gauss-Newton steps, in elements, do not change anything measurable.
_SMALLEST_STEP = 0.005
_STEPS_PER_LEVEL = 12
# Reweighted fits of the plane of the residuals, for the standard errors of the shift.
_ERROR_STEPS = 3
# A level of the refinement is dropped if it lowers the correlation of the details more than their
# interpolation does.
_LOWERED = 0.02
# 95 % efficiency at the normal distribution (Holland and Welsch 1977).
_BIWEIGHT = 4.685


def refine(
    h0: np.ndarray, h1: np.ndarray, details: Details, start: Match, factor: int
) -> tuple[Match, np.ndarray]:
    """Gauss-Newton on shift, rotation and plane, from smooth to fine, about the search's peak.

    Long waves and worn points must not lead away from this peak. So only levels count at which the
    details still match, within their longest wave. Also returns the standard errors (y, x) of the
    shift.
    """
    scale = np.array([factor, factor, 1.0])
    best, plane = start, None
    for smoothing, stride in _LEVELS:
        level = _Level(h0, h1, details.aspect, smoothing, stride)
        pose, level_plane = level.refined(best.pose * scale, plane)
        refined = details.match(pose / scale)
        moved = _moved(start.pose, refined.pose, details)
        is_as_good = refined.correlation >= best.correlation - _LOWERED
        if moved <= details.longest and is_as_good:
            best, plane = refined, level_plane
    return best, level.errors(best.pose * scale)


def _moved(one: np.ndarray, other: np.ndarray, details: Details) -> float:
    """Distance (elements) between the middles of the overlap at two poses."""
    shape, aspect = details.moving.shape, details.aspect
    first = np.maximum(0.0, one[:2])
    end = np.minimum(details.reference.shape, one[:2] + shape)
    y, x = (first + end - 1) / 2
    first, second = (on_moving(pose, y, x, shape, aspect) for pose in (one, other))
    return math.dist(first, second)


class _Level:
    """Both surfaces, smoothed, on every `stride`-th element of the reference.

    `moving` has the spline coefficients on all elements, and `slopes` (y or x, rows, columns) are
    those of the reference.
    """

    def __init__(
        self,
        h0: np.ndarray,
        h1: np.ndarray,
        aspect: float,
        smoothing: float,
        stride: int,
    ):
        self.shape, self.aspect, self.stride = h0.shape, aspect, stride
        smooth = scipy.ndimage.gaussian_filter(h0, smoothing)
        self.reference = smooth[::stride, ::stride]
        self.slopes = np.stack(np.gradient(smooth))[:, ::stride, ::stride]
        self.moving = spline(scipy.ndimage.gaussian_filter(h1, smoothing))

    def refined(
        self, pose: np.ndarray, plane: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """A better pose, and the plane of the difference there, from the last level."""
        pose, half = pose.copy(), max(self.shape) / 2
        places = self.stride * np.indices(self.reference.shape)
        middle = (np.array(self.moving.shape) - 1) / 2
        for _ in range(_STEPS_PER_LEVEL):
            moved = self._moved(pose)
            inside = np.isfinite(moved)
            if inside.sum() < LEAST_POINTS:
                break  # the next level takes more points of the same overlap
            residual = (moved - self.reference)[inside]
            centre = pose[:2] + middle
            dy, dx = (places[:, inside] - centre[:, None]) / half
            slope_y, slope_x = self.slopes[:, inside]
            turn = slope_y * dx / self.aspect - slope_x * dy * self.aspect
            design = np.stack([*planes_over(dy, dx), slope_y, slope_x, turn])
            if plane is None:
                # The robust fit starts from a plane by reweighted least squares.
                plane = _robust_plane(design[:3], residual, _STEPS_PER_LEVEL)
            weight = _biweights(_left(design, residual, plane))
            step = least_squares(design, residual, weight)
            plane = step[:3]
            pose += step[3:] / (1, 1, half)
            if np.abs(step[3:]).max() < _SMALLEST_STEP:
                break
        return pose, plane

    def _moved(self, pose: np.ndarray) -> np.ndarray:
        """The moving surface on the elements of this level; NaN outside."""
        return sample(self.moving, pose, self.shape, self.aspect, stride=self.stride)

    def errors(self, pose: np.ndarray) -> np.ndarray:
        """Standard errors (y, x) of the shift, elements; NaN if shared slopes do not determine it.

        They come from the scatter between blocks of the overlap of the residuals' effect on the
        shift. Errors of neighbouring points may correlate within a block.
        """
        moved = self._moved(pose)
        gradients = np.stack([np.gradient(self.reference), np.gradient(moved)])
        inside = np.isfinite(gradients).all(axis=(0, 1))
        if inside.sum() < LEAST_POINTS:
            return np.full(2, math.nan)
        first, second = gradients[:, :, inside] / self.stride
        y, x = np.nonzero(inside)
        ny, nx = inside.shape
        design = planes_over(y / ny, x / nx)
        residual = (moved - self.reference)[inside]
        left = _left(design, residual, _robust_plane(design, residual, _ERROR_STEPS))
        weight = _biweights(left)
        shared = np.einsum("ik,jk->ij", first * weight, second)
        shared = (shared + shared.T) / 2
        if not np.linalg.eigvalsh(shared)[0] > 0:
            return np.full(2, math.nan)
        block = _BLOCKS * (_BLOCKS * y // ny) + _BLOCKS * x // nx
        pull = weight * left / 2
        pulls = [np.bincount(block, pull * slope) for slope in first + second]
        shifts = np.linalg.solve(shared, pulls)
        return np.sqrt(np.sum(shifts**2, axis=1))


def _robust_plane(design: np.ndarray, values: np.ndarray, steps: int) -> np.ndarray:
    """The plane of reweighted least squares."""
    plane = least_squares(design, values)
    for _ in range(steps):
        weight = _biweights(_left(design, values, plane))
        plane = least_squares(design, values, weight)
    return plane


def _left(design: np.ndarray, values: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """Residuals (n,) of a plane, which is in the first three rows of the design."""
    return values - np.einsum("i,ij->j", plane, design[:3])


def _biweights(left: np.ndarray) -> np.ndarray | float:
    """Tukey's weights of residuals."""
    left = left - np.median(left)
    bound = _BIWEIGHT * robust_sigma(left)
    if not bound > 0:
        return 1.0
    return np.clip(1 - (left / bound) ** 2, 0, None) ** 2
