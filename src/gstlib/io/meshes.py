"""Triangle meshes of stones (STL, PLY, OBJ), read through trimesh, in mm.

trimesh reads a damaged STL without complaint and returns what it could make of it, often nothing;
so the file is held against its own header first.
"""

import re
import struct
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gstlib.errors import InputError

if TYPE_CHECKING:
    import trimesh

__all__ = ["MESH_UNITS", "read_mesh"]

# Length of each unit in mm.
MESH_UNITS = {"mm": 1.0, "m": 1000.0, "in": 25.4}

# Largest extent (mm) of anything that a hand could grind with; outside it the unit is wrong.
_SMALLEST_STONE, _LARGEST_STONE = 1.0, 1000.0

_STL_HEADER, _STL_FACE = 84, 50  # bytes
_EXPORT_AGAIN = "Export or copy the mesh again."


def read_mesh(path: str | Path, *, unit: str = "mm") -> "trimesh.Trimesh":
    """Read a triangle mesh.

    Parameters
    ----------
    path : str or Path
        STL (binary or ASCII), PLY or OBJ.
    unit : {"mm", "m", "in"}
        Unit of the file's coordinates: none of the formats says it.

    Returns
    -------
    trimesh.Trimesh
        Vertices in mm, equal ones merged.

    Raises
    ------
    InputError
        The file is missing, empty, truncated or not a mesh; the mesh has no faces or vertices that
        are not numbers; or its size is not that of a stone, as when the unit is wrong.
    """
    import trimesh

    path = Path(path)
    if unit not in MESH_UNITS:
        raise InputError(path, f"unknown mesh unit {unit!r}", f"Use one of {list(MESH_UNITS)}.")
    if not path.is_file():
        raise InputError(path, "no such file", "Correct the path of the mesh in the config.")
    if path.stat().st_size == 0:
        raise InputError(path, "the file is empty", _EXPORT_AGAIN)
    kind = path.suffix.lower().lstrip(".")
    if kind not in ("stl", "ply", "obj"):
        raise InputError(
            path, f"'{path.suffix}' is not a mesh format known here", "Use .stl, .ply or .obj."
        )
    if kind == "stl":
        _check_stl(path)
    try:
        mesh = trimesh.load_mesh(path, file_type=kind, process=False)
        faces, vertices = np.asarray(mesh.faces), np.asarray(mesh.vertices, dtype=float)
    except Exception as error:  # trimesh raises whatever its parsers raise
        raise InputError(
            path, f"cannot be read as {kind.upper()} ({type(error).__name__}: {error})",
            "Export it again, as triangles.",
        ) from error  # fmt: skip
    if len(faces) == 0:
        raise InputError(path, "the mesh has no faces", "Export it again, with its triangles.")
    bad = int((~np.isfinite(vertices)).any(axis=1).sum())
    if bad:
        raise InputError(
            path, f"{bad} of {len(vertices)} vertices are not numbers", "Repair the mesh."
        )
    _check_size(path, float(np.ptp(vertices, axis=0).max()), unit)
    mesh.apply_scale(MESH_UNITS[unit])
    mesh.merge_vertices()
    return mesh


def _check_stl(path: Path) -> None:
    """Hold an STL file against its own header (binary) or its last line (ASCII)."""
    size = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(1024)
        file.seek(max(0, size - 1024))
        end = file.read()
    promised = struct.unpack_from("<I", start, 80)[0] if size >= _STL_HEADER else 0
    whole = _STL_HEADER + _STL_FACE * promised
    if size >= _STL_HEADER and size == whole:
        return
    # Some binary files begin with "solid" too, but no text has zero bytes.
    if start.lstrip().lower().startswith(b"solid") and b"\0" not in start:
        if not re.search(rb"endsolid[^\n]*\s*$", end, re.IGNORECASE):
            raise InputError(
                path, "the ASCII STL ends without 'endsolid': it is cut", _EXPORT_AGAIN
            )
        return
    if size < _STL_HEADER:
        problem = f"{size} bytes are less than an STL header: the file is truncated or not an STL"
    else:
        problem = (
            f"its header announces {promised} faces, which take {whole} bytes, but the file has "
            f"{size}: it is {'truncated' if size < whole else 'damaged'} or not an STL"
        )
    raise InputError(path, problem, _EXPORT_AGAIN)


def _check_size(path: Path, extent: float, unit: str) -> None:
    """Refuse a mesh whose largest extent (in `unit`) is not that of a stone."""
    if _SMALLEST_STONE <= extent * MESH_UNITS[unit] <= _LARGEST_STONE:
        return
    # Metres and millimetres are what scanning software writes: name them first.
    fitting = [
        name
        for name in ("m", "mm", "in")
        if name != unit and 10 <= extent * MESH_UNITS[name] <= _LARGEST_STONE
    ]
    names = {"m": "metres", "mm": "millimetres", "in": "inches"}
    if fitting:
        remedy = f"It looks like {names[fitting[0]]}: set mesh_unit: {fitting[0]}."
    else:
        remedy = f"Scale the mesh to one of the units {list(MESH_UNITS)} and set mesh_unit."
    raise InputError(
        path, f"its largest extent is {extent:.4g} {unit}, which is no stone's size", remedy
    )
