"""What wear says about the pressures that made it: losses, or grades by eye.

Both give the likelihood of what was seen on each patch, if its pressure is known but for a scale.
What is not asked for (the wear coefficient, the scatter) is summed over a grid of nodes.
"""

# ASSUME: a patch loses in proportion to its pressure, but for a scatter of Student's t with four
# degrees of freedom: one wrong T1 does not move the answer. The scatter has a part that grows with
# the loss and one that does not. Beforehand, all coefficients are equally likely on a logarithmic
# scale.
# ASSUME: a grade says in which interval the logarithm of a patch's pressure lies, but for a normal
# error; a tenth of the grades are at random. As many patches lie between two limits as have the
# grade between them.

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
import scipy

__all__ = [
    "FEWEST_PATCHES",
    "FEWEST_WORN",
    "Evidence",
    "Grades",
    "Losses",
    "Seen",
    "log_evidence",
    "weigh",
]

# Patches, and patches whose loss is above the noise, below which nothing is inferred.
FEWEST_PATCHES, FEWEST_WORN = 6, 4
_FREEDOM = 4.0
_LOG_OF_T = float(scipy.stats.t.logpdf(0, _FREEDOM))
# Wear coefficient about that of all patches together; scatter over the loss of the patch, and over
# the mean loss. Most patches neither bear load nor wear, whatever the heights err by: their perfect
# fit says nothing of the patches at the edge of the contact, so that the second is a tenth or more.
_SCALES = np.exp(np.linspace(-1.2, 1.2, 13))
_SCATTERS = np.array([0.2, 0.35, 0.6, 1.0])
_FLOORS = np.array([0.1, 0.2, 0.4])
# All combinations, one node each.
_SCALE, _SCATTER, _FLOOR = (
    of.ravel() for of in np.meshgrid(_SCALES, _SCATTERS, _FLOORS, indexing="ij")
)
# Of the logarithm of pressure, for grades.
_GRADE_ERRORS = np.array([0.25, 0.5, 1.0])
_AT_RANDOM = 0.1
# Pressure that no eye tells from none, over the mean one.
_UNSEEN = 0.03
_GOLDEN = (1 + 5**0.5) / 2
# Values of a likelihood that are held in memory at a time.
_AT_A_TIME = 2_000_000


class Evidence(Protocol):
    """What was seen on each patch."""

    @property
    def tells(self) -> bool:
        """Whether patches differ."""

    def log_likelihood(self, pressure: np.ndarray) -> np.ndarray:
        """Of each patch at pressures (draws, patches): (draws, nodes, patches)."""

    def nodes(self, pressure: np.ndarray) -> Mapping[str, np.ndarray]:
        """What is known at each node, by name: (draws, nodes)."""

    def permuted(self, order: Sequence[int] | np.ndarray) -> "Evidence":
        """The same, seen on other patches."""


@dataclass(frozen=True)
class Losses:
    """Mean depth lost on each patch.

    Attributes
    ----------
    depth_um : (patches,) ndarray
        Volume lost over the area of the patch.
    above_noise : (patches,) ndarray of bool, optional
        Which losses are above the noise; by default, all but 0.
    """

    depth_um: np.ndarray
    above_noise: np.ndarray | None = None

    @property
    def tells(self) -> bool:
        """Whether enough patches lost more than the noise."""
        worn = self.depth_um > 0
        if self.above_noise is not None:
            worn = worn & self.above_noise  # so is the loss of a patch that lost nothing
        return bool(worn.sum() >= FEWEST_WORN)

    def permuted(self, order: Sequence[int] | np.ndarray) -> "Losses":
        """The same losses on other patches, or those of some patches."""
        known = self.above_noise
        return Losses(self.depth_um[order], None if known is None else known[order])

    def nodes(self, pressure: np.ndarray) -> Mapping[str, np.ndarray]:
        """``wear_coefficient`` (with the sliding, µm/MPa), ``scatter`` / loss, ``floor``, µm."""
        total = pressure.sum(axis=1, keepdims=True)
        shape = len(pressure), len(_SCALE)
        return {
            "wear_coefficient": self.depth_um.sum()
            / np.where(total > 0, total, np.inf)
            * _SCALE,
            "scatter": np.broadcast_to(_SCATTER, shape),
            "floor": np.broadcast_to(_FLOOR * abs(self.depth_um).mean(), shape),
        }

    def log_likelihood(self, pressure: np.ndarray) -> np.ndarray:
        """Of the loss of each patch (draws, nodes, patches)."""
        at = {name: of[..., None] for name, of in self.nodes(pressure).items()}
        expected = at["wear_coefficient"] * pressure[:, None, :]
        width = np.hypot(at["scatter"] * expected, at["floor"])
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

    @property
    def tells(self) -> bool:
        """Whether there are two grades."""
        return len(set(self.grade.tolist())) > 1

    def permuted(self, order: Sequence[int] | np.ndarray) -> "Grades":
        """The same grades on other patches."""
        return Grades(self.grade[order])

    def nodes(self, pressure: np.ndarray) -> Mapping[str, np.ndarray]:
        """``scatter`` of the logarithm of pressure."""
        return {"scatter": np.broadcast_to(_GRADE_ERRORS, (len(pressure), len(_GRADE_ERRORS)))}

    def log_likelihood(self, pressure: np.ndarray) -> np.ndarray:
        """Of the grade of each patch (draws, nodes, patches)."""
        mean = pressure.mean(axis=1, keepdims=True)
        seen = np.log(pressure / np.where(mean > 0, mean, np.inf) + _UNSEEN)
        grades, which = np.unique(self.grade, return_inverse=True)
        below = [np.sum(self.grade < grade) for grade in grades[1:]]
        ordered, endless = np.sort(seen, axis=1), np.full(len(seen), np.inf)
        between = [(ordered[:, count - 1] + ordered[:, count]) / 2 for count in below]
        limits = np.stack([-endless, *between, endless], axis=1)
        to_lower, to_upper = (limits[:, which + side] - seen for side in (0, 1))
        errors = _GRADE_ERRORS[:, None]
        inside = scipy.special.ndtr(to_upper[:, None, :] / errors)
        inside -= scipy.special.ndtr(to_lower[:, None, :] / errors)
        return np.asarray(np.log((1 - _AT_RANDOM) * inside + _AT_RANDOM / len(grades)))


