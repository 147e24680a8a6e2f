"""The answer says what the tables say, and no more."""

import math

import pandas as pd
import pytest
from gst.page.verdict import MODELS, used, where_to_scan
from gst.page.verdict import verdict as verdict_of
from gstlib.coupling.placement import AGREES, CANNOT_TELL, ELSEWHERE
from gstlib.macroscale.sampling_sites import Concentration
from gstlib.use.infer import NOT_PRESSED, PERHAPS, PRESSED, UNKNOWN
from gstlib.validation.baselines import BASELINES, ORACLE
from gstlib.wear.archard import BARE, CAPPED, INTERLAYER

NAN = math.nan
TOUCHED = "spearman(touched, mean_wear_depth_um)"
WORE, CONTACT, USED = "Which patches wore?", "Do untouched patches wear less?", "How was it used?"
WHERE, DEEP = "Where within the patches?", "How deep, how much?"
LOAD, SURE = "Which patches bear the load?", "How sure?"


def verdict(tables, **more):
    return verdict_of(tables, force_N=200.0, square_mm=5.0, **more)


def line(question, tables, **more):
    return said_of(verdict(tables, **more))[question]


def said_of(answer):
    """The sentence that answers each question."""
    return {line.question: line.short + line.rest for line in answer.lines}


def loaded(forces, *, studied=True):
    """Pressures and intervals of patches a, b, ... with these forces."""
    names = "abcdefghijklmnop"[: len(forces)]
    pressures = pd.DataFrame({"patch": list(names), "force_N": forces, "in_study": studied})
    pressures["pressure_MPa"] = pressures["force_N"] * 2
    intervals = pressures[["patch", "pressure_MPa"]].assign(low_MPa=1.0, high_MPa=123.4)
    return {"patch_pressures": pressures, "patch_intervals": intervals}


def compared(*, model=BARE, touched=(), mean=(), gain=(), tested=(), volume=(), depth=()):
    """A study of patches a to d, of which nothing touches d, and what differs from its summary."""
    row = {"value": 0.5, "low": 0.4, "high": 0.6, "p_value": NAN, "n": 4, "against": ""}
    rows = [{"model": model, "statistic": "mean(mcc)"} | row | dict(mean)]
    rows += [{"model": "rigid", "statistic": "mean(mcc)"} | row | {"value": 0.4}]
    rows += [{"model": "rigid", "statistic": "relative(map_error)"} | row | {"value": 0.5}]
    of = {"mean(mcc)": 0.45, "relative(map_error)": 0.7, "relative(volume_error)": 1.2}
    rows += [
        {"model": CAPPED, "statistic": name} | row | {"value": value} for name, value in of.items()
    ]
    better = {"value": 0.1, "low": 0.02, "high": 0.2, "p_value": 0.01, "against": "rigid"}
    for name, more in (
        ("mean(attainable_mcc)", {"value": 0.7}),
        ("gain(mcc)", better | dict(gain)),
        ("relative(map_error)", {"value": 0.6, "p_value": 0.0003, "against": "none"}),
        (
            "relative(volume_error)",
            {"value": 1.3, "p_value": 1.0, "against": "rigid"} | dict(volume),
        ),
        ("relative_to_best(map_error)", {"value": 1.2, "against": "rigid"} | dict(depth)),
        ("relative(out_of_contact)", {"value": 1.1, "p_value": 0.02, "against": BARE}),
        ("tested_mean(mcc)", {"p_value": 0.002, "n": 3} | dict(tested)),
    ):
        rows.append({"model": model, "statistic": name} | row | more)
    more = {"low": 0.1, "high": 0.9, "p_value": 0.004}
    # read from a file, an empty cell is missing
    rows.append({"model": NAN, "statistic": TOUCHED} | row | more | dict(touched))
    patches = pd.DataFrame({"patch": list("abcd"), "in_statistics": True})
    lost = {"patch": list("abcd"), "mean_wear_depth_um": [0.2, 0.4, 0.6, 0.05], "above_noise": True}
    lost |= {"loss_fraction": [0.1, 0.2, 0.3, 0.04]}
    lost |= {"mean_depth_where_worn_um": [2.0, 2.0, 2.0, 1.25], "excluded": False, "found": True}
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
    first = line(LOAD, loaded(forces))
    assert named in first
    assert f"{share} of the load on the {len(forces)} patches" in first
    assert f"bear {of_force} of the force" in first
    assert f"{2 * max(forces):g} MPa (95 % interval 1 to 120)" in first


