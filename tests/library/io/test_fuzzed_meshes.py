"""Mesh files after any accident: what is read is what they say, or they are refused.

What `read_mesh` accepts is held against readers of the fuzz's own, written row by row. A few dozen
cases a file here, always the same ones. For many, and other ones each time:

    GST_FUZZ_EXAMPLES=2000 python -m pytest -s tests/library/io/test_fuzzed_meshes.py

which prints, for each file, the cases, how many were refused, and the most memory and time of one.
"""

import io
import itertools
import os
import re
import struct
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, note, settings
from hypothesis import strategies as st
from mesh_samples import FILES, MEMORY_FLOOR, MEMORY_SHARE, outcome_and_memory

from gstlib.errors import InputError
from gstlib.io.meshes import read_mesh
from gstlib.preprocess.frame import Frame
from gstlib.preprocess.gridding import grid_both_ways

MANY = "GST_FUZZ_EXAMPLES" in os.environ
EXAMPLES = int(os.environ.get("GST_FUZZ_EXAMPLES", "60"))

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
        max_examples=EXAMPLES,
        derandomize=not MANY,
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
