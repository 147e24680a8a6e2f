"""Draw figures of the study from stored results: those whose pictures the rule names."""

import dataclasses
from typing import Any

from gst.page.figures.study import draw
from gst.page.results import Results
from gst.run.logs import run_in_snakemake

PICTURES = "_png", "_svg", "_pdf", "_jpg"


def main(*, note: str | None, **files: Any) -> None:
    """`files` are those that the figures show, and their pictures (see `draw`).

    Settings of `Results` are among them, by the names of its fields.
    """
    fields = {field.name for field in dataclasses.fields(Results)} & files.keys()
    settings = {name: files.pop(name) for name in fields}
    pictures = {name: file for name, file in files.items() if name.endswith(PICTURES)}
    draw(Results(files, **settings), pictures, note)


run_in_snakemake(main)
