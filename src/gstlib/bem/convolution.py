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

    It works in the memory of its crew: fresh memory is slow to touch, above all in threads.

    Parameters
    ----------
    shape : (int, int)
        Of the fields (ny, nx).
    spectrum : ndarray, shape (my // 2 + 1, mx // 2 + 1)
        Of the kernel, on the padded grid (my, mx), at wave numbers from 0 on.
    dtype : data-type
        Of fields and results: single or double precision.
    crew : Crew
        The threads; small grids do with one.
    """

    def __init__(self, shape, spectrum, dtype, crew):
        self.shape = shape
        self._dtype = np.dtype(dtype)
        self._padded = tuple(2 * (n - 1) for n in spectrum.shape)
        self._lines = _BLOCK // self._dtype.itemsize
        self._crew = crew
        self._threads = crew.size if math.prod(self._padded) >= WORTH_THREADS else 1
        # Transposed like the spectrum of the field below, and mirrored to all wave numbers along y.
        # Made complex, products take half the time in single precision (measured; none is saved in
        # double).
        half, stored = spectrum.T, np.complex64 if dtype == np.float32 else dtype
        self._spectrum = np.concatenate((half, half[:, -2:0:-1]), axis=1, dtype=stored)

    def __call__(self, field, elements=None, longest=(0, 0), respond=None):
        """The convolution of a field.

        Parameters
        ----------
        field : ndarray, shape (ny, nx), or (n,)
        elements : Elements, optional
            The n elements whose values `field` holds; the others are zero.
        longest : (int, int)
            Numbers (count_y, count_x) of waves that `respond` is given.
        respond : callable, optional
            Takes the longest waves of the field, an ndarray of complex (count_x, count_y): wave
            numbers 0 to count_x - 1 along x; along y from 0 on and then the negative ones, as
            an FFT of the even length count_y has them. Returns waves to be added to the result.
            Other threads go on meanwhile.

        Returns
        -------
        ndarray, shape (ny, nx), or (n,)
            On the whole grid, and then the crew's next convolution overwrites it; or on the
            elements, of float64.
        """
        (ny, nx), (my, mx), size = self.shape, self._padded, self._lines
        half, extra = longest[0] // 2, longest[1]
        number, wave = self._dtype, np.result_type(self._dtype, np.complex64)
        # Transposed, so that the transforms along y run along contiguous memory.
        transform = self._crew.memory("transform", (mx // 2 + 1, ny), wave)
        workers = range(self._threads)
        # Columns or rows of each thread, in the same memory. Columns first: they are mostly larger.
        columns, rows = (
            [self._crew.memory(worker, (size, length + _OFFSET), kind) for worker in workers]
            for length, kind in ((my, wave), (mx, number))
        )
        if elements is None:
            result = self._crew.memory("result", self.shape, number)
        else:
            result = np.empty(len(field))
            places, parts = elements.layout(self.shape, size, mx + _OFFSET)

        def rows_forward(worker, starts):
            memory = rows[worker]
            for start in starts:
                lines = slice(start, min(start + size, ny))
                block = memory[: lines.stop - start, :mx]
                if elements is None:
                    block[:, :nx] = field[lines]
                    block[:, nx:] = 0
                else:
                    part = parts[start // size]
                    block[:] = 0
                    memory.reshape(-1)[places[part]] = field[part]
                ducc0.fft.r2c(block, axes=(1,), out=transform.T[lines])

        def along_y(block, lines):
            block[:, :ny] = transform[lines]
            block[:, ny:] = 0
            ducc0.fft.c2c(block, axes=(1,), out=block)

        def back_along_y(block, lines):
            ducc0.fft.c2c(block, axes=(1,), forward=False, inorm=2, out=block)
            transform[lines] = block[:, :ny]

        def long_waves():
            lines = slice(extra)
            block = self._crew.memory("long waves", (extra, my + _OFFSET), wave)[:, :my]
            along_y(block, lines)
            added = respond(np.concatenate((block[:, :half], block[:, -half:]), axis=1))
            block *= self._spectrum[lines]
            block[:, :half] += added[:, :half]
            block[:, -half:] += added[:, half:]
            back_along_y(block, lines)

        def middle(worker, starts):
            for start in starts:
                lines = slice(start, min(start + size, mx // 2 + 1))
                block = columns[worker][: lines.stop - start, :my]
                along_y(block, lines)
                block *= self._spectrum[lines]
                back_along_y(block, lines)

        def rows_backward(worker, starts):
            memory = rows[worker]
            for start in starts:
                lines = slice(start, min(start + size, ny))
                block = memory[: lines.stop - start, :mx]
                ducc0.fft.c2r(
                    transform.T[lines], axes=(1,), lastsize=mx, forward=False, inorm=2, out=block
                )
                if elements is None:
                    result[lines] = block[:, :nx]
                else:
                    part = parts[start // size]
                    result[part] = memory.reshape(-1)[places[part]]

        run, threads = self._crew.run, self._threads
        run(rows_forward, range(0, ny, size), threads)
        run(middle, range(extra, mx // 2 + 1, size), threads, respond and long_waves)
        run(rows_backward, range(0, ny, size), threads)
        return result


class Crew:
    """Threads that share blocks of lines, and memory; the calling thread is one of them.

    Parameters
    ----------
    size : int
        Threads, at least 1.
    """

    def __init__(self, size):
        self.size = size
        self._memory = {}
        if size > 1:
            # Its threads start when first used, and end with the last reference to it.
            self._pool = ThreadPoolExecutor(size - 1)

    def memory(self, name, shape, dtype):
        """An array in memory of this name, with whatever its last user left there."""
        count = math.prod(shape) * np.dtype(dtype).itemsize
        if name not in self._memory or self._memory[name].size < count:
            self._memory[name] = np.empty(count, np.uint8)
        return self._memory[name][:count].view(dtype).reshape(shape)

    def start(self, task):
        """Let another thread do a task, if there is one; gives a function that waits for it."""
        return self._pool.submit(task).result if self.size > 1 else lambda: None

    def run(self, task, starts, threads, meanwhile=None):
        """Call ``task(worker, starts)`` in so many threads, with the first lines of its blocks.

        The calling thread does `meanwhile` before it takes its share.
        """
        # One iterator for all: each takes the next block when it is done with one.
        starts = iter(starts)
        others = [self._pool.submit(task, worker, starts) for worker in range(1, threads)]
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
    """Spectrum, from wave number 0 on, of a kernel even in y and x; in place of its quadrant."""
    return ducc0.fft.dct(quadrant, type=1, out=quadrant)
