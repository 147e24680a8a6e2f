"""Likelihood of the observed wear under given pressures: from losses, or from grades by eye.

Both kinds give the likelihood of the wear of each patch at pressures up to a common factor. The
prior of their other parameters (wear coefficient, scatter) is a standard normal variable, like all
priors in `gstlib.use.tempering`.
"""

# ASSUME: Scatter of losses. The loss of a patch is proportional to its pressure, with a scatter of
# Student's t with four degrees of freedom. One part of the scatter grows with the loss, and one is
# constant. Reason: With long tails, one wrong T1 does not change the result.
# ASSUME: Prior of the wear coefficient. The coefficient is lognormal, with a factor of 2 about its
# value for all patches together. Reason: A wear coefficient is positive, and unknown beforehand.
# ASSUME: Priors of the scatter of losses. The part that grows with the loss is lognormal about 35 %
# of the loss, with a factor of 2.2. The constant part is lognormal about 18 % of the mean loss,
# with a factor of 1.8. Reason: Both are positive, and unknown beforehand.
# ASSUME: Grades by eye. A grade is an interval of the logarithm of pressure, with a normal error,
# and a tenth of the grades are random. The limits divide the patches in proportion to the numbers
# of their grades. Reason: Grades give an order, but no depths.

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import scipy

from gstlib.conditions import ARCHARD, Law
from gstlib.errors import InputError
from gstlib.use.tempering import OfDraws, Particles, tempered

__all__ = [
    "FEWEST_PATCHES",
    "FEWEST_WORN",
    "Evidence",
    "Grades",
    "Losses",
    "likelihood",
    "posterior",
]

# Fewest patches, and fewest patches with a loss above the noise, for an inference.
FEWEST_PATCHES, FEWEST_WORN = 6, 4
_FREEDOM = 4.0
# Logarithm of the density of Student's t at 0 with these degrees of freedom.
_LOG_OF_T = math.log(3 / 8)
# Medians and standard deviations of logarithms. The wear coefficient is relative to its value for
# all patches together. The scatter is relative to the loss of the patch and to the mean loss. The
# constant scatter has a lower limit for this reason: most patches neither carry load nor wear,
# whatever the errors of the heights. Their perfect fit is no evidence for the patches at the edge
# of the contact.
_COEFFICIENT_ERROR = 0.7
_SCATTER, _SCATTER_ERROR = 0.35, 0.8
_FLOOR, _FLOOR_ERROR, _LEAST_FLOOR = 0.18, 0.6, 0.1
# Standard deviations of the logarithm of pressure, for grades.
_GRADE_ERROR, _GRADE_ERROR_ERROR = 0.5, 0.5
_AT_RANDOM = 0.1
# Largest invisible pressure, relative to the mean pressure.
_UNSEEN = 0.03


