"""Mesh files that are damaged, odd or hostile: refused with a reason, or read as they say."""

import struct
import sys

import numpy as np
import pytest
import trimesh
from mesh_samples import FILES, MEMORY_FLOOR, MEMORY_SHARE, outcome_and_memory, stone

from gstlib.errors import InputError
from gstlib.io.meshes import read_mesh, read_points


def refused(path, match, **kwargs):
    with pytest.raises(InputError, match=match) as caught:
        read_mesh(path, **kwargs)
    assert path.name in str(caught.value)


@pytest.mark.parametrize("name", FILES)
def test_whole_files_are_read(tmp_path, name):
    (tmp_path / name).write_bytes(FILES[name])
    mesh = read_mesh(tmp_path / name)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(40 * 30 * 20, rel=1e-6)
    assert len(mesh.vertices) == (8 if name == "quads.obj" else len(stone().vertices))


@pytest.mark.parametrize(
    ("name", "line_end"),
    [
        *((name, b"\r\n") for name in ("ascii.stl", "ascii.ply", "plain.obj", "quads.obj")),
        *((name, b"\r") for name in ("ascii.stl", "plain.obj", "quads.obj")),
    ],
)
def test_line_ends_of_other_systems(tmp_path, name, line_end):
    (tmp_path / name).write_bytes(FILES[name].replace(b"\n", line_end))
    assert read_mesh(tmp_path / name).volume == pytest.approx(40 * 30 * 20, rel=1e-6)


