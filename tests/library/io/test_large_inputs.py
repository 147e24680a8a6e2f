"""Small files that ask for much: refused in a sentence, before the memory is filled."""

import itertools
import zipfile

import numpy as np
import pytest
from gst.config_file import read_config_file
from gst.patches import read_patches
from gstlib.errors import ConfigError, InputError
from gstlib.gesture import read_poses
from gstlib.io.files import _LARGEST_UNPACKED
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import read_scan
from scan_files import FORMATS, write_sur


def zeros(path, name):
    """A zip file with a member that claims to unpack to a gigabyte."""
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, bytes(1000))
        archive.getinfo(name).file_size = 2 * _LARGEST_UNPACKED
    return path


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
    "mesh": (lambda folder: sparse(folder / "a.stl"), read_mesh),
    "scan": (lambda folder: sparse(folder / "a.plu"), read_scan),
    "table": (lambda folder: sparse(folder / "a.tsv"), patches),
    "poses": (lambda folder: sparse(folder / "a.csv"), lambda path: read_poses(path, size_mm=5.0)),
    "config": (lambda folder: sparse(folder / "a.yaml"), read_config_file),
    "aliases": (lambda folder: laughs(folder / "a.yaml"), read_config_file),
}


@pytest.mark.parametrize("case", CASES)
def test_what_asks_for_much_is_refused(tmp_path, case):
    make, read = CASES[case]
    path = make(tmp_path)
    with pytest.raises((ConfigError, InputError), match=path.name) as refused:
        read(path)
    assert "\n" not in str(refused.value)
    if case not in ("aliases", "points"):
        assert "MB" in str(refused.value)


def test_a_member_that_nobody_needs_is_not_unpacked(tmp_path):
    path = tmp_path / "a.x3p"
    FORMATS["x3p"].write(path, np.random.default_rng(1).random((9, 9)) * 1e-3, (1e-3, 1e-3))
    known = read_scan(path)
    zeros(path, "notes.bin")
    assert read_scan(path).equals(known)
