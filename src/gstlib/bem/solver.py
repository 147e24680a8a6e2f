"""Frictionless contact of a rigid rough surface with an elastic half-space.

The solution is the pressure p ≥ 0 that minimises ½ pᵀKp − pᵀw, so that the gap g = Kp − w ≥ 0 and
p·g = 0 on every element. K is the half-space of :mod:`gstlib.bem.halfspace`. The rigid
interpenetration at far-field displacement δ, counted from first touch, is w = δ − (h_max − h).
Either δ is given, or the mean pressure, and then δ is an unknown too.

The method is a bound-constrained conjugate gradient (Polonsky & Keer, Wear 231 (1999) 206;
Vollebregt, J. Optim. Theory Appl. 162 (2014) 936) with these additions:

- The preconditioner is an approximate inverse of K on the elements in contact (Vollebregt), and
  corrects it for islands of contact that sink together (:mod:`gstlib.bem.window`).
- Grids are nested, and each starts from the solution on elements twice as long.
- There is one convolution per iteration. If an iteration ends at p < 0, the pressure is cut to
  zero. The displacement of this small cut is computed with the next direction.
- Changes are convolved approximately (:mod:`gstlib.bem.convolution`), and only on the elements that
  may come into contact. An exact convolution removes the accumulated error
  (:mod:`gstlib.bem.descent`).

Results do not depend on the errors of this recurrence. Pressure, gap and residual are recomputed by
a separate convolution, in double precision and on every element.
"""

import copy
import math
from dataclasses import replace
from functools import cached_property

import numpy as np

from .descent import MAX_ITERATIONS, descend
from .doubts import warn_of_doubts
from .errors import (
    ContactInputError,
    ConvergenceError,
    TippingError,
    checked_array,
    checked_number,
    checked_tolerance,
)
from .fields import as_given, rows_first
from .halfspace import APPROXIMATION_ERROR, HalfSpace
from .load import LoadControl
from .rest import checked_point, resting, tipping
from .state import ContactState
from .window import Window

__all__ = ["ContactProblem", "solve_contact"]

# ASSUME: Strength as a pressure cap. The strength of the stone limits the pressure of each element,
# if `pressure_cap` gives it. Reason: Elastic pressures at summits exceed the strength of the rock.
# Alternative: A purely elastic contact, which is the default.

# Longest side of the coarsest grid, on which a cold start costs almost nothing.
_COARSEST = 64
# Tolerance on coarse grids: they differ from the next by more than this anyway.
_COARSE_TOLERANCE = 1e-2
# The iterations follow elements whose gap, as estimated at the start, is below this share of the
# displacement. The final check covers every element, and adds missed ones. Measured on ten rough
# patches: up to 7 % less time than 0.05. From 0.015 down some contact is missed at first, and the
# iterations begin again.
_CANDIDATE_GAP = 0.03
# Up to so many elements are followed alone if no others can touch.
_FEW = 64
# The recurrence continues to this share of the tolerance, so the recomputed residual meets it.
_INNER_FRACTION = 0.7
# At a steeper tilt, above 45°, a map of heights no longer shows all points that can touch.
# (Half-space and constant lever arms are valid for far smaller tilts only, which the caller has to
# limit.)
_STEEPEST_TILT = 1.0
# Elements this many times higher than long come from a wrong unit, and overflow sums.
_STEEPEST = 1e9