def test_a_single_patch_has_no_share_and_none_may_be_touched():
    assert line(LOAD, loaded([3.0])).startswith("Patch a bears the highest pressure, 6 MPa")
    none = line(LOAD, loaded([0.0, 0.0]), second=True)
    assert "No scanned patch touches under 200 N against the active tool; within" in none
    assert none.endswith("patch a may bear the most, up to 120 MPa.")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, "4 of 4 (patches c, b, a and d): on 4 % to 30 % of the area, 1.2 µm to 2 µm deep"),
        ({"above_noise": [True, True, False, True]}, "3 of 4 (patches b, a and d)"),
        ({"above_noise": [True, True, False, True]}, "; 1 lost what may be noise."),
        ({"loss_fraction": [0.1, 0.2, 0.3, 0.0]}, "3 of 4 (patches c, b and a)"),
        ({"loss_fraction": [0.1, 0.2, 0.3, 0.0]}, "; 1 lost less than the scans can show."),
        ({"loss_fraction": [0.1, 0.2, 0.3, 2e-5]}, ": on less than 0.1 % to 30 % of"),
        ({"found": [False, NAN, False, False]}, "Not known: no scan after use (T1) matches its T0"),
        ({"loss_fraction": 0.0}, "None of 4; 4 lost less than the scans can show."),
        (
            {"mean_wear_depth_um": [NAN, 0.4, NAN, NAN]},
            "1 of 1 (patch b): on 20 % of the area, 2 µm",
        ),
        ({"mean_wear_depth_um": [NAN, 0.4, NAN, NAN]}, "; of 3 more no loss is known."),
    ],
)
def test_which_patches_wore(changes, said):
    tables = compared()
    tables["registration"] = tables["registration"].assign(**changes)
    assert said in line(WORE, tables)


def test_of_many_worn_patches_the_most_worn_is_named():
    names = list("abcdefgh")
    of = {"mean_wear_depth_um": range(8), "loss_fraction": 0.5, "mean_depth_where_worn_um": 1.0}
    of |= {"above_noise": True, "excluded": False, "found": True}
    many = pd.DataFrame({"patch": names} | of)
    tables = compared() | loaded([1.0] * 9) | {"registration": many}
    assert line(WORE, tables).startswith("8 of 8, patch h the most: on 50 % of the area, 1 µm deep")
    assert line(WORE, tables).endswith("; of 1 more no loss is known.")


@pytest.mark.parametrize(
    ("gain", "words"),
    [
        ({}, "; better than the best baseline"),
        ({"value": -0.1, "low": -0.2, "high": -0.01}, "; worse than the best baseline"),
        ({"low": -0.1}, "; not shown to be better or worse than the best baseline"),
        ({"p_value": 0.06}, "; not shown to be better or worse than the best baseline"),
        (dict.fromkeys(("low", "high", "p_value"), NAN), "; not shown to be better or worse than"),
    ],
)
def test_the_prediction_against_its_best_baseline(gain, words):
    """A difference must show in the interval and in the test."""
    tables = compared(gain=gain)
    assert words in line(WHERE, tables)
    assert line(WHERE, tables).endswith(", a rigid flat sunk equally deep into every patch.")
    detail = verdict(tables).details[0]
    assert detail.startswith("From the wear of the other patches, Archard's law predicts where")
    numbers = "mean MCC of 0.50 (0 is chance, 1 perfect; 95 % interval 0.40 to 0.60)"
    assert f"{numbers} over 4 patches." in detail
    p = "not tested" if math.isnan(gain.get("p_value", 0)) else f"p = {gain.get('p_value', 0.01)}"
    assert detail.endswith(f"a rigid flat sunk equally deep into every patch, reaches 0.40 ({p}).")


