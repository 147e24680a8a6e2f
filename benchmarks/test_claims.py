"""The figures of the documents are those of the committed rows: benchmarks/README.md lists them.

The file claims.yaml selects rows for tables, for sentences, and for the first table of the
evidence, as in `cells`. `TABLES`, `WORDS` and `FIRST` add the values that a function computes: of
tables those in the last columns, and of the first table the number of cases last. Values are
compared as they are rounded.
"""

import functools
import itertools
import re
from pathlib import Path

import age
import chance
import correlated
import false_stops
import left_out
import measured_surfaces
import numpy as np
import pandas as pd
import placement
import power
import pytest
import statistics_of_contact
import strikes
import transforms
import two_scales
import use
import verdict
import yaml
from PIL import Image
from runner import RESULTS, ROOT

from gst.config.tables import TABLES as LISTED
from gstlib.io.files import sha256
from gstlib.io.tables import read_table

# A table or a sentence is looked for in these documents in turn.
DOCUMENTS = """docs/explanation/evidence.md benchmarks/README.md paper.md config/config.yaml
docs/explanation/solver.md docs/how-to/cluster.md README.md"""
TEXT = "\n".join((ROOT / name).read_text() for name in DOCUMENTS.split())
CLAIMS = yaml.safe_load(Path(__file__).with_name("claims.yaml").read_text())
SPELLED = {"none": "0", "nine": "9", "ten": "10", "yes": "1", "no": "0"}
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
SHOWN_TESTS = CLAIMS["tests"]
MCC, GAIN = "mean MCC", "law's gain"
MAPS, VOLUMES = "law's map_error_um / its", "law's volume_error / its"
INTERLAYER = f"better: relative(out_of_contact){power.WITH_INTERLAYER}"
STUDY = ROOT / "tests/baseline/tables"


def numbers(text):
    """The numbers in a text, as they are printed."""
    text = SPELLED.get(text, text).replace("−", "-")
    return NUMBER.findall(re.sub(r"(?<=\d),(?=\d{3}\b)", "", text))


def values(*parts, factor=1.0):
    """The numbers in texts and in lists."""
    lists = (
        numbers(part) if isinstance(part, str) else np.ravel(part) for part in parts
    )
    return [factor * float(number) for number in itertools.chain(*lists)]


percent = functools.partial(values, factor=100)


def assert_same(shown, value):
    """A cell shows these values, rounded; a cell without a number stands for a missing value."""
    printed, exact = numbers(shown), values(value)
    assert bool(printed) != np.isnan(exact[:1]).all(), (shown, value)
    for text, number in zip(printed, exact[: len(printed)], strict=True):
        # half a digit, and what the number itself was rounded by
        allowed = 0.56 * 10 ** -len(text.partition(".")[2])
        assert abs(float(text) - number) <= allowed, (shown, value)


def table(heading):
    """The rows of cells of the first Markdown table below a heading, without its head."""
    below = "".join(TEXT.partition(heading)[1:])
    lines = re.search(r"(^\|.*\n)+", below, re.MULTILINE)[0].splitlines()
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return rows[2:]


@functools.cache
def rows_of(name):
    return read_table(RESULTS / f"{name}.csv")


def shown_rates(rows):
    return power.rejection_rates(rows).query("level == @power.SHOWN")


def beside_paper(rows):
    """The summary of two scales; each row has what the paper reaches in its case, too."""
    table = two_scales.summary(rows)
    paper = table[table.variant == "paper"].drop(columns="variant")
    return table.merge(paper, on=two_scales.OF_ROW[:-1], suffixes=("", "_paper"))


def with_edges(rows):
    """The summary of uses, with the stones for which an edge is named, and is the right one."""
    side, reach = 5.0, 1.96  # mm, of config/config.yaml, and standard deviations
    mean, sd, true = (
        rows[[f"{name}_y_mm", f"{name}_x_mm"]].to_numpy()
        for name in ("mean", "sd", "true")
    )
    named = np.hstack([mean - reach * sd < 0, mean + reach * sd > side])
    right = named & np.hstack([true < 0, true > side])
    edges = {"named": named.any(axis=1), "right": right.any(axis=1)}
    counts = pd.DataFrame(edges).groupby(rows.case).sum()
    return use.summary(rows).rename_axis("case").join(counts)


