"""Meshes: what is read is whole and in mm; what is cut or damaged is refused with its reason."""

import itertools
import json
import re
import struct
import zipfile

import numpy as np
import pytest
import trimesh
from gstlib.errors import NOTE, InputError
from gstlib.io.meshes import ply_with, read_mesh

SIZE = (40.0, 30.0, 20.0)


def stone():
    """A box with 26 vertices and 48 triangles."""
    return trimesh.creation.box(SIZE).subdivide()


def uneven(roughness=0.02):
    """A rough ball of 5120 triangles."""
    ball = trimesh.creation.icosphere(4, radius=20)
    ball.vertices *= 1 + roughness * np.random.default_rng(1).normal(size=(len(ball.vertices), 1))
    return ball


def exported(kind):
    content = stone().export(file_type=kind)
    return content if isinstance(content, bytes) else content.encode()


def quads_obj():
    """A box of quads, as modelling programs write it: names, materials, texture."""
    corners = itertools.product(*((0.0, size) for size in SIZE))
    lines = ["# a box", "mtllib box.mtl", "o Box"]
    lines += [f"v {x} {y} {z}" for x, y, z in corners]
    lines += ["vt 0.0 0.0", "vn 0 0 1", "usemtl grey", "s off", "g sides"]
    sides = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    lines += ["f " + " ".join(f"{corner}/1/1" for corner in side) for side in sides]
    return ("\n".join(lines) + "\n").encode()


