"""The stone under its load: tables of the path to its equilibrium."""

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.contact import load_path_table
from gstlib.surfaces.grid import spacing_of

__all__ = ["macroscale_table"]


def macroscale_table(contact: xr.Dataset) -> pd.DataFrame:
    """Load path of the face, one row per step (`macroscale_path.csv`)."""
    table = load_path_table(contact)
    area = contact.height.size * float(np.prod(spacing_of(contact)))
    table.insert(1, "force_N", table.mean_pressure_MPa * area)
    return table
