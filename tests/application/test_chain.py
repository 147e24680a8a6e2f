"""What runs again, and when results are whole: by content, in any folder and of any date."""

import json
import os
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest
from gst.run.chain import (
    PAGE,
    Step,
    break_in,
    certified_inputs,
    check_chain,
    check_links,
    given_to,
    hashes_of,
    made_in,
    plan_again,
    record_of,
    versions_of,
    write_record,
)
from gst.run.logs import ASKED, run_script
from gst.run.scheduler import order_dates
from gstlib.errors import FaultError, InputError, refuse
from hypothesis import given, settings
from hypothesis import strategies as st
from snakemake.iocontainers import Namedlist

SCAN = Path("scans/1.plu")


def steps_in(results, **params):
    """A study of two steps and a page; `params` are those of the first."""
    surface, folder, page = (results / name for name in ("1.h5", "wear", "index.html"))
    steps = [
        Step("clean", {"code": "a", "flip": None} | params, [SCAN], [surface]),
        Step("wear", {"code": "b", "mesh": results / "mesh.stl"}, [surface], [folder]),
    ]
    rest = {"steps": hashes_of(steps, results), "config": {"results": str(results)}}
    return [*steps, Step(PAGE, rest, [surface, folder], [page])]


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
    again = plan_again(steps_in(results, **params), results)
    assert again == {"results/1.h5": why, "results/index.html": "steps has changed"}


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
        certified_inputs(results, {"clean": steps[2].params["steps"]["clean"]}, [SCAN])


def job_of(step, results, config=()):
    """A job as Snakemake gives it to a script, and what it reads and makes by name."""
    files = {"input": {"scan": str(SCAN)}, "output": {"surface": str(results / "1.h5")}}
    job = {name: Namedlist(fromdict=named) for name, named in files.items()}
    log = record_of(results, step.name).with_suffix(".log")
    return SimpleNamespace(**job, config=dict(config), params=step.params, log=[str(log)])


def clean(scan, surface, *, flip):
    surface.write_text(f"{flip} of {scan.read_text()}")


def test_a_file_that_changes_while_a_step_reads_it_is_seen(study):
    results, (clean, *others) = study

    def main(scan, surface, *, flip):
        surface.write_text(f"{flip} of {scan.read_text()}")
        rewrite(SCAN, "HEIGHTS")

    run_script(job_of(clean, results), main)
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


@pytest.mark.parametrize(("name", "step"), [("1.h5", "clean"), ("wear/1.png", "wear")])
def test_what_was_removed_is_said_to_be_missing(study, name, step):
    results, steps = study
    (results / name).unlink()
    assert break_in(results) == f"results/{name}, which the step {step} made, is missing"
    assert plan_again(steps, results).keys() == {"results/wear", "results/index.html"}


@pytest.mark.parametrize("name", [".DS_Store", "2.png", "notes/mine.txt"])
def test_a_file_that_no_step_made_is_ignored(study, name):
    """Also by a step that reads the folder, whether it runs before or after the file came."""
    results, steps = study
    file = results / "wear" / name
    file.parent.mkdir(exist_ok=True)
    file.write_text("of another program")
    assert plan_again(steps, results) == {}
    run(results, steps[2:])
    file.write_text("changed")
    assert plan_again(steps, results) == {}
    assert break_in(results) is None
    assert set(made_in(results)) == {
        results / made for made in ("1.h5", "wear/1.png", "index.html")
    }


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
    order_dates(moved)
    dates = {
        path: path.stat().st_mtime_ns for step in moved for path in (*step.inputs, *step.outputs)
    }
    for step in moved:
        assert max(map(dates.get, step.inputs)) <= min(map(dates.get, step.outputs))


def test_a_result_is_whole_without_the_measured_files_but_not_with_others(study):
    results, (*_, page) = study
    SCAN.rename("away")
    assert break_in(results) is None
    assert certified_inputs(results, page.params["steps"], [SCAN]).keys() == {str(SCAN)}
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


