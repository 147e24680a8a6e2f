"""Conditions under which a GLB or a 3MF contains the stone.

trimesh reads positions and nodes. Of a GLB, it ignores compressed, sparse and normalised numbers,
and features that move vertices in other ways. The stone would have another shape or size. Such a
file is refused, and the message names the feature.
"""

import itertools
import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from gstlib.io.files import UnreadableError, megabytes
from gstlib.io.plain_meshes import PlainMesh

__all__ = ["plain_3mf", "plain_glb"]

# A stone is one part. trimesh takes a quarter of a millisecond for each part.
_MOST_PARTS = 10_000
# Bytes of a header, and lists and objects in it. The header of a stone has some thousands, and ten
# times as many with pictures.
_LONGEST_HEADER, _MOST_LISTS = 1 << 24, 200_000
# Bytes before the header of a GLB.
_START = 20
# Extensions that a file may require and that change no position, by how their names begin.
_HARMLESS = (
    *("KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_"),
    *("KHR_xmp", "KHR_mesh_quantization"),
)
# Keys of features that are not applied here: they bend, copy or compress a mesh.
_NOT_APPLIED = (
    *("skin", "sparse", "EXT_mesh_gpu_instancing"),
    *("EXT_meshopt_compression", "KHR_meshopt_compression"),
)
# Mode of strips of triangles. Lower modes are points, lines and triangles; the higher one is fans.
_STRIP = 5
_PLAIN = "Export it again without compression and extensions, or as binary PLY."
# Types of whole numbers in a GLB.
_WHOLE_NUMBERS = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2"}

_Header = Mapping[str, Any]


def plain_glb(content: bytes) -> PlainMesh:
    """A GLB without content behind it, and the units of whole numbers in it.

    Raises
    ------
    InputError
        It uses a feature that is not read here: an extension, compressed or sparse positions, fans
        of triangles, or another way to move vertices.
    ValueError
        It has very many parts.
    """
    length = int.from_bytes(content[8:12], "little")
    content = content[: max(length, _START)]
    header = _checked_header(content)
    parts = itertools.chain.from_iterable(
        mesh["primitives"] for mesh in header.get("meshes", ())
    )
    positions = [part["attributes"]["POSITION"] for part in parts]
    largest = [_largest(header["accessors"][number]) for number in positions]
    return PlainMesh(content, largest=largest)


def _largest(accessor: _Header) -> int:
    """The whole number that stands for 1, as in a quantised GLB; 0 for other numbers."""
    if (kind := accessor["componentType"]) not in _WHOLE_NUMBERS:
        return 0
    return np.iinfo(_WHOLE_NUMBERS[kind]).max if accessor.get("normalized") else 1


def plain_3mf(content: bytes) -> PlainMesh:
    """A 3MF, of the content of `gstlib.io.containers.plain_zip`.

    Raises
    ------
    ValueError
        It has very many parts.
    """
    _check_parts(content.count(b"<item"))
    return PlainMesh(content)


def _check_parts(count: int) -> None:
    if count > _MOST_PARTS:
        raise ValueError(f"it has {count} parts, and a stone is one")


def _checked_header(content: bytes) -> _Header:
    """The header of a GLB whose features are all read."""
    if content[:4] != b"glTF":
        raise ValueError("it does not begin with glTF")
    text = content[_START : _START + int.from_bytes(content[12:16], "little")]
    lists = text.count(b"[") + text.count(b"{")
    if len(text) > _LONGEST_HEADER or lists > _MOST_LISTS:
        raise ValueError(f"its header has {megabytes(len(text))} MB")
    header: _Header = json.loads(text)
    _check_parts(len(header.get("nodes", ())))
    for feature in _not_read(header):
        raise UnreadableError(f"uses {feature}: its changes are not read", _PLAIN)
    return header


def _not_read(header: _Header) -> Iterator[str]:
    """The features of a file that would be read wrongly."""
    required = header.get("extensionsRequired", ())
    yield from (
        f"the extension {name}" for name in required if not name.startswith(_HARMLESS)
    )
    for buffer in header.get("buffers", ()):
        if not buffer.get("uri", "data:").startswith("data:"):
            yield f"data in another file ({buffer['uri']})"
    # by the specification, they are zeros
    if any("bufferView" not in each for each in header.get("accessors", ())):
        yield "numbers that only an extension holds"
    for key, value in _entries(header):
        if key in _NOT_APPLIED:
            yield f"the feature {key}"
        if key == "weights" and any(value):
            yield "morph targets that move the vertices"
        if key == "mode" and value > _STRIP:
            yield "fans of triangles"


def _entries(node: Any) -> Iterator[tuple[str, Any]]:
    """Each key in a header, at any depth, with its value."""
    if isinstance(node, dict):
        yield from node.items()
        node = [*node.values()]
    if isinstance(node, list):
        for each in node:
            yield from _entries(each)
