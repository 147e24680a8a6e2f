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
    """The lines before the first row of numbers, and the rest as (line number, line).

    A row of numbers has two cells at least, and at least one number. Lines without content and
    comments (``#``) are left out of the rest.
    """
    header, rows = [], []
    for count, line in enumerate(text.splitlines(), start=1):
        if not line.strip():
            continue
        if not rows and not _has_numbers(line):
            header.append(line)
            if len(header) > _LONGEST_HEADER or len(line) > _LONGEST_HEADER_LINE:
                raise InputError(
                    path,
                    f"line {count} is no row of numbers: {line[:60]!r}",
                    "Export the heights as text, one row of the map a line.",
                )
        elif not line.lstrip().startswith("#"):
            rows.append((count, line))
    return header, rows


def _has_numbers(line: str) -> bool:
    # the first cells are enough: only headers are to be told from rows
    cells = cells_of(line[:1000], separator_of(line))[:20]
    try:
        numbers = [number(cell) for cell in cells]
    except ValueError:
        return False
    return len(cells) > 1 and any(value == value for value in numbers)


def mentioned_units(header: list[str]) -> set[str]:
    """Units of length that a header speaks of.

    >>> sorted(mentioned_units(["# Width: 10.00 µm", "# Value units: m", "# made by mm GmbH"]))
    ['m', 'um']
    """
    found = re.findall(r"(?:[:=(\[]\s*[-+.\deE]*\s*)(m|mm|nm|um|µm|μm)\b", "\n".join(header))
    return {unit.replace("µ", "u").replace("μ", "u") for unit in found}
