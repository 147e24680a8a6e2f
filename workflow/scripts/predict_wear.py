"""Wear the square and its patches by Archard's law, and compare predicted with measured loss."""

from pathlib import Path

import pandas as pd

from gst.logs import run_script
from gst.provenance import provenance
from gstlib.contact import Loading
from gstlib.gesture import Gesture
from gstlib.io.results import columns_of
from gstlib.io.store import Stored, read_dataset, write_dataset
from gstlib.io.tables import read_pressures, read_table, write_table
from gstlib.study import score_wear, wear_stone
from gstlib.wear import fit_mat, wear_patches


def main(
    contact: Path,
    second: Path,
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
    size_mm: float,
    seed: int,
    resamples: int,
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    by_patch = read_pressures(pressures)
    settings = {"patch_mm": patch_mm, "steps": steps, "mat": mat}
    pressed, gesture = read_dataset(contact), None
    if poses:
        counterface = read_dataset(second).face if second else pressed.counterface
        through = Loading.of(pressed).through
        gesture = Gesture(counterface, bool(second), size_mm, through, pd.DataFrame(poses))
    square = wear_stone(pressed, by_patch, read_table(scores), gesture=gesture, **settings)
    if square is None:
        for file in (table, profile, summary):
            write_table(file, pd.DataFrame(columns=columns_of(file.stem)))
        return
    # no patch has an underscore in its name
    made = provenance([contact, pressures, scores], settings)
    write_dataset(folder / "whole_square.h5", square.path, made)
    before = Stored(dict(zip(worn, contacts, strict=True)))
    known = ["change", "loss", "level_of_detection"]
    changes = Stored(dict(zip(worn, registered, strict=True)), known)
    fitted = None
    if square.mat:
        fitted = fit_mat(square, before, changes)
        write_dataset(
            folder / "whole_mat.h5", fitted.assign(pressure=square.mat.pressure), made
        )
    files = {patch: folder / f"{patch}.h5" for patch in square.losers}
    for patch, loss in wear_patches(square, fitted, before):
        write_dataset(files[patch], loss, made)
    losses, chance = Stored(files), {"seed": seed, "resamples": resamples}
    tables = score_wear(before, changes, losses, square, fitted, **chance)
    for file, content in zip((table, profile, summary), tables, strict=True):
        write_table(file, content)


if "snakemake" in globals():
    run_script(snakemake, main)