class Seen(NamedTuple):
    """How well pressures go with what was seen, summed over the nodes.

    Attributes
    ----------
    log_evidence : (draws,) ndarray
        Logarithm of the probability (of losses: its density) of what was seen on all patches.
    log_without : (draws, patches) ndarray
        Of what was seen on all patches but one.
    drawn : mapping of str to (draws,) ndarray
        What is known at a node, of one node for each draw; a node is the likelier drawn, the better
        it goes with what was seen.
    without : mapping of str to (draws, patches) ndarray
        What is known at the nodes, as the mean after what was seen on all patches but one.
    """

    log_evidence: np.ndarray
    log_without: np.ndarray
    drawn: Mapping[str, np.ndarray]
    without: Mapping[str, np.ndarray]

    @classmethod
    def joined(cls, parts: Sequence["Seen"]) -> "Seen":
        """That of several sets of draws, one after the other."""

        def together(maps: Sequence[Mapping[str, np.ndarray]]) -> dict[str, np.ndarray]:
            return {name: np.concatenate([each[name] for each in maps]) for name in maps[0]}

        return cls(
            np.concatenate([part.log_evidence for part in parts]),
            np.concatenate([part.log_without for part in parts]),
            together([part.drawn for part in parts]),
            together([part.without for part in parts]),
        )

    def weights(self, log_prior: np.ndarray) -> np.ndarray:
        """Weight of each draw after what was seen; `log_prior` is that from before."""
        return np.asarray(scipy.special.softmax(log_prior + self.log_evidence))

    def weights_without(self, log_prior: np.ndarray) -> np.ndarray:
        """The same (draws, patches), after what was seen on all other patches."""
        return np.asarray(scipy.special.softmax(log_prior[:, None] + self.log_without, axis=0))

    def log_score(self, log_prior: np.ndarray) -> np.ndarray:
        """Logarithm of the probability (patches,) of what was seen on each, given all others.

        Notes
        -----
        Gelfand, Dey & Chang (1992), Bayesian Statistics 4:147.
        """
        known = scipy.special.logsumexp(log_prior + self.log_evidence)
        others = scipy.special.logsumexp(log_prior[:, None] + self.log_without, axis=0)
        return np.asarray(known - others)


def log_evidence(evidence: Evidence, pressure: np.ndarray) -> np.ndarray:
    """That of `weigh` alone (draws,)."""
    parts = _parts(evidence, pressure)
    total = np.concatenate([evidence.log_likelihood(part).sum(axis=2) for part in parts])
    return np.asarray(scipy.special.logsumexp(total, axis=1) - np.log(total.shape[1]))


def weigh(evidence: Evidence, pressure: np.ndarray) -> Seen:
    """How well pressures (draws, patches), MPa, go with what was seen."""
    return Seen.joined([_weigh(evidence, part) for part in _parts(evidence, pressure)])


def _parts(evidence: Evidence, pressure: np.ndarray) -> list[np.ndarray]:
    """Draws whose likelihoods fit in memory together."""
    nodes = next(iter(evidence.nodes(pressure[:1]).values())).shape[1]
    each = max(1, _AT_A_TIME // (nodes * max(1, pressure.shape[1])))
    return [pressure[at : at + each] for at in range(0, len(pressure), each)]


def _weigh(evidence: Evidence, pressure: np.ndarray) -> Seen:
    likelihood, nodes = evidence.log_likelihood(pressure), evidence.nodes(pressure)
    total = likelihood.sum(axis=2)
    without = total[..., None] - likelihood
    # nodes evenly spread over their probability, so that few draws show all of it
    place = (0.5 + np.arange(len(total)) / _GOLDEN) % 1
    below = np.cumsum(scipy.special.softmax(total, axis=1), axis=1) < place[:, None]
    one = np.minimum(below.sum(axis=1), total.shape[1] - 1)
    others = scipy.special.softmax(without, axis=1)
    # nothing rests on nothing
    rests = np.where(pressure.sum(axis=1) > 0, 0, -np.inf) - np.log(total.shape[1])
    return Seen(
        scipy.special.logsumexp(total, axis=1) + rests,
        scipy.special.logsumexp(without, axis=1) + rests[:, None],
        {name: np.take_along_axis(of, one[:, None], 1)[:, 0] for name, of in nodes.items()},
        {name: np.einsum("dnp,dn->dp", others, of) for name, of in nodes.items()},
    )
