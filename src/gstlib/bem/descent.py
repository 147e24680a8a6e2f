"""The iterations: bound-constrained conjugate gradients on the elements that may be in contact."""

import math
from dataclasses import dataclass

import numpy as np

from .halfspace import APPROXIMATION_ERROR
from .window import Window, dot

__all__ = ["MAX_ITERATIONS", "descend"]

# Iterations allowed on each grid. Rough surfaces take tens.
MAX_ITERATIONS = 500
# A cut larger than this share of the step is convolved at once rather than with the next one.
_LARGE_CUT = 0.3
# Bounds of the next trial's step. The line searches of a rough 4096² need 0.15. With a bound of
# 0.3, trials go too far, cuts are large, and every third iteration has an extra convolution.
_SHORTEST_STEP, _LONGEST_STEP = 0.1, 3.0
# Least share of the largest lift, so that every free element can take part in balancing the load.
_LEAST_LIFT = 1e-3
# A line search changes the pressure as a whole by no more than this share.
_LARGE_LEVEL = 0.5
# Iterations of the projected gradient, slow but sure, after an iteration that raised the energy.
_CAUTIOUS = 10
# Two directions are dependent when rounding may have left this of their Gram determinant.
_DEPENDENT = 1e-10
# If so many iterations do not halve the residual, as many cautious ones follow. Elements sixty
# times as long as wide need this under a pressure limit (measured: fewer help less).
_PATIENCE = 80
# The field is computed again, exactly, when its error may be this share of the residual.
_LARGE_ERROR = 0.3


@dataclass
class _Response:
    """The displacement (mm) of a pressure (MPa) on a window, followed change by change.

    Changes are convolved approximately, so that errors scale with them. `pressure` differs from an
    admissible one by the last cut, and `field` from its displacement by `error` at most.
    """

    window: Window
    pressure: np.ndarray
    field: np.ndarray
    error: float

    def compute(self, pressure, exactly=False):
        """The displacement of a pressure, approximately or in double precision."""
        self.pressure, self.error = pressure, 0.0
        if exactly:
            self.field = self.window.exact_displacement(pressure)
        else:
            self.field = self.window.displacement(pressure)
            self.error = APPROXIMATION_ERROR * self.field.max()

    def displacement(self, change):
        """The displacement of a change, whose error adds to the error of the field."""
        field = self.window.displacement(change)
        self.error += APPROXIMATION_ERROR * np.abs(field).max()
        return field

    def cut_to(self, pressure, exactly):
        """Go to an admissible pressure. Only the cut is convolved, unless `exactly`."""
        if exactly:
            self.compute(pressure, exactly)
        else:
            cut = pressure - self.pressure
            self.field, self.pressure = self.field + self.displacement(cut), pressure

    def add(self, change, field):
        """Change the pressure by a change of this displacement."""
        self.pressure, self.field = self.pressure + change, self.field + field


class _Progress:
    """Which iterations halved the residual, and how many cautious ones are still to come."""

    def __init__(self, iterations):
        self.halved, self.cautious = iterations, 0
        self.reached = self.lowest_energy = math.inf

    def is_stalled(self, iterations):
        """Whether the residual has not halved for long, so that cautious iterations follow."""
        if iterations - self.halved <= _PATIENCE or self.cautious:
            return False
        self.halved, self.cautious = iterations, _PATIENCE
        return True

    def reach(self, residual, iterations):
        """Note a residual."""
        if residual < 0.5 * self.reached:
            self.halved, self.reached = iterations, residual

    def compare(self, energy):
        """Be cautious if the energy rose: bold steps alone may go round in circles."""
        if energy >= self.lowest_energy:
            self.cautious = _CAUTIOUS
        self.lowest_energy = min(energy, self.lowest_energy)


