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
from gst.config.tables import columns_of
from gst.page.figures.maps import FORCE_MAP
from gstlib.io.store import read_dataset
from gstlib.surfaces.footprints import square_of
from gstlib.validation.summary import statistic_names
from PIL import Image


@pytest.fixture(scope="module")
def page(results):
    return lxml.html.fromstring((results / "index.html").read_text(encoding="utf-8"))


def text_of(element):
    return " ".join(element.text_content().split())


def number(value, digits=3):
    if pd.isna(value):
        return "–"
    return f"{float(f'{value:.{digits}g}'):,.12g}".replace(",", " ").replace("-", "−")


def score(value):
    return "–" if pd.isna(value) else f"{value:.2f}".replace("-", "−")


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
    of = summary.set_index(["model", statistic_names(summary)])
    scored, cap = of.loc[("archard", "mean(mcc)")], of.value["archard_capped", "mean(mcc)"]
    assert f"a mean MCC of {score(scored.value)} " in detail
    assert f"over {scored.n} patches" in detail
    losses = table("registration")
    worn = losses[losses.above_noise & (losses.loss_fraction > 0)]
    most = worn.patch[worn.mean_wear_depth_um.idxmax()]
    assert f"{len(worn)} of {len(losses)} (patches {most}, " in answer
    yielded = detail[detail.index("If no element bears more than 800 MPa") :]
    assert f"the mean MCC is {score(cap)}, " in yielded


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


def test_the_table_of_patches_has_the_numbers_of_the_tables(page, table):
    names = "patch_pressures", "patch_intervals", "registration", "validation_patches"
    pressures, intervals, losses, scores = (table(name).set_index("patch") for name in names)
    predicted = table("wear").query("model == 'archard'").set_index("patch")
    shown = page.xpath('//*[@id="patch-table"]/tbody/tr')
    assert [text_of(row.find("th")) for row in shown] == list(pressures.index)
    assert (scores.attainable_mcc == 0).any()
    for patch, row in zip(pressures.index, shown, strict=True):
        within, score_of = intervals.loc[patch], scores.loc[patch]
        low_high = f"({number(within.low_MPa)} to {number(within.high_MPa)})"
        is_nowhere = score_of.attainable_mcc == 0  # so that none is right or wrong
        cells = [text_of(cell) for cell in row.findall("td")]
        assert cells[:-1] == [
            f"{number(pressures.pressure_MPa[patch])} {low_high}",
            number(100 * score_of.contact_fraction),
            number(100 * losses.loss_fraction[patch]),
            number(losses.loss_volume_um3[patch]),
            number(predicted.predicted_volume_um3[patch]),
            *("–" if is_nowhere else score(score_of[name]) for name in ("mcc", "attainable_mcc")),
            score(score_of.map_error),
        ]
        assert cells[-1].startswith("yes" if pressures.in_study[patch] else "no: ")


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
    for name in [*files, "microscale_paths.csv"]:
        caption = text_of(said[f"tables/{name}"])
        for column in columns_of(name.removesuffix(".csv")):
            assert column in caption
    for name, of in shown.items():
        lines = pd.read_csv(results / f"tables/{name}", dtype=str, keep_default_na=False)
        rows = [list(map(text_of, row)) for row in of.iter("tr")]
        assert rows == [list(lines.columns), *lines.to_numpy().tolist()]
        assert f"{name}, {len(lines)} rows" in text_of(of.find("summary"))
        caption = text_of(of).partition(f"{len(lines)} rows ")[2]
        assert caption.startswith(text_of(said[f"tables/{name}"]))
        assert of.xpath(f".//a[@href='tables/{name}']")
    content = (results / "index.html").read_text(encoding="utf-8")
    assert len(content) < 12e6
    assert "{{" not in content.split("<script")[0]
    assert len(page.find_class("enlarge")) > 10
