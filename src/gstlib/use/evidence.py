"""What wear says about the pressures that made it: losses, or grades by eye.

Both give the likelihood of what was seen on each patch, if its pressure is known but for a scale.
What is not asked for (the wear coefficient, the scatter) is a standard normal variable beforehand,
like all that is not known (`gstlib.use.tempering`).
"""

# ASSUME: a patch loses in proportion to its pressure, but for a scatter of Student's t with four
# degrees of freedom: one wrong T1 does not move the answer. The scatter has a part that grows with
# the loss and one that does not. Beforehand, the coefficients are lognormal: that of wear with a
# factor of 2 about that of all patches together, the parts of the scatter with a factor of 2.2
# and 1.8 about 35 % of the loss of the patch and 18 % of the mean loss.
# ASSUME: a grade says in which interval the logarithm of a patch's pressure lies, but for a normal
# error; a tenth of the grades are at random. As many patches lie between two limits as have the
# grade between them.

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

# Patches, and patches whose loss is above the noise, below which nothing is inferred.
FEWEST_PATCHES, FEWEST_WORN = 6, 4
_FREEDOM = 4.0
# logarithm of the density of Student's t at 0, with these degrees of freedom
_LOG_OF_T = math.log(3 / 8)
# Medians and standard errors of logarithms: of the wear coefficient over that of all patches
# together; of the scatter over the loss of the patch, and over the mean loss. Most patches neither
# bear load nor wear, whatever the heights err by: their perfect fit says nothing of the patches at
# the edge of the contact, so that the last has a least value.
_COEFFICIENT_ERROR = 0.7
_SCATTER, _SCATTER_ERROR = 0.35, 0.8
_FLOOR, _FLOOR_ERROR, _LEAST_FLOOR = 0.18, 0.6, 0.1
# Of the logarithm of pressure, for grades.
_GRADE_ERROR, _GRADE_ERROR_ERROR = 0.5, 0.5
_AT_RANDOM = 0.1
# Pressure that no eye tells from none, over the mean one.
_UNSEEN = 0.03


class Evidence(Protocol):
    """What was seen on each patch.

    Attributes
    ----------
    variables : int
        Of what is not asked for.
    """

    variables: int

    @property
    def tells(self) -> bool:
        """Whether patches differ."""

    def log_likelihood(self, pressure: np.ndarray, standard: np.ndarray) -> np.ndarray:
        """Of each patch (draws, patches) at its pressures and `variables` of each draw."""

    def parameters(
        self, pressure: np.ndarray, standard: np.ndarray
    ) -> Mapping[str, np.ndarray]:
        """What is not asked for, by name: (draws,)."""

    def springs(self, pressure: np.ndarray) -> np.ndarray:
        """How far an element wears (draws,), mm/MPa, under pressures (draws, patches), MPa."""

    def permuted(self, order: Sequence[int] | np.ndarray) -> "Evidence":
        """The same, seen on other patches, or on some of them."""


@dataclass(frozen=True)
class Losses:
    """Mean depth lost on each patch.

    Attributes
    ----------
    depth_um : (patches,) ndarray
        Volume lost over the area of the patch.
    above_noise : (patches,) ndarray of bool, optional
        Which losses are above the noise; by default, all but 0.
    law : Law
        How they grow with pressure.
    """

    depth_um: np.ndarray
    above_noise: np.ndarray | None = None
    law: Law = ARCHARD
    variables = 3

    @property
    def tells(self) -> bool:
        """Whether enough patches lost more than the noise."""
        worn = np.asarray(self.depth_um > 0)
        if self.above_noise is not None:
            worn = (
                worn & self.above_noise
            )  # so is the loss of a patch that lost nothing
        return bool(worn.sum() >= FEWEST_WORN)

    def springs(self, pressure: np.ndarray) -> np.ndarray:
        """Wear coefficient with the sliding (draws,), mm/MPa, under pressures (draws, patches).

        An element that gives way by it under pressure has worn (`gstlib.bem.wear_path`).
        """
        borne = self.law.equivalent(pressure).sum(axis=1)
        lost = 1e-3 * max(float(self.depth_um.sum()), 0.0)
        return np.where(borne > 0, lost / np.where(borne > 0, borne, 1.0), 0.0)

    def permuted(self, order: Sequence[int] | np.ndarray) -> "Losses":
        """The same losses on other patches, or those of some patches."""
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
        """Of the loss of each patch (draws, patches)."""
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
        0, 1, 2 …, the more the more worn.
    """

    grade: np.ndarray
    variables = 1

    def springs(self, pressure: np.ndarray) -> np.ndarray:
        """0: how deep the wear is, grades do not say."""
        return np.zeros(len(pressure))

    @property
    def tells(self) -> bool:
        """Whether there are two grades."""
        return len(set(self.grade.tolist())) > 1

    def permuted(self, order: Sequence[int] | np.ndarray) -> "Grades":
        """The same grades on other patches, or those of some patches."""
        return Grades(self.grade[order])

    def parameters(
        self, pressure: np.ndarray, standard: np.ndarray
    ) -> Mapping[str, np.ndarray]:
        """``scatter`` of the logarithm of pressure."""
        return {"scatter": _GRADE_ERROR * np.exp(_GRADE_ERROR_ERROR * standard[:, 0])}

    def log_likelihood(self, pressure: np.ndarray, standard: np.ndarray) -> np.ndarray:
        """Of the grade of each patch (draws, patches)."""
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
    """That of the evidence (draws, patches), -inf where nothing bears load."""
    rests = np.any(pressure > 0, axis=1)
    return np.where(
        rests[:, None], evidence.log_likelihood(pressure, standard), -np.inf
    )
