"""The answer says what the tables say, and no more."""

import math
import re

import pandas as pd
import pytest
from gst.page.verdict import MODELS, TOUCHED, where_to_scan
from gst.page.verdict import verdict as verdict_of
from gstlib.coupling.comparison import AGREES, CANNOT_TELL, ELSEWHERE
from gstlib.macroscale.sampling_sites import Concentration
from gstlib.use.infer import NOT_PRESSED, PERHAPS, PRESSED, UNKNOWN
from gstlib.validation.baselines import BASELINES, ORACLE
from gstlib.validation.summary import separated
from gstlib.wear.archard import BARE, CAPPED, INTERLAYER

NAN = math.nan
WORE, CONTACT, USED = "Which patches wore?", "Do untouched patches wear less?", "How was it used?"
WHERE, DEEP = "Where within the patches?", "How deep, how much?"
LOAD, SURE, LAW = "Which patches bear the load?", "How sure?", "Which law predicts best?"
SHOWN = {1: "better than", -1: "worse than", 0: "not shown to be better or worse"}


def verdict(tables, **more):
    return verdict_of(tables, force_N=200.0, square_mm=5.0, **more)


def line(question, tables, **more):
    return sentences(verdict(tables, **more))[question]


def sentences(answer):
    """The sentence that answers each question."""
    return {line.question: line.short + line.rest for line in answer.lines}


def numbers(text):
    """The numbers of a sentence, in their order."""
    return [float(number) for number in re.findall(r"(?<!\w)\d+(?:\.\d+)?", text)]


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
        "validation_summary": separated(pd.DataFrame(rows)),
    }


@pytest.mark.parametrize(
    ("forces", "first", "percent"),
    [
        ([1.0, 30.0, 31.0, 8.0], "Patches c and b carry", [87, 4, 35, 62, 95, 1, 120]),
        ([60.0, 1.0, 1.0], "Patch a carries", [97, 3, 31, 120, 95, 1, 120]),
        ([10.0] * 16, "The load is spread", [9, 56, 16, 80, 20, 95, 1, 120]),
        ([3.0], "Patch a bears the highest", [6, 95, 1, 120]),
        ([0.0, 0.0], "No scanned patch touches", [200, 95, 120]),
    ],
)
def test_the_fewest_patches_that_carry_most_of_the_load(forces, first, percent):
    sentence = line(LOAD, loaded(forces))
    assert sentence.startswith(first)
    assert numbers(sentence) == percent


@pytest.mark.parametrize(
    ("changes", "patches", "counts"),
    [
        ({}, "cbad", [4, 4, 4, 30, 1.2, 2]),
        ({"above_noise": [True, True, False, True]}, "bad", [3, 4, 4, 20, 1.2, 2, 1]),
        ({"loss_fraction": [0.1, 0.2, 0.3, 0.0]}, "cba", [3, 4, 10, 30, 2, 1]),
        ({"loss_fraction": [0.1, 0.2, 0.3, 2e-5]}, "cbad", [4, 4, 0.1, 30, 1.2, 2]),
        ({"loss_fraction": 0.0}, "", [4, 4]),
        ({"mean_wear_depth_um": [NAN, 0.4, NAN, NAN]}, "b", [1, 1, 20, 2, 3]),
        ({"found": [False, NAN, False, False]}, "", []),
    ],
)
def test_which_patches_wore(changes, patches, counts):
    tables = compared()
    tables["registration"] = tables["registration"].assign(**changes)
    sentence = line(WORE, tables)
    named = re.search(r"\(patch(?:es)? ([^)]*)\)", sentence)
    assert "".join(re.findall(r"\b[a-d]\b", named[1] if named else "")) == patches
    assert numbers(sentence) == counts


def test_of_many_worn_patches_the_most_worn_is_named():
    columns = {"mean_wear_depth_um": range(8), "loss_fraction": 0.5, "above_noise": True}
    columns |= {"mean_depth_where_worn_um": 1.0, "excluded": False, "found": True}
    many = pd.DataFrame({"patch": list("abcdefgh")} | columns)
    sentence = line(WORE, compared() | loaded([1.0] * 9) | {"registration": many})
    assert "patch h the most" in sentence
    assert numbers(sentence) == [8, 8, 50, 1, 1]


@pytest.mark.parametrize(
    ("gain", "shown"),
    [
        ({}, 1),
        ({"value": -0.1, "low": -0.2, "high": -0.01}, -1),
        ({"low": -0.1}, 0),
        ({"p_value": 0.06}, 0),
        (dict.fromkeys(("low", "high", "p_value"), NAN), 0),
    ],
)
def test_the_prediction_against_its_best_baseline(gain, shown):
    """A difference must show in the interval and in the test."""
    tables = compared(gain=gain)
    sentence = line(WHERE, tables)
    assert SHOWN[shown] in sentence
    assert MODELS["rigid"] in sentence
    p_value = [] if math.isnan(gain.get("p_value", 0)) else [gain.get("p_value", 0.01)]
    expected = [0.5, 0, 1, 95, 0.4, 0.6, 4, 0.4, *p_value]
    assert numbers(verdict(tables).details[0]) == expected


