"""Mesh files that are damaged, odd or hostile: refused with a reason, or read as they say.

The fuzz holds what `read_mesh` accepts against readers of its own, written row by row. With
GSTLIB_FUZZ_EXAMPLES=2000 in the environment it makes that many files of each kind, other ones in
every run; with -s it tells how many were refused, and the most memory and time that one took.
"""

import io
import itertools
import os
import re
import struct
import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, note, settings
from hypothesis import strategies as st

from gstlib.errors import InputError
from gstlib.io.meshes import read_mesh, read_points
from gstlib.preprocess.frame import Frame
from gstlib.preprocess.gridding import grid_both_ways

EXAMPLES = int(os.environ.get("GSTLIB_FUZZ_EXAMPLES", "0"))

# Of the file's size, and bytes whatever its size.
MEMORY_SHARE, MEMORY_FLOOR = 100, 2_000_000


def stone():
    """A box of 40 mm with 48 triangles."""
    return trimesh.creation.box((40.0, 30.0, 20.0)).subdivide()


def quads_obj():
    """A box of quads, as modelling programs write it: names, materials, texture, relative faces."""
    corners = itertools.product((0.0, 40.0), (0.0, 30.0), (0.0, 20.0))
    lines = ["# a box", "mtllib box.mtl", "o Box"]
    lines += [f"v {x} {y} {z}" for x, y, z in corners]
    lines += ["vt 0.0 0.0", "vn 0 0 1", "usemtl grey", "s off", "g sides"]
    sides = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5)]
    lines += ["f " + " ".join(f"{corner}/1/1" for corner in side) for side in sides]
    lines += ["f -7 -3 -1 -5 # the last one, counted back", ""]
    return "\n".join(lines).encode()


def ply(order="<", dtype="<f4"):
    """The stone as a PLY with columns before and after those that matter."""
    mesh = stone()
    name = {"<": "binary_little_endian", ">": "binary_big_endian", "": "ascii"}[order]
    header = [
        *("ply", f"format {name} 1.0", "comment TextureFile ../secret.png"),
        *(f"element vertex {len(mesh.vertices)}", "property float x", "property float y"),
        *("property float z", "property uchar red", f"element face {len(mesh.faces)}"),
        *("property uchar quality", "property list uchar int vertex_indices", "end_header\n"),
    ]
    body = b""
    for x, y, z in mesh.vertices:
        body += struct.pack(order + "3fB", x, y, z, 9) if order else b"%g %g %g 9\n" % (x, y, z)
    for a, b, c in mesh.faces.tolist():
        body += (
            struct.pack(order + "2B3i", 5, 3, a, b, c) if order else b"5 3 %d %d %d\n" % (a, b, c)
        )
    return "\n".join(header).encode() + body


def exported(kind):
    content = stone().export(file_type=kind)
    return content if isinstance(content, bytes) else content.encode()


FILES = {
    "binary.stl": exported("stl"),
    "ascii.stl": exported("stl_ascii"),
    "little.ply": ply("<"),
    "big.ply": ply(">"),
    "ascii.ply": ply(""),
    "plain.obj": exported("obj"),
    "quads.obj": quads_obj(),
}


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


def outcome_and_memory(path):
    """The mesh, or None if it is refused, and the most bytes allocated while reading it."""
    mesh = None
    tracemalloc.start()
    try:
        mesh = read_mesh(path)
    except InputError as error:
        message = str(error)
    else:
        message = path.name
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert path.name in message
    return mesh, peak


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


# --- fuzz ----------------------------------------------------------------------------------------

