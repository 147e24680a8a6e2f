"""STL, PLY, OBJ and OFF, whose many dialects are written as trimesh reads them.

trimesh ignores lines that it does not recognise, and takes the rows that it needs. Rows are
therefore compared with the header of the file, before or after trimesh reads them.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from gstlib.io.files import UnreadableError

__all__ = [
    "EXPORT_AGAIN",
    "PLAIN",
    "PlainMesh",
    "check_count",
    "check_ply",
    "unit_word",
]

EXPORT_AGAIN = "Export the mesh again as triangles (binary STL or PLY)."
# Bytes of a face in an OBJ: of a thousand corners, which trimesh needs a thousand times for.
_LONGEST_FACE = 10_000
# Bytes at the beginning of a file in which a comment may contain the unit.
_HEAD = 1 << 14
_BLANKS = bytes.maketrans(b"\t\v\f\r", b"   \n")
_ODD_IN_OBJ = (
    (rb"^f [^\n]{%d}" % _LONGEST_FACE, "has a face of a thousand corners"),
    (rb"^f.* -?0+(?: |$)", "has a face with vertex number 0, but numbers begin with 1"),
    (
        rb"^f(?: \S+){0,2}$",
        "has a face of fewer than three corners: it is cut or damaged",
    ),
    (
        rb"^v(?: \S+){0,2}$",
        "has a vertex of fewer than three numbers: it is cut or damaged",
    ),
    (
        rb"^v(?: \S+){3} (?!1(?:\.0*)?$)\S+$",
        "has vertices with a weight other than 1 as fourth number, which is not applied here",
    ),
    (rb"^[-+.\d]", "has a line that begins with a number: it is damaged"),
)
_PLY_HEADER = re.compile(
    rb"ply[^\S\r\n]*[\r\n](?:[^\r\n]*[\r\n])*?end_header[ \t]*(?:\r\n|\r(?!\n)|\n)"
)
# Lines of a PLY's header that trimesh need not read: comments and empty ones.
_PASSED_OVER = re.compile(rb"^ *(?:(?:comment|obj_info)\b.*)?\n", re.MULTILINE)
_STL_HEADER = 84
_STL_RECORD = np.dtype(
    [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
)
# Counts in the header of an STL that was written before its program knew how many triangles follow.
_STREAMED = 0, 0xFFFFFFFF


class PlainMesh(NamedTuple):
    """A mesh as trimesh reads it, and what its file states.

    Attributes
    ----------
    content : bytes
    faces : int or None
        Number of triangles of its faces. None if the file does not state a number.
    is_ended : bool
        Whether its last line has an end, without which it may be cut.
    largest : sequence of int
        Whole number that stands for 1 in the positions of each part of a GLB; 0 if it has others.
    """

    content: bytes
    faces: int | None = None
    is_ended: bool = True
    largest: Sequence[int] = ()


def unit_word(content: bytes) -> str:
    """The word for a unit, without a plural s, in a comment at a file's head; may be empty."""
    pattern = rb"^\s*(?:#|comment|obj_info|solid)[^\n]*?\bunits?\W+(?:are |in )?(\w+)"
    stated = re.search(pattern, content[:_HEAD], re.MULTILINE | re.IGNORECASE)
    word = stated[1] if stated else b""
    return word.decode("latin-1").lower().removesuffix("s")


def _obj(content: bytes) -> PlainMesh:
    """The vertices and faces of an OBJ, without texture, normals, groups and materials."""
    text, is_ended = _tidied(content)
    lines = re.findall(rb"^(?:[vf]\b|[-+.\d]).*", text, re.MULTILINE)
    text = re.sub(rb"/[^ \n]*", b"", b"\n".join(lines))
    for odd, problem in _ODD_IN_OBJ:
        if re.search(odd, text, re.MULTILINE):
            raise UnreadableError(problem, EXPORT_AGAIN)
    # trimesh counts them from the last vertex of the file
    first_face = (b"\n" + text).find(b"\nf ")
    is_mixed = first_face < text.rfind(b"\nv ")
    if is_mixed and re.search(rb"^f .*-", text, re.MULTILINE):
        raise UnreadableError(
            "counts vertices backwards, but vertices follow the faces", EXPORT_AGAIN
        )
    return PlainMesh(text + b"\n", is_ended=is_ended)


def _off(content: bytes) -> PlainMesh:
    """An OFF. trimesh ignores numbers of its vertices that are not coordinates."""
    text, is_ended = _tidied(content)
    header = re.match(rb"(?:ST)?C?N?OFF\s(\d+) (\d+)(?: \d+)?\n", text)
    if header is None:
        raise _no_header()
    vertices, faces = map(int, header.groups())
    rows = text[header.end() :].splitlines()
    check_count(len(rows), vertices + faces, "rows")
    # a face begins with the count of its corners
    counts = [row.partition(b" ")[0] for row in rows[vertices:]]
    triangles = sum(int(count) - 2 for count in counts if count.isdigit())
    return PlainMesh(text, triangles, is_ended=is_ended)


def _ply(content: bytes) -> PlainMesh:
    """A PLY without comments. trimesh counts the faces of a binary file."""
    header = _PLY_HEADER.match(content)
    stated = header[0] if header else b""
    head = _PASSED_OVER.sub(b"", stated.translate(_BLANKS))
    if not re.search(rb"^ *element\s+face\s", head, re.MULTILINE):
        raise _no_header()
    body = content[len(stated) :]
    if not re.search(rb"^ *format +ascii", head, re.MULTILINE):
        return PlainMesh(head + body)
    text, is_ended = _tidied(body)
    rows = text.splitlines()
    head, *elements = head.split(b"element ")
    counts = [int(element.split()[1]) for element in elements]
    check_count(len(rows), sum(counts), "rows")
    parts, start = [], 0
    for element, count in zip(elements, counts, strict=True):
        own, plain = _with_corners_alone(element, rows[start : start + count])
        head += b"element " + own
        parts += plain
        start += count
    return PlainMesh(head + b"\n".join([*parts, b""]), is_ended=is_ended)