@pytest.mark.parametrize(
    ("ratio", "shown"),
    [
        ({"value": 0.5, "low": 0.4, "high": 0.9, "p_value": 0.01}, 1),
        ({"value": 1.5, "low": 1.1, "high": 2.0, "p_value": 0.01}, -1),
        ({"value": 0.5, "low": 0.4, "high": 0.9, "p_value": 0.2}, 0),
        ({"value": 0.5, "low": 0.4, "high": 1.1, "p_value": 0.01}, 0),
    ],
)
def test_an_error_is_better_where_interval_and_test_show_it(ratio, shown):
    depth, volume = (line(DEEP, compared(**{name: ratio})) for name in ("depth", "volume"))
    word = SHOWN[shown].removesuffix(" than")
    assert f"{MODELS['rigid']}: {word} (" in depth
    assert f"times as much as it: {word} (" in volume
    assert numbers(depth)[0] == numbers(volume)[1] == ratio["value"]
    # of depths, no loss is one of the baselines
    assert MODELS["none"] in line(DEEP, compared(depth=ratio | {"against": "none"}))


def test_errors_of_the_prediction_and_with_a_cap():
    assert numbers(verdict(compared()).details[1]) == [0.7, 0.6, 0.001, 1.3, 0.99]
    capped = verdict(compared(), pressure_cap=2000.0).details[1]
    assert numbers(capped)[5:] == [2000, 11, 12, 0.15, 0.3, 0.45, 0.7, 1.2]


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
    assert " ".join(re.findall("[●○]+", line(SURE, tables))) == marks


def test_interlayer_and_gesture_are_named():
    interlayer = {"young_MPa": 300.0, "poisson": 0.3, "thickness_um": 250.0}
    exposed = {"patch": ["a", "b"], "exposure_N_per_mm": [1.0, 3.0], "touched": [1.0, 0.25]}
    tables = compared(model=INTERLAYER) | {"exposure": pd.DataFrame(exposed)}
    answer = verdict(tables, interlayer=interlayer, poses=7)
    assert numbers(answer.details[0])[:3] == [7, 300, 250]
    assert numbers(answer.details[2]) == [1.1, 0.02]
    load = sentences(answer)[LOAD]
    assert "patch b is exposed most" in load
    assert numbers(load)[-2:] == [7, 25]
    # fitted, but with no interlayer: the bare stone is scored
    assert "interlayer" not in verdict(compared(), interlayer=None).details[0]


NOTHING = {"low": NAN, "high": NAN, "p_value": NAN}


@pytest.mark.parametrize(
    ("touched", "start"),
    [
        ({}, "Yes"),
        ({"low": -0.9, "high": -0.1}, "No, they wore more"),
        ({"p_value": 0.2}, "Not shown"),
        (NOTHING, "Not shown"),
    ],
)
def test_untouched_patches(touched, start):
    tables = compared(touched=touched)
    sentence = line(CONTACT, tables)
    assert sentence.startswith(f"{start}: ")
    assert numbers(sentence)[:3] == [0.05, 3, 0.4]
    # the load that the wear itself tells touches those that wore: it shows nothing
    shaped = tables["patch_pressures"].assign(pressure_MPa=1.0, stated_MPa=[2.0, 4.0, 6.0, 0.0])
    assert line(CONTACT, tables | {"patch_pressures": shaped}) == sentence
    tables["registration"]["above_noise"] = [True, True, True, False]
    assert line(CONTACT, tables).startswith("Not tested")


@pytest.mark.parametrize(
    ("p_value", "start"),
    [(0.002, "Better than by chance"), (0.06, "Not shown"), (NAN, "Not tested against chance")],
)
def test_the_place_of_the_loss_against_chance(p_value, start):
    sentence = line(WHERE, compared(tested={"p_value": p_value}))
    assert sentence.startswith(start)
    assert numbers(sentence) == ([] if math.isnan(p_value) else [p_value, 3])


def test_a_study_says_only_what_it_can():
    unused = verdict(loaded([1.0, 2.0]))
    assert list(sentences(unused)) == [WORE, LOAD]
    assert not unused.details
    tables = compared()
    left_out = sentences(verdict(tables | loaded([1.0, 2.0], studied=False)))
    assert list(left_out) == [WORE, CONTACT, WHERE, LOAD, SURE]
    unfitted = {"validation_summary": tables["validation_summary"].query("model != model")}
    nothing = NOTHING | {"value": NAN, "against": NAN, "n": 0}
    unlost = verdict(compared(mean=nothing, gain=nothing))
    cases = left_out[WHERE], line(WHERE, tables | unfitted), sentences(unlost)[WHERE]
    assert len({*cases, line(WHERE, tables)}) == 4
    assert not any("nan" in text for text in [*sentences(unlost).values(), *unlost.details])


