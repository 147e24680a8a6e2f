"""Triangle meshes of stones (STL, PLY, OBJ, OFF, GLB, 3MF), read through trimesh, in mm.

trimesh reads a damaged file without complaint and returns the part that it understood. A cut file
must never pass for a smaller stone, so the number of its faces is compared with the stated one.
"""

import io
import itertools
import json
import logging
import re
import warnings
import zipfile
import zlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gstlib.errors import NOTE, InputError
from gstlib.io.files import check_size, check_unpacked

if TYPE_CHECKING:
    import trimesh

__all__ = ["UNITS", "is_closed", "is_mesh", "ply_with", "read_mesh", "units_of_size"]

_log = logging.getLogger(__name__)

_READ = (".stl", ".ply", ".obj", ".off", ".glb", ".3mf")
# Other formats of meshes: trimesh needs further packages for them, or reads them unchecked.
_NOT_READ = (".gltf", ".fbx", ".dae", ".wrl", ".x3d", ".usd", ".usdz", ".nxs", ".nxz", ".ctm")
# The units that trimesh finds: GLB prescribes metres, 3MF states its own.
_STATED = {"meters": "m", "meter": "m", "millimeters": "mm", "millimeter": "mm"}
_STATED |= {"centimeter": "cm", "micron": "um", "inch": "in"}
# Length of each unit in mm.
UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "in": 25.4}
# Largest extent (mm) of a stone that a hand could grind with; outside it the unit is wrong.
_SMALLEST_STONE, _LARGEST_STONE = 1.0, 1000.0
# ASSUME: a stone of which only one unit makes a size (mm) within these is in that unit.
_HAND_SIZED = 20.0, 300.0
# A mesh whose area vectors cancel to this share is closed, except for pin-holes from the scanner.
_CLOSED = 0.01
# A stone is one part; each takes trimesh a quarter of a millisecond, whatever is in it.
_MOST_PARTS = 10_000
# Faces and vertices that are zeros, as in a lost block of the file: so many, and ten times as many
# as are in any other place, where one vertex is. Rounding shrinks triangles to points, too, but
# everywhere.
_FEWEST_EMPTY, _ZEROS_TIMES = 3, 10
# Bytes of a 3MF's XML, each of which takes thirty of memory: a stone of a million triangles.
_LONGEST_XML = 1 << 26
# Bytes of a face in an OBJ: of a thousand corners, which trimesh needs a thousand times for.
_LONGEST_FACE = 10_000
# Types of numbers in a PLY, and those of NumPy.
_PLY_TYPES = {
    b"char": "i1", b"uchar": "u1", b"short": "i2", b"ushort": "u2", b"int": "i4", b"uint": "u4",
    b"float": "f4", b"double": "f8", b"int8": "i1", b"uint8": "u1", b"int16": "i2",
    b"uint16": "u2", b"int32": "i4", b"uint32": "u4", b"float32": "f4", b"float64": "f8",
}  # fmt: skip
# How many rows an element of a PLY has, and the words of the header that describe its properties.
_PlyElement = tuple[int, list[list[bytes]]]
_EXPORT_AGAIN = "Export the mesh again as triangles (binary STL or PLY)."


def read_mesh(path: str | Path, *, unit: str | None = None) -> "trimesh.Trimesh":
    """Read a triangle mesh.

    Parameters
    ----------
    path : str or Path
        STL (binary or ASCII), PLY, OBJ, OFF, 3MF or GLB; the parts of a scene keep their places.
    unit : {"mm", "cm", "m", "um", "in"}, optional
        Unit of the file's coordinates; None for the one that the file states, or else mm. 3MF
        states it: another is refused. GLB prescribes metres: because exporters write other units,
        another is accepted, with a warning. The other formats do not state one.

    Returns
    -------
    trimesh.Trimesh
        Vertices in mm, equal ones merged; colours, textures and normals are left out. A closed one
        that is inside out is turned, with a warning. Its metadata ``file_unit`` is the unit of the
        file, and ``states_unit`` is whether it states one.

    Raises
    ------
    InputError
        The file is missing, cut, damaged or not a mesh; the mesh has no faces, or vertices
        that are not finite; or its size is not that of a stone, as when the unit is wrong.
    """
    import trimesh

    path = Path(path)
    if unit not in (None, *UNITS):
        raise InputError(path, f"unknown mesh unit {unit!r}", f"Use one of {list(UNITS)}.")
    content = _read_content(path)
    announced = _announced_faces(path, content)
    vertices, faces, stated = _load(path, content)
    _check_faces(path, vertices, faces, announced)
    unit = _unit_to_read_in(path, unit, stated)
    _check_extent(path, float(np.ptp(vertices, axis=0).max()), unit)
    metadata = {"file_unit": unit, "states_unit": stated is not None}
    mesh = trimesh.Trimesh(vertices * UNITS[unit], faces, process=False, metadata=metadata)
    mesh.merge_vertices()
    _refuse_zeros(path, vertices, faces, mesh)
    _turn_outwards(mesh)
    return mesh


