"""Convolution of fields with Love's kernel, by FFT on a padded grid.

Two ways. `EvenConvolution` is exact: the grid is padded to twice its size. `SplitConvolution` takes
a third of the time: the kernel 1/r has no end, so it is split as in Ewald's sum (P. P. Ewald, Ann.
Phys. 369 (1921) 253),

    K(r) = [K(r) − erf(r/σ)/(πE*r)] + erf(r/σ)/(πE*r).

The first part ends after a few σ, so a margin of that width is enough padding. The second part is
smooth, so a coarse grid can represent it, and its padding costs little. The longest waves of the
fine grid's transform carry load to the coarse grid and displacement back. A Gaussian smooths them
each way, so neither rings far. Both Gaussians are divided out of the coarse kernel in advance.
"""

import math

import numpy as np
import scipy

from .transforms import from_waves, from_waves_inplace, to_waves, to_waves_inplace

__all__ = [
    "EvenConvolution",
    "SplitConvolution",
    "even_size",
    "even_spectrum",
    "exact_padding",
    "love_kernel",
]

# Lines per block times bytes of a real number. They are few enough to stay in cache, and so many
# that the calls cost little (measured: flat from 32 to 128 lines).
_BLOCK = 256
# Numbers added to each line of a buffer, because lines a power of two apart share cache sets.
# (Measured: transforms of 1024 numbers in single precision take 2.6 times as long.)
_OFFSET = 8
# Measured together, for an error of 2e-6 of the largest displacement on noise (smooth loads: 1e-6).
# Elements per coarse element; σ over the coarse spacing; width of the margin over σ.
_COARSENING, _SIGMA, _MARGIN = 5, 2.5, 5.0
# The coarse kernel fades out over this share of its length.
_FADE = 0.5
# Splitting saves time if the near part's grid is smaller than this share of the exact one.
_WORTH_SPLITTING = 0.5


