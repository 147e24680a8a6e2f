"""The figures of a study, drawn from its stored results."""

import io
from collections.abc import Callable, Mapping
from pathlib import Path

import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from gst.page.figures import macroscale, microscale, places, tables
from gst.page.figures.microscale import PatchResult
from gst.page.figures.style import Layout, message_figure, save_figure
from gst.page.figures.use import use_figure
from gst.page.results import Results, evenly
from gstlib.io.files import write_whole
from gstlib.validation.scoring import own_model

__all__ = ["draw", "figure_of", "result_of"]

# Figures of patches in the study, and of predicted losses: without any, they are a sentence.
OF_STUDIED = {"microscale_maps", "two_scales"}
OF_PREDICTED = {"validation", "wear"}
# Patches of the figure of two scales, the most heavily loaded.
MOST_COMPARED = 8


def change_of(study: Results, patch: str) -> xr.Dataset | None:
    """Height change of a patch, with T1 as it was scanned where the change is unknown."""
    if patch not in study.worn:
        return None
    only = "t1", "change", "level_of_detection", "loss", "gain"
    change = study.by_patch("registered", [patch], *only)[patch]
    if change.change.isnull().all():
        change["t1"] = study.by_patch("t1", [patch], "height")[patch].height
    return change


def predicted_loss(study: Results, patch: str) -> xr.DataArray | None:
    """Loss of a patch as the study predicts it, if it does."""
    for depths in study.by_patch("depths", [patch], "depth").values():
        return depths.depth.sel(model=own_model(list(depths.model.values)))
    return None


def result_of(study: Results, patch: str) -> PatchResult:
    """The results of a study on one patch."""
    only = "height", "pressure", "mean_pressure"
    contact = study.by_patch("contacts", [patch], *only)[patch]
    return PatchResult(
        patch, contact, change_of(study, patch), predicted_loss(study, patch)
    )


def _inputs(study: Results) -> Figure:
    height = study.square("surface", "height").height
    outlined = pd.DataFrame(study.places)
    return macroscale.input_figure(height, outlined, patch_size_mm=study.patch_mm)


def _forces(study: Results) -> Figure:
    columns = ["patch", "low_MPa", "high_MPa"]
    pressures = study.pressures.merge(
        study.table("intervals", *columns)[columns], on="patch"
    )
    return macroscale.force_figure(
        study.square("contact"), pressures, patch_size_mm=study.patch_mm
    )


def _exposure(study: Results) -> Figure:
    if not study.has("proposed"):
        fields, outlined = map(study.square, ("exposure", "contact")), study.pressures
        return macroscale.exposure_figure(
            *fields, outlined, patch_size_mm=study.patch_mm
        )
    # where nothing is scanned: the square in the face
    middle = study.size_mm / 2
    square = pd.DataFrame(
        [{"patch": "", "x_mm": middle, "y_mm": middle, "rotation_deg": 0.0}]
    )
    fields = map(study.data, ("exposure", "contact"))
    return macroscale.exposure_figure(*fields, square, patch_size_mm=study.size_mm)


def _places(study: Results) -> Figure:
    left = study.data("exposure", "exposure", "touched")
    sizes = {"size_mm": study.size_mm, "patch_size_mm": study.patch_mm}
    return places.places_figure(*study.tool, left, study.table("proposed"), **sizes)


def _overview(study: Results) -> Figure:
    return microscale.overview_figure(
        study.square("contact"),
        study.pressures,
        study.tool,
        result_of(study, study.drawn[0]) if study.drawn else None,
        patch_size_mm=study.patch_mm,
        force_N=study.force_N,
    )


def _load_curves(study: Results) -> Figure:
    return microscale.load_curves_figure(study.square("contact"), study.contacts)


def _two_scales(study: Results) -> Figure:
    drawn = study.drawn[:MOST_COMPARED]
    others = study.by_patch("others", drawn, "height", "pressure")
    touches = study.data("reference", "contact").contact.isel(draw=0)
    return microscale.two_scales_figure(
        {"paper": others, "equilibrium": study.contacts},
        {patch: touches.sel(patch=patch).values for patch in drawn},
        study.table("two_scales"),
    )


