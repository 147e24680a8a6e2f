"""Contacts with a solution in closed form: frictionless, half-space, small strain.

They serve to check a solver, a mesh or a unit. Forces are in N, lengths in mm, pressures and moduli
in MPa, and E* is the contact modulus. Positions are measured from the centre of the contact.
Pressures are zero out of contact, displacements positive into the half-space.

Sources: K. L. Johnson, *Contact Mechanics* (1985), cited by equation; A. W. Bush, R. D. Gibson & T.
R. Thomas, Wear 35 (1975) 87; B. N. J. Persson, J. Chem. Phys. 115 (2001) 3840.
"""

import math
from dataclasses import dataclass

import numpy as np

__all__ = ["BUSH_SLOPE", "PERSSON_SLOPE", "Sphere", "persson_contact_fraction"]

PERSSON_SLOPE = math.sqrt(8 / math.pi)
"""Contact fraction over p̄/(E* h'rms) of a rough surface under small loads, by Persson."""

BUSH_SLOPE = math.sqrt(2 * math.pi)
"""The same by Bush, Gibson and Thomas, from the statistics of summits."""


@dataclass(frozen=True)
class Sphere:
    """Hertz: a sphere of a `radius` R (mm) on a flat. Johnson, eqs. 4.22-4.24.

    For two spheres, 1/R = 1/R₁ + 1/R₂.
    """

    force: float
    radius: float
    contact_modulus: float

    @property
    def contact_radius(self) -> float:
        """a = (3PR/4E*)^⅓ (mm)."""
        return (0.75 * self.force * self.radius / self.contact_modulus) ** (1 / 3)

    @property
    def peak_pressure(self) -> float:
        """p₀ = 3P/2πa² (MPa)."""
        return 1.5 * self.force / (math.pi * self.contact_radius**2)

    def pressure(self, x, y):
        """Pressure (MPa) at (x, y) (mm), zero out of contact. Arguments broadcast."""
        inside = 1 - (x**2 + y**2) / self.contact_radius**2
        return self.peak_pressure * np.sqrt(np.maximum(inside, 0.0))

    def stick_radius(self, tangential_ratio: float) -> float:
        """c = a (1 − Q/µP)^⅓ (mm), under a share Q/µP of the force that makes the sphere slide.

        Cattaneo and Mindlin; Johnson, eq. 7.44.
        """
        return self.contact_radius * (1 - tangential_ratio) ** (1 / 3)


def persson_contact_fraction(
    mean_pressure: float, rms_gradient: float, contact_modulus: float
) -> float:
    """Contact fraction of a rough surface under p̄ (MPa): erf(√2 p̄ / E* h'rms), by Persson."""
    return math.erf(math.sqrt(2) * mean_pressure / (contact_modulus * rms_gradient))
