"""Convolution of fields with a kernel that is even along both axes, by FFT on a padded grid.

Transforms run along x first, then along y, in blocks of fixed size: zero rows are never
transformed, each block stays in cache, and since every block is computed by one thread in the same
way whatever their number, so are the bits of the result.
"""

import copy
import math

import ducc0
import numpy as np

from .elasticity import love_kernel

__all__ = ["Crew", "EvenConvolution", "even_size", "love_spectrum"]

# Lines per block: few enough to stay in cache and to be shared evenly, many enough that the cost of
# the calls vanishes (measured: flat from 32 to 128).
_LINES = 32
# Fewer numbers than this are transformed in one thread: waking others takes as long (measured).
_WORTH_THREADS = 300_000
# Lines of a buffer lie this many numbers more apart: at a power of two they share cache sets
# (measured: transforms of 1024 numbers in single precision take 2.6 times as long).
_OFFSET = 8


class EvenConvolution:
    """Circular convolution on a padded grid with a kernel that is even in both axes.

    It keeps its workspace: fresh memory is slow to touch, above all in threads.

    Parameters
    ----------
    shape : (int, int)
        Of the fields (ny, nx).
    spectrum : ndarray, shape (my // 2 + 1, mx // 2 + 1)
        Of the kernel, on the padded grid (my, mx), at wave numbers from 0 on.
    dtype : data-type
        Of fields and results: single or double precision.
    crew : Crew
        The threads; small grids do without.
    """

    def __init__(self, shape, spectrum, dtype, crew):
        self.shape = shape
        self._padded = tuple(2 * (n - 1) for n in spectrum.shape)
        # Transposed like the spectrum of the field below, and mirrored to all wave numbers along y;
        # the inverse transform's scale goes in.
        half = spectrum.T / math.prod(self._padded)
        self._spectrum = np.concatenate((half, half[:, -2:0:-1]), axis=1, dtype=dtype)
        self._crew = crew if math.prod(self._padded) >= _WORTH_THREADS else Crew(1)
        self._workspace(dtype)

    def astype(self, dtype):
        """The same convolution in another precision."""
        other = copy.copy(self)
        other._spectrum = self._spectrum.astype(dtype)
        other._workspace(dtype)
        return other

    def _workspace(self, dtype):
        ny, (my, mx) = self.shape[0], self._padded
        complex_type = np.result_type(dtype, np.complex64)
        # Transposed, so that the transforms along y run along contiguous memory.
        self._transform = np.empty((mx // 2 + 1, ny), complex_type)
        self._result = np.empty(self.shape, dtype)

        def lines(length, number):
            buffer = np.zeros((_LINES, length + _OFFSET), number)
            return buffer[:, :length]

        # For each thread: padded rows and columns, which keep their zeros, and room for results.
        self._buffers = [
            (lines(mx, dtype), lines(my, complex_type), lines(my, complex_type), lines(mx, dtype))
            for _ in range(self._crew.size)
        ]

    def __call__(self, field):
        """The convolution of a field (ny, nx); the next call overwrites it."""
        ny, nx = self.shape
        mx = self._padded[1]
        transform, result = self._transform, self._result

        def rows_forward(worker, starts):
            padded = self._buffers[worker][0]
            for start in starts:
                rows = field[start : start + _LINES]
                count = len(rows)
                padded[:count, :nx] = rows
                ducc0.fft.r2c(padded[:count], axes=(1,), out=transform.T[start : start + count])

        def columns(worker, starts):
            _, padded, buffer, _ = self._buffers[worker]
            for start in starts:
                lines = transform[start : start + _LINES]
                count = len(lines)
                padded[:count, :ny] = lines
                block = ducc0.fft.c2c(padded[:count], axes=(1,), out=buffer[:count])
                block *= self._spectrum[start : start + count]
                ducc0.fft.c2c(block, axes=(1,), forward=False, out=block)
                lines[:] = block[:, :ny]

        def rows_backward(worker, starts):
            buffer = self._buffers[worker][3]
            for start in starts:
                rows = result[start : start + _LINES]
                count = len(rows)
                block = ducc0.fft.c2r(
                    transform.T[start : start + count],
                    axes=(1,),
                    lastsize=mx,
                    forward=False,
                    out=buffer[:count],
                )
                rows[:] = block[:, :nx]

        self._crew.run(rows_forward, ny)
        self._crew.run(columns, mx // 2 + 1)
        self._crew.run(rows_backward, ny)
        return result


class Crew:
    """Threads that share blocks of lines; the calling thread is one of them.

    Parameters
    ----------
    size : int
        Threads, at least 1.
    """

    def __init__(self, size):
        self.size = size
        if size > 1:
            # Imported here: one thread, the usual case of a workflow's job, has no use for it.
            from concurrent.futures import ThreadPoolExecutor

            # Its threads start when first used, and end with the last reference to it.
            self._pool = ThreadPoolExecutor(size - 1)

    def start(self, task):
        """Let another thread do a task, if there is one; gives a function that waits for it."""
        return self._pool.submit(task).result if self.size > 1 else lambda: None

    def run(self, task, lines):
        """Call ``task(worker, starts)`` in each thread, with the first lines of its blocks."""
        starts = range(0, lines, _LINES)
        others = [
            self._pool.submit(task, worker, starts[worker :: self.size])
            for worker in range(1, self.size)
        ]
        task(0, starts[:: self.size])
        for other in others:
            other.result()


def even_size(minimum):
    """Smallest even length not below `minimum` that the FFT handles fast."""
    return 2 * ducc0.fft.good_size((minimum + 1) // 2)


def love_spectrum(padded, spacing, contact_modulus):
    """Spectrum of Love's kernel, wrapped to the nearest image on a grid of even size `padded`.

    Returns
    -------
    ndarray, shape (my // 2 + 1, mx // 2 + 1)
        At wave numbers from 0 on; the kernel is even in y and in x, and so its spectrum, which is
        real besides.
    """
    quadrant = tuple(m // 2 + 1 for m in padded)
    return ducc0.fft.dct(love_kernel(quadrant, spacing, contact_modulus), type=1)
