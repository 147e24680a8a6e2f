"""Surfaces for tests, and a dense matrix for small grids from Love's closed form."""

import numpy as np

from gstlib.bem.closed_forms import love_rectangle_displacement

MODULUS = 12820.0


def dense_matrix(shape, spacing):
    """K (ny·nx, ny·nx): displacement of each element from unit pressure on each other."""
    dy, dx = np.broadcast_to(spacing, 2)
    y, x = np.indices(shape)
    quadrant = love_rectangle_displacement(x * dx, y * dy, (dx, dy), 1.0, MODULUS)
    rows_apart = abs(y.reshape(-1, 1) - y.ravel())
    columns_apart = abs(x.reshape(-1, 1) - x.ravel())
    return quadrant[rows_apart, columns_apart]


def self_affine(n, seed=0, *, length=0.85, roll_off=0.2, cut_off=4, rms=0.005):
    """Self-affine n × n surface (mm) with a Hurst exponent of 0.8; cut-off in elements."""
    rng = np.random.default_rng(seed)
    spacing = length / n
    along_x = np.fft.rfftfreq(n, spacing)
    along_y = np.fft.fftfreq(n, spacing)
    frequency = np.hypot(along_y[:, None], along_x)
    amplitude = np.maximum(frequency, 1 / roll_off) ** -1.8
    amplitude[frequency > n / (cut_off * length)] = 0
    amplitude[0, 0] = 0
    noise = np.fft.rfft2(rng.standard_normal((n, n)))
    heights = np.fft.irfft2(noise * amplitude, s=(n, n))
    return heights * (rms / heights.std())


def centred(n, spacing):
    """Coordinates (y, x) of elements' centres from the middle of a square grid (mm)."""
    along = (np.arange(n) - (n - 1) / 2) * spacing
    return np.meshgrid(along, along, indexing="ij")


def sphere(n, spacing, radius):
    """Heights of a sphere's cap, parabolic as in Hertz's theory, between four elements (n even)."""
    y, x = centred(n, spacing)
    return -(y**2 + x**2) / (2 * radius)
