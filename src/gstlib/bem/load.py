"""What holds a contact: a displacement or a force, and a ceiling on the pressure."""

import math
from dataclasses import dataclass, replace

import numpy as np

from .algebra import dot

__all__ = ["Load"]


@dataclass(frozen=True)
class Load:
    """Displacement or force control; one of the two is None.

    Attributes
    ----------
    displacement : float or None
        Far-field displacement (mm).
    force : float or None
        Sum of the elements' pressures (MPa).
    pressure_limit : float
        Ceiling on the pressure (MPa), may be infinite.
    """

    displacement: float | None
    force: float | None
    pressure_limit: float

    def coarser(self):
        """The same load on elements of twice the length."""
        return self if self.force is None else replace(self, force=self.force / 4)

    def displacement_at(self, pressure, opening) -> float:
        """Displacement that closes the contact, from the opening Kp + (h_max − h)."""
        if self.displacement is not None:
            return self.displacement
        elastic = pressure
        if self.pressure_limit < math.inf:
            elastic = pressure * (pressure < self.pressure_limit)
        force = float(elastic.sum())
        if force > 0:
            return dot(elastic, opening) / force
        # All contact is at the limit: any displacement from here to the next touch would do.
        return float(opening[pressure > 0].max())

    def admissible(self, trial, lift):
        """The pressure nearest to `trial` within its bounds, raised along `lift` ≥ 0 to the force.

        clip(trial + c·lift, 0, limit) with the number c for which its sum is the force.
        """
        limit, force = self.pressure_limit, self.force
        pressure = self._bounded(trial)
        if force is None:
            return pressure
        moving = lift > 0
        if not moving.any():
            return pressure
        shift, low, high = 0.0, -math.inf, math.inf
        if limit < math.inf:
            low, high = self._bounds(trial[moving], lift[moving])
        for _ in range(200):
            excess = float(pressure.sum()) - force
            if abs(excess) <= 1e-14 * force:
                break
            # The sum increases with c, piece by piece linear: Newton's method between bounds, which
            # without a limit, the sum being convex, are only needed where it starts on no slope.
            low, high = (low, shift) if excess > 0 else (shift, high)
            inside = pressure > 0
            if limit < math.inf:
                inside &= pressure < limit
            slope = dot(lift, inside.astype(float))
            shift = shift - excess / slope if slope > 0 else math.inf
            if not low < shift < high:
                if not math.isfinite(high - low):
                    lowest, highest = self._bounds(trial[moving], lift[moving])
                    low, high = max(low, lowest), min(high, highest)
                shift = 0.5 * (low + high)
            pressure = self._bounded(trial + shift * lift)
        return pressure

    def _bounds(self, trial, lift):
        """Numbers c for which trial + c·lift is nowhere positive; or has the force everywhere."""
        highest = min(self.force, self.pressure_limit)
        return (-trial / lift).min(), ((highest - trial) / lift).max()

    def _bounded(self, trial):
        pressure = np.maximum(trial, 0.0)
        return (
            pressure if self.pressure_limit == math.inf else pressure.clip(max=self.pressure_limit)
        )

    def carried_by(self, pressure) -> bool:
        """Whether a pressure ≥ 0 can be scaled to the force within its limit."""
        if self.force is None:
            return True
        if self.pressure_limit == math.inf:
            return bool(pressure.any())
        return np.count_nonzero(pressure) * self.pressure_limit > self.force

    def scaled(self, pressure):
        """A pressure ≥ 0 scaled to the force, but for what is at the limit; maybe itself."""
        lift = pressure
        if self.pressure_limit < math.inf:
            pressure = np.minimum(pressure, self.pressure_limit)
            lift = pressure * (pressure < self.pressure_limit)
        if self.force is None:
            return pressure
        return self.admissible(pressure, lift if lift.any() else pressure)

    def least_work(self, gap, force) -> float:
        """Least Σ s·g of the fields 0 ≤ s ≤ limit with the sum `force`, or 0 if that is less."""
        if self.pressure_limit == math.inf:
            return force * min(gap.min(), 0.0)
        full, rest = divmod(force / self.pressure_limit, 1)
        lowest = np.sort(gap, axis=None)[: int(full) + 1]
        work = lowest[: int(full)].sum() + rest * lowest[-1]
        return min(self.pressure_limit * work, 0.0)
