"""Damaged files, locks and folders; `make test-faults` tries what takes longer, such as kills."""

import base64
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT


def said_by(result):
    assert result.returncode != 0, result.stdout
    return result.stdout + result.stderr


def test_a_damaged_intermediate_is_named_and_made_anew_once_deleted(tiny):
    damaged = tiny.results / "microscale/7.h5"
    table = tiny.results / "tables/microscale_summary.csv"
    whole, before = damaged.read_bytes(), table.read_text()
    damaged.write_bytes(whole[: len(whole) // 2])
    target = str(table.relative_to(tiny.folder))
    said = said_by(tiny.run(target))
    assert "ERROR: results-tiny/microscale/7.h5: cannot be read as HDF5" in said
    assert "Delete it and run the study again." in said
    damaged.unlink()
    assert tiny.run(target).returncode == 0
    assert damaged.read_bytes() == whole
    assert table.read_text() == before


@pytest.mark.parametrize(
    ("damage", "problem"),
    [
        (lambda lines: [], "cannot be read as a table"),
        (lambda lines: lines[:-2], "has not one row for each patch"),
    ],
    ids=["empty", "rows"],
)
def test_a_damaged_table_that_jobs_are_planned_by(tiny, damage, problem):
    table = tiny.results / "tables/patch_pressures.csv"
    table.write_text("".join(damage(table.read_text().splitlines(keepends=True))))
    said = said_by(tiny.run("--dry-run"))
    assert f"results-tiny/tables/patch_pressures.csv: {problem}" in said
    assert "Delete it and run the study again." in said


def test_a_patch_taken_out_of_the_patch_table_is_no_damage(tiny):
    table = tiny.folder / "config/patches_tiny.tsv"
    rows = table.read_text().splitlines(keepends=True)
    table.write_text("".join(row for row in rows if not row.startswith("5\t")))
    assert "couple_scales" in tiny.planned()


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no folder that is closed to root too")
def test_a_results_folder_that_cannot_be_written_to(study):
    study.change(results="/proc/gst")
    assert "/proc/gst: cannot be written: " in said_by(study.run())
    assert not list(study.folder.glob(".snakemake/locks/*"))


def test_what_was_at_work_in_a_killed_run_is_run_again(tiny):
    """Snakemake's mark of a job at work, left behind: no error that asks for an option."""
    name = base64.urlsafe_b64encode(b"results-tiny/tables/texture.csv").decode()
    (tiny.folder / ".snakemake/incomplete" / name).write_text('{"external_jobid": null}')
    assert "tabulate_texture" in tiny.planned()


def test_unlocking_removes_what_unfinished_steps_behind_the_checkpoint_left(tiny):
    """Killed between its files, a step is not run again for the one that is there."""
    figures = [tiny.results / f"figures/microscale_{name}" for name in ("maps.png", "curves.png")]
    contents = [file.read_bytes() for file in figures]
    names = [str(file.relative_to(tiny.folder)).encode() for file in figures]
    for name in names:
        code = base64.urlsafe_b64encode(name).decode()
        (tiny.folder / ".snakemake/metadata" / code).unlink()
        (tiny.folder / ".snakemake/incomplete" / code).write_text('{"external_jobid": null}')
    figures[1].unlink()
    lock = tiny.folder / ".snakemake/locks/0.output.lock"
    lock.parent.mkdir(exist_ok=True)
    lock.write_bytes(b"\n".join(names))
    result = unlock(tiny)
    assert result.returncode == 0, result.stderr
    assert "removed: 1." in result.stdout
    result = tiny.run()
    assert result.returncode == 0, result.stderr
    assert [file.read_bytes() for file in figures] == contents


def unlock(study, *options):
    return subprocess.run(
        [sys.executable, str(ROOT / "workflow/unlock.py"), study.config, *options],
        cwd=study.folder,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture
def locked(study):
    """As a run leaves it that was ended by SIGKILL."""
    lock = study.folder / ".snakemake/locks/0.output.lock"
    lock.parent.mkdir(parents=True)
    lock.write_text("results-tiny/provenance.json\nresults-tiny/tables/inputs.csv\n")
    return study


def test_the_lock_of_a_killed_run(locked):
    assert "cannot be locked" in said_by(locked.run())
    assert "make unlock CONFIG=config/tiny.yaml" in said_by(unlock(locked, "--explain"))
    assert unlock(locked).returncode == 0
    assert not (locked.folder / ".snakemake/locks").exists()
    assert "not locked" in unlock(locked).stdout
    assert unlock(locked, "--explain").stdout == ""


@pytest.mark.parametrize(
    ("script", "words"),
    [
        ("snakemake", "another run is at work in this folder (process {})"),
        (".snakemake/scripts/tmp1.solve_patch.py", "(processes {}). Wait for them, or end them"),
    ],
)
def test_nothing_is_unlocked_while_something_is_at_work(locked, script, words):
    path = locked.folder / script
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("print(flush=True)\ninput()")
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [sys.executable, str(path)], cwd=locked.folder, stdin=pipe, stdout=pipe
    ) as process:
        process.stdout.readline()  # it has begun
        for options in ([], ["--explain"]):
            assert words.format(process.pid) in said_by(unlock(locked, *options))
        process.communicate(b"\n")
    assert (locked.folder / ".snakemake/locks/0.output.lock").exists()


def test_a_lock_on_another_study_of_the_folder_is_not_this_ones(locked):
    locked.change(results="results-other")
    assert "not locked" in unlock(locked).stdout
    assert (locked.folder / ".snakemake/locks/0.output.lock").exists()
