"""Draws of uses: importance samples in rounds, each about what the earlier ones found.

The first draws are from what the user states, with its standard errors; those of each further round
lie about what the earlier ones found, and all of them are weighed together, as draws from one
mixture (Owen & Zhou 2000, J. Am. Stat. Assoc. 95:135).
"""

import logging
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy

from gstlib.use.evidence import Evidence, Seen, weigh

__all__ = ["Draws", "Sampling", "effective_draws", "sample"]

_log = logging.getLogger(__name__)

# Effective draws that a proposal is fitted to; its tails are Student's. A draw counts from this
# share of the mean weight on.
_FITTED, _FREEDOM, _LEAST = 12, 5.0, 1e-3
# Fewer draws do not tell their covariance, and one draw has none: this share of the covariance
# beforehand is added to it.
_SHARE = 0.1


class Sampling(NamedTuple):
    """How uses are drawn.

    Attributes
    ----------
    draws, rounds : int
        Draws of a round, and the most rounds.
    seed : int
    enough : float
        Effective draws from which no further round is drawn.
    """

    draws: int
    rounds: int
    seed: int
    enough: float = 150.0


class Draws(NamedTuple):
    """Uses (draws, parameters), their probability beforehand, their pressures, what these show."""

    points: np.ndarray
    log_prior: np.ndarray
    pressure: np.ndarray
    seen: Seen

    @property
    def touching(self) -> int:
        """How many of the uses press a patch."""
        return int((self.pressure > 0).any(axis=1).sum())


def sample(
    prior: Any,
    pressures: Callable[[np.ndarray], np.ndarray],
    evidence: Evidence,
    sampling: Sampling,
    generator: np.random.Generator,
) -> Draws:
    """Uses in rounds, each about what the earlier ones found, until enough of them count.

    There is one round if none of its uses presses a patch.
    """
    proposals, points, fields, seen = [prior], [], [], []
    for _ in range(sampling.rounds):
        new = proposals[-1].rvs(sampling.draws, random_state=generator)
        points.append(np.reshape(new, (sampling.draws, -1)))
        fields.append(pressures(points[-1]))
        seen.append(weigh(evidence, fields[-1]))
        uses = np.concatenate(points)
        # draws of all rounds are those of one mixture
        density = [of.logpdf(uses) for of in proposals]
        mixture = scipy.special.logsumexp(density, axis=0) - np.log(len(proposals))
        drawn = Draws(uses, density[0] - mixture, np.concatenate(fields), Seen.joined(seen))
        if not drawn.touching:
            break
        effective = effective_draws(drawn.seen.weights(drawn.log_prior))
        _log.info("%d uses tried, of which %.1f count", len(uses), effective)
        if effective >= sampling.enough:
            break
        proposals.append(_proposal(drawn, prior.cov))
    return drawn


class _Kernels(NamedTuple):
    """A mixture of Student's t about the draws that count."""

    points: np.ndarray
    weight: np.ndarray
    shape: np.ndarray

    def rvs(self, draws: int, random_state: np.random.Generator) -> np.ndarray:
        """So many draws (draws, parameters)."""
        about = random_state.choice(len(self.points), draws, p=self.weight)
        apart = scipy.stats.multivariate_t(shape=self.shape, df=_FREEDOM)
        moved = apart.rvs(draws, random_state=random_state).reshape(draws, -1)
        return np.asarray(self.points[about] + moved)

    def logpdf(self, uses: np.ndarray) -> np.ndarray:
        """Logarithm of the density of uses (uses, parameters)."""
        apart = scipy.stats.multivariate_t(shape=self.shape, df=_FREEDOM)
        # SciPy drops the axis of a single point
        each = apart.logpdf(uses[:, None] - self.points).reshape(len(uses), -1)
        return np.asarray(scipy.special.logsumexp(each + np.log(self.weight), axis=1))


def _proposal(draws: Draws, prior: np.ndarray) -> _Kernels:
    """About the draws that count, with the wear counting just so much that enough of them do.

    `prior` is the covariance of the uses that are possible beforehand.
    """
    power, weight = 1.0, draws.seen.weights(draws.log_prior)
    while effective_draws(weight) < _FITTED and power > 1e-3:
        power *= 0.8
        weight = scipy.special.softmax(draws.log_prior + power * draws.seen.log_evidence)
    apart = draws.points - weight @ draws.points
    spread = (weight[:, None] * apart).T @ apart
    if effective_draws(weight) < _FITTED:
        spread += _SHARE * prior
    # the bandwidth of Scott, of as many draws as count
    bandwidth = effective_draws(weight) ** (-1 / (draws.points.shape[1] + 4))
    shape = bandwidth**2 * (_FREEDOM - 2) / _FREEDOM * spread
    counts = weight > _LEAST / len(weight)
    return _Kernels(draws.points[counts], weight[counts] / weight[counts].sum(), shape)


def effective_draws(weight: np.ndarray) -> float:
    """How many draws of equal weight would be worth as much."""
    return float(1 / (weight**2).sum())