def ply(order):
    """The stone as a PLY with columns before and after those that matter."""
    mesh = stone()
    name = {"<": "binary_little_endian", ">": "binary_big_endian", "": "ascii"}[order]
    header = [
        "ply",
        f"format {name} 1.0",
        "comment TextureFile ../secret.png",
        f"element vertex {len(mesh.vertices)}",
        "property float x",
        "property float y",
        "property float z",
        "property uchar red",
        f"element face {len(mesh.faces)}",
        "property uchar quality",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    body = b""
    for x, y, z in mesh.vertices:
        body += struct.pack(order + "3fB", x, y, z, 9) if order else b"%g %g %g 9\n" % (x, y, z)
    for a, b, c in mesh.faces.tolist():
        row = b"5 3 %d %d %d\n" % (a, b, c)
        body += struct.pack(order + "2B3i", 5, 3, a, b, c) if order else row
    return "\n".join(header).encode() + body


FILES = {
    "binary.stl": exported("stl"),
    "ascii.stl": exported("stl_ascii"),
    "little.ply": ply("<"),
    "big.ply": ply(">"),
    "ascii.ply": ply(""),
    "plain.obj": exported("obj").rstrip() + b"\n",
    "quads.obj": quads_obj(),
    "text.off": exported("off"),
    **{
        f"windows.{kind}": FILE.replace(b"\n", b"\r\n")
        for kind, FILE in (("obj", quads_obj()), ("ply", ply("")))
    },
    "whole.glb": exported("glb"),
    "whole.3mf": exported("3mf"),
}
BIG = FILES["big.ply"]
each_file = pytest.mark.parametrize("name", FILES)


def refused(path, match, **kwargs):
    with pytest.raises(InputError, match=match) as caught:
        read_mesh(path, **kwargs)
    assert path.name in str(caught.value)


@pytest.fixture
def write(tmp_path):
    def write(name, content=None):
        (tmp_path / name).write_bytes(FILES[name] if content is None else content)
        return tmp_path / name

    return write


@each_file
def test_whole_files_are_read(write, name):
    mesh = read_mesh(write(name), unit="mm")
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(np.prod(SIZE), rel=1e-6)
    assert len(mesh.vertices) == (8 if name in ("quads.obj", "windows.obj") else 26)
    assert mesh.extents == pytest.approx(SIZE)


def test_the_parts_of_a_scene_are_put_where_it_has_them(tmp_path):
    scene = trimesh.Scene(stone())
    twice = np.diag([2.0, 2.0, 2.0, 1.0])
    twice[0, 3] = 100.0
    scene.add_geometry(stone(), transform=twice)
    scene.export(tmp_path / "two.glb")
    mesh = read_mesh(tmp_path / "two.glb", unit="mm")
    np.testing.assert_allclose(mesh.bounds, [[-20, -30, -20], [140, 30, 20]], atol=1e-5)
    assert mesh.body_count == 2


def test_glb_is_in_metres_and_another_unit_is_warned_of(write, tmp_path, caplog):
    stone().apply_scale(1e-3).export(tmp_path / "metres.glb")
    for unit in (None, "m"):
        mesh = read_mesh(tmp_path / "metres.glb", unit=unit)
        assert mesh.extents == pytest.approx(SIZE)
        assert mesh.metadata["file_unit"] == "m"
    assert caplog.text == ""
    assert read_mesh(write("whole.glb"), unit="mm").metadata["file_unit"] == "mm"
    assert "specification" in caplog.text


def three_mf(path, stated, length=1.0):
    """The stone as a 3MF that states its unit so."""
    stone().apply_scale(1 / length).export(path)
    with zipfile.ZipFile(path) as plain:
        members = {name: plain.read(name) for name in plain.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content.replace(b' unit="millimeter"', stated))
    return path


@pytest.mark.parametrize(
    ("stated", "unit", "length"),
    [
        (b' unit="inch"', "in", 25.4),
        (b' unit="MilliMeter"', "mm", 1.0),
        (b"", "mm", 1.0),  # by the specification
    ],
)
def test_the_unit_that_a_3mf_states_holds(tmp_path, stated, unit, length):
    path = three_mf(tmp_path / "a.3mf", stated, length)
    for own in (None, unit):
        mesh = read_mesh(path, unit=own)
        assert mesh.extents == pytest.approx(SIZE, rel=1e-3)
        assert mesh.metadata["file_unit"] == unit
    refused(path, f"Set mesh_unit: {unit}", unit="cm")
    refused(three_mf(tmp_path / "b.3mf", b' unit="furlong"'), "furlong")


def glb(change=lambda header: header, numbers="<f4", largest=None, **part):
    """A ball of 60 mm as a GLB, its positions as a kind of numbers, its header changed."""
    mesh = trimesh.creation.icosphere(4, radius=0.03)  # m
    places = np.asarray(mesh.vertices)
    places = np.round(places / 0.03 * largest) if largest else places
    rows = np.zeros((len(places), 4), numbers)
    rows[:, :3] = places
    corners = np.asarray(mesh.faces, "<u4")
    data = rows.tobytes() + corners.tobytes()
    types = {"<f4": 5126, "<i2": 5122, "i1": 5120}
    views = [
        {"buffer": 0, "byteLength": rows.nbytes, "byteStride": 4 * rows.itemsize},
        {"buffer": 0, "byteOffset": rows.nbytes, "byteLength": corners.nbytes},
    ]
    positions = {"bufferView": 0, "componentType": types[numbers], "count": len(rows)}
    indices = {"bufferView": 1, "componentType": 5125, "count": corners.size, "type": "SCALAR"}
    header = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1} | part]}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": views,
        "accessors": [positions | {"type": "VEC3"}, indices],
    }
    text = json.dumps(change(header)).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def scaled(scale, **accessor):
    def change(header):
        header["nodes"][0]["scale"] = [scale] * 3
        header["accessors"][0] |= accessor
        return header | {"extensionsRequired": ["KHR_mesh_quantization"]}

    return change


def placed(header):
    """The node of its node moves it by a kilometre, turns and mirrors it."""
    header["nodes"] = [
        {"children": [1], "translation": [1000, 0, 0]},
        {"mesh": 0, "scale": [-1, 1, 1], "rotation": [0, 0, 0.6, 0.8]},
    ]
    return header


@pytest.mark.parametrize(
    ("content", "step_mm"),
    [
        (glb(), 1.9e-6),
        (glb(placed), 1.9e-6),
        (glb(scaled(0.03 / 32767), "<i2", 32767), 0.92e-3),
        (glb(scaled(0.03, normalized=True), "<i2", 32767), 0.92e-3),
    ],
)
def test_positions_of_a_glb_are_read_as_they_are_meant(write, content, step_mm):
    mesh = read_mesh(write("a.glb", content))
    assert mesh.extents == pytest.approx([60, 60, 60], rel=1e-3)
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 30**3, rel=0.01)
    assert mesh.metadata["step_mm"] == pytest.approx(step_mm, rel=0.1)


def changed(*path, **keys):
    """What changes the part of a header at the end of a path."""

    def change(header):
        part = header
        for step in path:
            part = part[step]
        part |= keys
        return header

    return change


def without_view(header):
    del header["accessors"][0]["bufferView"]
    return header


