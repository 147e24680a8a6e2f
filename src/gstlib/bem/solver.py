"""Frictionless contact of a rigid rough surface with an elastic half-space.

Find the pressure p ≥ 0 that minimises ½ pᵀKp − pᵀw, so that the gap g = Kp − w ≥ 0 and p·g = 0 on
every element. K is the half-space of :mod:`gstlib.bem.halfspace` and w the rigid
interpenetration at far-field displacement δ, counted from first touch: w = δ − (h_max − h).
Either δ is given, or the mean pressure, and then δ is an unknown too.

The method is a bound-constrained conjugate gradient (Polonsky & Keer, Wear 231 (1999) 206;
Vollebregt, J. Optim. Theory Appl. 162 (2014) 936) with three additions:

- the approximate inverse of K, restricted to the contact, is the preconditioner (Vollebregt);
- grids are nested: each starts from the solution on elements twice as long;
- one convolution an iteration. Where an iteration ends at p < 0, the pressure is cut to zero, and
  the displacement of that small cut is not computed on its own but with the next direction.

What is returned never rests on that recurrence: pressure, gap and residual are recomputed by a
convolution of their own.
"""

import math
import warnings
from dataclasses import dataclass

import numpy as np

from .checks import (
    checked_heights,
    checked_level,
    checked_limit,
    checked_modulus,
    checked_spacing,
    checked_tolerance,
)
from .errors import ConvergenceError, DomainTooSmallWarning, InvalidContactInput
from .halfspace import HalfSpace

__all__ = ["ContactState", "solve_contact"]

# ASSUME: a stone's strength, where `pressure_limit` gives one, acts as a ceiling on the pressure.

# Iterations allowed on each grid; rough surfaces take tens.
MAX_ITERATIONS = 500
# Longest side of the coarsest grid, where a cold start costs next to nothing.
_COARSEST = 64
# Tolerance on coarse grids: they differ from the next by more than this anyway.
_COARSE_TOLERANCE = 1e-3
# Elements whose gap at the start is below this share of the displacement are followed in the
# iterations; the final check covers every element, and adds those that were missed.
_CANDIDATE_GAP = 0.25
# A cut larger than this share of the step is convolved at once rather than with the next one.
_LARGE_CUT = 0.3
# Largest relative error of the unit displacement on the contact under a tangent's pressure.
_TANGENT_TOLERANCE = 1e-3
# Least share of the largest lift, so that every free element can take part in balancing the load.
_LEAST_LIFT = 1e-3
# A line search does not raise or lower the pressure as a whole by more than this share.
_LARGE_LEVEL = 0.5
# Iterations of the projected gradient, slow but sure, after an iteration that raised the energy.
_CAUTIOUS = 10
# The recurrence goes on to this share of the tolerance, so that the recomputed residual meets it.
_INNER_SHARE = 0.7


@dataclass(frozen=True, eq=False)
class ContactState:
    """A solved contact. Recomputed fields: gap, residual and duality gap come from the pressure.

    Attributes
    ----------
    pressure : ndarray, shape (ny, nx)
        Contact pressure (MPa), ≥ 0; zero out of contact.
    gap : ndarray, shape (ny, nx)
        Kp − w (mm): zero in contact and positive elsewhere, within `residual` × `displacement`.
    displacement : float
        Far-field displacement δ from first touch at the highest summit (mm); the largest rigid
        interpenetration.
    mean_pressure : float
        Total force over nominal area (MPa).
    contact_fraction : float
        Share of elements with p > 0.
    iterations, convolutions : int
        Spent on the finest grid, the final check included.
    residual : float
        Largest of abs(gap) where p > 0 and of −gap where p = 0, divided by `displacement`.
    duality_gap : float
        (pᵀg − F min g) / pᵀKp with F = Σp: a bound, relative to twice the elastic energy, on what
        any pressure field of the same load could still gain.
    history : tuple of float
        Residual of each iteration on the finest grid, as the recurrence had it.
    pressure_limit : float
        The ceiling asked for (MPa). Where the pressure is at it, −gap is the depth by which the
        surface has yielded, and no violation.
    """

    pressure: np.ndarray
    gap: np.ndarray
    displacement: float
    mean_pressure: float
    contact_fraction: float
    iterations: int
    convolutions: int
    residual: float
    duality_gap: float
    history: tuple[float, ...]
    pressure_limit: float = math.inf

    @property
    def ceiling_share(self) -> float:
        """Share of the contact whose pressure is at the limit; 0 without contact."""
        contact = np.count_nonzero(self.pressure)
        return float(np.count_nonzero(self.pressure >= self.pressure_limit) / max(contact, 1))

    @property
    def elastic_contact(self) -> np.ndarray:
        """Mask of the contact below the limit; bool, shape (ny, nx)."""
        return self.contact & (self.pressure < self.pressure_limit)

    @property
    def contact(self) -> np.ndarray:
        """Mask of the real contact, p > 0; bool, shape (ny, nx)."""
        return self.pressure > 0


