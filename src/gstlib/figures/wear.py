"""How much wore: predicted against measured loss."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from gstlib.figures import maps, style
from gstlib.figures.style import (
    AMBER,
    BLACK,
    BLUE,
    CHARTS,
    GREEN,
    GREY,
    MM_TO_UM,
    VERMILION,
    styled,
)

__all__ = ["wear_figure", "wear_maps_figure"]

_MODELS = {
    "archard": ("Archard's law", BLUE, "o"),
    "mat": ("Archard's law with a mat", GREEN, "D"),
    "pressure": ("in proportion to pressure", AMBER, "s"),
    "uniform": ("the same on every patch", GREY, "v"),
    "truncation": ("cut off flat over the worn area", VERMILION, "^"),
}


@styled
def wear_maps_figure(
    contacts: Mapping[str, xr.Dataset],
    changes: Mapping[str, xr.Dataset],
    worn: Mapping[str, xr.Dataset],
) -> Figure:
    """Measured and predicted loss of every patch, side by side, in one scale of colour.

    `contacts` hold ``height``, `changes` ``change`` and ``loss``, `worn` ``depth`` (model, y, x) of
    each patch, of which the last is drawn, as scans see it: from its median on.
    """
    fields = {}
    for patch, of in worn.items():
        change, depth = changes[patch], of.depth.values[-1]
        lost = np.where(np.isnan(change.change), np.nan, -change.change.values * change.loss.values)
        fields[patch, "measured"] = MM_TO_UM * lost
        fields[patch, "predicted"] = MM_TO_UM * np.maximum(depth - np.median(depth), 0)
    norm = Normalize(0, max(float(np.nanquantile(field, 0.999)) for field in fields.values()))
    look = {"cmap": maps.FORCE_MAP, "norm": norm, "bar": "height lost (µm)"}
    drawn = [
        (
            f"patch {patch} {name}, mean {np.nanmean(field):.2f} µm",
            contacts[patch].height,
            look | {"values": field},
        )
        for (patch, name), field in fields.items()
    ]
    figure = maps.draw_maps(drawn, 4, 1.9, (0.05, 0.05, 0.2, 0.35), head=0.3)
    figure.suptitle(
        "Height lost: measured, and by Archard's law with the coefficient of the others",
        y=1 - 0.08 / figure.get_figheight(),
    )
    return figure


@styled
def wear_figure(table: pd.DataFrame, profile: pd.DataFrame, limits: pd.DataFrame) -> Figure:
    """Predicted against measured volume of every patch, and loss by height.

    `table` is ``wear.csv``, `profile` is ``wear_profile.csv``; `limits` is ``patch_intervals.csv``:
    a volume is in proportion to the pressure, and so is its interval.
    """
    figure, (volumes, heights) = style.panels(2, 2, (2.6, 2.6), (0.7, *CHARTS[1:]), head=0.4)
    units = 1e5  # µm³
    models = {model: of for model, of in _MODELS.items() if model in set(table.model)}
    for model, (name, colour, marker) in models.items():
        of = table[table.model == model]
        places = of.measured_volume_um3 / units, of.predicted_volume_um3 / units
        volumes.plot(*places, color=colour, marker=marker, ls="", label=name)
        if model == "archard":
            share = limits.set_index("patch").loc[of.patch]
            low, high = (share[end] / share.pressure_MPa for end in ("low_MPa", "high_MPa"))
            ends = places[1].to_numpy() * np.array([low, high])
            volumes.vlines(places[0], *ends, color=colour, lw=0.8)
            for patch, x, y in zip(of.patch, *places, strict=True):
                style.write_beside(volumes, patch, (x, y), (3, 3), color=colour)
    most = table[["measured_volume_um3", "predicted_volume_um3"]].to_numpy().max() / units
    most = 1.05 * max(most, volumes.dataLim.y1)
    volumes.plot([0, most], [0, most], color=GREY, lw=0.6)
    volumes.set(xlim=(0, most), ylim=(0, most), aspect="equal")
    volumes.set(xlabel="measured volume (10⁵ µm³)", ylabel="predicted volume (10⁵ µm³)")
    volumes.set_title("How much did each patch lose?")
    figure.legend(*volumes.get_legend_handles_labels(), loc="upper center", ncols=3)

    means = profile[profile.by == "height"].groupby(["model", "band"], sort=False).loss_um.mean()
    for model, (_, colour, marker) in ({"measured": ("", BLACK, "x")} | models).items():
        if model in means:
            heights.plot(means[model], means[model].index, color=colour, marker=marker)
    heights.annotate("× measured", (means["measured"][3], 3), (8, -3), textcoords="offset points")
    bands = ["highest\nquarter", "second", "third", "lowest\nquarter"]
    heights.set_yticks(range(1, len(bands) + 1), bands)
    heights.invert_yaxis()
    heights.set_xlim(left=0)
    heights.set_xlabel("mean loss (µm)")
    heights.set_title("At which heights?")
    return figure