MESHOPT = {"EXT_meshopt_compression": {"buffer": 0}}


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (glb(scaled(0.03, normalized=True), "i1", 127), "steps of 236 µm"),
        (glb(changed(extensionsRequired=["KHR_draco_mesh_compression"])), "KHR_draco"),
        (glb(changed(extensionsRequired=["EXT_x"])), "EXT_x"),
        (glb(changed("bufferViews", 0, extensions=MESHOPT)), "EXT_meshopt"),
        (glb(changed("accessors", 0, sparse={"count": 10})), "sparse positions"),
        (glb(changed("accessors", 1, sparse={"count": 10})), "sparse triangles"),
        (glb(without_view), "positions"),
        (glb(changed("meshes", 0, weights=[0.0, 0.5])), "morph"),
        (glb(changed("nodes", 0, skin=0)), "skin"),
        (glb(changed("buffers", 0, uri="a.bin")), "a.bin"),
        (glb(mode=6), "fans"),
    ],
)
def test_what_a_glb_uses_and_is_not_read_is_named(write, content, match):
    refused(write("a.glb", content), match)


def test_strips_of_a_glb_are_triangles_that_look_one_way(write):
    def strip(header):
        header["accessors"][1]["count"] = 6
        return header

    mesh = read_mesh(write("a.glb", glb(strip, mode=5)))
    assert len(mesh.faces) == 4


def test_a_wrong_unit_is_named(tmp_path):
    stone().apply_scale(1e-3).export(tmp_path / "metres.stl")
    refused(tmp_path / "metres.stl", r"0\.04 mm.*set mesh_unit: m \(40 mm\)\.")
    stone().export(tmp_path / "mm.stl")
    refused(tmp_path / "mm.stl", r"40 m, .*set mesh_unit: mm \(40 mm\)\.", unit="m")
    refused(tmp_path / "mm.stl", "unknown mesh unit", unit="furlong")


def ball():
    """A stone of 2562 vertices, in mm, none of whose coordinates has an end."""
    return uneven(0.3)


def text_stl(mesh, number):
    corners = ("vertex " + " ".join(number % c for c in p) for t in mesh.triangles for p in t)
    faces = zip(*[corners] * 3, strict=True)
    body = "\nendloop\nendfacet\nfacet normal 0 0 1\nouter loop\n".join(map("\n".join, faces))
    return f"solid a\nfacet normal 0 0 1\nouter loop\n{body}\nendloop\nendfacet\nendsolid a\n"


def moved(by, kind="<f8", scale=1.0):
    """The ball, with coordinates that have gone through numbers of a kind far from the origin."""
    mesh = ball()
    vertices = (mesh.vertices * scale + by).astype(kind).astype(float)
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


def double_ply(mesh):
    header = double_header(len(mesh.vertices), len(mesh.faces))
    rows = np.zeros(len(mesh.faces), [("n", "u1"), ("corners", "<i4", 3)])
    rows["n"], rows["corners"] = 3, mesh.faces
    return header + np.asarray(mesh.vertices, "<f8").tobytes() + rows.tobytes()


def double_header(vertices, faces):
    return (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {vertices}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
    ).encode()


UTM = [431_234.0, 5_412_345.0, 120.0]  # m
STEPS = {
    "single.stl": (ball().export(file_type="stl"), "mm", 3.8e-6),
    "double.ply": (double_ply(ball()), "mm", 7.1e-15),
    "100m.stl": (moved(1e5).export(file_type="stl"), "mm", 7.8e-3),
    "utm_in_m.stl": (moved(UTM, scale=1e-3).export(file_type="stl"), "m", 500),
    "utm_in_double.ply": (double_ply(moved(UTM, scale=1e-3)), "m", 0.93e-6),
    # moved back, as some programs do when they export
    "back.ply": (double_ply(moved(1e5, "<f4").apply_translation([-1e5] * 3)), "mm", 7.8e-3),
    "two_decimals.stl": (text_stl(ball(), "%.2f").encode(), "mm", 10e-3),
}


@pytest.mark.parametrize("name", STEPS)
def test_the_step_of_the_coordinates_is_said_warned_of_and_refused(write, caplog, name):
    content, unit, step_mm = STEPS[name]
    if step_mm > 20e-3:
        refused(write(name, content), "steps of .* (origin|digits)", unit=unit)
        return
    mesh = read_mesh(write(name, content), unit=unit)
    assert mesh.metadata["step_mm"] == pytest.approx(step_mm, rel=0.1)
    assert ("steps of" in caplog.text) == (step_mm > 1e-3)


