"""Text files of numbers: their encoding, header and separators."""

import re
from pathlib import Path

from gstlib.errors import InputError

__all__ = [
    "cells_of",
    "mentioned_units",
    "number",
    "read_text",
    "separator_of",
    "split_header",
]

# Cells, in lower case, that stand for an unmeasured point.
_UNMEASURED = {"", "nan", "bad", "---"}

# A header of an instrument has a few dozen short lines. SurfaceTopography looks for its keywords
# with regular expressions, which can take for ever on lines of any length.
_LONGEST_HEADER, _LONGEST_HEADER_LINE = 200, 1000


def read_text(path: Path) -> str:
    """The file's text: UTF-8 or UTF-16 with its mark, else Latin-1, which any bytes are."""
    content = path.read_bytes()
    if b"\0" in content[:1000] and not content.startswith((b"\xff\xfe", b"\xfe\xff")):
        raise InputError(path, "is no text, though its name says so", "Correct its ending.")
    for encoding in ("utf-8-sig", "utf-16"):
        try:
            return content.decode(encoding)
        except UnicodeError:
            continue
    return content.decode("latin-1")


def separator_of(line: str) -> str | None:
    """Separator of a line's cells, None for blanks.

    >>> [separator_of(line) for line in ("1,5; 2", "1,5\\t2", "1, 2", "1 2")]
    [';', '\\t', ',', None]
    """
    return next((mark for mark in ";\t," if mark in line), None)


def cells_of(line: str, mark: str | None) -> list[str]:
    """The cells of a line; a comma that cannot separate them is a decimal sign.

    >>> cells_of("1,5;2", ";"), cells_of("1.5, 2", ","), cells_of("1.5 2 ", None)
    (['1.5', '2'], ['1.5', ' 2'], ['1.5', '2'])
    """
    if mark in (";", "\t"):
        line = line.replace(",", ".")
    return line.strip(" \r\n").split(mark)


def number(cell: str) -> float:
    """The number in a cell, NaN where it stands for an unmeasured point; ValueError for text.

    >>> number(" -1e-3"), number("BAD")
    (-0.001, nan)
    """
    cell = cell.strip()
    if cell.lower() in _UNMEASURED:
        return float("nan")
    if "_" in cell:  # which Python allows within numbers
        raise ValueError(cell)
    return float(cell)


def split_header(path: Path, text: str) -> tuple[list[str], list[tuple[int, str]]]:
    """The lines before the first row of the matrix, and the rest as (line number, line).

    A row has two cells at least. The header ends before the first row with a number, or before the
    rows right above it that have as many cells, none of them measured. Lines without content and
    comments (``#``) are left out of the rest.

    Raises
    ------
    InputError
        A line of the header is too long for one, or one too many; or the first row is empty under
        a header of as many cells, which it may belong to.
    """
    lines = [(n, line) for n, line in enumerate(text.splitlines(), start=1) if line.strip(" ")]
    first = next((n for n, (_, line) in enumerate(lines) if _has_numbers(line)), len(lines))
    shape = _shape(lines[first][1]) if first < len(lines) else None
    for above in reversed(range(first)):
        line = lines[above][1]
        if _shape(line) == shape and _is_unmeasured(line):
            first = above
        elif not _is_comment(line):
            break
    header = [(n, line) for n, line in lines[:first] if line.strip()]
    for place, (n, line) in enumerate(header):
        if place >= _LONGEST_HEADER or len(line) > _LONGEST_HEADER_LINE:
            raise InputError(
                path,
                f"line {n} is no row of numbers: {line[:60]!r}",
                "Export the heights as text, one row of the map a line.",
            )
    # a line of nothing but tabs is a row where tabs separate the cells
    rows = [
        (n, line)
        for n, line in lines[first:]
        if not _is_comment(line) and (line.strip() or shape[0] == "\t")
    ]
    if rows and header and _shape(header[-1][1]) == shape and _is_spacer(rows[0][1]):
        raise InputError(
            path,
            f"line {rows[0][0]} has no number and may be the end of the header, or a row of "
            "unmeasured points",
            "Delete it in the one case; in the other, write NaN into its cells.",
        )
    return [line for _, line in header], rows


def _cells(line: str) -> list[str]:
    return [cell.strip().lower() for cell in cells_of(line, separator_of(line))]


def _shape(line: str) -> tuple[str | None, int]:
    return separator_of(line), len(_cells(line))


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith("#")


def _is_unmeasured(line: str) -> bool:
    return _UNMEASURED.issuperset(_cells(line))


def _is_spacer(line: str) -> bool:
    # spreadsheets write the blank line under a header as one of empty cells
    return {"", "---"}.issuperset(_cells(line))


def _has_numbers(line: str) -> bool:
    cells = _cells(line)
    try:
        # the first cells are enough to tell a header from a row with a word in it, which is damaged
        for cell in cells[:20]:
            number(cell)
    except ValueError:
        return False
    return len(cells) > 1 and not _UNMEASURED.issuperset(cells)


def mentioned_units(header: list[str]) -> set[str]:
    """Units of length that a header speaks of.

    >>> sorted(mentioned_units(["# Width: 10.00 µm", "# Value units: m", "# made by mm GmbH"]))
    ['m', 'um']
    """
    found = re.findall(r"(?:[:=(\[]\s*[-+.\deE]*\s*)(m|mm|nm|um|µm|μm)\b", "\n".join(header))
    return {unit.replace("µ", "u").replace("μ", "u") for unit in found}
