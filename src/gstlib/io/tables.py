"""CSV tables: tidy, in a stable order, with fixed digits: `diff` shows real changes only."""

import os
from collections.abc import Iterable
from pathlib import Path

import pandas as pd

from gstlib.errors import InputError
from gstlib.io.files import write_whole

__all__ = [
    "ALL_DIGITS",
    "FEWER_DIGITS",
    "SIGNIFICANT_DIGITS",
    "printed",
    "read_table",
    "write_table",
]

# Results are solved to a relative residual of 1e-6 or better; five digits stay above that noise.
SIGNIFICANT_DIGITS = 5
# Columns with fewer digits: a stiffness is converged to about 1e-6.
FEWER_DIGITS = {"stiffness_MPa_per_um": 4}
# Differences beyond these digits are taken for rounding.
_KNOWN_DIGITS = 10
# Set to 1 it prints every digit, to see by how much two runs differ beneath the printed ones.
ALL_DIGITS = "GSTLIB_ALL_DIGITS"


def printed(value: float, digits: int = SIGNIFICANT_DIGITS) -> str:
    """A number as tables print it, with so many significant digits.

    Ties are told from noise: 0.3 times the 35.885 of another table is 10.7655, and its last digit
    shall not depend on the sixteenth.
    """
    known = float(f"{value:.{_KNOWN_DIGITS}g}")
    text = f"{known:.{digits}g}"
    return "0" if text == "-0" else text


def _format(value: object, digits: int) -> str:
    if value is None or value is pd.NA or (isinstance(value, float) and value != value):
        return ""
    if isinstance(value, bool) or type(value).__name__ in ("bool", "bool_"):
        return "yes" if value else "no"
    if isinstance(value, float):
        every_digit = os.environ.get(ALL_DIGITS) == "1"
        return f"{float(value):.17g}" if every_digit else printed(float(value), digits)
    return str(value)


def write_table(path: str | Path, table: pd.DataFrame) -> None:
    """Write `table` as CSV: floats with `SIGNIFICANT_DIGITS` or `FEWER_DIGITS`, booleans as yes/no,
    NaN as empty.

    The file is complete or absent; row order is the table's own.
    """
    text = table.astype(object).apply(
        lambda column: column.map(
            lambda value: _format(value, FEWER_DIGITS.get(column.name, SIGNIFICANT_DIGITS))
        )
    )
    write_whole(path, text.to_csv(index=False, lineterminator="\n").encode())


def read_table(path: str | Path, columns: Iterable[str] = ()) -> pd.DataFrame:
    """Read a table of `write_table`: yes/no columns as bool, ``patch`` as text.

    Parameters
    ----------
    path : str or Path
        A file of `write_table`.
    columns : iterable of str, optional
        Columns that must be there.

    Raises
    ------
    InputError
        The file is missing or is no table, or lacks a column.
    """
    try:
        table = pd.read_csv(path, dtype={"patch": str}, keep_default_na=True)
    except (OSError, ValueError) as error:  # pandas' own errors are ValueErrors
        reason = " ".join(str(error).split())
        raise InputError(
            path, f"cannot be read as a table ({reason})", "Delete it and run the study again."
        ) from error
    missing = [column for column in columns if column not in table.columns]
    if missing:
        raise InputError(path, f"lacks {', '.join(missing)}", "Delete it and run the study again.")
    for column in table.columns:
        if table[column].isin(["yes", "no"]).all() and len(table):
            table[column] = table[column] == "yes"
    return table
