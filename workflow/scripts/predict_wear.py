"""Wear the square and its patches by Archard's law, and compare predicted with measured loss."""

from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import xarray as xr

from gst.logs import patch_by_patch, run_script
from gst.provenance import provenance
from gstlib.io.results import columns_of
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import read_pressures, read_table, write_table
from gstlib.study import fit_mat, predict_wear, score_wear, wear_square


def main(
    square: Path,
    surface: Path,
    contacts: list[Path],
    registered: list[Path],
    pressures: Path,
    scores: Path,
    folder: Path,
    table: Path,
    profile: Path,
    summary: Path,
    *,
    worn: list[str],
    patch_mm: float,
    steps: int,
    mat: dict[str, float] | None,
    poses: dict | None,
    seed: int,
    resamples: int,
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    by_patch = read_pressures(pressures)
    settings = {"patch_mm": patch_mm, "steps": steps, "mat": mat}
    pressed = read_dataset(square).isel(step=-1)
    gesture = {}
    if poses:
        face = read_dataset(surface, only=["face"]).face
        gesture = {"face": face, "poses": pd.DataFrame(poses)}
    path = wear_square(
        pressed, by_patch, read_table(scores), source=square, **settings, **gesture
    )
    if path is None:
        for file in (table, profile, summary):
            write_table(file, pd.DataFrame(columns=columns_of(file.stem)))
        return
    files = dict(zip(worn, zip(contacts, registered, strict=True), strict=True))
    files = {
        patch: files[patch] for patch in path.measured.dropna("patch").patch.values.tolist()
    }

    def read() -> Iterator[tuple[str, xr.Dataset, xr.Dataset]]:
        for patch, inputs in patch_by_patch(files):
            yield patch, *map(read_dataset, inputs)

    path = fit_mat(path, read())
    made = provenance([square, pressures, scores], settings)
    write_dataset(
        folder / "whole_square.h5", path, made
    )  # no patch has an underscore in its name

    def patches() -> Iterator[tuple[str, xr.Dataset, xr.Dataset, xr.Dataset]]:
        for patch, contact, change in read():
            lost = predict_wear(contact, path, patch)
            made = provenance([*files[patch], square], settings)
            write_dataset(folder / f"{patch}.h5", lost, made)
            yield patch, contact, change, lost

    tables = score_wear(patches(), path, by_patch, seed=seed, resamples=resamples)
    for file, content in zip((table, profile, summary), tables, strict=True):
        write_table(file, content)


if "snakemake" in globals():
    run_script(snakemake, main)