def test_a_grid_of_heights_is_not_rounded_to_its_spacing(write):
    y, x = np.mgrid[0:40, 0:40] * 0.5
    z = np.random.default_rng(1).random(x.shape)
    corner = np.arange(39 * 40).reshape(39, 40)[:, :-1].ravel()
    faces = np.vstack([corner[:, np.newaxis] + corners for corners in ([0, 1, 41], [0, 41, 40])])
    sheet = trimesh.Trimesh(np.stack([x, y, z], axis=-1).reshape(-1, 3), faces, process=False)
    assert read_mesh(write("a.ply", double_ply(sheet))).metadata["step_mm"] < 1e-5


def quads(kind):
    """The box of quads as another kind of text, with its rows of vertices and faces."""
    lines = [line.split() for line in quads_obj().decode().splitlines()]
    places = [" ".join(line[1:]) for line in lines if line[0] == "v"]
    sides = [[int(c.split("/")[0]) - 1 for c in line[1:]] for line in lines if line[0] == "f"]
    rows = [*places, *("4 " + " ".join(map(str, side)) for side in sides)]
    if kind == "off":
        return "\n".join(["OFF", f"{len(places)} {len(sides)} 0", *rows]).encode()
    header = [
        "ply",
        "format ascii 1.0",
        "comment before end_header",
        f"element vertex {len(places)}",
    ]
    header += [f"property float {axis}" for axis in "xyz"]
    header += [f"element face {len(sides)}", "property list uchar int vertex_indices", "end_header"]
    return "\n".join(header + rows).encode()


def counted(stated):
    return FILES["binary.stl"][:80] + stated.to_bytes(4, "little") + FILES["binary.stl"][84:]


PLAIN = FILES["plain.obj"]
DIALECTS = {
    "bytes behind.stl": FILES["binary.stl"] + b"more",
    "padded.stl": FILES["binary.stl"] + bytes(512),
    "streamed.stl": counted(0),
    "named.stl": FILES["ascii.stl"].replace(b"solid ", b"solid my endsolid vertex ", 1),
    "padded text.stl": FILES["ascii.stl"] + bytes(9),
    "no end.obj": FILES["plain.obj"].rstrip(),
    "tabs.obj": PLAIN.replace(b" ", b"\t"),
    "indented.obj": PLAIN.replace(b"\n", b" \n  "),
    "old Mac.obj": PLAIN.replace(b"\n", b"\r"),
    "commented.obj": PLAIN.replace(b"\nf ", b" # a vertex\n\n# a face\nf ", 1),
    "backwards.obj": re.sub(
        rb"(?<= )\d+(?=[ \n])", lambda n: b"%d" % (int(n[0]) - 27), PLAIN[PLAIN.index(b"\nf") :]
    ).join([PLAIN[: PLAIN.index(b"\nf")], b""]),
    "marked.obj": b"\xef\xbb\xbf" + PLAIN,
    "sixteen.obj": PLAIN.decode().encode("utf-16"),
    "tabs.off": FILES["text.off"].replace(b" ", b"\t").replace(b"OFF\n", b"NOFF # normals\n"),
    "quads.off": quads("off"),
    "quads.ply": quads("ply"),
    "both sides.stl": trimesh.util.concatenate(
        [stone(), trimesh.Trimesh(stone().vertices, stone().faces[:, ::-1], process=False)]
    ).export(file_type="stl"),
    "bytes behind.glb": FILES["whole.glb"] + b"more",
}


@pytest.mark.parametrize("name", DIALECTS)
def test_dialects_are_read(write, name):
    mesh = read_mesh(write(name, DIALECTS[name]), unit="mm")
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(np.prod(SIZE), rel=1e-6)


@pytest.mark.parametrize(
    ("name", "content", "match"),
    [
        ("more.stl", counted(40), "states 40 triangles, and more follow"),
        ("commas.obj", PLAIN.replace(b".", b","), "decimal commas"),
        ("weights.obj", re.sub(rb"(?m)^v .*$", rb"\g<0> 2.0", PLAIN), "fourth number"),
        ("4D.off", FILES["text.off"].replace(b"OFF", b"4OFF"), "header of OFF"),
        ("mixed.obj", b"f -1 -1 -1\n" + PLAIN.replace(b"\nf 1", b"\nf -1"), "backwards"),
    ],
)
def test_what_could_mean_two_stones_is_refused(write, name, content, match):
    refused(write(name, content), match)


