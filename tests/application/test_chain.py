"""What runs again, and when results are whole: by content, in any folder and of any date."""

import json
import os
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest
from folders import fill, snapshot
from snakemake.iocontainers import Namedlist

from gst.run.chain import (
    PAGE,
    Step,
    break_in,
    certified_inputs,
    check_chain,
    given_to,
    hashes_of,
    made_in,
    other_files,
    plan_again,
    record_of,
    versions_of,
    write_record,
)
from gst.run.logs import ASKED, run_script
from gst.run.scheduler import order_dates
from gstlib.errors import FaultError, InputError, refuse

RESULTS = Path("results")
SCAN = Path("scans/1.plu")


def steps_in(results=RESULTS, scan=SCAN, **params):
    """A study of two steps and a page; `params` are those of the first, which reads the `scan`."""
    surface, folder, page = (results / name for name in ("1.h5", "wear", "index.html"))
    steps = [
        Step("clean", {"code": "a", "flip": None} | params, [scan], [surface]),
        Step("wear", {"code": "b", "mesh": results / "mesh.stl"}, [surface], [folder]),
    ]
    rest = {"steps": hashes_of(steps, results), "config": {"results": str(results)}}
    return [*steps, Step(PAGE, rest, [surface, folder], [page])]


def run(steps):
    """As a run would: each step reads, makes and records."""
    for step in steps:
        read = given_to(RESULTS, step)
        for output in step.outputs:
            file = output / "1.png" if output.suffix == "" else output
            fill(Path(), {file: f"{output.name} of {read['inputs']}"})
        write_record(RESULTS, step, read, {})


@pytest.fixture
def steps(tmp_path, monkeypatch):
    """The steps of a finished study in the working folder."""
    monkeypatch.chdir(tmp_path)
    fill(tmp_path, {SCAN: "heights"})
    run(made := steps_in())
    assert plan_again(made, RESULTS) == {}
    assert break_in(RESULTS) is None
    return made


@pytest.mark.parametrize(
    ("params", "why"),
    [
        ({"crop": (0.0, float("nan"))}, "crop was null, is [0.0, null]"),
        ({"code": "c"}, "the program has changed"),
        ({"flip": "x" * 99}, "flip has changed"),
    ],
)
def test_another_param_is_a_reason(steps, params, why):
    again = plan_again(steps_in(**params), RESULTS)
    assert again == {"results/1.h5": why, "results/index.html": "steps has changed"}


def rewrite(file, content):
    """Another content of the same size and date."""
    stat = file.stat()
    assert len(content) == stat.st_size
    file.write_text(content)
    os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns))


def test_a_scan_of_the_same_size_and_date_is_seen(steps):
    *_, page = steps
    rewrite(SCAN, "HEIGHTS")
    assert plan_again(steps, RESULTS) == {"results/1.h5": "scans/1.plu has changed"}
    problem = "scans/1.plu is not as the step clean read it"
    assert break_in(RESULTS) == problem
    with pytest.raises(InputError, match=problem):
        certified_inputs(RESULTS, page.params["steps"], [SCAN])


def job_of(step, config=()):
    """A job as Snakemake gives it to a script, and what it reads and makes by name."""
    return SimpleNamespace(
        input=Namedlist(fromdict={"scan": str(SCAN)}),
        output=Namedlist(fromdict={"surface": str(RESULTS / "1.h5")}),
        log=[str(RESULTS / f"logs/{step.name}.log")],
        config=dict(config),
        params=step.params,
    )


def clean(scan, surface, *, flip):
    surface.write_text(f"{flip} of {scan.read_text()}")


def test_a_file_that_changes_while_a_step_reads_it_is_seen(steps):

    def main(scan, surface, *, flip):
        clean(scan, surface, flip=flip)
        rewrite(SCAN, "HEIGHTS")

    run_script(job_of(steps[0]), main)
    assert plan_again(steps, RESULTS)["results/1.h5"] == "scans/1.plu has changed"


