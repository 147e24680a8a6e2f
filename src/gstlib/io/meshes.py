"""Triangle meshes of stones (STL, PLY, OBJ), read through trimesh, in mm.

trimesh reads a damaged file without complaint and returns what it could make of it, often nothing;
so the file is held against itself first (`gstlib.io.mesh_files`), and what came out against it.
"""

import io
import logging
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gstlib.errors import InputError
from gstlib.io.mesh_files import PLAIN, obj_vertices, ply_vertices

if TYPE_CHECKING:
    import trimesh

__all__ = ["MESH_UNITS", "read_mesh", "read_points"]

_log = logging.getLogger(__name__)

# Length of each unit in mm.
MESH_UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "in": 25.4}

# Largest extent (mm) of anything that a hand could grind with; outside it the unit is wrong.
_SMALLEST_STONE, _LARGEST_STONE = 1.0, 1000.0
# A mesh whose faces together are less than this share of its extent squared is a line.
_NO_AREA = 1e-9

_POINT_TABLES = ("csv", "xyz", "txt", "asc")
_EXPORT_AGAIN = "Export or copy the mesh again."


def read_mesh(path: str | Path, *, unit: str = "mm") -> "trimesh.Trimesh":
    """Read a triangle mesh.

    Parameters
    ----------
    path : str or Path
        STL (binary or ASCII), PLY or OBJ. No other file is opened, whatever the mesh names.
    unit : {"mm", "cm", "m", "um", "in"}
        Unit of the file's coordinates: none of the formats says it.

    Returns
    -------
    trimesh.Trimesh
        Vertices in mm, equal ones merged; colours, textures and normals are left out.

    Raises
    ------
    InputError
        The file is missing, empty, truncated, damaged or not a mesh; the mesh has no faces, no
        area, or vertices that are not numbers; or its size is not that of a stone, as when the
        unit is wrong.

    Notes
    -----
    The memory needed is bounded by the size of the file, whatever its header announces: 10 to 25
    times as much for a mesh, at most 100 times for a text made of the shortest words there are.
    """
    import trimesh

    path = Path(path)
    kind, content = _content(path, unit, tuple(PLAIN))
    vertices, faces = _load(path, kind, content)
    _check_size(path, float(np.ptp(vertices, axis=0).max()), unit)
    mesh = trimesh.Trimesh(vertices * MESH_UNITS[unit], faces, process=False)
    if mesh.area < _NO_AREA * float(np.ptp(mesh.vertices, axis=0).max()) ** 2:
        raise InputError(
            path, "its faces have no area: their corners are in line", "Repair the mesh."
        )
    mesh.merge_vertices()
    return mesh


def read_points(path: str | Path, *, unit: str = "mm") -> np.ndarray:
    """Read the points of a mesh or of a table, whatever they are joined to.

    Parameters
    ----------
    path : str or Path
        STL, PLY or OBJ, or a text (CSV, XYZ, TXT, ASC) whose rows begin with x, y, z, separated by
        blanks, commas or semicolons; one row of names and comments (#) may stand above.
    unit : {"mm", "cm", "m", "um", "in"}
        Unit of the coordinates.

    Returns
    -------
    (n, 3) numpy.ndarray
        mm, in the order of the file.

    Raises
    ------
    InputError
        The file is missing, empty or damaged, or has no points.
    """
    path = Path(path)
    kind, content = _content(path, unit, (*PLAIN, *_POINT_TABLES))
    if kind == "ply":
        points = ply_vertices(path, content)
    elif kind == "obj":
        points = obj_vertices(path, content)
    elif kind == "stl":
        points, _ = _load(path, kind, content)
    else:
        points = _table(path, content)
    if len(points) == 0:
        raise InputError(path, "there are no points in it", "Export it again.")
    _check_numbers(path, points)
    return points * MESH_UNITS[unit]