def inferred(**more):
    """The table ``use``."""
    names = ["load_point_x", "load_point_y", "spread", "radius"]
    use = pd.DataFrame({"parameter": names, "prior": [2.5, 2.5, NAN, 200.0]})
    use = use.assign(mean=[2.24, 3.14, 0.72, 169.8], low=[2, 3, 0.41, 133.1])
    use = use.assign(high=[2.5, 3.3, 1.1, 224.1], answer=PRESSED, competitor="a spot of wear")
    return use.assign(effective_sample_size=99.0, adopted="yes", **more)


def used(use, square_mm=5.0):
    answer = verdict_of(loaded([1.0]) | {"use": use}, force_N=550.0, square_mm=square_mm)
    return next(line for line in answer.lines if line.question == USED)


def test_the_use_is_said_with_what_was_stated():
    _, short, rest = used(inferred())
    assert numbers(short) == [2.2, 3.1, 0.7, 170, 550]
    assert numbers(rest) == [95, 2.0, 2.5, 3.0, 3.3, 0.4, 1.1, 130, 220, 2.5, 2.5, 200]
    assert "a spot of wear" in rest
    assert not any("radius" in text for text in used(inferred()[:3]))
    # a use that is taken has seen every loss, which the details add
    told, read = (
        compared() | {"use": inferred().assign(adopted=adopted)} for adopted in (False, True)
    )
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
    _, begins, rest = used(inferred().assign(answer=answer))
    assert begins.startswith(short)
    assert rest.endswith(f"The study goes on {goes_on}.") == (goes_on is not None)
    # a reason in place of a place, and a competitor where there is a score
    assert ("because only 3 of 90 uses count" in rest) == answer.startswith(UNKNOWN)
    assert ("a spot of wear" in rest) != answer.startswith(UNKNOWN)


def test_a_use_that_may_lie_beyond_the_square_is_at_its_edge():
    """Its side is known, its place is not."""
    low, high = [-0.1, 3, 0.41, 133.1], [2.5, 5.1, 1.1, 224.1]
    _, short, rest = used(inferred().assign(low=low))
    assert "the edge x = 0 mm" in short
    assert "x \N{MINUS SIGN}0.1 to 2.5" in rest
    _, short, _ = used(inferred().assign(low=low, high=high, answer=PERHAPS))
    assert short.startswith("Perhaps")
    assert "the edges x = 0 and y = 5 mm" in short


def test_the_law_that_predicts_best_is_named():
    laws = pd.DataFrame({"law": ["archard", "threshold", "higher exponent", "touched"]}).assign(
        mean=[NAN, 3.04, 1.52, NAN], low=[NAN, 1.2, 1.4, NAN], high=[NAN, 8.1, 2.0, NAN]
    )
    laws = laws.assign(
        log_score_gain=[0.0, -2.0, 4.06, -9.0], log_score_gain_error=[0.0, 1.0, 1.2, 3.0]
    )

    def sentence(answer, law=None):
        tables = compared() | {"laws": laws.assign(answer=answer)}
        return line(LAW, tables, wear_law=law)

    assert sentence("higher exponent").startswith("An exponent of pressure")
    assert numbers(sentence("higher exponent")) == [1.5, 95, 1.4, 2, 4.1, 1.2]
    assert "wear_law.exponent" in sentence("higher exponent")
    assert "wear_law" not in sentence("higher exponent", {"threshold_MPa": 0.0, "exponent": 1.5})
    assert sentence("archard").startswith("Archard's law: ")
    assert sentence("undecided").startswith("The data cannot tell: ")
    assert "better" not in sentence("undecided")
    assert LAW not in sentences(verdict(compared() | {"laws": laws[:0].assign(answer="")}))
    # the text does not say Archard's where the config says another law
    other = verdict(compared(), wear_law={"threshold_MPa": 2.0, "exponent": 1.0})
    assert "Archard" not in other.details[0]


def test_every_model_has_words():
    assert set(MODELS) == {BARE, INTERLAYER, CAPPED, *BASELINES, ORACLE}


def test_where_to_scan_is_said_with_its_numbers():
    places = pd.DataFrame({"place": ["E1", "E2", "C1"], "x_mm": [1.55, 2, 4], "y_mm": [2.1, 4, 4]})
    places["kind"] = ["exposed", "exposed", "control"]
    held = Concentration(0.824, 0.0153, 0.94, 0.0578)

    def told(places, **more):
        answer = where_to_scan(places, held, force_N=550.0, square_mm=5.0, **more)
        return list(sentences(answer).values())

    scan, controls, spread = told(places)
    assert scan.startswith("Scan E1 to E2: ")
    assert numbers(scan) == [94, 6, 1.55, 2.1]
    assert "C1" in controls
    assert numbers(spread) == [82, 1.5, 550]
    assert "no control" in told(places[:2])[1]
    (nothing,) = told(places[2:])
    assert nothing.startswith("No pose touches the square")
    flat = inferred().assign(posterior_mean_without_curvature=[1.04, 2.0, NAN, 90.4])
    assert numbers(told(places, use=flat)[0])[-3:] == [1.0, 2.0, 90]
    assert len(told(places, use=flat.assign(posterior_mean_without_curvature=NAN))) == 4