def solve_contact(
    heights,
    spacing,
    contact_modulus,
    *,
    displacement=None,
    mean_pressure=None,
    initial_pressure=None,
    pressure_limit=math.inf,
    tolerance=1e-6,
    max_iterations=MAX_ITERATIONS,
    workers=1,
) -> ContactState:
    """Contact at a given displacement or under a given mean pressure.

    Parameters
    ----------
    heights : array_like, shape (ny, nx)
        Heights of the rigid surface (mm), up towards the elastic body.
    spacing : float or (float, float)
        Side of the square elements, or (dy, dx) (mm).
    contact_modulus : float
        E* of the pair (MPa).
    displacement : float, optional
        Far-field displacement from first touch at the highest summit (mm), ≥ 0.
    mean_pressure : float, optional
        Force over nominal area (MPa), ≥ 0. Exactly one of the two is to be given.
    initial_pressure : array_like, shape (ny, nx), optional
        Start from this pressure (MPa) on the finest grid; by default, from coarser grids.
        Changes the cost, not the solution.
    pressure_limit : float
        Ceiling on the pressure, as a hardness (MPa): the elastic, perfectly plastic contact
        p ≤ H of Almqvist et al. (Tribol. Int. 40 (2007) 574). Infinite by default.
    tolerance : float
        Asked of `residual`, see :class:`ContactState`. About 1e-12 is the floor of float64.
    max_iterations : int
        On each grid.
    workers : int
        Threads of the convolutions. The result has the same bits for any number.

    Returns
    -------
    ContactState

    Raises
    ------
    InvalidContactInput
        Heights with holes or not two-dimensional, a negative or missing load, a wrong shape, a
        mean pressure not below the limit...
    ConvergenceError
        The tolerance was not reached.

    Warns
    -----
    DomainTooSmallWarning
        Contact reaches the border of the grid.

    Examples
    --------
    A flat surface is in contact as a whole:

    >>> import warnings, numpy as np
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore")
    ...     state = solve_contact(np.zeros((8, 8)), 0.1, 1e4, mean_pressure=10.0)
    >>> state.contact_fraction
    1.0
    """
    problem = ContactProblem(heights, spacing, contact_modulus, workers, pressure_limit)
    if (displacement is None) == (mean_pressure is None):
        raise InvalidContactInput("give exactly one of displacement (mm) and mean_pressure (MPa)")
    if displacement is not None:
        displacement = checked_level("displacement", displacement, "mm")
    else:
        mean_pressure = checked_level("mean_pressure", mean_pressure, "MPa")
        if mean_pressure >= problem.pressure_limit:
            raise InvalidContactInput(
                f"mean_pressure {mean_pressure} MPa is not below pressure_limit {pressure_limit}"
            )
    if initial_pressure is not None:
        initial_pressure = _checked_initial(initial_pressure, problem.half_space.shape)
    state = problem.solve(
        displacement=displacement,
        mean_pressure=mean_pressure,
        initial_pressure=initial_pressure,
        tolerance=checked_tolerance(tolerance),
        max_iterations=max_iterations,
    )
    warn_at_border(state.pressure)
    return state