def test_map_volume_and_the_yielding_case():
    tables = compared()
    errors = "Its maps err 0.6 times as much as no loss would (p < 0.001), its volumes 1.3 times"
    said = verdict(tables).details[1]
    assert said.startswith("Masks of the predicted areas could reach 0.70. ")
    assert said.endswith(f"{errors} as much as the best baseline's (p > 0.99).")
    said = verdict(tables, pressure_cap=2000.0).details[1]
    assert "If no element bears more than 2000 MPa (quartz indents at" in said
    assert said.endswith("the mean MCC is 0.45, and these errors are 0.7 and 1.2 times.")


def test_depths_and_volumes_against_the_best_baseline_of_each():
    """Of depths, no loss is one of them."""
    rigid = "a rigid flat sunk equally deep into every patch"
    better = {"value": 0.52, "low": 0.4, "high": 0.7, "p_value": 0.002}
    said = line(DEEP, compared(depth=better))
    assert said.startswith(
        f"Depths err 0.52 times as much as the best baseline, {rigid}: better (p = 0.002)"
    )
    assert "volumes 1.3 times as much as it:" in said
    said = line(DEEP, compared(depth={"value": 1.5, "against": "none"}))
    assert "the best baseline, no loss: not shown to be better or worse (not tested)" in said
    assert f"volumes 1.3 times as much as the best, {rigid}:" in said


@pytest.mark.parametrize(
    ("count", "status", "excluded", "marks"),
    [
        (4, [AGREES, AGREES, AGREES], 0, "●○○ ●●● ●●●"),
        (6, [AGREES, ELSEWHERE, AGREES], 1, "●●○ ●●○ ●●○"),
        (11, [CANNOT_TELL] * 3, 3, "●●● ●○○ ●○○"),
    ],
)
def test_how_sure_it_is_is_computed(count, status, excluded, marks):
    tables = compared()
    tables["validation_patches"] = pd.DataFrame({"p_value": [NAN] * count, "in_statistics": True})
    tables["placement"] = pd.DataFrame({"status": status})
    tables["registration"].loc[: excluded - 1, "excluded"] = excluded > 0
    said = line(SURE, tables)
    assert " ".join(word for word in said.split() if set(word) <= set("●○")) == marks


@pytest.mark.parametrize(
    ("volume", "words"),
    [
        (
            {"value": 0.5, "low": 0.4, "high": 0.9, "p_value": 0.01},
            "0.5 times as much as it: better (p",
        ),
        ({"value": 1.5, "low": 1.1, "high": 2.0, "p_value": 0.01}, ": worse (p = 0.01)"),
        (
            {"value": 0.5, "low": 0.4, "high": 0.9, "p_value": 0.2},
            ": not shown to be better or worse",
        ),
        ({"value": 0.5, "low": 0.4, "high": 1.1, "p_value": 0.01}, ": not shown to be better or"),
    ],
)
def test_a_volume_is_better_where_interval_and_test_show_it(volume, words):
    assert words in line(DEEP, compared(volume=volume))


def test_interlayer_and_gesture_are_named():
    interlayer = {"young_MPa": 300.0, "poisson": 0.3, "thickness_um": 250.0}
    exposed = {"patch": ["a", "b"], "exposure_N_per_mm": [1.0, 3.0], "touched": [1.0, 0.25]}
    tables = compared(model=INTERLAYER) | {"exposure": pd.DataFrame(exposed)}
    first, _, out, *_ = verdict(tables, interlayer=interlayer, poses=7).details
    assert (
        "law over a gesture of 7 poses with an interlayer of 300 MPa, 250 µm thick, predicts"
        in first
    )
    assert "err 1.1 times as much as those of the bare stone (p = 0.02)" in out
    load = line(LOAD, tables, interlayer=interlayer, poses=7)
    assert "patch b is exposed most; 25 % of them touch it" in load
    # fitted, but with no interlayer: the bare stone is scored
    assert "interlayer" not in verdict(compared(), interlayer=None).details[0]


FALLING, NOTHING = {"low": -0.9, "high": -0.1}, {"low": NAN, "high": NAN, "p_value": NAN}


