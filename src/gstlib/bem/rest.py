"""Contact at rest: the body is free to tilt, and the force acts through a given point.

The pressure minimises ½ pᵀKp − pᵀh over p ≥ 0 whose force and moments about the point r₀ equal the
force F: Σ p A = F, Σ p A r = F r₀. The multipliers of these three conditions are the body's
freedoms, so the gap is Kp − (h + c + θ·(r − r₀)), with the tilt θ. The problem is convex. If r₀ is
in the convex hull of the surface, there is one pressure. Otherwise the body tips over.

The solver's iterations keep all three conditions, while a contact on a fixed plane keeps one
(`RestingLoad`). They therefore find the tilt together with the pressure. A contact may have little
or no stiffness against tilting (one summit, two summits), as they do not need it.

They begin at the *rigid* rest. A hard body rests on three summits whose triangle contains r₀, the
facet of the surface's upper hull above it. A linear programme in three unknowns finds them, by the
simplex method (G. B. Dantzig, *Linear Programming and Extensions* (1963), ch. 5). The heights may
therefore be given at any distance from equilibrium.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy

from .errors import ContactInputError, TippingError
from .load import LoadControl
from .window import dot

__all__ = ["RestingLoad", "checked_point", "resting", "tipping"]

# A point so close to the hull (over the grid's size) is in it: rounding of its coordinates.
_ON_HULL = 1e-12
# Pivots of the rigid rest, which is a start only (measured: 2 to 15 on rough faces of 400²).
_MOST_PIVOTS = 60
# An element this little above the plane, relative to the relief, is in it.
_LEVEL = 1e-12
# Steps of Newton's method on the three multipliers (measured: 0 to 2, at most 22 on the coarsest
# grid), and trials in the search along one of them.
_MOST_STEPS = 60
# Moments are met to rounding: of one sum, and of the root of the number of elements.
_ROUNDING, _ROUNDING_PER_ROOT = 1e-14, 4e-16
# Smaller eigenvalues, relative to the largest, are rounding: a contact two elements wide on a grid
# of 1000 still has 1e-6.
_SINGULAR = 1e-12
# Below this share of force times an element's side squared, the contact has no stiffness against a
# tilt. This corresponds to one element with this share of the force, a side away from the others.
_NO_STIFFNESS = 1e-20
# A search along a step ends at this share of the initial slope.
_SMALL_SLOPE = 0.5
# Elements without pressure get this share of the largest as weight, if the others cannot carry the
# force at its point.
_FAINT = 1e-3


@dataclass(frozen=True, eq=False, kw_only=True)
class RestingLoad(LoadControl):
    """A force through a point, on a body that is free to tilt.

    Its `freedoms` are (c, slope_y, slope_x): displacement at the point (mm) and change of height
    over the `length`.

    Attributes
    ----------
    point : ndarray, shape (2,)
        Load point (y, x), in elements from the centre of element (0, 0).
    spacing : ndarray, shape (2,)
        Sides of an element over the `length`.
    length : float
        Longer side of the grid (mm), the unit of lever arms.
    columns : int
        Elements along x.
    supports : ndarray of int
        Flat indices of elements whose hull contains the point.
    softness : float
        Displacement of an element under unit pressure on itself (mm/MPa).
    rigid_tilt : ndarray, shape (2,)
        Slopes (y, x) that bring the rigid surface to rest. They have been added to the heights.
    modes : ndarray, shape (3, n), or None
        For the elements in question (`at`): 1, and lever arms (y, x) about the point over `length`.
    """

    point: np.ndarray
    spacing: np.ndarray
    length: float
    columns: int
    supports: np.ndarray
    softness: float
    rigid_tilt: np.ndarray
    modes: np.ndarray | None = None

    def at(self, elements):
        modes = np.ones((3, elements.size))
        rows, columns = np.divmod(elements, self.columns)
        modes[1] = self.spacing[0] * (rows - self.point[0])
        modes[2] = self.spacing[1] * (columns - self.point[1])
        return replace(self, modes=modes)

    def coarser(self, relief):
        # The coarse elements' centres reach less far out than the fine ones'.
        point = 0.5 * self.point - 0.25
        rest = settle(relief, point)
        if rest is None:
            places = np.argwhere(relief > -math.inf).astype(float)
            away = np.hypot(*(places - point).T)
            rest = settle(relief, places[away.argmin()])
        point, _, supports = rest
        return replace(
            self,
            force=self.force / 4,
            point=point,
            spacing=2 * self.spacing,
            columns=relief.shape[1],
            supports=supports,
            softness=2 * self.softness,
        )

    def followed(self):
        return self.supports

    def decided_by(self, pressure):
        return self._closing(pressure, pressure)[1]

    def freedoms(self, pressure, opening):
        """The plane that closes the contact best, weighted with the pressure.

        If the contact has no stiffness against a tilt, any element in question may decide it, as in
        a step along the projected gradient.
        """
        freedoms, firm = self._closing(pressure, opening)
        if firm:
            return freedoms
        lift = np.full(pressure.size, 1 / self.softness)
        return self._lifted(pressure - opening * lift, lift, freedoms)[1]

    def _closing(self, pressure, opening):
        """The plane of the contact alone, and whether the contact decides it."""
        force = float(pressure.sum())
        centre = np.einsum("in,n->i", self.modes[1:], pressure) / force
        arms = self.modes[1:] - centre[:, None]
        level, tilt, firm = dot(pressure, opening) / force, np.zeros(2), True
        remaining = opening - level
        # Along the stiffest direction first, so that the remaining direction is free of its
        # rounding.
        _, directions = np.linalg.eigh(np.einsum("in,jn,n->ij", arms, arms, pressure))
        for direction in directions.T[::-1]:
            arm = np.einsum("i,in->n", direction, arms)
            stiffness = dot(pressure * arm, arm)
            if stiffness <= _NO_STIFFNESS * force * self.spacing.min() ** 2:
                firm = False
                continue
            slope = dot(pressure * arm, remaining) / stiffness
            remaining = remaining - slope * arm
            tilt += slope * direction
        return np.array([level - centre @ tilt, *tilt]), firm

    def rigid(self, freedoms):
        return np.einsum("in,i->n", self.modes, freedoms)

    def plane(self, freedoms, shape):
        """c + θ·(r − r₀) (mm) on the whole grid, shape (ny, nx)."""
        level, *slopes = freedoms
        return _plane(shape, self.point, level, *(self.spacing * slopes))

    def tilt(self, freedoms):
        return tuple((self.rigid_tilt + freedoms[1:] / self.length).tolist())

    def deepest(self, rigid, relief):
        return float((rigid + relief).max())

    def balanced(self, direction, lift):
        excess = np.einsum("in,n->i", self.modes, direction)
        shift, _ = _solved(self._stiffness(lift), excess)
        return direction - lift * self.rigid(shift)

    def admissible(self, trial, lift):
        return self._lifted(trial, lift)[0]

    def carried_by(self, pressure):
        if not pressure.any():
            return False
        scaled = pressure / pressure.max()
        scaled *= self.force / scaled.sum()
        return self._lifted(scaled, scaled)[2]

    def scaled(self, pressure):
        scaled, _, met = self._lifted(pressure, pressure)
        if not met:
            scaled, _, _ = self._lifted(pressure, pressure + _FAINT * pressure.max())
        return scaled

    def eccentricity(self, pressure):
        moments = np.einsum("in,n->i", self.modes[1:], pressure)
        return float(np.hypot(*moments) / pressure.sum())

    def _lifted(self, trial, lift, shift=0.0):
        """max(trial + lift·(modes·s), 0) with the three numbers s that meet the load.

        It is the pressure nearest to `trial` that the load allows, with squared distances weighted
        by 1/lift. s minimises a convex function whose gradient is the excess of force and moments.
        Newton's method starts from `shift`, with a search along each step. Returns pressure, s, and
        whether the load is met.
        """
        shift = shift + np.zeros(3)
        pressure, excess = self._tried(trial, lift, shift)
        close = _ROUNDING + _ROUNDING_PER_ROOT * math.sqrt(trial.size)
        for _ in range(_MOST_STEPS):
            if np.abs(excess).max() <= close * self.force:
                return pressure, shift, True
            stiffness = self._stiffness(lift * (pressure > 0))
            step, firm = _solved(stiffness, -excess)
            if not firm:
                # As far as it takes until elements out of contact join and resist.
                stiffness = stiffness + _FAINT**2 * self._stiffness(lift)
                step, _ = _solved(stiffness, -excess)
            slope = float(excess @ step)
            if not slope < 0:
                break
            shift, pressure, excess = self._searched(trial, lift, shift, step, slope)
        return pressure, shift, False

    def _searched(self, trial, lift, shift, step, slope):
        """Go along a step until the slope is small, by false position and doubling."""
        low, high, length = (0.0, slope), None, 1.0
        for _ in range(_MOST_STEPS):
            pressure, excess = self._tried(trial, lift, shift + length * step)
            reached = float(excess @ step)
            if abs(reached) <= -_SMALL_SLOPE * slope:
                break
            if reached > 0:
                high = length, reached
            else:
                low = length, reached
            if high is None:
                length *= 2
                continue
            share = low[1] / (low[1] - high[1])
            length = low[0] + min(max(share, 0.1), 0.9) * (high[0] - low[0])
        return shift + length * step, pressure, excess

    def _tried(self, trial, lift, shift):
        """Pressure at one shift, and by how much its force and moments exceed the load's."""
        pressure = np.maximum(trial + lift * self.rigid(shift), 0.0)
        excess = np.einsum("in,n->i", self.modes, pressure)
        excess[0] -= self.force
        return pressure, excess

    def _stiffness(self, weights):
        return np.einsum("in,jn,n->ij", self.modes, self.modes, weights)


