"""The answer says what the tables say, and no more."""

import re

import pandas as pd
import pytest
import yaml
from contacts import written
from in_memory import InMemory

from gst.config.reading import complete
from gst.page import verdict as answers
from gst.page.verdict import MODELS, TOUCHED
from gstlib.coupling.comparison import AGREES, CANNOT_TELL, ELSEWHERE
from gstlib.macroscale.sampling_sites import Concentration
from gstlib.use.infer import NOT_PRESSED, PERHAPS, PRESSED, UNKNOWN
from gstlib.validation.baselines import BASELINES, ORACLE
from gstlib.validation.summary import separated
from gstlib.wear.archard import BARE, CAPPED, INTERLAYER

EXPLAINED = "Does the given load explain the wear?"
WORE, CONTACT = "Which patches wore?", "Do untouched patches wear less?"
USED, LAW = "How was it used?", "Which law predicts best?"
WHERE, DEEP = "Where within the patches?", "How deep, how much?"
LOAD, SURE = "Which patches carry the load?", "How sure?"
UNSHOWN = "not shown to be better or worse"

# As `compared` has them; "own" is the model of the study. Read from a file, an empty cell is NaN.
SUMMARY = f"""model,statistic,value,low,high,p_value,n,against
own,mean(mcc),0.5,0.4,0.6,,4,
own,mean(attainable_mcc),0.7,0.4,0.6,,4,
own,gain(mcc),0.1,0.02,0.2,0.01,4,rigid
own,tested_mean(mcc),0.5,0.4,0.6,0.002,3,
own,relative(map_error),0.6,0.4,0.6,0.0003,4,none
own,relative(volume_error),1.3,0.4,0.6,1.0,4,rigid
own,relative_to_best(map_error),1.2,0.4,0.6,,4,rigid
own,relative(out_of_contact),1.0233,0.4,0.6,0.02,4,{BARE}
rigid,mean(mcc),0.4,0.4,0.6,,4,
{CAPPED},mean(mcc),0.45,0.4,0.6,,4,
{CAPPED},relative(map_error),0.7,0.4,0.6,,4,
{CAPPED},relative(volume_error),1.2,0.4,0.6,,4,
,"{TOUCHED}",0.5,0.1,0.9,0.004,4,
"""
REGISTRATION = """patch,mean_wear_depth_um,loss_fraction,mean_depth_where_worn_um
a,0.2,0.1,2
b,0.4,0.2,2
c,0.6,0.3,2
d,0.05,0.04,1.25
"""
USE = """parameter,prior,posterior_mean,low,high,posterior_mean_without_curvature
load_point_x,2.5,2.24,2,2.5,1.04
load_point_y,2.5,3.14,3,3.3,2
spread,,0.72,0.41,1.1,
radius,200,169.8,133.1,224.1,90.4
"""


CONFIG = complete({"pressure_cap_MPa": None})


def verdict(tables, force_N=200.0, **settings):
    study = InMemory(tables, force_N=force_N, size_mm=5.0)
    return answers.verdict(study, CONFIG | settings)


def line(question, tables, **settings):
    return sentences(verdict(tables, **settings))[question]


def sentences(answer):
    """The sentence that answers each question."""
    return {line.question: line.short + line.rest for line in answer.lines}


def numbers(text):
    """The numbers of a sentence, in their order."""
    return " ".join(re.findall(r"(?<!\w)\d+(?:\.\d+)?", text))


def loaded(*forces, studied=True):
    """Pressures and intervals of patches a, b, ... with these forces."""
    names = list("abcdefghijklmnop"[: len(forces)])
    pressures = pd.DataFrame({"patch": names, "force_N": forces, "in_study": studied})
    pressures["pressure_MPa"] = pressures["force_N"] * 2
    intervals = pressures.assign(low_MPa=1.0, high_MPa=123.4)
    return {"patch_pressures": pressures, "patch_intervals": intervals}


