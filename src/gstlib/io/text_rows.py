"""The rows of a table of numbers in text, whoever wrote it, and its cells.

NumPy reads the cells, and strictly: a row of another length, or a word among the numbers, is a
damaged file.
"""

import itertools
import logging
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gstlib.io.files import UnreadableError

__all__ = [
    "FORMULA_ERROR",
    "NUMBER",
    "UNMEASURED_CELLS",
    "Table",
    "read_table",
    "refuse_odd_decimals",
    "separator_of",
]

_log = logging.getLogger(__name__)

# A cell whose formula failed, as spreadsheets in several languages write it. No comment begins so.
FORMULA_ERROR = re.compile(r"#(N/?[A-Z]|[^\sa-z,;]{2,}[!?])(?![^\s,;\"])")
# Cells that mark an unmeasured point, except empty ones and NaN, as written by instruments,
# ConfoMap (*****), compilers (1.#QNAN), libraries and spreadsheets.
_UNMEASURED = re.compile(
    r"(?<![^\s,;])(?:"
    r"(?i:bad|-{2,}|\*+|[-+]?nan(?:\(\w*\))?|[-+]?\d\.#\w+|n/?a|null|none|masked|no ?data)"
    rf"|{FORMULA_ERROR.pattern})(?![^\s,;])"
)
_SPECIAL = re.compile(r"[^0-9\s.,;eE+-]|--")
NUMBER = r"[-+]?(?:\d++[.,]?\d*|[.,]\d+)(?:[eE][-+]?\d+)?"
_CELL = re.compile(rf"\s*(?:{NUMBER}|nan|[-+]?inf|)\s*", re.ASCII | re.IGNORECASE)
# Lines that are inspected to find the layout of a file.
_SAMPLED = 200
# Numbers of a column of points, or of a matrix, are written with equally many decimals, or with
# many different counts. If up to this share of them differs, digits were lost or added.
_ODD_FRACTION = 1e-3
# Fewer cells do not show that each number was split at its decimal comma.
_FEWEST_SPLIT, _ALIKE, _SIGNED = 20, 0.9, 0.05

UNMEASURED_CELLS = (
    "Unmeasured points are empty cells, NaN, BAD, --- or ***. A line that begins with '#' is a "
    "comment."
)
_EXPORT = (
    "Export it again with decimal points, or with semicolons or tabs between the cells."
)


class Table(NamedTuple):
    """The lines of a text, and the numbers in its rows."""

    header: list[str]
    names: list[str]  # of the columns, if a row has them
    corner: str  # a word in the first cell, beside numbers
    rows: list[str]
    mark: str | None  # between the cells; None for blanks
    numbers: np.ndarray  # (rows, columns), NaN where unmeasured
    is_split: bool  # into blocks
    is_ended: bool  # in its last line


def separator_of(line: str) -> str | None:
    """Separator of a line's cells, None for blanks.

    >>> [separator_of(line) for line in ("1,5; 2", "1,5\\t2", "1, 2", "1 2")]
    [';', '\\t', ',', None]
    """
    return next((mark for mark in ";\t," if mark in line), None)


def _text_of(path: Path) -> str:
    """The text of a file, in which each unmeasured cell is nan and each number is plain."""
    content = path.read_bytes()
    is_utf_16 = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    try:
        text = content.decode("utf-16" if is_utf_16 else "utf-8-sig")
    except UnicodeError:
        text = content.decode("latin-1")
    if "\0" in text:
        raise UnreadableError(
            "is not text, although its ending suggests it", "Correct its ending."
        )
    if '"' in text:
        text = re.sub(r'"([^",;\t\n]*)"', r"\1", text)
    if _SPECIAL.search(text):
        text = _UNMEASURED.sub("nan", text.replace("−", "-"))
        text = re.sub(r"(?<=\d)[dD](?=[-+]\d)", "e", text)  # of Fortran
    return text