@pytest.mark.parametrize(
    ("touched", "start", "p"),
    [
        ({}, "Yes: ", "p = 0.004"),
        (FALLING, "No, they wore more: ", "p = 0.004"),
        ({"p_value": 0.2}, "Not shown: ", "p = 0.2"),
        (NOTHING, "Not shown: ", "not tested"),
    ],
)
def test_untouched_patches(touched, start, p):
    tables = compared(touched=touched)
    lost = (
        "the patch that the stated load does not touch lost 0.05 µm on average, the 3 others 0.4 µm"
    )
    assert line(CONTACT, tables) == f"{start}{lost} ({p})."
    # the load that the wear itself tells touches those that wore: it shows nothing
    shaped = tables["patch_pressures"].assign(pressure_MPa=1.0, stated_MPa=[2.0, 4.0, 6.0, 0.0])
    assert line(CONTACT, tables | {"patch_pressures": shaped}) == line(CONTACT, tables)
    tables["registration"].loc[3, "mean_wear_depth_um"] = 2e-6
    assert "lost less than 0.01 µm on average" in line(CONTACT, tables)
    tables["registration"]["above_noise"] = [True, True, True, False]
    assert line(CONTACT, tables).startswith("Not tested")


def test_a_study_says_only_what_it_can():
    for p, said in (
        (0.002, "Better than by chance (p = 0.002 over 3 patches), predicted"),
        (0.06, "Not shown (p = 0.06 over 3 patches), predicted"),
        (NAN, "Not tested against chance, predicted"),
    ):
        assert line(WHERE, compared(tested={"p_value": p})).startswith(said)
    unused = verdict(loaded([1.0, 2.0]))
    assert list(said_of(unused)) == [WORE, LOAD]
    assert "no prediction is compared" in said_of(unused)[WORE]
    assert not unused.details
    assert list(said_of(verdict(loaded([0.0, 0.0], studied=False)))) == [WORE, LOAD]
    left_out = verdict(compared() | loaded([1.0, 2.0], studied=False))
    assert list(said_of(left_out)) == [WORE, CONTACT, WHERE, LOAD, SURE]
    assert "No patch is in the study" in said_of(left_out)[WHERE]
    tables = compared()
    unfitted = tables["validation_summary"].query("model != model")
    assert "could be predicted" in line(WHERE, tables | {"validation_summary": unfitted})
    nothing = NOTHING | {"value": NAN, "against": NAN, "n": 0}
    found = verdict(compared(mean=nothing, gain=nothing))
    assert "lost enough" in said_of(found)[WHERE]
    assert not any("nan" in said for said in said_of(found).values())
    assert not any("nan" in said for said in found.details)


def inferred(**more):
    """The table ``use``."""
    names = ["load_point_x", "load_point_y", "spread", "radius"]
    use = pd.DataFrame({"parameter": names, "stated": [2.5, 2.5, NAN, 200.0]})
    use = use.assign(mean=[2.24, 3.14, 0.72, 169.8], low=[2, 3, 0.41, 133.1])
    use = use.assign(high=[2.5, 3.3, 1.1, 224.1], answer=PRESSED, competitor="a spot of wear")
    return use.assign(effective_draws=99.0, taken="yes", **more)


def test_the_use_is_said_with_what_was_stated():
    said = line(USED, compared() | {"use": inferred()})
    assert said.startswith(
        "Pressed about x 2.2 mm and y 3.1 mm, ± 0.7 mm, against a tool of 170 mm radius at 200 N"
    )
    assert "x 2.0 to 2.5, y 3.0 to 3.3 mm, ± 0.4 to 1.1 mm, radius 130 to 220 mm)" in said
    assert "Stated were x 2.5 and y 2.5 mm and 200 mm." in said
    assert "a spot of wear is the best" in said
    flat = inferred()[:3]
    assert not any("radius" in text for text in used(flat, 5.0, 550.0))
    # a use that is taken has seen every loss, which the details add
    told, read = (compared() | {"use": inferred().assign(taken=taken)} for taken in (False, True))
    assert len(verdict(read).details) == len(verdict(told).details) + 1