def ply_with(mesh: "trimesh.Trimesh", scalars: Mapping[str, np.ndarray], *, unit: str) -> bytes:
    """A binary PLY of a mesh (mm), in its file's own unit, with numbers (n,) at its vertices.

    Each is a property of its own. CloudCompare takes properties for scalar fields by the prefix
    ``scalar_``, which it does not show; MeshLab and Blender read properties of any name.
    """
    import trimesh

    numbers: Any = {f"scalar_{name}": of.astype(np.float32) for name, of in scalars.items()}
    vertices = np.asarray(mesh.vertices) / UNITS[unit]
    whole = trimesh.Trimesh(vertices, mesh.faces, process=False, vertex_attributes=numbers)
    ply: Any = whole.export(file_type="ply", vertex_normal=False)
    return ply


def is_mesh(path: str | Path) -> bool:
    """Whether a file has the ending of a mesh, of one that `read_mesh` reads or of another."""
    return Path(path).suffix.lower() in _READ + _NOT_READ


def _read_content(path: Path) -> bytes:
    """All bytes of a mesh's file, if it is none that would fill the memory."""
    if not path.is_file():
        raise InputError(path, "no such file", "Correct the path of the mesh in the config.")
    if path.suffix.lower() not in _READ:
        problem = f"'{path.suffix}' is not a mesh format that is read here"
        raise InputError(path, problem, f"Export the mesh as one of {', '.join(_READ)}.")
    check_size(path)
    if zipfile.is_zipfile(path):
        _check_archive(path)
    if not (content := path.read_bytes()):
        raise InputError(path, "the file is empty", "Copy it, or export it, again.")
    return content


def _check_archive(path: Path) -> None:
    """Refuse a 3MF that is damaged, or whose models are too large."""
    unreadable = OSError, zipfile.BadZipFile, zlib.error, NotImplementedError, ValueError
    try:
        with zipfile.ZipFile(path) as archive:
            check_unpacked(path, archive)
            models = [name for name in archive.namelist() if name.endswith(".model")]
            _refuse_long_xml(sum(archive.getinfo(model).file_size for model in models))
            _refuse_parts(sum(archive.read(model).count(b"<item") for model in models))
    except unreadable as error:
        raise InputError(path, f"is damaged, or too large ({error})", _EXPORT_AGAIN) from error


def _check_faces(
    path: Path, vertices: np.ndarray, faces: np.ndarray, announced: int | None
) -> None:
    """Refuse faces that are not all that the file states, and vertices that are no places."""
    if announced not in (None, len(faces)):
        raise InputError(
            path,
            f"{len(faces)} triangles can be read, but the file states {announced}: it is cut or "
            "damaged, or its faces are not triangles",
            _EXPORT_AGAIN,
        )
    if len(faces) == 0:
        raise InputError(path, "the mesh has no faces", "Export it again, with its triangles.")
    if faces.min() < 0 or faces.max() >= len(vertices):
        problem = f"a face refers to a vertex outside its {len(vertices)}: it is cut or damaged"
        raise InputError(path, problem, _EXPORT_AGAIN)
    if bad := int((~np.isfinite(vertices)).any(axis=1).sum()):
        raise InputError(
            path, f"{bad} of {len(vertices)} vertices are not numbers", "Repair it."
        )


def _unit_to_read_in(path: Path, given: str | None, stated: str | None) -> str:
    """The unit that the user gave or the file states, if they do not contradict each other."""
    unit = given or stated or "mm"
    if stated not in (None, unit):
        if path.suffix.lower() == ".3mf":
            problem = f"states its unit, {stated}, and is to be read in {unit}"
            raise InputError(path, problem, f"Set mesh_unit: {stated}.")
        message = "%s: GLB is in %s by its specification, but is read in %s, as given"
        _log.warning(message, path, stated, unit)
    return unit


