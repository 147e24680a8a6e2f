"""The page to open after a study, `index.html`.

It is a single file, makes no network requests, and is made from stored results alone. Beside
this module, `page.html` is its template; it takes in `page.answer.html`, `page.css` and `page.js`.
Needs the extra ``workflow``.
"""

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from gst.page.viewer import coarsen, packed, shipped, stone_data, three_js, to_script
from gstlib.surfaces.footprints import PatchPosition, outline, places_of
from gstlib.surfaces.grid import spacing_of

if TYPE_CHECKING:
    import markupsafe
    import trimesh

    from gstlib.surfaces.frames import Frame

__all__ = ["Shown", "by_category", "data_url", "embedded", "render", "tool_scene"]

# Faces of an active tool, which is drawn transparent over the first.
_SECOND_FACES = 20_000
_BESIDE = (
    0.2  # how much of the face the map shows beside the square, in sides of the square
)
_COLOURS = 256  # the most that a PNG with one byte per pixel can have


@dataclass(frozen=True)
class Shown:
    """A figure (PNG) or a table (CSV), with its category, title and caption."""

    file: Path
    category: str
    title: str
    caption: str  # HTML

    @cached_property
    def picture(self) -> str | None:
        return embedded(self.file.read_bytes()) if self.file.suffix == ".png" else None

    @cached_property
    def table(self) -> pd.DataFrame:
        # as printed: no digit is added or lost
        return pd.read_csv(self.file, dtype=str, keep_default_na=False)


def embedded(png: bytes) -> str:
    """A picture as a data URL, with fewer colours: a third of the size.

    Those of classes, which a legend names, stay as they are.
    """
    from PIL import Image, ImageColor

    from gst.page.figures.style import CLASSES

    with Image.open(io.BytesIO(png)) as picture:
        whole = picture.convert("RGB")
    # a pixel as one number: compared in a quarter of the time
    pixels = np.asarray(whole.convert("RGBA")).view(np.uint32)[..., 0]
    count = _COLOURS - len(CLASSES)
    few = whole.quantize(count, dither=Image.Dither.NONE)
    palette = (few.getpalette() or [])[: 3 * count]
    palette += [0] * (3 * count - len(palette))
    index = np.array(few)
    for number, colour in enumerate(CLASSES, count):
        rgb = ImageColor.getrgb(colour)
        index[pixels == np.array([*rgb, 255], np.uint8).view(np.uint32)] = number
        palette += rgb
    exact = Image.fromarray(index, mode="P")
    exact.putpalette(palette)
    content = io.BytesIO()
    exact.save(content, "png", compress_level=7)
    return data_url(min(content.getvalue(), png, key=len), "png")


def data_url(content: bytes, kind: str) -> str:
    """A picture of this kind, as a page has it."""
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


