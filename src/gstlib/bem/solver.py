"""Frictionless contact of a rigid rough surface with an elastic half-space.

Find the pressure p ≥ 0 that minimises ½ pᵀKp − pᵀw, so that the gap g = Kp − w ≥ 0 and p·g = 0 on
every element. K is the half-space of :mod:`gstlib.bem.halfspace` and w the rigid
interpenetration at far-field displacement δ, counted from first touch: w = δ − (h_max − h).
Either δ is given, or the mean pressure, and then δ is an unknown too.

The method is a bound-constrained conjugate gradient (Polonsky & Keer, Wear 231 (1999) 206;
Vollebregt, J. Optim. Theory Appl. 162 (2014) 936) with these additions:

- the preconditioner is an approximate inverse of K on the elements in contact (Vollebregt), and
  corrects it for islands of contact that sink together (:mod:`gstlib.bem.preconditioner`);
- grids are nested: each starts from the solution on elements twice as long;
- one convolution an iteration. Where an iteration ends at p < 0, the pressure is cut to zero, and
  the displacement of that small cut is not computed on its own but with the next direction;
- changes are convolved approximately (:mod:`gstlib.bem.splitting`), and only on the elements that
  may come into contact; the error that gathers is swept out by an exact convolution
  (:mod:`gstlib.bem.descent`).

What is returned never rests on that recurrence: pressure, gap and residual are recomputed by a
convolution of their own, in double precision and on every element.
"""

import math
import warnings

import numpy as np

from .algebra import dot
from .checks import (
    checked_heights,
    checked_level,
    checked_limit,
    checked_modulus,
    checked_spacing,
    checked_tolerance,
)
from .descent import descend
from .errors import ConvergenceError, DomainTooSmallWarning, InvalidContactInput
from .halfspace import HalfSpace
from .load import Load
from .state import ContactState
from .window import APPROXIMATION_ERROR, Window

__all__ = ["ContactProblem", "solve_contact", "warn_at_border"]

# ASSUME: a stone's strength, where `pressure_limit` gives one, acts as a ceiling on the pressure.

