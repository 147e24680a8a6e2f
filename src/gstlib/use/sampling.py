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

__all__ = ["Draws", "Sampling", "StatedUse", "sample"]

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


class StatedUse(NamedTuple):
    """Prior values of a load case, with standard errors.

    Attributes
    ----------
    force_N : float
    load_point : (float, float)
        The load point (y, x) on the square, mm.
    load_point_mm : float
        Standard error of the load point along each axis.
    radius_mm : float or None
        Radius of the active tool whose face is pressed (geometric mean of two radii). None if it is
        known or flat.
    radius_log_sd : float
        Standard error of the logarithm of the radius.
    scatter_mm, stroke_mm : float
        Scales of the scatter of strikes along each axis, and of the length of strokes. Each is 0
        with a probability of a half, and half-normal otherwise. All directions of a stroke are
        equally likely.
    """

    force_N: float
    load_point: tuple[float, float]
    load_point_mm: float
    radius_mm: float | None = None
    radius_log_sd: float = 0.0
    scatter_mm: float = 0.0
    stroke_mm: float = 0.0

    @property
    def mean(self) -> np.ndarray:
        """Mean (2 or 3,) of centre (y, x), mm, and logarithm of the radius, if it is inferred."""
        radius = [] if self.radius_mm is None else [np.log(self.radius_mm)]
        return np.array([*self.load_point, *radius])

    @property
    def error(self) -> np.ndarray:
        """Standard deviations (2 or 3,) of the same."""
        errors = self.load_point_mm, self.load_point_mm, self.radius_log_sd
        return np.array(errors)[: len(self.mean)]

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
        Their variables begin with the variables of the prior.
    process : StrikePressures
        Pressures between the solved contacts.
    touching : int
        Number of solved contacts that press a patch.
    contact_error : float
        R.m.s. error of the predictions of the last contacts, relative to their mean pressure.
    """

    particles: Particles
    process: StrikePressures
    touching: int
    contact_error: float

    @property
    def contacts(self) -> int:
        """Number of solved contacts."""
        return len(self.process.strikes)


def sample(
    prior: StatedUse,
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
        off = process.mean_pressures(Uses(new)) - solved
        mean = solved.mean()
        error = float(np.sqrt(np.square(off).mean()) / mean) if mean > 0 else np.inf
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
    return Draws(particles, process, touching, error)