class ContactProblem:
    """One surface and one half-space, to be solved at several loads. Checks heights once."""

    def __init__(self, heights, spacing, contact_modulus, workers=1, pressure_limit=math.inf):
        heights = checked_heights(heights)
        self.pressure_limit = checked_limit(pressure_limit)
        self.half_space = HalfSpace(
            heights.shape, checked_spacing(spacing), checked_modulus(contact_modulus), workers
        )
        self._inverse = self.half_space.approximate_inverse()
        self._relief = heights - heights.max()  # h − h_max, ≤ 0
        self._coarser = None

    def solve(
        self,
        *,
        displacement=None,
        mean_pressure=None,
        initial_pressure=None,
        tolerance,
        max_iterations,
    ) -> ContactState:
        """Solve at one load; arguments as of :func:`solve_contact`, already checked."""
        shape = self.half_space.shape
        if displacement == 0 or mean_pressure == 0:
            return ContactState(
                pressure=np.zeros(shape),
                gap=-self._relief,
                displacement=0.0,
                mean_pressure=0.0,
                contact_fraction=0.0,
                iterations=0,
                convolutions=0,
                residual=0.0,
                duality_gap=0.0,
                history=(),
                pressure_limit=self.pressure_limit,
            )
        total = None if mean_pressure is None else mean_pressure * math.prod(shape)
        if initial_pressure is None or (mean_pressure is not None and not initial_pressure.any()):
            initial_pressure = self._start(displacement, mean_pressure, max_iterations)
        return self._iterate(initial_pressure, displacement, total, tolerance, max_iterations)

    def _start(self, displacement, mean_pressure, max_iterations):
        """Pressure to start from: from the grid of elements twice as long, if worth it."""
        shape = self.half_space.shape
        if max(shape) <= _COARSEST:
            return np.full(shape, 0.0 if mean_pressure is None else mean_pressure)
        if self._coarser is None:
            self._coarser = self._coarsen()
        coarse = self._coarser
        total = None if mean_pressure is None else mean_pressure * math.prod(shape) / 4
        state = coarse._iterate(
            coarse._start(displacement, mean_pressure, max_iterations),
            displacement,
            total,
            _COARSE_TOLERANCE,
            max_iterations,
        )
        pressure = np.repeat(np.repeat(state.pressure, 2, axis=0), 2, axis=1)
        return pressure[: shape[0], : shape[1]]

    def _coarsen(self):
        ny, nx = self.half_space.shape
        # An odd grid is lengthened by a copy of its border; the solution there is a start only.
        relief = np.pad(self._relief, ((0, ny % 2), (0, nx % 2)), mode="edge")
        relief = 0.25 * (
            relief[::2, ::2] + relief[1::2, ::2] + relief[::2, 1::2] + relief[1::2, 1::2]
        )
        dy, dx = self.half_space.spacing
        coarse = ContactProblem(
            relief,
            (2 * dy, 2 * dx),
            self.half_space.contact_modulus,
            self.half_space.workers,
            self.pressure_limit,
        )
        # δ is counted from the summit of the finest grid, which averaging lowers.
        coarse._relief = relief
        return coarse

    def _iterate(self, pressure, displacement, total, tolerance, max_iterations):
        """Improve `pressure` until its recomputed residual is below `tolerance`."""
        history = []
        before = self.half_space.convolutions
        while True:
            state, field = self._recompute(pressure, displacement, total, history, before)
            if state.residual <= tolerance:
                return state
            if len(history) >= max_iterations:
                raise ConvergenceError(state.residual, tolerance, len(history))
            # Only elements that are, or may come, in contact take part in the iterations.
            candidates = np.flatnonzero(
                (state.gap < _CANDIDATE_GAP * state.displacement) | (state.pressure > 0)
            )
            pressure = np.zeros_like(pressure)
            pressure.reshape(-1)[candidates] = self._descend(
                candidates,
                state.pressure.reshape(-1)[candidates],
                field.reshape(-1)[candidates],
                displacement,
                total,
                _INNER_SHARE * tolerance,
                history,
                max_iterations,
            )

    def _recompute(self, pressure, displacement, total, history, before):
        """State of a pressure field, by a convolution of its own, and the surface displacement."""
        pressure = np.minimum(pressure, self.pressure_limit)
        if total is not None:
            # Along itself: scaled, but for what is at the limit.
            pressure = _balanced(pressure, pressure, total, self.pressure_limit)
        force = pressure.sum()
        field = self.half_space.displacement(pressure) if force > 0 else np.zeros_like(pressure)
        gap = field - self._relief
        if total is not None:
            displacement = self._displacement(pressure, gap)
        gap -= displacement
        contact = pressure > 0
        # Either the gap is open where there is pressure, or closed where there could be more.
        opened = (gap * contact).max()
        closed = -(gap * (pressure < self.pressure_limit)).min()
        violation = max(opened, closed)
        virtual_work = np.vdot(pressure, gap) - _least_work(gap, force, self.pressure_limit)
        state = ContactState(
            pressure=pressure,
            gap=gap,
            displacement=displacement,
            mean_pressure=float(force / pressure.size),
            contact_fraction=float(np.count_nonzero(contact) / pressure.size),
            iterations=len(history),
            convolutions=self.half_space.convolutions - before,
            residual=float(violation / displacement),
            duality_gap=float(virtual_work / np.vdot(pressure, field)) if force > 0 else math.inf,
            history=tuple(history),
            pressure_limit=self.pressure_limit,
        )
        return state, field

    def _displacement(self, pressure, opening):
        """δ at which the contact closes, from the opening Kp + (h_max − h) of each element."""
        elastic = pressure * (pressure < self.pressure_limit)
        if elastic.any():
            return float(np.vdot(elastic, opening) / elastic.sum())
        # All contact is at the limit: any δ from here to the next touch would do.
        return float(opening[pressure > 0].max())

    def _descend(
        self, candidates, pressure, field, displacement, total, tolerance, history, max_iterations
    ):
        """Preconditioned conjugate gradients on the candidates; returns their pressure.

        `field` is the displacement of `pressure`. In the loop it belongs to `convolved`, a
        pressure that differs from the admissible `pressure` by the last cut.
        """
        half_space = self.half_space
        grid = np.zeros(half_space.shape)

        def apply(operator, values):
            grid.reshape(-1)[candidates] = values
            return operator(grid).reshape(-1)[candidates]

        limit = self.pressure_limit

        def admissible(values, lift):
            if total is None:
                return np.clip(values, 0.0, limit)
            return _balanced(values, lift, total, limit)

        relief = self._relief.reshape(-1)[candidates]
        convolved = pressure
        change = change_field = lift = lift_set = None
        step = 1.0
        overlap = relief if displacement is None else relief + displacement
        lowest_energy, cautious = math.inf, 0
        while len(history) < max_iterations:
            if total is not None:
                displacement = self._displacement(pressure, field - relief)
            penetration = relief + displacement - field
            free = np.where(penetration > 0, pressure < limit, pressure > 0)
            history.append(float(np.abs(penetration[free]).max(initial=0.0) / displacement))
            if history[-1] <= tolerance:
                break

            direction = apply(self._inverse, penetration * free) * free
            if total is not None:
                # Pressure that a uniform lift adds: the direction along which the load is kept.
                if lift is None or not np.array_equal(free, lift_set):
                    lift, lift_set = apply(self._inverse, free.astype(float)), free
                    # Positive but for grids of a few elements; where it carries load it must be.
                    lift = np.maximum(lift, _LEAST_LIFT * lift.max()) * free
                direction -= lift * (direction.sum() / lift.sum())
            preconditioned = direction
            # Directions whose displacement is known already: the last change and, unless load or
            # limit hold it, the pressure itself, which sets the level of the whole.
            scalable = total is None and 0 < convolved.max() < limit
            level = [(convolved, field)] if scalable else []
            known = level if change is None else [(change, change_field), *level]
            if known:
                weights = _weights(known, [np.vdot(direction, image) for _, image in known])
                direction = preconditioned - _sum(weights, known)[0] * free
                if total is not None:
                    direction -= lift * (direction.sum() / lift.sum())
                if np.vdot(direction, penetration) <= 0:
                    direction = preconditioned
            trial = admissible(pressure + step * direction, lift)
            if cautious or np.vdot(penetration, trial - pressure) <= 0:
                gradient = penetration * free / half_space.self_influence
                trial = admissible(pressure + gradient, free.astype(float))

            change = trial - convolved
            if not change.any():
                break  # stuck at rounding; the recomputed residual will tell
            change_field = apply(half_space.displacement, change)
            # The exact line search along the change alone...
            scale = np.vdot(penetration, change) / np.vdot(change, change_field)
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
            weights = _weights(steps, [np.vdot(vector, penetration) for vector, _ in steps])
            if weights[0] <= 0 or abs(weights[1:]).sum() > _LARGE_LEVEL:
                weights = np.array([scale if scale > 0 else 1.0, *[0.0] * len(level)])
            step = min(max(weights[0] * step, 0.3), 3.0)

            change, change_field = _sum(weights, steps)
            convolved = convolved + change
            field = field + change_field
            # What the trial cut stays at its bound.
            inside = (trial > 0) & (trial < limit)
            pressure = admissible(
                np.where(inside, convolved, trial), None if lift is None else lift * inside
            )
            cut = pressure - convolved
            if np.abs(cut).max() > _LARGE_CUT * np.abs(change).max():
                field = field + apply(half_space.displacement, cut)
                convolved = pressure
                energy = np.vdot(pressure, 0.5 * field - overlap)
                if energy >= lowest_energy:
                    cautious = _CAUTIOUS
                lowest_energy = min(energy, lowest_energy)
        return pressure

    def tangent(self, contact, start=None):
        """Response to displacement on a fixed contact set: dp/dδ, and the stiffness.

        Solves K p' = 1 on the contact, p' = 0 elsewhere, by preconditioned conjugate gradients.

        Parameters
        ----------
        contact : ndarray of bool, shape (ny, nx)
            Elements whose pressure follows the displacement.
        start : ndarray, shape (ny, nx), optional
            A tangent to start from.

        Returns
        -------
        tangent : ndarray, shape (ny, nx)
            p' (MPa/mm), such that K p' is 1 on the contact within `_TANGENT_TOLERANCE`.
        stiffness : float
            d(mean pressure)/dδ (MPa/mm). Its error is of second order in that of p'.
        """
        half_space = self.half_space
        elements = np.flatnonzero(contact)
        grid = np.zeros(contact.shape)
        if not elements.size:
            return grid, 0.0

        def apply(operator, values):
            grid.reshape(-1)[elements] = values
            return operator(grid).reshape(-1)[elements]

        if start is None or not start[contact].any():
            solution = apply(self._inverse, np.ones(elements.size))
        else:
            solution = start.reshape(-1)[elements]
        image = apply(half_space.displacement, solution)
        factor = solution.sum() / np.vdot(solution, image)
        solution = factor * solution
        residual = 1 - factor * image
        direction, previous = 0.0, 1.0
        while np.abs(residual).max() > _TANGENT_TOLERANCE:
            preconditioned = apply(self._inverse, residual)
            product = np.vdot(residual, preconditioned)
            direction = preconditioned + direction * (product / previous)
            previous = product
            image = apply(half_space.displacement, direction)
            scale = product / np.vdot(direction, image)
            solution = solution + scale * direction
            residual = residual - scale * image
        grid.reshape(-1)[elements] = solution
        # The energy 2·Σp' − p'ᵀKp', stationary at the solution where it equals Σp'.
        return grid, float((solution.sum() + np.vdot(residual, solution)) / grid.size)


