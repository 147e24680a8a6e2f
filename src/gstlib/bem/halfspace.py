"""The elastic half-space as an operator: pressure on a grid of elements to displacement.

The half-space is not periodic. The discrete convolution with Love's kernel is done exactly, by FFT
on a grid padded with zeros to at least twice the size (Liu, Wang & Liu, Wear 243 (2000) 101).

Conventions: arrays are (ny, nx); pressure (MPa) is positive in compression, displacement (mm)
positive into the half-space. Transforms run along x first, then along y, in blocks of fixed size:
zero rows are never transformed, each block stays in cache, and since every block is computed by
one thread in the same way whatever their number, so are the bits of the result.
"""

import math

import ducc0
import numpy as np

from .checks import checked_modulus, checked_spacing, checked_workers
from .elasticity import love_kernel
from .errors import InvalidContactInput

__all__ = ["HalfSpace"]

# Lines per block: few enough to stay in cache, many enough that the cost of the calls vanishes and
# that threads seldom wait for the interpreter (measured: flat from 32 to 96).
_ROWS = 64
_COLUMNS = 64

# The approximate inverse needs no exact convolution: padding by a quarter keeps opposite borders
# from seeing each other (measured: wider padding saves no iteration, none costs a few).
_INVERSE_PADDING = 1.25


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
    convolutions : int
        Number of calls of :meth:`displacement` so far.
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
        self.convolutions = 0
        self._each_block = _each_block(self.workers)
        self.self_influence = love_kernel((1, 1), self.spacing, self.contact_modulus)[0, 0]
        self._convolve = _EvenConvolution(
            self.shape, tuple(_fast_even_size(2 * n - 1) for n in self.shape), self._spectrum
        )

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
        self.convolutions += 1
        return self._convolve(pressure, self._each_block)

    def approximate_inverse(self):
        """A cheap approximate inverse of :meth:`displacement`, to precondition with.

        Convolution with the inverse of the kernel's spectrum on a grid padded by a quarter only;
        at wavelengths above the element, the classical E*|q|/2 (Vollebregt, J. Optim. Theory
        Appl. 162 (2014) 936). Symmetric and positive definite, also when restricted to a contact
        set.

        Returns
        -------
        callable
            Maps a displacement (mm), shape (ny, nx), to a pressure (MPa) of that shape.
        """
        inverse = _EvenConvolution(
            self.shape,
            tuple(_fast_even_size(math.ceil(_INVERSE_PADDING * n)) for n in self.shape),
            lambda padded: 1 / self._spectrum(padded),
        )
        return lambda displacement: inverse(displacement, self._each_block)

    def _spectrum(self, padded):
        """Spectrum of the kernel wrapped to the nearest image on a grid of even size `padded`."""
        quadrant = tuple(m // 2 + 1 for m in padded)
        kernel = love_kernel(quadrant, self.spacing, self.contact_modulus)
        # The kernel is even in x and in y: so is its spectrum, which is real besides.
        return ducc0.fft.dct(kernel, type=1)


class _EvenConvolution:
    """Circular convolution on a padded grid with a kernel that is even in both axes."""

    def __init__(self, shape, padded, spectrum):
        self.shape = shape
        self.padded = padded
        # Transposed like the spectrum of the field below, and mirrored to all wave numbers along y;
        # the inverse transform's scale goes in.
        half = spectrum(padded).T / math.prod(padded)
        self.spectrum = np.concatenate((half, half[:, -2:0:-1]), axis=1)

    def __call__(self, field, each_block):
        ny, nx = self.shape
        my, mx = self.padded
        # Transposed, so that the transforms along y run along contiguous memory.
        transform = np.empty((mx // 2 + 1, ny), complex)
        result = np.empty(self.shape)

        def rows_forward(start):
            rows = np.zeros((min(_ROWS, ny - start), mx))
            rows[:, :nx] = field[start : start + _ROWS]
            ducc0.fft.r2c(rows, axes=(1,), out=transform.T[start : start + _ROWS])

        def columns(start):
            block = transform[start : start + _COLUMNS]
            padded = np.zeros((len(block), my), complex)
            padded[:, :ny] = block
            ducc0.fft.c2c(padded, axes=(1,), out=padded)
            padded *= self.spectrum[start : start + _COLUMNS]
            ducc0.fft.c2c(padded, axes=(1,), forward=False, out=padded)
            block[:] = padded[:, :ny]

        def rows_backward(start):
            rows = ducc0.fft.c2r(
                transform.T[start : start + _ROWS], axes=(1,), lastsize=mx, forward=False
            )
            result[start : start + _ROWS] = rows[:, :nx]

        each_block(rows_forward, range(0, ny, _ROWS))
        each_block(columns, range(0, mx // 2 + 1, _COLUMNS))
        each_block(rows_backward, range(0, ny, _ROWS))
        return result


def _each_block(workers):
    """A function that runs a task on each block, in as many threads as there are workers."""
    if workers == 1:

        def in_turn(task, starts):
            for start in starts:
                task(start)

        return in_turn
    # Imported here: one thread, the usual case of a workflow's job, has no use for it.
    from concurrent.futures import ThreadPoolExecutor

    # The threads end with the pool, and the pool with the last half-space that refers to it.
    pool = ThreadPoolExecutor(workers)
    return lambda task, starts: list(pool.map(task, starts))


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
