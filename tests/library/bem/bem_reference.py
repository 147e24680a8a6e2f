"""Surfaces for tests, and a dense matrix for small grids from Love's closed form."""

import math

import numpy as np

MODULUS = 12820.0


def dense_matrix(shape, spacing):
    """K (ny·nx, ny·nx): displacement of each element from unit pressure on each other.

    By Love's closed form for a rectangle (Johnson, *Contact Mechanics* (1985), eq. 3.25).
    """
    dy, dx = np.broadcast_to(spacing, 2)
    rows, columns = np.indices(shape)

    def corner(y, x):
        return y * np.arcsinh(x / np.abs(y)) + x * np.arcsinh(y / np.abs(x))

    quadrant = np.zeros(shape)
    for up, right in np.ndindex(2, 2):
        sign = 1 if up == right else -1
        quadrant += sign * corner((rows + up - 0.5) * dy, (columns + right - 0.5) * dx)
    quadrant /= math.pi * MODULUS
    rows_apart = abs(rows.reshape(-1, 1) - rows.ravel())
    columns_apart = abs(columns.reshape(-1, 1) - columns.ravel())
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
