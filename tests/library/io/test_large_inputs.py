"""Small files that ask for much: refused in a sentence, before the memory is filled."""

import itertools
import json
import struct
import zipfile

import numpy as np
import pytest
import trimesh
from gst.config_file import read_config_file
from gst.patches import read_patches
from gstlib.errors import ConfigError, InputError
from gstlib.gesture import read_poses
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import read_scan
from scan_files import FORMATS, write_sur


def zeros(path, name):
    """A zip file with a member of 20 MB of nothing."""
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, bytes(20_000_000))
    return path


def glb(path, change):
    """A ball, whose header is changed."""
    ball = trimesh.creation.icosphere(3).export(file_type="glb")
    end = 20 + int.from_bytes(ball[12:16], "little")
    header = json.dumps(change(json.loads(ball[20:end]))).encode()
    sizes = struct.pack("<4sIIII", b"glTF", 2, 20 + len(header) + len(ball) - end, len(header), 0)
    path.write_bytes(sizes[:16] + b"JSON" + header + ball[end:])
    return path


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


def sparse(path):
    with path.open("wb") as file:
        file.truncate(40_000_000_000)
    return path


def points(path):
    """On a grid of 60,000 lines a side, one point each."""
    at = np.arange(0, 60_000)
    np.savetxt(path, np.column_stack([at, at, 0 * at]), fmt="%d")
    return path


def false_sur(path):
    """Its stream states two gigabytes."""
    write_sur(path, np.ones((4, 4)), (1e-3, 1e-3), compressed=True)
    content = bytearray(path.read_bytes())
    at = content.rindex(b"a comment") + len(b"a comment") + 4
    content[at : at + 4] = (1 << 31).to_bytes(4, "little")
    path.write_bytes(content)
    return path


def false_sdf(path):
    """Its header announces 65,535² points."""
    FORMATS["sdf"].write(path, np.ones((4, 4)), (1e-3, 1e-3))
    content = bytearray(path.read_bytes())
    content[42:46] = struct.pack("<2H", 65_535, 65_535)
    path.write_bytes(content)
    return path


def nested(path):
    path.write_text(f"a: {'[' * 5000}{']' * 5000}")
    return path


def many(path):
    rows = "".join(f"p{n},1,1,a\n" for n in range(20_000))
    path.write_text(f"patch,x_mm,y_mm,t0\n{rows}")
    return path


def long(path):
    path.write_text(f"patch,x_mm,y_mm,t0,note\n1,1,1,a,{'x' * 200_000}\n")
    return path


def laughs(path):
    lines = ["results: &a [" + ", ".join("x" * 9) + "]"]
    names = "abcdefghi"
    for before, name in itertools.pairwise(names):
        lines.append(f"k{name}: &{name} [" + ", ".join(9 * [f"*{before}"]) + "]")
    path.write_text("\n".join(lines))
    return path


def patches(path):
    return read_patches(path, size_mm=5.0, patch_size_mm=0.85)


CASES = {
    "points": (lambda folder: points(folder / "a.xyz"), read_scan),
    "3mf": (lambda folder: zeros(folder / "a.3mf", "3D/3dmodel.model"), read_mesh),
    "plux": (lambda folder: zeros(folder / "a.plux", "LAYER_0.raw"), read_scan),
    "sur": (lambda folder: false_sur(folder / "a.sur"), read_scan),
    "sdf": (lambda folder: false_sdf(folder / "a.sdf"), read_scan),
    "repeated": (lambda folder: glb(folder / "a.glb", repeated), read_mesh),
    "empty": (lambda folder: glb(folder / "a.glb", empty), read_mesh),
    "mesh": (lambda folder: sparse(folder / "a.stl"), read_mesh),
    "scan": (lambda folder: sparse(folder / "a.plu"), read_scan),
    "table": (lambda folder: sparse(folder / "a.tsv"), patches),
    "poses": (lambda folder: sparse(folder / "a.csv"), lambda path: read_poses(path, size_mm=5.0)),
    "config": (lambda folder: sparse(folder / "a.yaml"), read_config_file),
    "rows": (lambda folder: many(folder / "a.csv"), patches),
    "line": (lambda folder: long(folder / "a.csv"), patches),
    "nested": (lambda folder: nested(folder / "a.yaml"), read_config_file),
    "aliases": (lambda folder: laughs(folder / "a.yaml"), read_config_file),
}


@pytest.mark.parametrize("case", CASES)
def test_what_asks_for_much_is_refused(tmp_path, case):
    make, read = CASES[case]
    path = make(tmp_path)
    with pytest.raises((ConfigError, InputError), match=path.name) as refused:
        read(path)
    assert "\n" not in str(refused.value)


def test_a_member_that_nobody_needs_is_not_unpacked(tmp_path):
    path = tmp_path / "a.x3p"
    FORMATS["x3p"].write(path, np.random.default_rng(1).random((9, 9)) * 1e-3, (1e-3, 1e-3))
    known = read_scan(path)
    zeros(path, "notes.bin")
    assert read_scan(path).equals(known)
