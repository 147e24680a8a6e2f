"""Meshes: what is read is whole and in mm; what is cut or damaged is refused with its reason."""

import io
import re
import struct
from functools import partial

import numpy as np
import pytest
import scan_files
import trimesh
from mesh_files import SIZE, glb, ply, rough_ball, sheet, stone
from scan_files import members_of, zipped

from gstlib.errors import NOTE
from gstlib.io.meshes import read_mesh

PLACES = "0 0 0\n0 0 20\n0 30 0\n0 30 20\n40 0 0\n40 0 20\n40 30 0\n40 30 20\n"
SIDES = "4 0 1 3 2\n4 4 6 7 5\n4 0 4 5 1\n4 2 3 7 6\n4 0 2 6 4\n4 1 5 7 3\n"
QUADS_PLY = f"""ply
format ascii 1.0
comment before end_header
element vertex 8
property float x
property float y
property float z
element face 6
property list uchar int vertex_indices
end_header
{PLACES}{SIDES}"""
# As modelling programs write a box: names, materials, texture, corners with three numbers.
QUADS_OBJ = """# a box
mtllib box.mtl
o Box
v 0 0 0
v 0 0 20
v 0 30 0
v 0 30 20
v 40 0 0
v 40 0 20
v 40 30 0
v 40 30 20
vt 0.0 0.0
vn 0 0 1
usemtl grey
s off
g sides
f 1/1/1 2/1/1 4/1/1 3/1/1
f 5/1/1 7/1/1 8/1/1 6/1/1
f 1/1/1 5/1/1 6/1/1 2/1/1
f 3/1/1 4/1/1 8/1/1 7/1/1
f -8 -6 -2 -4
f 2// 6// 8// 4//
"""


def exported(kind, scale=1.0):
    content = stone().apply_scale(scale).export(file_type=kind)
    return content if isinstance(content, bytes) else content.encode()


FILES = {
    "binary.stl": exported("stl"),
    "ascii.stl": exported("stl_ascii"),
    "little.ply": ply(stone()),
    "big.ply": ply(stone(), ">f4"),
    "ascii.ply": QUADS_PLY.encode(),
    "plain.obj": exported("obj").rstrip() + b"\n",
    "text.off": exported("off"),
    "whole.glb": exported("glb"),
    "whole.3mf": exported("3mf"),
}
STL, OBJ, OFF, BIG = (
    FILES[name] for name in ("binary.stl", "plain.obj", "text.off", "big.ply")
)
COUNT = struct.pack("<I", 48)
INSIDE_OUT = trimesh.Trimesh(stone().vertices, stone().faces[:, ::-1])
BOTH_SIDES = stone() + INSIDE_OUT
CENTIMETRES = b"# Units: centimeters\n"
# As MeshLab writes a texture: two numbers for each corner.
TEXTURE_LIST = "\nproperty list uchar float texcoord\nend_header"
TEXTURED_PLY = QUADS_PLY.replace("\nend_header", TEXTURE_LIST)
TEXTURE = " 8 0 0 0 1 1 1 1 0\n"
DIALECTS = {
    "textured.ply": TEXTURED_PLY.replace(SIDES, SIDES.replace("\n", TEXTURE)).encode(),
    "quads.obj": QUADS_OBJ.encode(),
    "quads.off": f"OFF\n8 6 0\n{PLACES}{SIDES}".encode(),
    "bytes behind.stl": STL + b"more",
    "streamed.stl": STL.replace(COUNT, bytes(4), 1),
    "named.stl": FILES["ascii.stl"].replace(b"solid ", b"solid my endsolid vertex ", 1),
    "both sides.stl": BOTH_SIDES.export(file_type="stl"),
    "no end.obj": OBJ.rstrip(),
    "tabs.obj": OBJ.replace(b" ", b"\t"),
    "windows.obj": OBJ.replace(b"\n", b"\r\n"),
    "old Mac.obj": OBJ.replace(b"\n", b"\r"),
    "commented.obj": OBJ.replace(b"\nf ", b" # a vertex\n\n# a face\nf ", 1),
    "tabs.off": OFF.replace(b" ", b"\t").replace(b"OFF\n", b"NOFF # normals\n"),
    "bytes behind.glb": FILES["whole.glb"] + b"more",
}