def compared(changes="{}", *, model=BARE, **losses):
    """A study of patches a to d, of which nothing touches d, and no loss is excluded.

    `changes` to the summary are YAML, by statistic and column; `losses` are columns.
    """
    summary = written(SUMMARY)
    summary["model"] = summary.model.replace("own", model)
    for statistic, values in yaml.safe_load(changes).items():
        row = (summary.statistic == statistic).idxmax()
        summary.loc[row, list(values)] = list(values.values())
    losses = {"above_noise": True, "excluded": False, "found": True} | losses
    registration = written(REGISTRATION).assign(**losses)
    return loaded(1.0, 2.0, 3.0, 0.0) | {
        "registration": registration,
        "validation_patches": registration[["patch"]].assign(in_statistics=True),
        "validation_summary": separated(summary),
    }


@pytest.mark.parametrize(
    ("forces", "first", "percent"),
    [
        ([1.0, 30.0, 31.0, 8.0], "Patches c and b carry", "87 4 35 62 95 1 120"),
        ([10.0] * 16, "The load is spread", "9 56 16 80 20 95 1 120"),
        ([3.0], "Patch a has the highest", "6 95 1 120"),
        ([0.0, 0.0], "No scanned patch touches", "200 95 120"),
    ],
)
def test_the_fewest_patches_that_carry_most_of_the_load(forces, first, percent):
    sentence = line(LOAD, loaded(*forces))
    assert sentence.startswith(first)
    assert numbers(sentence) == percent


@pytest.mark.parametrize(
    ("losses", "patches", "counts"),
    [
        ("{}", "c, b, a and d", "4 4 4 30 1.2 2 0.05 0.6"),
        (
            "above_noise: [true, true, false, true]",
            "b, a and d",
            "3 4 4 20 1.2 2 0.05 0.4 1",
        ),
        ("loss_fraction: [0.1, 0.2, 0.3, 0]", "c, b and a", "3 4 10 30 2 0.2 0.6 1"),
        ("mean_wear_depth_um: [.nan, 0.4, .nan, .nan]", "b", "1 1 20 2 0.4 3"),
        ("found: [false, .nan, false, false]", "", ""),
        ("mean_wear_depth_um: .nan", "", ""),
    ],
)
def test_which_patches_wore(losses, patches, counts):
    sentence = line(WORE, compared(**yaml.safe_load(losses)))
    assert "".join(re.findall(r"\(patch(?:es)? ([^)]*)\)", sentence)) == patches
    assert numbers(sentence) == counts


@pytest.mark.parametrize(
    ("pressed", "worn", "short", "counts"),
    [
        ("bc", 4, None, ""),
        ("a", 4, "No", "4 1"),
        ("", 4, "No", "4"),
        ("a", 3, "Not shown", "1 3"),
        ("", 1, "Not shown", ""),
    ],
)
def test_the_first_line_says_that_the_given_load_does_not_explain_the_wear(
    pressed, worn, short, counts
):
    """A few patches do not show it."""
    tables = compared(above_noise=[n < worn for n in range(4)])
    forces = [float(name in pressed) for name in "abcd"]
    answer = verdict(tables | loaded(*forces))
    assert (answer.lines[0].question == EXPLAINED) == (short is not None)
    if short:
        assert answer.lines[0].short == short
        assert numbers(sentences(answer)[EXPLAINED]) == counts


RIGID = MODELS["rigid"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ("gain(mcc): {p_value: 0.01}", "better than"),
        ("gain(mcc): {value: -0.1, low: -0.2, high: -0.01}", "worse than"),
        ("gain(mcc): {low: -0.1}", UNSHOWN),
        ("gain(mcc): {p_value: 0.06}", UNSHOWN),
        ("gain(mcc): {low: .nan, high: .nan, p_value: .nan}", UNSHOWN),
        ("tested_mean(mcc): {p_value: 0.002}", "Better than by chance"),
        ("tested_mean(mcc): {p_value: 0.06}", "Not shown"),
        ("tested_mean(mcc): {p_value: .nan}", "Not tested against chance"),
    ],
)
def test_what_is_better_must_show_in_the_interval_and_in_the_test(changes, words):
    sentence = line(WHERE, compared(changes))
    assert words in sentence
    assert RIGID in sentence


