"""The generated specimen's mesh, as photogrammetry would have made it."""

import io
from pathlib import Path

import numpy as np

from gstlib.io.files import write_whole
from gstlib.specimen.pebble import even_triangulation
from gstlib.specimen.stone import Stone

__all__ = ["specimen_mesh", "write_stl"]

# The waves die out towards the rim between these distances from the centre (1 is the rim): there
# the surface turns over, and a height over the use-face's plane has no meaning.
_FADE_FROM, _FADE_TO = 0.8, 0.97


def specimen_mesh(
    stone: Stone, generator: np.random.Generator, *, edge_mm: float, noise_um: float
) -> tuple[np.ndarray, np.ndarray]:
    """Closed mesh of the stone: the use-face looks along +z, the square is centred on x = y = 0.

    Vertices sample the macroscale surface (photogrammetry sees nothing below its cut-off) and carry
    noise of their own. The underside carries the waves of another part of the same field.

    Parameters
    ----------
    stone : Stone
    generator : numpy.random.Generator
        For the noise.
    edge_mm : float
        Mean edge length, mm.
    noise_um : float
        R.m.s. of the noise in height, µm.

    Returns
    -------
    vertices : (n, 3) ndarray
        mm.
    faces : (m, 3) ndarray of int
        Vertex numbers, anticlockwise as seen from outside.
    """
    vertices, faces, upper = even_triangulation(stone.pebble, edge_mm)
    x, y, _ = vertices.T
    rim_distance = np.sqrt(stone.pebble.rim_distance_squared(x, y))
    along = np.clip((_FADE_TO - rim_distance) / (_FADE_TO - _FADE_FROM), 0, 1)
    fade = along**2 * (3 - 2 * along)
    # ASSUME: photogrammetry is a sharp low-pass at the cut-off, plus white noise in height.

    # Half a period away the field is another one; heights below look down
    period = len(stone.waviness) * stone.waviness_spacing
    offset = np.where(upper, 0.0, period / 2)
    waves = stone.waves(stone.square_mm / 2 - y + offset, stone.square_mm / 2 - x + offset)
    vertices[:, 2] += fade * np.where(upper, waves, -waves)
    vertices[:, 2] += fade * generator.normal(0.0, noise_um * 1e-3, len(vertices))
    return vertices, faces


def write_stl(path: str | Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Write a mesh as binary STL, complete or not at all."""
    import trimesh

    mesh = trimesh.Trimesh(vertices, faces, process=False)
    content = io.BytesIO()
    mesh.export(content, file_type="stl")
    write_whole(path, content.getvalue())
