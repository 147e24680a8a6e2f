"""The page: what it is made of."""

import base64
import io
import re

import numpy as np
import pytest
import trimesh
import xarray as xr
from PIL import Image

from gst import ROOT
from gst.config.reading import read_config
from gst.config.tables import TABLES
from gst.page.captions import caption_html, table_caption
from gst.page.figures.style import STONE
from gst.page.figures.tool import coloured_tool
from gst.page.results import Results
from gst.page.scene import tool_scene
from gst.page.study_page import reported, scan_dates
from gst.page.templates import render
from gst.page.verdict import Answer
from gst.run.chain import given_to, step_of, write_record
from gstlib.io.store import write_dataset
from gstlib.surfaces.frames import Frame
from gstlib.surfaces.grid import make_surface

FRAME = Frame(origin=(-2, -2, 1.5), x_axis=(1, 0, 0), normal=(0, 0, 1))
PLACES = {
    "patch": ["a", "b"],
    "x_mm": [3.0, 1.0],
    "y_mm": [1.0, 3.0],
    "rotation_deg": [90.0, 0.0],
}


@pytest.fixture
def stone():
    """A slab of 3 mm; the square is on its upper side, and a quarter of it is pressed."""
    mesh = trimesh.creation.box((20, 20, 3)).subdivide_to_size(1.5)
    pressure = make_surface(np.zeros((20, 20)), 0.2)
    pressure[:10, 10:] = 100.0
    return mesh, pressure.assign_attrs(units="MPa")


@pytest.fixture
def scene_of(stone, tmp_path):
    """The scene of the slab, with these files beside its contact."""
    mesh, pressure = stone
    write_dataset(tmp_path / "contact.h5", pressure.to_dataset(name="pressure"))

    def scene(**files):
        files |= {"contact": tmp_path / "contact.h5"}
        study = Results(files, places=PLACES, size_mm=4.0, patch_mm=1.0)
        study.__dict__["tool"] = mesh, FRAME
        return tool_scene(study)

    return scene


def picture_of(field):
    png = base64.b64decode(field["map"].partition(",")[2])
    return np.array(Image.open(io.BytesIO(png)).convert("RGB"))


def test_the_square_is_coloured_where_it_is_pressed(stone):
    mesh, pressure = stone
    whole, colours = coloured_tool(mesh, FRAME, pressure)
    assert whole.volume == pytest.approx(1200, rel=0.15)
    dark = colours.sum(axis=1) < 200
    low, high = np.quantile(whole.vertices[dark], [0, 1], axis=0)
    # its upper side alone, lower right as one looks at the stone
    assert low == pytest.approx([0, -2, 1.5], abs=0.2)
    assert high == pytest.approx([2, 0, 1.5], abs=0.2)
    bare = colours[whole.vertices[:, 2] < 0][0]
    assert "#" + bytes(bare).hex() == STONE


def test_the_scene_has_its_patches_where_the_table_puts_them(scene_of):
    scene = scene_of()
    patch, _ = scene["patches"]
    # turned by a quarter: the first corner is now at the lower right
    np.testing.assert_allclose(patch["flat"][0], [3.5, 0.5])
    outline = np.array(patch["outline"])
    assert outline.min(axis=0) == pytest.approx([0.5, -1.5, 1.5])
    assert outline.max(axis=0) == pytest.approx([1.5, -0.5, 1.5])
    # y upwards: the pressed quarter, of small y, is at the picture's lower right
    picture = picture_of(scene["fields"][0])
    assert picture[15:, 15:].max() < 60
    assert picture[:9].min() == 255


@pytest.mark.parametrize("known", [True, False])
def test_an_unknown_loss_is_not_drawn_as_none(scene_of, tmp_path, known):
    """Of two patches, that of "b" is not known; if there is no other, none is drawn."""
    table = tmp_path / "registration.csv"
    table.write_text(f"patch,mean_wear_depth_um\na,{'2' if known else ''}\nb,\n")
    fields = scene_of(registration=table)["fields"]
    assert len(fields) == 1 + known
    if known:
        picture = picture_of(fields[1])
        assert picture[14, 15].max() < 60
        assert "#" + bytes(picture[4, 5]).hex() == STONE
        assert picture[14, 5].min() == 255
        assert fields[1]["highest"] == 2.0