refused = partial(scan_files.refused, read=read_mesh)


@pytest.mark.parametrize("name", FILES | DIALECTS)
def test_whole_files_in_all_dialects_are_read(write, name):
    mesh = read_mesh(write(name, (FILES | DIALECTS)[name]), unit="mm")
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(np.prod(SIZE), rel=1e-6)
    assert mesh.extents == pytest.approx(SIZE)


# --- Units and places ---------------------------------------------------------------------------


def test_the_parts_of_a_scene_are_put_where_it_has_them(write):
    scene = trimesh.Scene(stone())
    twice = np.diag([-2.0, 2.0, 2.0, 1.0])  # and mirrored
    twice[0, 3] = 100.0
    scene.add_geometry(stone(), transform=twice)
    mesh = read_mesh(write("two.glb", scene.export(file_type="glb")), unit="mm")
    np.testing.assert_allclose(mesh.bounds, [[-20, -30, -20], [140, 30, 20]], atol=1e-5)
    assert mesh.body_count == 2
    assert mesh.volume == pytest.approx(9 * np.prod(SIZE))


def three_mf(stated, scale=1.0):
    """The stone as a 3MF that states its unit so."""
    members = members_of(io.BytesIO(exported("3mf", scale)))
    for name, content in members.items():
        members[name] = content.replace(b' unit="millimeter"', stated)
    return zipped(members)


@pytest.mark.parametrize(
    ("content", "unit"),
    [
        (three_mf(b' unit="Inch"', 1 / 25.4), "in"),
        (three_mf(b""), "mm"),  # by the specification
    ],
)
def test_the_unit_that_a_3mf_states_holds(write, content, unit):
    path = write("a.3mf", content)
    mesh = read_mesh(path)
    assert mesh.extents == pytest.approx(SIZE, rel=1e-3)
    assert mesh.metadata["file_unit"] == unit
    refused(path, f"Set mesh_unit: {unit}", unit="cm")
    refused(write("a.3mf", three_mf(b' unit="furlong"')), "furlong")


@pytest.mark.parametrize(
    ("name", "content", "other", "match"),
    [
        ("a.obj", CENTIMETRES + exported("obj", 0.1), "mm", "is in cm by its own"),
        ("a.glb", exported("glb", 1e-3), "ft", "is in m by its specification"),
    ],
)
def test_another_unit_than_a_file_states_is_warned_of(
    write, caplog, name, content, other, match
):
    path = write(name, content)
    mesh = read_mesh(path)
    assert mesh.extents == pytest.approx(SIZE)
    assert not caplog.text
    read_mesh(path, unit=other)
    assert match in caplog.text


def test_a_wrong_unit_is_named(write):
    metres = write("metres.stl", exported("stl", 1e-3))
    refused(metres, r"0\.04 mm.*mesh_unit: m \(40 mm\)\.")
    refused(metres, "unknown mesh unit", unit="furlong")


# --- GLB ----------------------------------------------------------------------------------------


QUANTIZED = '"scene": 0,', '"extensionsRequired": ["KHR_mesh_quantization"],'
NORMALIZED = '"VEC3"', '"VEC3", "normalized": true'


def scaled(scale):
    return '{"mesh": 0}', f'{{"mesh": 0, "scale": {3 * [scale]}}}'


@pytest.mark.parametrize(
    "changes", [[scaled(0.03 / 32767)], [scaled(0.03), NORMALIZED]]
)
def test_positions_of_a_glb_are_read_as_they_are_meant(write, changes):
    mesh = read_mesh(write("a.glb", glb(QUANTIZED, *changes, number="<i2")))
    assert mesh.extents == pytest.approx([60, 60, 60], rel=1e-3)
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 30**3, rel=0.01)
    assert mesh.metadata["step_mm"] == pytest.approx(0.92e-3, rel=0.1)


