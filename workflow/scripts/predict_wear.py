"""Wear the square and its patches by Archard's law, as the losses of other patches foretell."""

from pathlib import Path

import pandas as pd

from gst.logs import run_script
from gst.provenance import provenance
from gstlib.contact import Contact
from gstlib.io.store import Stored, read_dataset, write_dataset
from gstlib.io.tables import read_pressures, read_table
from gstlib.macroscale.gesture import Gesture
from gstlib.wear.fit import wear_map, wear_stone
from gstlib.wear.interlayer import fit_mat


def main(
    contact: Path,
    second: Path,
    contacts: list[Path],
    registered: list[Path],
    pressures: Path,
    registration: Path,
    folder: Path,
    *,
    worn: list[str],
    patch_mm: float,
    steps: int,
    mat: dict[str, float] | None,
    hardness_MPa: float | None,
    poses: dict | None,
    size_mm: float,
) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    pressed, gesture = Contact.from_dataset(read_dataset(contact)), None
    if poses:
        counterface = read_dataset(second).face if second else pressed.interface.counterface
        through = pressed.load.through
        gesture = Gesture(counterface, bool(second), size_mm, through, pd.DataFrame(poses))
    settings = {"patch_mm": patch_mm, "steps": steps, "mat": mat}
    tables = read_pressures(pressures), read_table(registration)
    square = wear_stone(pressed, *tables, gesture=gesture, **settings)
    if square is None:
        return
    # no patch has an underscore in its name
    sources = [contact, pressures, registration]
    made = provenance(sources, settings)
    write_dataset(folder / "whole_square.h5", square.path, made)
    before = Stored(dict(zip(worn, contacts, strict=True)), then=Contact.from_dataset)
    known = ["change", "loss", "level_of_detection"]
    changes = Stored(dict(zip(worn, registered, strict=True)), known)
    fitted = None
    if square.mat:
        fitted = fit_mat(square, before, changes)
        write_dataset(
            folder / "whole_mat.h5", fitted.assign(pressure=square.mat.pressure), made
        )
    made = provenance(sources, settings | {"hardness_MPa": hardness_MPa})
    for patch in worn:
        found = wear_map(before[patch], square, fitted, patch, hardness_MPa=hardness_MPa)
        write_dataset(folder / f"{patch}.h5", found, made)


if "snakemake" in globals():
    run_script(snakemake, main)
