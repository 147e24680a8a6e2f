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
    figure, axes = style.panels(2 * len(worn), 4, (1.6, 1.6), (0.05, 0.05, 0.25, 0.1), head=0.5)
    lost = {
        patch: np.where(np.isnan(of.change), np.nan, -of.change.values * of.loss.values)
        for patch, of in changes.items()
    }
    deepest = max(
        [np.nanquantile(lost[patch], 0.999) for patch in worn]
        + [np.quantile(of.depth, 0.999) for of in worn.values()]
    )
    norm = Normalize(-deepest * MM_TO_UM, deepest * MM_TO_UM)
    panels = iter(axes)
    for patch, of in worn.items():
        for name, depth in (("measured", lost[patch]), ("predicted", of.depth.values)):
            panel = next(panels)
            image = maps.draw_map(
                panel,
                contacts[patch].height,
                -depth * MM_TO_UM,
                cmap=maps.CHANGE_MAP,
                norm=norm,
                marks={style.PALE: np.isnan(depth)},
            )
            mean = np.nanmean(depth) * MM_TO_UM
            panel.set_title(f"patch {patch} {name}: {mean:.2f} µm on average", fontsize=6.5)
            if panel is axes[0]:
                maps.scale_bar(panel)
    maps.colour_bar(axes[-1], image, "height change (µm)")
    figure.suptitle("Height lost by use, and by Archard's law with the coefficient of the others")
    return figure


@styled
def wear_figure(table: pd.DataFrame, summary: pd.DataFrame) -> Figure:
    """Predicted against measured volume of every patch, by model, and what the prediction is worth.

    `table` is ``wear.csv``, `summary` is ``wear_summary.csv``.
    """
    figure, (volumes, skills) = style.panels(2, 2, (2.8, 2.6), CHARTS, head=0.2)
    known = table[(table.measured_volume_um3 > 0) & (table.predicted_volume_um3 > 0)]
    span = known[["measured_volume_um3", "predicted_volume_um3"]].to_numpy()
    ends = np.array([0.8 * span.min(), 1.25 * span.max()]) if span.size else np.array([1.0, 10.0])
    volumes.plot(ends, ends, color=GREY, lw=0.6)
    for model, (name, colour, marker) in _MODELS.items():
        of = known[known.model == model]
        look = {"color": colour, "marker": marker, "ls": "", "label": name}
        volumes.plot(of.measured_volume_um3, of.predicted_volume_um3, **look)
        if model == "archard":
            at = zip(of.measured_volume_um3, of.predicted_volume_um3, strict=True)
            for patch, point in zip(of.patch, at, strict=True):
                style.write_beside(volumes, patch, point, (3, 3), color=colour)
    volumes.set(xscale="log", yscale="log", xlim=ends, ylim=ends)
    volumes.set(xlabel="measured volume (µm³)", ylabel="predicted volume (µm³)")
    volumes.set_title("How much did each patch lose?")
    volumes.legend(fontsize=6)

    rows = summary[summary.statistic.str.startswith("skill(")]
    skills.axvline(0, color=GREY, lw=0.8)
    for place, row in enumerate(rows.itertuples()):
        colour = _MODELS[row.against][1]
        skills.plot([row.low, row.high], [place, place], color=colour)
        skills.plot(row.value, place, _MODELS[row.against][2], color=colour)
    kinds = rows.statistic.str[len("skill(") : -1].map(_QUANTITIES)
    skills.set_yticks(range(len(rows)), [f"{a}\nvs {b}" for a, b in zip(kinds, rows.against, strict=True)])
    skills.tick_params(axis="y", labelsize=5.5)
    skills.set_xlim(-1.5, 1)
    skills.invert_yaxis()
    skills.set_xlabel("skill of Archard's law (1: no error; 0: errs as much)")
    skills.set_title("Is it better than its rivals?")
    return figure
