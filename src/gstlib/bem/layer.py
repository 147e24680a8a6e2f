"""A compliant layer bonded to a rigid body: soft material between two tools, as an operator.

Under a point force F, with the layer's E*ₘ = E/(1 − ν²) and thickness t, the surface sinks at the
distance r by

    u(r) = F/(πE*ₘ) [1/r − g(r/t)/t],   g(ρ) = ∫ (1 − f(ζ)) J₀(ζρ) dζ,  0 < ζ < ∞,

    f(ζ) = [(3 − 4ν) sinh 2ζ − 2ζ] / [(3 − 4ν) cosh 2ζ + 2ζ² + 5 − 12ν + 8ν²].

A wave q therefore meets the stiffness E*ₘq/(2 f(qt)) (Carbone & Mangialardi, J. Mech. Phys. Solids
56 (2008) 684). The first term belongs to a half-space. The second is smooth, and removes everything
that reaches farther than the layer's thickness.
"""

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from .convolution import love_kernel
from .errors import ContactInputError, checked_number, checked_poisson

__all__ = ["LONGEST_ELEMENT", "Layer"]

# In thicknesses: beyond this, the neglected displacement is below 1e-6 of a half-space's, even for
# an incompressible layer.
_REACH = 20.0
# 1 − f falls as ζ² exp(−2ζ). The nodes resolve J₀ out to the reach to 1e-11.
_LARGEST_WAVE, _WAVES = 30.0, 600
_TABLE = np.linspace(0.0, _REACH, 1001)
# Gauss's nodes along an element: some for a short one, more in proportion to its thicknesses.
_NODES, _NODES_PER_THICKNESS, _MOST_NODES = 3, 4, 64
# In thicknesses: on longer elements, so many nodes no longer resolve the layer (1 % at 50).
LONGEST_ELEMENT = 40


@dataclass(frozen=True)
class Layer:
    """An elastic layer, bonded to a rigid body behind it, without friction in front.

    Attributes
    ----------
    young : float
        Young's modulus (MPa).
    poisson : float
        Poisson's ratio, in (-1, 0.5].
    thickness : float
        mm.

    Raises
    ------
    ContactInputError
        A constant outside its physical range.

    Examples
    --------
    Long waves meet a bed of springs, and waves shorter than the layer a half-space:

    >>> import gstlib
    >>> hide = gstlib.Layer(young=20.0, poisson=0.3, thickness=1.0)
    >>> hide.stiffness([1e-3, 10.0]).round(1)
    array([ 26.9, 109.9])
    """

    young: float
    poisson: float
    thickness: float

    def __post_init__(self):
        checked_number("young", self.young, "MPa", positive=True)
        checked_number("thickness", self.thickness, "mm", positive=True)
        checked_poisson("poisson", self.poisson)

    @property
    def modulus(self) -> float:
        """E*ₘ = E/(1 − ν²) (MPa), as of a half-space of the layer's material."""
        return self.young / (1 - self.poisson**2)

    @property
    def reach(self) -> float:
        """Distance (mm) beyond which a force does not displace it."""
        return _REACH * self.thickness

    @property
    def uniform_influence(self) -> float:
        """Displacement under unit pressure all over (mm/MPa), t(1 + ν)(1 − 2ν)/(E(1 − ν))."""
        nu = self.poisson
        return self.thickness * (1 - 2 * nu) / (1 - nu) ** 2 / self.modulus

    def stiffness(self, wave_number):
        """Pressure per displacement (MPa/mm) of waves of these wave numbers (1/mm), > 0."""
        wave_number = np.asarray(wave_number, dtype=float)
        share = _share(self.poisson, wave_number * self.thickness)
        return self.modulus * wave_number / 2 / share

    def kernel(
        self, shape: tuple[int, int], spacing: tuple[float, float]
    ) -> np.ndarray:
        """Displacement of a quadrant of elements under unit pressure on its corner (mm/MPa).

        As in `HalfSpace.kernel`.
        """
        ny, nx = (
            min(n, math.ceil(self.reach / step) + 1)
            for n, step in zip(shape, spacing, strict=True)
        )
        places, weights = zip(*map(self._along, (ny, nx), spacing), strict=True)
        distance = np.hypot(places[0][:, None], places[1])
        smooth = _behind(self.poisson)(np.minimum(distance, _REACH))
        far = distance > _REACH
        smooth[far] = 1 / distance[far]
        smooth *= np.outer(*weights)
        nodes = len(weights[0]) // ny
        smooth = smooth.reshape(ny, nodes, nx, -1).sum(axis=(1, 3))
        near = love_kernel((ny, nx), spacing, self.modulus)
        near -= self.thickness / (math.pi * self.modulus) * smooth
        kernel = np.zeros(shape)
        kernel[:ny, :nx] = near
        return kernel

    def _along(self, count, step):
        """Gauss's nodes and weights in each of `count` elements, in thicknesses."""
        if step > LONGEST_ELEMENT * self.thickness:
            raise ContactInputError(
                f"a layer of {self.thickness:g} mm is too thin for elements of {step:g} mm: use "
                f"elements of at most {LONGEST_ELEMENT * self.thickness:g} mm"
            )
        step = step / self.thickness
        number = _NODES + math.ceil(_NODES_PER_THICKNESS * step)
        nodes, weights = np.polynomial.legendre.leggauss(min(number, _MOST_NODES))
        places = np.arange(count)[:, None] * step + nodes * step / 2
        return places.reshape(-1), np.tile(weights * step / 2, count)


def _share(poisson, zeta):
    """f(ζ): displacement of a wave relative to a half-space."""
    nu = poisson
    zeta = np.minimum(zeta, 100.0)  # f is 1 long before sinh overflows
    above = (3 - 4 * nu) * np.sinh(2 * zeta) - 2 * zeta
    below = (3 - 4 * nu) * np.cosh(2 * zeta) + 2 * zeta**2
    return above / (below + 5 - 12 * nu + 8 * nu**2)


@cache
def _behind(poisson):
    """g(ρ), the reduction due to the body behind the layer, 1/ρ beyond the reach."""
    # here: SciPy takes longer to import than all of gstlib.bem, and only a layer needs it
    from scipy.interpolate import CubicSpline
    from scipy.special import j0

    nodes, weights = np.polynomial.legendre.leggauss(_WAVES)
    zeta = _LARGEST_WAVE / 2 * (nodes + 1)
    weights = _LARGEST_WAVE / 2 * weights * (1 - _share(poisson, zeta))
    return CubicSpline(_TABLE, j0(np.outer(_TABLE, zeta)) @ weights)
