"""The patches: pressed, and compared with wear by use (Figs. 7 and 9 to 11)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from PIL import Image

from gst.page.figures import maps, style
from gst.page.figures.style import AGREEMENT, BLACK, BLUE, styled
from gst.page.figures.tool import draw_tool
from gst.page.results import PatchResult, Results
from gstlib.surfaces.grid import MM_TO_UM, spacing_of
from gstlib.wear.archard import seen_depth

_UNKNOWN = "#ffffff"
_TILE = 280  # side (pixels) of one of the pictures that the page shows in turn
_MOST_COMPARED = 8  # patches in the figure of two scales, the most heavily loaded
_OF_PATH: dict[str, Any] = {"marker": ".", "markersize": 2, "lw": 1}


def microscale_maps_figure(study: Results) -> Figure:
    """Contact on every patch at its own pressure (Fig. 9)."""
    drawn = []
    for patch, contact in study.contacts.items():
        touching = contact.pressure > 0
        pressure, percent = float(contact.mean_pressure), 100 * float(touching.mean())
        title = f"patch {patch}: {pressure:.1f} MPa, {percent:.2f} %"
        drawn.append((title, contact.height, {"marks": {BLACK: touching}}))
    return maps.draw_maps(drawn, 4)


def two_scales_figure(study: Results) -> Figure:
    """Contact within patches, for both couplings, beside the contact of the whole square."""
    patches, scores = study.drawn[:_MOST_COMPARED], study.table("two_scales")
    others = study.by_patch("others", patches, "height", "pressure")
    variants = {"paper": others, "equilibrium": study.contacts}
    whole = study.data("reference", "contact").contact.isel(draw=0)
    f1, drawn = scores.set_index(["variant", "patch"]).f1, []
    for patch in patches:
        is_touched = whole.sel(patch=patch)
        for variant, contacts in variants.items():
            title = f"{patch} {variant}: {f1[variant, patch]:.2f}"
            marks = _overlap(contacts[patch].pressure.values > 0, is_touched.values)
            drawn.append((title, contacts[patch].height, {"marks": marks}))
        title, height = f"{patch} whole square", study.contacts[patch].height
        drawn.append((title, height, {"marks": {BLUE: is_touched}}))
    figure = maps.draw_maps(drawn, 3 * min(2, len(patches)))
    pooled = " and ".join(f"{f1[name, 'all']:.2f} {name}" for name in variants)
    figure.suptitle(
        "Contact of the patches against one contact of the whole square at the scans' resolution\n"
        f"agreement (F1) over all patches, 1 if perfect: {pooled}"
    )
    names = "found", "missed", "not in the whole square's contact"
    style.colour_legend(figure, dict(zip(names, AGREEMENT.values(), strict=True)))
    return figure


def _overlap(predicted: np.ndarray, true: np.ndarray) -> dict[str, np.ndarray]:
    """Masks of the three kinds of `AGREEMENT` by colour."""
    masks = true & predicted, true & ~predicted, predicted & ~true
    return dict(zip(AGREEMENT.values(), masks, strict=True))


def _agreement(result: PatchResult) -> dict[str, np.ndarray]:
    """Masks of unknown change and, where they can be compared, of `AGREEMENT`, by colour.

    A loss is predicted where the scans would show one beyond the level of detection.
    """
    change, predicted = result.change, result.predicted
    if change is None:
        return {}
    is_known = change.change.notnull().values
    masks = {_UNKNOWN: ~is_known}
    if predicted is None or not is_known.any():
        return masks
    marked = is_known.copy()
    depth = seen_depth(predicted.values[is_known])
    marked[is_known] = depth > change.level_of_detection.values[is_known]
    return masks | _overlap(marked, is_known & change.loss.values)


def patch_figure(result: PatchResult) -> Figure:
    """One patch with a T1: its scans, its contact, its change and its predicted loss (Fig. 11)."""
    contact, change = result.contact, result.change
    assert change is not None  # it has a T1
    t0, touching = contact.height, contact.pressure > 0
    *drawn, measured = change_maps(t0, change, ("T0, before use", "T1, after use"))
    title = f"contact before use: {100 * float(touching.mean()):.2f} %"
    drawn += [(title, t0, {"marks": {BLACK: touching}}), measured]
    if result.predicted is not None:
        # from its median, as scans show it
        depth = seen_depth(result.predicted.values * MM_TO_UM).clip(0)
        title = f"predicted from the others: mean {depth.mean():.2g} µm"
        lost = {"colours": _change_colours(change)}
        drawn.append((title, t0.copy(data=-depth), lost))
    agreement = _agreement(result)
    is_compared = BLUE in agreement
    if is_compared:
        drawn.append(("predicted and measured loss", t0, {"marks": agreement}))
    figure = maps.draw_maps(drawn, 3)
    covers = "T1 was not found on T0"
    if change.change.notnull().any():
        covers = f"T1 covers {100 * change.overlap:.0f} % of T0"
    pressure = style.short(float(contact.mean_pressure))
    figure.suptitle(f"patch {result.patch}: {pressure} MPa, {covers}")
    if is_compared:
        is_known = ~agreement[_UNKNOWN]
        shares = {
            f"{name} {100 * agreement[colour][is_known].mean():.1f} %": colour
            for name, colour in AGREEMENT.items()
        }
        style.colour_legend(figure, shares)
    return figure


def change_maps(
    t0: xr.DataArray, change: xr.Dataset, names: Sequence[str]
) -> list[tuple[str, xr.DataArray, dict[str, Any]]]:
    """T0 and T1 under their names, in the same colours, and the change, for `maps.draw_maps`.

    The change is 0 where noise can explain it.
    """
    t0, t1 = t0 * MM_TO_UM, change.t1 * MM_TO_UM
    heights = {"colours": maps.height_colours(t0, t1), "bar": "height (µm)"}
    is_known = change.change.notnull()
    seen = change.change.where(change.loss | change.gain | ~is_known, 0.0)
    look = {
        "colours": _change_colours(change),
        "bar": "height change (µm), 0 where not detected",
    }
    title = "the change is unknown"
    if is_known.any():
        percent = 100 * float(change.loss.where(is_known).mean())
        title = f"lost more than {change.level_of_detection_um:.2f} µm: {percent:.1f} %"
    first, second = names
    return [(first, t0, heights), (second, t1, heights), (title, seen * MM_TO_UM, look)]


def _change_colours(change: xr.Dataset) -> ScalarMappable:
    """Colours of height changes (µm): as far as nearly all of them, or twice what is detected.

    Gains have colours where there are gains.
    """
    values = np.abs(np.nan_to_num(change.change.values * MM_TO_UM))
    most = np.quantile(values, 0.995) or 1
    # NaN where no change is known
    bound = float(np.nanmax([most, 2 * change.level_of_detection_um]))
    if change.gain.values.any():
        return ScalarMappable(Normalize(-bound, bound), maps.CHANGE_MAP)
    return ScalarMappable(Normalize(-bound, 0), maps.LOSS_MAP)


def patch_strip(result: PatchResult) -> "Image.Image":
    """T0, T1 and where predicted and measured loss agree, side by side, to be shown in turn.

    Heights are lit from the upper left, as a raking light shows them.
    """
    assert result.change is not None  # it has a T1
    t0, t1 = result.contact.height, result.change.t1
    agreement = maps.picture_of(t0, marks=_agreement(result))
    strip = Image.new("RGB", (3 * _TILE, _TILE))
    for number, tile in enumerate([maps.raking(t0), maps.raking(t1), agreement]):
        # rows of a picture run down, those of a scan upwards
        image = Image.fromarray(tile[::-1])
        image.thumbnail((_TILE, _TILE), Image.Resampling.BOX, reducing_gap=None)
        strip.paste(image.resize((_TILE, _TILE)), (number * _TILE, 0))
    return strip


@styled
def overview_figure(study: Results, patch: str | None = None) -> Figure:
    """The study at a glance: the tool, forces on its square, one patch's contact, measured loss.

    Panels of the patch are left out without one.
    """
    square = study.square("contact")
    result = None if patch is None else study.of_patch(patch)
    agreement = {} if result is None else _agreement(result)
    count = 2 + (result is not None) + (BLUE in agreement)
    figure, (whole, forces, *others) = style.panels(count, 4)
    draw_tool(whole, *study.tool, square.pressure)
    whole.set_title("1  the tool and its square\npressures on it in colour")
    maps.draw_forces(forces, square)
    pressures = study.table("patch_pressures")
    maps.draw_footprints(forces, pressures, study.patch_mm, colour=BLUE)
    force = float(square.pressure.sum() * np.prod(spacing_of(square)))
    shares = f"{style.short(force)} of {style.short(study.force_N)} N"
    forces.set_title(f"2  contact forces on the square\n{shares}")
    maps.scale_bar(forces)
    if result is None:
        return figure
    contact, touching = result.contact, result.contact.pressure > 0
    pressure, percent = float(contact.mean_pressure), 100 * float(touching.mean())
    maps.draw_map(others[0], contact.height, marks={BLACK: touching})
    others[0].set_title(
        f"3  predicted contact, patch {patch}\n"
        f"{pressure:.1f} MPa, {percent:.1f} % of the area"
    )
    maps.scale_bar(others[0])
    if BLUE in agreement:
        maps.draw_map(others[1], contact.height, marks=agreement)
        others[1].set_title("4  measured loss\nagainst the predicted one")
        style.colour_legend(figure, AGREEMENT)
    return figure


def load_curves_figure(study: Results) -> Figure:
    """Load paths of the patches (Fig. 10), and below them that of the square (Fig. 7).

    The force on the square is that of its own elements, while the face is pressed.
    """
    figure, axes = style.panels(5, 3, 1.05)
    area, load, stiffness, *of_square = axes
    contacts, square = study.contacts, study.square("contact")
    reached = [float(contact.mean_pressure) for contact in contacts.values()]
    shades = 0.88 * np.array(reached) / max([*reached, 1e-9])
    colours = list(colormaps["viridis"](shades))
    for path, colour in zip(contacts.values(), colours, strict=True):
        pressure = path.path_mean_pressure
        _draw_path((area, load), path, pressure, path.path_contact_fraction, colour)
        steepness = path.path_stiffness / MM_TO_UM
        stiffness.plot(pressure, steepness, color=colour, **_OF_PATH)
    pressed = square.path_pressure
    pressure, share = (field.mean(("y", "x")) for field in (pressed, pressed > 0))
    _draw_path(of_square, square, pressure, share, BLACK)
    for whose, (left, right) in {"patches": axes[:2], "square": of_square}.items():
        left.set(xlabel="F / (E* Aₙ)", ylabel="real contact area A / Aₙ (%)")
        left.locator_params(axis="x", nbins=5)
        left.set_title(f"Area in contact, {whose}")
        right.set(xlabel="far-field displacement (µm)")
        right.set(ylabel="mean pressure F / Aₙ (MPa)", title=f"Pressure, {whose}")
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
    area.plot(pressure / path.contact_modulus, 100 * share, color=colour, **_OF_PATH)
    displacement = path.path_displacement * MM_TO_UM
    load.plot(displacement, pressure, color=colour, **_OF_PATH)
