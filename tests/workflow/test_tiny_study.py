"""The whole of a study on coarse grids: what its files hold, by other means than the study's own.

That its tables are those of the library: test_measured.py. What browsers make of its page:
test_page_in_browser.py.
"""

import json

import lxml.html
import numpy as np
import pandas as pd
from specimens import specimen_config, specimen_studies, worn_patches

from gst.config.tables import TABLES, write_table
from gst.run.provenance import commit, program_hash
from gstlib.io.tables import read_table
from gstlib.use.outcome import use_of_study

from .conftest import ROOT
from .expected import assert_as_expected

# Of the tables listed, those that this study has no use for.
ABSENT = {"exposure", "places", "published"}


def test_the_study_is_as_expected(results):
    assert_as_expected(results, "tiny")


def test_every_table_is_there_and_no_other(results):
    files = {
        file.relative_to(results).as_posix(): file for file in results.rglob("*.csv")
    }
    assert set(files) == {
        one.file for name, one in TABLES.items() if name not in ABSENT
    }
    # five patches are too few to tell how the tool was used, and by which law they wore
    empty = {name for name, file in files.items() if not len(read_table(file))}
    assert empty == {"tables/predicted_losses.csv", "tables/laws.csv"}


def test_the_record_holds_the_whole_config_and_the_program(results, config):
    record = json.loads((results / "provenance.json").read_text())
    assert record["config"] == config
    assert record["software"]["commit"] == commit(ROOT)
    assert record["software"]["program"] == program_hash()


def test_the_page_has_every_table_as_stored_but_for_the_path_of_many_steps(results):
    page = lxml.html.fromstring((results / "index.html").read_text("utf-8"))
    tables = {}
    for details in page.xpath("//main//details[.//table]"):
        if links := details.xpath(".//a[starts-with(@href, 'tables/')]/@href"):
            tables[results / links[0]] = [
                [" ".join(cell.text_content().split()) for cell in row]
                for row in details.iter("tr")
            ]
    files = set(results.glob("tables/*.csv"))
    assert files - tables.keys() == {results / "tables/microscale_paths.csv"}
    for file, rows in tables.items():
        stored = pd.read_csv(file, dtype=str, keep_default_na=False)
        assert rows == [list(stored.columns), *stored.to_numpy().tolist()]


def test_the_report_holds_every_figure_and_caption(finished_tiny, tmp_path):
    report = tmp_path / "report.html"
    finished_tiny.run("--report", report)
    text = report.read_text("utf-8")
    for figure in finished_tiny.results.glob("figures/**/*.png"):
        assert str(figure.relative_to(finished_tiny.folder)) in text
    assert "{{" not in text.split("<script")[0]
    assert "results-tiny/index.html" in text  # which has the answer


def test_losses_tell_how_a_tool_was_used_as_expected(tmp_path):
    """In memory, of more patches, which wore under a load point and a radius that none stated."""
    config = specimen_config(ROOT / "config/tiny.yaml")
    config["use"] |= {"draws": 40, "rounds": 6, "particles": 500}
    patches = worn_patches(config | {"patches": str(ROOT / "config/patches.tsv")})[::2]
    patches = patches.reset_index(drop=True)
    config["specimen"] |= {"worn_off_middle_mm": (-0.8, 0.6), "worn_radius_mm": 120.0}
    ((_, study),) = specimen_studies(
        config, patches, config["specimen"]["seed"], ["archard"]
    )
    settings = study.settings["infer_use"]
    _, table, _ = use_of_study(study.composite, patches, study.registration, **settings)
    write_table(tmp_path / "tables/use.csv", table)
    assert_as_expected(tmp_path, "losses", "use")
    rows = table.set_index("parameter").loc[["load_point_y", "load_point_x", "radius"]]
    true = np.array([2.5 - 0.8, 2.5 + 0.6, 120.0])
    assert ((rows.low < true) & (true < rows.high)).all()
