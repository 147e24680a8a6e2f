"""The page: what it is made of."""

import base64
import io
import json
import re

import numpy as np
import pytest
import trimesh
from gst import ROOT
from gst.config.reading import read_config
from gst.config.tables import TABLES
from gst.page import page
from gst.page.captions import caption_html, table_caption
from gst.page.figures.style import STONE
from gst.page.figures.tool import coloured_tool
from gst.page.study_page import reported
from gst.page.verdict import Answer
from gst.run.chain import given_to, step_of, write_record
from gstlib.surfaces.frames import Frame
from gstlib.surfaces.grid import make_surface
from PIL import Image

FRAME = Frame(origin=(-2, -2, 1.5), x_axis=(1, 0, 0), normal=(0, 0, 1))


@pytest.fixture
def stone():
    """A slab of 3 mm; the square is on its upper side, and a quarter of it is pressed."""
    mesh = trimesh.creation.box((20, 20, 3)).subdivide_to_size(1.5)
    pressure = make_surface(np.zeros((20, 20)), 0.2)
    pressure[:10, 10:] = 100.0
    return mesh, pressure


def opened(url):
    return Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2])))


def test_the_square_is_coloured_where_it_is_pressed(stone):
    mesh, pressure = stone
    whole, colours = coloured_tool(mesh, FRAME, pressure, faces=1000)
    assert whole.volume == pytest.approx(1200, rel=0.15)
    x, y, z = whole.vertices.T
    dark = colours.sum(axis=1) < 200
    # its upper side alone, lower right as one looks at the stone
    assert (z[dark] > 1.4).all()
    assert x[dark].min() == pytest.approx(0, abs=0.2)
    assert (x[dark].max(), y[dark].min()) == pytest.approx((2, -2), abs=0.2)
    assert y[dark].max() == pytest.approx(0, abs=0.2)
    bare = "#" + bytes(colours[z < 0][0]).hex()
    assert bare == STONE


def test_the_scene_has_its_patches_where_the_table_puts_them(stone):
    places = {"patch": ["a"], "x_mm": [3.0], "y_mm": [1.0], "rotation_deg": [90.0]}
    mesh, pressure = stone
    fields = [
        field.assign_attrs(title=title, units="MPa")
        for title, field in (("pressure", pressure), ("half of it", pressure / 2))
    ]
    scene = page.tool_scene(mesh, FRAME, fields, places, (4.0, 1.0))
    (patch,) = scene["patches"]
    # turned by a quarter: the first corner is now at the lower right
    np.testing.assert_allclose(patch["flat"][0], [3.5, 0.5])
    outline = np.array(patch["outline"])
    assert outline.min(axis=0) == pytest.approx([0.5, -1.5, 1.5])
    assert outline.max(axis=0) == pytest.approx([1.5, -0.5, 1.5])
    # y upwards: the pressed quarter, of small y, is at the picture's lower right
    picture = np.array(opened(scene["fields"][0]["map"]).convert("L"))
    assert picture[15:, 15:].max() < 60
    assert picture[:9].min() == 255
    again = page.tool_scene(mesh, FRAME, fields, places, (4.0, 1.0))
    assert json.dumps(scene) == json.dumps(again)


def test_messages_are_told_once_with_their_steps(tmp_path):
    texts = {
        "check_placement": ["patches 12, a-1: check their places"],
        "prepare_T0_scans_1": ["a.plu: only Z, is read"],
        "prepare_T0_scans_2": ["a.plu: only Z, is read"],
        "score_wear": ["a.plu: only Z, is read", "all"],
        "stale": ["of another config"],
    }
    for name, warned in texts.items():
        step = step_of(tmp_path / f"logs/{name}.log", {}, [], [])
        write_record(tmp_path, step, given_to(tmp_path, step), {"WARNING": warned})
    steps = ["absent", *list(texts)[:-1]]
    found = reported(tmp_path, steps, "WARNING")
    assert [tuple(message.values()) for message in found] == [
        ("patches 12, a-1: check their places", ["check placement"], ["12", "a-1"]),
        ("a.plu: only Z, is read", ["prepare T0 scans", "score wear"], []),
        ("all", ["score wear"], []),
    ]
    assert reported(tmp_path, steps, "ERROR") == []


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("study", ["config", "interlayer", "two_tools", "m12"])
def test_the_caption_of_a_table_explains_its_columns_with_any_config(name, study):
    config = read_config(ROOT / f"config/{study}.yaml")
    text = re.sub(r"<[^>]+>", "", caption_html(table_caption(name), config=config))
    assert not re.search(r"[{}`]|None", text)
    for column, said in TABLES[name].columns.items():
        assert f"{column}{said.unit and f' ({said.unit})'}: " in text


def test_the_answer_of_a_generated_specimen_says_so_and_texts_are_no_markup():
    answer = Answer([("Why?", "Yes", ": a < b, 5 %")], ["A mean MCC of 1 < 2.", "A mean MCC of 1."])
    for generated in (True, False):
        said = {"answer": answer, "generated": generated}
        html = page.render("page.answer.html", **said, faults=[])
        assert ("Synthetic specimen" in html) == generated
        assert "<dt>Why?</dt><dd><strong>Yes</strong>: a &lt; b, 5\xa0%</dd>" in html
    assert html.count("<abbr") == html.count("Matthews") == 1
    plain = {"answer": answer._replace(details=[]), "generated": False, "faults": []}
    assert "<details" not in page.render("page.answer.html", **plain)


def test_an_accepted_fault_is_shown_and_the_answer_withheld():
    answer, fault = (
        Answer([("Why?", "Yes", ": because")], []),
        {"text": "patches: they lie elsewhere"},
    )
    html = page.render("page.answer.html", answer=answer, generated=False, faults=[fault])
    assert fault["text"] in html
    assert "because" not in html
