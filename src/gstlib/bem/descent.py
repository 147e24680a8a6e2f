"""The iterations: bound-constrained conjugate gradients on the elements that may be in contact."""

import math

import numpy as np

from .halfspace import APPROXIMATION_ERROR
from .window import dot

__all__ = ["MAX_ITERATIONS", "descend"]

# Iterations allowed on each grid; rough surfaces take tens.
MAX_ITERATIONS = 500
# A cut larger than this share of the step is convolved at once rather than with the next one.
_LARGE_CUT = 0.3
# Bounds of the next trial's step. The line searches of a rough 4096² ask for 0.15: with a bound of
# 0.3, trials go too far, cuts are large, and every third iteration has a convolution more.
_SHORTEST_STEP, _LONGEST_STEP = 0.1, 3.0
# Least share of the largest lift, so that every free element can take part in balancing the load.
_LEAST_LIFT = 1e-3
# A line search changes the pressure as a whole by no more than this share.
_LARGE_LEVEL = 0.5
# Iterations of the projected gradient, slow but sure, after an iteration that raised the energy.
_CAUTIOUS = 10
# Two directions are dependent when rounding may have left this of their Gram determinant.
_DEPENDENT = 1e-10
# If so many iterations do not halve the residual, as many cautious ones follow: needed for elements
# sixty times as long as wide under a pressure limit (measured: fewer help less).
_PATIENCE = 80
# The field is computed again, exactly, when its error may be this share of the residual.
_LARGE_ERROR = 0.3


