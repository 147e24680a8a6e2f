"""The tables of a study, as ``workflow/schemas/tables.yaml`` describes them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from gst import ROOT
from gstlib.io import tables
from gstlib.io.tables import SIGNIFICANT_DIGITS

__all__ = ["TABLES", "Column", "Table", "columns_of", "write_table"]

_SCHEMA = ROOT / "workflow/schemas/tables.yaml"


@dataclass(frozen=True)
class Column:
    """A column of a table; the schema says what the fields are."""

    meaning: str
    unit: str = ""
    digits: int = SIGNIFICANT_DIGITS
    optional: bool = False


@dataclass(frozen=True)
class Table:
    """A table of results; the schema says what the fields are."""

    file: str
    title: str
    stage: str
    key: list[str]
    caption: str
    columns: dict[str, Column]
    only: str = ""


def _read(name: str, columns: dict[str, Any], **rest: Any) -> Table:
    described = {
        column: Column(**(said if isinstance(said, dict) else {"meaning": said}))
        for column, said in columns.items()
    }
    return Table(**{"file": f"tables/{name}.csv"} | rest, columns=described)


def _read_schema() -> dict[str, Table]:
    # libyaml's loader, where there is one, takes a tenth of the time
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    content = yaml.load(_SCHEMA.read_text(encoding="utf-8"), loader)
    return {name: _read(name, **said) for name, said in content.items()}


TABLES = _read_schema()


def columns_of(table: str) -> list[str]:
    """The names of a table's columns, in their order."""
    return list(TABLES[table].columns)


def write_table(path: str | Path, table: pd.DataFrame) -> None:
    """Write a table of a study as CSV, with the digits that the schema gives each column.

    `path` is named after the table. One without rows gets the columns that are never missing. The
    rest is as in `gstlib.io.tables.write_table`.

    Raises
    ------
    ValueError
        The schema lists the table with other columns, or in another order.
    """
    path = Path(path)
    columns = TABLES[path.stem].columns
    expected = [
        name for name, column in columns.items() if name in table or not column.optional
    ]
    if not len(table):
        table = pd.DataFrame(columns=expected)
    if list(table) != expected:
        raise ValueError(
            f"{path} would have the columns {', '.join(table)}; {_SCHEMA.name} lists "
            f"{', '.join(expected)}"
        )
    tables.write_table(path, table, {name: columns[name].digits for name in expected})
