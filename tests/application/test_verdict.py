"""The answer says what the tables say, and no more."""

import math

import pandas as pd
import pytest
from gst.verdict import MODELS, where_to_scan
from gst.verdict import verdict as verdict_of
from gstlib.macroscale.sampling_sites import Concentration
from gstlib.validation.baselines import BASELINES, ORACLE
from gstlib.wear.archard import BARE, CAPPED, INTERLAYER

NAN = math.nan
TOUCHED = "spearman(touched, mean_wear_depth_um)"


def verdict(tables, **more):
    return verdict_of(tables, force_N=200.0, **more)


def loaded(forces, *, studied=True):
    """Pressures and intervals of patches a, b, ... with these forces."""
    names = "abcdefghijklmnop"[: len(forces)]
    pressures = pd.DataFrame({"patch": list(names), "force_N": forces, "in_study": studied})
    pressures["pressure_MPa"] = pressures["force_N"] * 2
    intervals = pressures[["patch", "pressure_MPa"]].assign(low_MPa=1.0, high_MPa=123.4)
    return {"patch_pressures": pressures, "patch_intervals": intervals}


def compared(*, model=BARE, p_values=(0.01, 0.2, 0.3, NAN), touched=(), mean=(), gain=()):
    """A study of patches a to d, of which nothing touches d, and what differs from its summary."""
    row = {"value": 0.5, "low": 0.4, "high": 0.6, "p_value": NAN, "n": 4, "against": ""}
    rows = [{"model": model, "statistic": "mean(mcc)"} | row | dict(mean)]
    rows += [{"model": "rigid", "statistic": "mean(mcc)"} | row | {"value": 0.4}]
    of = {"mean(mcc)": 0.45, "relative(map_error)": 0.7, "relative(volume_error)": 1.2}
    rows += [
        {"model": CAPPED, "statistic": name} | row | {"value": value} for name, value in of.items()
    ]
    better = {"value": 0.1, "low": 0.02, "high": 0.2, "p_value": 0.01, "against": "rigid"}
    for name, more in (
        ("mean(attainable_mcc)", {"value": 0.7}),
        ("gain(mcc)", better | dict(gain)),
        ("relative(map_error)", {"value": 0.6, "p_value": 0.03, "against": "none"}),
        ("relative(volume_error)", {"value": 1.3, "p_value": 1.0, "against": "mean_volume"}),
        ("relative(out_of_contact)", {"value": 1.1, "p_value": 0.02, "against": BARE}),
        ("tested_mean(mcc)", {"p_value": 0.002, "against": "other patches' predictions"}),
    ):
        rows.append({"model": model, "statistic": name} | row | more)
    more = {"low": 0.1, "high": 0.9, "p_value": 0.004}
    # read from a file, an empty cell is missing
    rows.append({"model": NAN, "statistic": TOUCHED} | row | more | dict(touched))
    patches = pd.DataFrame(
        {"patch": list("abcd"), "p_value": list(p_values), "in_statistics": True}
    )
    lost = {"patch": list("abcd"), "mean_wear_depth_um": [0.2, 0.4, 0.6, 0.05], "above_noise": True}
    return loaded([1.0, 2.0, 3.0, 0.0]) | {
        "registration": pd.DataFrame(lost),
        "validation_patches": patches,
        "validation_summary": pd.DataFrame(rows),
    }


@pytest.mark.parametrize(
    ("forces", "named", "share", "of_force"),
    [
        ([1.0, 30.0, 31.0, 8.0], "c and b carry", "87 %", "35 %"),
        ([60.0, 1.0, 1.0], "Patch a carries", "97 %", "31 %"),
        ([10.0] * 16, "spread: 9 patches", "56 %", "80 %"),
    ],
)
def test_the_fewest_patches_that_carry_most_of_the_load(forces, named, share, of_force):
    first = verdict(loaded(forces))[0]
    assert named in first
    assert f"{share} of the load on the {len(forces)} patches" in first
    assert f"bear {of_force} of the force" in first
    assert f"{2 * max(forces):g} MPa (95 % interval 1 to 120)" in first


def test_a_single_patch_has_no_fraction_and_none_may_be_touched():
    assert verdict(loaded([3.0]))[0].startswith("Patch a bears the highest pressure, 6 MPa")
    none = verdict(loaded([0.0, 0.0]), second=True)[0]
    assert "against the active tool, no scanned patch touches; within" in none
    assert none.endswith("patch a may bear the most, up to 120 MPa.")


@pytest.mark.parametrize(
    ("gain", "words"),
    [
        ({}, ": better than the best baseline"),
        ({"value": -0.1, "low": -0.2, "high": -0.01}, ": worse than the best baseline"),
        ({"low": -0.1}, ": not shown to be better or worse than the best baseline"),
        ({"p_value": 0.06}, ": not shown to be better or worse than the best baseline"),
        (dict.fromkeys(("low", "high", "p_value"), NAN), ": not shown to be better or worse than"),
    ],
)
def test_the_prediction_against_its_best_baseline(gain, words):
    """A difference must show in the interval and in the test."""
    said = verdict(compared(gain=gain))[0]
    assert said.startswith("From the wear of the other patches, Archard's law predicts where")
    numbers = "mean MCC of 0.50 (0 is chance, 1 perfect; 95 % interval 0.40 to 0.60)"
    assert f"{numbers} over 4 patches{words}" in said
    p = "not tested" if math.isnan(gain.get("p_value", 0)) else f"p = {gain.get('p_value', 0.01)}"
    assert said.endswith(f"a rigid flat sunk equally deep into every patch (0.40, {p}).")


