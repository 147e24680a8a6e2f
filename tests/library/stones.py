"""A rough stone of which scans are found again: its mesh, and scans of it."""

import numpy as np
import trimesh
from gstlib.surfaces.footprints import PatchPosition
from scipy.ndimage import gaussian_filter, map_coordinates

FACE, FINE = 24.0, 0.02  # mm
# How it lies in the mesh's coordinates.
TURN = trimesh.transformations.euler_matrix(0.7, -0.4, 1.9)


def rough_stone(path):
    """A slab with a rough upper face: its heights on fine elements, and its mesh of 0.2 mm."""
    rng = np.random.default_rng(8)
    waves = sum(gaussian_filter(rng.normal(size=2 * (round(FACE / FINE),)), s) * s for s in (6, 25))
    heights = 0.03 * waves / waves.std()
    y, x = np.mgrid[0:FACE:121j, 0:FACE:121j]
    at = y / FINE - 0.5, x / FINE - 0.5
    top = map_coordinates(gaussian_filter(heights, 5), at, mode="nearest")
    n, count = 121, 121 * 121
    corner = np.arange(count).reshape(n, n)[:-1, :-1].ravel()
    faces = np.array([[0, 1, n + 1], [0, n + 1, n]])
    up = (corner[:, None, None] + faces).reshape(-1, 3)
    points = np.stack([x, y, top], axis=-1).reshape(-1, 3)
    under = np.stack([x, y, np.full_like(x, -8)], axis=-1).reshape(-1, 3)
    slab = trimesh.Trimesh(np.vstack([points, under]), np.vstack([up, up[:, ::-1] + count]))
    slab.apply_transform(TURN)
    slab.export(path)
    return heights


def taken(heights, centre, turn, side, step, mirrored=False):
    """A scan of the stone with its centre at (y, x), mm."""
    along = (np.arange(round(side / step)) - (round(side / step) - 1) / 2) * step
    y, x = PatchPosition(*centre, turn).points(
        along[:, None], (-along if mirrored else along)[None, :]
    )
    return map_coordinates(heights, [y / FINE - 0.5, x / FINE - 0.5], order=3)