def _solved(matrix, right):
    """Solution of a small symmetric system, least if singular, and whether it is not singular."""
    values, vectors = np.linalg.eigh(matrix)
    firm = values > _SINGULAR * values[-1]
    scaled = (right @ vectors)[firm] / values[firm]
    return vectors[:, firm] @ scaled, bool(firm.all())


def checked_point(load_point) -> np.ndarray:
    """A point (y, x) of finite numbers (mm)."""
    try:
        point = np.array(load_point, dtype=float)
    except (TypeError, ValueError):
        point = np.zeros(0)
    if point.shape != (2,) or not np.isfinite(point).all():
        raise ContactInputError(
            f"load_point must be a point (y, x) in mm, got {load_point!r}"
        )
    return point


def resting(relief, half_space, force, load_point):
    """The load of a force through a point.

    Parameters
    ----------
    relief : ndarray, shape (ny, nx)
        Heights (mm); −inf where there is no surface.
    half_space : HalfSpace
    force : float
        Sum of the elements' pressures (MPa).
    load_point : ndarray, shape (2,)
        Point of the force (y, x), from the grid's corner (mm).

    Returns
    -------
    RestingLoad

    Raises
    ------
    ContactInputError
        The point is not in the hull of the elements with surface.
    """
    spacing = np.array(half_space.spacing)
    rest = settle(relief, load_point / spacing - 0.5)
    if rest is None:
        why = "is outside the outline of the surface: move it inward"
        raise TippingError(tipping(load_point, why))
    point, slopes, supports = rest
    length = float((relief.shape * spacing).max())
    return RestingLoad(
        force=force,
        point=point,
        spacing=spacing / length,
        length=length,
        columns=relief.shape[1],
        supports=supports,
        softness=half_space.self_influence,
        rigid_tilt=-slopes / spacing,
    )