@pytest.mark.parametrize("other", ["params", "files"])
def test_a_step_of_another_config_is_no_part_of_the_page(study, other):
    """As when the last job alone runs after an edit, or two folders share one for results."""
    results, steps = study
    edited = steps_in(results, flip="x")
    if other == "files":
        Path("scans/2.plu").write_text("heights")
        edited[0] = steps[0]._replace(inputs=[Path("scans/2.plu")])
        page = {"steps": hashes_of(edited[:2], results), "config": {"results": "results"}}
        edited[2] = steps[2]._replace(params=page)
    run(results, edited[2:])
    said = "the step clean was made with other params or files than the config gives"
    assert break_in(results) == said
    with pytest.raises(InputError, match=said):
        check_chain(results)
    with pytest.raises(InputError, match=said):
        certified_inputs(results, edited[2].params["steps"], [SCAN])
    assert plan_again(edited, results).keys() == {"results/1.h5"}
    run(results, edited)
    assert break_in(results) is None


def test_a_job_whose_config_was_edited_since_the_run_began_does_not_start(study, monkeypatch):
    results, steps = study
    monkeypatch.setenv(ASKED, json.dumps({str(results): hashes_of(steps, results)}))
    edited = steps_in(results, flip="x")[0]
    before = contents(results)
    with pytest.raises(SystemExit):
        run_script(job_of(edited, results), clean)
    log = record_of(results, "clean").with_suffix(".log")
    assert "edited while the study runs" in log.read_text()
    log.unlink()
    assert contents(results) == before
    run_script(job_of(steps[0], results), clean)


@pytest.mark.parametrize(
    ("before", "after", "runs"),
    [
        ([], ["holes"], False),
        (["epochs"], [], False),
        (["epochs", "face"], ["epochs"], True),
        (["odd_scan:1", "odd_scan:2"], ["odd_scan:1"], True),
        (["odd_scan:1", "odd_scan:2"], ["odd_scan:2", "holes", "odd_scan:1"], False),
    ],
)
def test_another_accept_runs_again_what_met_such_a_fault(study, before, after, runs):
    results, steps = study

    def main(scan, surface, *, flip):
        if "face" in before:
            refuse(FaultError("face", scan, "lies beyond", "Move it."))
        if "odd_scan:1" in before:
            refuse(FaultError("odd_scan", scan, "is odd", "Scan again.", ["1", "2"]))
        clean(scan, surface, flip=flip)

    run_script(job_of(steps[0], results, {"accept": before}), main)
    run(results, steps[1:])
    steps[2].params["config"]["accept"] = before
    run(results, steps[2:])
    assert plan_again(steps, results, before) == {}
    assert break_in(results) is None
    assert ("results/1.h5" in plan_again(steps, results, after)) == runs
    steps[2].params["config"]["accept"] = after
    run(results, steps[2:])  # the page alone
    assert (break_in(results) is not None) == runs


def test_versions_are_those_on_which_the_steps_ran(study, monkeypatch):
    results, steps = study
    monkeypatch.setattr("gst.run.logs.software", lambda: {"numpy": "2.0", "scipy": "1.1"})
    run_script(job_of(steps[0], results), clean)
    assert versions_of(results, ["clean", "wear"]) == {"numpy": "2.0", "scipy": "1.1"}
    monkeypatch.setattr("gst.run.logs.software", lambda: {"numpy": "2.1", "scipy": "1.1"})
    run_script(job_of(steps[1]._replace(name="wear"), results), lambda **_: None)
    assert versions_of(results, ["clean", "wear"]) == {"numpy": "mixed: 2.0, 2.1", "scipy": "1.1"}


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
            Step(PAGE, {"steps": {"wear": None}}, [], []),
        ],
    )
    (results / "out").symlink_to(folder)
    parts["params"]["makes"] = list(parts["outputs"])
    rest = {"messages": {}, "faults": {}, "software": {}}
    record_of(results, "wear").write_text(json.dumps(parts | rest))
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