def test_several_solids_of_any_name_are_one_mesh(tmp_path):
    facets = FILES["ascii.stl"].split(b"\n", 1)[1].replace(b"endsolid", b"").strip()
    half = facets.index(b"facet normal", len(facets) // 2)
    text = b"solid a vertex of\n%b\nendsolid\nsolid a vertex of\n%b\nendsolid solid\n"
    (tmp_path / "a.stl").write_bytes(text % (facets[:half], facets[half:]))
    assert read_mesh(tmp_path / "a.stl").volume == pytest.approx(40 * 30 * 20)


@pytest.mark.parametrize(
    ("name", "old", "new", "match"),
    [
        # Each of these trimesh reads, as a part of the stone or as another one.
        ("ascii.stl", b"vertex", b"vortex", "is no part of a facet"),
        ("ascii.stl", b"endfacet", b"", "is no part of a facet"),
        ("ascii.stl", b"vertex -20", b"vertex -2O", "is no part of a facet"),
        ("plain.obj", b"\nv ", b"\nw ", "line 2, 'w .* is damaged"),
        ("plain.obj", b"\nv ", b"\nV ", "line 2, 'V .* is damaged"),
        ("plain.obj", b"\nf ", b"\nf x", "'f x.* is damaged"),
        ("plain.obj", b"\nf 1 ", b"\nf 0 ", "'f 0 .* no such vertex"),
        ("plain.obj", b"\nf 1 ", b"\nf 999999999999 ", "a face has vertex 999999999999 of 26"),
        ("quads.obj", b"f -7", b"f -9", r"line \d+, .*no such vertex"),
        ("ascii.ply", b"5 3 0 ", b"5 4 0 ", "'face' has the row '5 4 0"),
        ("ascii.ply", b"5 3 0 ", b"5 3 0.5 ", "'face' has the row '5 3 0.5"),
        ("ascii.ply", b"5 3 0 ", b"5 3 77 ", "a face has vertex 77, counted from 0, of 26"),
        ("ascii.ply", b"-20 ", b"-2O ", "'vertex' has the row '-2O"),
        ("little.ply", struct.pack("<2B", 5, 3), struct.pack("<2B", 5, 4), "numbers of corners"),
        ("little.ply", struct.pack("<2Bi", 5, 3, 0), struct.pack("<2Bi", 5, 3, -1), "vertex -1"),
        ("little.ply", b"uchar int vertex_ind", b"uchar int vertex_int", "not vertex_indices"),
        ("little.ply", b"float y", b"float w", "not x, y and z"),
        ("little.ply", b"float y", b"float x", "a name twice"),
        ("little.ply", b"float y", b"flout y", "header has the line 'property flout y'"),
        ("little.ply", b"format binary_little", b"comment binary_little", "names no format"),
    ],
)
def test_damage_that_would_pass_for_a_mesh(tmp_path, name, old, new, match):
    assert old in FILES[name]
    (tmp_path / name).write_bytes(FILES[name].replace(old, new, 1))
    refused(tmp_path / name, match)


HUGE = 10**12


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.stl", b"\0" * 80 + struct.pack("<I", 2**32 - 1) + b"\0" * 50),
        ("a.ply", FILES["little.ply"].replace(b"vertex 26", b"vertex %d" % HUGE)),
        ("a.ply", FILES["ascii.ply"].replace(b"vertex 26", b"vertex %d" % HUGE)),
        ("a.ply", FILES["little.ply"].replace(b"face 48", b"face %d" % HUGE)),
        ("a.ply", FILES["little.ply"].replace(b"face 48", b"face 9" + b"9" * 5000)),
        ("a.ply", FILES["little.ply"].replace(b"list uchar", b"list uint")),
        ("a.ply", b"ply\nformat ascii 1.0\n" + b"comment x\n" * 200_000),
        (
            "a.ply",
            b"ply\nformat ascii 1.0\nelement vertex 1\n"
            + b"".join(b"property list uchar int p%d\n" % n for n in range(20_000))
            + b"end_header\n",
        ),
        ("a.ply", FILES["ascii.ply"].replace(b"end_header\n", b"end_header\n" + b"\n" * 1_000_000)),
        ("a.obj", b"f 1 2 3\n" * 20_000),
        ("a.obj", b"v 1 2 3\n" + (b"f" + b" 1" * 1000 + b"\n") * 100),
        ("a.obj", b"v " + b"1" * 1_000_000 + b" 2 3\n"),
        ("a.stl", b"solid " + b"facet normal " * 100_000 + b"\nendsolid"),
        ("a.stl", b"solid\n" + b"facet" + b" " * 1_000_000 + b"\nendsolid"),
        ("a.stl", b"solid\n" + b"solid\nendsolid\n" * 20_000),
    ],
)
def test_memory_is_bounded_by_the_file_not_by_its_promises(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    outcome, peak = outcome_and_memory(tmp_path / name)
    assert outcome is None or len(content) > 1_000_000  # blank lines do no harm
    assert peak < MEMORY_SHARE * len(content) + MEMORY_FLOOR


_opened = []
_watching = False


def _watch(event, arguments):
    if _watching and event in ("open", "socket.connect", "os.listdir", "subprocess.Popen"):
        _opened.append(str(arguments[0]))


sys.addaudithook(_watch)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("quads.obj", FILES["quads.obj"]),
        ("quads.obj", FILES["quads.obj"].replace(b"box.mtl", b"../secret.mtl")),
        ("little.ply", FILES["little.ply"]),
    ],
)
def test_no_file_but_the_mesh_is_opened(tmp_path, name, content):
    global _watching
    folder = tmp_path / "meshes"
    folder.mkdir()
    for secret in (tmp_path / "secret.mtl", folder / "box.mtl"):
        secret.write_text("newmtl grey\nmap_Kd ../secret.png\n")
    (tmp_path / "secret.png").write_bytes(b"not a picture")
    (folder / name).write_bytes(content)
    read_mesh(folder / name)  # modules are imported here
    _opened.clear()
    _watching = True
    try:
        read_mesh(folder / name)
    finally:
        _watching = False
    assert _opened == [str(folder / name)]


def test_number_of_corners_of_a_later_face(tmp_path):
    """As long as its header says, so trimesh reads it."""
    last = FILES["little.ply"].rindex(struct.pack("<2B", 5, 3))
    content = bytearray(FILES["little.ply"])
    content[last + 1] = 7
    (tmp_path / "a.ply").write_bytes(content)
    refused(tmp_path / "a.ply", "'vertex_indices' has 3 to 7 entries")


def test_more_properties_than_any_mesh_has(tmp_path):
    lists = b"".join(b"property list uchar int p%d\n" % number for number in range(300))
    head, body = FILES["little.ply"].split(b"end_header\n")
    content = head + b"element other 1\n" + lists + b"end_header\n" + body + b"\0" * 300
    (tmp_path / "a.ply").write_bytes(content)
    refused(tmp_path / "a.ply", "hundreds of properties")