def _turn_outwards(mesh: "trimesh.Trimesh") -> None:
    """Turn the faces of a closed mesh that is inside out."""
    # measured from its middle, so pin-holes far from the origin matter little
    outwards = (mesh.triangles_center - mesh.bounds.mean(axis=0)) * mesh.triangles_cross
    if is_closed(mesh) and outwards.sum() < 0:
        _log.log(NOTE, "the mesh is inside out (its volume is negative): its faces were turned")
        mesh.invert()


def is_closed(mesh: "trimesh.Trimesh") -> bool:
    """Whether a mesh has an underside, too, but for pin-holes."""
    areas = mesh.triangles_cross
    return bool(np.abs(areas.sum(axis=0)).max() < _CLOSED * np.linalg.norm(areas, axis=1).sum())


def _announced_faces(path: Path, content: bytes) -> int | None:
    """Number of faces that the file states, None if the format states none.

    Content that contradicts itself is refused.
    """
    kind = path.suffix.lower()
    if kind == ".stl":
        return _faces_of_stl(path, content)
    if kind == ".ply":
        return _faces_of_ply(path, content)
    if kind == ".off":
        return _faces_of_off(path, content)
    if kind == ".obj":
        _refuse_odd_text(path, content)
        _refuse_odd_obj(path, content)
    return None


def _faces_of_stl(path: Path, content: bytes) -> int:
    # Some binary files begin with "solid" too, but no text has zero bytes.
    if b"\0" in content:
        return int.from_bytes(content[80:84], "little")
    if not content.rstrip().rsplit(b"\n", 1)[-1].lstrip().lower().startswith(b"endsolid"):
        raise InputError(path, "ends without 'endsolid': it is cut, or no STL", _EXPORT_AGAIN)
    return content.lower().count(b"endfacet")


def _faces_of_off(path: Path, content: bytes) -> int:
    _refuse_odd_text(path, content)
    found = re.match(rb"(?:\s|#.*\n)*C?OFF(?:\s|#.*\n)*(?=\d+\s+(\d+)\s)", content)
    if found is None:
        raise _no_header(path)
    body = content[found.end() :]
    _check_rows(path, body, sum(map(int, body.split(maxsplit=2)[:2])))
    return int(found[1])


def _faces_of_ply(path: Path, content: bytes) -> int:
    header, end, body = content.partition(b"end_header")
    elements = _ply_elements(header)
    if b"face" not in elements:
        raise _no_header(path)
    if b"format ascii" in header:
        _refuse_odd_text(path, content)
        _check_rows(path, end + body, sum(count for count, _ in elements.values()))
        _check_ply_cells(path, elements.values(), body)
    else:
        order = ">" if b"binary_big_endian" in header else "<"
        _check_ply_lists(path, elements.values(), order, body.partition(b"\n")[2])
    return elements[b"face"][0]


def _no_header(path: Path) -> InputError:
    problem = f"does not begin with the header of {path.suffix[1:].upper()} with its faces"
    return InputError(path, problem, "Correct its ending, or export it again.")


def _refuse_odd_text(path: Path, content: bytes) -> None:
    if not content.endswith((b"\n", b"\r")):
        raise InputError(path, "ends within a line: it is cut", _EXPORT_AGAIN)
    if b"\0" in content:
        raise InputError(path, "is text with zero bytes in it: it is damaged", _EXPORT_AGAIN)


def _ply_elements(header: bytes) -> dict[bytes, _PlyElement]:
    """Elements of a PLY by name, in the order of the file."""
    elements: dict[bytes, _PlyElement] = {}
    for line in header.splitlines():
        if found := re.match(rb"element\s+(\w+)\s+(\d+)", line):
            properties: list[list[bytes]] = []
            elements[found[1]] = int(found[2]), properties
        elif elements and line.startswith(b"property"):
            properties.append(line.split()[1:-1])
    return elements


