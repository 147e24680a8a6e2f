"""Compute the wear of the square by Archard's law, and fit the law to the losses of the patches."""

from pathlib import Path

import pandas as pd
import xarray as xr

from gst.run.logs import run_in_snakemake
from gst.run.provenance import made_by
from gst.run.stored import active_tool_of, changes_of, contact_of, contacts_of
from gstlib.io.store import write_dataset
from gstlib.io.tables import read_pressures, read_table
from gstlib.macroscale.gesture import Gesture
from gstlib.wear.fit import PatchMaps, fit_wear


def main(
    contact: Path,
    second: Path | list,
    contacts: list[Path],
    registered: list[Path],
    pressures: Path,
    registration: Path,
    square: Path,
    fitted: Path | None = None,
    *,
    patches: list[str],
    wear: dict,
    poses: dict | None,
    size_mm: float,
) -> None:
    """The files are empty if wear is not predicted."""
    pressed, gesture = contact_of(contact), None
    if poses:
        tool = pressed.interface.counterface, active_tool_of(second), size_mm
        gesture = Gesture(*tool, pressed.load.load_point, pd.DataFrame(poses))
    tables = read_pressures(pressures), read_table(registration)
    maps = PatchMaps(contacts_of(contacts, patches), changes_of(registered, patches))
    worn = fit_wear(pressed, *tables, maps, gesture=gesture, **wear)
    made = made_by("fit_wear")
    write_dataset(square, worn.path if worn else xr.Dataset(), made)
    if fitted is not None:
        write_dataset(fitted, worn.fitted_interlayer if worn else xr.Dataset(), made)


run_in_snakemake(main)
