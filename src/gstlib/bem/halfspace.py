"""The elastic half-space as an operator: pressure on a grid of elements to displacement.

The half-space is not periodic. The discrete convolution with Love's kernel is done exactly, by FFT
on a grid padded with zeros to at least twice the size (Liu, Wang & Liu, Wear 243 (2000) 101).

Conventions: arrays are (ny, nx); pressure (MPa) is positive in compression, displacement (mm)
positive into the half-space.
"""

import math
from functools import cached_property

import numpy as np

from .checks import checked_modulus, checked_spacing, checked_workers
from .convolution import (
    WORTH_THREADS,
    Crew,
    EvenConvolution,
    even_size,
    exact_padding,
    love_spectrum,
)
from .elasticity import LoveKernel
from .errors import InvalidContactInput
from .splitting import SplitConvolution

__all__ = ["HalfSpace", "inverse_padding"]

# The approximate inverse needs no exact convolution: padding by a tenth keeps opposite borders from
# seeing each other (measured: wider padding saves no iteration, none costs a fifth).
_INVERSE_PADDING = 1.1

# A window of its own is made for less than this share of the elements.
_WORTH_A_WINDOW = 0.7


class HalfSpace:
    """Exact non-periodic response of an elastic half-space to uniform pressures on rectangles.

    It keeps a workspace: not to be called from several threads at a time.

    Parameters
    ----------
    shape : (int, int)
        Elements along y and x.
    spacing : float or (float, float)
        Side of the square elements, or (dy, dx) (mm).
    contact_modulus : float
        E* (MPa).
    workers : int
        Threads. The result has the same bits for any number of them.
    kernel : LoveKernel, optional
        Of this spacing and modulus, where it has been made before.

    Attributes
    ----------
    self_influence : float
        Displacement of an element under unit pressure on itself (mm/MPa).
    kernel : LoveKernel

    Raises
    ------
    InvalidContactInput
        Empty shape, spacing or modulus not positive and finite, workers < 1.

    Examples
    --------
    One loaded element sinks by 4 asinh(1)/(π E*) times its side per unit pressure:

    >>> HalfSpace((1, 1), 1.0, 1.0).displacement([[1.0]]).round(4)
    array([[1.1222]])
    """

    def __init__(self, shape, spacing, contact_modulus, workers=1, kernel=None):
        self.shape = _checked_shape(shape)
        self.spacing = checked_spacing(spacing)
        self.contact_modulus = checked_modulus(contact_modulus)
        self.workers = checked_workers(workers)
        self._convolutions = 0
        self._crew = Crew(self.workers)
        padded = exact_padding(self.shape)
        self.kernel = kernel or LoveKernel(
            self.spacing, self.contact_modulus, tuple(m // 2 + 1 for m in padded)
        )
        self.self_influence = float(self.kernel.quadrant((1, 1))[0, 0])
        self._window = None
        # Each transform is made when first asked for; if it is large, by another thread meanwhile.
        large = math.prod(padded) >= WORTH_THREADS
        self._wait = self._crew.start(self._prepare) if large else lambda: None

    def _prepare(self):
        return self._double, self._single, self._inverse

    @cached_property
    def _double(self):
        return self._exact(np.float64)

    def _exact(self, dtype):
        spectrum = love_spectrum(exact_padding(self.shape), self.kernel)
        return EvenConvolution(self.shape, spectrum, dtype, self._crew)

    @cached_property
    def _single(self):
        if SplitConvolution.saves(self.shape, self.spacing):
            return SplitConvolution(self.shape, self.kernel, self._crew)
        return self._exact(np.float32)

    @cached_property
    def _inverse(self):
        spectrum = love_spectrum(inverse_padding(self.shape), self.kernel)
        return EvenConvolution(self.shape, 1 / spectrum, np.float32, self._crew)

    @property
    def convolutions(self) -> int:
        """Number of displacements computed so far, exact or not, on windows too."""
        return self._convolutions + (self._window.convolutions if self._window else 0)

    def displacement(self, pressure) -> np.ndarray:
        """Surface displacement under a pressure field.

        Parameters
        ----------
        pressure : array_like, shape (ny, nx)
            Pressure (MPa), positive in compression, uniform on each element.

        Returns
        -------
        ndarray, shape (ny, nx)
            Displacement at element centres (mm), positive into the half-space.

        Raises
        ------
        InvalidContactInput
            Pressure of another shape.
        """
        pressure = np.asarray(pressure, dtype=float)
        if pressure.shape != self.shape:
            raise InvalidContactInput(
                f"pressure has shape {pressure.shape}, the half-space {self.shape}"
            )
        return self.exact_displacement(pressure).copy()

    def exact_displacement(self, pressure, elements=None) -> np.ndarray:
        """:meth:`displacement`, unchecked, on the grid or on some elements of it.

        Parameters
        ----------
        pressure : ndarray, shape (ny, nx), or (n,)
            Pressure (MPa).
        elements : Elements, optional
            The n elements whose pressure is given; the others have none.

        Returns
        -------
        ndarray, shape (ny, nx), or (n,)
            Displacement (mm) on the grid, and then the next use of the half-space overwrites it, or
            on the elements.
        """
        self._convolutions += 1
        self._wait()
        return self._double(pressure, elements)

    def approximate_displacement(self, pressure, elements=None) -> np.ndarray:
        """The same, nearly, at a third of the time: the kernel split, and in single precision.

        Its error, 2e-6 of the largest displacement, does no harm to a correction that is added to
        a field known exactly. Stripes of alternating sign are the worst case known: 5e-6.

        Parameters
        ----------
        pressure, elements
            As of :meth:`exact_displacement`.

        Returns
        -------
        ndarray of float32, shape (ny, nx), or of float64, shape (n,)
            Displacement (mm), as of :meth:`exact_displacement`.
        """
        self._convolutions += 1
        self._wait()
        return self._single(pressure, elements)

    def approximate_inverse(self, displacement, elements=None) -> np.ndarray:
        """A cheap approximate inverse of :meth:`displacement`, to precondition with.

        Convolution with the inverse of the kernel's spectrum on a grid padded by a tenth only;
        at wavelengths above the element, the classical E*|q|/2 (Vollebregt, J. Optim. Theory
        Appl. 162 (2014) 936). Symmetric and positive definite, also when restricted to a contact
        set. In single precision.

        Parameters
        ----------
        displacement : ndarray, shape (ny, nx), or (n,)
            Displacement (mm).
        elements : Elements, optional
            The n elements whose displacement is given; that of the others is zero.

        Returns
        -------
        ndarray of float32, shape (ny, nx), or of float64, shape (n,)
            Pressure (MPa), as the displacement of :meth:`exact_displacement`.
        """
        self._wait()
        return self._inverse(displacement, elements)

    def window(self, shape):
        """The half-space on a part of the grid that holds `shape` elements.

        The last one made is kept, and given again while it is not much larger than asked for.

        Parameters
        ----------
        shape : (int, int)
            Rows and columns needed, at most those of the grid.

        Returns
        -------
        HalfSpace
            Of that shape or a larger one; this half-space itself, where it is not much larger.
        """
        for known in (self, self._window):
            if (
                known is not None
                and all(n <= m for n, m in zip(shape, known.shape, strict=True))
                and math.prod(shape) > _WORTH_A_WINDOW * math.prod(known.shape)
            ):
                return known
        if self._window is not None:
            self._convolutions += self._window.convolutions
        self._window = HalfSpace(
            shape, self.spacing, self.contact_modulus, self.workers, self.kernel
        )
        return self._window


def _checked_shape(shape):
    try:
        ny, nx = (int(n) for n in shape)
    except (TypeError, ValueError):
        raise InvalidContactInput(f"shape must be two integers (ny, nx), got {shape}") from None
    if ny < 1 or nx < 1:
        raise InvalidContactInput(f"shape must be at least (1, 1), got {shape}")
    return ny, nx


def inverse_padding(shape):
    """Size of the grid on which an approximate inverse is computed."""
    return tuple(even_size(math.ceil(_INVERSE_PADDING * n)) for n in shape)