# Iterations allowed on each grid; rough surfaces take tens.
MAX_ITERATIONS = 500
# Longest side of the coarsest grid, where a cold start costs next to nothing.
_COARSEST = 64
# Tolerance on coarse grids: they differ from the next by more than this anyway.
_COARSE_TOLERANCE = 1e-2
# Elements whose gap, as far as it is known at the start, is below this share of the displacement
# are followed in the iterations; the final check covers every element, and adds what was missed
# (measured on ten rough patches: up to 7 % less time than 0.05; from 0.015 down some contact is
# missed at first, and the iterations begin again).
_CANDIDATE_GAP = 0.03
# The recurrence goes on to this share of the tolerance, so that the recomputed residual meets it.
_INNER_SHARE = 0.7


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

    def __init__(
        self, heights, spacing, contact_modulus, workers=1, pressure_limit=math.inf, kernel=None
    ):
        heights = checked_heights(heights)
        self.pressure_limit = checked_limit(pressure_limit)
        self.half_space = HalfSpace(
            heights.shape,
            checked_spacing(spacing),
            checked_modulus(contact_modulus),
            workers,
            kernel,
        )
        self._relief = heights - heights.max()  # h − h_max, ≤ 0
        self._coarser = None

    def solve(
        self,
        *,
        displacement=None,
        mean_pressure=None,
        initial_pressure=None,
        candidates=None,
        tolerance,
        max_iterations,
    ) -> ContactState:
        """Solve at one load; arguments as of :func:`solve_contact`, already checked.

        `candidates` : flat indices in ascending order, shape (n,), at least one, of the elements
        to follow first; `initial_pressure`, shape (n,), is theirs then, and zero elsewhere.
        """
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
        force = None if mean_pressure is None else mean_pressure * math.prod(shape)
        load = Load(displacement, force, self.pressure_limit)
        if initial_pressure is None or not load.carried_by(initial_pressure):
            initial_pressure, candidates = self._start(load, max_iterations)
        elif candidates is None:
            initial_pressure = np.array(initial_pressure, order="C")
            if force is not None:
                # Beforehand: were it far from the force, rounding would leave nothing of it.
                initial_pressure /= initial_pressure.max()
                initial_pressure *= force / initial_pressure.sum()
        return self._iterate(initial_pressure, candidates, load, tolerance, max_iterations)

    def _start(self, load, max_iterations):
        """Pressure to start from, and candidates: from the grid of elements twice as long."""
        shape = self.half_space.shape
        uniform = 0.0 if load.force is None else load.force / math.prod(shape)
        if max(shape) <= _COARSEST:
            return np.full(shape, uniform), None
        if self._coarser is None:
            self._coarser = self._coarsen()
        coarse = self._coarser._iterate(
            *self._coarser._start(load.coarser(), max_iterations),
            load.coarser(),
            _COARSE_TOLERANCE,
            max_iterations,
            certified=False,
        )

        # Candidates under the same elastic displacement: where the finer relief comes near it.
        depth = coarse.gap + self._coarser._relief - _CANDIDATE_GAP * coarse.displacement
        depth[coarse.contact] = -math.inf
        depth = np.repeat(depth, 2, axis=1)[:, : shape[1]]
        near = np.empty(shape, bool)
        for lines in (slice(0, None, 2), slice(1, None, 2)):
            relief = self._relief[lines]
            np.greater(relief, depth[: len(relief)], out=near[lines])
        candidates = np.flatnonzero(near)
        rows, columns = np.divmod(candidates, shape[1])
        pressure = coarse.pressure[rows // 2, columns // 2]
        # None at all is near under a spike that the coarse grid misses; it carries too little where
        # the border of an odd grid was cut off.
        if not (candidates.size and load.carried_by(pressure)):
            return np.full(shape, uniform), None
        return pressure, candidates

    def _coarsen(self):
        ny, nx = self.half_space.shape
        # An odd grid is lengthened by a copy of its border; the solution there is a start only.
        relief = np.pad(self._relief, ((0, ny % 2), (0, nx % 2)), mode="edge")
        relief = 0.25 * (
            relief[::2, ::2] + relief[1::2, ::2] + relief[::2, 1::2] + relief[1::2, 1::2]
        )
        kernel = self.half_space.kernel.coarser(2)
        coarse = ContactProblem(
            relief,
            kernel.spacing,
            kernel.contact_modulus,
            self.half_space.workers,
            self.pressure_limit,
            kernel,
        )
        # δ is counted from the summit of the finest grid, which averaging lowers.
        coarse._relief = relief
        return coarse

    def _iterate(self, pressure, candidates, load, tolerance, max_iterations, certified=True):
        """Improve `pressure` until its recomputed residual is below `tolerance`.

        Only candidates take part in the iterations, and `pressure` is theirs; if they are None it
        is that of the grid, in C order and overwritten, and they come from the gap under it. A
        state that is not to be `certified` is recomputed approximately.
        """
        history = []
        before = self.half_space.convolutions
        # To begin with, an approximate displacement will do.
        respond, inaccuracy = self.half_space.approximate_displacement, APPROXIMATION_ERROR
        field, error = None, 0.0
        while True:
            if candidates is None:
                state, field = self._recompute(pressure, respond, load, history, before)
                error = inaccuracy * float(field.max())
                if certified and error > 0 and state.residual * state.displacement <= error:
                    respond, inaccuracy = self.half_space.exact_displacement, 0.0
                    continue
                final = error == 0 or not certified
                if final and state.residual <= tolerance:
                    return state
                if final and len(history) >= max_iterations:
                    raise ConvergenceError(state.residual, tolerance, len(history))
                near = state.gap < _CANDIDATE_GAP * state.displacement
                candidates = np.flatnonzero(near | state.contact)
                pressure = state.pressure.reshape(-1)[candidates]
                field = field.reshape(-1)[candidates].astype(float)
            values = descend(
                Window(self.half_space, candidates),
                load,
                self._relief.reshape(-1)[candidates],
                pressure,
                field,
                _INNER_SHARE * tolerance,
                error,
                history,
                max_iterations,
            )
            pressure = np.zeros(self.half_space.shape)
            pressure.reshape(-1)[candidates] = values
            candidates = None
            if certified:
                respond, inaccuracy = self.half_space.exact_displacement, 0.0

    def _recompute(self, pressure, respond, load, history, before):
        """State of a pressure field by a convolution of its own, and its displacement.

        The pressure is scaled to the load, in place; the next convolution overwrites the
        displacement.
        """
        contact = np.flatnonzero(pressure > 0)
        loaded = load.scaled(pressure.reshape(-1)[contact])
        pressure.reshape(-1)[contact] = loaded
        force = float(loaded.sum())
        field = respond(pressure) if force > 0 else np.zeros_like(pressure)
        gap = field - self._relief
        displacement = load.displacement_at(loaded, gap.reshape(-1)[contact])
        gap -= displacement
        # Either the gap is open where there is pressure, or closed where there could be more.
        opened = gap.reshape(-1)[contact]
        below = gap if load.pressure_limit == math.inf else gap[pressure < load.pressure_limit]
        violation = max(opened.max(initial=0.0), -below.min(initial=0.0))
        virtual_work = dot(loaded, opened) - load.least_work(gap, force)
        doubled_energy = dot(loaded, field.reshape(-1)[contact])
        state = ContactState(
            pressure=pressure,
            gap=gap,
            displacement=displacement,
            mean_pressure=force / pressure.size,
            contact_fraction=contact.size / pressure.size,
            iterations=len(history),
            convolutions=self.half_space.convolutions - before,
            residual=float(violation / displacement),
            duality_gap=float(virtual_work / doubled_energy) if force > 0 else math.inf,
            history=tuple(history),
            pressure_limit=self.pressure_limit,
        )
        return state, field


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
    count = np.count_nonzero(pressure) - np.count_nonzero(pressure[1:-1, 1:-1])
    if count:
        warnings.warn(
            f"contact reaches the border of the grid on {count} elements: the domain is too small, "
            "or the load would be shared by surface that is not in it",
            DomainTooSmallWarning,
            stacklevel=3,
        )
