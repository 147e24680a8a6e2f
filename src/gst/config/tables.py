"""The tables of a study, as ``workflow/schemas/tables.yaml`` describes them."""

from pathlib import Path
from typing import NamedTuple

import pandas as pd
import yaml

from gst import ROOT
from gstlib.io import tables
from gstlib.io.tables import SIGNIFICANT_DIGITS

_SCHEMA = ROOT / "workflow/schemas/tables.yaml"


class Column(NamedTuple):
    """A column of a table. The schema describes the fields."""

    meaning: str
    unit: str = ""
    digits: int = SIGNIFICANT_DIGITS
    optional: bool = False


class Table(NamedTuple):
    """A table of results. The schema describes the fields."""

    file: str
    title: str
    stage: str
    key: list[str]
    caption: str
    columns: dict[str, Column]
    only: str = ""


def read_schema(path: Path) -> dict[str, Table]:
    """The tables by name, as a schema describes them."""
    # libyaml's loader, where there is one, takes a tenth of the time
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    schema = yaml.load(path.read_text(encoding="utf-8"), loader)
    for name, table in schema.items():
        for column, rule in table["columns"].items():
            table["columns"][column] = Column(
                **(rule if isinstance(rule, dict) else {"meaning": rule})
            )
        schema[name] = Table(**{"file": f"tables/{name}.csv"} | table)
    return schema


TABLES = read_schema(_SCHEMA)


def columns_of(table: str) -> list[str]:
    """The names of a table's columns, in their order."""
    return list(TABLES[table].columns)


def write_table(path: str | Path, table: pd.DataFrame) -> None:
    """Write a table of a study as CSV, with the digits that the schema gives each column.

    `path` is named after the table. One without rows gets the columns that are never missing. The
    rest is as in `gstlib.io.tables.write_table`. Raises a `ValueError` if the schema lists other
    columns, or in another order.
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
