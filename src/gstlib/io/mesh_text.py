"""Meshes in text (OBJ, OFF, ASCII PLY and STL), whose dialects are written as trimesh reads them.

trimesh ignores lines that it does not recognise, and takes the rows that it needs. Each row is
therefore compared with the header of the file, before trimesh reads it.
"""

import contextlib
import itertools
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from gstlib.errors import InputError

__all__ = [
    "EXPORT_AGAIN",
    "PlainText",
    "check_count",
    "plain_obj",
    "plain_off",
    "plain_ply",
    "plain_stl",
    "unit_word",
]

EXPORT_AGAIN = "Export the mesh again as triangles (binary STL or PLY)."
# Bytes of a face in an OBJ: of a thousand corners, which trimesh needs a thousand times for.
_LONGEST_FACE = 10_000
# Bytes at the beginning of a file in which a comment may contain the unit.
_HEAD = 1 << 14
_BLANKS = bytes.maketrans(b"\t\v\f\r", b"   \n")
_UTF_16 = b"\xff\xfe", b"\xfe\xff"
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


class PlainText(NamedTuple):
    """A mesh as text that trimesh reads, and the properties of the text.

    Attributes
    ----------
    content : bytes
    faces : int or None
        Number of triangles of its faces. None if the file does not state a number.
    is_ended : bool
        Whether its last line has an end, without which it may be cut.
    """

    content: bytes
    faces: int | None
    is_ended: bool


def unit_word(content: bytes) -> str:
    """The word for a unit, without a plural s, in a comment at a file's head; may be empty."""
    pattern = rb"^\s*(?:#|comment|obj_info|solid)[^\n]*?\bunits?\W+(?:are |in )?(\w+)"
    stated = re.search(pattern, content[:_HEAD], re.MULTILINE | re.IGNORECASE)
    word = stated[1] if stated else b""
    return word.decode("latin-1").lower().removesuffix("s")


def plain_obj(path: Path, content: bytes) -> PlainText:
    """The vertices and faces of an OBJ, without texture, normals, groups and materials."""
    text, is_ended = _tidied(path, content, continued=True)
    lines = re.findall(rb"^(?:[vf]\b|[-+.\d]).*", text, re.MULTILINE)
    text = re.sub(rb"/[^ \n]*", b"", b"\n".join(lines))
    for odd, problem in _ODD_IN_OBJ:
        if re.search(odd, text, re.MULTILINE):
            raise InputError(path, problem, EXPORT_AGAIN)
    # trimesh counts them from the last vertex of the file
    first_face = (b"\n" + text).find(b"\nf ")
    is_mixed = first_face < text.rfind(b"\nv ")
    if is_mixed and re.search(rb"^f .*-", text, re.MULTILINE):
        problem = (
            "counts the vertices of faces backwards, but vertices follow the faces"
        )
        raise InputError(path, problem, EXPORT_AGAIN)
    return PlainText(text + b"\n", None, is_ended)


def plain_off(path: Path, content: bytes) -> PlainText:
    """An OFF. trimesh ignores numbers of its vertices that are not coordinates."""
    text, is_ended = _tidied(path, content)
    header = re.match(rb"(?:ST)?C?N?OFF\s(\d+) (\d+)(?: \d+)?\n", text)
    if header is None:
        raise _no_header(path)
    vertices, faces = map(int, header.groups())
    rows = text[header.end() :].splitlines()
    check_count(path, len(rows), vertices + faces, "rows")
    # a face begins with the count of its corners
    counts = [row.partition(b" ")[0] for row in rows[vertices:]]
    triangles = sum(int(count) - 2 for count in counts if count.isdigit())
    return PlainText(text, triangles, is_ended)


def plain_ply(path: Path, content: bytes) -> PlainText:
    """A PLY without comments. trimesh counts the faces of a binary file."""
    header = re.match(
        rb"ply[^\S\r\n]*[\r\n](?:[^\r\n]*[\r\n])*?end_header[ \t]*(?:\r\n|\r(?!\n)|\n)",
        content,
    )
    of_faces = rb"^[ \t\r]*+element\s+face\s"
    if header is None or not re.search(of_faces, header[0], re.MULTILINE):
        raise _no_header(path)
    lines = header[0].translate(_BLANKS).split(b"\n")
    # and empty lines
    passed_over: list[list[bytes]] = [[], [b"comment"], [b"obj_info"]]
    kept = [line for line in lines if line.split()[:1] not in passed_over]
    head = b"\n".join([*kept, b""])
    body = content[header.end() :]
    _refuse_zero_bytes(path, head)
    is_text = any(line.split()[:2] == [b"format", b"ascii"] for line in kept)
    if not is_text:
        return PlainText(head + body, None, is_ended=True)
    body, is_ended = _tidied(path, body)
    rows = body.splitlines()
    elements = [*_elements(kept)]
    stated = sum(count for _, count, _ in elements)
    check_count(path, len(rows), stated, "rows")
    faces, left = 0, iter(rows)
    for name, count, is_list in elements:
        corners = [
            _corners(path, row, is_list) for row in itertools.islice(left, count)
        ]
        if name == b"face":
            faces += sum(corners) - 2 * count
    return PlainText(head + body, faces, is_ended)


