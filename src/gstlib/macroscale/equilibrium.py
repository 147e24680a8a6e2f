"""The stone under its load, until its forces balance; the square alone stays on its plane."""

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.contact import (
    Contact,
    ContactPath,
    Interface,
    Load,
    contact_at_pressure,
    contact_path,
    load_path_table,
)
from gstlib.macroscale.face import square_alone
from gstlib.surfaces.grid import spacing_of

__all__ = ["macroscale_table", "solve_at_load", "solve_macroscale", "solve_square"]


def solve_macroscale(
    face: xr.Dataset,
    *,
    force_N: float,
    through: tuple[float, float] | None,
    modulus: float,
    tolerance: float,
    steps: int,
    maximum_displacement_um: float,
    source: str = "macroscale",
) -> ContactPath:
    """Press the stone step by step up to its load (section 2.3).

    Parameters
    ----------
    face : xarray.Dataset
        ``height``, ``counterface`` and ``size_mm``, from
        `gstlib.macroscale.face.grid_macroscale` or `gstlib.macroscale.composite.compose_surface`.
    force_N : float
    through : (float, float) or None
        As in `gstlib.contact.Load`; without it, the square is pressed alone, on its mean plane.
    modulus, tolerance, steps, maximum_displacement_um
        As in `gstlib.contact.contact_path`.
    source : str
        The file of the face, for messages.
    """
    interface = pressed_interface(face, through)
    load = Load.of_force(force_N, interface.height, through)
    return contact_path(
        interface,
        load,
        modulus=modulus,
        tolerance=tolerance,
        source=source,
        steps=steps,
        maximum_displacement_um=maximum_displacement_um,
        every_step=True,
    )


def solve_square(
    face: xr.Dataset,
    *,
    force_N: float,
    modulus: float,
    tolerance: float,
    source: str = "macroscale",
) -> Contact:
    """The paper's square alone at the force, without the path to it."""
    solved = {"modulus": modulus, "tolerance": tolerance}
    return solve_at_load(face, force_N=force_N, through=None, **solved, source=source)


def solve_at_load(
    face: xr.Dataset,
    *,
    force_N: float,
    through: tuple[float, float] | None,
    modulus: float,
    tolerance: float,
    source: str = "macroscale",
) -> Contact:
    """The contact of `solve_macroscale` at the load, without the path to it."""
    interface = pressed_interface(face, through)
    load = Load.of_force(force_N, interface.height, through)
    solved: dict[str, Any] = {"modulus": modulus, "tolerance": tolerance}
    return contact_at_pressure(interface, load, source=source, **solved)


def pressed_interface(face: xr.Dataset, through: tuple[float, float] | None) -> Interface:
    """What is pressed: the whole face, free to tilt, or the square alone on its mean plane."""
    return square_alone(face) if through is None else Interface(face.height, face.counterface)


def macroscale_table(path: xr.Dataset) -> pd.DataFrame:
    """Load path of the face as stored, one row per step (`macroscale_path.csv`)."""
    table = load_path_table(path)
    area = path.height.size * float(np.prod(spacing_of(path)))
    table.insert(1, "force_N", table.mean_pressure_MPa * area)
    return table
