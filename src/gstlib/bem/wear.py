"""Wear by Archard's law: the surface loses height in proportion to pressure and sliding.

The rate of loss is k p v, with the wear coefficient k and the sliding speed v (J. F. Archard,
J. Appl. Phys. 24 (1953) 981). In a step of the sliding s, and with κ = k s (mm/MPa), the surface
after the step is h − κ p, and p is the pressure under which *that* surface is in contact
(backward Euler): Kp − w = −κ p where p > 0. So a step is one contact with the operator K + κI, a
half-space behind a bed of springs. The step is stable however long it is, and its error is of
first order in κ. What is lost is exactly κ times the force.
"""

from dataclasses import dataclass, replace

import numpy as np

from .errors import (
    InvalidContactInput,
    checked_array,
    checked_number,
    checked_steps,
    checked_tolerance,
)
from .load import Load
from .solver import ContactProblem, ContactState

__all__ = ["WearPath", "wear_path"]

_OF_STATE = "contact_fraction", "displacement", "mean_pressure", "iterations", "convolutions"


@dataclass(frozen=True, eq=False)
class WearPath:
    """A surface as it wears.

    Attributes
    ----------
    depth : ndarray, shape (ny, nx)
        Height lost in the end (mm), ≥ 0.
    mean_loss : ndarray, shape (steps,)
        Mean depth over the grid after each step (mm).
    contact_fraction, displacement, mean_pressure, iterations, convolutions : ndarray
        Shape (steps,): of the contact of the worn surface after each step, see `ContactState`.
        The displacement is counted from the worn surface's own highest point (mm).
    final : ContactState
        Contact of the worn surface in the end.
    states : tuple of ContactState
        Those of all steps, if asked for; else empty.
    """

    depth: np.ndarray
    mean_loss: np.ndarray
    contact_fraction: np.ndarray
    displacement: np.ndarray
    mean_pressure: np.ndarray
    iterations: np.ndarray
    convolutions: np.ndarray
    final: ContactState
    states: tuple[ContactState, ...]


def wear_path(
    heights,
    spacing,
    contact_modulus,
    *,
    mean_pressure,
    mean_loss,
    steps=10,
    tolerance=1e-6,
    workers=1,
    keep_states=False,
) -> WearPath:
    """Wear a rough surface by Archard's law under a mean pressure, down to a mean loss of height.

    Parameters
    ----------
    heights, spacing, contact_modulus, workers
        As of `solve_contact`.
    mean_pressure : float or array_like, shape (steps,)
        Force over nominal area (MPa), ≥ 0, in all steps or in each, not zero in all. The sliding
        is the same in all steps.
    mean_loss : float
        Mean depth over the grid in the end (mm), ≥ 0. It sets κ, wear coefficient × sliding: that
        of each step is `mean_loss` over the sum of the steps' mean pressures.
    steps : int
        Number of implicit steps.
    tolerance : float
        As of `solve_contact`, for each step.
    keep_states : bool
        Keep the contact of every step, not of the last one only.

    Raises
    ------
    InvalidContactInput
        A mean loss deeper than the relief of the surface, no steps, pressures of another number
        than the steps, and whatever `solve_contact` refuses.
    ConvergenceError
        A step did not reach the tolerance.

    Examples
    --------
    What is lost is wear coefficient × sliding × force, however the contact grows:

    >>> import numpy as np
    >>> wave = 1e-3 * np.cos(np.linspace(0, 8 * np.pi, 64)) * np.ones((64, 1))
    >>> path = wear_path(wave, 0.01, 1e4, mean_pressure=10.0, mean_loss=2e-4, steps=4)
    >>> path.mean_loss
    array([5.0e-05, 1.0e-04, 1.5e-04, 2.0e-04])
    """
    heights = checked_array("heights", heights)
    steps, tolerance = checked_steps(steps), checked_tolerance(tolerance)
    pressures = np.atleast_1d(np.asarray(mean_pressure, dtype=float))
    if pressures.shape not in ((1,), (steps,)):
        raise InvalidContactInput(
            f"mean_pressure must be one number or {steps}, one for each step, got {pressures.size}"
        )
    pressures = np.broadcast_to(
        [checked_number("mean_pressure", value, "MPa") for value in pressures], (steps,)
    )
    if not pressures.any():
        raise InvalidContactInput("mean_pressure must be positive in one step at least (MPa)")
    mean_loss = checked_number("mean_loss", mean_loss, "mm")
    relief = float(np.ptp(heights))
    if mean_loss > relief:
        raise InvalidContactInput(
            f"mean_loss {mean_loss:g} mm is more than the relief of the surface, {relief:g} mm: "
            "nothing of it would be left"
        )
    # The same sliding in each step, and so the same operator.
    rate = mean_loss / float(pressures.sum())
    problem = ContactProblem(heights, spacing, contact_modulus, springs=rate)
    depth, start, curve, states = np.zeros_like(heights), None, [], []
    for pressure in pressures:
        state = problem.solve(Load(force=pressure * heights.size), tolerance, start)
        start, loss = state.pressure, rate * state.pressure
        depth += loss
        problem, lowered = problem.lowered(loss)
        # Kp − w of the worn surface is (K + κI)p − w of that before: the gap is the same.
        if lowered:
            top = state.displacement - lowered
            state = replace(
                state, displacement=top, residual=state.residual * state.displacement / top
            )
        if keep_states:
            states.append(state)
        curve.append([float(depth.mean())] + [getattr(state, name) for name in _OF_STATE])
    names = ("mean_loss", *_OF_STATE)
    values = (np.array(column) for column in zip(*curve, strict=True))
    return WearPath(
        depth=depth,
        final=state,
        states=tuple(states),
        **dict(zip(names, values, strict=True)),
    )
