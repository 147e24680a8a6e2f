"""Whole mesh files of every kind, and how much memory reading one takes."""

import itertools
import struct
import tracemalloc

import trimesh

from gstlib.errors import InputError
from gstlib.io.meshes import read_mesh

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
