"""Files that ask for much, or are made to break their readers: read, or refused in a sentence.

Each test has a gigabyte more than there was before it, and ten seconds.
"""

import io
import json
import os
import resource
import struct
import time
import tracemalloc
from datetime import date
from pathlib import Path

import h5py
import numpy as np
import openpyxl
import pytest
from hypothesis import given, settings
from mesh_files import glb, stone
from scan_files import damaged, members_of, refused, replaced, zipped

from gst.config.patches import read_patches
from gst.config.strict_yaml import parse_yaml
from gstlib.errors import ConfigError, InputError
from gstlib.io import containers
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import read_scan
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table

BYTES, SECONDS = 10**9, 10
STATUS = Path("/proc/self/statm")  # of Linux


@pytest.fixture(autouse=True)
def _little_memory_and_time():
    before = resource.getrlimit(resource.RLIMIT_AS)
    if STATUS.is_file():
        pages = int(STATUS.read_text().split()[0])
        largest = pages * resource.getpagesize() + BYTES
        resource.setrlimit(resource.RLIMIT_AS, (largest, before[1]))
    start = time.process_time()
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)
    assert time.process_time() - start < SECONDS


def patches(path):
    return read_patches(path, size_mm=5.0, patch_size_mm=0.85)


# --- More than a file can hold ------------------------------------------------------------------


def mesh_with(more):
    """A 3MF with further members."""
    return zipped(members_of(io.BytesIO(stone().export(file_type="3mf"))) | more)


# The ball stands a thousand times in the scene.
REPEATED = (
    '[{"mesh": 0}]',
    json.dumps([{"children": list(range(1, 1001))}, *1000 * [{"mesh": 0}]]),
)
ROWS = "".join(f"p{n},1,1,a\n" for n in range(20_000))
POINTS = "".join(f"{n} {n} 0\n" for n in range(60_000))
# a face of six thousand corners, each of them at three places
FAN = "v 0 0 0\nv 9 0 0\nv 0 9 0\nf" + " 1 2 3" * 2000 + "\n"
ENTITY = b"<!DOCTYPE a [<!ENTITY b 'c'>]>"
CASES = {
    "points.xyz": (POINTS, read_scan),
    "zeros.3mf": (mesh_with({"notes.bin": bytes(20_000_000)}), read_mesh),
    "entity.3mf": (mesh_with({"a.xml": ENTITY}), read_mesh),
    "members.3mf": (mesh_with({f"{n}": b"" for n in range(2000)}), read_mesh),
    "fan.obj": (FAN, read_mesh),
    "repeated.glb": (glb(REPEATED), read_mesh),
    "rows.csv": (f"patch,x_mm,y_mm,t0\n{ROWS}", patches),
}


@pytest.mark.parametrize("name", CASES)
def test_a_file_that_asks_for_much_is_refused(write, name):
    content, read = CASES[name]
    refused(write(name, content), read=read)


@pytest.mark.parametrize(
    ("name", "read"), [("a.stl", read_mesh), ("a.plu", read_scan), ("a.tsv", patches)]
)
def test_a_file_of_forty_gigabytes_is_refused(write, name, read):
    path = write(name, "")
    os.truncate(path, 40_000_000_000)
    refused(path, read=read)


@pytest.mark.parametrize(
    ("name", "true", "false"),
    [
        ("sur, compressed", struct.pack("<2I", 1, 140), struct.pack("<2I", 1, 1 << 31)),
        ("sdf", struct.pack("<2H", 7, 5), b"\xff" * 4),
    ],
)
def test_a_scan_that_states_gigabytes_is_refused(sample, name, true, false):
    path, _ = sample(name)
    path.write_bytes(replaced(path.read_bytes(), (true, false)))
    refused(path)


def test_xml_with_too_many_elements_is_refused(write, monkeypatch):
    """Each takes a hundred times its bytes in memory."""
    monkeypatch.setattr(containers, "_MOST_IN_XML", 100)
    match = "elements and attributes, and 100 are read"
    refused(write("a.3mf", mesh_with({})), match, read_mesh)