# How the rows of a file are summarised; the others are shown as they are.
SUMMARIES = {
    "breech_faces": measured_surfaces.summary,
    "chance": chance.rates,
    "correlated": correlated.false_losses,
    "false_stops": false_stops.summary,
    "finding": lambda rows: rows.assign(
        located=rows.number * rows.found_fraction,
        missed=rows.number * (1 - rows.found_fraction),
    ),
    "left_out": left_out.summary,
    "placement": lambda rows: rows.set_index(
        ["stone", "patches", "mistake"]
    ).sort_index(),
    "repeats": lambda rows: rows.assign(
        along=rows.shift_x_um / rows.spacing_um,
        across=rows.shift_y_um / rows.spacing_um,
    ),
    "power": shown_rates,
    "power_correlated": lambda _: correlated.rates(),
    "scale": lambda rows: rows.set_index("quantity").T,
    "statistics_of_contact": statistics_of_contact.summary,
    "strikes": strikes.summary,
    "transforms": transforms.ratios,
    "two_scales": beside_paper,
    "use": with_edges,
    "verdict": verdict.model_table,
    "verdict_correlated": lambda _: correlated.verdicts(),
}


@functools.cache
def summary_of(name):
    return SUMMARIES.get(name, pd.DataFrame)(rows_of(name))


def cells(name, query, columns):
    """The rows of cells that a document shows of a summary.

    Of the rows that `query` selects, the columns after each comma. A column with a % is in percent,
    one with a ! without its interval, and columns joined by a + are in one cell.
    """
    frame = summary_of(name)
    frame = frame.query(query) if query else frame

    def cell(row, names):
        shown = []
        for part in names.split("+"):
            exact = values(row[part.strip("%!")], factor=100 if "%" in part else 1)
            shown += exact[:1] if "!" in part else exact
        return shown

    shown = columns.split(", ")
    return [[cell(row, names) for names in shown] for _, row in frame.iterrows()]


def of_best_baseline(column, worn_by=("archard", "summits"), by=None):
    """A column of the law beside the best baseline, by what wore the stones; and how many."""
    models = summary_of("verdict").query("model in @verdict.BASELINES")
    reached = models[by or column].map(lambda cell: values(cell)[0])
    best = reached.groupby(models["worn by"]).idxmax()
    shown = models.loc[best[[*worn_by]]]
    return values(*shown[column], shown.stones.max())


# --- Tables ---------------------------------------------------------------------------------------


def strengths():
    caps = verdict.strength_table(rows_of("verdict")).set_index(["worn_by", "model"])
    models = "archard", "2000 MPa", "1000 MPa", "300 MPa"
    for worn_by in verdict.WORN_BY:
        yield [
            [*caps.loc[(worn_by, model), ["mcc", "map_error_um"]]] for model in models
        ]


def claims_of_tests():
    whole = summary_of("power").query("drawn.isna()").set_index(["test", "wear"])
    for test in SHOWN_TESTS:
        tests = (whole.loc[(test, wear)] for wear in power.OF_BARE)
        yield [percent(row.rate, row.low, row.high) for row in tests]


def by_patches():
    drawn = summary_of("power").query(
        "test == @SHOWN_TESTS[-2] and wear == 'summits' and drawn in [4, 6, 8, 10, 12]"
    )
    return percent(*drawn.rate), [*drawn.specimens]


def mistakes_in_places():
    stones = ("default", 25), ("default", 4), ("mesh noise 3 µm", 25)
    mistakes = [placement.SOME[1], placement.ELSEWHERE, placement.EXCHANGED]
    for stone, patches in (*stones, ("mesh edges 0.45 mm", 25)):
        studies = summary_of("placement").loc[stone, patches]
        # all orientations were tried on the default stone alone
        turned = studies.stopped.reindex(placement.ORIENTED).mean(skipna=False)
        shares = [studies.right_agree[placement.NONE], turned]
        yield [patches, *percent([*shares, *studies.stopped[mistakes]])]


TABLES = CLAIMS["tables"] | {
    "| mean MCC (map error, µm) |": strengths,
    "| claim | worn on": claims_of_tests,
    "## How many patches?": by_patches,
    "**Mistakes in the positions**": mistakes_in_places,
}


@pytest.mark.parametrize("heading", TABLES)
def test_a_table_shows_the_rows(heading):
    claim = TABLES[heading]
    rows = claim() if callable(claim) else cells(*claim)
    for row, exact in zip(table(heading), rows, strict=True):
        for cell, value in zip(row[-len(exact) :], exact, strict=True):
            assert_same(cell, value)