# Its options are keywords.
def solve_contact(  # noqa: PLR0913
    heights,
    spacing=None,
    contact_modulus=None,
    *,
    displacement=None,
    mean_pressure=None,
    load_point=None,
    initial_pressure=None,
    pressure_cap=math.inf,
    springs=0.0,
    layer=None,
    periodic=False,
    tolerance=1e-6,
) -> ContactState:
    """Contact at a given displacement or mean pressure, or in equilibrium under a force.

    Parameters
    ----------
    heights : array_like, shape (ny, nx)
        Heights of the rigid surface (mm), up towards the elastic body. −inf marks elements without
        surface, which cannot touch. For a `DataArray`, the fields of the result are such, too.
    spacing : float or (float, float)
        Side of the square elements, or (dy, dx) (mm). The coordinates of a `DataArray` contain it.
    contact_modulus : float
        E* of the pair (MPa).
    displacement : float, optional
        Far-field displacement from first touch at the highest summit (mm), ≥ 0.
    mean_pressure : float, optional
        Force over the area of the whole grid (MPa), ≥ 0. Give exactly one of the two.
    load_point : (float, float), optional
        The body is free to tilt, and the force acts through this point (y, x), from the grid's
        corner (mm). The centre of element (0, 0) is at half a spacing. It needs a mean pressure.
        The point must be in the convex hull of the elements' centres, or the stone tips over. By
        default the body cannot tilt.
    initial_pressure : array_like, shape (ny, nx), optional
        Start from this pressure (MPa) on the finest grid. The default is a start from coarser
        grids. It changes the cost, not the solution. It also determines the tilt, so the pressure
        of a similar contact is enough for a start near equilibrium.
    pressure_cap : float
        Cap on the pressure, such as a hardness (MPa): the elastic, perfectly plastic contact p ≤ H
        of Almqvist et al. (Tribol. Int. 40 (2007) 574). The default is infinite. It excludes
        `load_point`.
    springs : float
        Compliance of independent springs between the surface and the half-space (mm/MPa), none by
        default. If it is κ, wear coefficient × sliding, the result is the pressure after the wear
        (`gstlib.bem.wear_path`).
    layer : Layer, optional
        A compliant layer between the surface and the half-space.
    periodic : bool
        The surface repeats itself without end in both directions. By default there is no contact
        beyond the grid. The displacement is then the mean displacement of the half-space's surface.
        It cannot grow beyond full contact, and is zero for a flat surface. It excludes
        `load_point`.
    tolerance : float
        Largest `residual`, see `ContactState`. About 1e-12 is the floor of float64.

    Raises
    ------
    ContactInputError
        Heights contain NaN or are not two-dimensional. The load is negative or missing, a shape is
        wrong, or the mean pressure is not below the cap. The stone tips over.
    ConvergenceError
        The tolerance was not reached.

    Warns
    -----
    ContactWarning
        Much of the force on the rim of the grid, a surface in full contact, an r.m.s. slope above
        1, or heights that were not levelled.

    Examples
    --------
    A flat surface is in contact everywhere:

    >>> import numpy as np
    >>> import gstlib
    >>> flat = np.zeros((8, 8)), 0.1, 1e4
    >>> gstlib.solve_contact(*flat, mean_pressure=10.0).contact_fraction
    1.0

    A flat surface carries the force off its middle by tilting:

    >>> state = gstlib.solve_contact(*flat, mean_pressure=10.0, load_point=(0.4, 0.45))
    >>> [round(1e4 * slope) for slope in state.tilt]
    [0, 3]
    """
    heights, spacing, like = as_given(heights, spacing)
    problem = ContactProblem(
        heights,
        spacing,
        contact_modulus,
        springs=springs,
        layer=layer,
        periodic=periodic,
    )
    load = problem.load(displacement, mean_pressure, pressure_cap)
    if initial_pressure is not None:
        initial_pressure = checked_array(
            "initial_pressure", rows_first(initial_pressure), problem.relief.shape
        )
        if initial_pressure.min() < 0:
            raise ContactInputError("initial_pressure must not be negative (MPa)")
        initial_pressure = np.where(problem.relief > -math.inf, initial_pressure, 0.0)
    if load_point is not None:
        if periodic or load.force is None or pressure_cap < math.inf:
            raise ContactInputError(
                "load_point needs mean_pressure (MPa), and neither displacement, pressure_cap nor "
                "periodic: solve in equilibrium without these, add the plane of `tilt` to the "
                "heights, and press these on a fixed plane"
            )
        problem, load = problem.at_rest(load.force, checked_point(load_point))
    state = problem.solve(load, checked_tolerance(tolerance), initial_pressure)
    if math.hypot(*state.tilt) > _STEEPEST_TILT:
        why = "would tilt it by more than 45°: level the heights, or move it inward"
        raise TippingError(tipping(load_point, why))
    warn_of_doubts(state, problem)
    return state.like(like)


