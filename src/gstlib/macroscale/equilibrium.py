"""The stone under its load, in equilibrium. The square alone stays on its plane."""

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.contact import (
    Contact,
    Interface,
    Load,
    contact_at_pressure,
    load_path_table,
)
from gstlib.surfaces.footprints import square_of
from gstlib.surfaces.grid import spacing_of
from gstlib.surfaces.leveling import remove_plane

__all__ = ["face_under_load", "macroscale_table", "solve_at_load"]


def face_under_load(
    face: xr.Dataset, force_N: float, load_point: tuple[float, float] | None
) -> tuple[Interface, Load]:
    """The two faces and their load, as `gstlib.contact` takes them (section 2.3).

    Parameters
    ----------
    face : xarray.Dataset
        ``height``, ``counterface`` and ``size_mm``, from
        `gstlib.macroscale.face.grid_macroscale` or `gstlib.macroscale.composite.compose_surface`.
    force_N : float
    load_point : (float, float) or None
        As in `gstlib.contact.Load`: the whole face is free to tilt. If it is None, the paper's
        square is cut out of it and pressed alone, on its mean plane, against a flat.
    """
    if load_point is None:
        square = square_of(face.height, float(face.size_mm))
        interface = Interface.on_flat(remove_plane(square)[0])
    else:
        interface = Interface(face.height, face.counterface)
    return interface, Load.of_force(force_N, interface.height, load_point)


def solve_at_load(
    face: xr.Dataset,
    *,
    force_N: float,
    load_point: tuple[float, float] | None = None,
    source: str = "macroscale",
    **solving: Any,
) -> Contact:
    """The contact of `face_under_load`, without the path to it.

    `source` and `solving` are the options of `gstlib.contact.contact_at_pressure`.
    """
    pressed = face_under_load(face, force_N, load_point)
    return contact_at_pressure(*pressed, source=source, **solving)


def macroscale_table(path: xr.Dataset) -> pd.DataFrame:
    """Load path of the face as stored, one row per step (`macroscale_path.csv`)."""
    table = load_path_table(path)
    area = path.height.size * float(np.prod(spacing_of(path)))
    table.insert(1, "force_N", table.mean_pressure_MPa * area)
    return table