def read_table(path: Path) -> Table:
    """The lines of a table of numbers."""
    text = _text_of(path)
    lines = [line.strip(" ") for line in text.splitlines()]
    mark, count = _layout(lines)

    def is_full(line: str) -> bool:
        return len(line.split(mark)) == count

    def is_row(line: str) -> bool:
        """Not a comment, unless its first cell is a number that had no room (####)."""
        is_number = line.startswith("##") and is_full(line)
        is_blank = not (line if mark else line.strip())
        return not is_blank and (is_number or not line.startswith("#"))

    top = next(n for n, line in enumerate(lines) if is_full(line) and is_row(line))
    names = _names_in(top, lines[top].split(mark))
    first = top + bool(names)
    numbers = [n for n in range(first, len(lines)) if is_row(lines[n])]
    rows = [lines[n] for n in numbers]
    _refuse_numbers_above(lines[:top], count)
    if mark == ",":
        _refuse_split_numbers(rows)
    if mark and all(row.endswith(mark) for row in rows):  # which adds one empty cell
        rows = [row[:-1] for row in rows]
    cell, *others = rows[0].split(mark)
    corner = ""
    if not _CELL.fullmatch(cell) and all(map(_CELL.fullmatch, others)):
        corner = cell.strip()
        rows[0] = (mark or " ").join(["nan", *others])
    return Table(
        header=lines[:first],
        names=names[: len(others) + 1],
        corner=corner,
        rows=rows,
        mark=mark,
        numbers=_numbers(path, rows, mark, first + 1),
        is_split=len({*np.diff(numbers)}) > 1,
        is_ended=text.endswith(("\n", "\r")),
    )


