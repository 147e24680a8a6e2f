"""Load paths: the far-field displacement grows in equal steps until a target pressure is reached.

The contact is elastic and frictionless, so each state depends on its load alone and not on the
path. The target state is therefore solved first, under load control, which gives the displacement
that the steps divide; the others follow downwards, each started from the one above it along the
exact tangent dp/dδ.
"""

import math
from dataclasses import dataclass

import numpy as np

from .errors import checked_number, checked_steps, checked_tolerance
from .load import Load
from .solver import ContactProblem, ContactState
from .window import Window, dot

__all__ = ["LoadPath", "load_path"]

# Tolerance of states that are not kept: they give points of a curve, not a field (measured on 13
# rough patches: all 1040 numbers agree with those at 1e-9 in five digits, the stiffness in four).
_CURVE_TOLERANCE = 1e-6
# Largest relative error of the unit displacement on the contact under the response's pressure; that
# of the stiffness is of second order in it.
_RESPONSE_TOLERANCE = 3e-3
# The properties of each state that a path has.
_OF_STATE = "mean_pressure", "contact_fraction", "iterations", "convolutions", "residual"


@dataclass(frozen=True, eq=False)
class LoadPath:
    """States at equal increments of displacement, the last one at the target pressure.

    Attributes
    ----------
    displacement : ndarray, shape (steps,)
        Far-field displacement from first touch (mm), in equal steps from displacement/steps on.
    mean_pressure, contact_fraction, iterations, convolutions, residual : ndarray, shape (steps,)
        Of each state, see `ContactState`. The cost of the stiffness is not included.
    stiffness : ndarray, shape (steps,)
        Contact stiffness d(mean pressure)/d(displacement) (MPa/mm): exact, by one linear solve
        on the fixed contact set of each state (its relative error is of the order of 1e-6; up to
        1e-4 if the contact is a few long elements). Infinite in full contact of periodic surfaces.
    final : ContactState
        The state at the target pressure.
    states : tuple of ContactState
        All states in order of displacement, if requested; else empty.
    """

    displacement: np.ndarray
    mean_pressure: np.ndarray
    contact_fraction: np.ndarray
    stiffness: np.ndarray
    iterations: np.ndarray
    convolutions: np.ndarray
    residual: np.ndarray
    final: ContactState
    states: tuple[ContactState, ...]


def load_path(
    heights,
    spacing,
    contact_modulus,
    *,
    target_pressure,
    steps=20,
    periodic=False,
    tolerance=1e-6,
    keep_states=False,
) -> LoadPath:
    """Press a rough surface in equal steps of displacement up to a mean pressure.

    Parameters
    ----------
    heights, spacing, contact_modulus, periodic
        As in `solve_contact`.
    target_pressure : float
        Mean pressure of the last state (MPa), ≥ 0; met to rounding. At 0 nothing touches: all
        values of the path are 0, the stiffness too.
    steps : int
        Number of states.
    tolerance : float
        As in `solve_contact`, for the last state and those that are kept; for the others 1e-6 if
        that is larger.
    keep_states : bool
        Keep the fields of every step, not of the last one only.

    Raises
    ------
    ContactInputError
        A negative target, no steps, and whatever `solve_contact` refuses.
    ConvergenceError
        A state did not reach the tolerance.
    """
    problem = ContactProblem(heights, spacing, contact_modulus, periodic=periodic)
    target_pressure = checked_number("target_pressure", target_pressure, "MPa")
    steps, tolerance = checked_steps(steps), checked_tolerance(tolerance)
    final = problem.solve(Load(force=target_pressure * problem.relief.size), tolerance)
    if not keep_states:
        tolerance = max(tolerance, _CURVE_TOLERANCE)

    displacement = final.displacement * np.arange(1, steps + 1) / steps
    stiffness, curve, states = np.zeros(steps), [], []
    state, window, pressure, response = final, None, np.zeros(0), np.zeros(0)
    for index in reversed(range(steps)):
        load = Load(displacement=displacement[index])
        if window is not None:
            # Along the tangent of p², not of p: at a moving edge p is the root of the distance, so
            # p² is smooth where p is not (on Hertz's sphere p² is linear in δ).
            descent = displacement[index + 1] - displacement[index]
            squared = pressure * (pressure - 2 * descent * response)
            opening = state.gap.reshape(-1)[window.elements]
            opening = opening + problem.relief.reshape(-1)[window.elements]
            # On the way down elements leave the contact; any that join it nevertheless, against the
            # continuum's rule, are added by the solver's final check.
            state = problem.solve(
                load,
                tolerance,
                np.sqrt(np.maximum(squared, 0)),
                window,
                known=(pressure, opening + state.displacement),
            )
        elif index < steps - 1:
            state = problem.solve(load, tolerance)
        contact = np.flatnonzero(state.pressure)
        window, last = None, window
        if contact.size == state.pressure.size and problem.full_displacement < math.inf:
            stiffness[index] = math.inf
        elif contact.size:
            before = np.zeros(state.pressure.size)
            if last is not None:
                before[last.elements] = response
            window = Window(problem.half_space, contact)
            pressure = state.pressure.reshape(-1)[contact]
            response, stiffness[index] = _unit_response(window, before[contact])
        curve.append([getattr(state, name) for name in _OF_STATE])
        if keep_states:
            states.append(state)
    return LoadPath(
        displacement=displacement,
        stiffness=stiffness,
        final=final,
        states=tuple(reversed(states)),
        **{
            name: np.array(values[::-1])
            for name, values in zip(_OF_STATE, zip(*curve, strict=True), strict=True)
        },
    )


def _unit_response(window, start):
    """Response to displacement on a fixed contact: p' = dp/dδ (MPa/mm), and the stiffness.

    Solves K p' = 1 on the window by preconditioned conjugate gradients, from `start` unless that
    is zero. The stiffness d(mean pressure)/dδ has an error of second order in that of p'.
    """
    precondition = window.preconditioner
    precondition.fit(np.ones(start.size, bool))
    solution = start if start.any() else precondition.uniform
    image = window.displacement(solution)
    factor = solution.sum() / dot(solution, image)
    solution = factor * solution
    residual = 1 - factor * image
    direction, previous = 0.0, 1.0
    while np.abs(residual).max() > _RESPONSE_TOLERANCE:
        preconditioned = precondition(residual)
        product = dot(residual, preconditioned)
        direction = preconditioned + direction * (product / previous)
        previous = product
        image = window.displacement(direction)
        scale = product / dot(direction, image)
        solution = solution + scale * direction
        residual = residual - scale * image
    # The energy 2·Σp' − p'ᵀKp', stationary at the solution where it equals Σp'.
    stiffness = (solution.sum() + dot(residual, solution)) / math.prod(window.half_space.shape)
    return solution, float(stiffness)