@pytest.mark.parametrize("comment", [b"# Units: centimeters", b"# File units = cm"])
def test_a_comment_states_the_unit(write, caplog, comment):
    content = comment + b"\n" + stone().apply_scale(0.1).export(file_type="obj").encode()
    assert read_mesh(write("a.obj", content)).extents == pytest.approx(SIZE)
    assert not caplog.text
    assert read_mesh(write("a.obj", content), unit="mm").extents[0] == pytest.approx(4)
    assert "is in cm" in caplog.text


@each_file
def test_cut_files_are_refused(write, name):
    """Wherever it is cut, but for an OBJ at the end of a line (see docs/reference/formats.md)."""
    content = uneven().export(file_type="obj").encode() if name.endswith("obj") else FILES[name]
    for length in {0, 1, 40, *range(100, len(content) - 20, len(content) // 17)}:
        with pytest.raises(InputError, match=name):
            read_mesh(write(name, content[:length].rstrip(b"\r\n")))
    if re.match("binary|little|big|whole", name):
        refused(write(name, content[:-1]), "cut|truncated|unexpected length")


@pytest.mark.parametrize(
    ("name", "old", "new", "match"),
    [
        # trimesh reads each of these as a part of the stone, or as another one
        ("ascii.stl", b"vertex", b"vortex", "cannot be read as STL"),
        ("ascii.stl", b"endfacet", b"", "48 triangles can be read.*states 47"),
        ("plain.obj", b"\nv ", b"\nw ", "cannot be read as OBJ"),
        ("plain.obj", b"\nf 1 ", b"\nf 0 ", "vertex number 0"),
        ("ascii.ply", b"5 3 0 ", b"5 3 77 ", "a face refers to a vertex outside its 26"),
        ("little.ply", struct.pack("<2Bi", 5, 3, 0), struct.pack("<2Bi", 5, 3, -1), "outside its"),
        ("little.ply", b"float y", b"float w", "cannot be read as PLY"),
        ("little.ply", b"face 48", b"face 100000000000", "cannot be read as PLY"),
        ("text.off", b"26 48", b"26 49", "has 74 rows, but states 75"),
        ("binary.stl", FILES["binary.stl"], FILES["binary.stl"][:-50], "47 triangles .* 48"),
        ("plain.obj", FILES["plain.obj"], b"v 0 0 0\nv 9 0 0\nv 0 9 0\n", "no faces"),
        ("whole.3mf", b"PK\1\2", b"PK\1\3", "is damaged"),
        ("little.ply", np.float32(-20).tobytes(), np.float32("nan").tobytes(), "are not numbers"),
        ("ascii.ply", b"-20 ", b"-2 0 ", "a row that its header does not describe"),
        # the last face, of 14 bytes, has none or seven corners
        ("big.ply", BIG[-14:], BIG[-14:-13] + b"\0" + BIG[-12:], "different numbers of corners"),
        ("big.ply", BIG[-14:], BIG[-14:-13] + b"\7" + BIG[-12:], "different numbers of corners"),
        ("text.off", b"\n3 ", b"\n3 0 1 2\n3 ", "has 75 rows, but states 74"),
        ("plain.obj", b"\nf 1 ", b"\n3 1 ", "a line that begins with a number"),
        *((name, b"0", b"\0", "zero bytes") for name in ("plain.obj", "ascii.ply", "text.off")),
        # its bytes differ from run to run, and so would its name
        pytest.param("whole.3mf", FILES["whole.3mf"][80:90], b"\xff" * 10, "is damaged", id="3mf"),
        *(
            (name, FILES[name], b"I am not a mesh\n" * 9, "endsolid|header|no faces|cannot be read")
            for name in ("ascii.stl", "little.ply", "plain.obj", "whole.glb")
        ),
    ],
)
def test_damaged_files_are_refused(write, name, old, new, match):
    assert old in FILES[name]
    refused(write(name, FILES[name].replace(old, new, 1)), match)


@pytest.mark.parametrize(("share", "at"), [(0.1, 0.2), (0.01, 0.8)])
@pytest.mark.parametrize("kind", ["stl", "ply", "glb"])
def test_a_mesh_with_a_block_of_zeros_is_refused(tmp_path, kind, at, share):
    """Its header is whole, and the counts are right; of a .glb, the vertices."""
    content = uneven().export(file_type=kind)
    first = round(at * len(content)) if kind != "glb" else content.index(b"BIN\0") + 70_000
    lost = round(share * len(content))
    (tmp_path / f"a.{kind}").write_bytes(content[:first] + bytes(lost) + content[first + lost :])
    refused(tmp_path / f"a.{kind}", "are nothing but zeros|different numbers of corners", unit="mm")


@pytest.mark.parametrize("kind", ["ply", "glb"])
def test_three_vertices_of_zeros_are_too_many(tmp_path, kind):
    """Two may be two points of a stone, and vertices of no face do not matter."""
    ball = uneven()
    for lost, is_refused in ((2, False), (3, True)):
        mesh = ball.copy()
        mesh.vertices[100 : 100 + lost] = 0
        mesh.export(tmp_path / f"a.{kind}")
        if is_refused:
            refused(tmp_path / f"a.{kind}", "3 of its vertices are nothing but zeros", unit="mm")
        else:
            read_mesh(tmp_path / f"a.{kind}", unit="mm")
    more = trimesh.Trimesh(np.vstack([ball.vertices, np.zeros((50, 3))]), ball.faces, process=False)
    more.export(tmp_path / "a.ply")
    assert read_mesh(tmp_path / "a.ply").volume == pytest.approx(ball.volume, rel=1e-6)


def test_triangles_that_rounding_shrinks_and_copies_of_the_origin_are_read(tmp_path):
    """A mesh may be in the origin, list each corner anew, and be rounded."""
    ball = uneven()
    ball.vertices -= ball.vertices[0]
    soup = trimesh.Trimesh(ball.vertices[ball.faces.ravel()], process=False)
    soup.faces = np.arange(len(soup.vertices)).reshape(-1, 3)
    rounded = trimesh.Trimesh(8 * np.round(ball.vertices / 8), ball.faces, process=False)
    for mesh in (ball, soup, rounded):
        for kind in ("ply", "stl"):
            mesh.export(tmp_path / f"a.{kind}")
            assert read_mesh(tmp_path / f"a.{kind}").extents == pytest.approx(mesh.extents)
    shrunk = (rounded.triangles == rounded.triangles[:, :1]).all(axis=(1, 2))
    assert shrunk.sum() > 100


def test_no_such_file_and_unknown_format(tmp_path, write):
    refused(tmp_path / "stone.stl", "no such file")
    refused(write("a.stl", b""), "the file is empty")
    refused(write("b.stl", b"hello"), "is cut, or no STL")
    refused(write("a.txt", b"hello"), r"not a mesh format.*\.glb")


def test_a_closed_mesh_inside_out_is_turned(tmp_path, caplog):
    caplog.set_level(NOTE)
    ball = trimesh.creation.icosphere(subdivisions=5, radius=20)
    ball.update_faces(np.arange(len(ball.faces)) > 2)  # pin-holes, as scanners leave them
    ball.apply_translation((500, 0, 0))
    ball.export(tmp_path / "right.stl")
    ball.invert()
    ball.export(tmp_path / "wrong.stl")
    right = read_mesh(tmp_path / "right.stl")
    assert "inside out" not in caplog.text
    assert read_mesh(tmp_path / "wrong.stl").volume == pytest.approx(right.volume)
    assert "inside out" in caplog.text


@pytest.mark.parametrize(("unit", "length"), [("mm", 1.0), ("m", 1000.0)])
def test_a_ply_has_numbers_at_its_vertices_in_the_files_own_unit(tmp_path, unit, length):
    mesh = stone()
    scalars = {"pressure_MPa": mesh.vertices[:, 0] ** 2, "exposure_N_per_mm": mesh.vertices[:, 1]}
    content = ply_with(mesh, scalars, unit=unit)
    rows = content.partition(b"end_header\n")[2]
    numbers = np.frombuffer(rows, "<f4", 5 * len(mesh.vertices)).reshape(-1, 5)
    expected = np.column_stack([mesh.vertices / length, *scalars.values()])
    np.testing.assert_allclose(numbers, expected, rtol=1e-6)
    (tmp_path / "tool.ply").write_bytes(content)
    again = read_mesh(tmp_path / "tool.ply", unit=unit)
    np.testing.assert_allclose(again.volume, mesh.volume, rtol=1e-5)
