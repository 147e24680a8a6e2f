"""Mean pressures over many strikes, whose load point scatters and moves along a stroke.

A tool strikes thousands of times, and its wear follows the mean pressure. Contacts are solved for
single strikes. Between them, the pressure of a patch is a Gaussian process, whose mean over a
normal scatter has a closed form (O'Hagan 1991, J. Stat. Plan. Inference 29:245). So a load case
with many strikes needs no further contacts.
"""

# ASSUME: Scatter of the strikes. Strikes scatter normally about their centre, alike along both
# axes, and further along a stroke, with the variance of a uniform distribution over its length. The
# face, the force and the radius are the same for all strikes. Reason: The mean pressure then has a
# closed form.

import itertools
from typing import NamedTuple

import numpy as np
import scipy

__all__ = ["StrikePressures", "Uses"]

# Length scales of the process over the load point (mm) and the logarithm of the radius, and the
# unexplained fraction of its variance.
_LENGTHS_MM = 0.5, 0.7, 1.0, 1.4, 2.0, 3.0
_RADIUS_LENGTHS = 0.5, 1.0, 2.0, 4.0
_NUGGETS = 1e-4, 1e-2
# Number of strikes for the choice of length scales; more strikes do not change the choice.
_MOST_FITTED = 200
# Pressures of a load case below this fraction of the pressures of the latest strikes that press a
# patch are errors of the process.
_LEAST = 0.1
# Variance of a uniform distribution along a stroke of unit length.
_OF_STROKE = 1 / 12


class Uses(NamedTuple):
    """Load cases, one in each row; by default without scatter.

    Attributes
    ----------
    points : (uses, 2 or 3) ndarray
        Centre (y, x) of the load points, mm, and the logarithm of the radius.
    scatter_mm : (uses,) ndarray
        Standard deviation of the strikes along each axis.
    stroke_mm : (uses, 2) ndarray
        Stroke from end to end, along y and x, mm.
    """

    points: np.ndarray
    scatter_mm: np.ndarray = np.zeros(1)
    stroke_mm: np.ndarray = np.zeros((1, 2))

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the load points of each load case (uses, 2, 2), mm²."""
        along = _OF_STROKE * self.stroke_mm[:, :, None] * self.stroke_mm[:, None, :]
        across = self.scatter_mm[:, None, None] ** 2 * np.eye(2)
        return along + across

    @property
    def spread_mm(self) -> np.ndarray:
        """R.m.s. distance of the strikes from their centre (uses,), along an axis, mm."""
        return np.sqrt(np.trace(self.covariance, axis1=1, axis2=2) / 2)

    def strikes(self, generator: np.random.Generator) -> np.ndarray:
        """One strike of each load case (uses, 2 or 3)."""
        points = self.points.copy()
        across, along = (
            generator.standard_normal((len(points), size)) for size in (2, 1)
        )
        points[:, :2] += self.scatter_mm[:, None] * across
        points[:, :2] += _OF_STROKE**0.5 * along * self.stroke_mm
        return points


class StrikePressures(NamedTuple):
    """Pressures of the patches between solved strikes.

    Attributes
    ----------
    strikes : (strikes, 2 or 3) ndarray
        Load points (y, x), mm, and logarithms of the radius, of the solved contacts.
    lengths : (3,) ndarray
        Length scales of the process.
    factors : (strikes, patches) ndarray
    least : float
        Sum of the pressures, MPa, below which pressures count as zero.
    """

    strikes: np.ndarray
    lengths: np.ndarray
    factors: np.ndarray
    least: float

    @classmethod
    def through(cls, strikes: np.ndarray, pressure: np.ndarray) -> "StrikePressures":
        """The process that best predicts each contact from the others.

        `pressure` (strikes, patches), MPa, is zero for a strike that tips the stone over.

        Examples
        --------
        If pressure grows with the square of x, a scatter adds its variance:

        >>> strikes = np.random.default_rng(1).uniform(-3, 3, (300, 2))
        >>> process = StrikePressures.through(strikes, 1 + strikes[:, 1:] ** 2)
        >>> use = Uses(np.array([[0.0, 1.0]]), np.array([0.5]), np.zeros((1, 2)))
        >>> round(process.mean_pressures(use).item(), 2)
        2.25
        """
        latest = slice(-_MOST_FITTED, None)
        lengths, nugget = _best_lengths(strikes[latest], pressure[latest])
        covariance = scipy.linalg.cho_factor(_covariance(strikes, lengths, nugget))
        factors = scipy.linalg.cho_solve(covariance, pressure)
        borne = pressure[latest].sum(axis=1)
        least = _LEAST * float(borne[borne > 0].mean()) if borne.any() else 0.0
        return cls(strikes, lengths, factors, least)

    def mean_pressures(self, uses: Uses) -> np.ndarray:
        """Mean pressures (uses, patches), MPa, over the strikes of each case; 0 far from all."""
        size = self.strikes.shape[1]
        lengths = self.lengths[:size]
        wide = np.tile(np.diag(lengths**2), (len(uses.points), 1, 1))
        wide[:, :2, :2] += uses.covariance
        inverse = np.linalg.inv(wide)
        middle = self.strikes.mean(axis=0)
        centre = uses.points - middle
        node = self.strikes - middle
        # The logarithm of the kernel is a quadratic form of the node, so it is one product.
        pulled = np.einsum("uij,uj->ui", inverse, centre)
        at_middle = np.log(np.prod(lengths)) - 0.5 * np.linalg.slogdet(wide).logabsdet
        at_middle -= 0.5 * np.sum(pulled * centre, axis=1)
        squares = np.einsum("ni,nj->nij", node, node).reshape(-1, size**2)
        of_use = np.column_stack(
            [-0.5 * inverse.reshape(-1, size**2), pulled, at_middle]
        )
        of_node = np.column_stack([squares, node, np.ones(len(node))])
        kernel = of_use @ of_node.T
        np.exp(kernel, out=kernel)
        pressure = np.maximum(kernel @ self.factors, 0.0)
        pressure[pressure.sum(axis=1) < self.least] = 0.0
        return pressure


def _covariance(nodes: np.ndarray, lengths: np.ndarray, nugget: float) -> np.ndarray:
    scaled = nodes / lengths[: nodes.shape[1]]
    squared = scipy.spatial.distance.cdist(scaled, scaled, "sqeuclidean")
    return np.exp(-0.5 * squared) + nugget * np.eye(len(nodes))


def _best_lengths(nodes: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, float]:
    """Lengths and nugget at which each value is best predicted from the others."""
    radii = _RADIUS_LENGTHS if nodes.shape[1] > 2 else (1.0,)

    def squared_error(lengths: np.ndarray, nugget: float) -> float:
        inverse = np.linalg.inv(_covariance(nodes, lengths, nugget))
        error = inverse @ values / inverse.diagonal()[:, None]
        return float(np.square(error).sum())

    tried = [
        (np.array([mm, mm, radius]), nugget)
        for mm, radius, nugget in itertools.product(_LENGTHS_MM, radii, _NUGGETS)
    ]
    return min(tried, key=lambda one: squared_error(*one))
