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

__all__ = ["EvenConvolution", "even_size", "love_spectrum", "shared_among"]

# Lines per block: few enough to stay in cache, many enough that the cost of the calls vanishes
# (measured: flat from 32 to 96).
_LINES = 64
# Lines of a buffer lie this many numbers more apart: at a power of two they share cache sets
# (measured: transforms of 1024 numbers in single precision take 2.6 times as long).
_OFFSET = 8


class EvenConvolution:
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


def shared_among(workers):
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