@pytest.mark.parametrize(("name", "step"), [("1.h5", "clean"), ("wear/1.png", "wear")])
def test_what_was_edited_or_removed_is_made_again(steps, name, step):
    file, made = RESULTS / name, RESULTS / name.partition("/")[0]
    rewrite(file, file.read_text().upper())
    again = plan_again(steps, RESULTS)
    assert again[str(made)] == f"{name} is not as it was made"
    assert again.keys() == {str(made), "results/wear", "results/index.html"}
    assert f"results/{name} is not as the step {step} made it" in break_in(RESULTS)
    file.unlink()
    missing = f"results/{name}, which the step {step} made, is missing"
    assert break_in(RESULTS) == missing
    assert plan_again(steps, RESULTS).keys() == {"results/wear", "results/index.html"}


def test_a_step_that_makes_other_files_than_last_time_records_these(steps):
    _, wear, page = steps
    read = given_to(RESULTS, wear)
    (RESULTS / "wear/1.png").rename(RESULTS / "wear/2.png")
    write_record(RESULTS, wear, read, {})
    made = [file.name for file in made_in(RESULTS)]
    assert made == ["1.h5", "2.png", "index.html"]
    assert "wear/1.png" in break_in(RESULTS)  # which the page has read
    run([page])
    assert break_in(RESULTS) is None


def test_a_file_that_no_step_made_is_ignored(steps):
    """Also by a step that reads the folder, whether it runs before or after the file came."""
    before = made_in(RESULTS)
    for text in ("of another program", "changed"):
        fill(RESULTS, {"wear/notes/mine.txt": text})
        assert plan_again(steps, RESULTS) == {}
        run(steps[2:])
    assert break_in(RESULTS) is None
    assert made_in(RESULTS) == before


def test_a_step_without_a_whole_record_is_run_again(steps):
    record = record_of(RESULTS, "wear")
    for content in ("[]", '{"params": {}}', record.read_text()[:-9], None):
        record.unlink() if content is None else record.write_text(content)
        assert plan_again(steps, RESULTS) == {
            "results/wear": "no record shows how it was made"
        }
        assert break_in(RESULTS) == "no record lists the files that the step wear made"


def test_results_may_be_moved_copied_and_renamed(steps, tmp_path, monkeypatch):
    """A copy has the dates of its making; no file is younger than what was made from it after."""
    other, renamed = tmp_path / "elsewhere", Path("b")
    shutil.copytree(RESULTS, other / renamed)
    shutil.copytree(SCAN.parent, other / SCAN.parent)
    monkeypatch.chdir(other)
    # not as they were made
    for age, name in enumerate(("wear/1.png", "index.html", "1.h5")):
        os.utime(renamed / name, (age, age))
    moved = steps_in(renamed)
    assert plan_again(moved, renamed) == {}
    assert break_in(renamed) is None
    order_dates(moved)
    for _, _, inputs, outputs in moved:
        read, made = (
            [os.stat(path).st_mtime for path in paths] for paths in (inputs, outputs)
        )
        assert max(read) <= min(made)


def test_a_result_is_whole_without_the_measured_files(steps):
    *_, page = steps
    SCAN.rename("away")
    assert break_in(RESULTS) is None
    assert certified_inputs(RESULTS, page.params["steps"], [SCAN]).keys() == {str(SCAN)}


def test_a_file_that_came_or_went_is_seen(steps):
    """As a scan does that is named after its patch, and not in the table."""
    *_, page = steps
    run([page._replace(inputs=[*page.inputs, SCAN])])
    assert other_files(RESULTS, [str(SCAN)]) is None
    new = "the page was made without scans/2.plu, which the study reads now"
    assert other_files(RESULTS, [str(SCAN), "scans/2.plu"]) == new
    gone = "the page was made with scans/1.plu, which the study no longer reads"
    assert other_files(RESULTS, []) == gone
    Path("scans/2.plu").write_text("heights")
    for files, why in (
        ([SCAN, Path("scans/2.plu")], "scans/2.plu is new"),
        ([], "scans/1.plu is no longer read"),
    ):
        again = plan_again([steps[0]._replace(inputs=files)], RESULTS)
        assert again == {"results/1.h5": why}


def test_a_page_is_that_of_its_files_and_of_its_config(steps):
    config = {"results": "results"}
    assert break_in(RESULTS, config) is None
    other = "the results were made with another config"
    assert break_in(RESULTS, config | {"load": 1}) == other
    assert break_in(Path("other")) == "this folder holds no finished study"
    read = given_to(RESULTS, steps[0])
    (RESULTS / "1.h5").write_text("as a newer program makes it")
    write_record(RESULTS, steps[0], read, {})
    assert break_in(RESULTS) == "results/1.h5 is not as the step wear read it"


