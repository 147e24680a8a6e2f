"""Sum macroscale forces over each patch, and choose the patches of the microscale study.

Inputs: contact.h5 of the macroscale, the patches' T0 surfaces (their real size), registrations, and
placement.csv where patches are to be taken from where they were found. Outputs:
patch_pressures.csv. Settings: the patch table, sides of patch and square, a shift of all patches,
selection rules.
"""

import logging
import math
from pathlib import Path

import pandas as pd

from gstlib.coupling import patch_pressures, select_patches, shifted_places
from gstlib.io.store import read_attributes, read_dataset
from gstlib.io.tables import read_table, write_table
from gstlib.logs import job_log
from gstlib.placement import found_places


def main(
    contact: Path,
    registered: dict[str, Path],
    placement: Path | None,
    table: Path,
    *,
    patches: pd.DataFrame,
    patch_mm: float,
    square_mm: float,
    shift_um: list[float],
    selection: dict[str, float],
) -> None:
    final = read_dataset(contact).isel(step=-1)
    if placement is None:
        patches = patches.assign(place="nominal")
    else:
        found = read_table(placement, ["patch", "shift_x_um", "shift_y_um", "verdict"])
        patches = found_places(patches, found)
    patches = shifted_places(patches, shift_um, size_mm=patch_mm, square_mm=square_mm)
    pressures = patch_pressures(final.pressure, patches, size_mm=patch_mm)
    pressures.insert(pressures.columns.get_loc("y_mm") + 1, "place", list(patches.place))
    attrs = {patch: read_attributes(file) for patch, file in registered.items()}
    quality = pd.DataFrame(
        {
            "patch": list(attrs),
            "overlap": [quality["overlap"] for quality in attrs.values()],
            # of the detail: the long waves of a stone correlate wherever T1 is laid
            "correlation": [
                quality["detail_correlation"] if quality["registration_found"] else math.nan
                for quality in attrs.values()
            ],
        }
    )
    selected = select_patches(pressures, quality, **selection)
    if not selected.in_study.any():
        logging.getLogger("gstlib").warning(
            "no patch enters the microscale study: the reasons are in %s, the rules in the section "
            "'selection' of the config",
            table,
        )
    write_table(table, selected)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            Path(snakemake.input.contact),
            dict(zip(snakemake.params.worn, map(Path, snakemake.input.registered), strict=True)),
            Path(snakemake.input.placement) if snakemake.input.placement else None,
            Path(snakemake.output.table),
            patches=pd.DataFrame(snakemake.params.patches),
            patch_mm=snakemake.params.patch_mm,
            square_mm=snakemake.params.square_mm,
            shift_um=snakemake.params.shift_um,
            selection=snakemake.params.selection,
        )
