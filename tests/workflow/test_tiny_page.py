"""The page of the tiny study says what its tables say, cell by cell.

What browsers make of it: tests/workflow/test_page_in_browser.py.
"""

import lxml.html
import numpy as np
import pandas as pd
import pytest


@pytest.fixture(scope="module")
def page(results):
    return lxml.html.fromstring((results / "index.html").read_text(encoding="utf-8"))


def text_of(element):
    return " ".join(element.text_content().split())


def number(value):
    if pd.isna(value):
        return "–"
    return f"{float(f'{value:.3g}'):,.12g}".replace(",", " ").replace("-", "−")


def score(value):
    return "–" if pd.isna(value) else f"{value:.2f}".replace("-", "−")


def test_the_table_of_patches_has_the_numbers_of_the_tables(page, table):
    names = "patch_pressures", "patch_intervals", "registration", "validation_patches"
    pressures, intervals, losses, scores = (
        table(name).set_index("patch") for name in names
    )
    wear = table("wear").query("model == 'archard'").set_index("patch")
    rows = page.xpath('//*[@id="patch-table"]/tbody/tr')
    assert [text_of(row.find("th")) for row in rows] == list(pressures.index)
    # so that none is right or wrong
    nowhere = scores.attainable_mcc == 0
    scores.loc[nowhere, ["mcc", "attainable_mcc"]] = np.nan
    assert nowhere.any()
    for patch, row in zip(pressures.index, rows, strict=True):
        *cells, in_study = (text_of(cell) for cell in row.findall("td"))
        low, high = intervals.low_MPa[patch], intervals.high_MPa[patch]
        assert cells == [
            f"{number(pressures.pressure_MPa[patch])} [{number(low)}, {number(high)}]",
            number(100 * scores.contact_fraction[patch]),
            number(100 * losses.loss_fraction[patch]),
            number(losses.loss_volume_um3[patch]),
            number(wear.predicted_volume_um3[patch]),
            score(scores.mcc[patch]),
            score(scores.attainable_mcc[patch]),
            score(scores.map_error[patch]),
        ]
        assert in_study.startswith("yes" if pressures.in_study[patch] else "no: ")


def test_every_table_is_there_as_stored_but_for_the_path_of_many_steps(results, page):
    tables = {}
    for details in page.xpath("//main//details[.//table]"):
        if links := details.xpath(".//a[starts-with(@href, 'tables/')]/@href"):
            rows = [list(map(text_of, row)) for row in details.iter("tr")]
            tables[results / links[0]] = rows
    files = set(results.glob("tables/*.csv"))
    assert files - tables.keys() == {results / "tables/microscale_paths.csv"}
    for file, rows in tables.items():
        stored = pd.read_csv(file, dtype=str, keep_default_na=False)
        assert rows == [list(stored.columns), *stored.to_numpy().tolist()]
