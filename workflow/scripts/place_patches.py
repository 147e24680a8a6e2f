"""Find each patch on the macroscale surface, and warn of those that lie elsewhere than stated.

Inputs: surface.h5 of the macroscale, the patches' T0 surfaces. Outputs: placement.csv, placement.h5
(correlation maps and the waves compared). Settings: the patch table, patch side, largest shift,
level of the tests, seed.
"""

import logging
from collections import UserDict
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import write_table
from gstlib.logs import job_log
from gstlib.placement import place_patches, warnings_of
from gstlib.provenance import provenance


class Heights(UserDict):
    """Heights by patch, read when their turn comes: many scans at once would fill the memory."""

    def __getitem__(self, patch: str) -> xr.DataArray:
        return read_dataset(self.data[patch], only=["height"]).height


def main(
    surface: Path,
    surfaces: dict[str, Path],
    table: Path,
    maps: Path,
    *,
    patches: pd.DataFrame,
    patch_mm: float,
    maximum_shift_um: float,
    significance: float,
    seed: int,
) -> None:
    macroscale = read_dataset(surface).height
    placement, found = place_patches(
        macroscale,
        patches,
        Heights(surfaces),
        size_mm=patch_mm,
        edge_mm=float(macroscale.attrs["mesh_edge_mm"]),
        maximum_shift_um=maximum_shift_um,
        significance=significance,
        generator=np.random.default_rng(seed),
    )
    for text in warnings_of(placement):
        logging.getLogger("gstlib").warning("%s", text)
    settings = {
        "patches": patches[["patch", "x_mm", "y_mm", "rotation_deg"]].to_dict("list"),
        "patch_mm": patch_mm,
        "maximum_shift_um": maximum_shift_um,
        "significance": significance,
        "seed": seed,
    }
    write_dataset(maps, found, provenance([surface, *surfaces.values()], settings))
    write_table(table, placement)


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        places = pd.DataFrame(snakemake.params.patches)
        main(
            Path(snakemake.input.surface),
            dict(zip(places.patch, map(Path, snakemake.input.surfaces), strict=True)),
            Path(snakemake.output.table),
            Path(snakemake.output.maps),
            patches=places,
            patch_mm=snakemake.params.patch_mm,
            maximum_shift_um=snakemake.params.maximum_shift_um,
            significance=snakemake.params.significance,
            seed=snakemake.params.seed,
        )
