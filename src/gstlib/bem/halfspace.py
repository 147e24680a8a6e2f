"""The elastic half-space as an operator: pressure on a grid of elements to displacement.

The half-space is not periodic. The discrete convolution with Love's kernel is done exactly, by FFT
on a grid padded with zeros to at least twice the size (Liu, Wang & Liu, Wear 243 (2000) 101).

Conventions: arrays are (ny, nx); pressure (MPa) is positive in compression, displacement (mm)
positive into the half-space. Transforms run along x first, then along y, in blocks of fixed size:
zero rows are never transformed, each block stays in cache, and since every block is computed by
one thread in the same way whatever their number, so are the bits of the result.
"""

import copy
import math

import ducc0
import numpy as np

from .checks import checked_modulus, checked_spacing, checked_workers
from .elasticity import love_kernel
from .errors import InvalidContactInput

__all__ = ["HalfSpace"]

# Lines per block: few enough to stay in cache, many enough that the cost of the calls vanishes
# (measured: flat from 32 to 96).
_LINES = 64
# Lines of a buffer lie this many numbers more apart: at a power of two they share cache sets
# (measured: transforms of 1024 numbers in single precision take 2.6 times as long).
_OFFSET = 8

# The approximate inverse needs no exact convolution: padding by a quarter keeps opposite borders
# from seeing each other (measured: wider padding saves no iteration, none costs a few).
_INVERSE_PADDING = 1.25

# A window of its own is made for less than this share of the elements.
_WORTH_A_WINDOW = 0.7