# --- Sentences ------------------------------------------------------------------------------------


def claims_of_uses():
    unpressed = summary_of("use").loc[[*use.UNPRESSED]]
    claimed, count, answered = unpressed[["pressed", "stones", "answered"]].sum()
    return claimed, count, count - answered


def better_forms():
    score = rows_of("use").pivot_table(index="seed", columns="case", values="log_score")
    score = score[["true form", "two radii"]].dropna()
    return (score["true form"] > score["two radii"]).sum(), len(score)


def adopted_without_relation(rows):
    """Studies that adopt a load case for wear unrelated to contact, and how many there are."""
    rows = rows.query("wear in @power.BY_RULE[1:]").drop_duplicates(["seed", "wear"])
    return rows.adopted.sum(), len(rows)


def adopted_with_both_errors():
    both = correlated.of_both("power", "wear").values()
    (first, count), (second, _) = map(adopted_without_relation, both)
    return first, count, second


def interlayers():
    """How many studies find one, of those whose stones wore with one, and of the others."""
    rates = summary_of("power")
    rates = rates[rates.test == INTERLAYER].assign(trials=rates["of"])
    counts = rates.groupby(rates.wear == "interlayer")[["claims", "trials"]].sum()
    return *counts.loc[True], *counts.loc[False]


@functools.cache
def measurements():
    """Measurements of the solver and of its peers, each with the case and the code."""
    rows = pd.concat([rows_of(name).assign(case=name) for name in age.OF_SOLVER])
    return rows.assign(of=rows.code.str.split(",").str[0])


def fastest():
    """Time of the fastest method of each code over ours, by case and code."""
    return measurements().query("reached").groupby(["case", "of"]).ratio.min()


def peers():
    own = measurements().query("code == 'gstlib, load'").set_index("case").cpu_median
    cold, path = fastest()["rough-76"], fastest()["path-76"]
    ratios = cold[["aspher", "slippy", "ContactMechanics", "Tamaas"]]
    return own["rough-76"], *ratios, own["path-76"], path.drop("gstlib").min()


def law_and_best_baseline():
    models = summary_of("verdict").set_index(["worn by", "model"])
    for worn_by in verdict.WORN_BY:
        yield models[MCC][worn_by, verdict.BARE]
        yield of_best_baseline(MCC, [worn_by])[0]


def runs_of_a_study():
    rows = rows_of("margin")
    (count,) = set(rows.groupby("run")["values"].sum())
    return count, int(rows.margin.min())


def rows_shown(claim):
    """The rows of a selection, or what a function computes in one row."""
    return [claim()] if callable(claim) else cells(*claim)


WORDS = {sentence["says"]: sentence["shows"] for sentence in CLAIMS["sentences"]} | {
    r"A load case was claimed in (\d+) of (\d+) such cases\. "
    r"In (\d+) of these, nothing could be inferred": claims_of_uses,
    r"a round one on (\d+) of (\d+) stones": better_forms,
    r"In (\d+) of the (\d+) cases \D*the study adopted the inferred load case": (
        lambda: adopted_without_relation(rows_of("power"))
    ),
    r"In (\d+) of the (\d+) cases \D*the study adopted the load case with \D+ in (\d+) with": (
        adopted_with_both_errors
    ),
    r"smooth contact at (\S+) to (\S+), (\S+) to (\S+) and (\S+) to (\S+)\.": lambda: (
        summary_of("strikes").sort_values("rms_um", kind="stable").correlation_strike
    ),
    r"The fault names that orientation in (\S+) % of all": lambda: percent(
        summary_of("placement").loc["default", 25].named[placement.ORIENTED].mean()
    ),
    r"None of (\S+) printed numbers changed.*? at least (\d+) times": runs_of_a_study,
    r"r\.m\.s\. errors of (\S+), (\S+) and (\S+) µm": lambda: (
        read_table(STUDY / "gridding.csv").left_out_rms_um
    ),
    r"test at 5 % claims a relation on (\S+) % of patches.*?a relation in (\S+) % of cases with "
    r"twelve.*?of normal numbers in (\S+) % of cases": lambda: percent(
        *summary_of("chance")["claim", "mean"][["waves", "neighbours"]],
        summary_of("chance")["held", "mean"]["mean of 6"],
    ),
    r"finds it on (\w+) of the (\w+) stones .*? on (\w+) of the (\w+) others": interlayers,
    r"With 2 GPa, up to (\d+) % of a patch's contact": lambda: percent(
        read_table(STUDY / "cases.csv")
        .query("quantity == 'share at the cap'")
        .value.max()
    ),
    r"took `gstlib` (\S+) s of .*? aspher took (\S+) times .*? slippy (\S+), ContactMechanics "
    r"(\S+) and Tamaas (\S+)\. .*? took (\S+) s, and the fastest peer (\S+) times": peers,
    r"Of (\d+) cases .*?, (\d+) (?:was|were) claimed": lambda: claims_of_uses()[1::-1],
    r"coefficient of (\S+)\. The best fair baseline reaches (\S+), .*? coefficients are (\S+) "
    r"and (\S+)\.": law_and_best_baseline,
}