def _layout(lines: Sequence[str]) -> tuple[str | None, int]:
    """The separator of the cells in most rows of numbers, and the number of these cells."""
    filled = [line for line in lines if line]
    votes: Counter[tuple[str | None, int]] = Counter()
    for line in filled[:: max(1, len(filled) // _SAMPLED)]:
        mark = separator_of(line)
        has_decimal_commas = re.search(r"\d,\d+\s+[-+\d]", line) and not re.search(
            r",\s", line
        )
        if mark == "," and has_decimal_commas:
            mark = None  # blanks, between numbers
        cells = line.split(mark)
        if len(cells) > 1 and all(map(_CELL.fullmatch, cells[:20])):
            votes[mark, len(cells)] += 1
    if not votes:
        middle = filled[len(filled) // 2] if filled else ""
        raise UnreadableError(
            f"does not have a row of numbers. In its middle, a line begins {middle!r:.40}",
            "Export the whole topography as text, with no mark between thousands.",
        )
    return votes.most_common(1)[0][0]


def _names_in(line: int, cells: Sequence[str]) -> list[str]:
    """The names of columns, if the cells of a row are words. The first cell may be empty."""
    words = [cell.strip() for cell in cells]
    others = [*filter(None, words[1:])]
    if not others or any(map(_CELL.fullmatch, others)):
        return []
    word, count = Counter(others).most_common(1)[0]
    if count > 1:  # what stands in place of numbers
        raise UnreadableError(
            f"line {line + 1} has {word!r:.20} in {count} cells, in place of numbers",
            UNMEASURED_CELLS,
        )
    return words


def _refuse_numbers_above(lines: Iterable[str], count: int) -> None:
    """Refuse a line of numbers above rows of another length: a header, or truncated rows."""
    for line in lines:
        cells = line.split(separator_of(line))
        read = [cell for cell in cells if _CELL.fullmatch(cell)]
        numbers = [cell for cell in read if re.search(r"\d", cell)]
        are_most = 2 < len(cells) < 2 * len(numbers)
        if numbers and (are_most or len(read) == len(cells)):
            raise UnreadableError(
                f"has rows of {len(cells)} and of {count} cells: it is damaged",
                "Export or copy it again, without numbers above the heights.",
            )


def _refuse_split_numbers(rows: Sequence[str]) -> None:
    """Refuse numbers with decimal commas between commas, where each is two whole numbers.

    The second ones have no sign, but many of the first do. Or they begin with zeros, or have as
    many digits each. Whole heights that look so, too, do so in all columns.
    """
    cells = [row.split(",") for row in rows[:_SAMPLED]]
    whole = [cell.strip() for row in cells for cell in row[::2]]
    parts = [cell for row in cells for cell in row[1::2]]
    if not _FEWEST_SPLIT <= len(parts) == len(whole):
        return
    unsigned = [cell.lstrip("+-") for cell in whole]
    if not all(map(str.isdecimal, parts + unsigned)):
        return
    lengths = {*map(len, parts)}
    alike = sum(len(cell) in lengths for cell in whole) / len(whole)
    padded = [any(re.match("0.", cell) for cell in each) for each in (whole, parts)]
    signs = ["-" in cell for cell in whole]
    are_decimals = padded == [False, True] or (len(lengths) == 1 and alike <= _ALIKE)
    if are_decimals or sum(signs) > _SIGNED * len(signs):
        raise UnreadableError(
            f"has commas between its cells and in its numbers, as in {rows[0]!r:.40}",
            _EXPORT,
        )


def refuse_odd_decimals(cells: Iterable[str], mark: str | None) -> None:
    """Refuse numbers that lost or gained digits, if all others have equally many."""
    decimals = re.compile(r"\.(\d+)" if mark == "," else r"[.,](\d+)")
    digits = itertools.chain.from_iterable(map(decimals.findall, cells))
    (usual, count), *others = Counter(map(len, digits)).most_common() or [(0, 0)]
    odd = sum(times for _, times in others)
    if 0 < odd <= _ODD_FRACTION * count:
        raise UnreadableError(
            f"{count} of its numbers have {usual} decimals, and {odd} others, such as "
            f"{others[-1][0]}: it is damaged",
            "Export or copy the file again. If you changed numbers, write all decimals.",
        )


def _numbers(
    path: Path, rows: Sequence[str], mark: str | None, first: int
) -> np.ndarray:
    """The cells of all rows, NaN where unmeasured. `first` is the number of the first line."""
    text = "\n".join(rows)
    if mark != ",":  # beside other separators, a comma is a decimal sign
        _mind_thousands(path, rows, mark, text)
        text = text.replace(",", ".")
    if mark:  # empty cells
        text = re.sub(f"(?<![^{mark}\n]) *(?=[{mark}\n]|\\Z)", "nan", text)
    try:
        return np.loadtxt(text.splitlines(), delimiter=mark, ndmin=2, comments=None)
    except ValueError as error:
        reason = str(error).split(";")[0]
        raise UnreadableError(
            f"from line {first} on, is not a table of numbers: {reason}",
            f"Export or copy the file again. {UNMEASURED_CELLS}",
        ) from error


def _mind_thousands(
    path: Path, rows: Sequence[str], mark: str | None, text: str
) -> None:
    """Refuse marks between thousands, and warn of decimal commas that may be such marks.

    Each number with such a mark has three digits behind it. Numbers of the same column without it
    are below a thousand.
    """
    sign = "," if "," in text else "."
    if sign == "," and "." in text:
        raise UnreadableError(
            "has numbers with commas and with points: one separates thousands", _EXPORT
        )
    digits = re.compile(rf"[1-9]\d{{0,2}}(?:\{sign}\d{{3}})+|\d+", re.ASCII)
    numbers = re.finditer(rf"\d[\d{sign}eE]*", text)
    if sign not in text or not all(digits.fullmatch(each[0]) for each in numbers):
        return
    for column in zip(*(row.split(mark) for row in rows), strict=False):
        has_sign = {sign in cell for cell in column if any(map(str.isdecimal, cell))}
        if len(has_sign) > 1:
            raise UnreadableError(
                f"has {sign!r} between thousands: some numbers of a column have it, with three "
                "digits behind it, and others have none",
                "Export it again without such marks.",
            )
    if sign == ",":
        message = (
            "%s: its commas are read as decimal signs. If they separate thousands, the heights are "
            "wrong. Then export them without"
        )
        _log.warning(message, path)
