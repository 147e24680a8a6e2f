"""Load paths: the far-field displacement grows in equal steps until a target pressure is reached.

The contact is elastic and frictionless, so each state depends on its load alone and not on the
path. The target state is therefore solved first, under load control, which gives the displacement
that the steps divide; the others follow downwards, each started from the one above it along the
exact tangent dp/dδ.
"""

import math
from dataclasses import dataclass

import numpy as np

from .checks import checked_level, checked_tolerance
from .errors import InvalidContactInput, UnreachableTargetError
from .solver import MAX_ITERATIONS, ContactProblem, warn_at_border
from .state import ContactState
from .stiffness import unit_response

__all__ = ["LoadPath", "load_path"]


@dataclass(frozen=True, eq=False)
class LoadPath:
    """States at equal increments of displacement, the last one at the target pressure.

    Attributes
    ----------
    displacement : ndarray, shape (steps,)
        Far-field displacement from first touch (mm), in equal steps from displacement/steps on.
    mean_pressure : ndarray, shape (steps,)
        Force over nominal area (MPa).
    contact_fraction : ndarray, shape (steps,)
        Share of elements in contact.
    stiffness : ndarray, shape (steps,)
        Contact stiffness d(mean pressure)/d(displacement) (MPa/mm): exact, by one linear solve
        on the fixed contact set of each state (its relative error is of the order of 1e-6; up to
        1e-4 where the contact is a few long elements).
    iterations, convolutions : ndarray of int, shape (steps,)
        Spent on each state on the finest grid; those for the stiffness are not counted in.
    residual : ndarray, shape (steps,)
        Recomputed residual of each state.
    final : ContactState
        The state at the target pressure.
    states : tuple of ContactState
        All states in order of displacement, if asked for; else empty.
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
    tolerance=1e-6,
    maximum_displacement=None,
    pressure_limit=math.inf,
    max_iterations=MAX_ITERATIONS,
    workers=1,
    keep_states=False,
    progress=None,
) -> LoadPath:
    """Press a rough surface in equal steps of displacement up to a mean pressure.

    Parameters
    ----------
    heights, spacing, contact_modulus, tolerance, pressure_limit, max_iterations, workers
        As in :func:`gstlib.bem.solve_contact`.
    target_pressure : float
        Mean pressure of the last state (MPa), > 0; met to rounding.
    steps : int
        Number of states.
    maximum_displacement : float, optional
        Largest far-field displacement allowed (mm).
    keep_states : bool
        Keep the fields of every step, not of the last one only.
    progress : callable, optional
        Called as ``progress(step_index, steps, state)`` after each solved state; the last
        index comes first, the others follow downwards.

    Returns
    -------
    LoadPath

    Raises
    ------
    InvalidContactInput
        Target not positive, no steps, and whatever :func:`gstlib.bem.solve_contact` refuses.
    UnreachableTargetError
        The target lies beyond `maximum_displacement`; it tells the pressure reached there.
    ConvergenceError
        A state did not reach the tolerance.

    Warns
    -----
    DomainTooSmallWarning
        Contact at the target reaches the border of the grid.
    """
    problem = ContactProblem(heights, spacing, contact_modulus, workers, pressure_limit)
    target_pressure = checked_level("target_pressure", target_pressure, "MPa")
    if target_pressure == 0:
        raise InvalidContactInput("target_pressure must be positive (MPa), got 0")
    if target_pressure >= problem.pressure_limit:
        raise InvalidContactInput(
            f"target_pressure {target_pressure} MPa is not below pressure_limit {pressure_limit}"
        )
    if not isinstance(steps, (int, np.integer)) or steps < 1:
        raise InvalidContactInput(f"steps must be an integer of at least 1, got {steps!r}")
    controls = {"tolerance": checked_tolerance(tolerance), "max_iterations": max_iterations}
    if maximum_displacement is not None:
        maximum_displacement = checked_level("maximum_displacement", maximum_displacement, "mm")

    final = problem.solve(mean_pressure=target_pressure, **controls)
    if maximum_displacement is not None and final.displacement > maximum_displacement:
        reached = problem.solve(displacement=maximum_displacement, **controls)
        raise UnreachableTargetError(target_pressure, reached.mean_pressure, maximum_displacement)
    warn_at_border(final.pressure)

    displacement = final.displacement * np.arange(1, steps + 1) / steps
    stiffness = np.empty(steps)
    summary = [None] * steps
    states = []
    state, tangent = final, None
    for index in reversed(range(steps)):
        if index < steps - 1:
            # Along the tangent of p², not of p: at a moving edge p is the root of the distance, so
            # p² is smooth where p is not (on Hertz's sphere p² is linear in δ).
            descent = displacement[index + 1] - displacement[index]
            contact = np.flatnonzero(state.contact)
            above, slope = (field.reshape(-1)[contact] for field in (state.pressure, tangent))
            state = problem.solve(
                displacement=displacement[index],
                initial_pressure=np.sqrt(np.maximum(above * (above - 2 * descent * slope), 0)),
                # On the way down elements leave the contact; what joins it after all, against
                # the continuum's rule, is added by the solver's final check.
                candidates=contact,
                **controls,
            )
        tangent, stiffness[index] = unit_response(
            problem.half_space, state.elastic_contact, tangent
        )
        summary[index] = (
            state.mean_pressure,
            state.contact_fraction,
            state.iterations,
            state.convolutions,
            state.residual,
        )
        if keep_states:
            states.insert(0, state)
        if progress is not None:
            progress(index, steps, state)
    mean_pressure, contact_fraction, iterations, convolutions, residual = map(
        np.array, zip(*summary, strict=True)
    )
    return LoadPath(
        displacement=displacement,
        mean_pressure=mean_pressure,
        contact_fraction=contact_fraction,
        stiffness=stiffness,
        iterations=iterations,
        convolutions=convolutions,
        residual=residual,
        final=final,
        states=tuple(states),
    )