@pytest.mark.parametrize("pattern", WORDS)
def test_a_sentence_says_what_the_rows_show(pattern):
    shown = re.search(pattern, " ".join(TEXT.split())).groups()
    exact = itertools.chain(*rows_shown(WORDS[pattern]))
    for text, value in zip(shown, exact, strict=True):
        assert_same(text, value)


# --- The first table ------------------------------------------------------------------------------


def of_level():
    """The least and the largest rate of claims that are false."""
    rates = summary_of("power").query(
        "test in @SHOWN_TESTS and wear in ['random', 'waves'] and drawn.isna()"
    )
    return *percent(rates.rate.min(), rates.rate.max()), rates.specimens.max()


def of_caps():
    elastic, *_, lowest = [*strengths()][1]
    return elastic[0], lowest[0], verdict.WITH_STRENGTHS


def of_mistakes():
    _, _, orientation, _, place, exchange = next(mistakes_in_places())
    return place, orientation, exchange, *summary_of("placement").studies.unique()


def wrong_matches():
    """Every match of an unrelated pair is wrong."""
    counts = summary_of("breech_faces")
    wrong = counts.wrong.drop("unrelated").sum() + counts.found["unrelated"]
    return wrong, counts.pairs.sum()


def of_repeats():
    rows = rows_of("repeats").query("found")
    is_little = rows[["loss_fraction", "gain_fraction"]].lt(0.005).all(axis=1)
    return (is_little | ~rows.above_noise.astype(bool)).sum(), len(rows)


def of_accuracy():
    own = measurements().query("of == 'gstlib'")
    return 1e9 * own.gap_error.max(), 10, len(own)


def of_speed(cases):
    peers = fastest().drop("gstlib", level="of").groupby("case").min()
    ratios = peers.filter(regex=cases)
    return *sorted({ratios.min(), ratios.max()}), len(ratios)


FIRST = CLAIMS["first"] | {
    "locates it better": lambda: of_best_baseline(GAIN, ["archard"], by=MCC),
    "a rule without contact": lambda: of_best_baseline(GAIN, ["summits"], by=MCC),
    "depth maps": lambda: of_best_baseline(MAPS),
    "volumes of the best": lambda: of_best_baseline(VOLUMES),
    "mean volume": lambda: values(
        *summary_of("verdict").query("model == 'mean_volume'")[VOLUMES][::-1], 20
    ),
    "a cap on the pressure": of_caps,
    "the middle half": lambda: (
        *summary_of("use").held_50[["scatter", "stroke", "control"]],
        40,
    ),
    "not attributed": lambda: claims_of_uses()[:2],
    "unrelated to contact": of_level,
    "finds an interlayer": lambda: np.reshape(interlayers(), (2, 2)).T.ravel(),
    "intervals of pressure": lambda: (
        *cells("two_scales", "distance_mm == 1 and held != ''", "held%")[0],
        500,
    ),
    "of another stone": lambda: (
        summary_of("finding")
        .query("scans in ['another', 'smooth']")[["located", "number"]]
        .sum()
    ),
    "wrong position, orientation": of_mistakes,
    "correct study": lambda: summary_of("false_stops")[["stop", "studies"]].sum(),
    "a wrong match": wrong_matches,
    "measured repeats": of_repeats,
    "every state": of_accuracy,
    "an eighth": lambda: of_speed("rough|hertz|path"),
    "two thirds": lambda: of_speed("periodic-2000"),
    "printed numbers": lambda: (rows_of("margin").changes.sum(), runs_of_a_study()[0]),
}


