"""The state of a solved contact."""

import math
from dataclasses import dataclass

import numpy as np

__all__ = ["ContactState"]


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
        any pressure field of the same force could still gain; whether the force is that of a
        given displacement, the residual tells.
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
        if self.pressure_limit == math.inf:
            return self.contact
        return self.contact & (self.pressure < self.pressure_limit)

    @property
    def contact(self) -> np.ndarray:
        """Mask of the real contact, p > 0; bool, shape (ny, nx)."""
        return self.pressure > 0