def _with_corners_alone(
    element: bytes, rows: Sequence[bytes]
) -> tuple[bytes, list[bytes]]:
    """The head and the rows of an element of a PLY in text; of faces, only the corners.

    trimesh takes all lists to be as long as the first, but a texture has two numbers for a corner.
    """
    lines = re.findall(rb"^ *property .*\n", element, re.MULTILINE)
    lists = [at for at, line in enumerate(lines) if line.split()[1] == b"list"]
    corners = next((at for at in lists if b" vertex_ind" in lines[at]), None)
    plain = []
    for row in rows:
        cells, more = row.split(), 0  # numbers in lists before this one
        for at in lists:
            start = at + more
            length = int(cells[start]) if start < len(cells) else 0
            if at == corners:
                row = b" ".join(cells[start : start + 1 + length])
            more += length
        if len(cells) != len(lines) + more:
            raise UnreadableError(
                f"has a row that its header does not describe: {cells[:9]}",
                EXPORT_AGAIN,
            )
        plain.append(row)
    for at, line in enumerate(lines):
        if corners not in (None, at):
            element = element.replace(line, b"", 1)
    return element, plain


def check_ply(elements: Mapping[str, Any]) -> None:
    """Refuse a binary PLY with lists that are not as long as the first of their property."""
    for element in elements.values():
        rows = element.get("data")
        columns = rows.dtype.names if isinstance(rows, np.ndarray) else ()
        for name in columns:
            values = rows[name]
            if values.dtype.names and (values["f0"] != values["f0"][:1]).any():
                raise UnreadableError(
                    "is damaged, or its faces have different numbers of corners",
                    EXPORT_AGAIN,
                )


def _stl(content: bytes) -> PlainMesh:
    text = content.rstrip(b"\0")
    is_text = bool(text) and b"\0" not in text
    return _text_stl(content) if is_text else _binary_stl(content)


def _text_stl(content: bytes) -> PlainMesh:
    """An ASCII STL, without the names of its solids, which trimesh takes for its keywords."""
    text, _ = _tidied(content)
    last = text.rsplit(b"\n", 2)[-2]
    if not last.lower().startswith(b"endsolid"):
        raise UnreadableError(
            "ends without 'endsolid': it is cut, or no STL", EXPORT_AGAIN
        )
    any_case = re.MULTILINE | re.IGNORECASE
    text = re.sub(rb"^(end)?solid\b.*", rb"\1solid", text, flags=any_case)
    return PlainMesh(text, text.lower().count(b"endfacet"))


def _binary_stl(content: bytes) -> PlainMesh:
    """The triangles of a binary STL, without content that some programs write behind them.

    A program that writes while it reads does not have the count yet, and leaves 0 or −1.
    """
    stated = int.from_bytes(content[80:_STL_HEADER], "little")
    count, left = divmod(len(content) - _STL_HEADER, _STL_RECORD.itemsize)
    if stated in _STREAMED and count > 0 and not left:
        stated = count
    end = _STL_HEADER + stated * _STL_RECORD.itemsize
    if len(content) < end:
        check_count(len(content), end, "bytes")
    corners = np.frombuffer(content, _STL_RECORD, count, _STL_HEADER)["corners"]
    own, more = corners[:stated], corners[stated:]
    if stated and more.any():
        lowest, highest = own.min(axis=(0, 1)), own.max(axis=(0, 1))
        are_inside = ((lowest <= more) & (more <= highest)).all(axis=(1, 2))
        if more[are_inside].any():  # not only zeros
            raise UnreadableError(
                f"states {stated} triangles, but more follow: it is damaged",
                EXPORT_AGAIN,
            )
    header = content[:80] + stated.to_bytes(4, "little")
    return PlainMesh(header + content[_STL_HEADER:end], stated)


def _tidied(content: bytes) -> tuple[bytes, bool]:
    """Text with one kind of line ends and blanks, without comments and empty lines.

    The second result is whether the text had an end of its last line.
    """
    text = content.removeprefix(b"\xef\xbb\xbf").rstrip(b"\0\x1a").translate(_BLANKS)
    if b"\0" in text:
        raise UnreadableError(
            "is text with zero bytes in it: it is damaged", EXPORT_AGAIN
        )
    is_ended = text.rstrip(b" ").endswith(b"\n")
    text = re.sub(rb"(?:^| )#.*", b"", text, flags=re.MULTILINE)
    text = re.sub(rb"  +", b" ", text)
    text = re.sub(rb" ?\n[ \n]*", b"\n", text).strip(b" \n") + b"\n"
    if re.search(rb"^(?:v |vertex )? ?[-+]?\d+,\d", text, re.MULTILINE | re.IGNORECASE):
        raise UnreadableError(
            "has decimal commas", "Export it again, with decimal points."
        )
    return text, is_ended


def check_count(count: int, stated: int | None, what: str) -> None:
    """Refuse a file that contains another number of something than it states."""
    if stated not in (None, count):
        raise UnreadableError(
            f"has {count} {what}, but states {stated}: it is cut or damaged",
            EXPORT_AGAIN,
        )


def _no_header() -> UnreadableError:
    return UnreadableError(
        "does not begin with a header of its format that describes faces",
        "Correct its ending, or export it again.",
    )


PLAIN: dict[str, Callable[[bytes], PlainMesh]] = {
    ".stl": _stl,
    ".ply": _ply,
    ".obj": _obj,
    ".off": _off,
}
