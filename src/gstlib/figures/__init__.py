"""Every figure of the study, drawn from stored results only: nothing is solved here.

Each function takes datasets and tables as the stages store them and returns a matplotlib figure,
which `save_figure` writes. The captions in ``workflow/report`` explain signs and colours.
"""

from gstlib.figures.macroscale import (
    contact_steps_figure,
    force_figure,
    input_figure,
    surface_figure,
)
from gstlib.figures.microscale import (
    agreement_figure,
    hardness_figure,
    load_curves_figure,
    microscale_maps_figure,
    overview_figure,
    patch_figure,
    preparation_figure,
    slip_figure,
    two_scales_figure,
)
from gstlib.figures.style import message_figure, save_figure
from gstlib.figures.tables import (
    placement_figure,
    power_figure,
    sweep_figure,
    texture_figure,
    validation_figure,
)

__all__ = ["agreement_figure", "contact_steps_figure", "force_figure", "hardness_figure"]
__all__ += ["input_figure", "load_curves_figure", "message_figure", "microscale_maps_figure"]
__all__ += ["overview_figure", "patch_figure", "placement_figure", "power_figure"]
__all__ += ["preparation_figure", "save_figure", "slip_figure", "surface_figure", "sweep_figure"]
__all__ += ["texture_figure", "two_scales_figure", "validation_figure"]
