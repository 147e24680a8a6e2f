"""PLY: as much as its header announces, with faces of one number of corners.

The header may announce anything, so it is held against the length of the file before anything is
made of it.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gstlib.errors import InputError
from gstlib.io.mesh_files.plain import AS_TRIANGLES, EXPORT_AGAIN, NUMBER, PlainMesh, quote, unix

__all__ = ["plain_ply", "ply_vertices"]

_NUMBERS = re.compile(rb"\s*+" + NUMBER + rb"(?:\s++" + NUMBER + rb")*+\s*+")
_TYPES = {
    "char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
    "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
    "int32": "i4", "uint32": "u4", "int64": "i8", "uint64": "u8", "float32": "f4",
    "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
# No header in use comes near it.
_LONGEST_HEADER, _MOST_COLUMNS, _LONGEST_LIST = 1 << 20, 200, 1000
# A whole number that a vertex may have.
_INDEX = re.compile(rb"[0-9]{1,9}+")
_END = re.compile(rb"^end_header[ \t]*+\r?\n", re.MULTILINE)
_CORNERS = ("vertex_indices", "vertex_index")


@dataclass(frozen=True)
class _Property:
    """A column of an element; a list has the type of its length too."""

    name: str
    type: str
    length_type: str | None = None


@dataclass(frozen=True)
class _Element:
    name: str
    rows: int
    properties: tuple[_Property, ...]

    @property
    def names(self) -> list[str]:
        return [column.name for column in self.properties]


@dataclass(frozen=True)
class _Ply:
    """A PLY file: what its header announces, and the bytes that follow it."""

    path: Path
    order: str
    elements: tuple[_Element, ...]
    body: bytes

    def __getitem__(self, name: str) -> _Element:
        for element in self.elements:
            if element.name == name and element.rows:
                return element
        raise InputError(self.path, f"the mesh has no {_PLURAL[name]}", AS_TRIANGLES)


_PLURAL = {"vertex": "vertices", "face": "faces"}


def _read_ply(path: Path, content: bytes) -> _Ply:
    end = _END.search(content, 0, _LONGEST_HEADER)
    if not content.startswith(b"ply") or end is None:
        raise InputError(path, "it does not begin with the header of a PLY", EXPORT_AGAIN)
    lines = content[: end.start()].decode("ascii", errors="replace").splitlines()
    order, elements = None, []
    for line in lines[1:]:
        words = line.split()
        match words:
            case [] | ["comment" | "obj_info", *_]:
                continue
            case ["format", name, "1.0"] if name in _ORDERS and order is None:
                order = _ORDERS[name]
            case ["element", name, count] if re.fullmatch(r"[0-9]{1,18}", count):
                elements.append((name, int(count), []))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1][2].append(_Property(name, _TYPES[kind]))
            case ["property", "list", length, kind, name] if (
                elements and kind in _TYPES and _TYPES.get(length, "f")[0] != "f"
            ):
                elements[-1][2].append(_Property(name, _TYPES[kind], _TYPES[length]))
            case _:
                raise InputError(
                    path, f"its header has the line {quote(line.encode())}", EXPORT_AGAIN
                )
    if order is None:
        raise InputError(path, "its header names no format", EXPORT_AGAIN)
    ply = _Ply(
        path,
        order,
        tuple(_Element(name, rows, tuple(columns)) for name, rows, columns in elements),
        content[end.end() :] if order else unix(content[end.end() :]),
    )
    if len(elements) + sum(len(columns) for *_, columns in elements) > _MOST_COLUMNS:
        raise InputError(path, "its header announces hundreds of properties", EXPORT_AGAIN)
    names = [element.name for element in ply.elements]
    for group in [names, *(element.names for element in ply.elements)]:
        if len(set(group)) < len(group):
            raise InputError(path, f"its header has a name twice among {group}", EXPORT_AGAIN)
    _check_room(ply)
    return ply


def _check_room(ply: _Ply) -> None:
    """Refuse a header that announces more than the file can hold, before anything is made of it."""
    least = 0
    for element in ply.elements:
        sizes = [int((column.length_type or column.type)[1]) for column in element.properties]
        # In a text a value takes a digit and a blank at least.
        least += element.rows * (sum(sizes) if ply.order else 2 * len(sizes))
    least -= not ply.order  # the last line may lack its end
    if least > len(ply.body):
        announced = " and ".join(f"{e.rows} × {e.name}" for e in ply.elements)
        raise InputError(
            ply.path,
            f"its header announces {announced}, which take {least} bytes or more, but "
            f"{len(ply.body)} follow it: the file is truncated or damaged",
            EXPORT_AGAIN,
        )


def plain_ply(path: Path, content: bytes) -> PlainMesh:
    """As much as the header announces, all faces with the same number of corners (3 or 4)."""
    ply = _read_ply(path, content)
    _check_columns(ply, ply["vertex"])
    face = ply["face"]
    corners = [c for c in face.properties if c.length_type and c.name in _CORNERS]
    if len(corners) != 1:
        raise InputError(
            path, f"its faces have {face.names}, not vertex_indices", "Export it again."
        )
    tables = _binary_tables(ply) if ply.order else _text_tables(ply)
    counts = tables["face"][_length_name(corners[0])]
    if not np.isin(counts, (3, 4)).all() or (ply.order and len(np.unique(counts)) > 1):
        raise InputError(
            path,
            f"its faces have {counts.min():g} to {counts.max():g} corners",
            AS_TRIANGLES,
        )
    body = ply.body if ply.order else b"\n".join(_rows(ply)) + b"\n"
    return PlainMesh(_plain_header(ply, corners[0]) + body, int((counts.astype(int) - 2).sum()))


def _check_columns(ply: _Ply, vertex: _Element) -> None:
    single = {column.name for column in vertex.properties if not column.length_type}
    if not set("xyz") <= single:
        raise InputError(
            ply.path, f"its vertices have {vertex.names}, not x, y and z", "Export it again."
        )


def _plain_header(ply: _Ply, corners: _Property) -> bytes:
    """The header with every name in it that is not of the shape made meaningless."""
    names = {order: name for name, order in _ORDERS.items()}
    types = {code: name for name, code in _TYPES.items()}
    lines = ["ply", f"format {names[ply.order]} 1.0"]
    for element in ply.elements:
        shape = {"vertex": "xyz", "face": (corners.name,)}.get(element.name, ())
        known = element.name in ("vertex", "face")
        lines.append(f"element {element.name if known else f'other{len(lines)}'} {element.rows}")
        for column in element.properties:
            length = f"list {types[column.length_type]} " if column.length_type else ""
            name = column.name if column.name in shape else f"other{len(lines)}"
            lines.append(f"property {length}{types[column.type]} {name}")
    return "\n".join([*lines, "end_header\n"]).encode("ascii")


def _length_name(column: _Property) -> str:
    return f"number of {column.name}"


def _binary_tables(ply: _Ply, last: str = "") -> dict[str, np.ndarray]:
    """The elements, up to and with `last`, as structured arrays over the file's own bytes."""
    tables, start = {}, 0
    for element in ply.elements:
        layout = _layout(ply, element, start)
        end = start + element.rows * layout.itemsize
        if end > len(ply.body):
            raise InputError(
                ply.path,
                f"it ends within '{element.name}': it is truncated, or its faces have different "
                "numbers of corners",
                AS_TRIANGLES,
            )
        if layout.itemsize:
            table = np.frombuffer(ply.body, layout, element.rows, start)
            for column in element.properties:
                counts = table[_length_name(column)] if column.length_type else np.zeros(1)
                if element.rows and (counts != counts[0]).any():
                    raise InputError(
                        ply.path,
                        f"'{column.name}' has {counts.min()} to {counts.max()} entries: its faces "
                        "have different numbers of corners, or it is damaged",
                        AS_TRIANGLES,
                    )
            tables[element.name] = table
        start = end
        if element.name == last:
            return tables
    if start != len(ply.body):
        raise InputError(
            ply.path,
            f"{len(ply.body) - start} bytes follow the last element: it is damaged, or its faces "
            "have different numbers of corners",
            AS_TRIANGLES,
        )
    return tables


