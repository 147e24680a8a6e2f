"""Closed-form contacts, to check solvers against: frictionless, half-space, small strain.

Forces in N, lengths in mm, pressures and moduli in MPa; E* is the contact modulus. Positions are
measured from the centre of the contact; pressures are zero out of contact.

Sources: K. L. Johnson, *Contact Mechanics* (1985), cited by equation; I. N. Sneddon, Int. J. Eng.
Sci. 3 (1965) 47; K. L. Johnson, J. A. Greenwood & J. G. Higginson, Int. J. Mech. Sci. 27 (1985)
383.
"""

import math
from dataclasses import dataclass

import numpy as np

__all__ = [
    "SQUARE_PUNCH_STIFFNESS",
    "Cone",
    "Ellipsoid",
    "crossed_waves_full_contact_pressure",
    "full_contact_rms_pressure",
    "love_rectangle_displacement",
]

SQUARE_PUNCH_STIFFNESS = 1.1523
"""Force over displacement of a flat square punch, in units of E* times its side.

The limit that uniform square elements approach from below (1.1462, 1.1492, 1.1507 at 64, 128 and
256 elements a side, first order in the element).
"""


@dataclass(frozen=True)
class Ellipsoid:
    """Hertz: radii `radius_x` ≠ `radius_y` (mm) under `force` (N). Johnson, eqs. 4.25-4.26."""

    force: float
    radius_x: float
    radius_y: float
    contact_modulus: float

    @property
    def semi_axes(self) -> tuple[float, float]:
        """Half-axes of the contact along x and y (mm)."""
        long, short = self._long_short()
        return (long, short) if self.radius_x > self.radius_y else (short, long)

    @property
    def peak_pressure(self) -> float:
        """p₀ = 3P/2πab (MPa)."""
        long, short = self._long_short()
        return 1.5 * self.force / (math.pi * long * short)

    @property
    def displacement(self) -> float:
        """δ = (p₀/E*) b K(e) (mm)."""
        from scipy.special import ellipk

        _, short = self._long_short()
        return (
            self.peak_pressure
            / self.contact_modulus
            * short
            * ellipk(self._eccentricity() ** 2)
        )

    def pressure(self, x, y):
        """Pressure at (x, y) (mm); broadcasts."""
        a, b = self.semi_axes
        return self.peak_pressure * _root(1 - (x / a) ** 2 - (y / b) ** 2)

    def _eccentricity(self):
        from scipy.special import ellipe, ellipk

        radii = self.radius_x, self.radius_y
        ratio = max(radii) / min(radii)
        low, high = 0.0, 1.0
        for _ in range(60):
            e = 0.5 * (low + high)
            K, E = ellipk(e * e), ellipe(e * e)
            found = (E / (1 - e * e) - K) / (K - E)
            low, high = (e, high) if found < ratio else (low, e)
        return e

    def _long_short(self):
        from scipy.special import ellipe, ellipk

        e = self._eccentricity()
        curvature = 1 / (2 * max(self.radius_x, self.radius_y))
        difference = ellipk(e * e) - ellipe(e * e)
        cube = (
            1.5 * self.force * difference / (math.pi * self.contact_modulus * e * e * curvature)
        )
        long = cube ** (1 / 3)
        return long, long * math.sqrt(1 - e * e)


@dataclass(frozen=True)
class Cone:
    """Sneddon: a cone of `half_angle` α (rad, from its axis) under `force` (N)."""

    force: float
    half_angle: float
    contact_modulus: float

    @property
    def displacement(self) -> float:
        """δ (mm), P = (2/π) E* δ² tan α."""
        tangent = math.tan(self.half_angle)
        return math.sqrt(0.5 * math.pi * self.force / (self.contact_modulus * tangent))

    @property
    def contact_radius(self) -> float:
        """a = (2/π) δ tan α (mm)."""
        return 2 / math.pi * self.displacement * math.tan(self.half_angle)

    def pressure(self, x, y):
        """p = E* acosh(a/r) / (2 tan α) (MPa); infinite at the tip."""
        distance = np.hypot(x, y)
        with np.errstate(divide="ignore"):
            ratio = np.maximum(self.contact_radius / distance, 1.0)
        return self.contact_modulus / (2 * math.tan(self.half_angle)) * np.arccosh(ratio)


def crossed_waves_full_contact_pressure(amplitude, wavelength, contact_modulus) -> float:
    """Mean pressure (MPa) that closes Δ cos(2πx/λ) cos(2πy/λ): √2 πE*Δ/λ (Johnson et al. 1985)."""
    return math.sqrt(2) * math.pi * contact_modulus * amplitude / wavelength


def full_contact_rms_pressure(rms_gradient, contact_modulus) -> float:
    """Standard deviation of pressure (MPa) in full contact with a rough surface: E* h'rms / 2.

    Each wave vector q of the surface takes the pressure E*|q|/2 per height (Johnson, §13.2).
    """
    return 0.5 * contact_modulus * rms_gradient


def love_rectangle_displacement(x, y, sides, pressure, contact_modulus):
    """Displacement (mm) at (x, y) on the surface under a uniform pressure on a rectangle.

    Love; Johnson, eq. 3.25. `sides` (mm) are the rectangle's lengths along x and y, its centre is
    the origin. Not on the edges' lines themselves.
    """
    left, right = x + sides[0] / 2, x - sides[0] / 2
    top, bottom = y + sides[1] / 2, y - sides[1] / 2

    def corner(a, b):
        return a * np.arcsinh(b / np.abs(a)) + b * np.arcsinh(a / np.abs(b))

    integral = (
        corner(left, top) - corner(left, bottom) - corner(right, top) + corner(right, bottom)
    )
    return pressure * integral / (math.pi * contact_modulus)


def _root(value):
    return np.sqrt(np.maximum(value, 0.0))
