"""The tool of a study for the viewer of its page, with its patches, and maps of fields on it."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.colors import to_hex
from PIL import Image

from gst.page.figures.maps import FORCE_MAP, force_colours, label_in, picture_of
from gst.page.figures.style import STONE
from gst.page.figures.tool import coloured_tool, outline_on, tool_view
from gst.page.page import embedded_png
from gst.page.results import Results
from gst.page.viewer import coarsen, packed, stone_data
from gstlib.macroscale.active_tool import ActiveTool, posed_mesh
from gstlib.surfaces.footprints import (
    PatchPosition,
    footprint_weights,
    outline,
    places_of,
    square_of,
)

# Faces of an active tool, which is drawn transparent over the first.
_SECOND_FACES = 20_000
# How much of the face the map shows beside the square, in sides of the square.
_BESIDE = 0.2
_INSIDE = 0.5  # share of an element that lies in a patch which colours it


def tool_scene(
    study: Results, active_tool: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """The tool in 3D, with pressure, measured loss and, of a gesture, exposure on it.

    Parameters
    ----------
    study : Results
    active_tool : mapping, optional
        Arguments of `ActiveTool.read`.

    Returns
    -------
    dict
        ``stone`` and ``second``, or None, for `gst.page.viewer`; ``frame``; ``view``, where to look
        from, with ``middle`` and ``extent``, the tool's middle, width and height from there;
        ``square`` and ``patches``: outlines on the tool (mesh's coordinates) and in the square,
        and where in it to name them;
        ``fields``: of each ``title`` and ``units``, ``colours`` on the stone, ``map`` (a data URL)
        and ``highest``, where a value that is not known has the colour of stone; ``low`` and
        ``side`` (mm) of the maps, which end near the square;
        ``face``: the ends of the face; ``scale``: colours from 0 to the highest.
    """
    (mesh, frame), size = study.tool, study.size_mm
    fields = _fields(study)
    stone, *colours = coloured_tool(mesh, frame, *fields)
    window = slice(-_BESIDE * size, (1 + _BESIDE) * size)
    low, high = _ends(fields[0].sel(x=window))

    def outlined(place: PatchPosition, side: float) -> dict[str, list]:
        flat = outline(place, side)
        on_tool = outline_on(stone, frame, flat, size)
        points = {"flat": flat, "outline": on_tool, "label": label_in(flat)}
        return {kind: np.round(values, 4).tolist() for kind, values in points.items()}

    patches = study.outlined
    if "places" in study.tables:
        patches = study.table("places").rename(columns={"place": "patch"})
        patches["rotation_deg"] = 0.0
    second = None
    if study.has("counterface") and active_tool:
        other = posed_mesh(ActiveTool.read(**active_tool), frame, size_mm=size)
        second = stone_data(coarsen(other, faces=_SECOND_FACES))
    view, axes = tool_view(stone, frame), frame.axes.tolist()
    return {
        "stone": stone_data(stone),
        "second": second,
        "frame": {"origin": list(frame.origin), "axes": axes, "size": size},
        "view": view.axes[2].tolist(),
        "middle": list(map(float, view.origin)),
        "extent": np.ptp(view.to_frame(stone.vertices), axis=0)[:2].tolist(),
        "square": outlined(PatchPosition(size / 2, size / 2), size),
        "patches": [
            {"patch": patch} | outlined(place, study.patch_mm)
            for patch, place in places_of(patches).items()
        ],
        "fields": [
            _mapped(field, field.sel(y=window, x=window), packed(of_stone, "u1"))
            for field, of_stone in zip(fields, colours, strict=True)
        ],
        "low": low,
        "side": high - low,
        "face": _ends(study.data("contact", "pressure").x),
        "scale": [to_hex(FORCE_MAP(share)) for share in np.linspace(0, 1, 13)],
    }


def _mapped(field: xr.DataArray, shown: xr.DataArray, on_stone: str) -> dict[str, Any]:
    """The part of a field that the map shows, its colours on the stone, and what is said of it."""
    colours = force_colours(field)
    picture = picture_of(shown, colours, {STONE: shown.isnull()})
    return {
        "title": field.title,
        "units": field.units,
        "map": embedded_png(Image.fromarray(picture[::-1])),
        "colours": on_stone,
        "highest": colours.get_clim()[1],
    }


def _ends(field: xr.DataArray) -> tuple[float, float]:
    """The coordinates at which the elements begin and end along x, without rounding errors."""
    x = field.x.values
    half = (x[1] - x[0]) / 2
    return round(float(x[0] - half), 6), round(float(x[-1] + half), 6)


def _fields(study: Results) -> list[xr.DataArray]:
    """Fields to show, with ``title`` and ``units``, of the square or, without patches, the face."""
    fields = [study.data("contact", "pressure").pressure.assign_attrs(title="pressure")]
    if study.has("exposure"):
        exposure = study.data("exposure", "exposure").exposure
        fields.append(exposure.assign_attrs(title="exposure"))
    if "places" in study.tables:
        return fields
    fields = [square_of(field, study.size_mm) for field in fields]
    if "registration" in study.tables:
        depths = study.table("registration").set_index("patch").mean_wear_depth_um
        if depths.notna().any():
            fields.insert(1, _loss_on(fields[0], study, depths))
    return fields


def _loss_on(square: xr.DataArray, study: Results, depths: pd.Series) -> xr.DataArray:
    """The mean depth that each patch lost, on the grid of the square; NaN if it is not known."""
    loss = xr.zeros_like(square)
    for patch, place in places_of(study.outlined).items():
        share = footprint_weights(square, place, study.patch_mm)
        loss.values[share > _INSIDE] = depths.get(patch, math.nan)
    return loss.assign_attrs(title="measured loss, mean over the patch", units="µm")
