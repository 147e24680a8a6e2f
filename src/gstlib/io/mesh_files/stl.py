"""STL: binary, as long as its header says, or ASCII, whole facets and nothing else."""

import re
import struct
from pathlib import Path

from gstlib.errors import InputError
from gstlib.io.mesh_files.plain import EXPORT_AGAIN, NUMBER, PlainMesh, quote, unix

__all__ = ["plain_stl"]

_HEADER, _FACE = 84, 50  # bytes
_VERTEX = rb"vertex(?:[ \t]++" + NUMBER + rb"){3}[ \t]*+\n\s*+"
_FACET = re.compile(
    # Normals are not used: some programs write those of slivers as 1.#QNAN.
    rb"facet\s++normal(?:\s++\S++){3}\s++outer\s*+loop\s++"
    rb"(?:" + _VERTEX + rb"){3}end\s*+loop\s++end\s*+facet(?![^\s])",
    re.IGNORECASE,
)  # fmt: skip
_SOLID = re.compile(rb"^[ \t]*+(?:end)?solid(?![^\s])[^\n]*+$", re.IGNORECASE | re.MULTILINE)


def plain_stl(path: Path, content: bytes) -> PlainMesh:
    """Binary: as long as its header says. ASCII: facets, whole ones, and nothing else."""
    size = len(content)
    promised = struct.unpack_from("<I", content, 80)[0] if size >= _HEADER else 0
    whole = _HEADER + _FACE * promised
    if size >= _HEADER and size == whole:
        return PlainMesh(content, promised)
    # Some binary files begin with "solid" too, but no text has zero bytes.
    if content[:1024].lstrip().lower().startswith(b"solid") and b"\0" not in content:
        return _plain_ascii_stl(path, unix(content))
    if size < _HEADER:
        problem = f"{size} bytes are less than an STL header: the file is truncated or not an STL"
    else:
        problem = (
            f"its header announces {promised} faces, which take {whole} bytes, but the file has "
            f"{size}: it is {'truncated' if size < whole else 'damaged'} or not an STL"
        )
    raise InputError(path, problem, EXPORT_AGAIN)


def _plain_ascii_stl(path: Path, text: bytes) -> PlainMesh:
    last = text[-1024:].rstrip().rsplit(b"\n", 1)[-1]
    if not last.lstrip().lower().startswith(b"endsolid"):
        raise InputError(path, "the ASCII STL ends without 'endsolid': it is cut", EXPORT_AGAIN)
    # A file may have several solids, under any names; their facets are one mesh.
    facets = _SOLID.sub(b"", text)
    rest, found = _FACET.subn(b"", facets)
    if rest.strip():
        raise InputError(
            path,
            f"the ASCII STL is damaged: {quote(rest.strip())} is no part of a facet",
            EXPORT_AGAIN,
        )
    return PlainMesh(b"solid stone\n" + facets.strip() + b"\nendsolid stone\n", found)