def descend(window, load, relief, pressure, field, tolerance, error, iterations):
    """Improve a pressure until the residual of the recurrence is below the tolerance.

    Each iteration adds a change whose displacement is computed approximately. Errors thus scale
    with the changes, which shrink. An exact convolution removes the accumulated error now and then,
    also at the start.

    All vectors contain the window's n elements. `relief` is h − h_max (mm), and `pressure` (MPa, ≥
    0) is the start. `field` is its displacement (mm), accurate to `error`, or None. If it is given,
    the pressure is admissible. `iterations` counts on. Returns pressure and iterations.
    """
    response = _Response(window, pressure, field, error)
    if field is None:
        response.compute(pressure := load.scaled(pressure))
    progress, last, step, started = _Progress(iterations), None, 1.0, False
    while iterations < MAX_ITERATIONS:
        rigid, penetration, free = _interpenetration(
            load, pressure, response.field - relief
        )
        violation = np.abs(penetration * free).max()
        stalled = progress.is_stalled(iterations)
        if stalled or response.error > _LARGE_ERROR * violation:
            response.compute(pressure, exactly=True)
            last, progress.lowest_energy = None if stalled else last, math.inf
            continue
        iterations += 1
        relative = violation / load.deepest(rigid, relief)
        if relative <= tolerance:
            break
        progress.reach(relative, iterations)

        # Directions whose displacement is known already: the last change and the pressure itself,
        # which sets the overall level, unless load or limit fix it.
        scalable = (
            load.force is None and 0 < response.pressure.max() < load.pressure_cap
        )
        level = [(response.pressure, response.field)] if scalable else []
        pairs = level if last is None else [last, *level]
        direction, lift = _direction(window, load, penetration, free, pairs)
        trial = load.admissible(pressure + step * direction, lift)
        if progress.cautious or dot(penetration, trial - pressure) <= 0:
            gradient = penetration * free / window.half_space.self_influence
            trial = load.admissible(pressure + gradient, free.astype(float))

        change = trial - response.pressure
        image = response.displacement(change)
        if not dot(change, image) > 0:
            break  # stuck at rounding; the recomputed residual will show it
        if progress.cautious:
            # Between one admissible pressure and another: admissible, and of less energy.
            progress.cautious -= 1
            scale = min(dot(penetration, change) / dot(change, image), 1.0)
            response.add(scale * change, scale * image)
            pressure, last = response.pressure, None
            continue
        weights, last = _line_search(penetration, [(change, image), *level])
        step = min(max(weights[0] * step, _SHORTEST_STEP), _LONGEST_STEP)
        response.add(*last)
        # Elements that the trial cut stay at their bound.
        inside = (trial > 0) & (trial < load.pressure_cap)
        pressure = load.admissible(
            np.where(inside, response.pressure, trial),
            None if lift is None else lift * inside,
        )
        cut = np.abs(pressure - response.pressure).max()
        if cut > _LARGE_CUT * np.abs(last[0]).max():
            if not started:
                # At the first iteration, most often at the start, large changes are still ahead.
                started = True
                response.compute(pressure)
                continue
            # The first change is large, and so is its error.
            response.cut_to(pressure, exactly=math.isinf(progress.lowest_energy))
            # An error changes only by the error of each step, so that energies can be compared
            # until the field is computed again.
            work = rigid if load.force is None else 0.0
            progress.compare(dot(pressure, 0.5 * response.field - relief - work))
    return pressure, iterations


def _interpenetration(load, pressure, opening):
    """The rigid displacement, how deep the surfaces overlap (mm), and which elements are free."""
    rigid = load.rigid(load.freedoms(pressure, opening))
    penetration = rigid - opening
    free = np.where(penetration > 0, pressure < load.pressure_cap, pressure > 0)
    return rigid, penetration, free


def _direction(window, load, penetration, free, pairs):
    """The direction of the next trial, and the lift that keeps its load (None without a force).

    It is conjugate to the `pairs` of a direction and its displacement.
    """
    residual, lift = penetration * free, None
    window.fit(free)
    direction = window.precondition(residual) * free
    if dot(direction, residual) <= 0:
        direction = window.short_range(residual) * free
    if load.force is not None:
        # Pressure that a uniform lift adds: the direction along which the load is kept.
        lift = window.uniform
        # Positive except on grids of a few elements. It must be positive under load.
        lift = np.maximum(lift, _LEAST_LIFT * lift.max()) * free
        direction = load.balanced(direction, lift)
    if not pairs:
        return direction, lift
    vectors, images = zip(*pairs, strict=True)
    weights = _energy_weights(pairs, [dot(direction, image) for image in images])
    conjugate = direction - _combination(weights, vectors) * free
    if load.force is not None:
        conjugate = load.balanced(conjugate, lift)
    return (direction if dot(conjugate, penetration) <= 0 else conjugate), lift


def _line_search(penetration, steps):
    """Weights of a change and the level, pairs with their displacements, and the sum."""
    work = [dot(vector, penetration) for vector, _ in steps]
    weights = _energy_weights(steps, work)
    if weights[0] <= 0 or abs(weights[1:]).sum() > _LARGE_LEVEL:
        # The exact search along the change alone.
        (scale,) = _energy_weights(steps[:1], work)
        weights = np.zeros(len(steps))
        weights[0] = scale if scale > 0 else 1.0
    return weights, [
        _combination(weights, column) for column in zip(*steps, strict=True)
    ]


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
    return sum(weight * vector for weight, vector in zip(weights, vectors, strict=True))