def tool_scene(
    mesh: "trimesh.Trimesh",
    frame: "Frame",
    fields: Sequence[xr.DataArray],
    places: Mapping[str, Sequence],
    sizes_mm: tuple[float, float],
    second: "trimesh.Trimesh | None" = None,
) -> dict[str, Any]:
    """The tool for the viewer, its square and its patches, and maps of the fields on it.

    Parameters
    ----------
    mesh, frame, fields
        As in `gst.page.figures.tool.coloured_tool`; a field has the attributes ``title`` and
        ``units``.
    places : mapping
        ``patch, x_mm, y_mm, rotation_deg``: a list each.
    sizes_mm : (float, float)
        Sides of the square and of a patch.
    second : trimesh.Trimesh, optional
        The active tool in its pose, in the tool's coordinates.

    Returns
    -------
    dict
        ``stone`` and ``second``, or None, for `gst.page.viewer`; ``frame``; ``view``, where to look
        from, with ``middle`` and ``extent``, the tool's middle, width and height from there;
        ``square`` and ``patches``: outlines on the tool (mesh's coordinates) and in the square,
        and where in it to name them;
        ``fields``: of each ``title`` and ``units``, ``colours`` on the stone, ``map`` (a data URL)
        and ``highest``; ``low`` and ``side`` (mm) of the maps, which end near the square;
        ``scale``: colours from 0 to the highest, on a square-root scale.
    """
    from matplotlib.colors import to_hex
    from matplotlib.image import imsave

    from gst.page.figures.maps import FORCE_MAP, force_norm, label_in
    from gst.page.figures.tool import coloured_tool, outline_on, tool_view

    stone, *colours = coloured_tool(mesh, frame, *fields)
    size, patch_mm = sizes_mm

    def outlined(place: PatchPosition, side: float, name: str = "") -> dict[str, list]:
        flat = outline(place, side)
        points = {
            "flat": flat,
            "outline": outline_on(stone, frame, flat, size),
            "label": label_in(flat, name),
        }
        return {kind: np.round(values, 4).tolist() for kind, values in points.items()}

    def mapped(field: xr.DataArray, of_stone: np.ndarray) -> dict[str, Any]:
        norm, png = force_norm(field.values), io.BytesIO()
        picture = FORCE_MAP(norm(field.sel(near).values))[::-1]
        imsave(png, picture, metadata={"Software": None})
        return {
            "title": field.attrs["title"],
            "units": field.attrs["units"],
            "map": embedded(png.getvalue()),
            "colours": packed(of_stone, "u1"),
            "highest": norm.vmax,
        }

    view = tool_view(stone, frame)
    across, up, _ = np.ptp(view.to_frame(stone.vertices), axis=0).tolist()
    window = slice(-_BESIDE * size, (1 + _BESIDE) * size)
    near = {"y": window, "x": window}
    shown_x = fields[0].sel(near).x
    half = spacing_of(fields[0])[0] / 2
    patches = places_of(pd.DataFrame(places))
    return {
        "stone": stone_data(stone),
        "second": stone_data(coarsen(second, faces=_SECOND_FACES)) if second else None,
        "frame": {
            "origin": list(frame.origin),
            "axes": frame.axes.tolist(),
            "size": size,
        },
        "view": view.axes[2].tolist(),
        "middle": list(map(float, view.origin)),
        "extent": [across, up],
        "square": outlined(PatchPosition(size / 2, size / 2, 0.0), size),
        "patches": [
            {"patch": patch} | outlined(place, patch_mm, str(patch))
            for patch, place in patches.items()
        ],
        "fields": list(map(mapped, fields, colours)),
        "low": round(
            float(shown_x[0]) - half, 6
        ),  # without the rounding of coordinates
        "side": float(shown_x[-1] - shown_x[0]) + 2 * half,
        "scale": [to_hex(FORCE_MAP(share)) for share in np.linspace(0, 1, 13)],
    }


def by_category(shown: Sequence[Shown]) -> list[dict[str, Any]]:
    """The categories, ``2 Macroscale`` by their number: ``id``, ``name`` and ``entries``."""
    names = sorted({one.category for one in shown})
    return [
        {
            "id": f"part-{name.split()[0]}",
            "name": name.partition(" ")[2],
            "entries": [one for one in shown if one.category == name],
        }
        for name in names
    ]


def render(template: str, **content: Any) -> str:
    """A template, filled in."""
    import jinja2

    from gst.page.figures.style import AGREEMENT

    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        undefined=jinja2.StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": _number,
        "script": to_script,
        "capfirst": _capitalised,
    }
    environment.filters |= {"breakable": _breakable, "score": _score}
    libraries = {"three_js": three_js, "shipped": shipped, "agreement": AGREEMENT}
    return environment.get_template(template).render(content | libraries) + "\n"


def _capitalised(text: str) -> str:
    """A sentence with its first letter large; the name of a file stays as it is."""
    return text[:1].upper() + text[1:] if text.split(" ")[0].isalpha() else text


def _breakable(column: str) -> "markupsafe.Markup":
    """A column's name, which may break after an underscore."""
    import markupsafe

    return markupsafe.Markup("_<wbr>").join(column.split("_"))


def _number(value: Any, digits: int = 3) -> str:
    """A number for a reader; a dash if there is none."""
    if value is None or pd.isna(value):
        return "–"
    rounded = float(f"{value:.{digits}g}")
    return f"{rounded:,.12g}".replace("-", "−").replace(",", "\u202f")


def _score(value: Any) -> str:
    """A score, or the difference of two."""
    return "–" if value is None or pd.isna(value) else f"{value:z.2f}".replace("-", "−")