def _weights(pairs, right):
    """Weights w that solve Σⱼ (vᵢᵀKvⱼ) wⱼ = rightᵢ, from pairs (v, Kv); least norm if dependent."""
    gram = np.array([[np.vdot(vector, image) for _, image in pairs] for vector, _ in pairs])
    norm = np.sqrt(np.diagonal(gram))
    scaled = gram / np.outer(norm, norm)
    return np.linalg.lstsq(scaled, np.asarray(right) / norm, rcond=1e-10)[0] / norm


def _sum(weights, pairs):
    """The pair (Σ w·v, Σ w·Kv)."""
    return tuple(
        sum(w * v for w, v in zip(weights, c, strict=True)) for c in zip(*pairs, strict=True)
    )


def _balanced(trial, lift, total, limit):
    """clip(trial + c·lift, 0, limit) with the number c for which its sum is `total`; lift ≥ 0."""
    pressure = np.clip(trial, 0.0, limit)
    moving = lift > 0
    if not moving.any():
        return pressure
    low = (-trial[moving] / lift[moving]).min()
    high = ((min(total, limit) - trial[moving]) / lift[moving]).max()
    shift = 0.0
    for _ in range(200):
        excess = pressure.sum() - total
        if abs(excess) <= 1e-14 * total:
            break
        # The sum increases with c, piece by piece linear: Newton's method, kept between bounds.
        low, high = (low, shift) if excess > 0 else (shift, high)
        slope = lift[(pressure > 0) & (pressure < limit)].sum()
        shift = shift - excess / slope if slope > 0 else math.inf
        if not low < shift < high:
            shift = 0.5 * (low + high)
        pressure = np.clip(trial + shift * lift, 0.0, limit)
    return pressure


