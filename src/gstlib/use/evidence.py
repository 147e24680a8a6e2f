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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import scipy

from gstlib.conditions import ARCHARD, Law

__all__ = [
    "FEWEST_PATCHES",
    "FEWEST_WORN",
    "Evidence",
    "Grades",
    "Losses",
    "likelihood",
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


class Evidence(Protocol):
    """Observed wear of each patch.

    Attributes
    ----------
    variables : int
        Number of additional parameters.
    """

    variables: int

    @property
    def tells(self) -> bool:
        """Whether the patches differ."""

    def log_likelihood(self, pressure: np.ndarray, standard: np.ndarray) -> np.ndarray:
        """Log likelihood of each patch (draws, patches), given its pressures and `variables`."""

    def parameters(
        self, pressure: np.ndarray, standard: np.ndarray
    ) -> Mapping[str, np.ndarray]:
        """Additional parameters (draws,) by name."""

    def springs(self, pressure: np.ndarray) -> np.ndarray:
        """Wear of an element per pressure (draws,), mm/MPa, at pressures (draws, patches), MPa."""

    def permuted(self, order: Sequence[int] | np.ndarray) -> "Evidence":
        """The same evidence for other patches, or for some of them."""


@dataclass(frozen=True)
class Losses:
    """Mean depth lost on each patch.

    Attributes
    ----------
    depth_um : (patches,) ndarray
        Lost volume per area of the patch, µm.
    above_noise : (patches,) ndarray of bool, optional
        Whether each loss is above the noise. By default, all losses except 0 are.
    law : Law
        Law of wear.
    """

    depth_um: np.ndarray
    above_noise: np.ndarray | None = None
    law: Law = ARCHARD
    variables = 3

    @property
    def tells(self) -> bool:
        """Whether enough patches have a loss above the noise."""
        worn = np.asarray(self.depth_um > 0)
        if self.above_noise is not None:
            worn = (
                worn & self.above_noise
            )  # so is the loss of a patch that lost nothing
        return bool(worn.sum() >= FEWEST_WORN)

    def springs(self, pressure: np.ndarray) -> np.ndarray:
        """Wear coefficient times sliding (draws,), mm/MPa, at pressures (draws, patches), MPa.

        An element that yields by this amount per pressure has worn (`gstlib.bem.wear_path`).
        """
        borne = self.law.equivalent(pressure).sum(axis=1)
        lost = 1e-3 * max(float(self.depth_um.sum()), 0.0)
        return np.where(borne > 0, lost / np.where(borne > 0, borne, 1.0), 0.0)

    def permuted(self, order: Sequence[int] | np.ndarray) -> "Losses":
        """The same losses for other patches, or the losses of some patches."""
        above_noise = self.above_noise
        if above_noise is not None:
            above_noise = above_noise[order]
        return replace(self, depth_um=self.depth_um[order], above_noise=above_noise)

    def parameters(
        self, pressure: np.ndarray, standard: np.ndarray
    ) -> Mapping[str, np.ndarray]:
        """``wear_coefficient`` (with the sliding, µm/MPa), ``scatter`` / loss, ``floor``, µm."""
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

    def log_likelihood(self, pressure: np.ndarray, standard: np.ndarray) -> np.ndarray:
        """Log likelihood of the loss of each patch (draws, patches)."""
        parameters = self.parameters(pressure, standard)
        coefficient, scatter, floor = (
            parameters[name][:, None]
            for name in ("wear_coefficient", "scatter", "floor")
        )
        expected = coefficient * self.law.equivalent(pressure)
        width = np.hypot(scatter * expected, floor)
        deviation = (self.depth_um - expected) / width
        log_density: np.ndarray = _LOG_OF_T - np.log(width)
        log_density -= (_FREEDOM + 1) / 2 * np.log1p(deviation**2 / _FREEDOM)
        return log_density


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
        return len(set(self.grade.tolist())) > 1

    def permuted(self, order: Sequence[int] | np.ndarray) -> "Grades":
        """The same grades for other patches, or the grades of some patches."""
        return Grades(self.grade[order])

    def parameters(
        self, pressure: np.ndarray, standard: np.ndarray
    ) -> Mapping[str, np.ndarray]:
        """``scatter`` of the logarithm of pressure."""
        return {"scatter": _GRADE_ERROR * np.exp(_GRADE_ERROR_ERROR * standard[:, 0])}

    def log_likelihood(self, pressure: np.ndarray, standard: np.ndarray) -> np.ndarray:
        """Log likelihood of the grade of each patch (draws, patches)."""
        mean = pressure.mean(axis=1, keepdims=True)
        relative = pressure / np.where(mean > 0, mean, np.inf)
        seen = np.log(relative + _UNSEEN)
        grades, which = np.unique(self.grade, return_inverse=True)
        counts = [np.sum(self.grade < grade) for grade in grades[1:]]
        ordered = np.sort(seen, axis=1)
        between = [(ordered[:, count - 1] + ordered[:, count]) / 2 for count in counts]
        endless = np.full(len(seen), np.inf)
        limits = np.stack([-endless, *between, endless], axis=1)
        error = self.parameters(pressure, standard)["scatter"][:, None]
        below_lower, below_upper = (
            scipy.special.ndtr((limits[:, which + side] - seen) / error)
            for side in (0, 1)
        )
        inside = below_upper - below_lower
        return np.asarray(np.log((1 - _AT_RANDOM) * inside + _AT_RANDOM / len(grades)))


def likelihood(
    evidence: Evidence, pressure: np.ndarray, standard: np.ndarray
) -> np.ndarray:
    """Log likelihood of the evidence (draws, patches), -inf if no patch carries load."""
    rests = np.any(pressure > 0, axis=1)
    return np.where(
        rests[:, None], evidence.log_likelihood(pressure, standard), -np.inf
    )
