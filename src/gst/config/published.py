"""The table of published figures that a study is compared with.

`workflow/schemas/published.schema.yaml` describes a row.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import pandas as pd

from gst.config.user_tables import Problem, read_rows
from gstlib.settings.contradictions import near

_OF_PATCH = "patch pressure"
# In which the study computes each quantity.
_UNITS = {
    "displacement": "um",
    "mean pressure": "MPa",
    "contact fraction": "1",
    _OF_PATCH: "MPa",
}


def read_published(path: str | Path, patches: Sequence[str]) -> pd.DataFrame:
    """The rows of the table, with the unit of each; `patches` are those of the study.

    A `ConfigError` lists all that is wrong, with line numbers.
    """
    table = read_rows(path, "published")
    rows = table.rows
    rows["unit"] = rows.unit.where(rows.unit != "", rows.quantity.map(_UNITS))
    table.refuse(_problems(rows, patches))
    return rows


def _problems(rows: pd.DataFrame, patches: Sequence[str]) -> Iterator[Problem]:
    """Rows that cannot be compared with a figure of the study."""
    for row in rows[rows.quantity.isin(_UNITS)].itertuples():
        name, unit = row.quantity, _UNITS[row.quantity]
        if row.unit != unit:
            yield row.Index, f"unit is {row.unit!r}: write {unit} for a {name}"
        if name != _OF_PATCH and row.patch:
            yield row.Index, f"patch is {row.patch!r}: leave it empty for a {name}"
        if name == _OF_PATCH and row.patch not in patches:
            hint = near(row.patch, patches)
            yield (row.Index, f"the patch is not in the patch table: {hint}correct it")