def test_a_member_is_unpacked_no_further_than_its_header_states(write):
    content = bytearray(zipped({"a.model": bytes(40_000_000)}))
    struct.pack_into("<I", content, content.index(b"PK\1\2") + 24, 10_000)
    tracemalloc.start()
    refused(write("a.3mf", content), "is damaged", read_mesh)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10_000_000


# --- HDF5 ---------------------------------------------------------------------------------------


def external(root):
    root.create_dataset("e", (100,), "u1", external=[("/etc/hostname", 0, 100)])


def virtual(root):
    layout = h5py.VirtualLayout((100,), "f8")
    layout[:] = h5py.VirtualSource("/tmp/other.h5", "height", (100,))
    root.create_virtual_dataset("v", layout)


def huge(root):
    root.create_dataset("huge", (10**6, 10**6), "f8", chunks=(100, 100))


def long_texts(root):
    texts = root.create_dataset("a", (100_000,), h5py.string_dtype())
    texts[:10] = "x" * 500_000


def references(root):
    field = root.create_dataset("height", data=np.zeros((4, 5)))
    field.attrs["DIMENSION_LIST"] = np.array([root.ref] * 2, h5py.ref_dtype)


HDF5 = {
    "external storage": (external, "stored in other files"),
    "virtual": (virtual, "stored in other files"),
    "link": (
        lambda root: root.update(a=h5py.ExternalLink("/tmp/b.h5", "height")),
        "a link",
    ),
    "huge": (huge, "unpacks from"),
    "texts": (long_texts, "too long"),
    "references": (references, "cannot be read as HDF5"),
    "filter": (
        lambda root: root.create_dataset("f", data=np.zeros(9), scaleoffset=3),
        "filters",
    ),
    "loop": (
        lambda root: root.create_group("g").update(again=root),
        "cannot be read as HDF5",
    ),
    "many": (
        lambda root: [root.create_group(f"{n}") for n in range(3000)],
        "more than 1000",
    ),
}


@pytest.mark.parametrize("kind", HDF5)
def test_hdf5_that_leads_elsewhere_or_cannot_hold_its_arrays_is_refused(tmp_path, kind):
    fill, match = HDF5[kind]
    with h5py.File(tmp_path / "a.h5", "w") as root:
        fill(root)
    refused(tmp_path / "a.h5", match, read_dataset)


@pytest.mark.parametrize("read", [read_dataset, read_table])
def test_a_result_that_is_a_pipe_is_not_waited_for(tmp_path, read):
    os.mkfifo(tmp_path / "a.h5")
    refused(tmp_path / "a.h5", read=read)


# --- Workbooks and configs ----------------------------------------------------------------------


def workbook(path, cells):
    book = openpyxl.Workbook()
    book.active.append(["patch", "x_mm", "y_mm", "t0", "note"])
    for n in range(1, 4):
        book.active.append([n, 1.2 * n, 1.5, f"{n}_T0.plu", date(2024, 5, n)])
    for place, value in cells:
        book.active[place] = value
    book.save(path)


def test_a_damaged_workbook_is_read_or_refused_in_a_sentence(tmp_path):
    path = tmp_path / "a.xlsx"
    workbook(path, [("E4", "#N/A")])

    @settings(max_examples=40, derandomize=True, database=None, deadline=None)
    @given(damaged(path.read_bytes()))
    def check(content):
        path.write_bytes(content)
        message = "a.xlsx"
        try:
            patches(path)
        except InputError as error:
            message = str(error)
        assert path.name in message.splitlines()[0]
        assert len(message) < 10_000

    check()


def test_the_format_of_a_far_cell_is_no_cell_but_its_value_is(tmp_path):
    path = tmp_path / "a.xlsx"
    workbook(path, [("A1", "patch")])
    book = openpyxl.load_workbook(path)
    book.active["XFD1048576"].number_format = "0.00"
    book.save(path)
    assert len(patches(path)) == 3
    workbook(path, [("XFD2", "a")])
    refused(path, "beyond column", patches)


@pytest.mark.parametrize("text", ["[" * 80_000, "- " * 40_000, "a: {b: " * 9000])
def test_yaml_that_would_take_minutes_is_refused(text):
    """Time grows with the square of the depth."""
    with pytest.raises(ConfigError, match=r"a\.yaml"):
        parse_yaml(text, "a.yaml")
