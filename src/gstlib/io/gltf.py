"""Conditions under which a GLB contains the positions of the stone.

trimesh reads positions and nodes. It ignores compressed, sparse and normalised numbers, and
features that move vertices in other ways. The stone would have another shape or size. Such a file
is refused, and the message names the feature.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from gstlib.errors import InputError
from gstlib.io.files import megabytes

__all__ = ["checked_header", "position_accessors"]

# A stone is one part. trimesh takes a quarter of a millisecond for each part.
MOST_PARTS = 10_000
# Bytes of a header, and lists and objects in it. The header of a stone has some thousands, and ten
# times as many with pictures.
_LONGEST_HEADER, _MOST_LISTS = 1 << 24, 200_000
# Extensions that a file may require and that change no position, by how their names begin.
_HARMLESS = (
    *("KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_"),
    *("KHR_xmp", "KHR_mesh_quantization"),
)
_MESHOPT = "EXT_meshopt_compression", "KHR_meshopt_compression"
# Modes of a primitive. Lower modes are points and lines, without faces; the higher one is fans.
_TRIANGLES, _STRIP = 4, 5
_PLAIN = "Export it again without compression and extensions, or as binary PLY."

_Header = Mapping[str, Any]


def checked_header(path: Path, content: bytes) -> _Header:
    """The header of a GLB.

    Raises
    ------
    InputError
        It uses a feature that is not read here: an extension, compressed or sparse positions, fans
        of triangles, or another way to move vertices.
    ValueError
        It has very many parts, or more vertices and faces than the file has bytes.
    """
    if content[:4] != b"glTF":
        raise ValueError("it does not begin with glTF")
    text = content[20 : 20 + int.from_bytes(content[12:16], "little")]
    lists = text.count(b"[") + text.count(b"{")
    if len(text) > _LONGEST_HEADER or lists > _MOST_LISTS:
        raise ValueError(f"its header has {megabytes(len(text))} MB")
    header: _Header = json.loads(text)
    if (count := len(header.get("nodes", ()))) > MOST_PARTS:
        raise ValueError(f"it has {count} parts, and a stone is one")
    # by the specification, numbers that are not in the file are zeros
    counts = [part["count"] for part in header.get("accessors", ())]
    if sum(counts) > len(content):
        raise ValueError("it declares more numbers than it contains")
    for feature in _not_read(header):
        raise InputError(path, f"uses {feature}: its changes are not read", _PLAIN)
    return header


def position_accessors(header: _Header) -> list[_Header]:
    """How the positions of each part are stored, in the order in which trimesh reads the parts."""
    accessors = header["accessors"]
    return [accessors[part["attributes"]["POSITION"]] for part in _primitives(header)]


def _primitives(header: _Header) -> Iterator[_Header]:
    for mesh in header.get("meshes", ()):
        yield from mesh["primitives"]


def _not_read(header: _Header) -> Iterator[str]:
    """The features of a file that would be read wrongly."""
    for name in header.get("extensionsRequired", ()):
        if not name.startswith(_HARMLESS):
            yield f"the extension {name}"
    for buffer in header.get("buffers", ()):
        if not buffer.get("uri", "data:").startswith("data:"):
            yield f"data in another file ({buffer['uri']})"
    yield from _moved_otherwise(header)
    for part in _primitives(header):
        if (mode := part.get("mode", _TRIANGLES)) > _STRIP:
            yield "fans of triangles"
        if mode >= _TRIANGLES:
            yield from _numbers_not_read(header, part)


def _moved_otherwise(header: _Header) -> Iterator[str]:
    """Features that move vertices, except the positions of the nodes."""
    for node in header.get("nodes", ()):
        if "skin" in node:
            yield "a skin that bends the mesh"
        if "EXT_mesh_gpu_instancing" in node.get("extensions", ()):
            yield "the extension EXT_mesh_gpu_instancing"
    holders = *header.get("meshes", ()), *header.get("nodes", ())
    for holder in holders:
        if any(holder.get("weights", ())):
            yield "morph targets that move the vertices"


def _numbers_not_read(header: _Header, part: _Header) -> Iterator[str]:
    """The numbers of a part's positions and corners that trimesh would read wrongly."""
    used = {
        "positions": part["attributes"]["POSITION"],
        "triangles": part.get("indices"),
    }
    for what, number in used.items():
        if number is None:
            continue
        accessor = header["accessors"][number]
        if "sparse" in accessor:
            yield f"sparse {what}"
        if "bufferView" not in accessor:
            compressed = " and ".join(part.get("extensions", ())) or "an extension"
            yield f"{what} that only {compressed} holds"
        else:
            view = header["bufferViews"][accessor["bufferView"]]
            yield from (
                f"the extension {name}"
                for name in view.get("extensions", ())
                if name in _MESHOPT
            )
