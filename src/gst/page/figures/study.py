"""The figures of a study, drawn from its stored results."""

import io
from collections.abc import Callable, Mapping
from pathlib import Path

from matplotlib.figure import Figure

from gst.page.figures import macroscale, microscale, tables
from gst.page.figures.places import places_figure
from gst.page.figures.style import message_figure, save_figure, styled
from gst.page.figures.use import use_figure
from gst.page.results import Results
from gstlib.io.files import write_whole

# Figures of patches in the study, and of predicted losses: without any, they are a sentence.
_OF_STUDIED = {"microscale_maps", "two_scales"}
_OF_PREDICTED = {"validation", "wear"}

# Figures that are not of a single patch.
_FIGURES: dict[str, Callable[[Results], Figure]] = {
    "inputs": macroscale.inputs_figure,
    "contact_steps": macroscale.contact_steps_figure,
    "forces": macroscale.forces_figure,
    "exposure": macroscale.exposure_figure,
    "places": places_figure,
    "overview": lambda study: microscale.overview_figure(study, *study.drawn[:1]),
    "load_curves": microscale.load_curves_figure,
    "microscale_maps": microscale.microscale_maps_figure,
    "two_scales": microscale.two_scales_figure,
    "wear": tables.wear_figure,
    "validation": tables.validation_figure,
    "texture": tables.texture_figure,
    "use": use_figure,
}


def _figure_of(name: str, study: Results) -> Figure:
    """A figure that is not of a single patch."""
    if name in _OF_STUDIED and not study.drawn:
        return message_figure("No patch is in the microscale study.")
    if name in _OF_PREDICTED and study.table("wear").empty:
        return message_figure(
            "No loss of a patch could be predicted from the losses of the others."
        )
    return _FIGURES[name](study)


@styled
def draw(study: Results, pictures: Mapping[str, Path], note: str | None) -> None:
    """Draw figures of a study, each with a `note` on the source, if there is one.

    `pictures` are by the figure's name and, after ``_``, its kind: the PNG, for some an SVG or a
    PDF to print. ``patch_png`` and ``strip_jpg`` are folders with a picture for each patch.
    """
    for each, file in pictures.items():
        name, _, kind = each.rpartition("_")
        if name in _FIGURES and kind == "png":
            vector = pictures.get(f"{name}_svg") or pictures.get(f"{name}_pdf")
            save_figure(_figure_of(name, study), file, vector, source_note=note)
    if "patch_png" not in pictures:
        return
    layouts: dict[tuple, Figure] = {}
    for patch in study.compared:
        result = study.of_patch(patch)
        figure = microscale.patch_figure(result)
        file = pictures["patch_png"] / f"{patch}.png"
        save_figure(figure, file, source_note=note, layouts=layouts)
        content = io.BytesIO()
        microscale.patch_strip(result).save(content, "jpeg", quality=80)
        write_whole(pictures["strip_jpg"] / f"{patch}.jpg", content.getvalue())