def _layout(ply: _Ply, element: _Element, start: int) -> np.dtype:
    """Columns of an element that begins at byte `start`, its lists as long as in its first row."""
    fields: list[tuple] = []
    for column in element.properties:
        if column.length_type and element.rows:
            length = np.dtype(ply.order + column.length_type)
            place = start + np.dtype(fields).itemsize
            first = ply.body[place : place + length.itemsize]
            count = int(np.frombuffer(first, length)[0]) if len(first) == length.itemsize else 0
            if not 0 <= count <= _LONGEST_LIST:
                raise InputError(
                    ply.path, f"'{column.name}' begins with {count} entries", EXPORT_AGAIN
                )
            fields.append((_length_name(column), length))
            fields.append((column.name, ply.order + column.type, (count,)))
        else:
            fields.append((column.name, ply.order + column.type))
    return np.dtype(fields)


def _rows(ply: _Ply) -> list[bytes]:
    return [line for line in ply.body.split(b"\n") if line.strip()]


def _text_tables(ply: _Ply, last: str = "") -> dict[str, dict[str, np.ndarray]]:
    """Columns, single values only, of a text's elements up to and with `last`."""
    rows, tables, start = _rows(ply), {}, 0
    for element in ply.elements:
        own = rows[start : start + element.rows]
        start += element.rows
        if len(own) < element.rows:
            raise InputError(
                ply.path,
                f"it has {len(own)} of the {element.rows} rows of '{element.name}' that its header "
                "announces: it is truncated",
                EXPORT_AGAIN,
            )
        columns = [_text_row(ply, element, row) for row in own]
        names = [_length_name(c) if c.length_type else c.name for c in element.properties]
        tables[element.name] = dict(zip(names, np.array(columns).T, strict=False))
        if element.name == last:
            return tables
    if start < len(rows):
        raise InputError(
            ply.path, f"{len(rows) - start} rows follow the last element", EXPORT_AGAIN
        )
    return tables


def _text_row(ply: _Ply, element: _Element, row: bytes) -> list[float]:
    """The single values of a row, and the lengths of its lists."""
    words = row.split() if _NUMBERS.fullmatch(row) else []
    values, place = [], 0
    for column in element.properties:
        number = float(words[place]) if place < len(words) else np.nan
        values.append(number)
        place += 1
        if column.length_type:
            length = int(number) if 0 <= number <= _LONGEST_LIST else len(words)
            entries = words[place : place + length]
            if column.type[0] in "iu" and not all(map(_INDEX.fullmatch, entries)):
                place = len(words)
            place += length
    if place != len(words) or not words:
        raise InputError(
            ply.path, f"'{element.name}' has the row {quote(row.strip())}", EXPORT_AGAIN
        )
    return values


def ply_vertices(path: Path, content: bytes) -> np.ndarray:
    """Vertices (n, 3) of a PLY, whatever its faces are."""
    ply = _read_ply(path, content)
    _check_columns(ply, ply["vertex"])
    table = (_binary_tables if ply.order else _text_tables)(ply, last="vertex")["vertex"]
    return np.stack([np.asarray(table[axis], dtype=float) for axis in "xyz"], axis=1)
