"""Compute the wear of the square by Archard's law, and fit the law to the losses of the patches."""

from pathlib import Path

import pandas as pd
import xarray as xr

from gst.run.contacts import contact_of, contacts_of
from gst.run.logs import run_in_snakemake
from gst.run.stored import active_tool_of, changes_of, table_of, write_result
from gstlib.io.tables import read_pressures
from gstlib.macroscale.gesture import Gesture
from gstlib.wear.fit import fit_wear


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
    tables = read_pressures(pressures), table_of(registration)
    maps = contacts_of(contacts, patches), changes_of(registered, patches)
    worn = fit_wear(pressed, *tables, *maps, gesture=gesture, **wear)
    write_result(square, worn.path if worn else xr.Dataset(), "fit_wear")
    if fitted is not None:
        write_result(fitted, worn.interlayer if worn else xr.Dataset(), "fit_wear")


run_in_snakemake(main)