def _content(path: Path, unit: str, kinds: tuple[str, ...]) -> tuple[str, bytes]:
    """Format (the suffix) and bytes of a file that is there and not empty."""
    if unit not in MESH_UNITS:
        raise InputError(path, f"unknown mesh unit {unit!r}", f"Use one of {list(MESH_UNITS)}.")
    if not path.is_file():
        raise InputError(path, "no such file", "Correct the path of the mesh in the config.")
    kind = path.suffix.lower().lstrip(".")
    if kind not in kinds:
        known = ", ".join(f".{kind}" for kind in kinds)
        raise InputError(path, f"'{path.suffix}' is not a mesh format known here", f"Use {known}.")
    content = path.read_bytes()
    if not content:
        raise InputError(path, "the file is empty", _EXPORT_AGAIN)
    return kind, content


def _load(path: Path, kind: str, content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3), float, in the file's unit, and faces (m, 3) of a mesh file, all of them."""
    import trimesh

    plain = PLAIN[kind](path, content)
    if plain.faces == 0:
        raise InputError(path, "the mesh has no faces", "Export it again, with its triangles.")
    try:
        # From memory, so that trimesh cannot look for materials beside the file.
        mesh = trimesh.load_mesh(io.BytesIO(plain.content), file_type=kind, process=False)
        vertices = np.array(mesh.vertices, dtype=float)
        faces = np.array(mesh.faces, dtype=np.int64)
    except Exception as error:  # trimesh raises whatever its parsers raise
        raise InputError(
            path, f"cannot be read as {kind.upper()} ({type(error).__name__}: {error})",
            "Export it again, as triangles.",
        ) from error  # fmt: skip
    if vertices.shape[1:] != (3,) or faces.shape != (plain.faces, 3):
        raise InputError(
            path, f"{len(faces)} of its {plain.faces} triangles can be read", _EXPORT_AGAIN
        )
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(
            path,
            f"a face has vertex {faces.min() if faces.min() < 0 else faces.max()}, counted from 0, "
            f"of {len(vertices)}",
            _EXPORT_AGAIN,
        )
    _check_numbers(path, vertices)
    return vertices, faces


def _table(path: Path, content: bytes) -> np.ndarray:
    """Points of a text, x, y, z first in each row."""
    points: list[list[float]] = []
    for number, line in enumerate(content.decode("utf-8", errors="replace").splitlines(), 1):
        words = line.split("#", 1)[0].replace(",", " ").replace(";", " ").split()
        if not words:
            continue
        try:
            x, y, z = (float(word) for word in words[:3])
        except ValueError as error:
            if not points:  # names of the columns
                continue
            raise InputError(
                path, f"row {number} does not begin with x, y, z", "Correct or remove it."
            ) from error
        points.append([x, y, z])
    return np.array(points).reshape(-1, 3)


def _check_numbers(path: Path, points: np.ndarray) -> None:
    bad = int((~np.isfinite(points)).any(axis=1).sum())
    if bad:
        raise InputError(path, f"{bad} of {len(points)} vertices are not numbers", "Repair it.")


def _check_size(path: Path, extent: float, unit: str) -> None:
    """Refuse a mesh whose largest extent (in `unit`) is not that of a stone."""
    if _SMALLEST_STONE <= extent * MESH_UNITS[unit] <= _LARGEST_STONE:
        return
    # Metres and millimetres are what scanning software writes: name them first.
    fitting = [
        name
        for name in ("m", "mm", "um", "in")
        if name != unit and 10 <= extent * MESH_UNITS[name] <= _LARGEST_STONE
    ]
    names = {"m": "metres", "mm": "millimetres", "um": "micrometres", "in": "inches"}
    if fitting:
        remedy = f"It looks like {names[fitting[0]]}: set mesh_unit: {fitting[0]}."
    else:
        remedy = f"Scale the mesh to one of the units {list(MESH_UNITS)} and set mesh_unit."
    raise InputError(
        path, f"its largest extent is {extent:.4g} {unit}, which is no stone's size", remedy
    )
