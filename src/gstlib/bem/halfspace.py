"""The elastic half-space as an operator: pressure on a grid of elements to displacement.

By default the surface is not loaded beyond the grid. The discrete convolution with Love's kernel is
done exactly, by FFT on a grid padded with zeros to at least twice the size (Liu, Wang & Liu, Wear
243 (2000) 101). A periodic half-space repeats the grid without end. Each wave of the pressure gives
the same wave of displacement, 2/(E*|q|) times as high (H. M. Stanley & T. Kato, J. Tribol. 119
(1997) 481). A uniform pressure gives no displacement, as it is counted from its mean.

Conventions: arrays are (ny, nx). Pressure (MPa) is positive in compression, displacement (mm)
positive into the half-space.
"""

import math
from functools import cached_property

import numpy as np

from .convolution import (
    EvenConvolution,
    SplitConvolution,
    even_size,
    even_spectrum,
    exact_padding,
    love_kernel,
)
from .errors import (
    ContactInputError,
    as_number,
    checked_array,
    checked_number,
    checked_poisson,
    checked_spacing,
)
from .layer import Layer

__all__ = ["APPROXIMATION_ERROR", "HalfSpace", "contact_modulus", "inverse_padding"]

# Error of an approximate displacement, relative to the largest. It only decides when to recompute
# exactly. (Measured: smaller on grids of 33 x 70 to 1024 x 1024, for noise, for sparse contact and
# for uniform pressure.)
APPROXIMATION_ERROR = 3e-6
# The approximate inverse needs no exact convolution. With padding by a tenth, opposite borders do
# not affect each other (measured: wider padding saves no iteration).
_INVERSE_PADDING = 1.1
# A separate half-space is made for a box with less than this share of the elements.
_WORTH_A_BOX = 0.7


def contact_modulus(
    young_1: float, poisson_1: float, young_2: float, poisson_2: float
) -> float:
    """Contact modulus E* of two elastic half-spaces, 1/E* = (1 - ν₁²)/E₁ + (1 - ν₂²)/E₂.

    Parameters
    ----------
    young_1, young_2 : float
        Young's moduli (MPa), positive, or ``math.inf`` for a rigid body (not both).
    poisson_1, poisson_2 : float
        Poisson's ratios, in (-1, 0.5].

    Returns
    -------
    float
        Contact modulus (MPa, as the Young's moduli).

    Raises
    ------
    ContactInputError
        A constant outside its physical range.

    References
    ----------
    K. L. Johnson, *Contact Mechanics* (1985), eq. 4.21. Some papers print (1 - ν) instead of (1 -
    ν²), which is a different function.

    Examples
    --------
    Two tools of one stone:

    >>> import gstlib
    >>> round(gstlib.contact_modulus(19500, 0.24, 19500, 0.24))
    10346
    """
    compliance = 0.0
    for body, young, poisson in ((1, young_1, poisson_1), (2, young_2, poisson_2)):
        young = as_number(f"young_{body}", young, "MPa")
        poisson = checked_poisson(f"poisson_{body}", poisson)
        if not young > 0:
            raise ContactInputError(f"young_{body} must be positive (MPa), got {young}")
        compliance += (1 - poisson**2) / young
    if compliance == 0:
        raise ContactInputError(
            "both bodies are rigid: one Young's modulus must be finite"
        )
    return 1 / compliance


