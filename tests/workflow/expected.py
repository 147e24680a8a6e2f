"""What a finished study has, in numbers few enough to read, beside those kept in `expected`.

Tables cell by cell. Of each field its mean, its spread, and how it leans along each axis, so that
none can be scaled, turned or mirrored unseen; so of what the page draws in space. Of each picture
the grey of 4 × 6 parts; of the page what its cells say, and the numbers in its text and drawings,
whatever the words. `make expected` renews them: read what `git diff` then shows.
"""

import base64
import io
import json
import os
import re
import shutil
from pathlib import Path

import lxml.html
import numpy as np
import pandas as pd
from PIL import Image

from gst.share.difference import compare_results, describe_changes
from gstlib.io.store import read_dataset

EXPECTED = Path(__file__).parent / "expected"
# Of the page, what is shown elsewhere: tables, programs, the specimen's solid, and versions.
ELSEWHERE = "//script | //style | //*[@id='methods'] | //main//details[.//table]"
# How much may differ with the processor: of leans, and of levels of grey.
ALLOWED = {"fields": 0.01, "pictures": 0.5}
# How the page packs numbers.
PACKED = {"vertices": "<f4", "faces": "<u4", "colours": "u1"}
DRAWN = "points", "d", "transform", "x", "y", "width", "height", "data-value", "viewBox"


def assert_as_expected(results, name, *only):
    """The results are those kept under `name`; of some studies only these tables."""
    kept = EXPECTED / name
    tables = only or [file.stem for file in results.glob("tables/*.csv")]
    facts_of = (
        {} if only else {"fields": fields_of(results), "pictures": pictures_of(results)}
    )
    page = "" if only else page_of(results / "index.html")
    if "RENEW" in os.environ:
        shutil.rmtree(kept, ignore_errors=True)
        (kept / "tables").mkdir(parents=True)
        for table in tables:
            shutil.copy(results / f"tables/{table}.csv", kept / "tables")
        for kind, rows in facts_of.items():
            rows.to_csv(kept / f"{kind}.csv", index=False, float_format="%.5g")
        if page:
            (kept / "page.txt").write_text(page, encoding="utf-8")
    changed = compare_results(kept, results, tolerance=1e-4)
    asked = changed.table.isin([f"{table}.csv" for table in only])
    changed = changed[asked if only else changed.table != "provenance"]
    assert changed.empty, describe_changes(changed)
    for kind, rows in facts_of.items():
        expected = pd.read_csv(kept / f"{kind}.csv").set_index("file")
        assert_alike(rows.set_index("file"), expected, ALLOWED[kind])
    if page:
        stored = (kept / "page.txt").read_text("utf-8")
        assert page.splitlines() == stored.splitlines()


def assert_alike(rows, expected, allowed):
    """Each number is the expected one, up to what is allowed, and a mean up to its size."""
    assert list(rows.index) == list(expected.index)
    for column in rows.columns:
        limit = allowed
        if column in ("mean", "spread"):
            limit = 2e-3 * (expected["mean"].abs() + expected.spread) + 1e-12
        wrong = ~(abs(rows[column] - expected[column]) <= limit)
        assert not wrong.any(), (column, rows[column][wrong], expected[column][wrong])


def fields_of(results):
    """A row for each array, and for each attribute that is a number."""
    numbers = {}
    for file in sorted(results.rglob("*.h5")):
        stored = read_dataset(file)
        where = file.relative_to(results).as_posix()
        for name, field in sorted(stored.variables.items()):
            # what a solver leaves over differs with the processor
            if field.dtype.kind in "biuf" and not name.endswith("residual"):
                numbers[f"{where} {name}"] = field.values
        for name, value in sorted(stored.attrs.items()):
            if isinstance(value, np.number):
                numbers[f"{where} @{name}"] = value
    for name, values in drawn_in_space(results / "index.html"):
        numbers[f"page{name}"] = values
    rows = [
        (name, *facts(np.asarray(values, float))) for name, values in numbers.items()
    ]
    columns = ["file", "count", "missing", "mean", "spread", "lean_y", "lean_x"]
    return pd.DataFrame(rows, columns=columns)


def drawn_in_space(page):
    """Each array that the page's script is given, by its name."""
    content = page.read_text("utf-8")
    scene = re.search(
        r'<script type="application/json" id="scene">(.*?)</script>', content, re.S
    )
    yield from arrays(json.loads(scene[1]) if scene else {}, "")


def arrays(value, name):
    """Each array in a value of JSON, by the names of the parts in which it lies."""
    if isinstance(value, list) and any(isinstance(part, dict) for part in value):
        value = dict(enumerate(value))
    if isinstance(value, dict):
        for key, part in value.items():
            yield from arrays(part, f"{name} {key}")
        return
    if isinstance(value, str):
        value = unpacked(value, name.split()[-1])
    if np.asarray(value).dtype.kind in "biuf":
        yield name, value


def unpacked(text, name):
    """The numbers in a text, or the grey of a picture; a text without any as it is."""
    if text.startswith("data:image"):
        content = base64.b64decode(text.partition(",")[2])
        return np.asarray(Image.open(io.BytesIO(content)).convert("L"), float)
    if kind := PACKED.get(name):
        return np.frombuffer(base64.b64decode(text), kind)
    return text


def facts(values):
    """Numbers in all and missing, mean, standard deviation, correlation with each axis."""
    measured = np.isfinite(values)
    if not measured.any():
        return values.size, values.size, 0.0, 0.0, 0.0, 0.0
    mean = values[measured].mean()
    apart = np.where(measured, values - mean, 0.0)
    spread = np.sqrt((apart**2).mean())
    lean = [0.0, 0.0]
    for axis in range(-min(values.ndim, 2), 0):
        along = np.linspace(-1, 1, values.shape[axis])
        by_step = np.moveaxis(apart, axis, -1).reshape(-1, len(along)).mean(axis=0)
        lean[axis] = (by_step * along).mean() / (spread or 1.0)
    return values.size, values.size - measured.sum(), mean, spread, *lean


def pictures_of(results):
    """Of each picture its size in pixels, and the grey of its parts from the upper left."""
    rows = []
    for file in sorted(results.glob("figures/**/*.[pj][np]g")):
        with Image.open(file) as picture:
            # the colours count, too: each channel with its own weight
            parts = picture.convert("RGB").resize((6, 4), Image.Resampling.BOX)
            grey = np.asarray(parts, float) @ [0.5, 0.3, 0.2]
            rows.append(
                (file.relative_to(results).as_posix(), *picture.size, *grey.ravel())
            )
    parts = [f"part_{row}{column}" for row in range(4) for column in range(6)]
    return pd.DataFrame(rows, columns=["file", "width", "height", *parts])


def page_of(file):
    """Lines of the page, each with what in it has digits: words, or the places of a drawing."""
    page = lxml.html.fromstring(file.read_text("utf-8"))
    for part in page.xpath(ELSEWHERE):
        part.drop_tree()
    lines = []
    for element in page.iter(lxml.html.etree.Element):
        drawn = [element.get(name) for name in DRAWN if element.get(name)]
        text = " ".join([element.text or "", *(child.tail or "" for child in element)])
        words = re.findall(r"\S*\d\S*", " ".join([*drawn, text]))
        if element.tag in ("td", "th", "dd") and len(text) < 40:
            words = " ".join([*drawn, text]).split()
        if words:
            where = element.get("id") or element.get("class") or ""
            lines.append(" ".join([f"{element.tag}{where and f'[{where}]'}:", *words]))
    return "\n".join(lines) + "\n"
