"""Contacts with a solution in closed form: frictionless, half-space, small strain.

They serve to check a solver, a mesh or a unit. Forces are in N, lengths in mm, pressures and moduli
in MPa, and E* is the contact modulus. Positions are measured from the centre of the contact.
Pressures are zero out of contact, displacements positive into the half-space.

Sources: K. L. Johnson, *Contact Mechanics* (1985), cited by equation; I. N. Sneddon, Int. J. Eng.
Sci. 3 (1965) 47; H. M. Westergaard, J. Appl. Mech. 6 (1939) A49; K. L. Johnson, J. A. Greenwood &
J. G. Higginson, Int. J. Mech. Sci. 27 (1985) 383; A. W. Bush, R. D. Gibson & T. R. Thomas, Wear 35
(1975) 87; B. N. J. Persson, J. Chem. Phys. 115 (2001) 3840; J. A. Greenwood & J. B. P. Williamson,
Proc. R. Soc. A 295 (1966) 300; J. I. McCool, Wear 107 (1986) 37.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from .roughness import Roughness

__all__ = [
    "BUSH_SLOPE",
    "PERSSON_SLOPE",
    "SQUARE_PUNCH_STIFFNESS",
    "Cone",
    "Ellipsoid",
    "GreenwoodWilliamson",
    "Indenter",
    "RoundPunch",
    "Sphere",
    "Wave",
    "crossed_waves_full_contact_pressure",
    "crossed_waves_heavy_contact",
    "crossed_waves_light_contact",
    "full_contact_rms_pressure",
    "love_rectangle_displacement",
    "persson_contact_fraction",
    "persson_pressure_density",
]

SQUARE_PUNCH_STIFFNESS = 1.1523
"""Force over displacement of a flat square punch, in units of E* times its side.

