"""Small meshes, and their files as several programs write them."""

import struct

import numpy as np
import trimesh
from scan_files import replaced
from scipy.spatial import Delaunay

SIZE = (40.0, 30.0, 20.0)
PLY_HEADER = """ply
format binary_{order}_endian 1.0
comment TextureFile ../secret.png
element vertex {vertices}
property {number} x
property {number} y
property {number} z
property uchar red
element face {faces}
property uchar quality
property list uchar int vertex_indices
end_header
"""
# The glTF numbers of the types of values.
COMPONENTS = {"<f4": 5126, "<i2": 5122, "i1": 5120}
RADIUS_M = 0.03


def stone():
    """A box with 26 vertices and 48 triangles."""
    return trimesh.creation.box(SIZE).subdivide()


def rough_ball(roughness=0.02):
    """A ball of 5120 triangles, none of whose coordinates is a short number."""
    ball = trimesh.creation.icosphere(4, radius=20)
    noise = np.random.default_rng(1).normal(size=(len(ball.vertices), 1))
    ball.vertices *= 1 + roughness * noise
    return ball


def sheet(function, edge=0.25, low=-1.5, high=6.5, up=True, jitter=0.3):
    """An open mesh z = function(x, y) on jittered points, whose faces look up, or down."""
    axis = np.arange(low, high + edge / 2, edge)
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    is_inner = ((points > low) & (points < axis[-1])).all(axis=1)
    moves = np.random.default_rng(0).uniform(-jitter, jitter, points.shape)
    points = points + edge * moves * is_inner[:, None]
    faces = Delaunay(points).simplices  # anticlockwise
    vertices = np.c_[points, function(*points.T)]
    return trimesh.Trimesh(vertices, faces if up else faces[:, ::-1], process=False)


def ply(mesh, number="<f4"):
    """A binary PLY with properties before and after those that matter."""
    order = number[0]
    columns = [("place", number, 3), ("red", "u1")]
    vertices = np.zeros(len(mesh.vertices), columns)
    vertices["place"] = mesh.vertices
    kinds = [("quality", "u1"), ("count", "u1"), ("corners", f"{order}i4", 3)]
    faces = np.zeros(len(mesh.faces), kinds)
    faces["quality"] = 5
    faces["count"] = 3
    faces["corners"] = mesh.faces
    header = PLY_HEADER.format(
        order={"<": "little", ">": "big"}[order],
        number={"4": "float", "8": "double"}[number[-1]],
        vertices=len(vertices),
        faces=len(faces),
    )
    return header.encode() + vertices.tobytes() + faces.tobytes()


GLB_HEADER = """{
  "asset": {"version": "2.0"},
  "scene": 0,
  "scenes": [{"nodes": [0]}],
  "nodes": [{"mesh": 0}],
  "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
  "buffers": [{"byteLength": %(size)d}],
  "bufferViews": [
    {"buffer": 0, "byteLength": %(start)d, "byteStride": %(stride)d},
    {"buffer": 0, "byteOffset": %(start)d, "byteLength": %(corners)d}
  ],
  "accessors": [
    {"bufferView": 0, "componentType": %(kind)d, "count": 2562, "type": "VEC3"},
    {"bufferView": 1, "componentType": 5125, "count": 15360, "type": "SCALAR"}
  ]
}"""


def glb(*changes, number="<f4"):
    """A ball of 60 mm as a GLB, its positions as a kind of numbers, its header changed."""
    ball = trimesh.creation.icosphere(4, radius=RADIUS_M)
    places = np.asarray(ball.vertices)
    if number != "<f4":
        places = np.round(places / RADIUS_M * np.iinfo(number).max)
    rows = np.zeros((len(places), 4), number)
    rows[:, :3] = places
    corners = np.asarray(ball.faces, "<u4").tobytes()
    content = rows.tobytes() + corners
    numbers = {
        "size": len(content),
        "start": rows.nbytes,
        "stride": 4 * rows.itemsize,
        "corners": len(corners),
        "kind": COMPONENTS[number],
    }
    text = replaced(GLB_HEADER % numbers, *changes).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text
    chunks += struct.pack("<I4s", len(content), b"BIN\0") + content
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
