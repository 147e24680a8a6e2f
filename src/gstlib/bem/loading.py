"""Load paths: in equal steps of far-field displacement up to a target pressure.

The contact is elastic and frictionless, so each state depends on its load alone and not on the
path. The last state is therefore solved first, under load control. It gives the displacement that
equal steps divide. The others follow downwards, each from the state above it along the exact
tangent dp/dδ.
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

from .doubts import warn_of_doubts
from .errors import checked_number, checked_steps, checked_tolerance
from .fields import as_given
from .load import LoadControl
from .solver import ContactProblem
from .state import ContactState
from .window import Window, dot

__all__ = ["LoadPath", "curve_table", "load_path"]

# Tolerance of states that are not kept. They give points of a curve, not a field. (Measured on 13
# rough patches: all 1040 numbers agree with results at 1e-9 in five digits, the stiffness in four.)
_CURVE_TOLERANCE = 1e-6
# Largest relative error of the unit displacement on the contact under the response's pressure. The
# error of the stiffness is of second order in it.
_RESPONSE_TOLERANCE = 3e-3
# The properties of each state in a path.
_OF_STATE = (
    "displacement",
    "mean_pressure",
    "contact_fraction",
    "iterations",
    "convolutions",
    "residual",
)


# Name and factor of the columns of its table.
_COLUMNS = {
    "displacement": ("displacement_um", 1e3),
    "mean_pressure": ("mean_pressure_MPa", 1.0),
    "contact_fraction": ("contact_fraction", 1.0),
    "stiffness": ("stiffness_MPa_per_um", 1e-3),
}


@dataclass(frozen=True, eq=False, repr=False)
class LoadPath:
    """States at equal increments of displacement up to the target pressure.

    Attributes
    ----------
    displacement : ndarray, shape (steps,)
        Far-field displacement from first touch (mm), in equal steps from displacement/steps on.
    mean_pressure, contact_fraction, iterations, convolutions, residual : ndarray, shape (steps,)
        Properties of each state, see `ContactState`. The cost of the stiffness is not included.
    stiffness : ndarray, shape (steps,)
        Contact stiffness d(mean pressure)/d(displacement) (MPa/mm). It is exact, by one linear
        solve on the fixed contact set of each state. Its relative error is of the order of 1e-6,
        and up to 1e-4 if the contact is a few long elements. For a periodic surface, it is −d(mean
        pressure)/d(mean gap), infinite in full contact.
    final : ContactState
        The state at the target pressure.
    states : tuple of ContactState
        All states in order of displacement, if requested. Otherwise it is empty.
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

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.displacement.size} states up to {self.final!r})"

    def table(self) -> "pd.DataFrame":
        """A row for each state, units in the names of its columns."""
        return curve_table(self).assign(residual=self.residual)


