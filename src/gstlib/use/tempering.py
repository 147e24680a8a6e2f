"""Sequential Monte Carlo: particles that follow the observations, whose weight is raised in steps.

The prior of each unknown is a standard normal variable. The particles end as draws of a mixture of
equal parts: the posterior given all places, and the posteriors given all places except one. Each
part follows by bounded weights (after Silva & Zanella 2024, J. Am. Stat. Assoc. 119:2369). The
steps are described by Del Moral, Doucet & Jasra (2006, J. R. Stat. Soc. B 68:411). The moves are
differential evolution (ter Braak 2006, Stat. Comput. 16:239).
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple, TypeAlias

import numpy as np
import scipy

__all__ = [
    "LIMITS",
    "OfDraws",
    "Particles",
    "effective_sample_size",
    "mean_and_limits",
    "tempered",
]

# Maps values of draws, such as their standard normal variables (draws, variables), to others.
OfDraws: TypeAlias = Callable[[np.ndarray], np.ndarray]
# Quantiles that enclose 95 % of the posterior.
LIMITS = 0.025, 0.975
# Effective fraction of the particles after a step, and accepted moves of each particle.
_KEPT, _ACCEPTED, _ACCEPTED_LAST, _MOST_MOVES = 0.5, 1.5, 4.0, 30
# Fraction of the moves that may jump between modes, and jitter of all moves.
_JUMPS, _JITTER = 0.1, 0.02


class Particles(NamedTuple):
    """Equally likely draws of a mixture: one part uses all places, each other all except one.

    Attributes
    ----------
    standard : (draws, variables) ndarray
        Standard normal variables under the prior.
    weights : (draws,) ndarray
        Weight of each draw given the observations at all places.
    weights_without : (draws, places) ndarray
        Weights given the observations at all other places.
    log_score : (places,) ndarray
        Log probability of the observation at each place, given all others.
    """

    standard: np.ndarray
    weights: np.ndarray
    weights_without: np.ndarray
    log_score: np.ndarray


def tempered(
    log_likelihood: OfDraws,
    variables: int,
    draws: int,
    generator: np.random.Generator,
    counted: float = 1.0,
) -> Particles | None:
    """Draws from the posterior; None if no draw is possible.

    Parameters
    ----------
    log_likelihood : callable
        Maps standard normal variables (draws, variables) to log likelihoods (draws, places).
    variables, draws : int
    generator : numpy.random.Generator
    counted : float
        Final weight of the observations, at most 1.

    Examples
    --------
    A mean with a standard error of 1, observed at 3 places:

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
    # Approximate logarithm of the ratio of the evidence of each part to the evidence of the first
    # part. It makes the parts equally large.
    offset = np.zeros(likelihood.shape[1])
    reached = 0.0
    while reached < counted:
        before = _target(likelihood, offset, reached)
        reached = _step(likelihood, before, offset, reached, counted)
        offset = _offset(reached * likelihood, before)
        target = partial(_target, offset=offset, counted=reached)
        weight = scipy.special.softmax(target(likelihood) - before)
        # each particle as often as its weight requires
        places = (np.arange(draws) + generator.random()) / draws
        chosen = np.searchsorted(np.cumsum(weight), places)
        chosen = np.minimum(chosen, draws - 1)
        enough = _ACCEPTED if reached < counted else _ACCEPTED_LAST
        particles = standard[chosen], likelihood[chosen]
        standard, likelihood = _moved(
            particles, log_likelihood, target, enough, generator
        )
    log_weight = likelihood.sum(axis=1) - _target(likelihood, offset)
    without = log_weight[:, None] - likelihood
    total = scipy.special.logsumexp(log_weight)
    return Particles(
        standard,
        weights=scipy.special.softmax(log_weight),
        weights_without=scipy.special.softmax(without, axis=0),
        log_score=total - scipy.special.logsumexp(without, axis=0),
    )


def effective_sample_size(weight: np.ndarray) -> np.ndarray:
    """Equivalent number of equally weighted draws; `weight` is (draws, …)."""
    return 1 / (weight**2).sum(axis=0)


def mean_and_limits(values: np.ndarray, weight: np.ndarray) -> list[float]:
    """Mean and 95 % limits of values (draws,) with these weights."""
    limits = np.quantile(values, LIMITS, weights=weight, method="inverted_cdf")
    return [float(weight @ values), *map(float, limits)]


def _target(
    log_likelihood: np.ndarray, offset: np.ndarray, counted: float = 1.0
) -> np.ndarray:
    """Logarithm (draws,) of the mixture relative to the prior.

    The observations have the weight `counted`. At zero weight, nothing is impossible.
    """
    part = counted * log_likelihood if counted else np.zeros_like(log_likelihood)
    total = part.sum(axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):
        without = total - part - offset
    parts = np.concatenate([total, without], axis=1)
    parts[np.isnan(parts)] = -np.inf
    return scipy.special.logsumexp(parts, axis=1)


def _offset(log_likelihood: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Logarithm (places,) of the size of each part relative to the first part."""
    possible = np.isfinite(log_likelihood).all(axis=1)
    log_likelihood = log_likelihood[possible]
    whole = log_likelihood.sum(axis=1) - target[possible]
    without = scipy.special.logsumexp(whole[:, None] - log_likelihood, axis=0)
    return without - scipy.special.logsumexp(whole)


def _step(
    likelihood: np.ndarray,
    target: np.ndarray,
    offset: np.ndarray,
    reached: float,
    most: float,
) -> float:
    """The next weight of the observations at which enough particles remain."""

    possible = np.isfinite(likelihood).all(axis=1).sum()

    def kept(counted: float) -> float:
        weight = scipy.special.softmax(_target(likelihood, offset, counted) - target)
        return float(effective_sample_size(weight)) / possible - _KEPT

    if kept(most) >= 0:
        return most
    least = reached + 1e-9 * (most - reached)
    return float(scipy.optimize.brentq(kept, least, most, rtol=1e-3))


def _moved(
    particles: tuple[np.ndarray, np.ndarray],
    log_likelihood: OfDraws,
    target: OfDraws,
    enough: float,
    generator: np.random.Generator,
) -> tuple[np.ndarray, np.ndarray]:
    """Particles after moves that keep their distribution, with `enough` accepted for each.

    Particles are variables and log likelihoods, of which `target` makes the density over the prior.
    """

    def log_density(standard: np.ndarray, likelihood: np.ndarray) -> np.ndarray:
        return -0.5 * np.square(standard).sum(axis=1) + target(likelihood)

    standard, likelihood = particles
    population = standard.copy()
    draws, variables = standard.shape
    density = log_density(standard, likelihood)
    accepted = 0.0
    for _ in range(_MOST_MOVES):
        one, other = generator.integers(0, draws, (2, draws))
        jumps = generator.random((draws, 1)) < _JUMPS
        scale = np.where(jumps, 1.0, 2.38 / (2 * variables) ** 0.5)
        proposed = standard + scale * (population[one] - population[other])
        proposed += _JITTER * generator.standard_normal(standard.shape)
        new = log_likelihood(proposed)
        new_density = log_density(proposed, new)
        is_accepted = np.log(generator.random(draws)) < new_density - density
        standard[is_accepted] = proposed[is_accepted]
        likelihood[is_accepted] = new[is_accepted]
        density[is_accepted] = new_density[is_accepted]
        accepted += is_accepted.mean()
        if accepted >= enough:
            break
    return standard, likelihood
