"""Triangle meshes of stones (STL, PLY, OBJ, OFF, GLB, 3MF), read through trimesh, in mm.

trimesh reads some damaged files without complaint and returns the part that it understood. A
truncated file must never pass for a smaller stone, so its faces are compared with the count in the
file. `gstlib.io.plain_meshes` unifies the many dialects of a format.
"""

import io
import logging
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from gstlib.errors import NOTE, InputError
from gstlib.io.containers import plain_zip
from gstlib.io.files import UnreadableError, check_input, naming
from gstlib.io.mesh_sizes import (
    STATED_UNITS,
    UNITS,
    check_step_and_extent,
    coordinate_step,
    steps_of,
    units_of_size,
)
from gstlib.io.plain_meshes import (
    EXPORT_AGAIN,
    PLAIN,
    PlainMesh,
    check_count,
    check_ply,
    unit_word,
)
from gstlib.io.scenes import plain_3mf, plain_glb

if TYPE_CHECKING:
    import trimesh

__all__ = ["UNITS", "is_mesh", "read_mesh", "steps_of", "units_of_size"]

_log = logging.getLogger(__name__)

_READ = PLAIN | {".glb": plain_glb, ".3mf": plain_3mf}
# Other formats of meshes: trimesh needs further packages for them, or reads them unchecked.
_NOT_READ = (
    *(".gltf", ".fbx", ".dae", ".wrl", ".x3d", ".usd", ".usdz", ".nxs", ".nxz", ".ctm"),
)
# A mesh whose area vectors cancel to this share is closed, except for pin-holes from the scanner.
_CLOSED = 0.01
# Faces and vertices that are zeros, as in a lost block of the file: so many, and ten times as many
# as at any other point. Rounding shrinks triangles to points, too, but everywhere.
_FEWEST_EMPTY, _ZEROS_TIMES = 3, 10


# A part of a scene at its position, in the unit of the file: its vertices, faces and step.
_Part: TypeAlias = tuple[np.ndarray, np.ndarray, float]


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
    with naming(path):
        if unit not in (None, *UNITS):
            raise UnreadableError(
                f"unknown mesh unit {unit!r}", f"Use one of {list(UNITS)}."
            )
        parts, stated, is_ended = _load(path)
        all_vertices, all_faces, steps = zip(*parts, strict=True)
        vertices, faces = trimesh.util.append_faces(all_vertices, all_faces)
        _mind_cut_end(path, vertices, faces, is_ended=is_ended)
        unit = _unit_to_read_in(path, unit, stated)
        step_mm = max(steps) * UNITS[unit]
        check_step_and_extent(path, vertices[faces], step_mm, unit)
        metadata = {
            "file_unit": unit,
            "states_unit": stated is not None,
            "step_mm": step_mm,
        }
        vertices_mm = vertices * UNITS[unit]
        mesh = trimesh.Trimesh(vertices_mm, faces, process=False, metadata=metadata)
        mesh.merge_vertices()
        _refuse_zeros(vertices, faces, mesh)
        _drop_copies(mesh)
        _turn_outwards(mesh)
        return mesh


def is_mesh(path: str | Path) -> bool:
    """Whether a file has the ending of a mesh, of one that `read_mesh` reads or of another."""
    return Path(path).suffix.lower() in (*_READ, *_NOT_READ)


def _load(path: Path) -> tuple[list[_Part], str | None, bool]:
    """The parts of a mesh, the unit in the file, and whether its last line has an end."""
    check_input(path, "Correct the path of the mesh in the config.")
    ending = path.suffix.lower()
    if ending not in _READ:
        raise UnreadableError(
            f"'{path.suffix}' is not a mesh format that is read here",
            f"Export the mesh as one of {', '.join(_READ)}.",
        )
    try:
        # a zip file is unpacked with care
        is_zip = ending == ".3mf"
        content = plain_zip(path).getvalue() if is_zip else path.read_bytes()
        plain = _READ[ending](content)
        scene = _scene(plain.content, ending)
        parts = [*_parts(scene, plain)]
    except InputError:
        raise
    except Exception as error:  # trimesh raises whatever its parsers raise
        kind = ending[1:].upper()
        raise UnreadableError(
            f"cannot be read as {kind} ({type(error).__name__}: {error})", EXPORT_AGAIN
        ) from error
    word = str(scene.units or "").lower() or unit_word(content)
    unit = STATED_UNITS.get(word.removesuffix("s"))
    if ending == ".3mf" and unit is None:
        raise UnreadableError(
            f"states a unit that 3MF does not have, {word!r}",
            "Export it again, in millimeter.",
        )
    if plain.faces is not None:
        count = sum(len(faces) for _, faces, _ in parts)
        check_count(count, plain.faces, "triangles")
    if not parts:
        raise UnreadableError(
            "the mesh has no faces", "Export it again, with its triangles."
        )
    return parts, unit, plain.is_ended


def _scene(content: bytes, ending: str) -> Any:
    """The result of trimesh's reader."""
    import trimesh

    # from memory, so that trimesh cannot look for other files beside this one
    file = io.BytesIO(content)
    with warnings.catch_warnings():
        # NumPy stops at a word that is not a number, and only warns
        warnings.filterwarnings("error", message="string or file could not be read")
        return trimesh.load_scene(
            file,
            file_type=ending[1:],
            process=False,
            # textures and materials would open other files and split vertices
            skip_materials=True,
            fix_texture=False,
            maintain_order=True,
        )