@pytest.mark.parametrize(
    ("value", "low", "high", "words"),
    [(0.5, 0.4, 0.9, "smaller"), (1.5, 1.1, 2, "larger"), (0.5, 0.4, 1.1, "no diff")],
)
def test_an_error_is_better_where_interval_and_test_show_it(value, low, high, words):
    ratio = f"{{value: {value}, low: {low}, high: {high}, p_value: 0.01}}"
    depth = line(DEEP, compared(f"relative_to_best(map_error): {ratio}"))
    volume = line(DEEP, compared(f"relative(volume_error): {ratio}"))
    assert f"is {value} times the error of the best baseline, {RIGID}: {words}" in depth
    assert f"is {value} times the error of this baseline: {words}" in volume


@pytest.mark.parametrize(
    ("count", "status", "excluded", "marks"),
    [
        (4, [AGREES, AGREES, AGREES], "", "●○○ ●●● ●●●"),
        (6, [AGREES, ELSEWHERE, AGREES], "a", "●●○ ●●○ ●●○"),
        (11, [CANNOT_TELL] * 3, "abc", "●●● ●○○ ●○○"),
    ],
)
def test_how_sure_it_is_is_computed(count, status, excluded, marks):
    tables = compared(excluded=[patch in excluded for patch in "abcd"])
    tables["validation_patches"] = pd.DataFrame({"in_statistics": [True] * count})
    tables["placement"] = pd.DataFrame({"status": status})
    assert " ".join(re.findall("[●○]+", line(SURE, tables))) == marks


def test_interlayer_and_gesture_are_named(monkeypatch):
    exposed = written("patch,exposure_N_per_mm,touched\na,1,1\nb,3,0.25")
    tables = compared(model=INTERLAYER) | {"exposure": exposed}
    interlayer = {"young_MPa": 300.0, "poisson": 0.3, "thickness_um": 250.0}
    monkeypatch.setattr(answers, "poses_of", lambda config: range(7))
    answer = verdict(tables, interlayer=interlayer)
    assert numbers(answer.details[0]).startswith("7 300 250 ")
    assert numbers(answer.details[2]) == "1.02 98 0.02"
    assert (
        "patch b is exposed most: it is touched in 25 % of them"
        in sentences(answer)[LOAD]
    )


@pytest.mark.parametrize(
    ("row", "start"),
    [
        ("{}", "Yes"),
        ("{low: -0.9, high: -0.1}", "No, they wore more"),
        ("{p_value: 0.2}", "Not shown"),
    ],
)
def test_untouched_patches_are_those_that_the_given_load_does_not_touch(row, start):
    tables = compared(f"{TOUCHED}: {row}")
    sentence = line(CONTACT, tables)
    assert sentence.startswith(f"{start}: ")
    assert numbers(sentence).startswith("0.05 3 0.4")
    # the load that the wear itself tells touches those that wore: it shows nothing
    pressures = tables["patch_pressures"]
    shaped = pressures.assign(pressure_MPa=1.0, stated_MPa=[2.0, 4.0, 6.0, 0.0])
    assert line(CONTACT, tables | {"patch_pressures": shaped}) == sentence
    tables["registration"]["above_noise"] = [True, True, True, False]
    assert line(CONTACT, tables).startswith("Not tested")


def test_a_study_says_only_what_it_can():
    unused = verdict(loaded(1.0, 2.0))
    assert list(sentences(unused)) == [WORE, LOAD]
    tables = compared()
    left_out = tables | loaded(1.0, 2.0, studied=False)
    assert line(WHERE, left_out).startswith("No patch is in the study")
    unpredicted = tables["validation_summary"].query("model != model")
    sentence = line(WHERE, tables | {"validation_summary": unpredicted})
    assert sentence.startswith("Nothing is compared")
    nothing = "{low: .nan, high: .nan, p_value: .nan, value: .nan, against: .nan, n: 0}"
    unlost = verdict(compared(f"mean(mcc): {nothing}\ngain(mcc): {nothing}"))
    assert sentences(unlost)[WHERE].startswith("Not compared")
    assert not any(
        "nan" in text for text in [*sentences(unlost).values(), *unlost.details]
    )