def _least_work(gap, force, limit):
    """Least Σ s·g of the fields 0 ≤ s ≤ limit with the sum `force`, or 0 if that is less."""
    if limit == math.inf:
        return force * min(gap.min(), 0.0)
    full, rest = divmod(force / limit, 1)
    lowest = np.sort(gap, axis=None)[: int(full) + 1]
    return min(limit * (lowest[: int(full)].sum() + rest * lowest[-1]), 0.0)


def _checked_initial(initial_pressure, shape):
    pressure = np.asarray(initial_pressure, dtype=float)
    if pressure.shape != shape:
        raise InvalidContactInput(
            f"initial_pressure has shape {pressure.shape}, the heights {shape}"
        )
    if not np.all(np.isfinite(pressure)) or pressure.min() < 0:
        raise InvalidContactInput("initial_pressure must be finite and not negative (MPa)")
    return pressure


def warn_at_border(pressure):
    """Warn where contact touches the border of the grid."""
    border = np.concatenate((pressure[0], pressure[-1], pressure[:, 0], pressure[:, -1]))
    count = np.count_nonzero(border)
    if count:
        warnings.warn(
            f"contact reaches the border of the grid on {count} elements: the domain is too small, "
            "or the load would be shared by surface that is not in it",
            DomainTooSmallWarning,
            stacklevel=3,
        )