def tipping(load_point, why):
    """The sentence for a body that does not come to rest."""
    y, x = load_point
    return f"the stone tips over: the load point (y, x) = ({y:g}, {x:g}) mm {why}"


def settle(relief, point):
    """The rigid rest of a surface on a plane, under a force through a point.

    Parameters
    ----------
    relief : ndarray, shape (ny, nx)
        Heights (mm); −inf where there is no surface.
    point : ndarray, shape (2,)
        (y, x) in elements from the centre of element (0, 0).

    Returns
    -------
    None if the point is not in the hull of the elements with surface. Otherwise the point, moved by
    rounding at most, the plane's slopes along y and x (mm per element), shape (2,), and the flat
    indices of the elements that carry the force.
    """
    shares, corners = _triangle(_hull(relief > -math.inf), point)
    if corners is None:
        return None
    point, slopes = shares @ corners, np.zeros(2)
    # Directions in which the surface extends: two, one if all of it is on a line, or none.
    along = np.linalg.qr((corners[1:] - corners[0]).T)[0]
    for _ in range(_MOST_PIVOTS):
        system = np.column_stack((np.ones(len(corners)), (corners - point) @ along))
        rows, columns = corners.T.astype(int)
        try:
            level, *plane = np.linalg.solve(system, relief[rows, columns])
            slopes = along @ plane
            above = relief - _plane(relief.shape, point, level, *slopes)
            highest = np.unravel_index(above.argmax(), relief.shape)
            if above[highest] <= _LEVEL * np.ptp(relief[rows, columns]):
                break
            entering = np.array(highest, dtype=float)
            lever = (entering - point) @ along
            needed = np.linalg.solve(system.T, [1.0, *lever])
        except np.linalg.LinAlgError:
            break  # three in a line
        # The entering summit takes force until the force on one of the three is zero.
        ratios = np.full(len(shares), math.inf)
        np.divide(shares, needed, out=ratios, where=needed > _LEVEL)
        leaving = int(ratios.argmin())
        share = ratios[leaving]
        shares = np.maximum(shares - share * needed, 0.0)
        shares[leaving] = share
        corners[leaving] = entering
    rows, columns = corners.T.astype(int)
    return point, slopes, np.unique(rows * relief.shape[1] + columns)


