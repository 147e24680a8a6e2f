"""Small files that ask for much: refused in a sentence, before the memory is filled."""

import itertools
import json
import struct
import zipfile

import numpy as np
import pytest
import trimesh
from gst.config.patches import read_patches
from gst.config.poses import read_poses
from gst.config.reading import read_config_file
from gstlib.errors import ConfigError, InputError
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import read_scan
from scan_files import FORMATS, write_sur, zipped


def zeros(name):
    """A zip file with a member of 20 MB of nothing."""

    def make(path):
        with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(name, bytes(20_000_000))

    return make


def glb(change):
    """A ball, whose header is changed."""

    def make(path):
        ball = trimesh.creation.icosphere(3, radius=0.02).export(file_type="glb")  # m
        end = 20 + int.from_bytes(ball[12:16], "little")
        head = json.dumps(change(json.loads(ball[20:end]))).encode()
        sizes = struct.pack("<4sIIII", b"glTF", 2, 20 + len(head) + len(ball) - end, len(head), 0)
        path.write_bytes(sizes[:16] + b"JSON" + head + ball[end:])

    return make


def repeated(header):
    """The ball stands a thousand times in the scene."""
    nodes = [{"children": list(range(1, 1001))}, *1000 * [{"mesh": 0}]]
    return header | {"nodes": nodes, "scenes": [{"nodes": [0]}]}


def empty(header):
    """Of what it states, nothing is in the file."""
    return header | {
        "accessors": [
            {name: part[name] for name in ("componentType", "type")} | {"count": 10**9}
            for part in header["accessors"]
        ]
    }


def many(header):
    """Beside the ball, there are many parts with nothing in them."""
    nodes = [{"mesh": 0}, *10_000 * [{}]]
    return header | {"nodes": nodes, "scenes": [{"nodes": list(range(len(nodes)))}]}


def wide_3mf(path):
    """A ball with seventy megabytes of XML, which take two gigabytes of memory, and a picture."""
    trimesh.creation.icosphere(3, radius=20).export(path)
    with zipfile.ZipFile(path) as ball:
        members = {name: ball.read(name) for name in ball.namelist()}
    model = members["3D/3dmodel.model"]
    members["3D/3dmodel.model"] = model.replace(b"<vertices>", b"<vertices>" + b"<a/>" * 17_500_000)
    members["picture.png"] = np.random.default_rng(1).bytes(4_000_000)
    path.write_bytes(zipped(members))


def flat_sur(path):
    """More points than measured heights can have in so many bytes."""
    write_sur(path, np.zeros((2100, 2100)), (1e-3, 1e-3), compressed=True)
    path.write_bytes(path.read_bytes() + np.random.default_rng(1).bytes(1_000_000))


def test_a_scan_that_compresses_well_is_read(tmp_path):
    write_sur(tmp_path / "a.sur", np.zeros((300, 300)), (1e-3, 1e-3), compressed=True)
    assert read_scan(tmp_path / "a.sur").shape == (300, 300)


def fan(path):
    """A face of six thousand corners, each of them at three places."""
    path.write_text("v 0 0 0\nv 9 0 0\nv 0 9 0\nf" + " 1 2 3" * 2000 + "\n")


def sparse(path):
    with path.open("wb") as file:
        file.truncate(40_000_000_000)


def false_sur(path):
    """Its stream states two gigabytes."""
    write_sur(path, np.ones((4, 4)), (1e-3, 1e-3), compressed=True)
    content = bytearray(path.read_bytes())
    at = content.rindex(b"a comment") + len(b"a comment") + 4
    content[at : at + 4] = (1 << 31).to_bytes(4, "little")
    path.write_bytes(content)


def false_sdf(path):
    """Its header announces 65,535² points."""
    FORMATS["sdf"].write(path, np.ones((4, 4)), (1e-3, 1e-3))
    content = bytearray(path.read_bytes())
    content[42:46] = struct.pack("<2H", 65_535, 65_535)
    path.write_bytes(content)


def text(*lines):
    return lambda path: path.write_text("\n".join(lines))


def laughs():
    """Nine aliases of nine aliases of nine ..."""
    yield "a: &a [" + ", ".join("x" * 9) + "]"
    for before, name in itertools.pairwise("abcdefghi"):
        yield f"k{name}: &{name} [" + ", ".join(9 * [f"*{before}"]) + "]"


def patches(path):
    return read_patches(path, size_mm=5.0, patch_size_mm=0.85)


def poses(path):
    return read_poses(path, size_mm=5.0)


ROWS = (f"p{n},1,1,a" for n in range(20_000))
CASES = {
    # on a grid of 60,000 lines a side, one point each
    "points": (text(*(f"{n} {n} 0" for n in range(60_000))), "a.xyz", read_scan),
    "3mf": (zeros("3D/3dmodel.model"), "a.3mf", read_mesh),
    "xml": (wide_3mf, "a.3mf", read_mesh),
    "fan": (fan, "a.obj", read_mesh),
    "flat": (flat_sur, "a.sur", read_scan),
    "plux": (zeros("LAYER_0.raw"), "a.plux", read_scan),
    "sur": (false_sur, "a.sur", read_scan),
    "sdf": (false_sdf, "a.sdf", read_scan),
    "repeated": (glb(repeated), "a.glb", read_mesh),
    "empty": (glb(empty), "a.glb", read_mesh),
    "many": (glb(many), "a.glb", read_mesh),
    "mesh": (sparse, "a.stl", read_mesh),
    "scan": (sparse, "a.plu", read_scan),
    "table": (sparse, "a.tsv", patches),
    "poses": (sparse, "a.csv", poses),
    "config": (sparse, "a.yaml", read_config_file),
    "rows": (text("patch,x_mm,y_mm,t0", *ROWS), "a.csv", patches),
    "line": (text("patch,x_mm,y_mm,t0,note", f"1,1,1,a,{'x' * 200_000}"), "a.csv", patches),
    "nested": (text(f"a: {'[' * 5000}{']' * 5000}"), "a.yaml", read_config_file),
    "aliases": (text(*laughs()), "a.yaml", read_config_file),
}


@pytest.mark.parametrize("case", CASES)
def test_what_asks_for_much_is_refused(tmp_path, case):
    make, name, read = CASES[case]
    make(tmp_path / name)
    with pytest.raises((ConfigError, InputError), match=name) as refused:
        read(tmp_path / name)
    assert "\n" not in str(refused.value)


def test_a_member_that_nobody_needs_is_not_unpacked(tmp_path):
    path = tmp_path / "a.x3p"
    FORMATS["x3p"].write(path, np.random.default_rng(1).random((9, 9)) * 1e-3, (1e-3, 1e-3))
    known = read_scan(path)
    zeros("notes.bin")(path)
    assert read_scan(path).equals(known)
