"""The stages of a study by the sections of its config, in one process: from files to contacts.

The workflow runs each stage as a job of its own, keeps the states on the way to the target
pressure and draws them; here is what scores rest on and no more, for those who put many studies
through (`gstlib.power`, `gstlib.sweep`).
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray as xr

from gstlib.contact import pressed_height, solve_at_pressure
from gstlib.io.meshes import read_mesh
from gstlib.preprocess.frame import find_frame
from gstlib.preprocess.gridding import grid_mesh
from gstlib.preprocess.leveling import remove_plane

__all__ = ["grid_square", "press_patch", "press_square"]


def grid_square(
    mesh: Path, *, mesh_unit: str, square: Mapping, grid: int, margin_mm: float
) -> xr.DataArray:
    """Heights (mm) of the analysed square, level, on a grid of (`grid`, `grid`) elements."""
    stone = read_mesh(mesh, unit=mesh_unit)
    gridded = grid_mesh(
        stone,
        find_frame(square, stone, unit=mesh_unit, source=str(mesh)),
        size_mm=square["size_mm"],
        shape=(grid, grid),
        margin_mm=margin_mm,
        source=str(mesh),
    )
    return remove_plane(gridded)[0]


def press_square(
    height: xr.DataArray, *, source: str | Path, macroscale: Mapping, contact_modulus_MPa: float
) -> xr.DataArray:
    """Contact pressure (MPa) of the square at the target pressure."""
    return solve_at_pressure(
        height,
        source=source,
        contact_modulus_MPa=contact_modulus_MPa,
        target_pressure_MPa=macroscale["target_pressure_MPa"],
        tolerance=macroscale["tolerance"],
    )[1]


def press_patch(
    faces: xr.Dataset, *, pressure_MPa: float, tolerance: float, contact_modulus_MPa: float
) -> xr.Dataset:
    """Contact of a patch at its own pressure.

    Parameters
    ----------
    faces : xarray.Dataset
        ``height`` (y, x) of the patch and, where there is one, that of the ``counterface``; mm.
    pressure_MPa, tolerance, contact_modulus_MPa : float

    Returns
    -------
    xarray.Dataset
        `faces` with ``pressure`` (MPa), ``gap`` (mm), both (y, x), and ``displacement`` (mm).
    """
    state, pressure = solve_at_pressure(
        pressed_height(faces),
        source="patch",
        contact_modulus_MPa=contact_modulus_MPa,
        target_pressure_MPa=pressure_MPa,
        tolerance=tolerance,
    )
    return faces.assign(
        pressure=pressure,
        gap=(faces.height.dims, np.asarray(state.gap)),
        displacement=state.displacement,
    )
