"""What the page to open after a study, `index.html`, shows: pictures and tables.

The page is a single file, makes no network requests, and is made from stored results alone. Beside
this module, `page.html` is its template; it takes in `page.answer.html`, `page.css` and `page.js`.
Needs the extra ``workflow``.
"""

import base64
import io
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd
from PIL import Image

from gst.page.figures.style import CLASSES

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
        return embedded(self.file) if self.file.suffix == ".png" else None

    @cached_property
    def table(self) -> pd.DataFrame:
        # as printed: no digit is added or lost
        return pd.read_csv(self.file, dtype=str, keep_default_na=False)


def embedded(file: Path) -> str:
    """A picture as a data URL; a PNG with fewer colours."""
    if file.suffix == ".png":
        return embedded_png(Image.open(file))
    return _data_url(file.read_bytes(), "jpeg")


def embedded_png(picture: Image.Image) -> str:
    """A picture as a data URL of a PNG, with fewer colours: a third of the size.

    Those of classes, which a legend names, stay as they are.
    """
    picture = picture.convert("RGB")
    count = _COLOURS - len(CLASSES)
    few = np.array(picture.quantize(count, dither=Image.Dither.NONE).convert("RGB"))
    exact = np.asarray(picture)
    # a pixel as one number
    classes = [int(colour.removeprefix("#"), 16) for colour in CLASSES]
    is_class = np.isin(exact @ [1 << 16, 1 << 8, 1], classes)
    few[is_class] = exact[is_class]
    palette = Image.fromarray(few).quantize(_COLOURS, dither=Image.Dither.NONE)
    content = io.BytesIO()
    palette.save(content, "png", compress_level=7)
    return _data_url(content.getvalue(), "png")


def _data_url(content: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"