MESHOPT = '{"extensions": {"EXT_meshopt_compression": {"buffer": 0}}, "buffer": 0,'


@pytest.mark.parametrize(
    ("old", "new", "match"),
    [
        ('"scene": 0', '"extensionsRequired": ["KHR_draco_mesh_compression"]', "draco"),
        ('{"buffer": 0,', MESHOPT, "EXT_meshopt"),
        ('"SCALAR"', '"SCALAR", "sparse": {"count": 10}', "sparse"),
        ('"bufferView": 0, ', "", "only an extension holds"),
        ('{"primitives"', '{"weights": [0.0, 0.5], "primitives"', "morph"),
        ('{"mesh": 0', '{"mesh": 0, "skin": 0', "skin"),
        ('{"byteLength"', '{"uri": "a.bin", "byteLength"', "a.bin"),
        ('"indices": 1', '"indices": 1, "mode": 6', "fans"),
    ],
)
def test_a_feature_of_a_glb_that_is_not_read_is_named(write, old, new, match):
    refused(write("a.glb", glb((old, new))), match)


# --- Steps of the coordinates -------------------------------------------------------------------


def moved(by, number="<f8", scale=1.0):
    """A ball whose coordinates have gone through numbers of a kind, far from the origin."""
    mesh = rough_ball(0.3)
    vertices = (mesh.vertices * scale + by).astype(number).astype(float)
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


UTM = [431_234.0, 5_412_345.0, 120.0]  # m
STEPS = {
    "utm_in_m.stl": (moved(UTM, scale=1e-3).export(file_type="stl"), "m", 500),
    "utm_in_double.ply": (ply(moved(UTM, scale=1e-3), "<f8"), "m", 0.93e-6),
    # moved back, as some programs do when they export
    "back.ply": (
        ply(moved(1e5, "<f4").apply_translation([-1e5] * 3), "<f8"),
        "mm",
        7.8e-3,
    ),
    "two_decimals.off": (
        rough_ball(0.3).export(file_type="off", digits=2).encode(),
        "mm",
        10e-3,
    ),
    "whole_numbers.glb": (
        glb(QUANTIZED, scaled(0.03), NORMALIZED, number="i1"),
        "m",
        0.236,
    ),
}


@pytest.mark.parametrize("name", STEPS)
def test_the_step_of_the_coordinates_is_told_warned_of_and_refused(write, caplog, name):
    content, unit, step_mm = STEPS[name]
    path = write(name, content)
    if step_mm > 20e-3:
        refused(path, "steps of .* (origin|digits)", unit=unit)
        return
    told_mm = read_mesh(path, unit=unit).metadata["step_mm"]
    assert told_mm == pytest.approx(step_mm, rel=0.1)
    assert ("steps of" in caplog.text) == (step_mm > 1e-3)


def test_a_grid_of_heights_is_not_rounded_to_its_spacing(write):
    def heights(x, y):
        return np.random.default_rng(1).random(x.shape)

    grid = sheet(heights, 0.5, 0.0, 20.0, jitter=0.0)
    assert read_mesh(write("a.ply", ply(grid, "<f8"))).metadata["step_mm"] < 1e-5


