"""Damaged files, kills, locks and folders; `make test-faults` tries what takes longer."""

import os
import re
import shutil
import signal
import subprocess

from gst.run.owned import CLAIMS, LOCK

from .conftest import GST

NOT_FOR_USERS = (
    "Traceback",
    "RuleException",
    "CalledProcessError",
    'File "',
    "InputFunction",
)


def test_a_failed_step_shows_its_own_error_and_nothing_else(tiny):
    tiny.change(
        load={"force_N": 2.4e4},
        macroscale={"maximum_displacement_um": 20.0},
        pressure_cap_MPa=None,
    )
    text = tiny.run(code=1)
    assert text.count("240 MPa cannot be reached") == 1, text
    assert "log:  results-tiny/logs/solve_macroscale.log" in text
    assert "Stopped with " in text
    assert not [word for word in NOT_FOR_USERS if word in text], text
    assert not (tiny.results / "macroscale/contact.h5").exists()


def test_what_was_deleted_edited_or_cut_is_made_again(tiny):
    """And nothing else; the plan says why. A deleted log is missed by nobody."""
    results, folder = tiny.results, tiny.results.name
    cut, edited = results / "wear/1/7.h5", results / "tables/wear.csv"
    gone, record = results / "figures/patch/7.png", results / "logs/compare_scales.json"
    whole = {file: file.read_bytes() for file in (cut, edited, gone)}
    before = tiny.tables()
    cut.write_bytes(whole[cut][:9])
    edited.write_bytes(whole[edited].replace(b"0.", b"99.", 1))
    for file in (gone, record, results / "logs/solve_macroscale.log"):
        file.unlink()
    text = tiny.gst("study", tiny.config, "--plan")
    for step, why in (
        ("predict_wear", "wear/1/7.h5 is not as it was made"),
        ("score_wear", "wear/1/7.h5 has changed"),
        ("compare_scales", "no record shows how it was made"),
    ):
        assert re.search(
            rf"^{step}: .*\n    {re.escape(why)}; last took \d", text, re.MULTILINE
        )
    assert "register_patches" not in text
    text = tiny.gst("study", tiny.config)
    assert "again: wear/1/7.h5 is not as it was made" in text
    assert {file: file.read_bytes() for file in whole} == whole
    assert tiny.tables() == before
    assert record.is_file()
    assert "Nothing to do." in tiny.gst("study", tiny.config, "--plan")
    stated = f"results in  {folder}: finished, with this config"
    assert stated in tiny.gst("check", tiny.config)


def test_stale_results_are_not_certified_without_the_records_of_snakemake(tiny):
    """A folder that was copied, and another config. Asked for less, the study says so."""
    shutil.rmtree(tiny.folder / ".snakemake")
    tiny.change(load={"force_N": 200.0})
    assert "made with another config" in tiny.gst("check", tiny.config)
    text = tiny.gst("study", tiny.config, "--until", "solve_macroscale")
    assert "again: force_N was 550.0, is 200.0" in text
    assert "Done" not in text
    assert "The study is not finished" in text
    for command in ("export", "package"):
        refused = tiny.gst(command, tiny.results.name, code=2)
        assert "was made with other params or files" in refused
    assert not list(tiny.folder.glob("*.zip"))


def test_ctrl_c_ends_a_run_in_a_sentence(study):
    """As in a terminal, where it reaches every process of the command's group."""
    process = subprocess.Popen(
        [GST, "study", study.config],
        cwd=study.folder,
        stdout=subprocess.PIPE,
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


def test_a_study_folder_runs_no_code_of_its_own(study):
    """Neither a module nor a profile that nobody named, nor what Snakemake keeps there."""
    mark = study.folder / "ran"
    code = f"open({str(mark)!r}, 'w')\n"
    scripts = study.folder / ".snakemake/scripts"
    scripts.mkdir(parents=True)
    for name in ("json", "numpy", "random", "sitecustomize", "snakemake", "pickle"):
        for folder in (study.folder, scripts):
            (folder / f"{name}.py").write_text(code)
    for folder in ("profiles/default", "default"):
        (study.folder / folder).mkdir(parents=True)
        profile = f"__use_yte__: true\ncores: ?open({str(mark)!r}, 'w') and 1\n"
        (study.folder / folder / "config.yaml").write_text(profile)
    until = "--until", "generate_specimen"
    for name, *options in (["check"], ["study", "--plan"], ["study", *until]):
        study.gst(name, study.config, *options)
        assert not mark.exists(), name
    assert (study.results / CLAIMS).is_file()
    study.gst("study", study.config, "--plan", "--profile", "./profiles/default")
    assert mark.exists()


def test_a_file_of_the_user_is_moved_from_a_folder_that_is_made_anew(tiny):
    note = tiny.results / "figures/patch/note.txt"
    note.write_text("mine")
    step = "draw_validation"
    text = tiny.gst("study", tiny.config, "--forcerun", step, "--until", step)
    moved = tiny.results / "moved_aside/figures/patch/note.txt"
    assert str(moved.relative_to(tiny.folder)) in text
    assert moved.read_text() == "mine"