@pytest.mark.parametrize("other", [{"flip": "x"}, {"scan": Path("scans/2.plu")}])
def test_a_step_of_another_config_is_no_part_of_the_page(steps, other):
    """As when the last job alone runs after an edit, or two folders share one for results."""
    Path("scans/2.plu").write_text("heights")
    edited = steps_in(**other)
    run(edited[2:])
    problem = "the step clean was made with other params or files than the config gives"
    with pytest.raises(InputError, match=problem):
        check_chain(RESULTS)
    with pytest.raises(InputError, match=problem):
        certified_inputs(RESULTS, edited[2].params["steps"], [SCAN])
    assert plan_again(edited, RESULTS).keys() == {"results/1.h5"}


def test_a_job_whose_config_was_edited_since_the_run_began_does_not_start(
    steps, monkeypatch
):
    monkeypatch.setenv(ASKED, json.dumps({str(RESULTS): hashes_of(steps, RESULTS)}))
    edited = steps_in(flip="x")[0]
    before = snapshot(RESULTS)
    with pytest.raises(SystemExit):
        run_script(job_of(edited), clean)
    log = RESULTS / "logs/clean.log"
    assert "edited while the study runs" in log.read_text()
    log.unlink()
    assert snapshot(RESULTS) == before
    run_script(job_of(steps[0]), clean)


@pytest.mark.parametrize(
    ("after", "runs"),
    [(["odd_scan:1"], True), (["odd_scan:2", "holes", "odd_scan:1"], False)],
)
def test_another_accept_runs_again_what_met_such_a_fault(steps, after, runs):
    before = ["odd_scan:1", "odd_scan:2", "epochs"]

    def main(scan, surface, *, flip):
        refuse(FaultError("odd_scan", scan, "is odd", "Scan again.", ["1", "2"]))
        clean(scan, surface, flip=flip)

    run_script(job_of(steps[0], {"accept": before}), main)
    run(steps[1:])
    for accepted, is_other in ((before, False), (after, runs)):
        steps[2].params["config"]["accept"] = accepted
        run(steps[2:])  # the page alone
        assert ("results/1.h5" in plan_again(steps, RESULTS, accepted)) == is_other
        assert (break_in(RESULTS) is not None) == is_other


def test_versions_are_those_on_which_the_steps_ran(steps, monkeypatch):
    versions = {"numpy": "2.0", "scipy": "1.1"}
    monkeypatch.setattr("gst.run.logs.software", versions.copy)
    run_script(job_of(steps[0]), lambda **_: None)
    assert versions_of(RESULTS, ["clean"]) == versions
    versions["numpy"] = "2.1"
    run_script(job_of(steps[1]), lambda **_: None)
    assert versions_of(RESULTS, ["clean", "wear"]) == versions | {
        "numpy": "mixed: 2.0, 2.1"
    }


ELSEWHERE = "/etc/passwd", "../private", "wear/../../private", "out/private", "."


@pytest.mark.parametrize(
    "name", [*ELSEWHERE, "", "\0", "é" * 200, "wear/" * 600], ids=len
)
def test_no_record_makes_anything_be_written_or_deleted(steps, name):
    """Records may come from anywhere: with a results folder of somebody else."""
    Path("private").write_text("mine")
    (RESULTS / "out").symlink_to(Path.cwd())
    file = record_of(RESULTS, "wear")
    record = json.loads(file.read_text())
    for part in ("inputs", "files", "outputs"):
        record[part][name] = "a1"
    record["params"]["makes"] = [name]
    file.write_text(json.dumps(record))
    before = snapshot(Path.cwd())
    plan_again(steps, RESULTS)
    break_in(RESULTS)
    for made in made_in(RESULTS):
        assert Path(os.path.normpath(made)).is_relative_to(RESULTS)
    assert snapshot(Path.cwd()) == before
    outside = r"results/out: is a link to .*, outside the results"
    with pytest.raises(InputError, match=outside):
        check_chain(RESULTS)