@pytest.mark.parametrize(
    ("answer", "short", "goes_on"),
    [
        (PRESSED, "Pressed about x 2.2 mm", None),
        (PERHAPS, "Perhaps pressed about x 2.2 mm", "under this use"),
        (NOT_PRESSED, "Not shown", "as stated"),
        (f"{UNKNOWN}, because only 3 of 90 uses count", "Cannot be inferred", "as stated"),
    ],
)
def test_each_answer_says_how_the_study_goes_on(answer, short, goes_on):
    begins, rest = used(inferred().assign(answer=answer), 5.0, 550.0)
    assert begins.startswith(short)
    if goes_on is None:
        assert "goes on" not in rest
    else:
        assert rest.endswith(f"The study goes on {goes_on}.")
    # a reason in place of a place, and a competitor where there is a score
    assert ("because only 3 of 90 uses count" in rest) == answer.startswith(UNKNOWN)
    assert ("a spot of wear" in rest) != answer.startswith(UNKNOWN)
    assert ("Stated were" in rest) == ("pressed about" in begins.lower())


def test_a_use_that_may_lie_beyond_the_square_is_at_its_edge():
    """Its side is known, its place is not."""
    low, high = [-0.1, 3, 0.41, 133.1], [2.5, 5.1, 1.1, 224.1]
    short, rest = used(inferred().assign(low=low), 5.0, 550.0)
    assert short == "Pressed near or beyond the edge x = 0 mm of the square"
    assert rest.startswith(": about x 2.2 mm and y 3.1 mm")
    assert "x \N{MINUS SIGN}0.1 to 2.5" in rest
    assert "intervals are too narrow" in rest
    both = inferred().assign(low=low, high=high, answer=PERHAPS)
    edges = "the edges x = 0 and y = 5 mm of the square"
    assert used(both, 5.0, 550.0)[0] == f"Perhaps pressed near or beyond {edges}"


def test_the_law_that_predicts_best_is_named():
    laws = pd.DataFrame({"law": ["archard", "threshold", "higher exponent", "touched"]}).assign(
        mean=[NAN, 3.04, 1.52, NAN], low=[NAN, 1.2, 1.4, NAN], high=[NAN, 8.1, 2.0, NAN]
    )
    laws = laws.assign(gain=[0.0, -2.0, 4.06, -9.0], gain_error=[0.0, 1.0, 1.2, 3.0])
    question = "Which law predicts best?"

    def said(answer, law=None):
        tables = compared() | {"laws": laws.assign(answer=answer)}
        return line(question, tables, wear_law=law)

    best = "An exponent of pressure of 1.5 (95 %: 1.4 to 2): it predicts the losses better than"
    assert said("higher exponent").startswith(best)
    assert "(log score +4.1 ± 1.2). Set wear_law.exponent" in said("higher exponent")
    assert "wear_law" not in said("higher exponent", {"threshold_MPa": 0.0, "exponent": 1.5})
    assert said("archard").startswith("Archard's law: ")
    assert said("undecided").startswith("The data cannot tell: ")
    assert "better" not in said("undecided")
    assert question not in said_of(verdict(compared() | {"laws": laws[:0].assign(answer="")}))
    # the text does not say Archard's where the config says another law
    other = verdict(compared(), wear_law={"threshold_MPa": 2.0, "exponent": 1.0})
    assert "the wear law in the config predicts" in other.details[0]


def test_every_model_has_words():
    assert set(MODELS) == {BARE, INTERLAYER, CAPPED, *BASELINES, ORACLE}


def test_where_to_scan_is_said_with_its_numbers():
    places = pd.DataFrame({"place": ["E1", "E2", "C1"], "x_mm": [1.55, 2, 4], "y_mm": [2.1, 4, 4]})
    places["kind"] = ["exposed", "exposed", "control"]
    held = Concentration(0.824, 0.0153, 0.94, 0.0578)
    scan, controls, spread = said_of(
        where_to_scan(places, held, force_N=550.0, square_mm=5.0)
    ).values()
    assert spread.startswith(
        "82 % of the exposure lies in the square, half of that on 1.5 % of its area"
    )
    assert scan.startswith("Scan E1 to E2: of the square's exposure, 94 % lies there, on 6 %")
    assert "most in E1, 1.55 mm along x and 2.1 mm along y" in scan
    assert controls == "Scan C1 as controls: no pose touches them."
    assert (
        "no control" in where_to_scan(places[:2], held, force_N=550.0, square_mm=5.0).lines[1].short
    )
    (nothing,) = said_of(where_to_scan(places[2:], held, force_N=550.0, square_mm=5.0)).values()
    assert nothing.startswith("No pose touches the square")