def _parts(scene: Any, plain: PlainMesh) -> Iterator[_Part]:
    """The parts of a scene that have faces, each at its position."""
    left = len(plain.content)
    largest = dict(zip(scene.geometry, plain.largest, strict=bool(plain.largest)))
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        part = scene.geometry[name]
        check_ply(part.metadata.pop("_ply_raw", {}))
        faces = np.asarray(getattr(part, "faces", ()), np.int64)
        left -= len(faces)
        if left < 0:
            raise ValueError("it repeats its parts until it has more faces than bytes")
        if not len(faces):
            continue
        vertices = np.asarray(part.vertices, float)
        one = largest.get(name, 0)
        if one > 1:
            vertices = np.maximum(vertices / one, -1.0)
        _check_faces(vertices, faces)
        turn, shift = matrix[:3, :3], matrix[:3, 3]
        scale = np.linalg.norm(turn, axis=0).max()
        step = 1 / one if one else coordinate_step(vertices, faces)
        if np.linalg.det(turn) < 0:  # a mirror
            faces = faces[:, ::-1]
        yield vertices @ turn.T + shift, faces, float(scale * step)


def _check_faces(vertices: np.ndarray, faces: np.ndarray) -> None:
    """Refuse faces with vertices that are missing or not finite."""
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise UnreadableError(
            f"a face refers to a vertex outside its {len(vertices)}: it is cut or damaged",
            EXPORT_AGAIN,
        )
    bad = np.count_nonzero(~np.isfinite(vertices).all(axis=1))
    if bad:
        raise UnreadableError(
            f"{bad} of {len(vertices)} vertices are not numbers", "Repair it."
        )


def _unit_to_read_in(path: Path, wanted: str | None, stated: str | None) -> str:
    """The unit from the user or from the file, if they do not contradict each other."""
    unit = wanted or stated or "mm"
    if stated not in (None, unit):
        if path.suffix.lower() == ".3mf":
            raise UnreadableError(
                f"states its unit, {stated}, but is to be read in {unit}",
                f"Set mesh_unit: {stated}.",
            )
        source = "specification" if path.suffix.lower() == ".glb" else "own comment"
        message = "%s: is in %s by its %s, but is read in %s, the requested unit"
        _log.warning(message, path, stated, source, unit)
    return unit


def _turn_outwards(mesh: "trimesh.Trimesh") -> None:
    """Turn the faces of a mesh that is inside out, if it has an underside, too."""
    areas = mesh.triangles_cross
    open_area = np.abs(areas.sum(axis=0)).max()
    is_closed = open_area < _CLOSED * np.linalg.norm(areas, axis=1).sum()
    # measured from its middle, so pin-holes far from the origin matter little
    from_middle = mesh.triangles_center - mesh.bounds.mean(axis=0)
    if is_closed and (from_middle * areas).sum() < 0:
        message = (
            "the mesh is inside out (its volume is negative), so its faces were turned"
        )
        _log.log(NOTE, message)
        mesh.invert()


def _drop_copies(mesh: "trimesh.Trimesh") -> None:
    """Leave each face once, whichever way round, as in a mesh whose sides are both drawn."""
    is_first = mesh.unique_faces()
    if not is_first.all():
        message = "%d of %d faces are in the mesh twice. Their copies were left out"
        _log.log(NOTE, message, (~is_first).sum(), len(is_first))
        mesh.update_faces(is_first)


def _is_used(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Whether each vertex belongs to a face."""
    return np.bincount(faces.ravel(), minlength=len(vertices)) > 0


def _mind_cut_end(
    path: Path, vertices: np.ndarray, faces: np.ndarray, *, is_ended: bool
) -> None:
    """Refuse text that ends within a line, if its last face or its vertices show that it is cut."""
    # an OBJ does not contain its number of faces
    if is_ended and path.suffix.lower() != ".obj":
        return
    unused = np.count_nonzero(~_is_used(vertices, faces))
    sign = f"{unused} of its vertices belong to no face"
    edges = np.diff(vertices[faces[:, [0, 1, 2, 0]]], axis=1)
    longest = np.linalg.norm(edges, axis=2).max(axis=1)
    if unused and is_ended:
        _log.warning("%s: %s. If it was cut, copy it again", path, sign)
    elif not is_ended and (unused or longest[-1] > longest[:-1].max(initial=0)):
        sign = sign if unused else "its last face is odd"
        raise UnreadableError(
            f"ends within a line, and {sign}: it is cut",
            f"{EXPORT_AGAIN} If it is whole, end its last line.",
        )


def _refuse_zeros(
    vertices: np.ndarray, faces: np.ndarray, merged: "trimesh.Trimesh"
) -> None:
    """Refuse zeros where vertices or faces were: triangles, or several vertices, at one point."""
    is_point = (merged.faces == merged.faces[:, :1]).all(axis=1)
    is_zero = ~faces.any(axis=1) | ~merged.triangles.any(axis=(1, 2))
    lost = is_point & is_zero
    elsewhere = np.bincount(merged.faces[is_point & ~lost, 0])
    _refuse_lost(lost.sum(), elsewhere.max(initial=0), "faces")
    corners = vertices[_is_used(vertices, faces)]
    lost = ~corners.any(axis=1)
    if lost.sum() >= _FEWEST_EMPTY:
        _, copies = np.unique(corners[~lost], axis=0, return_counts=True)
        _refuse_lost(lost.sum(), copies.max(initial=1) - 1, "vertices")


def _refuse_lost(count: int, elsewhere: int, what: str) -> None:
    if count >= _FEWEST_EMPTY and count > _ZEROS_TIMES * elsewhere:
        raise UnreadableError(
            f"{count} of its {what} are only zeros: a part of the file is lost",
            "Copy it, or export it, again.",
        )
