"""What a person sees of a run: how far it is, and the error of a step that failed."""

import re

NOT_FOR_USERS = ("Traceback", "RuleException", "CalledProcessError", 'File "', "InputFunction")


def test_output_counts_the_steps_and_shows_their_warnings(tiny):
    targets = [f"results-tiny/tables/{n}.csv" for n in ("registration", "texture", "preprocessing")]
    tiny.change(selection={"minimum_pressure_MPa": 1000.0})
    for name in targets:
        (tiny.folder / name).unlink()
    said = tiny.succeed(*targets)
    assert not re.search(r"[^\x20-\x7e\n]", said)
    assert "3 steps to do.\n" in said
    assert re.findall(r"(\d+) of (\d+) steps done", said) == [("1", "3"), ("2", "3"), ("3", "3")]
    assert re.search(r"^All 3 steps are done, after .*\.$", said, re.MULTILINE)
    assert "WARNING: no patch enters the study" in said  # from the job's log


def test_a_failed_step_shows_its_own_error_and_nothing_else(tiny):
    tiny.change(
        macroscale={"target_pressure_MPa": 5000.0, "maximum_displacement_um": 100.0}, hardness=None
    )
    result = tiny.run("results-tiny/macroscale/contact.h5")
    assert result.returncode != 0
    said = result.stdout + result.stderr
    for words in ("composite.h5", "5000 MPa cannot be reached", "Lower target_pressure_MPa"):
        assert said.count(words) == 1, said
    assert "step: Pressing the square" in said
    assert "log:  results-tiny/logs/solve_macroscale.log" in said
    assert "Repeat the same command to go on from there." in said
    assert not [word for word in NOT_FOR_USERS if word in said], said
    assert len(said.splitlines()) <= 8
    assert not (tiny.results / "macroscale/contact.h5").exists()
