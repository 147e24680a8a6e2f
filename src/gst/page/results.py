"""The stored results of a study, for its figures and its page."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import pandas as pd
import xarray as xr

from gst.run.batches import files_of
from gstlib.coupling.pressures import stated
from gstlib.errors import InputError
from gstlib.io.meshes import read_mesh
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.surfaces.footprints import square_of
from gstlib.surfaces.frames import FRAME, Frame, stored_frame

if TYPE_CHECKING:
    import trimesh

__all__ = ["Results", "evenly"]


def evenly(patches: Sequence[str], most: int) -> list[str]:
    """At most `most` of the patches, in even steps."""
    count = min(len(patches), most)
    return [patches[place * len(patches) // count] for place in range(count)]


@dataclass(frozen=True)
class Results:
    """Files of a study by name, and settings; each figure and the page need some of them."""

    files: Mapping[
        str, Any
    ]  # a file, the folders with a file for each patch, or [] for none
    patches: Sequence[str] = ()
    worn: Sequence[str] = ()  # those with a T1
    max_plotted_patches: int = 0  # that are drawn one by one
    places: Mapping[str, list] | None = (
        None  # columns ``patch, x_mm, y_mm, rotation_deg``
    )
    size_mm: float = math.nan  # side of the square
    patch_mm: float = math.nan
    force_N: float = math.nan
    mesh_unit: str = "mm"

    def has(self, name: str) -> bool:
        return bool(self.files.get(name))

    def data(self, name: str, *only: str) -> xr.Dataset:
        return read_dataset(self.files[name], only or None)

    def square(self, name: str, *only: str) -> xr.Dataset:
        """The part of a face that lies in the square."""
        return square_of(self.data(name, *only), self.size_mm)

    def by_patch(
        self, name: str, patches: Iterable[str], *only: str
    ) -> dict[str, xr.Dataset]:
        """Datasets of the patches that have a file in these folders."""
        files = files_of(self.files.get(name, []), patches)
        return {patch: read_dataset(file, only) for patch, file in files.items()}

    def table(self, name: str, *columns: str) -> pd.DataFrame:
        return read_table(self.files[name], columns)

    @cached_property
    def tool(self) -> "tuple[trimesh.Trimesh, Frame]":
        """The mesh, and the frame of its square."""
        mesh = read_mesh(self.files["mesh"], unit=self.mesh_unit)
        return mesh, stored_frame(self.data("surface", *FRAME))

    @cached_property
    def pressures(self) -> pd.DataFrame:
        table = self.table("pressures")
        if list(table["patch"]) != list(self.patches):
            problem = "does not have exactly one row per patch"
            raise InputError(
                self.files["pressures"], problem, "Delete it and run the study again."
            )
        return table

    @property
    def by_stated_pressure(self) -> pd.DataFrame:
        """``patch, stated_MPa``, the pressures under the given load."""
        return self.pressures[["patch"]].assign(stated_MPa=stated(self.pressures))

    @cached_property
    def drawn(self) -> list[str]:
        """The patches of the study that are drawn one by one, most heavily loaded first."""
        return self._most_loaded(self.pressures.in_study)

    @cached_property
    def compared(self) -> list[str]:
        """The patches with a T1 that are drawn one by one, most heavily loaded first."""
        return self._most_loaded(self.pressures.patch.isin(list(self.worn)))

    def _most_loaded(self, among: pd.Series) -> list[str]:
        table = self.pressures[among].sort_values(
            "pressure_MPa", ascending=False, kind="stable"
        )
        return evenly(list(table.patch), self.max_plotted_patches)

    @cached_property
    def contacts(self) -> dict[str, xr.Dataset]:
        path = "displacement", "mean_pressure", "contact_fraction", "stiffness"
        drawn = "height", "pressure", "mean_pressure", "contact_modulus"
        return self.by_patch(
            "contacts", self.drawn, *drawn, *(f"path_{name}" for name in path)
        )
