"""Triangle meshes of stones (STL, PLY, OBJ, OFF, GLB, 3MF), read through trimesh, in mm.

trimesh reads some damaged files without complaint and returns the part that it understood. A
truncated file must never pass for a smaller stone, so its faces are compared with the count in the
file. `gstlib.io.mesh_text` unifies the many dialects of text.
"""

import io
import logging
import warnings
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from gstlib.errors import NOTE, InputError
from gstlib.io.containers import plain_zip
from gstlib.io.files import check_input
from gstlib.io.gltf import MOST_PARTS, checked_header, position_accessors
from gstlib.io.mesh_sizes import (
    STATED_UNITS,
    UNITS,
    check_step_and_extent,
    steps_of,
    units_of_size,
)
from gstlib.io.mesh_text import (
    EXPORT_AGAIN,
    PlainText,
    check_count,
    plain_obj,
    plain_off,
    plain_ply,
    plain_stl,
    unit_word,
)
from gstlib.io.rounding import coordinate_step

if TYPE_CHECKING:
    import trimesh

__all__ = ["UNITS", "is_closed", "is_mesh", "read_mesh", "steps_of", "units_of_size"]

_log = logging.getLogger(__name__)

_READ = (".stl", ".ply", ".obj", ".off", ".glb", ".3mf")
# Other formats of meshes: trimesh needs further packages for them, or reads them unchecked.
_NOT_READ = (
    ".gltf",
    ".fbx",
    ".dae",
    ".wrl",
    ".x3d",
    ".usd",
    ".usdz",
    ".nxs",
    ".nxz",
    ".ctm",
)
# A mesh whose area vectors cancel to this share is closed, except for pin-holes from the scanner.
_CLOSED = 0.01
# Faces and vertices that are zeros, as in a lost block of the file: so many, and ten times as many
# as at any other point. Rounding shrinks triangles to points, too, but everywhere.
_FEWEST_EMPTY, _ZEROS_TIMES = 3, 10
_RECORD = np.dtype(
    [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
)
_TEXT_READERS = {".obj": plain_obj, ".off": plain_off, ".ply": plain_ply}
_STL_HEADER = 84
# Counts in the header of an STL that was written before its program knew how many triangles follow.
_STREAMED = 0, 0xFFFFFFFF
_GLB_HEADER = 20
# Types of whole numbers in a GLB.
_WHOLE_NUMBERS = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2"}


class _Part(NamedTuple):
    """A part of a scene at its position, in the unit of the file."""

    vertices: np.ndarray
    faces: np.ndarray
    step: float  # of its coordinates


def read_mesh(path: str | Path, *, unit: str | None = None) -> "trimesh.Trimesh":
    """Read a triangle mesh.

    Parameters
    ----------
    path : str or Path
        STL (binary or ASCII), PLY, OBJ, OFF, 3MF or GLB. The parts of a scene keep their positions.
    unit : {"mm", "cm", "m", "um", "in", "ft"}, optional
        Unit of the file's coordinates. If it is None, the unit in the file is used, or else mm. A
        3MF contains its unit, and a different one is refused. GLB prescribes metres, but exporters
        write other units. A different unit is therefore accepted with a warning, as for a unit in a
        comment of a text. The other formats do not contain a unit.

    Returns
    -------
    trimesh.Trimesh
        Vertices in mm, with equal ones merged, and without colours, textures and normals. A closed
        mesh that is inside out is turned, with a warning. In its metadata, ``file_unit`` is the
        unit of the file, and ``states_unit`` is whether the file contains it. ``step_mm`` is the
        step of the coordinates, inferred from them. Above 1 µm there is a warning.

    Raises
    ------
    InputError
        The file is missing, truncated, damaged or not a mesh. The mesh has no faces, or vertices
        that are not finite. Its size does not fit a stone, as when the unit is wrong. The step of
        its coordinates is above 20 µm.

    Examples
    --------
    >>> import gstlib, pathlib, tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = pathlib.Path(folder.name) / "corner.off"
    >>> size = path.write_text("OFF\\n3 1 0\\n0 0 0\\n4 0 0\\n0 3 0.5\\n3 0 1 2\\n")
    >>> mesh = gstlib.read_mesh(path, unit="cm")
    >>> mesh.extents.tolist(), mesh.metadata["file_unit"]
    ([40.0, 30.0, 5.0], 'cm')
    """
    import trimesh

    path = Path(path)
    if unit not in (None, *UNITS):
        raise InputError(
            path, f"unknown mesh unit {unit!r}", f"Use one of {list(UNITS)}."
        )
    content = _read_content(path)
    parts, stated, is_ended = _load(path, content)
    vertices = np.concatenate([part.vertices for part in parts])
    before = np.cumsum([0, *(len(part.vertices) for part in parts)])
    shifted = [part.faces + n for part, n in zip(parts, before, strict=False)]
    faces = np.concatenate(shifted)
    _mind_cut_end(path, vertices, faces, is_ended=is_ended)
    unit = _unit_to_read_in(path, unit, stated)
    step_mm = max(part.step for part in parts) * UNITS[unit]
    check_step_and_extent(path, vertices[faces], step_mm, unit)
    metadata = {
        "file_unit": unit,
        "states_unit": stated is not None,
        "step_mm": step_mm,
    }
    vertices_mm = vertices * UNITS[unit]
    mesh = trimesh.Trimesh(vertices_mm, faces, process=False, metadata=metadata)
    mesh.merge_vertices()
    _refuse_zeros(path, vertices, faces, mesh)
    _drop_copies(mesh)
    _turn_outwards(mesh)
    return mesh


def is_mesh(path: str | Path) -> bool:
    """Whether a file has the ending of a mesh, of one that `read_mesh` reads or of another."""
    return Path(path).suffix.lower() in _READ + _NOT_READ


def _read_content(path: Path) -> bytes:
    """All bytes of a mesh's file, unless it would fill the memory."""
    check_input(path, "Correct the path of the mesh in the config.")
    if path.suffix.lower() not in _READ:
        problem = f"'{path.suffix}' is not a mesh format that is read here"
        raise InputError(
            path, problem, f"Export the mesh as one of {', '.join(_READ)}."
        )
    if zipfile.is_zipfile(path):
        return _check_parts(path, plain_zip(path))
    return path.read_bytes()


def _check_parts(path: Path, content: io.BytesIO) -> bytes:
    """The content of a 3MF with no more parts than a stone can have."""
    with zipfile.ZipFile(content) as archive:
        models = [name for name in archive.namelist() if name.endswith(".model")]
        count = sum(archive.read(model).count(b"<item") for model in models)
    if count > MOST_PARTS:
        problem = f"has {count} parts, but a stone has only one"
        raise InputError(path, problem, EXPORT_AGAIN)
    return content.getvalue()


def _check_faces(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    """Refuse faces with vertices that are missing or not finite."""
    are_there = faces.min() >= 0 and faces.max() < len(vertices)
    if not are_there:
        problem = f"a face refers to a vertex outside its {len(vertices)}: it is cut or damaged"
        raise InputError(path, problem, EXPORT_AGAIN)
    bad = np.count_nonzero(~np.isfinite(vertices).all(axis=1))
    if bad:
        problem = f"{bad} of {len(vertices)} vertices are not numbers"
        raise InputError(path, problem, "Repair it.")


def _unit_to_read_in(path: Path, wanted: str | None, stated: str | None) -> str:
    """The unit from the user or from the file, if they do not contradict each other."""
    unit = wanted or stated or "mm"
    if stated not in (None, unit):
        if path.suffix.lower() == ".3mf":
            problem = f"states its unit, {stated}, but is to be read in {unit}"
            raise InputError(path, problem, f"Set mesh_unit: {stated}.")
        source = "specification" if path.suffix.lower() == ".glb" else "own comment"
        message = "%s: is in %s by its %s, but is read in %s, the requested unit"
        _log.warning(message, path, stated, source, unit)
    return unit


def _turn_outwards(mesh: "trimesh.Trimesh") -> None:
    """Turn the faces of a closed mesh that is inside out."""
    # measured from its middle, so pin-holes far from the origin matter little
    from_middle = mesh.triangles_center - mesh.bounds.mean(axis=0)
    outwards = from_middle * mesh.triangles_cross
    if is_closed(mesh) and outwards.sum() < 0:
        _log.log(
            NOTE,
            "the mesh is inside out (its volume is negative), so its faces were turned",
        )
        mesh.invert()


def is_closed(mesh: "trimesh.Trimesh") -> bool:
    """Whether a mesh has an underside, too, apart from pin-holes."""
    areas = mesh.triangles_cross
    whole_area = np.linalg.norm(areas, axis=1).sum()
    open_area = np.abs(areas.sum(axis=0)).max()
    return bool(open_area < _CLOSED * whole_area)


def _drop_copies(mesh: "trimesh.Trimesh") -> None:
    """Leave each face once, whichever way round, as in a mesh whose sides are both drawn."""
    is_first = mesh.unique_faces()
    if not is_first.all():
        message = "%d of %d faces are in the mesh twice. Their copies were left out"
        _log.log(NOTE, message, (~is_first).sum(), len(is_first))
        mesh.update_faces(is_first)


def _used(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Whether each vertex belongs to a face."""
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    return used


def _mind_cut_end(
    path: Path, vertices: np.ndarray, faces: np.ndarray, *, is_ended: bool
) -> None:
    """Refuse text that ends within a line, if its last face or its vertices show that it is cut."""
    unused = int(np.count_nonzero(~_used(vertices, faces)))
    sign = (
        f"{unused} of its vertices belong to no face"
        if unused
        else "its last face is odd"
    )
    if is_ended:
        # an OBJ does not contain its number of faces
        if unused and path.suffix.lower() == ".obj":
            _log.warning("%s: %s. If it was cut, copy it again", path, sign)
        return
    outlines = vertices[faces[:, [0, 1, 2, 0]]]
    edges = np.diff(outlines, axis=1)
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    is_last_odd = longest[-1] > longest[:-1].max(initial=0)
    if unused or is_last_odd:
        problem = f"ends within a line, and {sign}: it is cut"
        raise InputError(
            path, problem, f"{EXPORT_AGAIN} If it is whole, end its last line."
        )


def _plain(path: Path, content: bytes) -> PlainText:
    """A file's content as trimesh reads it, and the values in its header."""
    kind = path.suffix.lower()
    if kind == ".stl":
        text = content.rstrip(b"\0")
        is_text = bool(text) and b"\0" not in text
        return plain_stl(path, content) if is_text else _binary_stl(path, content)
    if read := _TEXT_READERS.get(kind):
        return read(path, content)
    if kind == ".glb":  # its length is that of its header; more may follow
        length = int.from_bytes(content[8:12], "little")
        content = content[: max(length, _GLB_HEADER)]
    return PlainText(content, None, is_ended=True)


def _binary_stl(path: Path, content: bytes) -> PlainText:
    """The triangles of a binary STL, without content that some programs write behind them.

    A program that writes while it reads does not have the count yet, and leaves 0 or −1.
    """
    stated = int.from_bytes(content[80:84], "little")
    count, left = divmod(len(content) - _STL_HEADER, _RECORD.itemsize)
    if stated in _STREAMED and count > 0 and not left:
        stated = count
    elif stated > count:
        needed = _STL_HEADER + stated * _RECORD.itemsize
        check_count(path, len(content), needed, "bytes")
    end = _STL_HEADER + stated * _RECORD.itemsize
    corners = np.frombuffer(content, _RECORD, count, _STL_HEADER)["corners"]
    own, more = corners[:stated], corners[stated:]
    if stated and len(more):
        lowest, highest = own.min(axis=(0, 1)), own.max(axis=(0, 1))
        is_inside = (lowest <= more) & (more <= highest)
        is_padding = ~more.any(axis=(1, 2))
        if (is_inside.all(axis=(1, 2)) & ~is_padding).any():
            problem = f"states {stated} triangles, but more follow: it is damaged"
            raise InputError(path, problem, EXPORT_AGAIN)
    header = content[:80] + stated.to_bytes(4, "little")
    return PlainText(header + content[_STL_HEADER:end], stated, is_ended=True)


def _load(path: Path, content: bytes) -> tuple[list[_Part], str | None, bool]:
    """The parts of a mesh, the unit in the file, and whether its last line has an end."""
    kind = path.suffix.lower()[1:]
    try:
        plain = _plain(path, content)
        with warnings.catch_warnings():
            # NumPy stops at a word that is not a number, and only warns.
            warnings.filterwarnings("error", message="string or file could not be read")
            stored = (
                position_accessors(checked_header(path, content))
                if kind == "glb"
                else []
            )
            scene = _scene(plain.content, kind)
            if kind == "ply":
                _check_ply_lists(path, scene)
            parts = [*_parts(path, scene, stored)]
        units = str(scene.units or "").lower()
        word = units.removesuffix("s") or unit_word(content)
    except InputError:
        raise
    except Exception as error:  # trimesh raises whatever its parsers raise
        problem = f"cannot be read as {kind.upper()} ({type(error).__name__}: {error})"
        raise InputError(path, problem, EXPORT_AGAIN) from error
    if kind == "3mf" and word not in STATED_UNITS:
        problem = f"states a unit that 3MF does not have, {word!r}"
        raise InputError(path, problem, "Export it again, in millimeter.")
    count = sum(len(part.faces) for part in parts)
    check_count(path, count, plain.faces, "triangles")
    if count == 0:
        raise InputError(
            path, "the mesh has no faces", "Export it again, with its triangles."
        )
    return parts, STATED_UNITS.get(word), plain.is_ended


def _scene(content: bytes, kind: str) -> "trimesh.Scene":
    """The result of trimesh's reader."""
    import trimesh

    # Textures and materials would open other files and split vertices.
    options: Any = {
        "skip_materials": True,
        "fix_texture": False,
        "maintain_order": True,
    }
    # From memory, so that trimesh cannot look for other files beside this one.
    file = io.BytesIO(content)
    scene: Any = trimesh.load_scene(file, file_type=kind, process=False, **options)
    names = [scene.graph[node][1] for node in scene.graph.nodes_geometry]
    counts = [len(getattr(scene.geometry[name], "faces", ())) for name in names]
    if sum(counts) > len(content):
        raise ValueError("it repeats its parts until there are more faces than bytes")
    return scene


def _parts(
    path: Path, scene: "trimesh.Scene", stored: Sequence[Mapping[str, Any]]
) -> Iterator[_Part]:
    """The parts of a scene that have faces, each at its position.

    `stored` describes how a GLB stores the positions of each part.
    """
    accessors = dict(zip(scene.geometry, stored, strict=bool(stored)))
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        part: Any = scene.geometry[name]
        faces = np.asarray(getattr(part, "faces", ()), np.int64)
        if not len(faces):
            continue
        numbers = np.asarray(part.vertices, float)
        accessor = accessors.get(name, {})
        vertices, step = _numbers(numbers, accessor)
        _check_faces(path, vertices, faces)
        turn, shift = matrix[:3, :3], matrix[:3, 3]
        scale = np.linalg.norm(turn, axis=0).max()
        step = float(scale * (step or coordinate_step(vertices, faces)))
        if np.linalg.det(turn) < 0:  # a mirror
            faces = faces[:, ::-1]
        yield _Part(vertices @ turn.T + shift, faces, step)


def _numbers(
    stored: np.ndarray, accessor: Mapping[str, Any]
) -> tuple[np.ndarray, float]:
    """Coordinates of a part, and their step if they are whole numbers, as in quantised GLB."""
    if (kind := accessor.get("componentType")) not in _WHOLE_NUMBERS:
        return stored, 0.0
    if not accessor.get("normalized"):
        return stored, 1.0
    largest = np.iinfo(_WHOLE_NUMBERS[kind]).max
    return np.maximum(stored / largest, -1.0), 1.0 / largest


def _check_ply_lists(path: Path, scene: "trimesh.Scene") -> None:
    """Refuse a binary PLY with lists that are not as long as the first of their property."""
    for part in scene.geometry.values():
        for element in part.metadata.pop("_ply_raw", {}).values():
            rows = element.get("data")
            columns = getattr(getattr(rows, "dtype", None), "names", None) or ()
            for column in columns:
                if not rows.dtype[column].names:  # no lists
                    continue
                lengths = rows[column]["f0"]
                if (lengths != lengths[:1]).any():
                    problem = (
                        "is damaged, or its faces have different numbers of corners"
                    )
                    raise InputError(path, problem, EXPORT_AGAIN)


def _refuse_zeros(
    path: Path, vertices: np.ndarray, faces: np.ndarray, merged: "trimesh.Trimesh"
) -> None:
    """Refuse zeros where vertices or faces were: triangles, or several vertices, at one point."""
    is_point = (merged.faces == merged.faces[:, :1]).all(axis=1)
    is_zero = (faces == 0).all(axis=1)
    is_zero |= ~merged.triangles.any(axis=(1, 2))
    lost = is_point & is_zero
    other_points = merged.faces[is_point & ~lost, 0]
    elsewhere = int(np.bincount(other_points).max(initial=0))
    count = int(lost.sum())
    if count >= _FEWEST_EMPTY and count > _ZEROS_TIMES * elsewhere:
        _refuse_lost(path, count, "faces")
    corners = vertices[_used(vertices, faces)]
    lost = ~corners.any(axis=1)
    count = int(lost.sum())
    if count >= _FEWEST_EMPTY:
        _, copies = np.unique(corners[~lost], axis=0, return_counts=True)
        most_elsewhere = copies.max(initial=1)
        if count - 1 > _ZEROS_TIMES * (most_elsewhere - 1):
            _refuse_lost(path, count, "vertices")


def _refuse_lost(path: Path, count: int, what: str) -> None:
    problem = f"{count} of its {what} are only zeros: a part of the file is lost"
    raise InputError(path, problem, "Copy it, or export it, again.")
