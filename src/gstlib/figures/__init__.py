"""Every picture of the study, drawn from stored results only: nothing is computed here.

Each function takes datasets and tables as the stages store them and returns a matplotlib figure,
to be written by `save_figure`. `source_note` is small print for the corner of the figure: a
generated specimen's pictures say so themselves.
"""

from gstlib.figures.inputs import input_figure, surface_figure
from gstlib.figures.macroscale import (
    contact_steps_figure,
    elastic_rigid_figure,
    force_figure,
    macroscale_curves_figure,
    patch_pressure_figure,
)
from gstlib.figures.microscale import (
    hardness_figure,
    microscale_curves_figure,
    microscale_maps_figure,
    slip_figure,
)
from gstlib.figures.placement import placement_figure
from gstlib.figures.power import power_figure
from gstlib.figures.preparation import preparation_figure
from gstlib.figures.scores import validation_figure
from gstlib.figures.style import save_figure
from gstlib.figures.sweep import sweep_figure
from gstlib.figures.texture import texture_figure
from gstlib.figures.validation import (
    overview_figure,
    patch_figure,
    published_figure,
    truth_figure,
)

__all__ = [
    "contact_steps_figure",
    "elastic_rigid_figure",
    "force_figure",
    "hardness_figure",
    "input_figure",
    "macroscale_curves_figure",
    "microscale_curves_figure",
    "microscale_maps_figure",
    "overview_figure",
    "patch_figure",
    "patch_pressure_figure",
    "placement_figure",
    "power_figure",
    "preparation_figure",
    "published_figure",
    "save_figure",
    "slip_figure",
    "surface_figure",
    "sweep_figure",
    "texture_figure",
    "truth_figure",
    "validation_figure",
]
