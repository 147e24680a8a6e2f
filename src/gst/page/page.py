"""The page to open after a study, `index.html`.

It is a single file, makes no network requests, and is made from stored results alone. Beside
this module, `page.html` is its template; it takes in `page.answer.html`, `page.css` and `page.js`.
Needs the extra ``workflow``.
"""

import base64
import io
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import pandas as pd
from markupsafe import Markup
from PIL import Image

from gst.page.figures.style import AGREEMENT, CLASSES
from gst.page.viewer import shipped, three_js, to_script

# The most that a PNG with one byte per pixel can have.
_COLOURS = 256


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
    whole = Image.open(io.BytesIO(png)).convert("RGB")
    exact = np.asarray(whole)
    count = _COLOURS - len(CLASSES)
    few = np.array(whole.quantize(count, dither=Image.Dither.NONE).convert("RGB"))
    # a pixel as one number
    classes = [int(colour.removeprefix("#"), 16) for colour in CLASSES]
    is_class = np.isin(exact @ [1 << 16, 1 << 8, 1], classes)
    few[is_class] = exact[is_class]
    content = io.BytesIO()
    palette = Image.fromarray(few).quantize(_COLOURS, dither=Image.Dither.NONE)
    palette.save(content, "png", compress_level=7)
    return data_url(content.getvalue(), "png")


def data_url(content: bytes, kind: str) -> str:
    """A picture of this kind, as a page has it."""
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


def render(template: str, **content: Any) -> str:
    """A template, filled in."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        undefined=jinja2.StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    filters = _number, _capitalised, _breakable, _score
    environment.filters |= {each.__name__[1:]: each for each in filters}
    environment.filters["script"] = to_script
    libraries = {"three_js": three_js, "shipped": shipped, "agreement": AGREEMENT}
    return environment.get_template(template).render(content | libraries) + "\n"


def _capitalised(text: str) -> str:
    """A sentence with its first letter large; the name of a file stays as it is."""
    return text[:1].upper() + text[1:] if text.split(" ")[0].isalpha() else text


def _breakable(column: str) -> Markup:
    """A column's name, which may break after an underscore."""
    return Markup("_<wbr>").join(column.split("_"))


def _number(value: Any, digits: int = 3) -> str:
    """A number for a reader; a dash if there is none."""
    if value is None or pd.isna(value):
        return "–"
    rounded = float(f"{value:.{digits}g}")
    return f"{rounded:z,.12g}".replace("-", "−").replace(",", "\u202f")


def _score(value: Any) -> str:
    """A score, or the difference of two."""
    return "–" if value is None or pd.isna(value) else f"{value:z.2f}".replace("-", "−")
