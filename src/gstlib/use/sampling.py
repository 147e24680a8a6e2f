"""Draws of uses: contacts where likely uses strike, and particles between them.

Contacts are solved in rounds. The first are strikes of uses that are possible beforehand; those of
each further round are strikes of uses that the wear says are likely, by the pressures between the
contacts so far (`gstlib.use.spread`). The uses themselves take no contact
(`gstlib.use.tempering`).
"""

# ASSUME: beforehand, half of the uses have no scatter, and half have no stroke. Without such a
# share, a tool that always struck one point would seem to scatter, and its radius too small.

import logging
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from gstlib.use.evidence import Evidence, likelihood
from gstlib.use.spread import StrikePressures, Uses
from gstlib.use.tempering import Particles, tempered

__all__ = ["Draws", "Prior", "Sampling", "sample"]

_log = logging.getLogger(__name__)

# Uses from which the strikes of a round are taken.
_USES_OF_ROUND = 400
# How much the wear counts in the first rounds, while few contacts are known.
_COUNTED = 0.2, 0.5, 1.0
# Contacts that were predicted as well as this, over their mean pressure, need no further ones.
_PREDICTED = 0.1


class Sampling(NamedTuple):
    """How uses are drawn.

    Attributes
    ----------
    draws, rounds : int
        Contacts of a round, and the most rounds.
    particles : int
        Uses in the end.
    seed : int
    """

    draws: int
    rounds: int
    particles: int
    seed: int


class Prior(NamedTuple):
    """Uses that are possible beforehand.

    Attributes
    ----------
    mean, error : (2 or 3,) ndarray
        Of the centre (y, x), mm, and the logarithm of the radius: normal.
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
        """How many standard normal variables make a use."""
        return len(self.mean) + 4

    def uses(self, standard: np.ndarray) -> Uses:
        """The uses of standard normal variables (uses, variables)."""
        size = len(self.mean)
        scatter, length, *direction = standard[:, size:].T
        stroke = (
            self.stroke_mm * np.maximum(length, 0.0) * direction / np.hypot(*direction)
        )
        points = self.mean + self.error * standard[:, :size]
        return Uses(points, self.scatter_mm * np.maximum(scatter, 0.0), stroke.T)


class Draws(NamedTuple):
    """Uses, and what the wear says of them.

    Attributes
    ----------
    particles : Particles
    pressures_of : callable
        From standard normal variables (draws, variables) to pressures (draws, patches), MPa.
    variables : int
    uses : Uses
    pressure, pressure_at_centre : (draws, patches) ndarray
        Mean over the strikes, and of a strike through their centre, MPa.
    parameters : mapping of str to (draws,) ndarray
        What the evidence does not ask for.
    contacts, touching : int
        Contacts that were solved, and those that press a patch.
    contact_error : float
        R.m.s. error with which the last contacts were predicted, over their mean pressure.
    """

    particles: Particles
    pressures_of: Callable[[np.ndarray], np.ndarray]
    variables: int
    uses: Uses
    pressure: np.ndarray
    pressure_at_centre: np.ndarray
    parameters: Mapping[str, np.ndarray]
    contacts: int
    touching: int
    contact_error: float


def sample(
    prior: Prior,
    pressures: Callable[[np.ndarray, np.ndarray], np.ndarray],
    evidence: Evidence,
    sampling: Sampling,
    generator: np.random.Generator,
    springs: np.ndarray,
) -> Draws | None:
    """Uses that are likely, from contacts in rounds, until these are predicted well.

    `pressures` gives those (strikes, patches), MPa, of single strikes, whose elements give way by
    so much each, mm/MPa: by `springs` (1,) in the first round, and then by the wear of the use
    that the strike is of. There are no draws if no strike of the first round presses a patch.
    """

    def particles(
        process: StrikePressures, draws: int, counted: float
    ) -> Particles | None:
        def log_likelihood(standard: np.ndarray) -> np.ndarray:
            pressure = process.mean_pressures(
                prior.uses(standard[:, : prior.variables])
            )
            return likelihood(evidence, pressure, standard[:, prior.variables :])

        size = prior.variables + evidence.variables
        return tempered(log_likelihood, size, draws, generator, counted)

    possible = generator.standard_normal((sampling.draws, prior.variables))
    strikes = prior.uses(possible).strikes(generator)
    pressed, error = pressures(strikes, springs), np.nan
    if not pressed.any():
        return None
    for number in range(1, sampling.rounds):
        process = StrikePressures.through(strikes, pressed)
        counted = _COUNTED[min(number, len(_COUNTED)) - 1]
        likely = particles(process, _USES_OF_ROUND, counted)
        if likely is None:
            return None
        chosen = generator.choice(_USES_OF_ROUND, sampling.draws)
        uses = prior.uses(likely.standard[chosen, : prior.variables])
        new = uses.strikes(generator)
        solved = pressures(new, evidence.springs(process.mean_pressures(uses)))
        error = _relative_error(process, new, solved)
        strikes, pressed = (
            np.concatenate([strikes, new]),
            np.concatenate([pressed, solved]),
        )
        _log.info(
            "%d contacts, the last of them predicted to %.2g", len(strikes), error
        )
        if counted == 1 and error <= _PREDICTED:
            break
    process = StrikePressures.through(strikes, pressed)
    final = particles(process, sampling.particles, 1.0)
    if final is None:
        return None
    uses = prior.uses(final.standard[:, : prior.variables])
    pressure = process.mean_pressures(uses)
    return Draws(
        final,
        lambda standard: process.mean_pressures(prior.uses(standard)),
        prior.variables,
        uses,
        pressure,
        process.mean_pressures(uses.still),
        evidence.parameters(pressure, final.standard[:, prior.variables :]),
        len(strikes),
        int(pressed.any(axis=1).sum()),
        error,
    )


def _relative_error(
    process: StrikePressures, strikes: np.ndarray, pressure: np.ndarray
) -> float:
    still = Uses(strikes, np.zeros(len(strikes)), np.zeros((len(strikes), 2)))
    error, mean = process.mean_pressures(still) - pressure, pressure.mean()
    return float(np.sqrt(np.square(error).mean()) / mean) if mean > 0 else np.inf