def test_other_elements_do_no_harm(tmp_path):
    """Edges, which trimesh makes a path of, and texture, by which it parts the faces."""
    head, body = FILES["ascii.ply"].split(b"end_header\n")
    head = head.replace(b"uchar red\n", b"uchar s\nproperty float t\n")
    head += b"element edge 2\nproperty int vertex1\nproperty int vertex2\nend_header\n"
    rows = body.splitlines()
    rows = [*(row + b" 0.5" for row in rows[:26]), *rows[26:], b"0 1", b"1 2", b""]
    (tmp_path / "a.ply").write_bytes(head + b"\n".join(rows))
    mesh = read_mesh(tmp_path / "a.ply")
    assert (len(mesh.vertices), len(mesh.faces)) == (26, 48)
    assert mesh.volume == pytest.approx(40 * 30 * 20)


@pytest.mark.parametrize("kind", ["stl", "ply", "obj"])
def test_faces_without_area(tmp_path, kind):
    line = trimesh.Trimesh([[0, 0, 0], [10, 0, 0], [20, 0, 0]], [[0, 1, 2]], process=False)
    line.export(tmp_path / f"a.{kind}")
    refused(tmp_path / f"a.{kind}", "no area")


@pytest.mark.parametrize("name", ["ascii.stl", "little.ply", "ascii.ply", "plain.obj"])
def test_not_a_number(tmp_path, name):
    olds = {"little.ply": np.float32(-20).tobytes(), "ascii.stl": b"-20.0", "ascii.ply": b"-20"}
    old = olds.get(name, b"-20.00000000")
    new = np.float32(np.nan).tobytes() if name == "little.ply" else b"nan"
    assert old in FILES[name]
    (tmp_path / name).write_bytes(FILES[name].replace(old, new, 1))
    refused(tmp_path / name, "are not numbers")


class TestPoints:
    """Files of points: whatever their faces are."""

    @pytest.mark.parametrize("name", FILES)
    def test_of_a_mesh(self, tmp_path, name):
        (tmp_path / name).write_bytes(FILES[name])
        points = read_points(tmp_path / name, unit="in")
        np.testing.assert_allclose(np.ptp(points, axis=0), 25.4 * np.array([40, 30, 20]))

    def test_ply_of_mixed_polygons(self, tmp_path):
        content = FILES["ascii.ply"].replace(b"element face 48", b"element face 2")
        content = content[: content.index(b"\n5 3 ") + 1] + b"5 4 0 1 2 3\n5 5 0 1 2 3 4\n"
        (tmp_path / "a.ply").write_bytes(content)
        refused(tmp_path / "a.ply", "faces have 4 to 5 corners.*as triangles")
        assert read_points(tmp_path / "a.ply").shape == (26, 3)

    @pytest.mark.parametrize(
        "text",
        [
            "1 2 3\n4 5 6\n",
            "1\t2\t3\t0.5\n\n4\t5\t6\t0.5",
            "x,y,z\n1,2,3\n4,5,6\n",
            "# mm\nX;Y;Z;name\n1;2;3;a\n4;5;6;b\n",
        ],
    )
    def test_of_a_table(self, tmp_path, text):
        (tmp_path / "a.csv").write_text(text)
        np.testing.assert_array_equal(read_points(tmp_path / "a.csv"), [[1, 2, 3], [4, 5, 6]])

    @pytest.mark.parametrize(
        ("name", "content", "match"),
        [
            ("a.csv", b"1,2,3\n4,5\n", "row 2"),
            ("a.csv", b"x,y,z\n", "no points"),
            ("a.xyz", b"1 2 nan\n", "not numbers"),
            ("a.obj", b"o nothing\n", "no points"),
            ("a.ply", FILES["little.ply"][:600], "truncated"),
            ("a.pp", b"<x/>", "not a mesh format"),
        ],
    )
    def test_refused(self, tmp_path, name, content, match):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=match):
            read_points(tmp_path / name)
