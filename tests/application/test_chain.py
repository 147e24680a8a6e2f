"""What runs again, and when results are whole: by content, in any folder and of any date."""

import json
import os
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest
from gst.chain import (
    PAGE,
    Step,
    break_in,
    certified_inputs,
    check_chain,
    check_links,
    given_to,
    made_in,
    plan_again,
    record_of,
    write_record,
)
from gst.logs import run_script
from gstlib.errors import InputError
from hypothesis import given, settings
from hypothesis import strategies as st
from snakemake.iocontainers import Namedlist

SCAN = Path("scans/1.plu")


def steps_in(results, **params):
    """A study of two steps and a page; `params` are those of the first."""
    surface, folder, page = (results / name for name in ("1.h5", "wear", "index.html"))
    rest = {"steps": ["clean", "wear"], "config": {"results": str(results)}}
    return [
        Step("clean", {"code": "a", "flip": None} | params, [SCAN], [surface]),
        Step("wear", {"code": "b", "mesh": results / "mesh.stl"}, [surface], [folder]),
        Step(PAGE, rest, [surface, folder], [page]),
    ]


def run(results, steps):
    """As a run would: each step reads, makes and records."""
    for step in steps:
        read = given_to(results, step)
        for output in step.outputs:
            file = output / "1.png" if output.suffix == "" else output
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(f"{output.name} of {read['inputs']}")
        write_record(results, step, read, {})


@pytest.fixture
def study(tmp_path, monkeypatch):
    """A finished study in the working folder, and its steps."""
    monkeypatch.chdir(tmp_path)
    SCAN.parent.mkdir()
    SCAN.write_text("heights")
    results = Path("results")
    run(results, steps := steps_in(results))
    assert plan_again(steps, results) == {}
    assert break_in(results) is None
    return results, steps


@pytest.mark.parametrize(
    ("params", "why"),
    [
        ({"flip": "x"}, 'flip was null, is "x"'),
        ({"crop": (0.0, float("nan"))}, "crop was null, is [0.0, null]"),
        ({"code": "c"}, "the program has changed"),
        ({"flip": "x" * 99}, "flip has changed"),
    ],
)
def test_another_param_is_a_reason(study, params, why):
    results, _ = study
    assert plan_again(steps_in(results, **params), results) == {"results/1.h5": why}


def rewrite(file, content):
    """Another content of the same size and date."""
    stat = file.stat()
    assert len(content) == stat.st_size
    file.write_text(content)
    os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns))


def test_a_scan_of_the_same_size_and_date_is_seen(study):
    results, steps = study
    rewrite(SCAN, "HEIGHTS")
    assert plan_again(steps, results) == {"results/1.h5": "scans/1.plu has changed"}
    assert break_in(results) == "scans/1.plu is not as the step clean read it"
    with pytest.raises(InputError, match=r"scans/1\.plu is not as the step clean read it"):
        certified_inputs(results, ["clean"], [SCAN])


def test_a_file_that_changes_while_a_step_reads_it_is_seen(study):
    results, (clean, *others) = study

    def main(scan, surface, *, flip):
        surface.write_text(f"{flip} of {scan.read_text()}")
        rewrite(SCAN, "HEIGHTS")

    files = {"input": {"scan": str(SCAN)}, "output": {"surface": str(results / "1.h5")}}
    job = {name: Namedlist(fromdict=named) for name, named in files.items()}
    log = record_of(results, "clean").with_suffix(".log")
    run_script(SimpleNamespace(**job, config={}, params=clean.params, log=[str(log)]), main)
    assert plan_again([clean, *others], results)["results/1.h5"] == "scans/1.plu has changed"


@pytest.mark.parametrize("name", ["1.h5", "wear/1.png"])
def test_what_was_edited_is_made_again(study, name):
    results, steps = study
    file = results / name
    rewrite(file, file.read_text().upper())
    step, made = ("clean", "1.h5") if name == "1.h5" else ("wear", "wear")
    again = plan_again(steps, results)
    assert again[f"results/{made}"] == f"{name} is not as it was made"
    follows = {"results/wear", "results/index.html"}
    assert again.keys() == follows | {f"results/{made}"}
    assert f"results/{name} is not as the step {step} made it" in break_in(results)


def test_what_was_removed_is_said_to_be_missing(study):
    results, steps = study
    (results / "1.h5").unlink()
    assert break_in(results) == "results/1.h5, which the step clean made, is missing"
    assert plan_again(steps, results)["results/wear"] == "1.h5 is missing"


