"""What a person sees of a run: how far it is, and of a failed step its own error."""

import os
import pty
import re
import subprocess

CONTROL = re.compile(r"[^\x20-\x7e\n]")
SNAKEMAKES = ("Traceback", "RuleException", "CalledProcessError", 'File "', "InputFunction")


def test_piped_output_is_short_and_counts_the_steps(tiny):
    targets = [
        f"results-tiny/{name}" for name in ("tables/registration.csv", "figures/texture.png")
    ]
    for name in [*targets, "results-tiny/tables/texture.csv"]:
        (tiny.folder / name).unlink()
    result = tiny.run(*targets)
    assert result.returncode == 0, result.stderr
    said = result.stdout + result.stderr
    assert not CONTROL.search(said)
    assert "3 steps to do.\n" in said
    counts = re.findall(r"^(\d+) of (\d+) steps done", said, re.MULTILINE)
    assert counts == [("1", "3"), ("2", "3"), ("3", "3")]
    assert re.search(r"^All is done: 3 steps in .* s\.$", said, re.MULTILINE)
    assert "WARNING: patch 10: T1 was not found" in said  # from the job's log


def test_a_terminal_shows_each_step(tiny):
    (tiny.results / "tables/gridding.csv").unlink()
    ours, theirs = pty.openpty()
    command = tiny.command("results-tiny/tables/gridding.csv")
    run = subprocess.Popen(command, cwd=tiny.folder, stdout=theirs, stderr=theirs)
    os.close(theirs)
    said = b""
    try:
        while part := os.read(ours, 4096):
            said += part
    except OSError:  # the other end is closed
        pass
    os.close(ours)
    assert run.wait() == 0
    shown = said.decode()
    assert re.search(r" 1 of 1 .* s  Interpolating results-tiny/specimen/mesh.stl.*\n", shown)
    assert "Now: Interpolating" in shown
    assert "\x1b[" in shown


def test_a_failed_step_says_its_own_error_and_nothing_else(tiny):
    tiny.change(
        macroscale={"target_pressure_MPa": 5000.0, "maximum_displacement_um": 100.0}, hardness=None
    )
    result = tiny.run("results-tiny/macroscale/contact.h5")
    assert result.returncode != 0
    said = result.stdout + result.stderr
    assert said.count("5000 MPa cannot be reached") == 1
    assert "step: Pressing the square" in said
    assert "log:  results-tiny/logs/solve_macroscale.log" in said
    assert "Stopped after" in said
    assert not [word for word in SNAKEMAKES if word in said], said
    assert len(said.splitlines()) <= 8


def test_an_error_found_between_steps_is_as_plain(tiny):
    """The hardness is below the pressure of a patch, known once the scales are coupled."""
    tiny.change(macroscale={"target_pressure_MPa": 5.0}, hardness=5.1)
    result = tiny.run()
    assert result.returncode != 0
    said = result.stdout + result.stderr
    assert said.count("hardness") == 1, said
    assert "patch" in said
    assert "5.1" in said
    assert not [word for word in SNAKEMAKES if word in said], said
    assert not list(tiny.results.glob("hardness/*.h5"))
    assert "goes on from there" in said


def test_power_of_measured_files_is_refused(measured):
    measured.change(power={"first_seed": 1, "specimens": 3})
    result = measured.run("power")
    assert result.returncode != 0
    assert "'power'" in result.stderr
    assert "MissingRule" not in result.stderr
