"""Damaged files, kills, locks and folders; `make test-faults` tries what takes longer."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

from gst.run.owned import CLAIMS, LOCK

NOT_FOR_USERS = ("Traceback", "RuleException", "CalledProcessError", 'File "', "InputFunction")


def test_a_failed_step_shows_its_own_error_and_nothing_else(tiny):
    tiny.change(
        load={"force_N": 2.4e4}, macroscale={"maximum_displacement_um": 20.0}, pressure_cap_MPa=None
    )
    result = tiny.run()
    assert result.returncode != 0
    text = result.stdout + result.stderr
    assert text.count("240 MPa cannot be reached") == 1, text
    assert "log:  results-tiny/logs/solve_macroscale.log" in text
    assert not [word for word in NOT_FOR_USERS if word in text], text
    assert not (tiny.results / "macroscale/contact.h5").exists()


def test_what_was_deleted_edited_or_cut_is_made_again(tiny):
    """And nothing else; the plan says why. A deleted log is missed by nobody."""
    results = tiny.results
    names = ("change/1/7.h5", "tables/wear.csv", "figures/patch/7.png")
    whole = {results / name: (results / name).read_bytes() for name in names}
    cut, edited, gone = whole
    cut.write_bytes(whole[cut][:9])
    edited.write_bytes(whole[edited].replace(b"0.", b"99.", 1))
    record = results / "logs/compare_scales.json"
    for file in (gone, record, results / "logs/solve_macroscale.log"):
        file.unlink()
    plan = tiny.gst("study", tiny.config, "--plan").stdout
    for step, why in (
        ("register_patches", "change/1/7.h5 is not as it was made"),
        ("score_wear", "change/1/7.h5 has changed"),
        ("compare_scales", "no record says how it was made"),
    ):
        assert re.search(rf"^{step}: .*\n    {re.escape(why)}; last took \d", plan, re.MULTILINE)
    assert "compose_surface" not in plan
    before = tiny.tables()
    result = tiny.gst("study", tiny.config)
    assert result.returncode == 0, result.stderr
    assert "again: change/1/7.h5 is not as it was made" in result.stderr
    assert {file: file.read_bytes() for file in whole} == whole
    assert tiny.tables() == before | {edited.name: whole[edited].decode()}
    assert record.is_file()
    check = tiny.gst("check", tiny.config).stdout
    assert f"results in  {results.name}: finished, with this config" in check


def test_ctrl_c_ends_a_run_in_a_sentence(study):
    """As in a terminal, where it reaches every process of the command's group."""
    gst = Path(sys.executable).with_name("gst")
    command, pipe = [gst, "study", study.config], subprocess.PIPE
    process = subprocess.Popen(
        command,
        cwd=study.folder,
        stdout=pipe,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    text = ""
    while "Making the specimen" not in text:
        text += process.stdout.readline()
    os.killpg(process.pid, signal.SIGINT)
    text += process.communicate()[0]
    assert process.returncode == 1
    assert text.endswith("Repeat the same command to continue from there.\n")
    assert len(text.splitlines()) < 8
    assert not (study.results / LOCK).exists()


def test_a_first_run_writes_in_place_of_no_file(study):
    """What a study would not write is in nobody's way."""
    mine, beside = study.results / "figures/overview.png", study.results / "figures/photo.jpg"
    mine.parent.mkdir(parents=True)
    for file in (mine, beside):
        file.write_text("mine")
    result = study.gst("study", study.config)
    assert result.returncode == 2
    assert f"ERROR: {mine.relative_to(study.folder)}: " in result.stderr
    assert {file for file in study.results.rglob("*") if file.is_file()} == {mine, beside}
    mine.unlink()
    assert study.gst("study", study.config, "--plan").returncode == 0


def test_a_study_folder_runs_no_code_of_its_own(study):
    """Neither a module nor a profile that nobody named, nor what Snakemake keeps there."""
    mark = study.folder / "ran"
    code = f"open({str(mark)!r}, 'w')\n"
    scripts = study.folder / ".snakemake/scripts"
    scripts.mkdir(parents=True)
    for name in ("json", "numpy", "random", "sitecustomize", "snakemake", "pickle"):
        for folder in (study.folder, scripts):
            (folder / f"{name}.py").write_text(code)
    profile = study.folder / "profiles/default/config.yaml"
    profile.parent.mkdir(parents=True)
    profile.write_text(f"__use_yte__: true\ncores: ?open({str(mark)!r}, 'w') and 1\n")
    result = study.gst("study", study.config, "--until", "generate_specimen")
    assert result.returncode == 0, result.stderr
    assert not mark.exists()
    assert (study.results / CLAIMS).is_file()
    named = study.gst("study", study.config, "--plan", "--profile", "./profiles/default")
    assert named.returncode == 0, named.stderr
    assert mark.exists()


def test_a_file_of_the_user_is_moved_from_a_folder_that_is_made_anew(tiny):
    note = tiny.results / "figures/preparation/note.txt"
    note.write_text("mine")
    result = tiny.gst("study", tiny.config, "--forcerun", "draw_inputs", "--until", "draw_inputs")
    assert result.returncode == 0, result.stderr
    moved = tiny.results / "moved_aside/figures/preparation/note.txt"
    assert str(moved.relative_to(tiny.folder)) in result.stderr
    assert moved.read_text() == "mine"
