"""A solved contact: its fields, and the numbers that they come to."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

__all__ = ["ContactState"]

# Elements from the border that form its rim, which carries extra load if the body ends there.
_RIM = 3
# A side of an element adds this share of an element to the area of a smooth contact, on average.
_PIXELS = (math.pi - 1 + math.log(2)) / 24


@dataclass(frozen=True, eq=False, repr=False)
class ContactState:
    """A solved contact. Gap and residual are recomputed from the pressure.

    Attributes
    ----------
    pressure : ndarray or DataArray, shape (ny, nx)
        Contact pressure (MPa), ≥ 0, zero out of contact.
    gap : ndarray or DataArray, shape (ny, nx)
        Kp − w (mm): zero in contact and positive elsewhere, within `residual` × `displacement`. It
        is inf where the surface is missing.
    displacement : float
        Far-field displacement δ from first touch at the highest summit (mm). It equals the largest
        rigid interpenetration.
    mean_pressure : float
        Total force over nominal area (MPa).
    contact_fraction : float
        Share of elements with p > 0.
    iterations, convolutions : int
        Spent on the finest grid, the final check included.
    residual : float
        Largest of abs(gap) where p > 0 and of −gap where p = 0, divided by `displacement`.
    pressure_cap : float
        The requested cap (MPa). If the pressure reaches it, −gap is the depth by which the surface
        has yielded.
    tilt : (float, float)
        Slopes (y, x) by which the surface has tilted. This is the contact of heights + tilt·(r −
        load_point), and `displacement` is counted from their highest summit. It is zero without
        `load_point`, and the tilt of the rigid rest without force.
    moment_residual : float
        Distance between the pressure's centre Σ p r/Σ p and `load_point`, over the longer side of
        the grid. It is computed from the final pressure in double precision, and at most the
        tolerance. It is zero without such a point.
    periodic : bool
        Whether the surface repeats itself.
    """

    pressure: Any
    gap: Any
    displacement: float
    mean_pressure: float
    contact_fraction: float
    iterations: int = 0
    convolutions: int = 0
    residual: float = 0.0
    pressure_cap: float = math.inf
    tilt: tuple[float, float] = (0.0, 0.0)
    moment_residual: float = 0.0
    periodic: bool = False

    def __repr__(self) -> str:
        ny, nx = self.pressure.shape
        return (
            f"{type(self).__name__}({ny} × {nx} elements, {self.mean_pressure:.4g} MPa, "
            f"displacement {self.displacement:.4g} mm, contact {self.contact_fraction:.3%}, "
            f"residual {self.residual:.1e})"
        )

    @property
    def capped_fraction(self) -> float:
        """Share of the contact whose pressure is at the limit, 0 without contact."""
        pressure = np.asarray(self.pressure)
        at_limit = pressure[pressure > 0] >= self.pressure_cap
        return float(at_limit.mean()) if at_limit.size else 0.0

    @property
    def contact(self) -> Any:
        """Mask of the real contact, p > 0, bool, shape (ny, nx), like the pressure."""
        return self.pressure > 0

    def like(self, field: Callable[[str, np.ndarray], Any]) -> "ContactState":
        """The same with fields as their heights were given, see ``gstlib.bem.fields``."""
        pressure = field("pressure", self.pressure)
        if pressure is self.pressure:
            return self
        return replace(self, pressure=pressure, gap=field("gap", self.gap))

    @property
    def rim_fraction(self) -> float:
        """Share of the force on the outer three elements of the grid, unless it is periodic."""
        return self._on_rim(np.asarray(self.pressure))

    @property
    def rim_area(self) -> float:
        """Share of these elements in the grid."""
        return self._on_rim(np.ones(self.pressure.shape))

    def _on_rim(self, field):
        total = float(field.sum())
        inner = float(field[_RIM:-_RIM, _RIM:-_RIM].sum())
        return 0.0 if self.periodic or not total else 1 - inner / total

    @property
    def corrected_fraction(self) -> float:
        """Contact fraction without the excess of an edge made of square elements' sides.

        A/A₀ − ((π − 1 + ln 2)/24) S Δx/A₀ with the perimeter S counted along the sides
        (V. A. Yastrebov, G. Anciaux & J.-F. Molinari, Tribol. Int. 114 (2017) 161).
        """
        contact = np.asarray(self.contact)
        around = np.pad(contact, ((0, 1), (0, 1)), "wrap" if self.periodic else "edge")
        sides = np.count_nonzero(np.diff(around, axis=0)[:, :-1])
        sides += np.count_nonzero(np.diff(around, axis=1)[:-1])
        return float(np.count_nonzero(contact) - _PIXELS * sides) / contact.size