def load_path(
    heights,
    spacing=None,
    contact_modulus=None,
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
        Mean pressure of the last state (MPa), ≥ 0, met to rounding. At 0, all values of the path
        are 0, also the stiffness.
    steps : int
        Number of states.
    tolerance : float
        As in `solve_contact`, for the last state and kept states. For the others it is at least
        1e-6.
    keep_states : bool
        Keep the fields of every step, not of the last one only.

    Raises
    ------
    ContactInputError
        A negative target, no steps, and whatever `solve_contact` refuses.
    ConvergenceError
        A state did not reach the tolerance.

    Warns
    -----
    ContactWarning
        As in `solve_contact`, for the last state.

    Examples
    --------
    The stiffness of a sphere grows with the square root of the displacement (Hertz):

    >>> import numpy as np
    >>> import gstlib
    >>> along = 0.01 * (np.arange(32) - 15.5)
    >>> sphere = -np.add.outer(along**2, along**2) / (2 * 5.0)
    >>> path = gstlib.load_path(sphere, 0.01, 1e4, target_pressure=20.0, steps=4)
    >>> (path.stiffness / path.stiffness[-1]).round(1)
    array([0.5, 0.7, 0.9, 1. ])
    """
    heights, spacing, like = as_given(heights, spacing)
    problem = ContactProblem(heights, spacing, contact_modulus, periodic=periodic)
    target = checked_number("target_pressure", target_pressure, "MPa")
    steps, tolerance = checked_steps(steps), checked_tolerance(tolerance)
    final = problem.solve(LoadControl(force=target * problem.relief.size), tolerance)
    warn_of_doubts(final, problem)
    if not keep_states:
        tolerance = max(tolerance, _CURVE_TOLERANCE)

    stiffness, curve, states = np.zeros(steps), [], []
    level = final.displacement * np.arange(1, steps + 1) / steps
    state, tangent = final, None
    for index in reversed(range(steps)):
        if tangent is not None:
            state = _below(problem, state, level[index], tolerance, tangent)
        elif index < steps - 1:
            state = problem.solve(LoadControl(level[index]), tolerance)
        tangent, stiffness[index] = _tangent(problem, state, tangent)
        curve.append([getattr(state, name) for name in _OF_STATE])
        if keep_states:
            states.append(state.like(like))
    columns = [np.array(values) for values in zip(*reversed(curve), strict=True)]
    return LoadPath(
        stiffness=stiffness,
        final=final.like(like),
        states=tuple(reversed(states)),
        **dict(zip(_OF_STATE, columns, strict=True)),
    )


def curve_table(path, prefix: str = "") -> "pd.DataFrame":
    """A load path, whose attributes have this prefix, with units in the names of its columns."""
    import pandas as pd  # here: solving needs it not

    return pd.DataFrame(
        {
            column: factor * np.asarray(getattr(path, prefix + name))
            for name, (column, factor) in _COLUMNS.items()
        }
    )


def _tangent(problem, state, above):
    """The contact's window, its pressure and response to displacement, and the stiffness.

    The three are None without contact, or in full contact without a response. `above` contains the
    three of the state at the previous load, if any.
    """
    contact = np.flatnonzero(state.pressure)
    if not contact.size:
        return None, 0.0
    if contact.size == state.pressure.size and problem.full_displacement < math.inf:
        return None, math.inf
    before = np.zeros(state.pressure.size)
    if above is not None:
        before[above[0].elements] = above[2]
    window = Window(problem.half_space, contact)
    response, stiffness = _unit_response(window, before[contact])
    return (window, state.pressure.reshape(-1)[contact], response), stiffness


def _below(problem, above, displacement, tolerance, tangent):
    """The state at a smaller displacement than that of another state, by its tangent."""
    window, pressure, response = tangent
    descent = above.displacement - displacement
    # Along the tangent of p², not of p. At a moving edge p is the root of the distance, so p² is
    # smooth where p is not. On Hertz's sphere p² is linear in δ.
    squared = pressure * (pressure - 2 * descent * response)
    opening = above.gap.reshape(-1)[window.elements]
    opening = opening + problem.relief.reshape(-1)[window.elements]
    # On the way down elements leave the contact. If some join it nevertheless, against the
    # continuum's rule, the solver's final check adds them.
    nearby = pressure, opening + above.displacement
    start = np.sqrt(np.maximum(squared, 0))
    return problem.solve(LoadControl(displacement), tolerance, start, nearby, window)


def _unit_response(window, start):
    """Response to displacement on a fixed contact: p' = dp/dδ (MPa/mm), and the stiffness.

    Solves K p' = 1 on the window by preconditioned conjugate gradients, from `start` unless it is
    zero. The error of the stiffness d(mean pressure)/dδ is of second order in the error of p'.
    """
    window.fit(np.ones(start.size, bool))
    solution = start if start.any() else window.uniform
    image = window.displacement(solution)
    factor = solution.sum() / dot(solution, image)
    solution = factor * solution
    residual = 1 - factor * image
    direction, previous = 0.0, 1.0
    while np.abs(residual).max() > _RESPONSE_TOLERANCE:
        preconditioned = window.precondition(residual)
        product = dot(residual, preconditioned)
        direction = preconditioned + direction * (product / previous)
        previous = product
        image = window.displacement(direction)
        scale = product / dot(direction, image)
        solution = solution + scale * direction
        residual = residual - scale * image
    # The energy 2·Σp' − p'ᵀKp', stationary at the solution where it equals Σp'.
    energy = solution.sum() + dot(residual, solution)
    return solution, float(energy) / math.prod(window.half_space.shape)