# --- Damage -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", FILES)
def test_cut_files_are_refused(write, name):
    """Wherever it is cut, but for an OBJ at the end of a line (see docs/reference/formats.md)."""
    content = FILES[name]
    if name.endswith("obj"):
        content = rough_ball().export(file_type="obj").encode()
    for length in {0, 1, 40, *range(100, len(content) - 20, len(content) // 9)}:
        refused(write(name, content[:length].rstrip(b"\r\n")))
    if re.match("binary|little|big|whole", name):
        refused(write(name, content[:-1]))


@pytest.mark.parametrize(
    ("name", "old", "new", "match"),
    [
        # they could mean two stones
        ("binary.stl", COUNT, struct.pack("<I", 40), "states 40 triangles"),
        ("plain.obj", b".0", b",0", "decimal commas"),
        ("plain.obj", b"\nv ", b"\nv 1 2 3 2.0\nv ", "fourth number"),
        ("plain.obj", b"\nv ", b"\nf -1 -1 -1\nv ", "backwards"),
        # trimesh reads each of these as a part of the stone, or as another one
        ("ascii.stl", b"vertex", b"vortex", "cannot be read as STL"),
        ("ascii.stl", b"endfacet", b"", "has 48 triangles, but states 47"),
        ("plain.obj", b"\nf 1 ", b"\n3 1 ", "a line that begins with a number"),
        ("ascii.ply", b"4 0 1", b"4 77 1", "a face refers to a vertex outside its 8"),
        ("ascii.ply", b"40 ", b"4 0 ", "a row that its header does not describe"),
        ("ascii.ply", b"element vertex 8", b"element vertex", "cannot be read as PLY"),
        ("text.off", b"26 48", b"26 49", "has 74 rows, but states 75"),
        (
            "little.ply",
            np.float32(-20).tobytes(),
            np.float32("nan").tobytes(),
            "are not numbers",
        ),
        # the last face, of 14 bytes, has seven corners
        (
            "big.ply",
            BIG[-14:],
            BIG[-14:-13] + b"\7" + BIG[-12:],
            "different numbers of corners",
        ),
        ("plain.obj", OBJ, b"v 0 0 0\nv 9 0 0\nv 0 9 0\n", "no faces"),
        ("ascii.stl", FILES["ascii.stl"], b"", "the file is empty"),
        ("ascii.stl", FILES["ascii.stl"], b"I am not a mesh\n", "endsolid"),
    ],
)
def test_damaged_files_are_refused(write, name, old, new, match):
    before, old, after = FILES[name].partition(old)
    assert old
    refused(write(name, before + new + after), match)


def test_no_such_file_and_unknown_format(write):
    text = write("a.txt", "hello")
    refused(text, r"not a mesh format.*\.glb")
    refused(text.with_suffix(".stl"), "no such file")


@pytest.mark.parametrize("kind", ["stl", "ply", "glb"])
def test_a_mesh_with_a_block_of_zeros_is_refused(write, kind):
    """Its header is whole, and the counts are right; of a .glb, the vertices."""
    content = rough_ball().export(file_type=kind)
    first = len(content) * 4 // 5
    if kind == "glb":
        first = content.index(b"BIN\0") + 70_000
    lost = len(content) // 100
    path = write(f"a.{kind}", content[:first] + bytes(lost) + content[first + lost :])
    refused(path, "are only zeros|different numbers of corners", unit="mm")


def test_three_vertices_of_zeros_are_too_many(write):
    """Two may be two points of a stone."""
    ball = rough_ball()
    ball.vertices[100:102] = 0
    read_mesh(write("a.ply", ply(ball)))
    ball.vertices[102] = 0
    refused(write("a.ply", ply(ball)), "3 of its vertices are only zeros")


def test_triangles_that_rounding_shrinks_are_read(write):
    """In the origin, too."""
    ball = rough_ball()
    ball.vertices -= ball.vertices[0]
    ball.vertices = 8 * np.round(ball.vertices / 8)
    assert (np.ptp(ball.triangles, axis=1) == 0).all(axis=1).sum() > 100
    assert read_mesh(write("a.ply", ply(ball))).extents == pytest.approx(ball.extents)


def test_a_closed_mesh_inside_out_is_turned(write, caplog):
    caplog.set_level(NOTE)
    ball = rough_ball().apply_translation((500, 0, 0))
    ball.faces = ball.faces[2:]  # pin-holes, as scanners leave them
    right = read_mesh(write("right.ply", ply(ball)))
    assert "inside out" not in caplog.text
    ball.invert()
    wrong = read_mesh(write("wrong.ply", ply(ball)))
    assert wrong.volume == pytest.approx(right.volume)
    assert "inside out" in caplog.text
