"""The page of the tiny study says what its tables say, cell by cell.

What browsers make of it: tests/workflow/test_page_in_browser.py.
"""

import base64
import io
import json
import re

import lxml.html
import numpy as np
import pandas as pd
import pytest
from gst.figures.maps import FORCE_MAP
from gst.tables import columns_of
from gst.verdict import MODELS
from gstlib.io.store import read_dataset
from gstlib.surfaces.footprints import square_of
from PIL import Image


@pytest.fixture(scope="module")
def page(results):
    return lxml.html.fromstring((results / "index.html").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def known(table):
    """What the tables have of each patch, in one row; of wear, the study's own prediction."""
    joined = table("patch_pressures").set_index("patch").drop(columns="rotation_deg")
    for name in ("patch_intervals", "registration", "validation_patches", "wear", "placement"):
        of = table(name)
        of = of[of.model == "archard"] if name == "wear" else of
        of = of.set_index("patch")
        joined = joined.join(of[[column for column in of if column not in joined]])
    pressed = table("microscale_summary").set_index("patch")
    return joined.join(pressed.displacement_um)


def text_of(element):
    return " ".join(element.text_content().split())


def number(value, digits=3):
    if pd.isna(value):
        return "–"
    return f"{float(f'{value:.{digits}g}'):,.12g}".replace(",", " ").replace("-", "−")


def score(value):
    return "–" if pd.isna(value) else f"{value:.2f}".replace("-", "−")


def interval(row):
    return f"({number(row.low_MPa)} to {number(row.high_MPa)})"


def test_the_answer_stands_first_with_the_numbers_of_the_tables(results, page, table):
    assert "Synthetic specimen" in text_of(page.find_class("mark")[0])
    (shown,) = page.find_class("verdict")
    answer, (detail,) = text_of(shown.find("dl")), map(text_of, shown.findall("details"))
    pressures, summary = table("patch_pressures"), table("validation_summary")
    top = pressures.sort_values("pressure_MPa").patch.iloc[-1]
    assert f"patch {top} bears the highest pressure" in answer
    borne = pressures.force_N.sum() / 550
    assert (
        f"the {len(pressures)} patches, which bear {borne:.0%} of the force".replace("%", " %")
        in answer
    )
    of = summary.set_index(["model", "statistic"])
    scored, cap = of.loc[("archard", "mean(mcc)")], of.value["archard_capped", "mean(mcc)"]
    assert f"a mean MCC of {score(scored.value)} " in detail
    assert f"over {scored.n} patches" in detail
    losses = table("registration")
    worn = losses[losses.above_noise & (losses.loss_fraction > 0)]
    most = worn.patch[worn.mean_wear_depth_um.idxmax()]
    assert f"{len(worn)} of {len(losses)} (patches {most}, " in answer
    yielded = detail[detail.index("If no element bears more than 800 MPa") :]
    assert f"the mean MCC is {score(cap)}, " in yielded


def test_the_patches_are_listed_as_the_tables_have_them(page, known):
    """What is shown, under which heading and unit, and what the table is sorted by."""
    (listed,) = page.xpath('//table[@id="patch-table"]')
    columns = {
        "Patch": ("Index", lambda row: row.Index),
        "Pressure MPa, 95 % interval": (
            "pressure_MPa",
            lambda row: f"{number(row.pressure_MPa)} {interval(row)}",
        ),
        "Contact %": ("contact_fraction", lambda row: number(100 * row.contact_fraction)),
        "Loss %": ("loss_fraction", lambda row: number(100 * row.loss_fraction)),
        "Volume lost µm³": ("loss_volume_um3", lambda row: number(row.loss_volume_um3)),
        "Predicted µm³": ("predicted_volume_um3", lambda row: number(row.predicted_volume_um3)),
        "MCC": ("mcc", lambda row: score(row.mcc)),
        "Attainable": ("attainable_mcc", lambda row: score(row.attainable_mcc)),
        "Map error": ("map_error", lambda row: score(row.map_error)),
        "In the study": ("in_study", lambda row: "yes" if row.in_study else f"no: {row.reason}"),
    }
    assert [text_of(head) for head in listed.findall("thead/tr/th")] == list(columns)
    rows = listed.findall("tbody/tr")
    nothing = known.attainable_mcc == 0  # no place is predicted, so none is right or wrong
    scores = {name: known[name].mask(nothing) for name in ("mcc", "attainable_mcc")}
    known = known.assign(**scores)
    for cells, row in zip(rows, known.itertuples(), strict=True):
        for cell, (name, shown) in zip(cells, columns.values(), strict=True):
            assert text_of(cell) == shown(row), name
        values = [cell.get("data-value") for cell in cells]
        assert (values[0], values[-1]) == (row.Index, "yes" if row.in_study else "no")
        for value, (name, _) in zip(values[1:-1], list(columns.values())[1:-1], strict=True):
            assert float(value or "nan") == pytest.approx(getattr(row, name), nan_ok=True)


def test_a_card_says_what_is_known_of_its_patch(page, known, table):
    models = table("wear").set_index(["patch", "model"]).mcc
    cards = {card.get("id"): card for card in page.find_class("card")}
    assert list(cards) == [f"patch-{patch}" for patch in known.index]
    for row in known.itertuples():
        card = cards[f"patch-{row.Index}"]
        assert len(card.find_class("enlarge")) == 1
        facts = {text_of(fact[0]): text_of(fact[1]) for fact in card.findall(".//dl/div")}
        worn = f"{number(100 * row.loss_fraction)} % of the known area, "
        deep = number(row.mean_depth_where_worn_um)
        worn += f"{number(row.loss_volume_um3)} µm³, {deep} µm deep on average"
        reached = (
            f"MCC {score(row.mcc)}; a mask of its area could reach {score(row.attainable_mcc)}"
        )
        laid = f"shift {number(row.shift_x_um)}, {number(row.shift_y_um)} µm, turn "
        laid += (
            f"{number(row.rotation_deg, 2)}°, covers {number(100 * row.overlap)} %, correlation "
        )
        laid += number(row.correlation, 4)
        assert facts == {
            "Pressure (95 % interval)": f"{number(row.pressure_MPa)} MPa {interval(row)}",
            "Highest pressure of an element of the square": f"{number(row.peak_pressure_MPa)} MPa",
            "Predicted contact": f"{number(100 * row.contact_fraction)} % of the area",
            "Measured wear": worn,
            "Volume lost, predicted from the other patches": (
                f"{number(row.predicted_volume_um3)} µm³"
            ),
            "Agreement of predicted with measured loss": reached,
            "Error of the predicted depths": f"{score(row.map_error)} times that of no loss",
            "Against chance": f"p = {number(row.p_value, 2)}"
            if row.p_value == row.p_value
            else f"not tested: {row.untested}",
            "In the statistics over patches": "yes" if row.in_statistics else "no",
            "T1 on T0": laid,
            "Smallest change detected": f"{number(row.level_of_detection_um, 2)} µm",
            "Position on the mesh": row.status,
        } | ({"Displacement": f"{number(row.displacement_um)} µm"} if row.in_study else {})
        others = text_of(card.find_class("others")[0]).removeprefix("MCC of others: ")
        assert others.removesuffix(".").split("; ") == [
            f"{words} {score(models[row.Index, name])}"
            for name, words in MODELS.items()
            if name != "archard" and (row.Index, name) in models
        ]


def test_the_map_is_that_of_the_last_load_step_or_of_the_loss(results, page, table):
    contact = read_dataset(results / "macroscale/contact.h5", only=["pressure"])
    pressure = square_of(contact, 5.0).pressure.values
    shown, loss = page.xpath('//*[@id="map"]//image')
    assert loss.get("display") == "none"
    content = base64.b64decode(shown.get("href").partition(",")[2])
    colours = np.asarray(Image.open(io.BytesIO(content)).convert("RGB"))[::-1].astype(int)
    expected = 255 * FORCE_MAP(np.sqrt(pressure / pressure.max()))[..., :3]
    assert np.abs(colours - expected).max() < 12  # of fewer colours
    bar, lost = page.find_class("scale")
    assert text_of(bar) == f"0 {number(pressure.max())} MPa"
    deepest = table("registration").mean_wear_depth_um.max()
    assert text_of(lost) == f"0 {number(deepest)} µm"
    colours = re.findall(r"#(\w{6})", bar.find_class("bar")[0].get("style"))
    low, high = (np.array(list(bytes.fromhex(colours[end]))) for end in (0, -1))
    np.testing.assert_allclose([low, high], 255 * FORCE_MAP([0.0, 1.0])[:, :3], atol=1)
    (caption,) = page.find_class("map")[0].findall("figcaption")
    assert "under 550 N (22 MPa on the square)" in text_of(caption)


def test_every_warning_of_every_step_is_told(results, page):
    logs = (file.read_text(encoding="utf-8") for file in results.glob("logs/**/*.log"))
    raised = set(re.findall(r"^WARNING (.*)", "\n".join(logs), re.MULTILINE))
    assert len(raised) > 1
    (section,) = page.xpath('//*[@id="warnings"]')
    assert f"raised {len(raised)} warnings" in text_of(section)
    assert f"Warnings ({len(raised)})" in text_of(page.find(".//nav"))
    told = [text_of(entry).casefold() for entry in section.findall(".//li")]
    for text in raised:
        assert any(entry.startswith(text.casefold()) for entry in told)


def test_every_table_is_there_with_its_caption(results, page):
    listed = {
        text_of(of.find("summary")).split(": ", 1)[-1]: of
        for of in page.xpath("//main//details[.//table]")
    }
    shown = {name.split()[-3].rstrip(","): of for name, of in listed.items()}
    # a path of many steps is for programs
    files = {file.name for file in results.glob("tables/*.csv")} - {"microscale_paths.csv"}
    assert set(shown) == files
    contents = json.loads((results / "contents.json").read_text(encoding="utf-8"))
    said = {entry["file"]: lxml.html.fromstring(entry["caption"]) for entry in contents}
    for name, of in shown.items():
        lines = pd.read_csv(results / f"tables/{name}", dtype=str, keep_default_na=False)
        rows = [list(map(text_of, row)) for row in of.iter("tr")]
        assert rows == [list(lines.columns), *lines.to_numpy().tolist()]
        assert f"{name}, {len(lines)} rows" in text_of(of.find("summary"))
        caption = text_of(of).partition(f"{len(lines)} rows ")[2]
        assert caption.startswith(text_of(said[f"tables/{name}"]))
        for column in columns_of(name.removesuffix(".csv")):
            assert column in caption
        assert of.xpath(f".//a[@href='tables/{name}']")
    content = (results / "index.html").read_text(encoding="utf-8")
    assert len(content) < 12e6
    assert "{{" not in content.split("<script")[0]
    assert len(page.find_class("enlarge")) > 10