The limit that uniform square elements approach from below (1.1462, 1.1492, 1.1507 at 64, 128 and
256 elements a side, first order in the element).
"""

PERSSON_SLOPE = math.sqrt(8 / math.pi)
"""Contact fraction over p̄/(E* h'rms) of a rough surface under small loads, by Persson."""

BUSH_SLOPE = math.sqrt(2 * math.pi)
"""The same by Bush, Gibson and Thomas, from the statistics of summits."""


class Indenter:
    """A body pressed on a flat by a `force` P (N), with a `contact_modulus` E* (MPa)."""

    force: float
    contact_modulus: float

    def pressure(self, x, y):
        """Pressure (MPa) at (x, y) (mm), zero out of contact. Arguments broadcast."""
        raise NotImplementedError


@dataclass(frozen=True)
class Sphere(Indenter):
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

    @property
    def displacement(self) -> float:
        """δ = a²/R (mm)."""
        return self.contact_radius**2 / self.radius

    @property
    def stiffness(self) -> float:
        """dP/dδ = 2E*a (N/mm)."""
        return 2 * self.contact_modulus * self.contact_radius

    def pressure(self, x, y):
        return self.peak_pressure * _root(1 - (x**2 + y**2) / self.contact_radius**2)

    def stick_radius(self, tangential_ratio: float) -> float:
        """c = a (1 − Q/µP)^⅓ (mm), under a share Q/µP of the force that makes the sphere slide.

        Cattaneo and Mindlin; Johnson, eq. 7.44.
        """
        return self.contact_radius * (1 - tangential_ratio) ** (1 / 3)


@dataclass(frozen=True)
class Ellipsoid(Indenter):
    """Hertz: a body with the radii `radius_x` and `radius_y` (mm). Johnson, eqs. 4.25-4.26.

    The radii are the radii of curvature along x and y. Equal ones are a `Sphere`.
    """

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
        _, short = self._long_short()
        integral = scipy.special.ellipk(self._eccentricity() ** 2)
        return self.peak_pressure / self.contact_modulus * short * float(integral)

    def pressure(self, x, y):
        a, b = self.semi_axes
        return self.peak_pressure * _root(1 - (x / a) ** 2 - (y / b) ** 2)

    def _eccentricity(self) -> float:
        radii = self.radius_x, self.radius_y
        ratio = max(radii) / min(radii)
        low, high = 0.0, 1.0
        for _ in range(60):
            e = 0.5 * (low + high)
            K = scipy.special.ellipk(e * e)
            E = scipy.special.ellipe(e * e)
            smaller = (E / (1 - e * e) - K) / (K - E) < ratio
            low, high = (e, high) if smaller else (low, e)
        return e

    def _long_short(self) -> tuple[float, float]:
        e = self._eccentricity()
        curvature = 1 / (2 * max(self.radius_x, self.radius_y))
        difference = float(scipy.special.ellipk(e * e) - scipy.special.ellipe(e * e))
        below = math.pi * self.contact_modulus * e * e * curvature
        long = (1.5 * self.force * difference / below) ** (1 / 3)
        return long, long * math.sqrt(1 - e * e)


@dataclass(frozen=True)
class Cone(Indenter):
    """Sneddon: a cone whose sides have a `half_angle` α (rad) from its axis."""

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
        """p = E* acosh(a/r) / (2 tan α) (MPa) at (x, y) (mm), infinite at the tip."""
        distance = np.hypot(x, y)
        with np.errstate(divide="ignore"):
            ratio = np.maximum(self.contact_radius / distance, 1.0)
        return (
            self.contact_modulus / (2 * math.tan(self.half_angle)) * np.arccosh(ratio)
        )


@dataclass(frozen=True)
class RoundPunch(Indenter):
    """A rigid flat punch, a circle of a `radius` a (mm). Johnson, eqs. 3.34-3.36 and 5.36."""

    force: float
    radius: float
    contact_modulus: float

    @property
    def displacement(self) -> float:
        """δ = P/2aE* (mm)."""
        return self.force / (2 * self.radius * self.contact_modulus)

    def pressure(self, x, y):
        """p = P / (2πa √(a² − r²)) (MPa) at (x, y) (mm); infinite at the edge, 0 beyond it."""
        inside = self.radius**2 - np.square(x) - np.square(y)
        with np.errstate(divide="ignore"):
            value = self.force / (2 * math.pi * self.radius * _root(inside))
        return np.where(inside >= 0, value, 0.0)

    def tilt(self, offset: float) -> float:
        """θ = 3Pd/4E*a³ (rad), the force acting `offset` d (mm) from the axis.

        All of the punch stays in contact while d ≤ a/3.
        """
        return 0.75 * self.force * offset / (self.contact_modulus * self.radius**3)


@dataclass(frozen=True)
class Wave:
    """Westergaard: Δ cos(2πx/λ) on a flat, without end. Johnson, sect. 13.2.

    The `amplitude` is Δ, the `wavelength` λ (mm).
    """

    amplitude: float
    wavelength: float
    contact_modulus: float

    @property
    def full_contact_pressure(self) -> float:
        """p* = πE*Δ/λ (MPa), the mean pressure that closes it."""
        return math.pi * self.contact_modulus * self.amplitude / self.wavelength

    def contact_fraction(self, mean_pressure: float) -> float:
        """2a/λ, with p̄ = p* sin²(πa/λ) (MPa); 1 from p* on."""
        share = min(mean_pressure / self.full_contact_pressure, 1.0)
        return 2 / math.pi * math.asin(math.sqrt(share))

    def displacement(self, mean_pressure: float) -> float:
        """Δ s (1 − ln s) (mm) with s = p̄/p*, from first touch to the mean line; Δ from p* on."""
        share = min(mean_pressure / self.full_contact_pressure, 1.0)
        return self.amplitude * share * (1 - math.log(share)) if share else 0.0

    def pressure(self, x, mean_pressure: float):
        """Pressure (MPa) at x (mm) from a crest; broadcasts.

        2p* cos(πx/λ) √(sin²(πa/λ) − sin²(πx/λ)), and p̄ + p* cos(2πx/λ) in full contact.
        """
        phase = math.pi * np.asarray(x) / self.wavelength
        if mean_pressure >= self.full_contact_pressure:
            return mean_pressure + self.full_contact_pressure * np.cos(2 * phase)
        share = mean_pressure / self.full_contact_pressure
        root = _root(share - np.sin(phase) ** 2)
        return 2 * self.full_contact_pressure * np.abs(np.cos(phase)) * root


@dataclass(frozen=True)
class GreenwoodWilliamson:
    """Summits of one radius and of Gaussian heights, each pressed by itself as Hertz's sphere.

    Their `density` is η (1/mm²), their `radius` R (mm), and the standard deviation of their
    heights `height` σ (mm).
    """

    density: float
    radius: float
    height: float
    contact_modulus: float

    @classmethod
    def from_roughness(
        cls, surface: Roughness, contact_modulus: float
    ) -> "GreenwoodWilliamson":
        """The summits of a Gaussian surface, from its moments: Nayak, McCool.

        η = m₄/(6√3 π m₂), R = (3/8)√(π/m₄), σ² = (1 − 0.8968/α) m₀, as `gstlib.bem.roughness`
        defines them.
        """
        m0 = surface.height**2
        m2 = surface.slope**2 / 2
        m4 = 1.5 * surface.curvature**2
        return cls(
            density=m4 / (6 * math.sqrt(3) * math.pi * m2),
            radius=0.375 * math.sqrt(math.pi / m4),
            height=math.sqrt((1 - 0.8968 / surface.nayak) * m0),
            contact_modulus=contact_modulus,
        )

    def contact_fraction(self, separation):
        """πηRσ F₁(d/σ) at d (mm) above the mean height of the summits; broadcasts."""
        mean = self.height * self._mean_power(separation, 1)
        return math.pi * self.density * self.radius * mean

    def mean_pressure(self, separation):
        """(4/3) E* η √R σ^³⁄₂ F_³⁄₂(d/σ) (MPa) at d (mm); broadcasts."""
        mean = self.height**1.5 * self._mean_power(separation, 1.5)
        return (
            4 / 3 * self.contact_modulus * self.density * math.sqrt(self.radius) * mean
        )

    def _mean_power(self, separation, power):
        """Fₙ(t), the mean of (s − t)ⁿ over s > t, normal: by parabolic cylinder functions."""
        t = np.asarray(separation) / self.height
        factor = math.gamma(power + 1) / math.sqrt(2 * math.pi)
        return factor * np.exp(-(t**2) / 4) * scipy.special.pbdv(-power - 1, t)[0]


def crossed_waves_full_contact_pressure(
    amplitude: float, wavelength: float, contact_modulus: float
) -> float:
    """Mean pressure (MPa) that closes Δ cos(2πx/λ) cos(2πy/λ): √2 πE*Δ/λ.

    Johnson, Greenwood & Higginson (1985). Δ and λ in mm, E* in MPa.
    """
    return math.sqrt(2) * math.pi * contact_modulus * amplitude / wavelength


def crossed_waves_light_contact(share: float) -> float:
    """Contact fraction of crossed waves under a small share p̄/p* of the load that closes them.

    Each crest as Hertz's sphere, π(3s/8π)^⅔; Johnson, Greenwood & Higginson (1985).
    """
    return math.pi * (3 * share / (8 * math.pi)) ** (2 / 3)


def crossed_waves_heavy_contact(share: float) -> float:
    """The same just before p* closes them: each hollow as a crack, 1 − 3(1 − s)/2π."""
    return 1 - 3 * (1 - share) / (2 * math.pi)


def full_contact_rms_pressure(rms_gradient: float, contact_modulus: float) -> float:
    """Standard deviation of pressure (MPa) in full contact with a rough surface: E* h'rms / 2.

    Each wave vector q of the surface takes the pressure E*|q|/2 per height (Johnson, sect. 13.2).
    """
    return 0.5 * contact_modulus * rms_gradient


def persson_contact_fraction(
    mean_pressure: float, rms_gradient: float, contact_modulus: float
) -> float:
    """Contact fraction of a rough surface under p̄ (MPa): erf(√2 p̄ / E* h'rms), by Persson."""
    return math.erf(math.sqrt(2) * mean_pressure / (contact_modulus * rms_gradient))


def persson_pressure_density(
    pressure, mean_pressure: float, rms_gradient: float, contact_modulus: float
):
    """Probability density (1/MPa) of a pressure p > 0 (MPa) on a rough surface, by Persson.

    It is the difference of two Gaussians of the variance (E* h'rms/2)² about ±p̄. It starts from
    zero in proportion to p, and its integral is the contact fraction. Arguments broadcast.
    """
    width = full_contact_rms_pressure(rms_gradient, contact_modulus)
    at = np.asarray(pressure) / width
    mean = mean_pressure / width
    density = np.exp(-((at - mean) ** 2) / 2) - np.exp(-((at + mean) ** 2) / 2)
    return density / (math.sqrt(2 * math.pi) * width)


def love_rectangle_displacement(
    x, y, sides: tuple[float, float], pressure: float, contact_modulus: float
):
    """Displacement (mm) at (x, y) (mm) on the surface under a uniform pressure on a rectangle.

    Love; Johnson, eq. 3.25. `sides` (mm) are the rectangle's lengths along x and y, and its centre
    is the origin. The formula does not apply on the lines of the edges.
    """
    left, right = x + sides[0] / 2, x - sides[0] / 2
    top, bottom = y + sides[1] / 2, y - sides[1] / 2

    def corner(a, b):
        return a * np.arcsinh(b / np.abs(a)) + b * np.arcsinh(a / np.abs(b))

    integral = (
        corner(left, top)
        - corner(left, bottom)
        - corner(right, top)
        + corner(right, bottom)
    )
    return pressure * integral / (math.pi * contact_modulus)


def _root(value):
    return np.sqrt(np.maximum(value, 0.0))