# The inner loop: its steps share nearly all of their state.
def descend(  # noqa: C901, PLR0915
    window, load, relief, pressure, field, tolerance, error, iterations
):
    """Improve a pressure until the residual of the recurrence is below the tolerance.

    Each iteration adds a change whose displacement is computed approximately; errors thus scale
    with the changes, which shrink. An exact convolution removes the accumulated error now and then,
    also at the start.

    All vectors are of the window's n elements: `relief` is h − h_max (mm), `pressure` (MPa, ≥ 0)
    that to start from, and `field` its displacement (mm), known up to `error`, or None; where it is
    known, the pressure is admissible. `iterations` counts on. Returns pressure and iterations.
    """
    if field is None:
        pressure = load.scaled(pressure)
        field = window.displacement(pressure)
        error = APPROXIMATION_ERROR * field.max()
    # `field` is the displacement of `convolved`, a pressure that differs from the admissible
    # `pressure` by the last cut.
    convolved = pressure
    preconditioner = window.preconditioner
    change = change_field = lift = None
    step = 1.0
    started, lowest_energy, cautious = False, math.inf, 0
    halved, reached = iterations, math.inf
    while iterations < MAX_ITERATIONS:
        opening = field - relief
        rigid = load.rigid(load.freedoms(pressure, opening))
        penetration = rigid - opening
        free = np.where(penetration > 0, pressure < load.pressure_cap, pressure > 0)
        residual = penetration * free
        violation = np.abs(residual).max()
        stalled = iterations - halved > _PATIENCE and not cautious
        if stalled:
            halved, cautious, change = iterations, _PATIENCE, None
        if stalled or error > _LARGE_ERROR * violation:
            convolved, field, error = pressure, window.exact_displacement(pressure), 0.0
            lowest_energy = math.inf
            continue
        iterations += 1
        relative = violation / load.deepest(rigid, relief)
        if relative <= tolerance:
            break
        if relative < 0.5 * reached:
            halved, reached = iterations, relative

        preconditioner.fit(free)
        direction = preconditioner(residual) * free
        if dot(direction, residual) <= 0:
            direction = preconditioner.short_range(residual) * free
        if load.force is not None:
            # Pressure that a uniform lift adds: the direction along which the load is kept.
            lift = preconditioner.uniform
            # Positive but for grids of a few elements; where it carries load it must be.
            lift = np.maximum(lift, _LEAST_LIFT * lift.max()) * free
            direction = load.balanced(direction, lift)
        preconditioned = direction
        # Directions whose displacement is known already: the last change and, unless load or
        # limit hold it, the pressure itself, which sets the level of the whole.
        scalable = load.force is None and 0 < convolved.max() < load.pressure_cap
        level = [(convolved, field)] if scalable else []
        known = level if change is None else [(change, change_field), *level]
        if known:
            weights = _energy_weights(known, [dot(direction, image) for _, image in known])
            direction = preconditioned - _combination(weights, [v for v, _ in known]) * free
            if load.force is not None:
                direction = load.balanced(direction, lift)
            if dot(direction, penetration) <= 0:
                direction = preconditioned
        trial = load.admissible(pressure + step * direction, lift)
        if cautious or dot(penetration, trial - pressure) <= 0:
            gradient = penetration * free / window.half_space.self_influence
            trial = load.admissible(pressure + gradient, free.astype(float))

        change = trial - convolved
        change_field = window.displacement(change)
        error += APPROXIMATION_ERROR * np.abs(change_field).max()
        curvature = dot(change, change_field)
        if not curvature > 0:
            break  # stuck at rounding; the recomputed residual will show it
        # The exact line search along the change alone...
        scale = dot(penetration, change) / curvature
        if cautious:
            # Between one admissible pressure and another: admissible, and of less energy.
            cautious -= 1
            scale = min(scale, 1.0)
            pressure = convolved = convolved + scale * change
            field = field + scale * change_field
            change = None
            continue
        # ... and together with the level.
        steps = [(change, change_field), *level]
        weights = _energy_weights(steps, [dot(vector, penetration) for vector, _ in steps])
        if weights[0] <= 0 or abs(weights[1:]).sum() > _LARGE_LEVEL:
            weights = np.array([scale if scale > 0 else 1.0, *[0.0] * len(level)])
        step = min(max(weights[0] * step, _SHORTEST_STEP), _LONGEST_STEP)

        change, change_field = (_combination(weights, c) for c in zip(*steps, strict=True))
        convolved = convolved + change
        field = field + change_field
        # What the trial cut stays at its bound.
        inside = (trial > 0) & (trial < load.pressure_cap)
        pressure = load.admissible(
            np.where(inside, convolved, trial), None if lift is None else lift * inside
        )
        cut = pressure - convolved
        if np.abs(cut).max() > _LARGE_CUT * np.abs(change).max():
            if not started:
                # At the first, most often that of the start, much is still to change.
                started, convolved, field = True, pressure, window.displacement(pressure)
                error = APPROXIMATION_ERROR * field.max()
                continue
            # The first change is large, and so is its error.
            if math.isinf(lowest_energy):
                convolved, field, error = pressure, window.exact_displacement(pressure), 0.0
            else:
                cut_field = window.displacement(cut)
                convolved, field = pressure, field + cut_field
                error += APPROXIMATION_ERROR * np.abs(cut_field).max()
            # Bold steps alone may go round in circles. An error stays as it is, but for what each
            # step adds, so that energies can be compared until the field is computed again.
            given = rigid if load.force is None else 0.0
            energy = dot(pressure, 0.5 * field - relief - given)
            if energy >= lowest_energy:
                cautious = _CAUTIOUS
            lowest_energy = min(energy, lowest_energy)
    return pressure, iterations


def _energy_weights(pairs, right):
    """Weights w that solve Σⱼ (vᵢᵀKvⱼ) wⱼ = rightᵢ, from one or two pairs (v, Kv).

    The second has no weight if it depends on the first.
    """
    (first, image), *others = pairs
    energy = dot(first, image)
    if not others:
        return np.array([right[0] / energy])
    second, second_image = others[0]
    mixed, other_energy = dot(second, image), dot(second, second_image)
    determinant = energy * other_energy - mixed**2
    if not determinant > _DEPENDENT * energy * other_energy:
        return np.array([right[0] / energy, 0.0])
    return np.array(
        [
            (other_energy * right[0] - mixed * right[1]) / determinant,
            (energy * right[1] - mixed * right[0]) / determinant,
        ]
    )


def _combination(weights, vectors):
    """Σ w·v."""
    total = weights[0] * vectors[0]
    for weight, vector in zip(weights[1:], vectors[1:], strict=True):
        total += weight * vector
    return total
