"""The figures of a study, drawn from its stored results."""

import io
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from gst.page.figures import macroscale, microscale, places, tables
from gst.page.figures.microscale import PatchResult
from gst.page.figures.style import message_figure, save_figure
from gst.page.figures.use import use_figure
from gst.run.batches import files_of
from gstlib.coupling.pressures import stated
from gstlib.errors import InputError
from gstlib.io.files import write_whole
from gstlib.io.meshes import read_mesh
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.surfaces.footprints import square_of
from gstlib.surfaces.frames import FRAME, Frame, stored_frame
from gstlib.validation.scoring import own_model

if TYPE_CHECKING:
    import trimesh

__all__ = ["Study", "draw"]

# Figures of patches in the study.
OF_STUDIED = {"microscale_maps", "two_scales"}
# Figures of predicted losses.
OF_PREDICTED = {"validation", "wear"}
# Patches of the figure of two scales, the most heavily loaded.
MOST_COMPARED = 8


def evenly(patches: Sequence[str], most: int) -> list[str]:
    """At most `most` of the patches, in even steps."""
    count = min(len(patches), most)
    return [patches[place * len(patches) // count] for place in range(count)]


@dataclass(frozen=True)
class Study:
    """Files and settings that the figures are drawn from; each figure needs some of them."""

    files: Mapping[str, Any]  # by name: a file, or the folders with a file for each patch
    patches: Sequence[str] = ()
    worn: Sequence[str] = ()  # those with a T1
    most_drawn_patches: int = 0  # that are drawn one by one
    places: Mapping[str, list] | None = None  # columns ``patch, x_mm, y_mm, rotation_deg``
    size_mm: float = math.nan  # side of the square
    patch_mm: float = math.nan
    force_N: float = math.nan
    mesh_unit: str = "mm"

    def data(self, name: str, *only: str) -> xr.Dataset:
        return read_dataset(self.files[name], only or None)

    def square(self, name: str, *only: str) -> xr.Dataset:
        """The part of a face that lies in the square."""
        return square_of(self.data(name, *only), self.size_mm)

    def by_patch(self, name: str, patches: Iterable[str], *only: str) -> dict[str, xr.Dataset]:
        """Datasets of the patches that have a file in these folders."""
        found = files_of(self.files[name], patches)
        return {patch: read_dataset(file, only) for patch, file in found.items()}

    def table(self, name: str, *columns: str) -> pd.DataFrame:
        return read_table(self.files[name], columns)

    @cached_property
    def pressures(self) -> pd.DataFrame:
        table = self.table("pressures")
        if list(table["patch"]) != list(self.patches):
            problem, remedy = (
                "has not one row for each patch",
                "Delete it and run the study again.",
            )
            raise InputError(self.files["pressures"], problem, remedy)
        return table

    @cached_property
    def drawn(self) -> list[str]:
        """The patches of the study that are drawn one by one, most heavily loaded first."""
        table = self.pressures.sort_values("pressure_MPa", ascending=False, kind="stable")
        return evenly(list(table["patch"][table["in_study"]]), self.most_drawn_patches)

    @cached_property
    def contacts(self) -> dict[str, xr.Dataset]:
        path = "displacement", "mean_pressure", "contact_fraction", "stiffness"
        drawn = "height", "pressure", "mean_pressure", "contact_modulus"
        return self.by_patch("contacts", self.drawn, *drawn, *(f"path_{name}" for name in path))

    @cached_property
    def tool(self) -> "tuple[trimesh.Trimesh, Frame]":
        """The mesh, and the frame of its square."""
        mesh = read_mesh(self.files["mesh"], unit=self.mesh_unit)
        return mesh, stored_frame(self.data("surface", *FRAME))

    @cached_property
    def compared(self) -> list[str]:
        """The patches with a T1 that are drawn one by one, most heavily loaded first."""
        table = self.pressures.sort_values("pressure_MPa", ascending=False, kind="stable")
        worn = [patch for patch in table["patch"] if patch in self.worn]
        return evenly(worn, self.most_drawn_patches)

    def change(self, patch: str) -> xr.Dataset | None:
        """Height change of a patch, with T1 as it was scanned where no change is known."""
        if patch not in self.worn:
            return None
        only = "t1", "change", "level_of_detection", "loss", "gain"
        change = self.by_patch("registered", [patch], *only)[patch]
        scanned = self.by_patch("t1", [patch], "height")[patch].height
        if change.change.isnull().all():
            change["t1"] = scanned
        return change

    def predicted(self, patch: str) -> xr.DataArray | None:
        """Loss of a patch as the study predicts it, if it does."""
        found = self.by_patch("depths", [patch], "depth") if "depths" in self.files else {}
        if patch not in found:
            return None
        depth = found[patch].depth
        return depth.sel(model=own_model(list(depth.model.values)))

    def result(self, patch: str) -> PatchResult:
        """What the study found on a patch."""
        only = "height", "pressure", "mean_pressure"
        contact = self.by_patch("contacts", [patch], *only)[patch]
        return PatchResult(patch, contact, self.change(patch), self.predicted(patch))


def _inputs(study: Study) -> Figure:
    height = study.square("surface", "height")["height"]
    places = pd.DataFrame(study.places)
    return macroscale.input_figure(height, places, patch_size_mm=study.patch_mm)


def _forces(study: Study) -> Figure:
    columns = ["patch", "low_MPa", "high_MPa"]
    pressures = study.pressures.merge(study.table("intervals", *columns)[columns], on="patch")
    return macroscale.force_figure(
        study.square("contact"), pressures, patch_size_mm=study.patch_mm
    )


def _exposure(study: Study) -> Figure:
    if "proposed" not in study.files:
        fields, outlined = map(study.square, ("exposure", "contact")), study.pressures
        return macroscale.exposure_figure(*fields, outlined, patch_size_mm=study.patch_mm)
    # where nothing is scanned: the square in the face
    middle = study.size_mm / 2
    square = pd.DataFrame([{"patch": "", "x_mm": middle, "y_mm": middle, "rotation_deg": 0.0}])
    fields = map(study.data, ("exposure", "contact"))
    return macroscale.exposure_figure(*fields, square, patch_size_mm=study.size_mm)


def _places(study: Study) -> Figure:
    left = study.data("exposure", "exposure", "touched")
    sizes = {"size_mm": study.size_mm, "patch_size_mm": study.patch_mm}
    return places.places_figure(*study.tool, left, study.table("proposed"), **sizes)


def _overview(study: Study) -> Figure:
    return microscale.overview_figure(
        study.square("contact"),
        study.pressures,
        study.tool,
        study.result(study.drawn[0]) if study.drawn else None,
        patch_size_mm=study.patch_mm,
        force_N=study.force_N,
    )


def _load_curves(study: Study) -> Figure:
    return microscale.load_curves_figure(study.square("contact"), study.contacts)


def _two_scales(study: Study) -> Figure:
    drawn = study.drawn[:MOST_COMPARED]
    others = study.by_patch("others", drawn, "height", "pressure")
    touches = study.data("reference", "contact").contact.isel(draw=0)
    return microscale.two_scales_figure(
        {"levelled": others, "placed": study.contacts},
        {patch: touches.sel(patch=patch).values for patch in drawn},
        study.table("two_scales"),
    )


def _wear(study: Study) -> Figure:
    patches = study.table("patches_table", "patch", "in_statistics")
    in_statistics = patches.patch[patches.in_statistics.astype(bool)]
    wear, profile = study.table("wear"), study.table("wear_profile")
    return tables.wear_figure(wear, profile, study.table("intervals"), in_statistics)


def _validation(study: Study) -> Figure:
    under = study.pressures[["patch"]].assign(stated_MPa=stated(study.pressures))
    losses = study.table("registration", "patch").merge(under, on="patch")
    patches = study.table("patches_table", "patch")
    return tables.validation_figure(patches, losses, study.table("summary"))


def _use(study: Study) -> Figure:
    found = study.data("use")
    if not found.sizes:
        return message_figure(f"How the tool was used {found.attrs['answer']}.")
    return use_figure(
        found,
        study.table("use_table", "parameter"),
        study.table("predicted_losses", "patch") if "predicted_losses" in study.files else None,
        study.square("surface", "height")["height"],
        pd.DataFrame(study.places),
        patch_size_mm=study.patch_mm,
    )


# Figures that are not of a single patch.
_FIGURES: dict[str, Callable[[Study], Figure]] = {
    "inputs": _inputs,
    "contact_steps": lambda study: macroscale.contact_steps_figure(
        study.data("contact"), size_mm=study.size_mm
    ),
    "forces": _forces,
    "exposure": _exposure,
    "places": _places,
    "overview": _overview,
    "load_curves": _load_curves,
    "microscale_maps": lambda study: microscale.microscale_maps_figure(study.contacts),
    "two_scales": _two_scales,
    "wear": _wear,
    "validation": _validation,
    "texture": lambda study: tables.texture_figure(study.table("texture")),
    "use": _use,
}


def figure_of(name: str, study: Study) -> Figure:
    """A figure that is not of a single patch."""
    return _FIGURES[name](study)


def figures_by_patch(name: str, study: Study) -> Iterator[tuple[str, Figure]]:
    """`preparation` or `patch`: a figure for each of the patches."""
    if name == "patch":
        for patch in study.compared:
            yield patch, microscale.patch_figure(study.result(patch))
        return
    for patch in evenly(study.patches, study.most_drawn_patches):
        epochs = ["T0", "T1"] if patch in study.worn else ["T0"]
        only = "measured", "filled", "outlier"
        scans = {
            epoch: study.by_patch(epoch.lower(), [patch], *only)[patch] for epoch in epochs
        }
        yield patch, microscale.preparation_figure(scans, patch=patch)


def draw(study: Study, pictures: Mapping[str, Path], note: str | None) -> None:
    """Draw figures of a study, each with a `note` on the source, if there is one.

    `pictures` are by the figure's name and, after ``_``, its kind: the PNG, for some an SVG or a
    PDF to print, for `preparation` and `patch` a folder, for a PNG of each patch; ``strip_jpg`` is
    a folder for those of `microscale.patch_strip`.
    """
    for name in (each.removesuffix("_png") for each in pictures if each.endswith("_png")):
        png, empty = pictures[f"{name}_png"], None
        vector = pictures.get(f"{name}_svg") or pictures.get(f"{name}_pdf")
        if name in OF_STUDIED and not study.drawn:
            empty = message_figure("No patch is in the microscale study.")
        elif name in OF_PREDICTED and not len(study.table("wear")):
            empty = message_figure("No loss of a patch could be predicted from the others'.")
        if name in ("preparation", "patch"):
            for patch, figure in [("none", empty)] if empty else figures_by_patch(name, study):
                save_figure(figure, png / f"{patch}.png", source_note=note)
        else:
            save_figure(empty or figure_of(name, study), png, vector, source_note=note)
    for patch in study.compared if "strip_jpg" in pictures else ():
        content = io.BytesIO()
        microscale.patch_strip(study.result(patch)).save(content, "jpeg", quality=80)
        write_whole(pictures["strip_jpg"] / f"{patch}.jpg", content.getvalue())