@dataclass(frozen=True)
class Losses:
    """Mean depth lost on each patch.

    Attributes
    ----------
    depth_um : (patches,) ndarray
        Lost volume per area of the patch, µm. All are known.
    above_noise : (patches,) ndarray of bool, or bool
        Whether each loss is above the noise.
    law : Law
        Law of wear.
    variables : int
        Number of additional parameters.
    """

    depth_um: np.ndarray
    above_noise: np.ndarray | bool = True
    law: Law = ARCHARD
    variables = 3

    def __post_init__(self) -> None:
        depth_um = np.asarray(self.depth_um, dtype=float)
        unknown = np.count_nonzero(~np.isfinite(depth_um))
        if depth_um.ndim != 1 or unknown:
            problem = f"of shape {depth_um.shape} has {unknown} NaN or infinite values"
            remedy = "Give one loss for each patch, and leave out patches without."
            raise InputError("depth_um", problem, remedy)
        object.__setattr__(self, "depth_um", depth_um)

    @property
    def tells(self) -> bool:
        """Whether enough patches have a loss above the noise; a loss of 0 does not count."""
        worn = (self.depth_um > 0) & self.above_noise
        return bool(worn.sum() >= FEWEST_WORN)

    def springs(self, pressure: np.ndarray) -> np.ndarray:
        """Wear coefficient times sliding (draws,), mm/MPa, at pressures (draws, patches), MPa.

        An element that yields by this amount per pressure has worn (`gstlib.bem.wear_path`).
        """
        borne = self.law.equivalent(pressure).sum(axis=1)
        lost = 1e-3 * max(self.depth_um.sum(), 0.0)
        return lost / np.where(borne > 0, borne, np.inf)

    def parameters(
        self, pressure: np.ndarray, standard: np.ndarray
    ) -> Mapping[str, np.ndarray]:
        """Additional parameters (draws,): ``wear_coefficient`` (with the sliding, µm/MPa),
        ``scatter`` / loss, ``floor``, µm.
        """
        total = self.law.equivalent(pressure).sum(axis=1)
        together = self.depth_um.sum() / np.where(total > 0, total, np.inf)
        errors = _COEFFICIENT_ERROR, _SCATTER_ERROR, _FLOOR_ERROR
        coefficient, scatter, floor = np.exp(errors * standard).T
        return {
            "wear_coefficient": together * coefficient,
            "scatter": _SCATTER * scatter,
            "floor": abs(self.depth_um).mean()
            * np.maximum(_FLOOR * floor, _LEAST_FLOOR),
        }

    def expected(
        self, pressure: np.ndarray, *parameters: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Expected losses (draws, patches), µm, and the widths of their scatter."""
        coefficient, scatter, floor = (each[:, np.newaxis] for each in parameters)
        expected = coefficient * self.law.equivalent(pressure)
        return expected, np.hypot(scatter * expected, floor)

    def log_likelihood(self, pressure: np.ndarray, standard: np.ndarray) -> np.ndarray:
        """Log likelihood of the loss of each patch (draws, patches)."""
        parameters = self.parameters(pressure, standard).values()
        expected, width = self.expected(pressure, *parameters)
        deviation = (self.depth_um - expected) / width
        tail = (_FREEDOM + 1) / 2 * np.log1p(deviation**2 / _FREEDOM)
        return _LOG_OF_T - np.log(width) - tail


@dataclass(frozen=True)
class Grades:
    """Grade of the wear of each patch, by eye.

    Attributes
    ----------
    grade : (patches,) ndarray of int
        Grades 0, 1, 2 …, which increase with wear.
    """

    grade: np.ndarray
    variables = 1

    def springs(self, pressure: np.ndarray) -> np.ndarray:
        """Zero, because grades do not contain depths."""
        return np.zeros(len(pressure))

    @property
    def tells(self) -> bool:
        """Whether there are at least two grades."""
        return bool(np.ptp(self.grade) > 0)

    def parameters(
        self, pressure: np.ndarray, standard: np.ndarray
    ) -> Mapping[str, np.ndarray]:
        """Additional parameter (draws,): ``scatter`` of the logarithm of pressure."""
        return {"scatter": _GRADE_ERROR * np.exp(_GRADE_ERROR_ERROR * standard[:, 0])}

    def log_likelihood(self, pressure: np.ndarray, standard: np.ndarray) -> np.ndarray:
        """Log likelihood of the grade of each patch (draws, patches)."""
        mean = pressure.mean(axis=1, keepdims=True)
        relative = pressure / np.where(mean > 0, mean, np.inf)
        seen = np.log(relative + _UNSEEN)
        _, which, counts = np.unique(
            self.grade, return_inverse=True, return_counts=True
        )
        below = np.cumsum(counts)[:-1]
        ordered = np.sort(seen, axis=1)
        between = (ordered[:, below - 1] + ordered[:, below]) / 2
        ends = (0, 0), (-np.inf, np.inf)
        limits = np.pad(between, ((0, 0), (1, 1)), constant_values=ends)
        error = self.parameters(pressure, standard)["scatter"][:, None]
        below_lower, below_upper = (
            scipy.special.ndtr((limits[:, which + side] - seen) / error)
            for side in (0, 1)
        )
        inside = below_upper - below_lower
        return np.log((1 - _AT_RANDOM) * inside + _AT_RANDOM / len(counts))


Evidence: TypeAlias = Losses | Grades


def likelihood(
    evidence: Evidence, pressure: np.ndarray, standard: np.ndarray
) -> np.ndarray:
    """Log likelihood of the evidence (draws, patches), -inf if no patch carries load."""
    rests = np.any(pressure > 0, axis=1)
    return np.where(
        rests[:, None], evidence.log_likelihood(pressure, standard), -np.inf
    )


def posterior(
    pressures: OfDraws,
    variables: int,
    evidence: Evidence,
    draws: int,
    generator: np.random.Generator,
    counted: float = 1.0,
) -> Particles | None:
    """Draws given the evidence; None if no draw is possible.

    `pressures` maps standard normal variables (draws, variables) to pressures (draws, patches), in
    any unit. The evidence has further variables. `counted` is the weight of the evidence.
    """

    def log_likelihood(standard: np.ndarray) -> np.ndarray:
        pressure = pressures(standard[:, :variables])
        return likelihood(evidence, pressure, standard[:, variables:])

    size = variables + evidence.variables
    return tempered(log_likelihood, size, draws, generator, counted)