class HalfSpace:
    """Exact non-periodic response of an elastic half-space to uniform pressures on rectangles.

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

    Attributes
    ----------
    self_influence : float
        Displacement of an element under unit pressure on itself (mm/MPa).

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

    def __init__(self, shape, spacing, contact_modulus, workers=1):
        self.shape = _checked_shape(shape)
        self.spacing = checked_spacing(spacing)
        self.contact_modulus = checked_modulus(contact_modulus)
        self.workers = checked_workers(workers)
        self._convolutions = 0
        self._each_block = _each_block(self.workers)
        self.self_influence = love_kernel((1, 1), self.spacing, self.contact_modulus)[0, 0]
        padded = tuple(_fast_even_size(2 * n - 1) for n in self.shape)
        self._displace = _EvenConvolution(self.shape, self._spectrum(padded), np.float64)
        self._displace_single = self._invert = self._window = None

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
        self._convolutions += 1
        return self._displace(pressure, self._each_block)

    def approximate_displacement(self, pressure) -> np.ndarray:
        """The same in single precision, at two thirds of the time and half of the memory.

        Its error, a few 1e-7 of the largest displacement, does no harm to a correction that is
        added to a field known exactly.

        Parameters
        ----------
        pressure : ndarray of float32, shape (ny, nx)
            Pressure (MPa).

        Returns
        -------
        ndarray of float32, shape (ny, nx)
            Displacement (mm).
        """
        if self._displace_single is None:
            self._displace_single = self._displace.astype(np.float32)
        self._convolutions += 1
        return self._displace_single(pressure, self._each_block)

    def approximate_inverse(self, displacement) -> np.ndarray:
        """A cheap approximate inverse of :meth:`displacement`, to precondition with.

        Convolution with the inverse of the kernel's spectrum on a grid padded by a quarter only;
        at wavelengths above the element, the classical E*|q|/2 (Vollebregt, J. Optim. Theory
        Appl. 162 (2014) 936). Symmetric and positive definite, also when restricted to a contact
        set. In single precision.

        Parameters
        ----------
        displacement : ndarray of float32, shape (ny, nx)
            Displacement (mm).

        Returns
        -------
        ndarray of float32, shape (ny, nx)
            Pressure (MPa).
        """
        if self._invert is None:
            padded = tuple(_fast_even_size(math.ceil(_INVERSE_PADDING * n)) for n in self.shape)
            self._invert = _EvenConvolution(self.shape, 1 / self._spectrum(padded), np.float32)
        return self._invert(displacement, self._each_block)

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
        self._window = HalfSpace(shape, self.spacing, self.contact_modulus, self.workers)
        return self._window

    def _spectrum(self, padded):
        """Spectrum of the kernel wrapped to the nearest image on a grid of even size `padded`."""
        quadrant = tuple(m // 2 + 1 for m in padded)
        kernel = love_kernel(quadrant, self.spacing, self.contact_modulus)
        # The kernel is even in x and in y: so is its spectrum, which is real besides.
        return ducc0.fft.dct(kernel, type=1)


class _EvenConvolution:
    """Circular convolution on a padded grid with a kernel that is even in both axes."""

    def __init__(self, shape, spectrum, dtype):
        """From the shape of the fields, and the kernel's spectrum at wave numbers from 0 on."""
        self.shape = shape
        self.padded = tuple(2 * (n - 1) for n in spectrum.shape)
        self.dtype = np.dtype(dtype)
        # Transposed like the spectrum of the field below, and mirrored to all wave numbers along y;
        # the inverse transform's scale goes in.
        half = spectrum.T / math.prod(self.padded)
        self.spectrum = np.concatenate((half, half[:, -2:0:-1]), axis=1, dtype=dtype)

    def astype(self, dtype):
        """The same convolution in another precision."""
        other = copy.copy(self)
        other.dtype, other.spectrum = np.dtype(dtype), self.spectrum.astype(dtype)
        return other

    def __call__(self, field, each_block):
        ny, nx = self.shape
        my, mx = self.padded
        complex_type = np.result_type(self.dtype, np.complex64)
        # Transposed, so that the transforms along y run along contiguous memory.
        transform = np.empty((mx // 2 + 1, ny), complex_type)
        result = np.empty(self.shape, self.dtype)

        def rows_forward(starts):
            rows = np.zeros((min(_LINES, ny), mx), self.dtype)
            for start in starts:
                lines = field[start : start + _LINES]
                rows[: len(lines), :nx] = lines
                ducc0.fft.r2c(
                    rows[: len(lines)], axes=(1,), out=transform.T[start : start + _LINES]
                )

        def columns(starts):
            # One buffer keeps its zeros, the other takes the transform.
            padded = np.zeros((_LINES, my + _OFFSET), complex_type)[:, :my]
            buffer = np.empty((_LINES, my + _OFFSET), complex_type)[:, :my]
            for start in starts:
                lines = transform[start : start + _LINES]
                count = len(lines)
                padded[:count, :ny] = lines
                block = ducc0.fft.c2c(padded[:count], axes=(1,), out=buffer[:count])
                block *= self.spectrum[start : start + _LINES]
                ducc0.fft.c2c(block, axes=(1,), forward=False, out=block)
                lines[:] = block[:, :ny]

        def rows_backward(starts):
            rows = np.empty((_LINES, mx + _OFFSET), self.dtype)[:, :mx]
            for start in starts:
                lines = result[start : start + _LINES]
                block = ducc0.fft.c2r(
                    transform.T[start : start + _LINES],
                    axes=(1,),
                    lastsize=mx,
                    forward=False,
                    out=rows[: len(lines)],
                )
                lines[:] = block[:, :nx]

        each_block(rows_forward, ny)
        each_block(columns, mx // 2 + 1)
        each_block(rows_backward, ny)
        return result


def _each_block(workers):
    """A function that runs a task on all blocks of lines, shared among the workers."""
    if workers == 1:
        return lambda task, lines: task(range(0, lines, _LINES))
    # Imported here: one thread, the usual case of a workflow's job, has no use for it.
    from concurrent.futures import ThreadPoolExecutor

    # The threads end with the pool, and the pool with the last half-space that refers to it.
    pool = ThreadPoolExecutor(workers - 1)

    def shared(task, lines):
        # This thread takes a share of its own.
        starts = range(0, lines, _LINES)
        others = [pool.submit(task, starts[worker::workers]) for worker in range(1, workers)]
        task(starts[::workers])
        for other in others:
            other.result()

    return shared


def _fast_even_size(minimum):
    """Smallest even length not below `minimum` that the FFT handles fast."""
    return 2 * ducc0.fft.good_size((minimum + 1) // 2)


def _checked_shape(shape):
    try:
        ny, nx = (int(n) for n in shape)
    except (TypeError, ValueError):
        raise InvalidContactInput(f"shape must be two integers (ny, nx), got {shape}") from None
    if ny < 1 or nx < 1:
        raise InvalidContactInput(f"shape must be at least (1, 1), got {shape}")
    return ny, nx
