"""The patches: pressed, and compared with wear by use (Figs. 7 and 9 to 11)."""

from collections.abc import Iterable, Sequence
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
from gst.page.figures.maps import Map
from gst.page.figures.style import AGREEMENT, BLACK, BLUE, styled
from gst.page.figures.tool import draw_tool
from gst.page.results import PatchResult, Results
from gstlib.surfaces.grid import MM_TO_UM, spacing_of
from gstlib.wear.archard import seen_depth

_UNKNOWN = "#ffffff"
_TILE = 280  # side (pixels) of one of the pictures that the page shows in turn
_MOST_COMPARED = 8  # patches in the figure of two scales, the most heavily loaded
# Title and labels of x and y.
_CURVES = [
    ("Area in contact", "F / (E* Aₙ)", "real contact area A / Aₙ (%)"),
    ("Pressure", "far-field displacement (µm)", "mean pressure F / Aₙ (MPa)"),
    ("Stiffness", "mean pressure (MPa)", "stiffness (MPa/µm)"),
]


def microscale_maps_figure(study: Results) -> Figure:
    """Contact on every patch at its own pressure (Fig. 9)."""
    drawn = []
    for patch, contact in study.contacts.items():
        touching = contact.pressure > 0
        shares = f"{contact.mean_pressure:.1f} MPa, {100 * touching.mean():.2f} %"
        title = f"patch {patch}: {shares}"
        drawn.append(Map(title, contact.height, marks={BLACK: touching}))
    return maps.draw_maps(drawn, 4)


def two_scales_figure(study: Results) -> Figure:
    """Contact within patches, for both couplings, beside the contact of the whole square."""
    patches, scores = study.drawn[:_MOST_COMPARED], study.table("two_scales")
    others = study.by_patch("others", patches, "height", "pressure")
    variants = {"paper": others, "equilibrium": study.contacts}
    whole = study.data("reference", "contact").contact.isel(draw=0)
    f1, drawn = scores.set_index(["variant", "patch"]).f1, []
    for patch in patches:
        height, is_touched = study.contacts[patch].height, whole.sel(patch=patch)
        for variant, contacts in variants.items():
            title = f"{patch} {variant}: {f1[variant, patch]:.2f}"
            touching = contacts[patch].pressure.values > 0
            marks = _overlap(touching, is_touched.values)
            drawn.append(Map(title, contacts[patch].height, marks=marks))
        marks = {BLUE: is_touched}
        drawn.append(Map(f"{patch} whole square", height, marks=marks))
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
    title = f"contact before use: {100 * touching.mean():.2f} %"
    drawn += [Map(title, t0, marks={BLACK: touching}), measured]
    if result.predicted is not None:
        # from its median, as scans show it
        depth = seen_depth(result.predicted.values * MM_TO_UM).clip(0)
        title = f"predicted from the others: mean {depth.mean():.2g} µm"
        drawn.append(Map(title, t0.copy(data=-depth), measured.colours))
    agreement = _agreement(result)
    is_compared = BLUE in agreement
    if is_compared:
        drawn.append(Map("predicted and measured loss", t0, marks=agreement))
    figure = maps.draw_maps(drawn, 3)
    covers = "T1 was not found on T0"
    if change.change.notnull().any():
        covers = f"T1 covers {100 * change.overlap:.0f} % of T0"
    pressure = style.short(contact.mean_pressure)
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
) -> list[Map]:
    """T0 and T1 under their names, in the same colours, and the change.

    The change is 0 where noise can explain it.
    """
    t0, t1 = t0 * MM_TO_UM, change.t1 * MM_TO_UM
    colours = maps.height_colours(t0, t1)
    scans = [
        Map(name, scan, colours, bar="height (µm)")
        for name, scan in zip(names, (t0, t1), strict=True)
    ]
    is_known = change.change.notnull()
    seen = change.change.where(change.loss | change.gain | ~is_known, 0.0) * MM_TO_UM
    title = "the change is unknown"
    if is_known.any():
        percent = 100 * change.loss.where(is_known).mean()
        title = f"lost more than {change.level_of_detection_um:.2f} µm: {percent:.1f} %"
    bar = "height change (µm), 0 where not detected"
    return [*scans, Map(title, seen, _change_colours(change), bar=bar)]


