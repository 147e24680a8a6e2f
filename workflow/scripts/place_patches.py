"""Hold each patch against the macroscale surface under it, and warn of wrong places."""

from collections import UserDict
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from gst.logs import run_script
from gstlib.io.store import read_dataset
from gstlib.io.tables import write_table
from gstlib.study import place_patches


class Heights(UserDict):
    """Heights by patch, read when their turn comes: many scans at once would fill the memory."""

    def __getitem__(self, patch: str) -> xr.DataArray:
        return read_dataset(self.data[patch], only=["height"]).height


def main(
    surface: Path, t0: list[Path], table: Path, *, patches: dict[str, list], **settings: Any
) -> None:
    places = pd.DataFrame(patches)
    heights = Heights(zip(places.patch, t0, strict=True))
    write_table(table, place_patches(read_dataset(surface), places, heights, **settings))


if "snakemake" in globals():
    run_script(snakemake, main)