class ContactProblem:
    """One surface and one half-space, to solve at several loads.

    Attributes
    ----------
    half_space : HalfSpace
    relief : ndarray, shape (ny, nx)
        h − h_max (mm), ≤ 0, −inf where the surface is missing.
    """

    def __init__(self, heights, spacing, contact_modulus, **options):
        heights = checked_array("heights", heights, holes=True)
        self.half_space = HalfSpace(heights.shape, spacing, contact_modulus, **options)
        self.relief = heights - heights.max()
        height = -float(self.relief.min(where=self.relief > -math.inf, initial=0.0))
        if height > _STEEPEST * min(self.half_space.spacing):
            raise ContactInputError(
                f"heights range over {height:g} mm on elements of {spacing} mm: are both in mm?"
            )

    @property
    def full_displacement(self):
        """Displacement at which a periodic surface is in full contact, and no longer sinks (mm)."""
        if self.half_space.uniform_influence:
            return math.inf
        return -float(self.relief.mean())

    def load(self, displacement, mean_pressure, pressure_cap):
        """The load in the arguments of `solve_contact`."""
        if (displacement is None) == (mean_pressure is None):
            raise ContactInputError(
                "give exactly one of displacement (mm) and mean_pressure (MPa)"
            )
        if pressure_cap != math.inf:
            pressure_cap = checked_number(
                "pressure_cap", pressure_cap, "MPa", positive=True
            )
        if mean_pressure is None:
            displacement = checked_number("displacement", displacement, "mm")
            if displacement and displacement >= self.full_displacement:
                raise ContactInputError(
                    f"at a displacement of {self.full_displacement:g} mm the periodic surface is "
                    f"in full contact, and {displacement:g} mm do not determine the pressure: "
                    "pass mean_pressure (MPa)"
                )
            return LoadControl(displacement, None, pressure_cap)
        mean_pressure = checked_number("mean_pressure", mean_pressure, "MPa")
        covered = float(np.isfinite(self.relief).mean())
        if mean_pressure >= covered * pressure_cap:
            where = f" over the {100 * covered:.3g} % of the grid with surface"
            raise ContactInputError(
                f"mean_pressure {mean_pressure:g} MPa is not below pressure_cap {pressure_cap:g} "
                f"MPa{where if covered < 1 else ''}"
            )
        return LoadControl(None, mean_pressure * self.relief.size, pressure_cap)

    def at_rest(self, force, load_point):
        """The problem of the surface in its equilibrium as a rigid body, and its load.

        The force (MPa, sum of the elements' pressures) acts through a point (y, x) (mm).
        """
        load = resting(self.relief, self.half_space, force, load_point)
        freedoms = 0.0, *(load.rigid_tilt * load.length)
        problem, _ = self.lowered(-load.plane(freedoms, self.relief.shape))
        return problem, load

    def lowered(self, depth):
        """The problem of the surface minus a depth (mm), and how far its summit sank (mm)."""
        problem = copy.copy(self)
        problem.__dict__.pop("_coarser", None)
        problem.relief = self.relief - depth
        top = float(problem.relief.max())
        problem.relief -= top
        return problem, -top

    def solve(self, load, tolerance, pressure=None, displacement=None, window=None):
        """Solve at one load, from a pressure (MPa) on the grid or the `window` to follow first.

        `displacement` (mm) is the exact one of the pressure on the grid, under a force. On a
        window, it is a pressure near the initial one, and its displacement.
        """
        nothing = np.zeros_like(self.relief)
        options = self._options(load, np.zeros(3))
        if load.displacement == 0 or load.force == 0:
            return ContactState(nothing, -self.relief, 0.0, 0.0, 0.0, **options)
        if self.full_displacement == 0:
            mean = load.force / nothing.size
            return ContactState(nothing + mean, nothing, 0.0, mean, 1.0, **options)
        few = self._only_candidates(load)
        if few is not None:
            pressure, displacement = np.full(few.size, load.force), None
            window = Window(self.half_space, few)
        elif pressure is None or not _carried(load, pressure):
            (pressure, window), displacement = self._start(load), None
        elif window is None:
            pressure, field = np.array(pressure, order="C"), displacement
            displacement = None
            if load.force and not 0.1 < pressure.sum() / load.force < 10:
                # So far from the force, it would be lost to rounding.
                pressure /= pressure.max()
                pressure *= load.force / pressure.sum()
            elif field is not None:
                scale = load.force / pressure.sum()
                if scale * pressure.max() < load.pressure_cap:
                    pressure, displacement = scale * pressure, scale * field
        return self._iterate(load, tolerance, pressure, window, displacement)

    def _only_candidates(self, load):
        """The only elements that can touch, if so small a load leaves only a few, or None.

        Among all the others, their pressure would be lost to rounding.
        """
        if load.force is None or load.force >= load.pressure_cap:
            return None
        # One element that carries all the load sinks deepest. Between periods another may touch,
        # which the final check adds.
        sinks = self.half_space.self_influence * load.force
        near = self.relief >= -sinks
        if np.count_nonzero(near) > _FEW:
            return None
        return np.union1d(np.flatnonzero(near), load.followed())

    @cached_property
    def _coarser(self):
        """The problem on elements twice as long."""
        ny, nx = self.relief.shape
        # An odd grid is lengthened by a copy of its border. The solution there is only a start.
        relief = np.pad(self.relief, ((0, ny % 2), (0, nx % 2)), mode="edge")
        coarse = copy.copy(self)
        # δ is counted from the summit of the finest grid, which averaging lowers.
        coarse.relief = _mean_of_four(relief)
        coarse.half_space = self.half_space.on(coarse.relief.shape, coarsening=2)
        return coarse

    def _start(self, load):
        """Pressure to start from, and the window to follow: from the next coarser grid."""
        ny, nx = self.relief.shape
        mean = (load.force or 0.0) / self.relief.size
        uniform = np.where(self.relief > -math.inf, mean, 0.0)
        if max(ny, nx) <= _COARSEST:
            return uniform, None
        coarser = self._coarser
        half = load.coarser(coarser.relief)
        start = coarser._start(half)
        coarse = coarser._iterate(half, _COARSE_TOLERANCE, *start, certified=False)

        # Candidates under the same elastic displacement: elements whose finer relief is near it.
        # Without surface, the depth is not a number, and the element no candidate.
        with np.errstate(invalid="ignore"):
            depth = coarse.gap + coarser.relief - _CANDIDATE_GAP * coarse.displacement
        depth[coarse.contact] = -math.inf
        depth = depth.repeat(2, axis=0).repeat(2, axis=1)[:ny, :nx]
        candidates = np.union1d(np.flatnonzero(self.relief > depth), load.followed())
        rows, columns = np.divmod(candidates, nx)
        pressure = coarse.pressure[rows // 2, columns // 2]
        # If the coarse grid misses a spike, no element is near. If the border of an odd grid was
        # cut off, the near elements carry too little.
        if not (candidates.size and load.at(candidates).carried_by(pressure)):
            return uniform, None
        return pressure, Window(self.half_space, candidates)

    def _iterate(self, load, tolerance, pressure, window, field=None, certified=True):
        """Improve `pressure` until its recomputed residual is below `tolerance`.

        Only elements of the window take part in the iterations, and have the `pressure`. If the
        window is None, `pressure` covers the grid, in C order, and is overwritten. The window then
        comes from the gap under it. For the `field`, see the displacement of `solve`. Unless
        `certified`, a state is recomputed approximately.
        """
        before, iterations, error = self.half_space.convolutions, 0, 0.0
        if field is not None and window is not None:
            # Only the difference is computed approximately.
            difference = window.displacement(pressure - field[0])
            field = field[1] + difference
            error = APPROXIMATION_ERROR * np.abs(difference).max()
        while True:
            if window is None:
                state, field = self._recompute(load, pressure, field, certified)
                reached = max(state.residual, state.moment_residual)
                if reached <= tolerance:
                    spent = self.half_space.convolutions - before
                    return replace(state, iterations=iterations, convolutions=spent)
                if iterations >= MAX_ITERATIONS:
                    raise ConvergenceError(
                        f"contact not converged: residual {reached:.3g} after {iterations} "
                        f"iterations, tolerance {tolerance:.3g}. Set a tolerance above the "
                        "rounding floor of about 1e-12, or check the heights for spikes."
                    )
                near = state.gap < _CANDIDATE_GAP * state.displacement
                window = Window(self.half_space, np.flatnonzero(near | state.contact))
                pressure = state.pressure.reshape(-1)[window.elements]
                error = 0.0 if certified else APPROXIMATION_ERROR * float(field.max())
                field = field.reshape(-1)[window.elements].astype(float)
            values, iterations = descend(
                window,
                load.at(window.elements),
                self.relief.reshape(-1)[window.elements],
                pressure,
                field,
                _INNER_FRACTION * tolerance,
                error,
                iterations,
            )
            pressure = np.zeros(self.relief.shape)
            pressure.reshape(-1)[window.elements] = values
            window = field = None

    def _recompute(self, load, pressure, field, certified):
        """State of a pressure field by a separate convolution, and its displacement.

        The pressure is scaled to the load, in place. The next convolution overwrites the
        displacement. It is not computed if the `field` is given.
        """
        contact = np.flatnonzero(pressure > 0)
        own = load.at(contact)
        loaded = own.scaled(pressure.reshape(-1)[contact])
        pressure.reshape(-1)[contact] = loaded
        force = float(loaded.sum())
        if field is None and force > 0:
            half_space = self.half_space
            respond = half_space.approximate_displacement
            if certified:
                respond = half_space.exact_displacement
            field = respond(pressure)
        elif field is None:
            field = np.zeros_like(pressure)
        gap = field - self.relief
        deciding = contact
        if not own.decided_by(loaded):
            deciding = np.flatnonzero(self.relief > -math.inf)
        freedoms = load.at(deciding).freedoms(
            pressure.reshape(-1)[deciding], gap.reshape(-1)[deciding]
        )
        rigid = load.plane(freedoms, gap.shape)
        displacement = load.deepest(rigid, self.relief)
        gap -= rigid
        # Either the gap is open under pressure, or negative where the pressure could be higher.
        opened = gap.reshape(-1)[contact].max(initial=0.0)
        below = gap[pressure < load.pressure_cap].min(initial=0.0)
        state = ContactState(
            pressure=pressure,
            gap=gap,
            displacement=displacement,
            mean_pressure=force / pressure.size,
            contact_fraction=contact.size / pressure.size,
            residual=float(max(opened, -below) / displacement),
            moment_residual=own.eccentricity(loaded),
            **self._options(load, freedoms),
        )
        return state, field

    def _options(self, load, freedoms):
        """What a state says of its problem."""
        return {
            "pressure_cap": load.pressure_cap,
            "tilt": load.tilt(freedoms),
            "periodic": self.half_space.periodic,
        }


def _carried(load, pressure):
    """Whether elements with pressure, on the grid or a window, can carry the load."""
    elements = np.flatnonzero(pressure)
    return load.at(elements).carried_by(pressure.reshape(-1)[elements])


def _mean_of_four(relief):
    """Mean of the elements with surface in each two by two elements; −inf without any."""
    quarters = [relief[i::2, j::2] for j in (0, 1) for i in (0, 1)]
    there = np.isfinite(quarters)
    count = there.sum(axis=0)
    total = np.sum(quarters, axis=0, where=there)
    return np.where(count > 0, total / np.maximum(count, 1), -math.inf)
