"""CSV tables: tidy, in a stable order, with fixed digits: `diff` shows real changes only."""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gstlib.errors import InputError
from gstlib.io.files import cannot_read, check_regular, write_whole

__all__ = [
    "ALL_DIGITS",
    "SIGNIFICANT_DIGITS",
    "printed",
    "read_pressures",
    "read_table",
    "studied_files",
    "write_table",
]

# Of a number in a table, unless its column has others.
SIGNIFICANT_DIGITS = 5
# Differences beyond these digits count as rounding.
_KNOWN_DIGITS = 10
_FORMULA = ("=", "+", "-", "@")
# Columns that the stages take from the table of patch pressures.
_PRESSURES = (
    "patch",
    "x_mm",
    "y_mm",
    "rotation_deg",
    "pressure_MPa",
    "square_pressure_MPa",
)
# If this variable is 1, tables print every digit, to show differences below the printed ones.
ALL_DIGITS = "GSTLIB_ALL_DIGITS"


def printed(value: float, digits: int = SIGNIFICANT_DIGITS) -> str:
    """A number as tables print it, with `digits` significant digits.

    A tie must not be decided by rounding errors. For example, 0.3 times 35.885, from another table,
    is 10.7655, and its last printed digit must not depend on the sixteenth.
    """
    rounded = float(f"{value:.{_KNOWN_DIGITS}g}")
    text = f"{rounded:.{digits}g}"
    return "0" if text == "-0" else text


def _format(value: Any, digits: int) -> str:
    if pd.isna(value):
        return ""
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float):
        return (
            f"{value:.17g}"
            if os.environ.get(ALL_DIGITS) == "1"
            else printed(value, digits)
        )
    text = str(value)
    # spreadsheets would take it for a formula
    return f"'{text}" if isinstance(value, str) and text.startswith(_FORMULA) else text


def write_table(
    path: str | Path, table: pd.DataFrame, digits: Mapping[str, int] | None = None
) -> None:
    """Write `table` as CSV: floats with five digits, booleans as yes/no, NaN as empty.

    `digits` gives columns another number of significant digits. The file is complete or absent.
    Rows keep their order.
    """
    of_columns = digits or {}

    def words(column: pd.Series) -> pd.Series:
        count = of_columns.get(str(column.name), SIGNIFICANT_DIGITS)
        return column.map(lambda value: _format(value, count))

    text = table.astype(object).apply(words)
    write_whole(path, text.to_csv(index=False, lineterminator="\n").encode())


def read_table(path: str | Path, columns: Iterable[str] = ()) -> pd.DataFrame:
    """Read a table of `write_table`: yes/no columns as bool, ``patch`` as text, empty cells as NaN.

    Parameters
    ----------
    path : str or Path
        A file of `write_table`.
    columns : iterable of str, optional
        Columns that must be there.

    Raises
    ------
    InputError
        The file is missing or not a table, or lacks a column.
    """
    try:
        check_regular(path)
        # NA, nan or None may be the name of a patch
        table = pd.read_csv(
            path, dtype={"patch": str}, keep_default_na=False, na_values=[""]
        )
    except (OSError, ValueError) as error:  # pandas' own errors are ValueErrors
        raise cannot_read(path, "a table", error) from error
    missing = [column for column in columns if column not in table.columns]
    if missing:
        raise InputError(
            path, f"lacks {', '.join(missing)}", "Delete it and run the study again."
        )
    for column in table.columns.drop("patch", errors="ignore"):
        is_yes_or_no = table[column].isin(["yes", "no"])
        if is_yes_or_no.all() and len(table):
            table[column] = table[column] == "yes"
    return table


def read_pressures(path: str | Path) -> pd.DataFrame:
    """Read ``patch_pressures.csv``, or the pressures before the patches are selected."""
    return read_table(path, _PRESSURES)


def studied_files(
    pressures: str | Path, patches: Sequence[str], files: Sequence[Path]
) -> dict[str, Path]:
    """The `files` of patches in the study, by patch, with one file for each of `patches`.

    `pressures` is ``patch_pressures.csv``.
    """
    table = read_table(pressures, ["patch", "in_study"])
    studied = set(table.patch[table.in_study])
    by_patch = zip(patches, files, strict=True)
    return {patch: file for patch, file in by_patch if patch in studied}
