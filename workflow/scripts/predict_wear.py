"""Wear the square and its patches by Archard's law, and compare predicted with measured loss."""

from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import xarray as xr

from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import read_pressures, read_table, studied_files, write_table
from gstlib.logs import patch_by_patch, run_script
from gstlib.provenance import provenance
from gstlib.study import score_wear, wear_patch, wear_square
from gstlib.wear import COLUMNS


def main(
    square: Path,
    contacts: list[Path],
    registered: list[Path],
    pressures: Path,
    scores: Path,
    folder: Path,
    table: Path,
    summary: Path,
    *,
    worn: list[str],
    patch_mm: float,
    steps: int,
    seed: int,
    resamples: int,
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    by_patch, scored = read_pressures(pressures), read_table(scores)
    settings = {"patch_mm": patch_mm, "steps": steps}
    pressed = read_dataset(square, only=["height", "pressure"]).isel(step=-1)
    path = wear_square(pressed, by_patch, scored, source=square, **settings)
    if path is None:
        for file, columns in zip((table, summary), COLUMNS, strict=True):
            write_table(file, pd.DataFrame(columns=columns))
        return
    write_dataset(folder / "square.h5", path, provenance([square, pressures, scores], settings))

    def patches() -> Iterator[tuple[str, xr.Dataset, xr.Dataset, xr.Dataset]]:
        files = studied_files(pressures, worn, list(zip(contacts, registered, strict=True)))
        believed = scored.patch[scored.believed.astype(bool)]
        for patch, inputs in patch_by_patch({p: files[p] for p in files if p in set(believed)}):
            contact, change = map(read_dataset, inputs)
            lost = wear_patch(contact, path, patch)
            write_dataset(folder / f"{patch}.h5", lost, provenance([*inputs, square], settings))
            yield patch, contact, change, lost

    tables = score_wear(patches(), by_patch, seed=seed, resamples=resamples)
    for file, content in zip((table, summary), tables, strict=True):
        write_table(file, content)


if "snakemake" in globals():
    run_script(snakemake, main)
