"""Captions of figures and tables, for the page and for Snakemake's report.

They are reStructuredText with Jinja, which may quote the config. Figures have theirs in
``workflow/report``; those of tables are made from ``workflow/schemas/tables.yaml``.
"""

import textwrap
from types import SimpleNamespace
from typing import Any

import jinja2
from docutils.core import publish_parts

from gst import ROOT
from gst.config.tables import TABLES


def caption_of(name: str) -> str:
    """The caption of a figure, by the name of its file, or of a table, ``tables/NAME.rst``."""
    folder, _, file = name.rpartition("/")
    if folder == "tables":
        return table_caption(file.removesuffix(".rst"))
    return (ROOT / "workflow/report" / name).read_text(encoding="utf-8")


def table_caption(name: str) -> str:
    """The caption of a table of results, with a line for each column."""
    table = TABLES[name]
    text = textwrap.fill(
        table.caption, 110, break_long_words=False, break_on_hyphens=False
    )
    columns = [
        f"- ``{name}``{column.unit and f' ({column.unit})'}: {column.meaning}."
        for name, column in table.columns.items()
    ]
    return "\n".join(["{% set config = snakemake.config %}", text, "", *columns, ""])


def caption_html(template: str, **names: Any) -> str:
    """A caption as HTML; `names` are those that it may use of ``snakemake``."""
    filled = jinja2.Template(template, undefined=jinja2.StrictUndefined)
    text = filled.render(snakemake=SimpleNamespace(**names))
    quiet = {"raw_enabled": False, "file_insertion_enabled": False, "report_level": 3}
    return publish_parts(text, writer="html5", settings_overrides=quiet)["body"]
