"""ConfoMap's table of texture parameters beside the study's: `gst compare-texture`.

ConfoMap and MountainsMap append a line of results to a CSV file (Windows-1252) for every surface
that a template is applied to. Above them stand three lines: the number of the template's frame that
each column is of, its name, and its unit. `*****` stands for no result. The names of surfaces and
files are among the results, and tell to which scan a line belongs. The layout is that of the tables
of Calandra et al. (2022, github.com/tracer-monrepos/SSFAcomparisonPaper).
"""

import csv
import math
import re
from pathlib import Path

import pandas as pd

from gstlib.errors import InputError
from gstlib.io.files import check_size
from gstlib.io.results import TABLES
from gstlib.io.tables import read_table
from gstlib.io.text import decoded, separator_of

__all__ = ["compare_texture"]

_HEADER = 3
_NONE = "*****"
# What one of their units is in ours.
_UNITS = {
    "µm": {"nm": 1e-3, "µm": 1.0, "mm": 1e3},
    "µm³/µm²": {"µm³/µm²": 1.0, "nm³/nm²": 1e-3, "mm³/mm²": 1e3, "µm³/mm²": 1e-6, "ml/m²": 1.0},
    "%": {"%": 1.0},
    "": {"<no unit>": 1.0, "": 1.0},
}


def compare_texture(results: Path, file: Path) -> pd.DataFrame:
    """Texture parameters of a study, and the same of ConfoMap, in the study's units.

    Returns
    -------
    pandas.DataFrame
        A row for each parameter of each scan in both: ``patch, epoch, parameter, unit``; ``frame``,
        the number that ConfoMap gives; ``study, confomap``; ``difference_percent`` of the second
        from the first; NaN where there is none.

    Raises
    ------
    InputError
        A table is missing, the file is not ConfoMap's, or has none of the study's scans.
    """
    texture = read_table(results / "tables/texture.csv")
    scans = read_table(results / "tables/inputs.csv")[["patch", "epoch", "file"]]
    (frames, names, units), lines = _read(file)
    ours = {c.name.partition("_")[0]: c for c in TABLES["texture"].columns if c.name in texture}
    found = []
    for row in texture.merge(scans).to_dict("records"):
        stem = re.escape(Path(row["file"]).stem)
        named = re.compile(rf"(?<![\w-]){stem}(?![\w-])")
        for line in lines:
            if not any(map(named.search, line)):
                continue
            for frame, name, unit, cell in zip(frames, names, units, line, strict=False):
                symbol = name.rpartition("(")[2].removesuffix(")")
                if symbol in ours and symbol[0] in "SV":
                    column = ours[symbol]
                    theirs = _number(file, symbol, cell) * _factor(
                        file, name, unit, column.unit
                    )
                    study = row[column.name]
                    off = 100 * (theirs / study - 1) if study else math.nan
                    found.append(
                        (
                            row["patch"],
                            row["epoch"],
                            symbol,
                            column.unit,
                            frame,
                            study,
                            theirs,
                            off,
                        )
                    )
    if not found:
        problem = (
            f"none of its {len(lines)} lines names a scan of the study with a parameter of it"
        )
        raise InputError(file, problem, f"Name the surfaces as the scans: {scans.file[0]}.")
    columns = ["patch", "epoch", "parameter", "unit", "frame"]
    return pd.DataFrame(found, columns=[*columns, "study", "confomap", "difference_percent"])


def _read(file: Path) -> tuple[list[list[str]], list[list[str]]]:
    """The three lines of the header, and the lines of results."""
    try:
        check_size(file)
        content = file.read_bytes()
    except OSError as error:
        problem = f"cannot be read ({error.strerror})"
        raise InputError(file, problem, "Correct its path.") from error
    try:
        text = decoded(content)
    except UnicodeError:
        text = content.decode("cp1252", "replace")
    mark = separator_of(text.partition("\n")[0]) or ","
    lines = list(csv.reader(text.replace("μ", "µ").splitlines(), delimiter=mark))
    if len(lines) <= _HEADER or any(line[:1] != ["#"] for line in lines[:_HEADER]):
        problem = (
            "is not ConfoMap's table of results: its first three lines do not begin with '#'"
        )
        raise InputError(file, problem, "Export the results from ConfoMap as CSV.")
    return lines[:_HEADER], [line for line in lines[_HEADER:] if line]


def _number(file: Path, symbol: str, cell: str) -> float:
    """A result; NaN if there is none."""
    if cell.strip() in (_NONE, ""):
        return math.nan
    try:
        return float(cell.replace(",", "."))
    except ValueError as error:
        problem = f"{symbol} is {cell!r}, not a number"
        raise InputError(file, problem, "Export the results again.") from error


def _factor(file: Path, name: str, unit: str, ours: str) -> float:
    """What a unit is in the study's."""
    if unit not in _UNITS[ours]:
        problem = f"{name} is in {unit!r}, not in one of {list(_UNITS[ours])}"
        raise InputError(file, problem, "Choose one of these units in ConfoMap.")
    return _UNITS[ours][unit]
