"""What a person sees of a step that failed; the rest of the display: tests/library/test_logs.py."""

NOT_FOR_USERS = ("Traceback", "RuleException", "CalledProcessError", 'File "', "InputFunction")


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
