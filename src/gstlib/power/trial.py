"""One generated specimen through the whole study, in one process and without the load paths.

The steps are the study's own functions with its settings; only what scores do not need is left
out: the states on the way to the target pressure, figures, and files between the stages.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import pandas as pd
import xarray as xr

from gstlib.coupling import patch_pressures, select_patches
from gstlib.preprocess.patch import clean_scan
from gstlib.specimen import SpecimenParameters, generate_specimen
from gstlib.specimen.parameters import WEAR_PLACEMENTS
from gstlib.stages import grid_square, press_patch, press_square
from gstlib.validation.change import measured_change

__all__ = ["Trial", "try_specimen"]


class Trial(NamedTuple):
    """A patch of the microscale study, with wear placed in one of the ways.

    Attributes
    ----------
    wear : str
        How it is placed, one of `WEAR_PLACEMENTS`.
    patch : str
    x_mm, y_mm : float
        Its nominal place.
    pressure : float
        Of the macroscale, MPa.
    contact : xarray.Dataset
        ``height, pressure, gap`` (y, x) and ``displacement``, at that pressure.
    registered : xarray.Dataset
        As from `gstlib.validation.change.measured_change`.
    """

    wear: str
    patch: str
    x_mm: float
    y_mm: float
    pressure: float
    contact: xr.Dataset
    registered: xr.Dataset


def try_specimen(
    patches: pd.DataFrame,
    parameters: SpecimenParameters,
    *,
    square: Mapping,
    macroscale: Mapping,
    patch_mm: float,
    scans: Mapping,
    preprocessing: Mapping,
    registration: Mapping,
    traces: Mapping,
    selection: Mapping,
    microscale: Mapping,
    contact_modulus_MPa: float,
) -> Iterator[Trial]:
    """Every patch of a specimen that the study takes, with each placement of its wear.

    The stone, its scans before use and the predictions are the same for every placement.

    Parameters
    ----------
    patches : pandas.DataFrame
        Patch table (`gstlib.io.patches.read_patches`), every patch scanned before and after use.
    parameters : SpecimenParameters
        What the specimen is made from; its ``wear_placement`` is not used.
    square, macroscale, scans, preprocessing, registration, traces, selection, microscale : mapping
        These sections of the config.
    patch_mm : float
        Side of a patch.
    contact_modulus_MPa : float
    """
    with TemporaryDirectory() as name:
        folders = {placement: Path(name) / placement for placement in WEAR_PLACEMENTS}
        for placement, folder in folders.items():
            generate_specimen(
                patches,
                mesh=folder / "mesh.stl",
                scan_folder=folder,
                truth=folder / "truth.h5",
                square_mm=square["size_mm"],
                grid=macroscale["grid"],
                parameters=replace(parameters, wear_placement=placement),
            )
        before_use = folders[WEAR_PLACEMENTS[0]]
        mesh = before_use / "mesh.stl"
        height = grid_square(
            mesh,
            mesh_unit="mm",
            square=square,
            grid=macroscale["grid"],
            margin_mm=macroscale["margin_mm"],
        )
        pressure = press_square(
            height, source=mesh, macroscale=macroscale, contact_modulus_MPa=contact_modulus_MPa
        )
        pressures = patch_pressures(pressure, patches, size_mm=patch_mm)
        reading = {
            "crop": None,
            "patch_mm": patch_mm,
            "scans": scans,
            "preprocessing": preprocessing,
        }
        for at in patches.merge(pressures[["patch", "pressure_MPa"]]).itertuples(index=False):
            if not _in_study(at, {}, selection):
                continue
            before = clean_scan(before_use / at.t0, **reading)
            contact = press_patch(
                before[["height"]],
                pressure_MPa=at.pressure_MPa,
                tolerance=microscale["tolerance"],
                contact_modulus_MPa=contact_modulus_MPa,
            )
            for placement, folder in folders.items():
                after = clean_scan(folder / at.t1, **reading)
                found, change = measured_change(before, after, **registration, **traces)
                quality = {"overlap": found.overlap, "correlation": found.detail_correlation}
                if _in_study(at, quality, selection):
                    at_place = (at.patch, at.x_mm, at.y_mm, at.pressure_MPa)
                    yield Trial(placement, *at_place, contact, change)


def _in_study(at: tuple, quality: Mapping[str, float], selection: Mapping) -> bool:
    """Whether the study takes the patch: by its pressure, and by how T1 lies over T0 if known."""
    pressures = pd.DataFrame({"patch": [at.patch], "pressure_MPa": [at.pressure_MPa]})
    registrations = pd.DataFrame([{"patch": at.patch, **quality}]) if quality else None
    return bool(select_patches(pressures, registrations, **selection).in_study.item())