TOKENS = [
    *(b"nan", b"inf", b"-1", b"1e999", b"0", b"4294967295", b"1000000000000", b"1e-5", b".", b"-"),
    *(b"\n", b"\r", b"\0", b" ", b"\t", b"#", b"/", b"\\\n", b"\xff\xff\xff\xff", b"\x80\x7f"),
    *(b"solid", b"endsolid\n", b"facet", b"vertex", b"endloop", b"endfacet\n"),
    *(b"ply\n", b"end_header\n", b"element face 3\n", b"element vertex 1000000000000\n"),
    *(b"property list uint int a\n", b"property double b\n", b"format ascii 1.0\n"),
    *(b"\nv 1 2 3", b"\nf 1 2 3", b"\nf -1 -2 -3 -4\n", b"\nmtllib /etc/passwd\n", b"usemtl a\n"),
    *(b"\n5 3 1 2 3", b"\x03", b"\x04"),
]


@st.composite
def damaged(draw, content):
    """The content of a file after one to four accidents."""
    for _ in range(draw(st.sampled_from([1, 1, 1, 2, 3]))):
        size = len(content)
        place = draw(st.integers(0, size))
        until = min(size, place + draw(st.integers(0, 60)))
        match draw(
            st.sampled_from(["flip", "token", "put", "cut", "drop", "repeat", "swap", "zero"])
        ):
            case "flip" if place < size:
                flipped = bytes([content[place] ^ (1 << draw(st.integers(0, 7)))])
                content = content[:place] + flipped + content[place + 1 :]
            case "token":
                content = content[:place] + draw(st.sampled_from(TOKENS)) + content[place:]
            case "put":
                token = draw(st.sampled_from(TOKENS) | st.binary(max_size=8))
                content = content[:place] + token + content[place + len(token) :]
            case "cut":
                content = content[:place]
            case "drop":
                content = content[:place] + content[until:]
            case "repeat":
                content = content[:until] + content[place:]
            case "swap":
                other = draw(st.sampled_from(sorted(FILES.values())))
                content = content[:place] + other[place:]
            case "zero":
                content = content[:place] + b"\0" * (until - place) + content[until:]
    return content


def stl_triangles(content):
    if len(content) >= 84 and len(content) == 84 + 50 * struct.unpack_from("<I", content, 80)[0]:
        rows = [content[start : start + 50] for start in range(84, len(content), 50)]
        return [struct.unpack("<12f", row[:48])[3:] for row in rows]
    lines = content.decode("latin-1").lower().replace("\r", "\n").split("\n")
    words = [w for line in lines if not _names_solid(line) for w in line.split()]
    text = iter(" ".join(words).replace("outerloop", "outer loop").split())
    triangles = []
    for word in text:
        assert (word, next(text)) == ("facet", "normal")
        [next(text) for _ in range(3)]
        assert (next(text), next(text)) == ("outer", "loop")
        corners = []
        for _ in range(3):
            assert next(text) == "vertex"
            corners += [float(next(text)) for _ in range(3)]
        for what in ("loop", "facet"):
            end = next(text)
            assert end == f"end{what}" or (end, next(text)) == ("end", what)
        triangles.append(corners)
    return triangles


def _names_solid(line):
    return line.split()[:1] in (["solid"], ["endsolid"])


def ply_triangles(content):
    header, body = re.split(rb"^end_header.*\n", content, maxsplit=1, flags=re.MULTILINE)
    codes = dict(
        char="b", uchar="B", short="h", ushort="H", int="i", uint="I", float="f", double="d"
    )
    codes |= dict(int8="b", uint8="B", int16="h", uint16="H", int32="i", uint32="I", float32="f")
    codes |= dict(float64="d", int64="q", uint64="Q")
    lines = [line.split() for line in header.decode("latin-1").splitlines()]
    (form,) = [line[1] for line in lines if line[:1] == ["format"]]
    stream, words = io.BytesIO(body), iter(body.split())

    def value(kind):
        if form == "ascii":
            return float(next(words))
        code = {"b": ">", "l": "<"}[form[7]] + codes[kind]
        return struct.unpack(code, stream.read(struct.calcsize(code)))[0]

    tables = {}
    for place, line in enumerate(lines):
        if line[:1] != ["element"]:
            continue
        rows = tables[line[1]] = []
        columns = itertools.takewhile(lambda x: x[:1] != ["element"], lines[place + 1 :])
        columns = [column for column in columns if column[:1] == ["property"]]
        for _ in range(int(line[2])):
            row = {}
            for _, *kind, name in columns:
                listed = kind[0] == "list"
                count = int(value(kind[1])) if listed else 1
                entries = [value(kind[-1]) for _ in range(count)]
                row[name] = entries if listed else entries[0]
            rows.append(row)
    points = [[row[axis] for axis in "xyz"] for row in tables["vertex"]]
    faces = [row.get("vertex_indices", row.get("vertex_index")) for row in tables["face"]]
    return _fan(points, [[int(corner) for corner in face] for face in faces])