def _change_colours(change: xr.Dataset) -> ScalarMappable:
    """Colours of height changes (µm): as far as nearly all of them, or twice what is detected.

    Gains have colours where there are gains.
    """
    values = np.abs(np.nan_to_num(change.change.values * MM_TO_UM))
    most = np.quantile(values, 0.995) or 1
    # NaN where no change is known
    bound = float(np.nanmax([most, 2 * change.level_of_detection_um]))
    if change.gain.any():
        return ScalarMappable(Normalize(-bound, bound), maps.CHANGE_MAP)
    return ScalarMappable(Normalize(-bound, 0), maps.LOSS_MAP)


def patch_strip(result: PatchResult) -> Image.Image:
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
    result = study.of_patch(patch) if patch else None
    agreement = _agreement(result) if result else {}
    is_compared = BLUE in agreement
    count = 2 + (result is not None) + is_compared
    figure, (whole, forces, *others) = style.panels(count, 4)
    draw_tool(whole, *study.tool, square.pressure)
    whole.set_title("1  the tool and its square\npressures on it in colour")
    maps.draw_forces(forces, square)
    pressures = study.table("patch_pressures")
    maps.draw_footprints(forces, pressures, study.patch_mm, colour=BLUE)
    force = style.short(square.pressure.sum() * np.prod(spacing_of(square)))
    whole_force = style.short(study.force_N)
    forces.set_title(f"2  contact forces on the square\n{force} of {whole_force} N")
    maps.scale_bar(forces)
    if result:
        touching = result.contact.pressure > 0
        maps.draw_map(others[0], result.contact.height, marks={BLACK: touching})
        others[0].set_title(
            f"3  predicted contact, patch {patch}\n"
            f"{result.contact.mean_pressure:.1f} MPa, "
            f"{100 * touching.mean():.1f} % of the area"
        )
        maps.scale_bar(others[0])
    if result and is_compared:
        maps.draw_map(others[1], result.contact.height, marks=agreement)
        others[1].set_title("4  measured loss\nagainst the predicted one")
        style.colour_legend(figure, AGREEMENT)
    return figure


def load_curves_figure(study: Results) -> Figure:
    """Load paths of the patches (Fig. 10), and below them that of the square (Fig. 7).

    The force on the square is that of its own elements, while the face is pressed.
    """
    figure, axes = style.panels(5, 3, 1.05)
    contacts, square = study.contacts, study.square("contact")
    reached = np.array([float(contact.mean_pressure) for contact in contacts.values()])
    shades = 0.88 * reached / max(reached.max(initial=0), 1e-9)
    colours = list(colormaps["viridis"](shades))
    _draw_paths(axes[:3], "patches", contacts.values(), colours)
    pressed = square.path_pressure
    square["path_mean_pressure"] = pressed.mean(("y", "x"))
    square["path_contact_fraction"] = (pressed > 0).mean(("y", "x"))
    _draw_paths(axes[3:], "square", [square], [BLACK])
    for panel in axes[:3]:
        ends = [line.get_xydata()[-1] for line in panel.lines]
        style.write_all(panel, list(contacts), ends, colours)
    return figure


def _draw_paths(
    panels: Sequence[Axes],
    whose: str,
    contacts: Iterable[xr.Dataset],
    colours: Iterable[Any],
) -> None:
    """Area, pressure and, if there is a panel for it, stiffness along load paths."""
    for contact, colour in zip(contacts, colours, strict=True):
        pressure = contact.path_mean_pressure
        displacement_um = contact.path_displacement * MM_TO_UM
        relative = pressure / contact.contact_modulus
        curves = [
            (relative, 100 * contact.path_contact_fraction),
            (displacement_um, pressure),
            (pressure, contact.path_stiffness / MM_TO_UM),
        ]
        for panel, curve in zip(panels, curves, strict=False):
            panel.plot(*curve, ".-", color=colour, markersize=2, linewidth=1)
    for panel, (title, x, y) in zip(panels, _CURVES, strict=False):
        panel.set(title=f"{title}, {whose}", xlabel=x, ylabel=y)
        panel.set(xlim=(0, None), ylim=(0, None))
    panels[0].locator_params(axis="x", nbins=5)
