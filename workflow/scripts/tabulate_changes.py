"""Tabulate for each patch the match between T1 and T0, and the loss."""

import logging
from pathlib import Path

from gst.config.tables import write_table
from gst.run.logs import run_in_snakemake
from gst.run.stored import changes_of
from gstlib.change.selection import (
    exchanged_epochs,
    other_heights,
    registration_table,
    rise_warnings,
)
from gstlib.errors import raise_unless_accepted


def main(
    registered: list[Path],
    registration: Path,
    *,
    worn: list[str],
    selection: dict[str, float],
    max_gain_to_loss_ratio: float,
    accept: list[str],
) -> None:
    changes = changes_of(registered, worn, ["change", "loss", "gain"])
    table = registration_table(
        changes, selection, max_gain_to_loss_ratio=max_gain_to_loss_ratio
    )
    raise_unless_accepted([*other_heights(table), *exchanged_epochs(table)], accept)
    for doubt in rise_warnings(table, max_gain_to_loss_ratio=max_gain_to_loss_ratio):
        logging.getLogger("gst").warning("%s", doubt)
    write_table(registration, table)


run_in_snakemake(main)