def _plane(shape, point, level, slope_y, slope_x):
    """A plane on the whole grid (mm): its level at a point, and slopes per element."""
    y = np.arange(shape[0]) - point[0]
    x = np.arange(shape[1]) - point[1]
    return level + slope_y * y[:, None] + slope_x * x


def _hull(surface):
    """Corners (row, column) of the convex hull of a mask, in order."""
    rows = np.flatnonzero(surface.any(axis=1))
    first = surface[rows].argmax(axis=1)
    last = surface.shape[1] - 1 - surface[rows, ::-1].argmax(axis=1)
    ends = np.concatenate(([rows, first], [rows, last]), axis=1).T
    ends = np.unique(ends, axis=0).astype(float)
    try:
        return ends[scipy.spatial.ConvexHull(ends).vertices]
    except scipy.spatial.QhullError:  # all on a line
        return ends[np.unique([0, len(ends) - 1])]


def _triangle(corners, point):
    """Shares and corners of a part of a convex polygon around a point, or None outside."""
    # Lever arms about the point over the grid's size: rounding is the same on a grid of any size.
    size = max(corners.max(), 1.0)
    fan = [corners[[0, k, k + 1]] for k in range(1, len(corners) - 1)]
    for part in fan or [corners]:
        arms = (part - point) / size
        system = np.column_stack((np.ones(len(part)), arms))
        shares = np.linalg.lstsq(system.T, [1.0, 0.0, 0.0])[0]
        shares[shares < _ON_HULL] = 0.0
        shares /= shares.sum()
        if np.abs(shares @ arms).max() <= _ON_HULL:
            return shares, part
    return None, None