class EvenConvolution:
    """Circular convolution on a padded grid with a kernel that is even in both axes.

    Transforms run along x first, then along y, in blocks of fixed size: zero rows are never
    transformed, and each block stays in cache.

    Parameters
    ----------
    shape : (int, int)
        Shape of the fields (ny, nx).
    spectrum : ndarray, shape (my // 2 + 1, mx // 2 + 1)
        Spectrum of the kernel, on the padded grid (my, mx), at wave numbers from 0 on.
    dtype : data-type
        Precision of the computation: single or double.
    padded : (int, int), optional
        (my, mx), if not even. At `shape` itself, without padding, fields are periodic.
    """

    def __init__(self, shape, spectrum, dtype, padded=None):
        my, mx = padded or (2 * (n - 1) for n in spectrum.shape)
        self._shape, self._padded = shape, (my, mx)
        wave = np.result_type(dtype, np.complex64)
        # Transposed like the spectrum of the field below, and mirrored to all wave numbers along y.
        # As complex numbers, products take half the time in single precision (measured; no less in
        # double).
        half = spectrum.T
        mirrored = half[:, (my - 1) // 2 : 0 : -1]
        stored = np.complex64 if dtype == np.float32 else dtype
        self._spectrum = np.concatenate((half, mirrored), axis=1, dtype=stored)
        # Memory is kept from call to call: fresh pages are slow to touch. The transform is
        # transposed, so transforms along y run along contiguous memory.
        lines = _BLOCK // np.dtype(dtype).itemsize
        self._transform = np.empty((mx // 2 + 1, shape[0]), wave)
        rows = np.empty((lines, mx + _OFFSET), dtype)
        columns = np.empty((lines, my + _OFFSET), wave)
        self._rows, self._columns = rows[:, :mx], columns[:, :my]
        self._result = np.empty(shape, dtype)

    def __call__(self, field, longest=(0, 0), respond=None):
        """The convolution of a field, shape (ny, nx), which the next call overwrites.

        `respond`, if given, takes the `longest` waves (count_y, count_x) of the field, complex,
        shape (count_x, count_y). Wave numbers are 0 to count_x - 1 along x. Along y they are in the
        order of an FFT of the even length count_y, from 0 on and then the negative ones. It returns
        waves that are added to the waves of the result.
        """
        ny, nx = self._shape
        my, mx = self._padded
        transform = self._transform
        half, extra = longest[0] // 2, longest[1]
        for lines, block in self._blocks(self._rows, 0, ny):
            block[:, :nx] = field[lines]
            block[:, nx:] = 0
            to_waves(block, transform.T[lines])

        if respond is not None:
            block = np.empty((extra, my), transform.dtype)
            self._convolve(slice(extra), block, half, respond)
        for lines, block in self._blocks(self._columns, extra, mx // 2 + 1):
            self._convolve(lines, block)

        for lines, block in self._blocks(self._rows, 0, ny):
            from_waves(transform.T[lines], block)
            self._result[lines] = block[:, :nx]
        return self._result

    def _convolve(self, lines, block, half=0, respond=None):
        """Convolve lines of the transform along y, in the memory of a block."""
        ny = self._shape[0]
        block[:, :ny] = self._transform[lines]
        block[:, ny:] = 0
        waves, added = to_waves_inplace(block), None
        if respond is not None:
            added = respond(np.hstack((waves[:, :half], waves[:, -half:])))
        waves *= self._spectrum[lines]
        if added is not None:
            waves[:, :half] += added[:, :half]
            waves[:, -half:] += added[:, half:]
        self._transform[lines] = from_waves_inplace(waves)[:, :ny]

    def _blocks(self, buffer, start, stop):
        """Lines from start to stop, and the part of the buffer for them."""
        for first in range(start, stop, len(buffer)):
            block = buffer[: stop - first]
            yield slice(first, first + len(block)), block


class SplitConvolution:
    """Displacement (mm) of a pressure field (MPa), shape (ny, nx), in single precision.

    `kernel` gives a quadrant of the kernel, shape (my, mx) (mm/MPa). This is Love's kernel for a
    half-space with this `contact_modulus` (MPa), plus any part that reaches less far than the
    margin.
    """

    def __init__(self, shape, spacing, contact_modulus, kernel):
        sigma = _sigma(spacing)
        padded = _margin_padding(shape, spacing)
        lengths = np.multiply(padded, spacing)
        coarse = tuple(even_size(math.ceil(side * _SIGMA / sigma)) for side in lengths)
        coarse_spacing = lengths / coarse
        element = math.prod(spacing) / (math.pi * contact_modulus)

        quadrant = tuple(m // 2 + 1 for m in padded)
        near = kernel(quadrant)
        near -= element * _far_field(quadrant, spacing, sigma)
        self._near = EvenConvolution(shape, even_spectrum(near), np.float32)
        far = element * _coarse_kernel(coarse, coarse_spacing, sigma)
        self._far = EvenConvolution(coarse, even_spectrum(far), np.float32)

        # To the coarse grid, into its middle; and back.
        grids = zip(coarse, coarse_spacing, padded, shape, strict=True)
        down_y, down_x = (
            _smoothing(m, step, sigma) * _shift(m, (size - n) / (2 * size))
            for m, step, size, n in grids
        )
        down = down_x[: coarse[1] // 2 + 1, None] * down_y / math.prod(coarse)
        up = down.conj() * math.prod(padded)
        self._down = down.astype(np.complex64)
        self._up = up.astype(np.complex64)
        self._coarse = coarse

    @staticmethod
    def saves(shape, spacing, reach):
        """Whether a kernel that differs from Love's out to `reach` (mm) is faster with it."""
        if reach > _MARGIN * _sigma(spacing):
            return False
        near = math.prod(_margin_padding(shape, spacing))
        exact = math.prod(exact_padding(shape))
        return near < _WORTH_SPLITTING * exact

    def __call__(self, pressure):
        """The displacement, shape (ny, nx), which the next call overwrites."""
        size_y, size_x = self._coarse
        return self._near(pressure, (size_y, size_x // 2 + 1), self._from_afar)

    def _from_afar(self, waves):
        """Waves of the far part's displacement, from the waves of the pressure."""
        size_y, size_x = self._coarse
        waves *= self._down
        load = scipy.fft.irfft2(waves, (size_y, size_x), axes=(1, 0), norm="forward")
        displacement = self._far(load.T).T
        waves = scipy.fft.rfft2(displacement, axes=(1, 0))
        waves *= self._up
        return waves


def even_size(minimum):
    """Smallest even length not below `minimum` that the FFT handles fast."""
    return 2 * scipy.fft.next_fast_len((minimum + 1) // 2)


def exact_padding(shape):
    """Padded size on which opposite ends do not affect each other."""
    return tuple(even_size(2 * n - 1) for n in shape)


def love_kernel(shape, spacing, contact_modulus):
    """Displacement at element centres from unit pressure on the element at the origin.

    Entry [i, j] is the displacement (mm/MPa, positive into the half-space) at (y, x) =
    (i·dy, j·dx). The kernel is even in x and in y, so one quadrant contains all of it. Source:
    A. E. H. Love, Phil. Trans. A 228 (1929) 377; Johnson, *Contact Mechanics* (1985), eq. 3.25.
    """
    dy, dx = spacing
    # The integral of 1/r over an element is a difference of its antiderivative between the
    # corners. Neighbours share corners: evaluate each once, then difference along x and y.
    y = (np.arange(shape[0] + 1) - 0.5)[:, None] * dy
    x = (np.arange(shape[1] + 1) - 0.5)[None, :] * dx

    def antiderivative(one, other):
        """One of its two terms: one·asinh(other/|one|)."""
        term = other / np.abs(one)
        np.arcsinh(term, out=term)
        term *= one
        return term

    corners = antiderivative(x, y)
    symmetric = dy == dx and shape[0] == shape[1]
    corners = corners + (corners.T if symmetric else antiderivative(y, x))
    integral = np.diff(np.diff(corners, axis=0), axis=1)
    integral /= math.pi * contact_modulus
    return integral


def even_spectrum(quadrant):
    """Spectrum of a kernel that is even in y and x, and wrapped to the nearest image.

    It is real, and at wave numbers from 0 on. Of a grid of even size (my, mx), the quadrant of the
    kernel, which is overwritten, and its spectrum have the shape (my // 2 + 1, mx // 2 + 1).
    """
    return scipy.fft.dctn(quadrant, type=1, overwrite_x=True)


def _sigma(spacing):
    return _SIGMA * _COARSENING * max(spacing)


def _margin_padding(shape, spacing):
    """Size of the grid on which the near part is convolved."""
    margin = _MARGIN * _sigma(spacing)
    lengths = zip(shape, spacing, strict=True)
    return tuple(even_size(n + math.ceil(margin / step)) for n, step in lengths)


def _far_field(quadrant, spacing, sigma):
    """erf(r/σ)/r (1/mm) at the offsets of a quadrant."""
    y, x = (np.arange(n) * step for n, step in zip(quadrant, spacing, strict=True))
    distance = np.hypot(y[:, None], x)
    distance[0, 0] = 1.0  # replaced below
    field = 1 / distance
    # From 5.9 on, erf is 1 in double precision.
    reach = 5.9 * sigma
    inner = np.ix_(y < reach, x < reach)
    field[inner] *= [[math.erf(r / sigma) for r in row] for row in distance[inner]]
    field[0, 0] = 2 / (math.sqrt(math.pi) * sigma)
    return field


def _coarse_kernel(coarse, spacing, sigma):
    """Quadrant of erf(r/σ)/r, freed of the smoothing before and after the convolution."""
    # It fades out beyond its needed length: a sharp end has short waves, which would grow here.
    long = tuple(math.ceil((1 + _FADE) * m) for m in coarse)
    fades, growths = [], []
    for m, n, step in zip(coarse, long, spacing, strict=True):
        place = np.clip((np.arange(n + 1) - m) / (n - m), 0, 1)
        fades.append([0.5 * math.erfc(8 * (p - 0.5)) for p in place])
        wave_number = math.pi * np.arange(n + 1) / (n * step)
        growths.append(np.exp((wave_number * sigma) ** 2 / 4) / (2 * n))
    field = _far_field(tuple(n + 1 for n in long), spacing, sigma)
    smoothed = even_spectrum(field * np.outer(*fades))
    freed = even_spectrum(smoothed * np.outer(*growths))
    my, mx = coarse
    return freed[: my + 1, : mx + 1]


def _smoothing(size, spacing, sigma):
    """exp(−q²σ²/8) at the wave numbers q of a grid, and 0 at the last, which has no sign."""
    wave_number = 2 * math.pi * _waves(size) / (size * spacing)
    smoothing = np.exp(-((wave_number * sigma) ** 2) / 8)
    smoothing[size // 2] = 0.0
    return smoothing


def _shift(size, share):
    """Factors that shift waves by this share of the grid."""
    return np.exp(-2j * math.pi * _waves(size) * share)


def _waves(size):
    """Waves in the grid's length, in the order of an FFT of even size."""
    return np.fft.ifftshift(np.arange(size) - size // 2)
