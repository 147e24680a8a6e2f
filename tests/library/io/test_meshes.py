"""Meshes: what is read is whole and in mm; what is not is refused with its reason."""

import struct

import numpy as np
import pytest
import trimesh

from gstlib.errors import InputError
from gstlib.io.meshes import read_mesh


@pytest.fixture
def stone():
    """A ball of 80 mm."""
    return trimesh.creation.icosphere(subdivisions=2, radius=40.0)


@pytest.mark.parametrize("kind", ["stl", "stl_ascii", "ply", "obj"])
def test_formats_give_the_same_closed_mesh(tmp_path, stone, kind):
    path = tmp_path / f"stone.{kind.split('_')[0]}"
    stone.export(path, file_type=kind)
    mesh = read_mesh(path)
    assert len(mesh.faces) == len(stone.faces)
    assert len(mesh.vertices) == len(stone.vertices)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(stone.volume, rel=1e-5)


@pytest.mark.parametrize(
    ("unit", "length"), [("cm", 10.0), ("m", 1000.0), ("um", 1e-3), ("in", 25.4)]
)
def test_units(tmp_path, stone, unit, length):
    stone.apply_scale(1 / length)
    stone.export(tmp_path / "stone.stl")
    mesh = read_mesh(tmp_path / "stone.stl", unit=unit)
    assert mesh.extents == pytest.approx([80, 80, 80], rel=1e-3)


def test_mesh_in_metres_is_named(tmp_path, stone):
    stone.apply_scale(1e-3)
    stone.export(tmp_path / "stone.stl")
    with pytest.raises(InputError, match=r"stone\.stl: .*0\.08 mm.*metres: set mesh_unit: m\."):
        read_mesh(tmp_path / "stone.stl")


def test_millimetres_taken_for_metres(tmp_path, stone):
    stone.export(tmp_path / "stone.stl")
    with pytest.raises(InputError, match=r"80 m, .*set mesh_unit: mm\."):
        read_mesh(tmp_path / "stone.stl", unit="m")


def _refused(path, match, **kwargs):
    with pytest.raises(InputError, match=match) as caught:
        read_mesh(path, **kwargs)
    assert path.name in str(caught.value)


def test_missing(tmp_path):
    _refused(tmp_path / "stone.stl", "no such file")


@pytest.mark.parametrize("name", ["a.stl", "a.ply", "a.obj"])
def test_empty(tmp_path, name):
    (tmp_path / name).write_bytes(b"")
    _refused(tmp_path / name, "empty")


def test_unknown_format_and_unit(tmp_path, stone):
    (tmp_path / "a.txt").write_text("hello")
    _refused(tmp_path / "a.txt", "not a mesh format")
    stone.export(tmp_path / "a.stl")
    _refused(tmp_path / "a.stl", "unknown mesh unit", unit="furlong")


@pytest.mark.parametrize("header", [b"\0" * 80, b"solid of the exporter".ljust(80, b"\0")])
def test_truncated_binary_stl(tmp_path, stone, header):
    path = tmp_path / "stone.stl"
    stone.export(path)
    whole = header + path.read_bytes()[80:]
    path.write_bytes(whole)
    assert len(read_mesh(path).faces) == 320  # whole, it is read
    path.write_bytes(whole[:5000])
    _refused(path, f"320 faces, which take {84 + 320 * 50} bytes, but the file has 5000.*truncated")
    path.write_bytes(whole[:50])
    _refused(path, "less than an STL header")
    path.write_bytes(whole + b"more")
    _refused(path, "damaged")


def test_truncated_ascii_stl(tmp_path, stone):
    path = tmp_path / "stone.stl"
    stone.export(path, file_type="stl_ascii")
    path.write_text(path.read_text()[:5000])
    _refused(path, "endsolid")


def test_truncated_ply(tmp_path, stone):
    path = tmp_path / "stone.ply"
    stone.export(path)
    path.write_bytes(path.read_bytes()[:3000])
    _refused(path, "ends within .face.: it is truncated")


def test_no_mesh_at_all(tmp_path):
    for name in ("a.stl", "a.ply", "a.obj"):
        (tmp_path / name).write_text("I am not a mesh, whatever my ending says\n" * 10)
        _refused(tmp_path / name, "not an STL|header of a PLY|line 1, .* is damaged")


def test_no_faces(tmp_path):
    (tmp_path / "a.stl").write_bytes(b"\0" * 80 + struct.pack("<I", 0))
    _refused(tmp_path / "a.stl", "no faces")
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 10 0 0\nv 0 10 0\n")
    _refused(tmp_path / "a.obj", "no faces")


def test_vertices_that_are_not_numbers(tmp_path):
    triangle = np.array([0, 0, 1, 0, 0, 0, 10, 0, 0, 0, np.nan, 0], "<f4")
    (tmp_path / "a.stl").write_bytes(
        b"\0" * 80 + struct.pack("<I", 1) + triangle.tobytes() + b"\0\0"
    )
    _refused(tmp_path / "a.stl", "1 of 3 vertices are not numbers")


def test_obj_with_a_face_of_a_vertex_that_is_not_there(tmp_path):
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 10 0 0\nv 0 10 0\nf 1 2 7\n")
    _refused(tmp_path / "a.obj", "a face has vertex 7 of 3")
