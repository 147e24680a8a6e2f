"""Convolution of fields with a kernel that is even along both axes, by FFT on a padded grid.

Transforms run along x first, then along y, in blocks of fixed size: zero rows are never
transformed, each block stays in cache, and since every block is computed by one thread in the same
way whatever their number, so are the bits of the result.
"""

import math
from concurrent.futures import ThreadPoolExecutor

import ducc0
import numpy as np

__all__ = [
    "WORTH_THREADS",
    "Crew",
    "EvenConvolution",
    "even_size",
    "even_spectrum",
    "exact_padding",
    "love_spectrum",
]

# Lines per block times bytes of a real number: few enough to stay in cache and be shared evenly,
# many enough that the cost of the calls vanishes (measured: 32 lines in double precision and 64 in
# single are best for two threads; for one it is flat from 32 to 128).
_BLOCK = 256
# Fewer numbers than this are transformed in one thread (measured on a virtual machine: at 576² two
# threads take four fifths of the time of one; waking the other takes 0.05 ms, a step 0.2 ms).
WORTH_THREADS = 300_000
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
        # Made complex, products take half the time in single precision (measured; none is saved in
        # double).
        stored = np.complex64 if dtype == np.float32 else dtype
        self._spectrum = np.concatenate((half, half[:, -2:0:-1]), axis=1, dtype=stored)
        self._crew = crew if math.prod(self._padded) >= WORTH_THREADS else Crew(1)
        self._lines = _BLOCK // np.dtype(dtype).itemsize
        ny, (my, mx) = self.shape[0], self._padded
        complex_type = np.result_type(dtype, np.complex64)
        # Transposed, so that the transforms along y run along contiguous memory.
        self._transform = np.empty((mx // 2 + 1, ny), complex_type)
        self._result = np.empty(self.shape, dtype)

        def lines(length, number):
            buffer = np.zeros((self._lines, length + _OFFSET), number)
            return buffer[:, :length]

        # For each thread: padded rows and columns, which keep their zeros, and room for results.
        self._buffers = [
            (lines(mx, dtype), lines(my, complex_type), lines(my, complex_type), lines(mx, dtype))
            for _ in range(self._crew.size)
        ]

    def __call__(self, field, longest=(0, 0), respond=None):
        """The convolution of a field (ny, nx); the next call overwrites it.

        Parameters
        ----------
        field : ndarray, shape (ny, nx)
        longest : (int, int)
            Numbers (count_y, count_x) of waves that `respond` is given.
        respond : callable, optional
            Takes the longest waves of the field, an ndarray of complex (count_x, count_y): wave
            numbers 0 to count_x - 1 along x; along y from 0 on and then the negative ones, as
            an FFT of the even length count_y has them. Returns waves to be added to the result.
            Other threads go on meanwhile.
        """
        ny, nx = self.shape
        mx = self._padded[1]
        transform, result, size = self._transform, self._result, self._lines
        half, extra = longest[0] // 2, longest[1]

        def rows_forward(worker, starts):
            padded = self._buffers[worker][0]
            for start in starts:
                block = field[start : start + size]
                count = len(block)
                padded[:count, :nx] = block
                ducc0.fft.r2c(padded[:count], axes=(1,), out=transform.T[start : start + count])

        def long_waves():
            waves = np.empty((extra, 2 * half), transform.dtype)
            blocks = [slice(start, min(start + size, extra)) for start in range(0, extra, size)]
            for lines in blocks:
                block = self._along_y(0, lines)
                waves[lines, :half], waves[lines, half:] = block[:, :half], block[:, -half:]
            added = respond(waves)
            for lines in blocks:
                block = self._along_y(0, lines)
                block *= self._spectrum[lines]
                block[:, :half] += added[lines, :half]
                block[:, -half:] += added[lines, half:]
                self._back_along_y(block, lines)

        def columns(worker, starts):
            for start in starts:
                lines = slice(start, start + size)
                block = self._along_y(worker, lines)
                block *= self._spectrum[lines]
                self._back_along_y(block, lines)

        def rows_backward(worker, starts):
            buffer = self._buffers[worker][3]
            for start in starts:
                lines = result[start : start + size]
                count = len(lines)
                block = ducc0.fft.c2r(
                    transform.T[start : start + count],
                    axes=(1,),
                    lastsize=mx,
                    forward=False,
                    out=buffer[:count],
                )
                lines[:] = block[:, :nx]

        self._crew.run(rows_forward, range(0, ny, size))
        self._crew.run(columns, range(extra, mx // 2 + 1, size), respond and long_waves)
        self._crew.run(rows_backward, range(0, ny, size))
        return result

    def _along_y(self, worker, lines):
        """Columns of the field's transform, transformed along y too, in a buffer of the worker."""
        _, padded, buffer, _ = self._buffers[worker]
        block = self._transform[lines]
        count = len(block)
        padded[:count, : self.shape[0]] = block
        return ducc0.fft.c2c(padded[:count], axes=(1,), out=buffer[:count])

    def _back_along_y(self, block, lines):
        """A block of them back into the field's transform; the block is overwritten."""
        ducc0.fft.c2c(block, axes=(1,), forward=False, out=block)
        self._transform[lines] = block[:, : self.shape[0]]


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
            # Its threads start when first used, and end with the last reference to it.
            self._pool = ThreadPoolExecutor(size - 1)

    def start(self, task):
        """Let another thread do a task, if there is one; gives a function that waits for it."""
        return self._pool.submit(task).result if self.size > 1 else lambda: None

    def run(self, task, starts, meanwhile=None):
        """Call ``task(worker, starts)`` in each thread, with the first lines of its blocks.

        The calling thread does `meanwhile` before it takes its share.
        """
        # One iterator for all: each takes the next block when it is done with one.
        starts = iter(starts)
        others = [self._pool.submit(task, worker, starts) for worker in range(1, self.size)]
        if meanwhile is not None:
            meanwhile()
        task(0, starts)
        for other in others:
            other.result()


def even_size(minimum):
    """Smallest even length not below `minimum` that the FFT handles fast."""
    return 2 * ducc0.fft.good_size((minimum + 1) // 2)


def exact_padding(shape):
    """Padded size on which opposite ends do not see each other."""
    return tuple(even_size(2 * n - 1) for n in shape)


def love_spectrum(padded, kernel):
    """Spectrum of a LoveKernel, wrapped to the nearest image on a grid of even size `padded`.

    Returns
    -------
    ndarray, shape (my // 2 + 1, mx // 2 + 1)
        At wave numbers from 0 on; the kernel is even in y and in x, and so its spectrum, which is
        real besides.
    """
    return even_spectrum(kernel.quadrant(tuple(m // 2 + 1 for m in padded)))


def even_spectrum(quadrant):
    """Spectrum, from wave number 0 on, of a kernel that is even in y and x, from its quadrant."""
    return ducc0.fft.dct(quadrant, type=1)