class HalfSpace:
    """Exact response of an elastic half-space to uniform pressures on rectangles, or to waves.

    It keeps a workspace: do not call it from several threads at a time.

    Parameters
    ----------
    shape : (int, int)
        Elements along y and x.
    spacing : float or (float, float)
        Side of the square elements, or (dy, dx) (mm).
    contact_modulus : float
        E* (MPa).
    springs : float
        Compliance of a (Winkler) bed of independent springs in front of the half-space (mm/MPa).
        The default is none.
    layer : Layer, optional
        A compliant layer in front of the half-space. Their displacements add up, as if the body
        behind the layer were rigid.
    periodic : bool
        The grid repeats itself without end.

    Attributes
    ----------
    self_influence : float
        Displacement of an element under unit pressure on itself (mm/MPa), without the periods.
    uniform_influence : float
        Displacement under unit pressure all over (mm/MPa): infinite unless periodic.

    Raises
    ------
    ContactInputError
        Empty shape, spacing or modulus not positive and finite.

    Examples
    --------
    One loaded element sinks by 4 asinh(1)/(π E*) times its side per unit pressure:

    >>> import gstlib
    >>> gstlib.HalfSpace((1, 1), 1.0, 1.0).displacement([[1.0]]).round(4)
    array([[1.1222]])
    """

    def __init__(
        self,
        shape,
        spacing,
        contact_modulus,
        *,
        springs: float = 0.0,
        layer: Layer | None = None,
        periodic: bool = False,
    ):
        if len(shape) != 2 or min(shape) < 1:
            raise ContactInputError(
                f"shape must be (ny, nx), at least (1, 1), got {shape}"
            )
        self.shape = tuple(shape)
        self.spacing = checked_spacing(spacing)
        self.contact_modulus = checked_number(
            "contact_modulus", contact_modulus, "MPa", positive=True
        )
        if not isinstance(layer, Layer | None):
            raise ContactInputError(f"layer must be a gstlib.Layer, got {layer!r}")
        self.springs, self.layer = checked_number("springs", springs, "mm/MPa"), layer
        self.periodic, self.uniform_influence = periodic, math.inf
        if periodic:
            in_layer = layer.uniform_influence if layer else 0.0
            self.uniform_influence = self.springs + in_layer
        self.self_influence = float(self.kernel((1, 1))[0, 0])
        self._convolutions = 0
        self._box: HalfSpace | None = None

    @property
    def convolutions(self) -> int:
        """Number of displacements computed so far, exact or not, on boxes too."""
        return self._convolutions + (self._box.convolutions if self._box else 0)

    @cached_property
    def _double(self):
        return self._exact(np.float64)

    @cached_property
    def _single(self):
        reach = self.layer.reach if self.layer else 0.0
        grid = self.shape, self.spacing
        if self.periodic or not SplitConvolution.saves(*grid, reach):
            return self._exact(np.float32)
        return SplitConvolution(*grid, self.contact_modulus, self.kernel)

    @cached_property
    def _inverse(self):
        padded = self.shape if self.periodic else inverse_padding(self.shape)
        inverse = 1 / self.spectrum(padded)
        return EvenConvolution(self.shape, inverse, np.float32, padded)

    def _exact(self, dtype):
        padded = self.shape if self.periodic else exact_padding(self.shape)
        spectrum = self.spectrum(padded)
        if self.periodic:
            spectrum[0, 0] = self.uniform_influence
        return EvenConvolution(self.shape, spectrum, dtype, padded)

    def spectrum(self, grid):
        """Displacement of waves of unit pressure on a grid that repeats itself (mm/MPa), > 0.

        It is at wave numbers from 0 on, shape (my // 2 + 1, mx // 2 + 1). The size must be even
        unless the half-space is periodic. In this case the first value is at half the least wave
        number.
        """
        if not self.periodic:
            return even_spectrum(self.kernel([m // 2 + 1 for m in grid]))
        y, x = (
            np.arange(m // 2 + 1) * (2 * math.pi / (m * side))
            for m, side in zip(grid, self.spacing, strict=True)
        )
        wave_number = np.hypot(y[:, None], x)
        wave_number[0, 0] = math.pi / np.multiply(grid, self.spacing).max()
        spectrum = self.springs + 2 / (self.contact_modulus * wave_number)
        if self.layer:
            spectrum += 1 / self.layer.stiffness(wave_number)
        return spectrum

    def kernel(self, shape):
        """Displacement of a quadrant of elements under unit pressure on its corner (mm/MPa)."""
        kernel = love_kernel(shape, self.spacing, self.contact_modulus)
        kernel[0, 0] += self.springs
        if self.layer:
            kernel += self.layer.kernel(shape, self.spacing)
        return kernel

    def displacement(self, pressure) -> np.ndarray:
        """Displacement at element centres (mm) under a pressure, uniform on each element (MPa).

        Both are of shape (ny, nx). A pressure of another shape, or not of finite real numbers,
        raises `ContactInputError`.
        """
        return self.exact_displacement(
            checked_array("pressure", pressure, self.shape)
        ).copy()

    def exact_displacement(self, pressure):
        """`displacement`, unchecked. The next call overwrites it."""
        self._convolutions += 1
        return self._double(pressure)

    def approximate_displacement(self, pressure):
        """The same within `APPROXIMATION_ERROR`, in float32, in a third of the time.

        The kernel is split, and precision is single. The error, 2e-6 of the largest displacement,
        does no harm to a correction that is added to a field known exactly. Stripes of alternating
        sign are the worst case known: 5e-6.
        """
        self._convolutions += 1
        return self._single(pressure)

    def approximate_inverse(self, displacement):
        """Pressure (MPa), float32, for about this displacement (mm). The next call overwrites it.

        It is a convolution with the inverse of the kernel's spectrum on a grid padded by a tenth
        only. At wavelengths above the element, this is the classical E*|q|/2 (Vollebregt, J. Optim.
        Theory Appl. 162 (2014) 936). It is symmetric and positive definite, also when restricted to
        a contact set.
        """
        return self._inverse(displacement)

    def box(self, shape):
        """The half-space on a part of the grid with at least `shape` elements."""
        if self.periodic:
            return self
        for box in filter(None, (self, self._box)):
            holds = all(n <= m for n, m in zip(shape, box.shape, strict=True))
            if holds and math.prod(shape) > _WORTH_A_BOX * math.prod(box.shape):
                return box
        self._convolutions = self.convolutions
        self._box = self.on(shape)
        return self._box

    def on(self, shape, coarsening=1):
        """The same half-space on another grid, with elements `coarsening` times as long."""
        spacing = [coarsening * side for side in self.spacing]
        return HalfSpace(
            shape,
            spacing,
            self.contact_modulus,
            springs=self.springs,
            layer=self.layer,
            periodic=self.periodic,
        )


def inverse_padding(shape):
    """Size of the grid on which an approximate inverse is computed."""
    return tuple(even_size(math.ceil(_INVERSE_PADDING * n)) for n in shape)
