"""Wear the square by Archard's law, and fit law and interlayer to the losses of the patches."""

from pathlib import Path

import pandas as pd
import xarray as xr

from gst.batches import files_of
from gst.logs import run_script
from gst.provenance import provenance
from gstlib.contact import Contact
from gstlib.io.store import Stored, read_dataset, write_dataset
from gstlib.io.tables import read_pressures, read_table
from gstlib.macroscale.gesture import Gesture
from gstlib.wear.fit import wear_stone
from gstlib.wear.interlayer import fit_interlayer

CHANGE = "change", "loss", "level_of_detection"


def main(
    contact: Path,
    second: Path,
    contacts: list[Path],
    registered: list[Path],
    pressures: Path,
    registration: Path,
    square: Path,
    interlayer: Path | None = None,
    *,
    patches: list[str],
    patch_mm: float,
    steps: int,
    interlayer_layer: dict[str, float] | None,
    poses: dict | None,
    size_mm: float,
) -> None:
    """The files are empty where wear is not predicted."""
    pressed, gesture = Contact.from_dataset(read_dataset(contact)), None
    if poses:
        counterface = read_dataset(second).face if second else pressed.interface.counterface
        through = pressed.load.through
        gesture = Gesture(counterface, bool(second), size_mm, through, pd.DataFrame(poses))
    settings = {"patch_mm": patch_mm, "steps": steps, "interlayer": interlayer_layer}
    tables = read_pressures(pressures), read_table(registration)
    worn = wear_stone(pressed, *tables, gesture=gesture, **settings)
    made = provenance([contact, pressures, registration], settings)
    write_dataset(square, worn.path if worn else xr.Dataset(), made)
    if interlayer is not None:
        fitted = xr.Dataset()
        if worn:
            before = Stored(files_of(contacts, patches), then=Contact.from_dataset)
            fitted = fit_interlayer(worn, before, Stored(files_of(registered, patches), CHANGE))
            fitted = fitted.assign(pressure=worn.interlayer.pressure)
        write_dataset(interlayer, fitted, made)


if "snakemake" in globals():
    run_script(snakemake, main)