def _check_ply_cells(path: Path, elements: Iterable[_PlyElement], body: bytes) -> None:
    """Refuse text whose rows have more or fewer cells than the header says.

    trimesh takes all lists to be as long as the first, and drops what is left.
    """
    rows = (row for row in map(bytes.split, body.splitlines()) if row and row[0][:1] != b"#")
    for count, properties in elements:
        for row in itertools.islice(rows, count):
            if not _has_cells(row, properties):
                problem = f"has a row that its header does not describe: {row[:9]}"
                raise InputError(path, problem, _EXPORT_AGAIN)


def _has_cells(row: Sequence[bytes], properties: Iterable[Sequence[bytes]]) -> bool:
    at = 0
    try:
        for words in properties:
            at += 1 + int(row[at]) if words[0] == b"list" else 1
    except (IndexError, ValueError):
        return False
    return at == len(row)


def _check_ply_lists(
    path: Path, elements: Iterable[_PlyElement], order: str, body: bytes
) -> None:
    """Refuse a binary PLY with lists that are not as long as the first of their property."""
    at = 0
    try:
        for count, properties in elements:
            if not count:
                continue
            rows = np.frombuffer(body, _ply_row(properties, order, body, at), count, at)
            lengths = [rows[name] for name in rows.dtype.names or () if name[0] == "n"]
            if any((length != length[:1]).any() for length in lengths):
                problem = "is damaged, or its faces are not all triangles"
                raise InputError(path, problem, _EXPORT_AGAIN)
            at += rows.nbytes
    except (IndexError, KeyError, ValueError) as error:
        raise InputError(path, f"cannot be read as PLY ({error})", _EXPORT_AGAIN) from error


def _ply_row(
    properties: Iterable[Sequence[bytes]], order: str, body: bytes, at: int
) -> np.dtype[Any]:
    """A row of a PLY's element, with its lists as long as those in the row at byte `at`."""
    fields: list[Any] = []
    for number, (kind, *of) in enumerate(properties):
        if kind == b"list":
            length_type, item = (order + _PLY_TYPES[word] for word in of)
            (length,) = np.frombuffer(body, length_type, 1, at + np.dtype(fields).itemsize)
            fields += [(f"n{number}", length_type), (f"items {number}", item, int(length))]
        else:
            fields.append((f"value {number}", order + _PLY_TYPES[kind]))
    return np.dtype(fields)


def _check_rows(path: Path, body: bytes, stated: int) -> None:
    """Refuse text whose rows, after one of the header, are not as many as it states.

    trimesh reads those that it needs.
    """
    lines = re.finditer(rb"^[ \t]*[^\s#]", body.replace(b"\r", b"\n"), re.MULTILINE)
    if (count := sum(1 for _ in lines) - 1) != stated:
        problem = f"has {count} rows, but states {stated}: it is cut or damaged"
        raise InputError(path, problem, _EXPORT_AGAIN)


def _refuse_odd_obj(path: Path, content: bytes) -> None:
    """Refuse faces that trimesh would read with other vertices, and lines that it passes over."""
    for odd, problem in (
        (rb"^f\b[^\n]*\s(?:-|0[\s/])", "has a face with vertex numbers below 1"),
        (rb"^f\b[^\n]{%d}" % _LONGEST_FACE, "has a face of a thousand corners"),
        (
            rb"(?<!\\)(?<!\\\r)\n[ \t]*[-+.\d]",
            "has a line that begins with a number: it is damaged",
        ),
    ):
        if re.search(odd, content, re.MULTILINE):
            raise InputError(path, problem, _EXPORT_AGAIN)


def _load(path: Path, content: bytes) -> tuple[np.ndarray, np.ndarray, str | None]:
    """Vertices (n, 3), triangles (m, 3) and the stated unit, as trimesh reads them."""
    import trimesh

    kind = path.suffix.lower()[1:]
    # Textures and materials would open other files and split vertices.
    options: dict[str, Any] = {
        "skip_materials": True,
        "fix_texture": False,
        "maintain_order": True,
    }
    try:
        with warnings.catch_warnings():
            # NumPy stops at a word that is not a number, and only warns.
            warnings.filterwarnings("error", message="string or file could not be read")
            # From memory, so that trimesh cannot look for other files beside this one.
            file = io.BytesIO(content)
            if kind == "glb":
                _refuse_unlikely_header(content)
            scene: Any = trimesh.load_scene(file, file_type=kind, process=False, **options)
            named = [scene.geometry[scene.graph[n][1]] for n in scene.graph.nodes_geometry]
            if sum(len(getattr(part, "faces", ())) for part in named) > len(content):
                raise ValueError("it repeats its parts until there are more faces than bytes")
            vertices, faces, count = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], 0
            part: Any
            for part in scene.dump():
                vertices.append(np.asarray(part.vertices, dtype=np.float64))
                faces.append(
                    np.asarray(getattr(part, "faces", faces[0]), dtype=np.int64) + count
                )
                count += len(vertices[-1])
        return np.concatenate(vertices), np.concatenate(faces), _STATED.get(str(scene.units))
    except Exception as error:  # trimesh raises whatever its parsers raise
        problem = f"cannot be read as {kind.upper()} ({type(error).__name__}: {error})"
        raise InputError(path, problem, _EXPORT_AGAIN) from error


