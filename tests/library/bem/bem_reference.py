"""References of the tests' own: Love's kernel written out afresh, dense, for small grids."""

import itertools
import math

import numpy as np

MODULUS = 12820.0


def influence(y, x, dy, dx, modulus=MODULUS):
    """Displacement at (y, x) from unit pressure on a dy × dx rectangle at the origin.

    The logarithmic form of Johnson (1985), eq. 3.25, term by term.
    """

    def term(a, b):
        return a * math.log(b + math.hypot(a, b)) if a else 0.0

    total = 0.0
    for sy, sx in itertools.product((1, -1), repeat=2):
        yc, xc = y + sy * dy / 2, x + sx * dx / 2
        total += sy * sx * (term(xc, yc) + term(yc, xc))
    return total / (math.pi * modulus)


def dense_matrix(shape, spacing, modulus=MODULUS):
    """K (ny·nx, ny·nx): displacement of each element from unit pressure on each other."""
    dy, dx = np.broadcast_to(spacing, 2)
    quadrant = np.array(
        [
            [influence(i * dy, j * dx, dy, dx, modulus) for j in range(shape[1])]
            for i in range(shape[0])
        ]
    )
    row, column = np.indices(shape).reshape(2, -1)
    return quadrant[abs(row[:, None] - row), abs(column[:, None] - column)]


def self_affine(
    n, seed=0, *, length=0.85, hurst=0.8, roll_off=0.2, cut_off=4, rms=0.005, grid=None
):
    """Self-affine n × n surface (mm); cut-off in elements of a grid of `grid` (default n)."""
    rng = np.random.default_rng(seed)
    spacing = length / n
    frequency = np.hypot(np.fft.fftfreq(n, spacing)[:, None], np.fft.rfftfreq(n, spacing))
    amplitude = np.maximum(frequency, 1 / roll_off) ** (-hurst - 1)
    amplitude[frequency > (grid or n) / (cut_off * length)] = 0
    amplitude[0, 0] = 0
    noise = np.fft.rfft2(rng.standard_normal((n, n)))
    heights = np.fft.irfft2(noise * amplitude, s=(n, n))
    return heights * (rms / heights.std())


def sphere(n, spacing, radius):
    """Heights of a sphere's cap, parabolic as in Hertz's theory, between four elements (n even)."""
    at = (np.arange(n) - (n - 1) / 2) * spacing
    return -(at[:, None] ** 2 + at**2) / (2 * radius)