def test_messages_are_told_once_with_their_steps(tmp_path):
    messages = {
        "check_placement": "patches 12, a-1: check their places",
        "prepare_T0_scans_1": "a.plu: only Z, is read",
        "prepare_T0_scans_2": "a.plu: only Z, is read",
        "score_wear": "a.plu: only Z, is read",
        "stale": "of another config",
    }
    for name, text in messages.items():
        step = step_of(tmp_path / f"logs/{name}.log", {}, [], [])
        write_record(tmp_path, step, given_to(tmp_path, step), {"WARNING": [text]})
    steps = ["absent", *list(messages)[:-1]]
    placed, read = reported(tmp_path, steps, "WARNING")
    assert placed["patches"] == ["12", "a-1"]
    assert read["steps"] == ["prepare T0 scans", "score wear"]
    assert reported(tmp_path, steps, "ERROR") == []


@pytest.mark.parametrize("study", ["config", "interlayer", "two_tools"])
def test_the_caption_of_a_table_explains_its_columns_with_any_config(study):
    config = read_config(ROOT / f"config/{study}.yaml")
    for name, described in TABLES.items():
        text = re.sub(r"<[^>]+>", "", caption_html(table_caption(name), config=config))
        assert not re.search(r"[{}`]|None", text)
        for column, entry in described.columns.items():
            unit = f" ({entry.unit})" if entry.unit else ""
            assert f"{column}{unit}: " in text


def answer_html(**content):
    """The head of a page, by default with an answer and nothing else."""
    answer = Answer([("Why?", "Yes", ": a < b, 5 %")], ["A mean MCC of 1 < 2."])
    parts = {"answer": answer, "faults": [], "load": {"held": {}}, "truth": {}}
    config = {"specimen": content.pop("specimen", None)}
    return render("page.answer.html", config=config, **parts | content)


def test_the_answer_of_a_generated_specimen_says_so_and_texts_are_no_markup():
    html = answer_html()
    assert "<dt>Why?</dt><dd><strong>Yes</strong>: a &lt; b, 5\xa0%</dd>" in html
    assert "1 &lt; 2" in html
    assert "Synthetic specimen" not in html
    generated = answer_html(specimen={"wear_placement": "summits"})
    assert "Synthetic specimen" in generated


def test_an_accepted_fault_is_shown_above_the_answer():
    fault = [{"text": "patches: they lie elsewhere"}]
    html = answer_html(faults=fault)
    assert 0 < html.index(fault[0]["text"]) < html.index("Why?")
    nothing = answer_html(faults=fault, answer=Answer([], []))
    assert "No answer could be computed" in nothing


@pytest.mark.parametrize("held", [{}, {"given": True}, {"given": False}])
def test_the_answer_says_if_the_wear_and_the_given_load_disagree(held):
    html = answer_html(load={"held": held}).replace("\xa0", " ")
    assert ("outside the 95 % region" in html) == (held == {"given": False})


def test_the_truth_is_one_line():
    html = answer_html(truth={"radius": (0, 1), "pressure": (24, 25)})
    (line,) = re.findall("<dt>Is the truth met.*", html)
    met = re.findall("<strong>(.*?)</strong>", line)
    assert met == ["radius no", "pressures 24 of 25"]


def test_the_days_of_the_scans_are_those_in_their_files(tmp_path):
    times = {
        "a_T0": "2021-03-04 10:00:00",
        "b_T0": "Tue Mar 2",
        "c_T0": "",
        "a_T1": "2021-02-03T09:00",
        "b_T1": "2021-03-05",
    }
    for name, when in times.items():
        scan = xr.Dataset(attrs={"acquired": when} if when else {})
        write_dataset(tmp_path / name[-2:] / f"1/{name}.h5", scan)
    folders = {epoch: [tmp_path / epoch.upper() / "1"] for epoch in ("t0", "t1")}
    study = Results(folders, places={"patch": ["a", "b", "c"]})
    assert scan_dates(study) == ["2021-02-03", "2021-03-05"]
    assert scan_dates(Results({}, places={"patch": []})) == []