@pytest.mark.parametrize("part", FIRST)
def test_the_first_table_shows_the_rows(part):
    ((_, number, count, verdict_of_it),) = [
        row for row in table("# Evidence") if part in row[0]
    ]
    *shown, counts = zip(*rows_shown(FIRST[part]), strict=True)
    exact = [*itertools.chain(*shown), *np.unique(counts)]
    for shown, value in zip(numbers(f"{number} {count}"), values(*exact), strict=True):
        assert_same(shown, value)
    assert verdict_of_it in ("holds", "does not hold", "not shown")


def test_the_first_table_has_a_check_for_each_row():
    assert len(table("# Evidence")) == len(FIRST)


def test_the_readme_repeats_the_first_table():
    first = [
        (numbers(f"{number} {count}"), holds)
        for _, number, count, holds in table("# Evidence")
    ]
    for _, number, holds in table("> **Status.**"):
        shown = numbers(number)
        assert any((shown, holds) == (own[: len(shown)], held) for own, held in first)


# --- Rows, and what they must show whatever the documents say ------------------------------------


def test_the_rows_are_those_that_their_program_made():
    kept = {file.stem: sha256(file)[:16] for file in RESULTS.glob("*.csv")}
    kept.pop("calibration")  # where a search for tolerances starts
    assert kept == {name: made["rows"] for name, made in age.read().items()}


def test_the_evidence_says_how_old_its_rows_are():
    shown = age.EVIDENCE.read_text().partition(age.BEGIN)[2].partition(age.END)[0]
    assert shown.strip() == age.ages(), "run benchmarks/age.py"


def test_rows_are_of_the_program_until_a_module_changes(tmp_path, monkeypatch):
    monkeypatch.setattr(age, "MADE", tmp_path / "made.json")
    rows = tmp_path / "chance.csv"
    rows.write_text("case\n")
    age.record(rows)
    now, earlier = age.ages().splitlines()
    assert "`chance.csv`" in now
    assert "`chance.csv`" not in earlier
    monkeypatch.setattr(age, "library_hash", lambda script: "another")
    assert "`chance.csv`" in age.ages().splitlines()[-1]
    age.record(rows, adds=True)
    assert age.read()["chance"]["program"] == age.SEVERAL
    age.record(rows)
    assert age.read()["chance"]["program"] == "another"


@pytest.mark.parametrize(("name", "query", "holds"), CLAIMS["always"])
def test_rows_show_this_whatever_the_documents_say(name, query, holds):
    rows = summary_of(name).query(query)
    assert len(rows) > 0
    assert rows.eval(holds).all()


def test_names_in_the_first_column_are_those_of_the_rows():
    for heading, names in (
        ("## How was it used?", summary_of("use").index),
        ("**Repeats.**", rows_of("repeats").pair),
        ("| way | found |", summary_of("finding").query("scans == 'own'").how),
        ("## False stops", [f"{n} × {n}" for n in summary_of("false_stops").index]),
        ("## Hundreds of patches", summary_of("scale").index),
    ):
        assert [row[0] for row in table(heading)] == list(names)


def test_the_force_in_the_square():
    shown = [row[1] for row in table("## Errors due to the two scales") if row[1]]
    exact = cells(
        "two_scales",
        "scan_points == 128 and distance_mm == 0 and variant == 'true face' and trial == 'default'",
        "square_N!",
    )
    for cell, ((newtons,),) in zip(shown, exact, strict=True):
        assert_same(cell, 100 * newtons / 550)  # of config/config.yaml


def test_as_many_rows_are_committed_as_the_programs_make():
    made = rows_of("power").groupby("wear").seed.nunique()
    assert {made[wear] for wear in power.OF_BARE} == {power.SPECIMENS}
    assert made["interlayer"] == power.INTERLAYERS
    assert set(rows_of("false_stops").seed) == {false_stops.STOPPED, *false_stops.SEEDS}


def test_rows_of_runs_are_of_tables_of_a_study():
    tables = {Path(listed.file).name for listed in LISTED.values()}
    assert {*rows_of("margin").table} <= tables


def test_the_picture_of_readme_shows_the_stored_study():
    """`docs/overview.py` draws it, and says in it of which scores."""
    with Image.open(ROOT / "docs/overview.png") as picture:
        shows = picture.text["scores"]
    assert shows == sha256(STUDY / "validation_patches.csv")
