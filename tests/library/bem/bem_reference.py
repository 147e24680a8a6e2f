"""Surfaces for tests, and a dense matrix for small grids from Love's closed form."""

import math

import numpy as np

import gstlib

MODULUS = 12820.0


def dense_matrix(shape, spacing):
    """K (ny·nx, ny·nx): displacement of each element from unit pressure on each other.

    By Love's closed form for a rectangle (Johnson, *Contact Mechanics* (1985), eq. 3.25).
    """
    dy, dx = np.broadcast_to(spacing, 2)
    y = (np.arange(shape[0] + 1)[:, None] - 0.5) * dy
    x = (np.arange(shape[1] + 1) - 0.5) * dx
    corners = y * np.arcsinh(x / np.abs(y)) + x * np.arcsinh(y / np.abs(x))
    quadrant = np.diff(np.diff(corners, axis=0)) / (math.pi * MODULUS)
    rows, columns = np.indices(shape).reshape(2, -1)
    apart = abs(np.subtract.outer(rows, rows)), abs(np.subtract.outer(columns, columns))
    return quadrant[apart]


def self_affine(n, seed=0, *, length=0.85, roll_off=0.2, rms=0.005):
    """Self-affine n × n surface (mm) with a Hurst exponent of 0.8, from four elements on."""
    spacing, rng = length / n, np.random.default_rng(seed)
    waves = {"hurst_exponent": 0.8, "roll_off": roll_off, "shortest": 4 * spacing}
    heights = gstlib.self_affine_field(rng, n, spacing, **waves).astype(float)
    return heights * (rms / heights.std())


def centred(n, spacing):
    """Coordinates (y, x) of elements' centres from the middle of a square grid (mm)."""
    along = (np.arange(n) - (n - 1) / 2) * spacing
    return np.meshgrid(along, along, indexing="ij")


def sphere(n, spacing, radius):
    """Heights of a sphere's cap, parabolic as in Hertz's theory, between four elements (n even)."""
    y, x = centred(n, spacing)
    return -(y**2 + x**2) / (2 * radius)