def inferred(answer=PRESSED, **columns):
    """The table ``use``."""
    columns |= {"answer": answer, "competitor": "a spot of wear", "adopted": True}
    return written(USE).assign(**columns)


def used(use):
    answer = verdict(loaded(1.0) | {"use": use}, 550.0)
    return next(line for line in answer.lines if line.question == USED)


def test_the_use_is_shown_with_the_prior():
    _, short, rest = used(inferred())
    assert numbers(short) == "2.2 3.1 0.7 170 550"
    assert numbers(rest) == "95 2.0 2.5 3.0 3.3 0.4 1.1 130 220 2.5 2.5 200"
    assert not any("radius" in text for text in used(inferred()[:3]))


@pytest.mark.parametrize(
    ("answer", "start", "goes_on", "competitor"),
    [
        (PRESSED, "Pressed about x 2.2 mm", None, True),
        (PERHAPS, "Perhaps pressed about x 2.2 mm", "this", True),
        (NOT_PRESSED, "Not shown", "the given", True),
        (f"{UNKNOWN}, as 3 count", "Cannot be inferred", "the given", False),
    ],
)
def test_each_answer_says_how_the_study_goes_on(answer, start, goes_on, competitor):
    _, short, rest = used(inferred(answer))
    assert short.startswith(start)
    assert rest.endswith(f"The study continues with {goes_on} load.") == (
        goes_on is not None
    )
    assert ("a spot of wear" in rest) == competitor
    assert ("as 3 count" in rest) != competitor


def test_a_use_that_may_lie_beyond_the_square_is_at_its_edge():
    """Its side is known, its place is not."""
    low, high = [-0.1, 3, 0.41, 133.1], [2.5, 5.1, 1.1, 224.1]
    _, short, rest = used(inferred(PERHAPS, low=low, high=high))
    assert short.startswith("Perhaps")
    assert "the edges x = 0 and y = 5 mm" in short
    assert "x [\N{MINUS SIGN}0.1, 2.5]" in rest


def test_the_law_that_predicts_best_is_named():
    laws = written(
        """law,log_score_gain,log_score_gain_error,posterior_mean,low,high
        archard,0,1.2,,,
        threshold,-2,1.2,,,
        higher exponent,4.06,1.2,1.52,1.4,2"""
    )
    sentence = line(LAW, compared() | {"laws": laws.assign(answer="higher exponent")})
    assert sentence.startswith("An exponent of pressure")
    assert numbers(sentence) == "1.5 95 1.4 2 4.1 1.2"
    for answer, start in {"archard": "Archard's", "undecided": "Undecided"}.items():
        decided = laws.assign(answer=answer)
        assert line(LAW, compared() | {"laws": decided}).startswith(start)


def test_a_law_of_the_config_is_not_called_archards():
    other = verdict(compared(), wear_law={"threshold_MPa": 2.0, "exponent": 1.0})
    assert "Archard" not in other.details[0]


def test_every_model_has_words():
    assert set(MODELS) == {BARE, INTERLAYER, CAPPED, *BASELINES, ORACLE}


def test_where_to_scan_is_said_with_its_numbers(monkeypatch):
    places = written(
        """place,x_mm,y_mm,kind
        E1,1.55,2.1,exposed
        E2,2,4,exposed
        C1,4,4,control"""
    )
    held = Concentration(0.824, 0.0153, 0.94, 0.0578)
    monkeypatch.setattr(answers, "concentration", lambda *_, **sizes: held)
    answer = verdict({"places": places, "use": inferred()}, 550.0)
    use, scan, controls, spread = sentences(answer).values()
    assert scan.startswith("Scan E1 to E2: ")
    assert numbers(scan) == "94 6 1.55 2.1"
    assert controls.startswith("Scan C1 as controls")
    assert numbers(spread) == "82 1.5 550"
    assert numbers(use).endswith(" 1.0 2.0 90")
