"""Stones of which scans are found again: a rough one with its mesh, and waves known everywhere."""

import numpy as np
import trimesh
from scipy.ndimage import gaussian_filter, map_coordinates

from gstlib.surfaces.footprints import PatchPosition

FACE, FINE = 24.0, 0.02  # mm
# How it lies in the mesh's coordinates.
TURN = trimesh.transformations.euler_matrix(0.7, -0.4, 1.9)


def rough_stone(path):
    """A slab with a rough upper face: its heights on fine elements, and its mesh of 0.2 mm."""
    noise = np.random.default_rng(8)
    points = round(FACE / FINE)
    waves = sum(
        gaussian_filter(noise.normal(size=(points, points)), s) * s for s in (6, 25)
    )
    heights = 0.03 * waves / waves.std()
    n = 121
    y, x = np.mgrid[0 : FACE : n * 1j, 0 : FACE : n * 1j]
    top = sampled(gaussian_filter(heights, 5), y, x, order=3, mode="nearest")
    corner = np.arange(n * n).reshape(n, n)[:-1, :-1].reshape(-1, 1, 1)
    up = np.add(corner, [[0, 1, n + 1], [0, n + 1, n]]).reshape(-1, 3)
    sides = [
        np.stack([x, y, z], axis=-1).reshape(-1, 3) for z in (top, np.full_like(x, -8))
    ]
    slab = trimesh.Trimesh(np.vstack(sides), np.vstack([up, up[:, ::-1] + n * n]))
    slab.apply_transform(TURN)
    slab.export(path)
    return heights


def taken(heights, centre, turn, side, step, mirrored=False):
    """A scan of the stone with its centre at (y, x), mm."""
    count = round(side / step)
    along = (np.arange(count) - (count - 1) / 2) * step
    y, x = PatchPosition(*centre, turn).points(
        along[:, None], -along if mirrored else along
    )
    return sampled(heights, y, x, order=3)


def sampled(heights, y, x, **options):
    """Heights of the stone at (y, x), mm."""
    return map_coordinates(heights, [y / FINE - 0.5, x / FINE - 0.5], **options)


def waves(seed, shortest, longest, rms_mm, *, across_only=False):
    """Heights (mm) of random waves at (y, x), mm; those of striae run along x alone."""
    rng, count = np.random.default_rng(seed), 120
    length = shortest * (longest / shortest) ** rng.random(count)
    way, phase = rng.uniform(0, 2 * np.pi, (2, count))
    amplitude = length**0.8 * rng.normal(size=count)
    amplitude *= rms_mm / np.sqrt(np.sum(amplitude**2) / 2)
    along = 0 * way if across_only else np.sin(way)

    def heights(y, x):
        y, x = (each[..., None] for each in np.broadcast_arrays(y, x))
        distance = along * y + np.cos(way) * x
        return np.sin(2 * np.pi / length * distance + phase) @ amplitude

    return heights


def seen(heights, spacing, shift=(0.0, 0.0), turn_deg=0.0, shape=(96, 112)):
    """Heights on the points of a scan whose middle lies at `shift` (mm), turned x towards y."""
    v, u = (
        step * (np.arange(count) - (count - 1) / 2)
        for step, count in zip(spacing, shape, strict=True)
    )
    return heights(*PatchPosition(*shift, turn_deg).points(v[:, None], u))