def _refuse_parts(count: int) -> None:
    if count > _MOST_PARTS:
        raise ValueError(f"it has {count} parts, and a stone is one")


def _refuse_long_xml(size: int) -> None:
    if size > _LONGEST_XML:
        most = f"at most {_LONGEST_XML / 1e6:.0f} MB are read"
        raise ValueError(f"it holds {size / 1e6:.0f} MB of XML, and {most}")


def _refuse_unlikely_header(content: bytes) -> None:
    """Refuse a GLB of very many parts, or of more vertices and faces than the file has bytes.

    By its specification, numbers that are not in the file are zeros.
    """
    header = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    _refuse_parts(len(header.get("nodes", ())))
    if sum(part["count"] for part in header.get("accessors", ())) > len(content):
        raise ValueError("it states more numbers than it holds")


def _refuse_zeros(
    path: Path, vertices: np.ndarray, faces: np.ndarray, merged: "trimesh.Trimesh"
) -> None:
    """Refuse zeros where vertices or faces were: triangles, or several vertices, in one place."""
    shrunk = (merged.faces == merged.faces[:, :1]).all(axis=1)
    lost = shrunk & ((faces == 0).all(axis=1) | ~merged.triangles.any(axis=(1, 2)))
    elsewhere = int(np.bincount(merged.faces[shrunk & ~lost, 0]).max(initial=0))
    if (count := int(lost.sum())) >= _FEWEST_EMPTY and count > _ZEROS_TIMES * elsewhere:
        _refuse_lost(path, count, "faces")
    is_used = np.zeros(len(vertices), bool)
    is_used[faces] = True
    corners = vertices[is_used]
    lost = ~corners.any(axis=1)
    if (count := int(lost.sum())) >= _FEWEST_EMPTY:
        _, copies = np.unique(corners[~lost], axis=0, return_counts=True)
        if count - 1 > _ZEROS_TIMES * (copies.max(initial=1) - 1):
            _refuse_lost(path, count, "vertices")


def _refuse_lost(path: Path, count: int, what: str) -> None:
    problem = f"{count} of its {what} are nothing but zeros: a part of it is lost"
    raise InputError(path, problem, "Copy it, or export it, again.")


def _check_extent(path: Path, extent: float, unit: str) -> None:
    """Refuse a mesh whose largest extent (in `unit`) is not that of a stone."""
    if _SMALLEST_STONE <= extent * UNITS[unit] <= _LARGEST_STONE:
        return
    remedy = f"Scale the mesh to one of the units {list(UNITS)} and set mesh_unit."
    fitting = {name: extent * UNITS[name] for name in units_of_size(extent)}
    if fitting:
        sizes = " or ".join(f"mesh_unit: {name} ({mm:.3g} mm)" for name, mm in fitting.items())
        remedy = f"It looks as if it were in another unit: set {sizes}."
    raise InputError(
        path, f"its largest extent is {extent:.4g} {unit}, which is no stone's size", remedy
    )


def units_of_size(extent: float) -> list[str]:
    """The units in which a largest extent is that of a stone as hands hold it.

    If there is none, those in which it is that of any ground stone tool.

    >>> [units_of_size(extent) for extent in (55.4, 0.0554, 8.0, 400.0)]
    [['mm'], ['m'], ['cm', 'in'], ['mm']]
    """
    for low, high in (_HAND_SIZED, (10.0, _LARGEST_STONE)):
        if fitting := [name for name, mm in UNITS.items() if low <= extent * mm <= high]:
            return fitting
    return []