def plain_stl(path: Path, content: bytes) -> PlainText:
    """An ASCII STL, without the names of its solids, which trimesh takes for its keywords."""
    text, _ = _tidied(path, content)
    last = text.rsplit(b"\n", 2)[-2]
    if not last.lower().startswith(b"endsolid"):
        raise InputError(
            path, "ends without 'endsolid': it is cut, or no STL", EXPORT_AGAIN
        )
    any_case = re.MULTILINE | re.IGNORECASE
    text = re.sub(rb"^(end)?solid\b.*", rb"\1solid", text, flags=any_case)
    return PlainText(text, text.lower().count(b"endfacet"), is_ended=True)


def _tidied(
    path: Path, content: bytes, *, continued: bool = False
) -> tuple[bytes, bool]:
    """Text with one kind of line ends and blanks, without comments and empty lines.

    Lines that end in a backslash go on if `continued`. The second result is whether the text had an
    end of its last line.
    """
    if content[:2] in _UTF_16:
        content = content.decode("utf-16", "replace").encode()
    text = content.removeprefix(b"\xef\xbb\xbf").rstrip(b"\0\x1a").translate(_BLANKS)
    _refuse_zero_bytes(path, text)
    is_ended = text.rstrip(b" ").endswith(b"\n")
    if continued:
        text = text.replace(b"\\\n", b" ")
    text = re.sub(rb" +", b" ", text) if b"  " in text else text
    text = re.sub(rb"(?:(?:^| )#.*| $|^ )", b"", text, flags=re.MULTILINE)
    text = text.strip(b" \n") + b"\n"
    text = re.sub(rb"\n\n+", b"\n", text)
    if re.search(rb"^(?:v |vertex )? ?[-+]?\d+,\d", text, re.MULTILINE | re.IGNORECASE):
        raise InputError(
            path, "has decimal commas", "Export it again, with decimal points."
        )
    return text, is_ended


def _refuse_zero_bytes(path: Path, text: bytes) -> None:
    if b"\0" in text:
        raise InputError(
            path, "is text with zero bytes in it: it is damaged", EXPORT_AGAIN
        )


def _elements(header: Sequence[bytes]) -> Iterator[tuple[bytes, int, list[bool]]]:
    """Each element of a PLY: its name, its count of rows, and which of their values are lists."""
    words = [line.split() for line in header]
    starts = [number for number, line in enumerate(words) if line[0] == b"element"]
    for start, end in itertools.pairwise([*starts, len(words)]):
        is_list = [
            line[1] == b"list" for line in words[start:end] if line[0] == b"property"
        ]
        yield words[start][1], int(words[start][2]), is_list


def _corners(path: Path, row: bytes, is_list: Sequence[bool]) -> int:
    """Length of the longest list of a PLY's row. A row that contradicts the header is refused.

    trimesh takes all lists to be as long as the first, and drops the rest.
    """
    cells = row.split()
    at = longest = 0
    with contextlib.suppress(IndexError, ValueError):
        for a_list in is_list:
            length = int(cells[at]) if a_list else 0
            longest = max(longest, length)
            at += 1 + length
        if at == len(cells):
            return longest
    problem = f"has a row that its header does not describe: {cells[:9]}"
    raise InputError(path, problem, EXPORT_AGAIN)


def check_count(path: Path, count: int, stated: int | None, what: str) -> None:
    """Refuse a file that contains another number of something than it states."""
    if stated not in (None, count):
        problem = f"has {count} {what}, but states {stated}: it is cut or damaged"
        raise InputError(path, problem, EXPORT_AGAIN)


def _no_header(path: Path) -> InputError:
    problem = f"does not begin with a header of {path.suffix[1:].upper()} that describes faces"
    return InputError(path, problem, "Correct its ending, or export it again.")
