"""Draws of load cases: solved contacts of likely strikes, and particles between them.

Contacts are solved in rounds. The first round draws strikes from the prior. Each further round
draws strikes that are likely given the wear and the pressures between the contacts so far
(`gstlib.use.spread`). The load cases themselves need no further contacts (`gstlib.use.tempering`).
"""

# ASSUME: Prior of scatter and stroke. A load case has no scatter with a probability of a half, and
# no stroke with a probability of a half. Reason: Otherwise a tool that always struck one point
# would seem to scatter, and its inferred radius would be too small.

import logging
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from gstlib.use.evidence import Evidence, posterior
from gstlib.use.spread import StrikePressures, Uses
from gstlib.use.tempering import Particles

__all__ = ["Draws", "Prior", "Sampling", "sample"]

_log = logging.getLogger(__name__)

# Load cases that supply the strikes of a round.
_USES_OF_ROUND = 400
# Weight of the wear in the first rounds, which have few contacts.
_COUNTED = 0.2, 0.5, 1.0
# Relative error of predicted contacts at which no further rounds are needed.
_PREDICTED = 0.1


class Sampling(NamedTuple):
    """Settings of the sampler.

    Attributes
    ----------
    draws, rounds : int
        Contacts of a round, and the largest number of rounds.
    particles : int
        Load cases in the final sample.
    seed : int
    """

    draws: int
    rounds: int
    particles: int
    seed: int


class Prior(NamedTuple):
    """Prior of the load cases.

    Attributes
    ----------
    mean, error : (2 or 3,) ndarray
        Normal prior of the centre (y, x), mm, and of the logarithm of the radius.
    scatter_mm, stroke_mm : float
        Scales of the scatter and of the length of a stroke. Each is 0 with a probability of a half,
        and half-normal otherwise. All directions of a stroke are equally likely.
    """

    mean: np.ndarray
    error: np.ndarray
    scatter_mm: float
    stroke_mm: float

    @property
    def variables(self) -> int:
        """Number of standard normal variables of a load case."""
        return len(self.mean) + 4

    def uses(self, standard: np.ndarray) -> Uses:
        """Load cases from standard normal variables (uses, variables)."""
        size = len(self.mean)
        scatter, length, *direction = standard[:, size:].T
        stroke = (
            self.stroke_mm * np.maximum(length, 0.0) * direction / np.hypot(*direction)
        )
        points = self.mean + self.error * standard[:, :size]
        return Uses(points, self.scatter_mm * np.maximum(scatter, 0.0), stroke.T)

    def pressures(self, process: StrikePressures, standard: np.ndarray) -> np.ndarray:
        """Mean pressures (uses, patches), MPa, of load cases from `standard`, as in `uses`."""
        return process.mean_pressures(self.uses(standard))


class Draws(NamedTuple):
    """Posterior draws of the load case.

    Attributes
    ----------
    particles : Particles
        Their variables begin with the variables of the `prior`.
    prior : Prior
    process : StrikePressures
        Pressures between the solved contacts.
    touching : int
        Number of solved contacts that press a patch.
    contact_error : float
        R.m.s. error of the predictions of the last contacts, relative to their mean pressure.
    """

    particles: Particles
    prior: Prior
    process: StrikePressures
    touching: int
    contact_error: float

    @property
    def contacts(self) -> int:
        """Number of solved contacts."""
        return len(self.process.strikes)


def sample(
    prior: Prior,
    pressures: Callable[..., np.ndarray],
    evidence: Evidence,
    sampling: Sampling,
    generator: np.random.Generator,
    springs: np.ndarray,
) -> Draws | None:
    """Draw likely load cases from rounds of contacts, until these are predicted well.

    `pressures` computes pressures (strikes, patches), MPa, from single strikes and the yield of
    their elements (`springs`), mm/MPa. The yield is `springs` (1,) in the first round, and later
    the wear of the load case of the strike. The result is None if no strike of the first round
    presses a patch.
    """

    def likely(
        process: StrikePressures, draws: int, counted: float
    ) -> Particles | None:
        pressed_by = partial(prior.pressures, process)
        size = prior.variables
        return posterior(pressed_by, size, evidence, draws, generator, counted)

    possible = generator.standard_normal((sampling.draws, prior.variables))
    strikes = prior.uses(possible).strikes(generator)
    pressed, error = pressures(strikes, springs=springs), np.nan
    if not pressed.any():
        return None
    for number in range(1, sampling.rounds):
        process = StrikePressures.through(strikes, pressed)
        counted = _COUNTED[min(number, len(_COUNTED)) - 1]
        particles = likely(process, _USES_OF_ROUND, counted)
        if particles is None:
            return None
        chosen = generator.choice(_USES_OF_ROUND, sampling.draws)
        uses = prior.uses(particles.standard[chosen, : prior.variables])
        new = uses.strikes(generator)
        worn = evidence.springs(process.mean_pressures(uses))
        solved = pressures(new, springs=worn)
        error = _relative_error(process, new, solved)
        strikes = np.concatenate([strikes, new])
        pressed = np.concatenate([pressed, solved])
        _log.info(
            "%d contacts are solved, the last predicted to %.2g", len(strikes), error
        )
        if counted == 1 and error <= _PREDICTED:
            break
    process = StrikePressures.through(strikes, pressed)
    particles = likely(process, sampling.particles, 1.0)
    if particles is None:
        return None
    touching = int(pressed.any(axis=1).sum())
    return Draws(particles, prior, process, touching, error)


def _relative_error(
    process: StrikePressures, strikes: np.ndarray, pressure: np.ndarray
) -> float:
    error = process.mean_pressures(Uses(strikes)) - pressure
    mean = pressure.mean()
    return float(np.sqrt(np.square(error).mean()) / mean) if mean > 0 else np.inf
