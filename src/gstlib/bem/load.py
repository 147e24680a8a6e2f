"""The load of a contact: a displacement or a force, and a cap on the pressure."""

import math
from dataclasses import dataclass, replace

import numpy as np

from .window import dot

__all__ = ["LoadControl"]


@dataclass(frozen=True)
class LoadControl:
    """Displacement or force control, with the other one None.

    Attributes
    ----------
    displacement : float or None
        Far-field displacement (mm).
    force : float or None
        Sum of the elements' pressures (MPa).
    pressure_cap : float
        Cap on the pressure (MPa), may be infinite.

    Notes
    -----
    Vectors contain the elements that the load is `at`: pressures in MPa, and openings Kp + (h_max −
    h) in mm. `freedoms` are what the load leaves free: here the displacement (mm).
    """

    displacement: float | None = None
    force: float | None = None
    pressure_cap: float = math.inf

    def coarser(self, relief):
        """The same load on elements twice as long, with their relief (mm)."""
        return self if self.force is None else replace(self, force=self.force / 4)

    def at(self, elements):
        """The load on the elements of these flat indices."""
        return self

    def freedoms(self, pressure, opening):
        """Displacement that closes the contact."""
        if self.displacement is not None:
            return self.displacement
        elastic = pressure * (pressure < self.pressure_cap)
        force = float(elastic.sum())
        if force > 0:
            return dot(elastic, opening) / force
        # All contact is at the limit: any displacement from here to the next touch would do.
        return float(opening[pressure > 0].max())

    def followed(self):
        """Flat indices of elements to follow however far they are from contact."""
        return np.zeros(0, np.intp)

    def decided_by(self, pressure):
        """Whether this pressure, without elements out of contact, decides the freedoms."""
        return True

    def rigid(self, freedoms):
        """Displacement of the rigid surface at the elements (mm)."""
        return freedoms

    def plane(self, freedoms, shape):
        """The same on the whole grid."""
        return freedoms

    def tilt(self, freedoms):
        """Slopes (y, x) of the surface in the contact."""
        return 0.0, 0.0

    def eccentricity(self, pressure):
        """Distance of the pressure's resultant from its required point, over the grid's side."""
        return 0.0

    def deepest(self, rigid, relief):
        """Largest rigid interpenetration of the elements (mm)."""
        return rigid

    def balanced(self, direction, lift):
        """A direction that keeps the load, by a share of `lift` ≥ 0."""
        return direction - lift * (direction.sum() / lift.sum())

    def admissible(self, trial, lift):
        """The pressure nearest to `trial` within its bounds, raised along `lift` ≥ 0 to the force.

        clip(trial + c·lift, 0, limit) with the number c for which its sum is the force.
        """
        limit, force = self.pressure_cap, self.force
        pressure = trial.clip(0.0, limit)
        if force is None:
            return pressure
        moving = lift > 0
        if not moving.any():
            return pressure
        # The sum increases with c and is piecewise linear: Newton's method between bounds.
        shift = 0.0
        low = (-trial[moving] / lift[moving]).min()
        high = ((min(force, limit) - trial[moving]) / lift[moving]).max()
        for _ in range(200):
            excess = float(pressure.sum()) - force
            if abs(excess) <= 1e-14 * force:
                break
            low, high = (low, shift) if excess > 0 else (shift, high)
            inside = (pressure > 0) & (pressure < limit)
            slope = dot(lift, inside.astype(float))
            shift = shift - excess / slope if slope > 0 else math.inf
            if not low < shift < high:
                shift = 0.5 * (low + high)
            pressure = (trial + shift * lift).clip(0.0, limit)
        return pressure

    def carried_by(self, pressure):
        """Whether a pressure ≥ 0 can be scaled to the force within its limit."""
        if self.force is None:
            return True
        count = np.count_nonzero(pressure)
        return count > 0 and count * self.pressure_cap > self.force

    def scaled(self, pressure):
        """A pressure ≥ 0 scaled to the force, except at the limit. It may be unchanged."""
        pressure = np.minimum(pressure, self.pressure_cap)
        if self.force is None:
            return pressure
        lift = pressure * (pressure < self.pressure_cap)
        return self.admissible(pressure, lift if lift.any() else pressure)
