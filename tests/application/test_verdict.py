"""The answer says what the tables say, and no more."""

import math

import pandas as pd
import pytest
from gst.verdict import verdict as verdict_of
from gst.verdict import where_to_scan
from gstlib.places import Concentration


def verdict(*tables):
    return verdict_of(*tables, force_N=200.0)


def tables(forces, *, studied=True):
    """Pressures and intervals of patches a, b, ... with these forces."""
    names = "abcdefghijklmnop"[: len(forces)]
    pressures = pd.DataFrame({"patch": list(names), "force_N": forces, "in_study": studied})
    pressures["pressure_MPa"] = pressures["force_N"] * 2
    intervals = pressures[["patch", "pressure_MPa"]].assign(low_MPa=1.0, high_MPa=123.4)
    return pressures, intervals


def compared(p_values=(0.01, 0.2, 0.3, math.nan), **row):
    """Gains of patches with these p-values, and variants whose first has this row."""
    gains = pd.DataFrame({"score": "mcc", "p_value": list(p_values)})
    gains = pd.concat([gains, gains.assign(score="f1", p_value=0.001)])
    own = {"variant": "placed", "score": "mcc", "contact": 0.5, "rival": 0.4, "n": len(p_values)}
    own |= {"best_rival": "rigid", "low": 0.02, "high": 0.2, "p_value": 0.01} | row
    other = own | {"variant": "levelled", "contact": 0.11, "rival": 0.22}
    return gains, pd.DataFrame([own | {"score": "f1", "contact": 0.99}, own, other])


@pytest.mark.parametrize(
    ("forces", "named", "share", "of_force"),
    [
        ([1.0, 30.0, 31.0, 8.0], "c and b carry", "87 %", "35 %"),
        ([60.0, 1.0, 1.0], "Patch a carries", "97 %", "31 %"),
        ([10.0] * 16, "spread: 9 patches", "56 %", "80 %"),
    ],
)
def test_the_fewest_patches_that_carry_most_of_the_load(forces, named, share, of_force):
    first = verdict(*tables(forces))[0]
    assert named in first
    assert f"{share} of the load on the {len(forces)} patches" in first
    assert f"bear {of_force} of the force" in first
    assert f"{2 * max(forces):g} MPa (95 % interval 1 to 120)" in first


def test_a_single_patch_has_no_share():
    assert verdict(*tables([3.0]))[0].startswith("Patch a bears the highest pressure, 6 MPa")


def test_patches_that_nothing_touches():
    assert "no scanned patch touches" in verdict(*tables([0.0, 0.0]))[0]


@pytest.mark.parametrize(
    ("row", "words", "numbers"),
    [
        ({}, "Contact predicts the loss better than the best rival", "0.50 against 0.40"),
        (
            {"contact": 0.3, "low": -0.2, "high": -0.1, "best_rival": "highest"},
            "The best rival that needs no mechanics, the highest points, predicts the loss better",
            "0.40 against 0.30",
        ),
        ({"low": -0.1}, "The data do not show", "0.50 against 0.40"),
        ({"p_value": 0.06}, "The data do not show", "p = 0.06"),
        (
            {"low": math.nan, "high": math.nan, "p_value": math.nan},
            "The data do not show",
            "4 patches)",
        ),
        ({"contact": -0.1, "low": -0.2, "high": 0.1}, "The data do not show", "MCC −0.10 against"),
    ],
)
def test_contact_against_its_best_rival(row, words, numbers):
    said = verdict(*tables([1.0, 2.0]), *compared(**row))
    assert len(said) == 3
    assert said[-1].startswith(words)
    assert numbers in said[-1]


def test_contact_against_chance_counts_what_was_tested():
    said = verdict(*tables([1.0, 2.0]), *compared())
    assert "On 1 of the 3 patches that can be tested" in said[1]
    assert said[1].endswith("; 1 cannot be tested.")
    untested = compared(p_values=[math.nan] * 2)
    assert "None of the 2 patches" in verdict(*tables([1.0, 2.0]), *untested)[1]


def test_a_score_without_a_value():
    nothing = dict.fromkeys(("contact", "rival", "low", "high", "p_value", "best_rival"), math.nan)
    assert "no MCC" in verdict(*tables([1.0, 2.0]), *compared(**nothing, n=0))[-1]


def test_a_study_says_only_what_it_can():
    load = verdict(*tables([1.0, 2.0]))
    assert len(load) == 2
    assert "not compared with wear" in load[-1]
    (_, none) = verdict(*tables([1.0, 2.0], studied=False), *compared())
    assert "No patch is in the study" in none
    gains, variants = compared()
    assert "nothing is compared" in verdict(*tables([1.0, 2.0]), gains[:0], variants)[-1]


def test_where_to_scan_is_said_with_its_numbers():
    places = pd.DataFrame(
        {
            "place": ["E1", "E2", "C1"],
            "kind": ["exposed", "exposed", "control"],
            "x_mm": [1.55, 2.0, 4.0],
            "y_mm": [2.1, 4.0, 4.0],
        }
    )
    held = Concentration(0.824, 0.0153, 0.94, 0.0578)
    spread, scan, controls = where_to_scan(places, held, force_N=550.0)
    assert spread.startswith("Under 550 N, wherever the hand pushes, 82 % of the exposure")
    assert "half of it on 1.5 % of its area" in spread
    assert scan.startswith("Scan E1 to E2: of the square's exposure, 94 % lies there, on 6 %")
    assert "most in E1, 1.55 mm along x and 2.1 mm along y" in scan
    assert controls == "No pose touches C1: scan them as controls."
    assert "no control" in where_to_scan(places[:2], held, force_N=550.0)[-1]
    (nothing,) = where_to_scan(places[2:], held, force_N=550.0)
    assert nothing.startswith("No pose touches the square")
