"""How much wore: predicted against measured loss."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from gstlib.figures import maps, style
from gstlib.figures.style import AMBER, BLUE, CHARTS, GREY, MM_TO_UM, VERMILION, styled

__all__ = ["wear_figure", "wear_maps_figure"]

_MODELS = {
    "archard": ("Archard's law", BLUE, "o"),
    "pressure": ("in proportion to pressure", AMBER, "s"),
    "uniform": ("the same on every patch", GREY, "v"),
    "truncation": ("cut off flat over the worn area", VERMILION, "^"),
}
_QUANTITIES = {"volume": "volume", "depth": "depth", "map": "map of depth"}


@styled
def wear_maps_figure(
    contacts: Mapping[str, xr.Dataset],
    changes: Mapping[str, xr.Dataset],
    worn: Mapping[str, xr.Dataset],
) -> Figure:
    """Measured and predicted loss of every patch, side by side, in one scale of colour.

    `contacts` hold ``height``, `changes` ``change`` and ``loss``, `worn` ``depth`` (y, x) of each
    patch.
    """
    figure, axes = style.panels(2 * len(worn), 4, (1.6, 1.6), (0.05, 0.05, 0.2, 0.25), head=0.3)
    lost = {
        patch: np.where(np.isnan(of.change), np.nan, -of.change.values * of.loss.values)
        for patch, of in changes.items()
    }
    fields = [*(lost[patch] for patch in worn), *(of.depth.values for of in worn.values())]
    norm = Normalize(0, max(float(np.nanquantile(field, 0.999)) for field in fields) * MM_TO_UM)
    panels = iter(axes)
    for patch, of in worn.items():
        for name, depth in (("measured", lost[patch]), ("predicted", of.depth.values)):
            panel, height = next(panels), contacts[patch].height
            image = maps.draw_map(panel, height, depth * MM_TO_UM, cmap=maps.FORCE_MAP, norm=norm)
            mean = np.nanmean(depth) * MM_TO_UM
            panel.set_title(f"patch {patch} {name}, mean {mean:.2f} µm", fontsize=6)
    maps.scale_bar(axes[0])
    maps.colour_bar(axes[-1], image, "height lost (µm)")
    figure.suptitle(
        "Height lost: measured, and by Archard's law with the coefficient of the others",
        y=1 - 0.08 / figure.get_figheight(),
    )
    return figure


@styled
def wear_figure(table: pd.DataFrame, summary: pd.DataFrame) -> Figure:
    """Predicted against measured volume of every patch, by model, and what the prediction is worth.

    `table` is ``wear.csv``, `summary` is ``wear_summary.csv``.
    """
    figure, (volumes, skills) = style.panels(2, 2, (2.6, 2.6), (0.7, *CHARTS[1:]), head=0.25)
    units = 1e5  # µm³
    for model, (name, colour, marker) in _MODELS.items():
        of = table[table.model == model]
        places = of.measured_volume_um3 / units, of.predicted_volume_um3 / units
        volumes.plot(*places, color=colour, marker=marker, ls="", label=name)
        if model == "archard":
            for patch, x, y in zip(of.patch, *places, strict=True):
                style.write_beside(volumes, patch, (x, y), (3, 3), color=colour)
    most = 1.05 * table[["measured_volume_um3", "predicted_volume_um3"]].to_numpy().max() / units
    volumes.plot([0, most], [0, most], color=GREY, lw=0.6)
    volumes.set(xlim=(0, most), ylim=(0, most), aspect="equal")
    volumes.set(xlabel="measured volume (10⁵ µm³)", ylabel="predicted volume (10⁵ µm³)")
    volumes.set_title("How much did each patch lose?")
    figure.legend(*volumes.get_legend_handles_labels(), loc="upper center", ncols=len(_MODELS))

    rows = summary[summary.statistic.str.startswith("skill(")]
    skills.axvline(0, color=GREY, lw=0.8)
    for place, row in enumerate(rows.itertuples()):
        colour = _MODELS[row.against][1]
        skills.plot([row.low, row.high], [place, place], color=colour)
        skills.plot(row.value, place, _MODELS[row.against][2], color=colour)
    kinds = rows.statistic.str[len("skill(") : -1].map(_QUANTITIES)
    skills.set_yticks(
        range(len(rows)), [f"{a}\nvs {b}" for a, b in zip(kinds, rows.against, strict=True)]
    )
    skills.tick_params(axis="y", labelsize=5.5)
    skills.set_xlim(max(-3, rows[["value", "low"]].min().min() - 0.1), 1)
    skills.invert_yaxis()
    skills.set_xlabel("skill of Archard's law (1: no error; 0: errs as much)")
    skills.set_title("Is it better than its rivals?")
    return figure
