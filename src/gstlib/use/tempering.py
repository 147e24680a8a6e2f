"""Sequential Monte Carlo: particles that follow what was seen, which counts more and more.

All that is not known is a standard normal variable beforehand. The particles end as draws of a
mixture of what is likely given all places, and given all but each one, in equal parts. Each part
follows by weights that are bounded (after Silva & Zanella 2024, J. Am. Stat. Assoc. 119:2369). The
way there is that of Del Moral, Doucet & Jasra (2006, J. R. Stat. Soc. B 68:411), with moves of
differential evolution (ter Braak 2006, Stat. Comput. 16:239).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

__all__ = [
    "LIMITS",
    "Particles",
    "effective_sample_size",
    "mean_and_limits",
    "tempered",
]

# Quantiles that hold 95 % of what is likely.
LIMITS = 0.025, 0.975
# Share of the particles that still count after a step, and how many moves each has accepted then.
_KEPT, _ACCEPTED, _ACCEPTED_LAST, _MOST_MOVES = 0.5, 1.5, 4.0, 30
# Share of the moves that may jump from one mode to another, and what is added to all moves.
_JUMPS, _JITTER = 0.1, 0.02


class Particles(NamedTuple):
    """Equally likely draws of a mixture: one part has seen all places, each other all but one.

    Attributes
    ----------
    standard : (draws, variables) ndarray
        Standard normal beforehand.
    log_likelihood : (draws, places) ndarray
        Of what was seen on each place.
    offset : (places,) ndarray
        About the logarithm of the evidence of each part over the first: it makes them as large.
    """

    standard: np.ndarray
    log_likelihood: np.ndarray
    offset: np.ndarray

    @property
    def weights(self) -> np.ndarray:
        """Weight of each draw (draws,) after what was seen on all places."""
        return np.asarray(scipy.special.softmax(self._log_weight))

    @property
    def weights_without(self) -> np.ndarray:
        """The same (draws, places), after what was seen on all other places."""
        return np.asarray(scipy.special.softmax(self._log_without, axis=0))

    @property
    def log_score(self) -> np.ndarray:
        """Logarithm of the probability (places,) of what was seen on each, given all others."""
        log_total = scipy.special.logsumexp(self._log_weight)
        return np.asarray(
            log_total - scipy.special.logsumexp(self._log_without, axis=0)
        )

    @property
    def _log_weight(self) -> np.ndarray:
        return self.log_likelihood.sum(axis=1) - _target(
            self.log_likelihood, self.offset
        )

    @property
    def _log_without(self) -> np.ndarray:
        return np.asarray(self._log_weight[:, None] - self.log_likelihood)


def tempered(
    log_likelihood: Callable[[np.ndarray], np.ndarray],
    variables: int,
    draws: int,
    generator: np.random.Generator,
    counted: float = 1.0,
) -> Particles | None:
    """Draws of what is likely; None if nothing that is tried is possible.

    Parameters
    ----------
    log_likelihood : callable
        From standard normal variables (draws, variables) to (draws, places).
    variables, draws : int
    generator : numpy.random.Generator
    counted : float
        How much that was seen counts in the end, up to 1.

    Examples
    --------
    Of a mean with a standard error of 1, seen at 3 places:

    >>> seen, generator = np.array([0.9, 1.0, 1.4]), np.random.default_rng(1)
    >>> def log_likelihood(standard):
    ...     return scipy.stats.norm.logpdf(seen, 10 * standard, 1)
    >>> particles = tempered(log_likelihood, 1, 2000, generator)
    >>> round(10 * float(particles.weights @ particles.standard[:, 0]), 1)
    1.1
    """
    standard = generator.standard_normal((draws, variables))
    likelihood = log_likelihood(standard)
    if not np.isfinite(likelihood).all(axis=1).any():
        return None
    offset = np.zeros(likelihood.shape[1])
    reached = 0.0
    while reached < counted:
        target = _target(_in_part(likelihood, reached), offset)
        reached = _step(likelihood, target, offset, reached, counted)
        in_part = _in_part(likelihood, reached)
        offset = _offset(in_part, target)
        weight = scipy.special.softmax(_target(in_part, offset) - target)
        chosen = _resampled(weight, generator)
        density = _Density(log_likelihood, reached, offset)
        accepted = _ACCEPTED if reached < counted else _ACCEPTED_LAST
        standard, likelihood = density.moved(
            standard[chosen], likelihood[chosen], accepted, generator
        )
    return Particles(standard, likelihood, offset)


def effective_sample_size(weight: np.ndarray) -> np.ndarray:
    """How many draws of equal weight would be worth as much; `weight` is (draws, …)."""
    return np.asarray(1 / (weight**2).sum(axis=0))


def mean_and_limits(values: np.ndarray, weight: np.ndarray) -> list[float]:
    """Mean and limits of 95 % of values (draws,) with these weights."""
    limits = np.quantile(values, LIMITS, weights=weight, method="inverted_cdf")
    return [float(weight @ values), *map(float, limits)]


def _target(log_likelihood: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Logarithm (draws,) of the mixture over what is likely beforehand."""
    total = log_likelihood.sum(axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):
        without = total - log_likelihood - offset
    parts = np.concatenate([total, without], axis=1)
    parts[np.isnan(parts)] = -np.inf
    return np.asarray(scipy.special.logsumexp(parts, axis=1))