def _wear(study: Results) -> Figure:
    patches = study.table("patches_table", "patch", "in_statistics")
    in_statistics = patches.patch[patches.in_statistics.astype(bool)]
    wear, profile = study.table("wear"), study.table("wear_profile")
    return tables.wear_figure(wear, profile, study.table("intervals"), in_statistics)


def _validation(study: Results) -> Figure:
    losses = study.table("registration", "patch").merge(
        study.by_stated_pressure, on="patch"
    )
    patches = study.table("patches_table", "patch")
    return tables.validation_figure(patches, losses, study.table("summary"))


def _use(study: Results) -> Figure:
    use = study.data("use")
    if not use.sizes:
        return message_figure(f"How the tool was used {use.attrs['answer']}.")
    return use_figure(
        use,
        study.table("use_table", "parameter"),
        study.table("predicted_losses", "patch")
        if study.has("predicted_losses")
        else None,
        study.square("surface", "height").height,
        pd.DataFrame(study.places),
        patch_size_mm=study.patch_mm,
    )


# Figures that are not of a single patch.
_FIGURES: dict[str, Callable[[Results], Figure]] = {
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


def figure_of(name: str, study: Results) -> Figure:
    """A figure that is not of a single patch."""
    return _FIGURES[name](study)


def draw(study: Results, pictures: Mapping[str, Path], note: str | None) -> None:
    """Draw figures of a study, each with a `note` on the source, if there is one.

    `pictures` are by the figure's name and, after ``_``, its kind: the PNG, for some an SVG or a
    PDF to print, for `preparation` and `patch` a folder, for a PNG of each patch; ``strip_jpg`` is
    a folder beside that of `patch`, for those of `microscale.patch_strip`.
    """
    for name in (
        each.removesuffix("_png") for each in pictures if each.endswith("_png")
    ):
        png = pictures[f"{name}_png"]
        vector = pictures.get(f"{name}_svg") or pictures.get(f"{name}_pdf")
        if name == "preparation":
            _draw_preparation(study, png, note)
            continue
        if name == "patch":
            _draw_compared(study, png, pictures.get("strip_jpg"), note)
            continue
        if name in OF_STUDIED and not study.drawn:
            figure = message_figure("No patch is in the microscale study.")
        elif name in OF_PREDICTED and study.table("wear").empty:
            figure = message_figure(
                "No loss of a patch could be predicted from the losses of the others."
            )
        else:
            figure = figure_of(name, study)
        save_figure(figure, png, vector, source_note=note)


def _draw_preparation(study: Results, folder: Path, note: str | None) -> None:
    """A figure for each of some patches: its scans as they are prepared."""
    layouts: dict[tuple, Layout] = {}
    for patch in evenly(study.patches, study.max_plotted_patches):
        epochs = ["T0", "T1"] if patch in study.worn else ["T0"]
        only = "measured", "filled", "outlier"
        scans = {
            epoch: study.by_patch(epoch.lower(), [patch], *only)[patch]
            for epoch in epochs
        }
        figure = microscale.preparation_figure(scans, patch=patch)
        file = folder / f"{patch}.png"
        save_figure(figure, file, source_note=note, layouts=layouts)


def _draw_compared(
    study: Results, folder: Path, strips: Path | None, note: str | None
) -> None:
    """A figure, and a strip of small pictures, for each patch that is compared."""
    layouts: dict[tuple, Layout] = {}
    for patch in study.compared:
        result = result_of(study, patch)
        figure = microscale.patch_figure(result)
        file = folder / f"{patch}.png"
        save_figure(figure, file, source_note=note, layouts=layouts)
        if strips is not None:
            content = io.BytesIO()
            microscale.patch_strip(result).save(content, "jpeg", quality=80)
            write_whole(strips / f"{patch}.jpg", content.getvalue())