def obj_triangles(content):
    text = content.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n").replace("\\\n", " ")
    points, faces = [], []
    for line in text.split("\n"):
        words = line.split("#")[0].split()
        if words[:1] == ["v"]:
            points.append([float(word) for word in words[1:4]])
        elif words[:1] == ["f"]:
            corners = [int(word.split("/")[0]) for word in words[1:]]
            faces.append([c - 1 if c > 0 else len(points) + c for c in corners])
    return _fan(points, faces)


def _fan(points, faces):
    assert min(map(min, faces)) >= 0
    return [
        points[face[0]] + points[second] + points[third]
        for face in faces
        for second, third in itertools.pairwise(face[1:])
    ]


def moments(triangles):
    """Area, its first and second moments, and volume: none of them depends on the order."""
    corners = np.array(triangles, dtype=float).reshape(-1, 3, 3)
    area_vectors = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    area = np.linalg.norm(area_vectors, axis=1)[:, None]
    centres = corners.mean(axis=1)
    volume = np.einsum("ij,ij->", corners[:, 0], area_vectors) / 3
    return np.array([area.sum(), *(area * centres).sum(0), *(area * centres**2).sum(0), volume])


def grid_or_refuse(mesh):
    """What is read can be gridded, or is refused with a reason."""
    top = mesh.bounds[1]
    frame = Frame((top[0] - 5, top[1] - 5, top[2]), (-1, 0, 0), (0, 0, 1))
    try:
        gridded = grid_both_ways(mesh, frame, size_mm=5.0, shape=(9, 9), margin_mm=1.0)
    except InputError:
        return
    assert np.isfinite(gridded.height.values).all()


READERS = {"stl": stl_triangles, "ply": ply_triangles, "obj": obj_triangles}


@pytest.mark.parametrize("name", FILES)
def test_the_readers_of_the_fuzz_read(name):
    triangles = np.array(READERS[Path(name).suffix[1:]](FILES[name]))
    assert moments(triangles)[-1] == pytest.approx(40 * 30 * 20)


@pytest.mark.parametrize("name", FILES)
def test_fuzz(tmp_path_factory, name):
    path = tmp_path_factory.mktemp("fuzz") / name
    path.write_bytes(FILES[name])
    read_mesh(path)  # imports take memory too
    tally = {"files": 0, "refused": 0, "memory": 0, "seconds": 0.0}

    @settings(
        max_examples=EXAMPLES or 60,
        derandomize=not EXAMPLES,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(damaged(FILES[name]) | st.binary(max_size=300))
    def check(content):
        path.write_bytes(content)
        start = time.perf_counter()
        mesh, peak = outcome_and_memory(path)
        seconds = time.perf_counter() - start
        note(f"{len(content)} bytes, {peak} of memory")
        assert peak < MEMORY_SHARE * len(content) + MEMORY_FLOOR
        tally["files"] += 1
        tally["refused"] += mesh is None
        tally["memory"] = max(tally["memory"], peak)
        tally["seconds"] = max(tally["seconds"], seconds)
        if mesh is not None:
            assert np.isfinite(mesh.vertices).all()
            expected = moments(READERS[Path(name).suffix[1:]](content))
            found = moments(mesh.triangles)
            scale = np.abs(expected).max()
            np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-6 * scale)
            grid_or_refuse(mesh)

    check()
    print(f"{name}: {tally}")
    assert tally["refused"] > 0