def _in_part(log_likelihood: np.ndarray, counted: float) -> np.ndarray:
    """What was seen, where it counts in part; before anything counts, nothing is impossible."""
    if counted == 0:
        return np.zeros_like(log_likelihood)
    return counted * log_likelihood


def _offset(log_likelihood: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Logarithms (places,) of what there is of each part, over that of the first."""
    possible = np.isfinite(log_likelihood).all(axis=1)
    log_likelihood = log_likelihood[possible]
    whole = log_likelihood.sum(axis=1) - target[possible]
    without = scipy.special.logsumexp(whole[:, None] - log_likelihood, axis=0)
    return np.asarray(without - scipy.special.logsumexp(whole))


def _step(
    likelihood: np.ndarray,
    target: np.ndarray,
    offset: np.ndarray,
    reached: float,
    most: float,
) -> float:
    """How much may count next, so that enough of the particles still do."""

    possible = np.isfinite(likelihood).all(axis=1).sum()

    def kept(counted: float) -> float:
        new_target = _target(_in_part(likelihood, counted), offset)
        weight = scipy.special.softmax(new_target - target)
        return float(effective_sample_size(weight)) / possible - _KEPT

    if kept(most) >= 0:
        return most
    least = reached + 1e-9 * (most - reached)
    return float(scipy.optimize.brentq(kept, least, most, rtol=1e-3))


def _resampled(weight: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """Which particles go on: each as often as its weight says, but for a fraction."""
    places = (np.arange(len(weight)) + generator.random()) / len(weight)
    return np.minimum(np.searchsorted(np.cumsum(weight), places), len(weight) - 1)


class _Density(NamedTuple):
    """What the particles follow: the mixture, of which what was seen counts in part."""

    log_likelihood: Callable[[np.ndarray], np.ndarray]
    counted: float
    offset: np.ndarray

    def moved(
        self,
        standard: np.ndarray,
        likelihood: np.ndarray,
        enough: float,
        generator: np.random.Generator,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Particles after moves that keep their distribution, so many of each accepted."""
        population = standard.copy()
        draws, variables = standard.shape
        density = self._log(standard, likelihood)
        accepted = 0.0
        for _ in range(_MOST_MOVES):
            one, other = generator.integers(0, draws, (2, draws))
            jumps = generator.random((draws, 1)) < _JUMPS
            scale = np.where(jumps, 1.0, 2.38 / (2 * variables) ** 0.5)
            proposed = standard + scale * (population[one] - population[other])
            proposed += _JITTER * generator.standard_normal(standard.shape)
            new = self.log_likelihood(proposed)
            new_density = self._log(proposed, new)
            is_accepted = np.log(generator.random(draws)) < new_density - density
            standard = np.where(is_accepted[:, None], proposed, standard)
            likelihood = np.where(is_accepted[:, None], new, likelihood)
            density = np.where(is_accepted, new_density, density)
            accepted += is_accepted.mean()
            if accepted >= enough:
                break
        return standard, likelihood

    def _log(self, standard: np.ndarray, likelihood: np.ndarray) -> np.ndarray:
        prior = -0.5 * np.square(standard).sum(axis=1)
        return np.asarray(
            prior + _target(_in_part(likelihood, self.counted), self.offset)
        )
