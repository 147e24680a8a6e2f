"""Wear the square by Archard's law, and fit law and interlayer to the losses of the patches."""

from pathlib import Path

import pandas as pd
import xarray as xr

from gst.logs import run_script
from gst.provenance import provenance
from gst.stored import changes_of, contact_of, contacts_of
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import read_pressures, read_table
from gstlib.macroscale.gesture import Gesture
from gstlib.wear.fit import PatchMaps, fit_wear


def main(
    contact: Path,
    second: Path,
    contacts: list[Path],
    registered: list[Path],
    pressures: Path,
    registration: Path,
    square: Path,
    fitted: Path | None = None,
    *,
    patches: list[str],
    patch_mm: float,
    steps: int,
    interlayer: dict[str, float] | None,
    poses: dict | None,
    size_mm: float,
) -> None:
    """The files are empty where wear is not predicted."""
    pressed, gesture = contact_of(contact), None
    if poses:
        counterface = read_dataset(second).face if second else pressed.interface.counterface
        through = pressed.load.through
        gesture = Gesture(counterface, bool(second), size_mm, through, pd.DataFrame(poses))
    settings = {"patch_mm": patch_mm, "steps": steps, "interlayer": interlayer}
    tables = read_pressures(pressures), read_table(registration)
    maps = PatchMaps(contacts_of(contacts, patches), changes_of(registered, patches))
    worn = fit_wear(pressed, *tables, maps, gesture=gesture, **settings)
    made = provenance([contact, pressures, registration], settings)
    write_dataset(square, worn.path if worn else xr.Dataset(), made)
    if fitted is not None:
        write_dataset(fitted, worn.fitted_interlayer if worn else xr.Dataset(), made)


if "snakemake" in globals():
    run_script(snakemake, main)