@pytest.mark.parametrize("change", ["unlink", "add"])
def test_a_file_that_went_or_came_in_a_folder_is_seen(study, change):
    results, steps = study
    if change == "unlink":
        (results / "wear/1.png").unlink()
    else:
        (results / "wear/2.png").write_text("of another study")
    assert plan_again(steps, results).keys() == {"results/wear", "results/index.html"}


def test_a_step_without_a_whole_record_is_run_again(study):
    results, steps = study
    record = record_of(results, "wear")
    for content in (None, "", "[]", '{"params": {}}', record.read_text()[:-9]):
        record.unlink() if content is None else record.write_text(content)
        assert plan_again(steps, results) == {"results/wear": "no record says how it was made"}
        assert break_in(results) == "no record says what the step wear made"


def test_results_may_be_moved_copied_and_renamed(study, tmp_path, monkeypatch):
    """A copy has the dates of its making; no file is younger than what was made from it after."""
    results, _ = study
    other = tmp_path / "elsewhere"
    shutil.copytree(results, other / "b", copy_function=shutil.copy)
    shutil.copytree(SCAN.parent, other / SCAN.parent)
    for age, name in enumerate(("wear/1.png", "index.html", "1.h5")):  # not as they were made
        os.utime(other / "b" / name, (age, age))
    monkeypatch.chdir(other)
    moved = steps_in(renamed := Path("b"))
    assert plan_again(moved, renamed) == {}
    assert break_in(renamed) is None
    dates = {
        path: path.stat().st_mtime_ns for step in moved for path in (*step.inputs, *step.outputs)
    }
    for step in moved:
        assert max(map(dates.get, step.inputs)) <= min(map(dates.get, step.outputs))


def test_a_result_is_whole_without_the_measured_files_but_not_with_others(study):
    results, _ = study
    SCAN.rename("away")
    assert break_in(results) is None
    assert certified_inputs(results, ["clean"], [SCAN]).keys() == {str(SCAN)}
    SCAN.write_text("another")
    assert "scans/1.plu" in break_in(results)


def test_a_page_of_what_was_there_before_is_not_whole(study):
    results, (first, *_) = study
    read = given_to(results, first)
    (results / "1.h5").write_text("as a newer program makes it")
    write_record(results, first, read, {})
    assert break_in(results) == "results/1.h5 is not as the step wear read it"


def test_a_page_is_that_of_its_config(study):
    results, _ = study
    assert break_in(results, {"results": "results"}) is None
    assert break_in(results, {"results": "results", "load": 1}) == (
        "the results were made with another config"
    )
    assert break_in(Path("other")) == "this folder holds no finished study"


def test_what_was_made_is_what_the_records_of_this_study_name(study):
    results, _ = study
    (results / "2.h5").write_text("of a patch that the table no longer has")
    assert set(made_in(results)) == {
        results / name for name in ("1.h5", "wear/1.png", "index.html")
    }


ELSEWHERE = "/etc/passwd", "../private", "wear/../../private", "out/private", "\0", "", ".", "1.h5"
ELSEWHERE += "é" * 200, "/".join(600 * ["wear"])
NAMES = st.dictionaries(st.sampled_from(ELSEWHERE) | st.text(), st.text() | st.none(), max_size=4)


@given(
    parts=st.fixed_dictionaries({name: NAMES for name in ("inputs", "files", "outputs", "params")})
)
@settings(max_examples=60, deadline=None)  # the first example imports more
def test_no_record_makes_anything_be_written_or_deleted(parts, tmp_path_factory):
    """Records may come from anywhere: with a results folder of somebody else."""
    folder = tmp_path_factory.mktemp("study")
    (folder / "private").write_text("mine")
    results = folder / "results"
    run(
        results,
        steps := [
            Step("wear", {}, [], [results / "wear"]),
            Step(PAGE, {"steps": ["wear"]}, [], []),
        ],
    )
    (results / "out").symlink_to(folder)
    record_of(results, "wear").write_text(json.dumps(parts | {"messages": {}}))
    before = contents(folder)
    plan_again(steps, results)
    break_in(results)
    for file in made_in(results):
        assert Path(os.path.normpath(file)).is_relative_to(results)
    assert contents(folder) == before
    for check in (check_links, check_chain):
        with pytest.raises(InputError, match=r"results/out: is a link to .*, outside the results"):
            check(results)


def contents(folder):
    return {file: file.read_bytes() for file in sorted(folder.rglob("*")) if file.is_file()}
