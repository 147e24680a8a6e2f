"""Elastic constants of a pair of half-spaces, and the influence of one loaded element.

Sources: K. L. Johnson, *Contact Mechanics* (1985), §3.3 and §4.2; A. E. H. Love, Phil. Trans. A 228
(1929) 377.
"""

import copy
import math

import numpy as np

from .errors import InvalidContactInput

__all__ = ["LoveKernel", "contact_modulus", "love_kernel"]


def contact_modulus(young_1: float, poisson_1: float, young_2: float, poisson_2: float) -> float:
    """Contact modulus E* of two elastic half-spaces, 1/E* = (1 - ν₁²)/E₁ + (1 - ν₂²)/E₂.

    Parameters
    ----------
    young_1, young_2 : float
        Young's moduli (MPa), positive; ``math.inf`` for a rigid body (not both).
    poisson_1, poisson_2 : float
        Poisson's ratios, in (-1, 0.5].

    Returns
    -------
    float
        Contact modulus, in the unit of the Young's moduli (MPa).

    Raises
    ------
    InvalidContactInput
        A constant outside its physical range.

    References
    ----------
    Johnson, *Contact Mechanics* (1985), eq. 4.21. Some papers print (1 - ν) in place of (1 - ν²);
    that is not this function.
    """
    compliance = 0.0
    for body, young, poisson in ((1, young_1, poisson_1), (2, young_2, poisson_2)):
        if not young > 0:
            raise InvalidContactInput(f"young_{body} must be positive (MPa), got {young}")
        if not -1 < poisson <= 0.5:
            raise InvalidContactInput(f"poisson_{body} must lie in (-1, 0.5], got {poisson}")
        compliance += (1 - poisson**2) / young
    if compliance == 0:
        raise InvalidContactInput("both bodies are rigid: one Young's modulus must be finite")
    return 1 / compliance


def love_kernel(
    shape: tuple[int, int], spacing: tuple[float, float], contact_modulus: float
) -> np.ndarray:
    """Displacement at element centres from unit pressure on the element at the origin.

    The kernel is even in x and in y, so one quadrant holds all of it.

    Parameters
    ----------
    shape : (int, int)
        Number of offsets along y and x.
    spacing : (float, float)
        Sides (dy, dx) of the rectangular elements (mm).
    contact_modulus : float
        E* (MPa).

    Returns
    -------
    ndarray, shape `shape`
        Entry [i, j]: displacement (mm per MPa, positive into the half-space) at
        (y, x) = (i·dy, j·dx).

    References
    ----------
    Love (1929); Johnson (1985), eq. 3.25.
    """
    dy, dx = spacing
    # The integral of 1/r over an element is a difference of its antiderivative between the
    # corners. Corners are shared by neighbours: evaluate each once, then difference along x and y.
    y = (np.arange(shape[0] + 1) - 0.5)[:, None] * dy
    x = (np.arange(shape[1] + 1) - 0.5)[None, :] * dx

    def antiderivative(one, other):
        """One of its two terms: one·asinh(other/|one|)."""
        term = other / np.abs(one)
        np.arcsinh(term, out=term)
        term *= one
        return term

    corners = antiderivative(x, y)
    symmetric = dy == dx and shape[0] == shape[1]
    corners = corners + (corners.T if symmetric else antiderivative(y, x))
    integral = np.diff(np.diff(corners, axis=0), axis=1)
    integral /= math.pi * contact_modulus
    return integral


class LoveKernel:
    """Love's kernel, evaluated once for grids of several sizes and of longer elements.

    It is homogeneous, and exactly so in floating point for powers of two: on elements twice as long
    it is twice as large.

    Parameters
    ----------
    spacing : (float, float)
        Sides (dy, dx) of the elements (mm).
    contact_modulus : float
        E* (MPa).
    shape : (int, int)
        Offsets along y and x that are kept; beyond them it is evaluated anew each time.
    """

    def __init__(self, spacing, contact_modulus, shape):
        self.spacing = spacing
        self.contact_modulus = contact_modulus
        self._kept, self._factor = love_kernel(shape, spacing, contact_modulus), 1

    def coarser(self, factor):
        """The kernel of elements longer by `factor`, a power of two."""
        kernel = copy.copy(self)
        kernel.spacing = tuple(factor * side for side in self.spacing)
        kernel._factor = factor * self._factor
        return kernel

    def quadrant(self, shape):
        """Influence (mm/MPa) at offsets from zero on; a fresh array of that shape."""
        if any(n > m for n, m in zip(shape, self._kept.shape, strict=True)):
            return love_kernel(shape, self.spacing, self.contact_modulus)
        return self._factor * self._kept[: shape[0], : shape[1]]
