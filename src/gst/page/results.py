"""The stored results of a study, for its figures and its page."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import pandas as pd
import xarray as xr

from gst.run.stored import files_of
from gstlib.coupling.pressures import stated
from gstlib.io.meshes import read_mesh
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.surfaces.footprints import square_of
from gstlib.surfaces.frames import FRAME, Frame, stored_frame
from gstlib.validation.scoring import own_model

if TYPE_CHECKING:
    import trimesh


# Of a contact, what is drawn of it and of its load path; of the change since.
_PRESSED = "height", "pressure", "mean_pressure"
_PATH = (
    "contact_modulus",
    "path_displacement",
    "path_mean_pressure",
    "path_contact_fraction",
    "path_stiffness",
)
_CHANGED = "t1", "change", "level_of_detection", "loss", "gain"


class PatchResult(NamedTuple):
    """What the study found on one patch."""

    patch: str
    # ``height``, ``pressure`` (y, x) and ``mean_pressure`` of its contact before use.
    contact: xr.Dataset
    # ``t1``, ``change``, ``level_of_detection``, ``loss``, ``gain`` (y, x) and the attributes
    # ``level_of_detection_um``, ``overlap``. Where no change is known, ``t1`` is the scan by
    # itself. None without a T1.
    change: xr.Dataset | None
    # Depth (y, x) that the study's own prediction takes off it, mm; None if there is none.
    predicted: xr.DataArray | None


@dataclass(frozen=True)
class Results:
    """Files of a study by name, and settings; each figure and the page need some of them."""

    # a file, the folders with a file for each patch, or [] for none
    files: Mapping[str, Any]
    patches: Sequence[str] = ()
    worn: Sequence[str] = ()  # those with a T1
    max_plotted_patches: int = 0  # that are drawn one by one
    # columns ``patch, x_mm, y_mm, rotation_deg``
    places: Mapping[str, list] | None = None
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

    @cached_property
    def tables(self) -> dict[str, Path]:
        """The files of the tables by their names."""
        files = [file for file in self.files.values() if isinstance(file, Path)]
        return {file.stem: file for file in files if file.suffix == ".csv"}

    def table(self, name: str) -> pd.DataFrame:
        return read_table(self.tables[name])

    @cached_property
    def tool(self) -> "tuple[trimesh.Trimesh, Frame]":
        """The mesh, and the frame of its square."""
        mesh = read_mesh(self.files["mesh"], unit=self.mesh_unit)
        return mesh, stored_frame(self.data("surface", *FRAME))

    @property
    def outlined(self) -> pd.DataFrame:
        return pd.DataFrame(self.places)

    @property
    def losses(self) -> pd.DataFrame:
        """The losses of all patches, with ``stated_MPa``, the pressures under the given load."""
        pressures = self.table("patch_pressures")
        by_stated = pressures[["patch"]].assign(stated_MPa=stated(pressures))
        return by_stated.merge(self.table("registration"), how="left")

    @property
    def drawn(self) -> list[str]:
        """The patches of the study that are drawn one by one, most heavily loaded first."""
        table = self.table("patch_pressures")
        return self._most_loaded(table[table.in_study])

    @property
    def compared(self) -> list[str]:
        """The patches with a T1 that are drawn one by one, most heavily loaded first."""
        table = self.table("patch_pressures")
        return self._most_loaded(table[table.patch.isin(list(self.worn))])

    def _most_loaded(self, table: pd.DataFrame) -> list[str]:
        """The patches of a table or, if they are too many, some in even steps."""
        table = table.sort_values("pressure_MPa", ascending=False, kind="stable")
        patches = list(table.patch)
        count = min(len(patches), self.max_plotted_patches)
        return [patches[place * len(patches) // count] for place in range(count)]

    @cached_property
    def contacts(self) -> dict[str, xr.Dataset]:
        return self.by_patch("contacts", self.drawn, *_PRESSED, *_PATH)

    def of_patch(self, patch: str) -> PatchResult:
        """The results on one patch."""
        contact = self.by_patch("contacts", [patch], *_PRESSED)[patch]
        change = self.by_patch("registered", [patch], *_CHANGED).get(patch)
        if change is not None and change.change.isnull().all():
            change["t1"] = self.by_patch("t1", [patch], "height")[patch].height
        predicted = None
        for depths in self.by_patch("depths", [patch], "depth").values():
            own = own_model(list(depths.model.values))
            predicted = depths.depth.sel(model=own)
        return PatchResult(patch, contact, change, predicted)
