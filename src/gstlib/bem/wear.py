"""Wear by Archard's law: the surface loses height in proportion to pressure and sliding.

The rate of loss is k p v, with the wear coefficient k and the sliding speed v (J. F. Archard,
J. Appl. Phys. 24 (1953) 981). In a step of the sliding s, and with κ = k s (mm/MPa), the surface
after the step is h − κ p. p is the pressure under which *this* surface is in contact (backward
Euler): Kp − w = −κ p where p > 0. A step is therefore one contact with the operator K + κI, a
half-space behind a bed of springs. A step of any length is stable, and its error is of first order
in κ. The lost volume is exactly κ times the force.

A compliant third body may be between the stones for a share of the sliding. It wears the surface
too, with its own pressure. The rate is v (k_s p_s + k_m p_m), with one coefficient for the bare
stone and one for the third body. The two take turns in each step.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .doubts import warn_of_doubts
from .errors import (
    ContactInputError,
    checked_array,
    checked_fraction,
    checked_number,
    checked_steps,
    checked_tolerance,
)
from .fields import as_given, rows_first
from .layer import Layer
from .load import LoadControl
from .solver import ContactProblem
from .state import ContactState

__all__ = ["ThirdBody", "WearPath", "wear_path"]


@dataclass(frozen=True, eq=False)
class ThirdBody:
    """A body between the stones for a share of the wear.

    Attributes
    ----------
    layer : Layer
    share : float
        k_m/(k_s + k_m), from 0 to 1.
    mean_pressure : float or array_like, shape (steps,)
        Mean pressure on it (MPa), like the pressure of the bare stone.
    lowered : array_like, shape (ny, nx), or float
        Additional depth of the surface for it, relative to the bare stone (mm), because loads
        beyond the grid displace a layer less.
    """

    layer: Layer
    share: float
    mean_pressure: float | np.ndarray
    lowered: np.ndarray | float = 0.0


@dataclass(frozen=True, eq=False, repr=False)
class WearPath:
    """A surface as it wears.

    Attributes
    ----------
    depth : ndarray or DataArray, shape (ny, nx)
        Height lost in the end (mm), ≥ 0.
    mean_loss : ndarray, shape (steps,)
        Mean depth over the grid after each step (mm).
    highest_pressure : float
        Highest pressure of all elements, bodies and steps (MPa).
    final : ContactState
        The contact in the last step, of the bare stone unless the third body does all the wear. It
        is the contact of the surface after the wear of this body in the step. Its displacement is
        counted from the highest point of the worn surface.
    states : tuple of tuple of ContactState
        For each step the contacts of the bare stone and of the third body, except one whose share
        is 0. It is empty unless requested.
    depths : tuple of ndarray or DataArray
        `depth` after each step, or empty unless requested.
    """

    depth: Any
    mean_loss: np.ndarray
    highest_pressure: float
    final: ContactState
    states: tuple[tuple[ContactState, ...], ...]
    depths: tuple[Any, ...]

    def __repr__(self) -> str:
        lost = f"{self.mean_loss[-1]:.4g} mm lost in {self.mean_loss.size} steps"
        return f"WearPath({lost}, {self.final!r})"


# Its options are keywords.
def wear_path(  # noqa: PLR0913
    heights,
    spacing=None,
    contact_modulus=None,
    *,
    mean_pressure,
    mean_loss,
    steps=10,
    third_body=None,
    pressure_cap=math.inf,
    periodic=False,
    tolerance=1e-6,
    keep_states=False,
    keep_depths=False,
) -> WearPath:
    """Wear a rough surface by Archard's law under a mean pressure, down to a mean loss of height.

    Parameters
    ----------
    heights, spacing, contact_modulus, periodic
        As in `solve_contact`.
    mean_pressure : float or array_like, shape (steps,)
        Force over nominal area (MPa), ≥ 0, one value or one per step, not zero in all. The sliding
        is the same in all steps.
    mean_loss : float
        Mean depth over the grid in the end (mm), ≥ 0: the specific wear rate (mm³/(N·m)), including
        the third body, times the sliding (m) and the mean pressure (MPa) of all steps. It sets κ,
        wear coefficient × sliding. In each step it is `mean_loss` over the sum of the steps' mean
        pressures, weighted by the share of each body.
    steps : int
        Number of implicit steps.
    third_body : ThirdBody, optional
        A body between the surface and the elastic body for a share of the wear.
    pressure_cap : float
        Cap on the pressure in each step (MPa), as in `solve_contact`. An element that yields in a
        step is as high as before in the next, minus its wear.
    tolerance : float
        As in `solve_contact`, for each step.
    keep_states, keep_depths : bool
        Keep contacts and depths of every step, not of the last one only.

    Raises
    ------
    ContactInputError
        A mean loss deeper than the relief of the surface, no steps, another number of pressures
        than of steps, and whatever `solve_contact` refuses.
    ConvergenceError
        A step did not reach the tolerance.

    Warns
    -----
    ContactWarning
        As `solve_contact`, of the last contact of the bare stone.

    Examples
    --------
    The lost volume is wear coefficient × sliding × force, however the contact grows:

    >>> import numpy as np
    >>> import gstlib
    >>> wave = 1e-3 * np.cos(np.linspace(0, 8 * np.pi, 64)) * np.ones((64, 1))
    >>> load = {"mean_pressure": 10.0, "mean_loss": 2e-5 * 1.0 * 10.0}
    >>> path = gstlib.wear_path(wave, 0.01, 1e4, **load, steps=4)
    >>> path.mean_loss
    array([5.0e-05, 1.0e-04, 1.5e-04, 2.0e-04])
    """
    heights, spacing, like = as_given(heights, spacing)
    heights = checked_array("heights", heights, holes=True)
    steps, tolerance = checked_steps(steps), checked_tolerance(tolerance)
    target = checked_number("mean_loss", mean_loss, "mm")
    relief = float(np.ptp(heights[heights > -math.inf]))
    if target > relief:
        raise ContactInputError(
            f"mean_loss {target:g} mm is more than the relief of the surface, {relief:g} mm: "
            "nothing would be left of it"
        )
    pressed = list(_pressed(heights, mean_pressure, third_body, steps))
    total = sum(share * float(pressures.sum()) for share, _, pressures, _ in pressed)
    if not total > 0:
        raise ContactInputError(
            "mean_pressure must be positive in at least one step (MPa)"
        )
    bodies = []
    for share, surface, pressures, layer in pressed:
        # The same sliding in each step, and so the same operators.
        rate = share * target / total
        grid = spacing, contact_modulus
        problem = ContactProblem(
            surface, *grid, springs=rate, layer=layer, periodic=periodic
        )
        cap = problem.load(None, pressures.max(), pressure_cap).pressure_cap
        bodies.append(_Body(rate, pressures * heights.size, cap, problem))
    depth, mean_loss = np.zeros_like(heights), np.zeros(steps)
    states, depths, highest = [], [], 0.0
    for step in range(steps):
        reached: list[ContactState] = []
        for body in bodies:
            state = body.press(step, tolerance)
            loss = body.rate * state.pressure
            depth += loss
            highest = max(highest, float(state.pressure.max()))
            sunk = [other.lower(loss) for other in bodies]
            # Kp − w of the worn surface is (K + κI)p − w of that before: the gap is the same.
            reached.append(_sunk(state, sunk[len(reached)]))
        if keep_states:
            states.append(tuple(state.like(like) for state in reached))
        if keep_depths:
            depths.append(like("depth", depth.copy()))
        mean_loss[step] = depth.mean()
    warn_of_doubts(reached[0], bodies[0].problem)
    return WearPath(
        depth=like("depth", depth),
        mean_loss=mean_loss,
        highest_pressure=highest,
        final=reached[0].like(like),
        states=tuple(states),
        depths=tuple(depths),
    )


@dataclass
class _Body:
    """A body that presses the surface for a share of the wear: bare stone or third body.

    `rate` is wear coefficient × sliding of a step (mm/MPa), and `forces` are the sums of pressures
    in each step. `problem` is the contact with the surface as worn so far. `start` is the last
    pressure and its displacement.
    """

    rate: float
    forces: np.ndarray
    pressure_cap: float
    problem: ContactProblem
    start: tuple = (None, None)

    def press(self, step, tolerance):
        """The contact of a step."""
        load = LoadControl(force=self.forces[step], pressure_cap=self.pressure_cap)
        state = self.problem.solve(load, tolerance, *self.start)
        relief = self.problem.relief
        field, there = np.zeros_like(relief), relief > -math.inf
        field[there] = state.gap[there] + relief[there] + state.displacement
        self.start = state.pressure, field
        return state

    def lower(self, loss):
        """Subtract a loss (mm) from the surface, and return how far its summit sank (mm)."""
        self.problem, sunk = self.problem.lowered(loss)
        return sunk


def _pressed(heights, mean_pressure, third_body, steps):
    """The share, surface, pressures and layer of each body that wears, the bare stone first."""
    share = checked_fraction(
        "share of the third body", third_body.share if third_body else 0
    )
    if share < 1:
        yield 1 - share, heights, _in_steps(mean_pressure, steps), None
    if share > 0:
        lowered = np.asarray(rows_first(third_body.lowered))
        if lowered.size > 1 and lowered.shape != heights.shape:
            raise ContactInputError(
                f"third_body.lowered has the shape {lowered.shape}, the surface {heights.shape}"
            )
        pressures = _in_steps(third_body.mean_pressure, steps)
        yield share, heights - lowered, pressures, third_body.layer


def _sunk(state, depth):
    """A state whose displacement is counted from a deeper summit (mm)."""
    top = state.displacement - depth
    # A periodic surface that has worn flat takes no displacement.
    residual = state.residual * state.displacement / top if top > 0 else 0.0
    return replace(state, displacement=top, residual=residual) if depth else state


def _in_steps(mean_pressure, steps):
    """A mean pressure of each step."""
    pressures = np.atleast_1d(np.asarray(mean_pressure, dtype=float))
    if pressures.shape not in ((1,), (steps,)):
        raise ContactInputError(
            f"mean_pressure must be one number or {steps}, one for each step, got {pressures.size}"
        )
    for pressure in pressures:
        checked_number("mean_pressure", pressure, "MPa")
    return np.broadcast_to(pressures, (steps,))
