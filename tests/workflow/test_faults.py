"""Damaged files, kills, locks and folders; `make test-faults` tries what takes longer."""

import platform
import subprocess
import sys

import pytest

NOT_FOR_USERS = ("Traceback", "RuleException", "CalledProcessError", 'File "', "InputFunction")


def begin(study):
    """`gst study` up to Snakemake, which only says what its rules are."""
    result = study.gst("study", study.config, "--list-rules")
    assert ("solve_patches" in result.stdout + result.stderr) == (result.returncode == 0)
    return result


def test_a_failed_step_shows_its_own_error_and_nothing_else(tiny):
    tiny.change(
        load={"force_N": 2.4e4}, macroscale={"maximum_displacement_um": 20.0}, hardness=None
    )
    result = tiny.run("results-tiny/macroscale/contact.h5")
    assert result.returncode != 0
    said = result.stdout + result.stderr
    for words in ("composite.h5", "240 MPa cannot be reached", "Lower the load"):
        assert said.count(words) == 1, said
    assert "step: Pressing the stone with 24000" in said
    assert "log:  results-tiny/logs/solve_macroscale.log" in said
    assert "Repeat the same command to continue from there." in said
    assert not [word for word in NOT_FOR_USERS if word in said], said
    assert len(said.splitlines()) <= 8
    assert not (tiny.results / "macroscale/contact.h5").exists()


def test_a_damaged_intermediate_is_named_and_made_anew_once_deleted(tiny):
    damaged, table = tiny.results / "registered/7.h5", tiny.results / "tables/registration.csv"
    whole, before = damaged.read_bytes(), table.read_text()
    damaged.write_bytes(whole[: len(whole) // 2])
    target = str(table.relative_to(tiny.folder))
    result = tiny.run(target)
    assert result.returncode != 0
    said = result.stdout + result.stderr
    assert "ERROR: results-tiny/registered/7.h5: cannot be read as HDF5" in said
    assert "Delete it and run the study again." in said
    damaged.unlink()
    tiny.succeed(target)
    assert damaged.read_bytes() == whole
    assert table.read_text() == before


def test_what_is_deleted_is_planned_again(tiny):
    for names, rules in (
        (("macroscale/contact.h5",), {"solve_macroscale", "couple_scales"}),
        (("coupling/pressures.csv",), {"couple_scales"}),
        (("verdict.html", "contents.json", "provenance.json"), {"write_page"}),
        (("reference/contact.h5",), {"solve_reference", "compare_scales"}),
        (("microscale/levelled/7.h5",), {"solve_patches", "compare_scales"}),
    ):
        kept = {tiny.results / name: (tiny.results / name).read_bytes() for name in names}
        for file in kept:
            file.unlink()
        assert rules <= tiny.planned(), names
        for file, content in kept.items():
            file.write_bytes(content)


def test_one_file_of_a_folder_and_what_is_not_recorded_are_made_again(tiny):
    picture, wear = tiny.results / "figures/patch/7.png", tiny.results / "wear/7.h5"
    before = picture.read_bytes()
    record, log = (
        tiny.results / f"logs/{name}" for name in ("judge_wear.sha256", "write_page.log")
    )
    for deleted in (picture, record, log):
        deleted.unlink()
    said = tiny.gst("study", tiny.config, "--plan").stdout
    again = "results-tiny/figures/patch, what judge_wear made, what write_page made"
    assert f"Missing, and to be made again: {again}\n" in said
    assert str(wear.relative_to(tiny.folder)) not in said
    assert tiny.gst("study", tiny.config).returncode == 0
    assert picture.read_bytes() == before
    assert record.is_file()
    assert log.is_file()


def test_what_was_edited_or_cut_is_never_certified(tiny):
    """Neither by the command nor by the step that writes the page, whoever starts it."""
    table, page = tiny.results / "tables/wear.csv", tiny.results / "index.html"
    for file, damaged in (
        (page, page.read_bytes()[: page.stat().st_size // 2]),
        (table, table.read_bytes().replace(b"0.", b"99.", 1)),
    ):
        whole = file.read_bytes()
        file.write_bytes(damaged)
        refused = tiny.gst("study", tiny.config)
        assert refused.returncode == 2
        assert f"{file.relative_to(tiny.folder)}: is not as its step made it" in refused.stderr
        assert "Delete it" in refused.stderr
        if file == table:
            record = tiny.results / "logs/judge_wear.sha256"
            kept = record.read_bytes()
            for fault in ("is not as its step made it", "no step has recorded that it made it"):
                result = tiny.run("--forcerun", "write_page")
                assert result.returncode != 0
                assert fault in result.stdout + result.stderr
                record.unlink(missing_ok=True)
            record.write_bytes(kept)
        file.write_bytes(whole)


@pytest.fixture
def locked(study):
    """A folder as a run leaves it that was ended by SIGKILL."""
    lock = study.folder / ".snakemake/locks/0.output.lock"
    lock.parent.mkdir(parents=True)
    lock.write_text("results-tiny/provenance.json\n")
    return lock


def test_the_lock_of_a_killed_run_is_removed(study, locked):
    assert begin(study).returncode == 0
    assert not locked.exists()


@pytest.mark.parametrize("script", ["snakemake", ".snakemake/scripts/tmp1.solve_patches.py"])
def test_a_folder_with_a_live_run_or_job_is_refused(study, locked, script):
    path = study.folder / script
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("print(flush=True)\ninput()")
    pipe = subprocess.PIPE
    with subprocess.Popen(
        [sys.executable, str(path)], cwd=study.folder, stdin=pipe, stdout=pipe
    ) as process:
        process.stdout.readline()  # it has begun
        result = begin(study)
        process.communicate(b"\n")
    assert result.returncode == 2
    said = result.stderr.strip()
    assert said.startswith(f"ERROR: {study.folder}: a run or its jobs are still at work")
    assert said.endswith(f"Wait, or end them: kill {process.pid}")
    assert locked.exists()


def test_a_lock_that_another_machine_may_hold_is_kept(study, locked):
    (study.folder / ".snakemake/host").write_text(f"not-{platform.node()}")
    result = begin(study)
    assert result.returncode == 2
    assert f"was started on not-{platform.node()} may still be at work" in result.stderr
    assert locked.exists()
