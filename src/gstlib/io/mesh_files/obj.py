"""OBJ: lines that the format has, and faces of vertices that are there."""

import itertools
import re
from pathlib import Path

import numpy as np

from gstlib.errors import InputError
from gstlib.io.mesh_files.plain import EXPORT_AGAIN, NUMBER, PlainMesh, quote, unix

__all__ = ["obj_vertices", "plain_obj"]

_VERTEX = re.compile(rb"v((?:\s++" + NUMBER + rb"){3})(?:\s++" + NUMBER + rb")*+")
_FACE = re.compile(rb"f(?:\s++[-+]?[0-9]{1,15}+(?:/[-+]?[0-9]*+){0,2}){3,1000}")
# Everything else that the format has: texture and normals, names, materials, curves.
_OTHER = frozenset(
    b"vt vn vp p l g o s mg mtllib usemtl usemap maplib deg bmat step cstype curv curv2 surf parm "
    b"trim hole scrv sp end con bevel c_interp d_interp lod shadow_obj trace_obj ctech stech "
    b"call csh".split()
)


def _shape(path: Path, content: bytes) -> tuple[list[bytes], list[tuple[int, ...]]]:
    """Coordinates of each vertex, as text, and vertices, from 1 on, of each face."""
    vertices, faces = [], []
    # A backslash at its end joins a line to the next one.
    lines = unix(content).replace(b"\\\n", b" ").split(b"\n")
    for number, line in enumerate(lines, 1):
        line = line.split(b"#", 1)[0].strip()
        if vertex := _VERTEX.fullmatch(line):
            vertices.append(vertex[1])
        elif _FACE.fullmatch(line):
            corners = [int(word.split(b"/")[0]) for word in line.split()[1:]]
            # A negative one counts back from the vertices given so far.
            faces.append(tuple(c if c > 0 else len(vertices) + 1 + c for c in corners))
            if 0 in corners or min(faces[-1]) < 1:
                raise InputError(
                    path, f"line {number}, {quote(line)}, has no such vertex", EXPORT_AGAIN
                )
        elif line and line.split()[0] not in _OTHER:
            raise InputError(path, f"line {number}, {quote(line)}, is damaged", EXPORT_AGAIN)
    return vertices, faces


def plain_obj(path: Path, content: bytes) -> PlainMesh:
    """Lines that OBJ has; faces of vertices that are there, cut into triangles."""
    vertices, faces = _shape(path, content)
    highest = max(map(max, faces), default=0)
    if highest > len(vertices):
        raise InputError(path, f"a face has vertex {highest} of {len(vertices)}", EXPORT_AGAIN)
    lines = bytearray()
    for vertex in vertices:
        lines += b"v %b\n" % b" ".join(vertex.split())
    triangles = 0
    for corners in faces:
        for second, third in itertools.pairwise(corners[1:]):
            lines += b"f %d %d %d\n" % (corners[0], second, third)
            triangles += 1
    return PlainMesh(bytes(lines), triangles)


def obj_vertices(path: Path, content: bytes) -> np.ndarray:
    """Vertices (n, 3) of an OBJ, whatever its faces are."""
    vertices, _ = _shape(path, content)
    return np.array([vertex.split() for vertex in vertices], dtype=float).reshape(-1, 3)