def test_map_volume_and_the_yielding_case():
    tables = compared()
    errors = "Its maps err 0.6 times as much as no loss would (p = 0.03), its volumes 1.3 times"
    said = verdict(tables)[1]
    assert said.startswith("Masks of the predicted areas could reach 0.70. ")
    assert said.endswith(f"{errors} as much as the best baseline's (p = 1).")
    said = verdict(tables, pressure_cap=2000.0)[1]
    assert "If no element bears more than 2000 MPa (quartz indents at" in said
    assert said.endswith("the mean MCC is 0.45, and these errors are 0.7 and 1.2 times.")


def test_interlayer_and_gesture_are_named():
    interlayer = {"young_MPa": 300.0, "poisson": 0.3, "thickness_um": 250.0}
    exposed = {"patch": ["a", "b"], "exposure_N_per_mm": [1.0, 3.0], "touched": [1.0, 0.25]}
    tables = compared(model=INTERLAYER) | {"exposure": pd.DataFrame(exposed)}
    first, _, out, *_, last = verdict(tables, interlayer=interlayer, poses=7)
    assert (
        "law over a gesture of 7 poses with an interlayer of 300 MPa, 250 µm thick, predicts"
        in first
    )
    assert "err 1.1 times as much as those of the bare stone (p = 0.02)" in out
    assert "patch b is exposed most; 25 % of them touch it" in last
    # fitted, but with no interlayer: the bare stone is scored
    assert "interlayer" not in verdict(compared(), interlayer=None)[0].replace("mate", "")


FALLING, NOTHING = {"low": -0.9, "high": -0.1}, {"low": NAN, "high": NAN, "p_value": NAN}


@pytest.mark.parametrize(
    ("touched", "words"),
    [
        ({}, "untouched patches wear less (p = 0.004)"),
        (FALLING, "untouched patches wear more"),
        ({"p_value": 0.2}, "this does not show that untouched patches wear less (p = 0.2)"),
        (NOTHING, "wear less (not tested)"),
    ],
)
def test_untouched_patches(touched, words):
    said = verdict(compared(touched=touched))[2]
    lost = "The patch that nothing touches lost 0.05 µm on average, the 3 touched 0.4 µm: "
    assert said.startswith(lost)
    assert words in said
    tables = compared()
    tables["registration"]["above_noise"] = [True, True, True, False]
    assert not any("nothing touches" in sentence for sentence in verdict(tables))


def test_a_study_says_only_what_it_can():
    said = verdict(compared())[3]
    assert said.startswith("On 1 of the 3 patches that can be tested")
    assert said.endswith("(p ≤ 0.05; together p = 0.002); 1 cannot be tested.")
    untested = verdict(compared(p_values=[NAN] * 4))
    assert untested[3] == "No patch can be tested against chance."
    (_, none) = verdict(loaded([1.0, 2.0]))
    assert "no prediction is compared" in none
    (_, none) = verdict(compared() | loaded([1.0, 2.0], studied=False))
    assert "No patch is in the study" in none
    tables = compared()
    unfitted = tables["validation_summary"].query("model != model")
    assert "could be predicted" in verdict(tables | {"validation_summary": unfitted})[-1]
    nothing = NOTHING | {"value": NAN, "against": NAN, "n": 0}
    assert "lost enough" in verdict(compared(mean=nothing, gain=nothing))[0]
    assert not any("nan" in sentence for sentence in verdict(compared(mean=nothing)))


def test_every_model_has_words():
    assert set(MODELS) == {BARE, INTERLAYER, CAPPED, *BASELINES, ORACLE}


def test_where_to_scan_is_said_with_its_numbers():
    places = pd.DataFrame({"place": ["E1", "E2", "C1"], "x_mm": [1.55, 2, 4], "y_mm": [2.1, 4, 4]})
    places["kind"] = ["exposed", "exposed", "control"]
    held = Concentration(0.824, 0.0153, 0.94, 0.0578)
    scan, controls, spread = where_to_scan(places, held, force_N=550.0)
    assert spread.startswith("Under 550 N, wherever the hand pushes, 82 % of the exposure")
    assert "half of it on 1.5 % of its area" in spread
    assert scan.startswith("Scan E1 to E2: of the square's exposure, 94 % lies there, on 6 %")
    assert "most in E1, 1.55 mm along x and 2.1 mm along y" in scan
    assert controls == "No pose touches C1: scan them as controls."
    assert "no control" in where_to_scan(places[:2], held, force_N=550.0)[1]
    (nothing,) = where_to_scan(places[2:], held, force_N=550.0)
    assert nothing.startswith("No pose touches the square")
