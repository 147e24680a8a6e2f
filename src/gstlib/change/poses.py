"""One surface sampled on the grid of another, at a pose.

A pose is (y, x, turn): the shift in elements, and the rotation in radians. The shift is measured
from the corner of the reference to the corner of the moving surface.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy

__all__ = ["on_moving", "sample", "spline", "turned"]


def spline(heights: np.ndarray) -> np.ndarray:
    """Cubic spline coefficients, computed once for many samplings."""
    return scipy.ndimage.spline_filter(heights, order=3, mode="mirror")


def sample(
    coefficients: np.ndarray,
    pose: Sequence[float] | np.ndarray,
    shape: tuple[int, ...],
    aspect: float,
    *,
    stride: int = 1,
    order: int = 3,
) -> np.ndarray:
    """The moving surface at every `stride`-th element of the reference; NaN outside.

    `aspect` is the spacing along y over the spacing along x: surfaces turn in mm, not in elements.
    """
    y, x = np.ogrid[: shape[0] : stride, : shape[1] : stride]
    rows, columns = on_moving(pose, y, x, coefficients.shape, aspect)
    values = scipy.ndimage.map_coordinates(
        coefficients, [rows, columns], order=order, mode="mirror", prefilter=False
    )
    # Elements extend half a spacing beyond their centres.
    height, width = coefficients.shape
    inside_y = (rows >= -0.5) & (rows <= height - 0.5)
    inside_x = (columns >= -0.5) & (columns <= width - 0.5)
    return np.where(inside_y & inside_x, values, np.nan)


def on_moving(
    pose: Sequence[float] | np.ndarray,
    y: np.ndarray,
    x: np.ndarray,
    shape: tuple[int, ...],
    aspect: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of elements of the reference on the moving surface, which has this shape."""
    shift_y, shift_x, turn = pose
    centre_y, centre_x = ((count - 1) / 2 for count in shape)
    dy, dx = y - shift_y - centre_y, x - shift_x - centre_x
    rows, columns = turned(dy, dx, -turn, aspect)
    return rows + centre_y, columns + centre_x


def turned(y: Any, x: Any, turn: float, aspect: float) -> tuple[Any, Any]:
    """Offsets (elements) of a point (y, x) on axes that are rotated from x towards y.

    Slopes (y, x), per element, turn with the inverse of the aspect.
    """
    cosine, sine = math.cos(turn), math.sin(turn)
    return cosine * y + sine / aspect * x, cosine * x - sine * aspect * y
