"""Displacement at a third of the price: the kernel split into a near and a smooth far part.

The exact convolution pads the grid to twice its size, for the kernel 1/r has no end. Split as in
Ewald's sum (P. P. Ewald, Ann. Phys. 369 (1921) 253),

    K(r) = [K(r) − erf(r/σ)/(πE*r)] + erf(r/σ)/(πE*r),

its first part ends after a few σ, so that a margin of that width is padding enough; its second is
smooth, so that a coarse grid holds it, on which padding costs little. Load gets to the coarse grid
and displacement back by the longest waves of the fine grid's own transform, smoothed by a Gaussian
on each way, so that neither rings far; the coarse kernel is freed of both in advance.
"""

import math

import ducc0
import numpy as np

from .convolution import Crew, EvenConvolution, even_size, even_spectrum, exact_padding

__all__ = ["SplitConvolution"]

# Measured together for an error of 2e-6 of the largest displacement, on noise (smooth loads: 1e-6).
# Elements per coarse one; σ over the coarse spacing; width of the margin over σ.
_COARSENING, _SIGMA, _MARGIN = 5, 2.5, 5.0
# The coarse kernel fades out over this share of its length.
_FADE = 0.5
# Worth it where the near part's grid is smaller than this share of the exact one (measured).
_WORTH_SPLITTING = 0.5


class SplitConvolution:
    """Convolution of fields (ny, nx) with Love's kernel, in single precision.

    Parameters
    ----------
    shape : (int, int)
    kernel : LoveKernel
    crew : Crew
    """

    def __init__(self, shape, kernel, crew):
        spacing = kernel.spacing
        sigma, padded = _sigma(spacing), _padding(shape, spacing)
        lengths = tuple(m * step for m, step in zip(padded, spacing, strict=True))
        coarse = tuple(even_size(math.ceil(length * _SIGMA / sigma)) for length in lengths)
        coarse_spacing = tuple(length / m for length, m in zip(lengths, coarse, strict=True))
        element = math.prod(spacing) / (math.pi * kernel.contact_modulus)

        quadrant = tuple(m // 2 + 1 for m in padded)
        near = kernel.quadrant(quadrant)
        near -= element * _far_field(quadrant, spacing, sigma)
        self._near = EvenConvolution(shape, even_spectrum(near), np.float32, crew)
        far = element * _coarse_kernel(coarse, coarse_spacing, sigma)
        self._far = EvenConvolution(coarse, even_spectrum(far), np.float32, Crew(1))

        # To the coarse grid, into its middle; and back.
        down_y, down_x = (
            _smoothing(m, step, sigma) * _shift(m, (size - n) / (2 * size))
            for m, step, size, n in zip(coarse, coarse_spacing, padded, shape, strict=True)
        )
        down = down_x[: coarse[1] // 2 + 1, None] * down_y / math.prod(coarse)
        up = down.conj() * math.prod(padded)
        self._down, self._up = down.astype(np.complex64), up.astype(np.complex64)
        self._coarse = coarse

    @staticmethod
    def saves(shape, spacing):
        """Whether it is faster than the exact convolution."""
        near, exact = math.prod(_padding(shape, spacing)), math.prod(exact_padding(shape))
        return near < _WORTH_SPLITTING * exact

    def __call__(self, pressure, elements=None):
        """Displacement of a pressure, on the grid or on some elements, as of EvenConvolution."""
        size_y, size_x = self._coarse
        return self._near(pressure, elements, (size_y, size_x // 2 + 1), self._from_afar)

    def _from_afar(self, waves):
        """Waves of the far part's displacement, from those of the pressure."""
        waves *= self._down
        load = ducc0.fft.c2r(waves, axes=(1, 0), lastsize=self._coarse[1], forward=False)
        waves = ducc0.fft.r2c(self._far(load.T).T, axes=(1, 0))
        waves *= self._up
        return waves


def _sigma(spacing):
    return _SIGMA * _COARSENING * max(spacing)


def _padding(shape, spacing):
    """Size of the grid on which the near part is convolved."""
    margin = _MARGIN * _sigma(spacing)
    return tuple(
        even_size(n + math.ceil(margin / step)) for n, step in zip(shape, spacing, strict=True)
    )


def _far_field(quadrant, spacing, sigma):
    """erf(r/σ)/r (1/mm) at the offsets of a quadrant."""
    y, x = (np.arange(n) * step for n, step in zip(quadrant, spacing, strict=True))
    distance = np.hypot(y[:, None], x)
    distance[0, 0] = 1.0  # replaced below
    field = 1 / distance
    # From 5.9 on, erf is 1 in double precision.
    inner = np.ix_(y < 5.9 * sigma, x < 5.9 * sigma)
    field[inner] *= [[math.erf(r / sigma) for r in row] for row in distance[inner]]
    field[0, 0] = 2 / (math.sqrt(math.pi) * sigma)
    return field


def _coarse_kernel(coarse, spacing, sigma):
    """Quadrant of erf(r/σ)/r, freed of the smoothing before and after the convolution."""
    # Beyond its needed length it is faded out: an end would have short waves, which now grow.
    long = tuple(math.ceil((1 + _FADE) * m) for m in coarse)
    fades, growths = [], []
    for m, n, step in zip(coarse, long, spacing, strict=True):
        place = np.clip((np.arange(n + 1) - m) / (n - m), 0, 1)
        fades.append([0.5 * math.erfc(8 * (p - 0.5)) for p in place])
        wave_number = math.pi * np.arange(n + 1) / (n * step)
        growths.append(np.exp((wave_number * sigma) ** 2 / 4) / (2 * n))
    kernel = _far_field(tuple(n + 1 for n in long), spacing, sigma) * np.outer(*fades)
    freed = even_spectrum(even_spectrum(kernel) * np.outer(*growths))
    return freed[: coarse[0] + 1, : coarse[1] + 1]


def _smoothing(size, spacing, sigma):
    """exp(−q²σ²/8) at the wave numbers q of a grid; 0 at the last, which has no sign."""
    wave_number = 2 * math.pi * _waves(size) / (size * spacing)
    smoothing = np.exp(-((wave_number * sigma) ** 2) / 8)
    smoothing[size // 2] = 0.0
    return smoothing


def _shift(size, share):
    """Factors that move waves on by this share of the grid."""
    return np.exp(-2j * math.pi * _waves(size) * share)


def _waves(size):
    """Waves in the grid's length, in the order of an FFT of even size."""
    return np.concatenate((np.arange(size // 2), np.arange(-size // 2, 0)))
