"""The patches: prepared, pressed, and compared with wear by use (Figs. 7 and 9 to 11).

Parameters that the figures share:

contacts : mapping of patch to xarray.Dataset
    ``height``, ``pressure`` (y, x) of the final state, and the load path (step):
    ``displacement``, ``mean_pressure``, ``contact_fraction``, ``stiffness``.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from PIL import Image

from gst.page.figures import maps, style
from gst.page.figures.style import (
    AGREEMENT,
    AMBER,
    BLACK,
    BLUE,
    PURPLE,
    VERMILION,
    styled,
)
from gst.page.figures.tool import draw_tool
from gstlib.surfaces.frames import Frame
from gstlib.surfaces.grid import MM_TO_UM, spacing_of
from gstlib.wear.archard import seen_depth

if TYPE_CHECKING:
    import trimesh

__all__ = [
    "PatchResult",
    "load_curves_figure",
    "microscale_maps_figure",
    "overview_figure",
]
__all__ += ["patch_figure", "patch_strip", "preparation_figure", "two_scales_figure"]

_UNKNOWN = "#ffffff"
_TILE = 280  # side (pixels) of one of the pictures that the page shows in turn
_OF_PATH: dict[str, Any] = {"marker": ".", "markersize": 2, "lw": 1}


@dataclass(frozen=True)
class PatchResult:
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


@styled
def preparation_figure(prepared: Mapping[str, xr.Dataset], *, patch: str) -> Figure:
    """A patch's scans as measured, with the points that were replaced.

    `prepared` holds for each epoch ``measured`` (NaN where unmeasured), ``filled``, ``outlier``
    (y, x), and the attributes of the prepared scan.
    """
    drawn = []
    for epoch, scan in prepared.items():
        filled, outliers = scan["filled"].values, scan["outlier"].values
        marks = {BLUE: filled & ~outliers, VERMILION: outliers}
        before, after = (scan.attrs[f"Sq_{when}_um"] for when in ("before", "after"))
        title = f"patch {patch}, {epoch}: Sq {before:.3g} µm, prepared {after:.3g} µm"
        drawn.append((title, scan["measured"], maps.HEIGHTS | {"marks": marks}))
    return maps.draw_maps(drawn, 2)


@styled
def microscale_maps_figure(contacts: Mapping[str, xr.Dataset]) -> Figure:
    """Contact on every patch at its own pressure (Fig. 9)."""
    drawn = []
    for patch, contact in contacts.items():
        touching = contact["pressure"].values > 0
        pressure = float(contact["mean_pressure"])
        title = f"patch {patch}: {pressure:.1f} MPa, {100 * touching.mean():.2f} %"
        drawn.append((title, contact["height"], {"marks": {BLACK: touching}}))
    return maps.draw_maps(drawn, 4)


def _agreement(predicted: xr.DataArray, change: xr.Dataset) -> dict[str, np.ndarray]:
    """Masks of the three kinds of `AGREEMENT` and of unknown change, by colour.

    A loss is predicted where the scans would show one beyond the level of detection.
    """
    is_measured = np.isfinite(change["change"].values)
    marked = np.zeros(is_measured.shape, dtype=bool)
    if is_measured.any():
        depth = seen_depth(predicted.values[is_measured])
        marked[is_measured] = depth > change["level_of_detection"].values[is_measured]
    loss = change["loss"].values.astype(bool) & is_measured
    masks = loss & marked, loss & ~marked, marked & ~loss, ~is_measured
    return dict(zip([*AGREEMENT.values(), _UNKNOWN], masks, strict=True))


@styled
def two_scales_figure(
    contacts: Mapping[str, Mapping[str, xr.Dataset]],
    reference: Mapping[str, np.ndarray],
    scores: pd.DataFrame,
) -> Figure:
    """Contact within patches, for both couplings, beside the contact of the whole square.

    `contacts` are those of each variant; `reference` (ny, nx) marks where the single-scale contact
    touches each patch; `scores` is ``two_scales.csv``.
    """
    f1, drawn = scores.set_index(["variant", "patch"]).f1, []
    for patch, true in reference.items():
        for variant, by_patch in contacts.items():
            height = by_patch[patch]["height"]
            touching = by_patch[patch]["pressure"].values > 0
            marks = {
                BLUE: touching & true,
                AMBER: true & ~touching,
                PURPLE: touching & ~true,
            }
            title = f"{patch} {variant}: {f1[variant, patch]:.2f}"
            drawn.append((title, height, {"marks": marks}))
        drawn.append((f"{patch} whole square", height, {"marks": {BLUE: true}}))
    columns = (len(contacts) + 1) * min(2, len(reference))
    figure = maps.draw_maps(drawn, columns)
    pooled = " and ".join(f"{f1[name, 'all']:.2f} {name}" for name in contacts)
    figure.suptitle(
        "Contact of the patches against one contact of the whole square at the scans' resolution\n"
        f"agreement (F1) over all patches: {pooled}; 1 would be perfect"
    )
    names = {
        "found": BLUE,
        "missed": AMBER,
        "not in the whole square's contact": PURPLE,
    }
    style.colour_legend(figure, names)
    return figure


@styled
def patch_figure(result: PatchResult) -> Figure:
    """One patch with a T1: its scans, its contact, its change and its predicted loss (Fig. 11)."""
    contact, change, predicted = result.contact, result.change, result.predicted
    assert change is not None  # it has a T1
    t0, t1 = contact["height"], change["t1"]
    unknown = np.isnan(change["change"].values)
    nowhere = bool(unknown.all())
    count = max(np.count_nonzero(~unknown), 1)
    touching = contact["pressure"].values > 0
    heights = maps.HEIGHTS | {"norm": maps.height_norm(t0, t1)}
    colours = change_colours(change)
    measured = colours | {
        "values": detected_change(change),
        "marks": {_UNKNOWN: unknown},
        "bar": "height change (µm), 0 where not detected",
    }
    lost_percent = 100 * change["loss"].values.sum() / count
    limit = change.attrs["level_of_detection_um"]
    lost = f"lost more than {limit:.2f} µm: {lost_percent:.1f} %"
    touched = f"contact before use: {100 * touching.mean():.2f} %"
    drawn = [
        ("T0, before use", t0, heights),
        ("T1, after use" + ", not registered to T0" * nowhere, t1, heights),
        (touched, t0, {"marks": {BLACK: touching}}),
        ("the change is unknown" if nowhere else lost, t0, measured),
    ]
    agreement = {}
    if predicted is not None:
        # from its median, as scans show it
        depth = seen_depth(predicted.values * MM_TO_UM).clip(0)
        title = f"predicted from the others: mean {depth.mean():.2g} µm"
        drawn.append((title, t0, colours | {"values": -depth}))
        if not nowhere:
            agreement = _agreement(predicted, change)
            drawn.append(("predicted and measured loss", t0, {"marks": agreement}))
    figure = maps.draw_maps(drawn, 3)
    pressure, overlap = float(contact["mean_pressure"]), change.attrs["overlap"]
    covers = (
        "T1 was not found on T0"
        if nowhere
        else f"T1 covers {100 * overlap:.0f} % of T0"
    )
    figure.suptitle(f"patch {result.patch}: {style.short(pressure)} MPa, {covers}")
    if agreement:
        percent = {
            colour: 100 * mask.sum() / count for colour, mask in agreement.items()
        }
        names = {f"{name} {percent[c]:.1f} %": c for name, c in AGREEMENT.items()}
        style.colour_legend(figure, names)
    return figure


def detected_change(change: xr.Dataset) -> np.ndarray:
    """Height change (µm), 0 where noise can explain it, NaN where it is not known."""
    values = change["change"].values * MM_TO_UM
    return np.where(change["loss"].values | change["gain"].values, values, 0.0 * values)


def change_colours(change: xr.Dataset) -> dict:
    """Colours of height changes (µm): as far as nearly all of them, or twice what is detected.

    Gains have colours where there are gains.
    """
    values = np.abs(np.nan_to_num(change["change"].values * MM_TO_UM))
    most = np.quantile(values, 0.995) or 1
    limit = change.attrs["level_of_detection_um"]  # NaN where no change is known
    bound = float(np.nanmax([most, 2 * limit]))
    if change["gain"].values.any():
        return {"cmap": maps.CHANGE_MAP, "norm": Normalize(-bound, bound)}
    return {"cmap": maps.LOSS_MAP, "norm": Normalize(-bound, 0)}


def patch_strip(result: PatchResult) -> "Image.Image":
    """T0, T1 and where predicted and measured loss agree, side by side, to be shown in turn.

    Heights are lit from the upper left, as a raking light shows them.
    """
    change, predicted = result.change, result.predicted
    assert change is not None  # it has a T1
    t0, t1 = result.contact["height"], change["t1"]
    agreement = {} if predicted is None else _agreement(predicted, change)
    tiles = maps.raking(t0), maps.raking(t1), maps.picture_of(t0, marks=agreement)
    strip = Image.new("RGB", (3 * _TILE, _TILE))
    for number, tile in enumerate(tiles):
        # rows of a picture run down, those of a scan upwards
        image = Image.fromarray(tile[::-1])
        image.thumbnail((_TILE, _TILE), Image.Resampling.BOX, reducing_gap=None)
        strip.paste(image.resize((_TILE, _TILE)), (number * _TILE, 0))
    return strip


@styled
def overview_figure(
    square: xr.Dataset,
    pressures: pd.DataFrame,
    tool: tuple["trimesh.Trimesh", Frame],
    result: PatchResult | None,
    *,
    patch_size_mm: float,
    force_N: float,
) -> Figure:
    """The study at a glance: the tool, forces on its square, one patch's contact, measured loss.

    `square` is the contact of the square under its part of `force_N`; `pressures` is
    ``patch_pressures.csv``; `tool` is the mesh, mm, and the frame of its square. Panels of the
    patch are left out for which there is no `result`.
    """
    agreement = None
    if (
        result is not None
        and result.change is not None
        and result.predicted is not None
    ):
        agreement = _agreement(result.predicted, result.change)
    count = 2 + (result is not None) + (agreement is not None)
    figure, (whole, forces, *axes) = style.panels(count, 4)
    draw_tool(whole, *tool, square["pressure"])
    whole.set_title("1  the tool and its square\npressures on it in colour")
    maps.draw_forces(forces, square)
    maps.draw_footprints(forces, pressures, patch_size_mm, colour=BLUE)
    force = float(square["pressure"].sum()) * float(np.prod(spacing_of(square)))
    shares = f"{style.short(force)} of {style.short(force_N)} N"
    forces.set_title(f"2  contact forces on the square\n{shares}")
    maps.scale_bar(forces)
    if result is not None:
        _draw_contact(axes[0], result)
        if agreement is not None:
            maps.draw_map(axes[1], result.contact["height"], marks=agreement)
            axes[1].set_title("4  measured loss\nagainst the predicted one")
            style.colour_legend(figure, AGREEMENT)
    return figure


def _draw_contact(axes: Axes, result: PatchResult) -> None:
    """The third panel of the overview: where the patch touches."""
    touching = result.contact["pressure"].values > 0
    pressure = float(result.contact["mean_pressure"])
    maps.draw_map(axes, result.contact["height"], marks={BLACK: touching})
    axes.set_title(
        f"3  predicted contact, patch {result.patch}\n"
        f"{pressure:.1f} MPa, {100 * touching.mean():.1f} % of the area"
    )
    maps.scale_bar(axes)


@styled
def load_curves_figure(
    square: xr.Dataset, contacts: Mapping[str, xr.Dataset]
) -> Figure:
    """Load paths of the patches (Fig. 10), and below them that of the square (Fig. 7).

    All are contacts with their paths; `square` is the part of the face's that lies in the square,
    on which the force is that of its own elements.
    """
    figure, axes = style.panels(5, 3, 1.05)
    area, load, stiffness, *of_square = axes
    reached = [float(contact["mean_pressure"]) for contact in contacts.values()]
    shades = 0.88 * np.array(reached) / max([*reached, 1e-9])
    colours = list(colormaps["viridis"](shades))
    for path, colour in zip(contacts.values(), colours, strict=True):
        pressure = path["path_mean_pressure"]
        _draw_path((area, load), path, pressure, path["path_contact_fraction"], colour)
        stiffness.plot(
            pressure, path["path_stiffness"] / MM_TO_UM, color=colour, **_OF_PATH
        )
    pressed = square["path_pressure"]
    pressure, share = (field.mean(("y", "x")) for field in (pressed, pressed > 0))
    _draw_path(of_square, square, pressure, share, BLACK)
    _name_path((area, load), "patches")
    _name_path(of_square, "square")
    stiffness.set(xlabel="mean pressure (MPa)", ylabel="stiffness (MPa/µm)")
    stiffness.set_title("Stiffness, patches")
    for panel in axes:
        panel.set(xlim=(0, None), ylim=(0, None))
    for panel in axes[:3]:
        ends = [line.get_xydata()[-1] for line in panel.lines]
        style.write_all(panel, list(contacts), ends, color=colours)
    return figure


def _draw_path(
    panels: Sequence[Axes],
    path: xr.Dataset,
    pressure: xr.DataArray,
    share: xr.DataArray,
    colour: Any,
) -> None:
    """Area and pressure along a load path."""
    area, load = panels
    area.plot(pressure / path["contact_modulus"], 100 * share, color=colour, **_OF_PATH)
    displacement = path["path_displacement"] * MM_TO_UM
    load.plot(displacement, pressure, color=colour, **_OF_PATH)


def _name_path(panels: Sequence[Axes], whose: str) -> None:
    """Titles and labels of the two panels of load paths."""
    area, load = panels
    area.set(xlabel="F / (E* Aₙ)", ylabel="real contact area A / Aₙ (%)")
    area.locator_params(axis="x", nbins=5)
    area.set_title(f"Area in contact, {whose}")
    load.set(xlabel="far-field displacement (µm)", ylabel="mean pressure F / Aₙ (MPa)")
    load.set_title(f"Pressure, {whose}")
