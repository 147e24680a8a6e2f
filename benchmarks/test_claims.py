"""The figures of the documents are those of the committed rows: benchmarks/README.md lists them.

`TABLES` has, for each table of a document, the values that its last columns show; `WORDS` those
that stand in a sentence. Figures are compared as they are rounded.
"""

import functools
import re
from pathlib import Path

import age
import chance
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
from PIL import Image
from runner import RESULTS, ROOT

from gst.config.tables import TABLES as LISTED
from gstlib.io.files import sha256
from gstlib.io.tables import read_table

EVIDENCE, SOLVER = (
    ROOT / "docs/explanation/evidence.md",
    ROOT / "docs/explanation/solver.md",
)
CLUSTER, README, PAPER, CONFIG = (
    ROOT / file
    for file in (
        "docs/how-to/cluster.md",
        "benchmarks/README.md",
        "paper.md",
        "config/config.yaml",
    )
)
SPELLED = {"none": "0", "nine": "9", "ten": "10"}
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
INTERLAYER = f"better: relative(out_of_contact){power.WITH_INTERLAYER}"
CASES = ROOT / "tests/baseline/tables/cases.csv"
SHOWN_TESTS = [
    "tested_mean(mcc)",
    "better: gain(mcc)",
    "worse: gain(mcc)",
    "better: relative(map_error)",
    "better: relative(volume_error)",
    "spearman(pressure_MPa, loss_fraction)",
    "spearman(touched, mean_wear_depth_um)",
]


def numbers(shown):
    """The numbers in a text, as they are printed; those of a list are its own."""
    if isinstance(shown, str):
        return NUMBER.findall(
            re.sub(r"(?<=\d),(?=\d{3}\b)", "", shown.replace("−", "-"))
        )
    return shown if isinstance(shown, list) else [shown]


def values(*parts, factor=1.0):
    return [factor * float(number) for part in parts for number in numbers(part)]


percent = functools.partial(values, factor=100)


def assert_same(shown, value):
    """A cell shows these values, rounded; a cell without a number stands for a missing value."""
    printed = numbers(shown)
    exact = values(value)
    if not printed:
        assert not exact or pd.isna(exact[0]), (shown, value)
        return
    assert len(printed) <= len(exact), (shown, value)
    for text, number in zip(printed, exact, strict=False):
        # half a digit, and what the number itself was rounded by
        allowed = 0.56 * 10 ** -len(text.partition(".")[2])
        assert abs(float(text) - number) <= allowed, (shown, value)


def table(heading, document=EVIDENCE):
    """The rows of cells of the first Markdown table below a heading, without its head."""
    below = document.read_text().partition(heading)
    lines = "".join(below[1:]).splitlines()
    start = next(number for number, line in enumerate(lines) if line.startswith("|"))
    rows = []
    for line in lines[start:]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows[2:]


def words(pattern, document=EVIDENCE):
    """What the groups of a pattern are in the text of a document."""
    return re.search(pattern, " ".join(document.read_text().split())).groups()


@functools.cache
def rows_of(name):
    return (
        use.made(use.RESULT) if name == "use" else read_table(RESULTS / f"{name}.csv")
    )


@functools.cache
def summary_of(module, name):
    return module.summary(rows_of(name))


@functools.cache
def scales():
    keys = ["scan_points", "trial", "radius_mm", "distance_mm", "variant"]
    return summary_of(two_scales, "two_scales").set_index(keys).sort_index()


def scale_of(variant, *, points=128, trial="default", radius=200, distance=0):
    return scales().loc[points, trial, radius, distance, variant]


@functools.cache
def rates(name):
    rates = power.rejection_rates(rows_of(name))
    return rates[rates.level == power.SHOWN]


def values_of(frame, columns, factors=()):
    """The columns of a table, row by row; some of them times a factor."""
    scaled = frame[columns].mul(
        pd.Series(dict(factors)).reindex(columns, fill_value=1.0)
    )
    return scaled.astype(float).to_numpy().tolist()


def two_scales_by_form():
    for radius in (60, 200, 1000):
        for variant in ("equilibrium", "paper"):
            row = scale_of(variant, radius=radius)
            yield percent(row.misplaced), percent(row.misplaced_of_all), values(row.f1)


def two_scales_by_load_point():
    for radius, distance in ((60, 1), (200, 1), (200, 3), (1000, 1)):
        cells = []
        for variant, count in (("equilibrium", 3), ("paper", 1)):
            row = scale_of(variant, radius=radius, distance=distance)
            cell = percent(row.misplaced)[:count] + percent(row.misplaced_of_all)[:1]
            cells.append(cell + values(row.f1)[:1])
        yield cells


def two_scales_by_error():
    for trial in two_scales.TRIALS:
        if not trial.startswith("S-filter"):
            row, other = (
                scale_of(variant, trial=trial) for variant in ("equilibrium", "paper")
            )
            paper = percent(other.misplaced)[:1] + values(other.f1)[:1]
            cells = percent(row.misplaced), row.f1, row.area_ratio, row.volume_error
            tilts = (
                values(row.tilt_error_mrad)[:1] + values(row.stated_tilt_error_mrad)[:1]
            )
            yield *cells, tilts, paper


def worth(worn_by):
    models = verdict.model_table(rows_of("verdict"))
    return models[models["worn by"] == worn_by].iloc[:, 3:].to_numpy()


def strengths():
    caps = verdict.strength_table(rows_of("verdict")).set_index(["worn_by", "model"])
    models = "archard", "2000 MPa", "1000 MPa", "300 MPa"
    for worn_by in verdict.WORN_BY:
        yield [
            [*caps.loc[(worn_by, model), ["mcc", "map_error_um"]]] for model in models
        ]


def claims_of_tests(name, wears):
    whole = rates(name)[rates(name).drawn.isna()].set_index(["test", "wear"])
    for test in SHOWN_TESTS:
        tests = (whole.loc[(test, wear)] for wear in wears)
        yield [percent([row.rate, row.low, row.high]) for row in tests]


def rough_contact():
    for row in summary_of(statistics_of_contact, "statistics_of_contact").itertuples():
        published = row.published, [row.deviation_percent, row.error_percent]
        yield [row.kappa, row.error], *published, row.contact, row.persson, row.gamma


def places_of_scans():
    own = found_places().xs("own", level="scans")
    columns = [
        "found_fraction",
        "off_median_um",
        "off_p95_um",
        "stated_rms_um",
        "true_rms_um",
    ]
    shares = {"found_fraction": 100, "held_fraction": 100}
    return values_of(own, [*columns, "held_fraction", "found_and_wrong"], shares)


def found_places():
    return pd.read_csv(RESULTS / "finding.csv").set_index(["how", "scans"])


def by_patches():
    drawn = rates("power")[rates("power").test == SHOWN_TESTS[-2]].query(
        "wear == 'summits'"
    )
    drawn = drawn.dropna(subset="drawn").set_index("drawn").loc[[4, 6, 8, 10, 12]]
    return [percent([*drawn.rate]), [*drawn.specimens]]


@functools.cache
def studies_of_places():
    keys = ["stone", "patches", "mistake"]
    return pd.read_csv(RESULTS / "placement.csv").set_index(keys).sort_index()


def mistakes_in_places():
    stones = ("default", 25), ("default", 4), ("mesh noise 3 µm", 25)
    mistakes = [placement.SOME[1], placement.ELSEWHERE, placement.EXCHANGED]
    for stone, patches in (*stones, ("mesh edges 0.45 mm", 25)):
        studies = studies_of_places().loc[stone, patches]
        # all orientations were tried on the default stone alone
        turned = studies.stopped.reindex(placement.ORIENTED).mean(skipna=False)
        shares = [studies.right_agree[placement.NONE], turned]
        yield [patches, *percent([*shares, *studies.stopped[mistakes]])]


def repeats():
    for row in rows_of("repeats").itertuples():
        shifts = np.array([row.shift_x_um, row.shift_y_um]) / row.spacing_um
        cells = [*percent(row.loss_fraction), *percent(row.gain_fraction), ..., ...]
        cells += [[row.neighbours_x, row.neighbours_y]]
        cells += [percent([row.white_loss, row.white_gain])]
        yield (
            shifts.tolist(),
            *(cells if row.found else [np.nan, np.nan, ..., ..., np.nan, np.nan]),
        )


def breech_faces():
    counts = summary_of(measured_surfaces, "breech_faces").astype(float)
    counts.loc["unrelated", "wrong"] = np.nan  # they have no right place
    return values_of(counts, ["pairs", "found", "wrong", "refused"])


def many_patches():
    sizes = pd.read_csv(RESULTS / "scale.csv", index_col="quantity").T
    names = [
        "plan_jobs",
        "plan_cpu_s",
        "plan_peak_mb",
        "run_cpu_s",
        "run_cpu_s_per_patch",
    ]
    return values_of(sizes, [*names, "run_wall_s", "run_largest_job_mb"])


def columns(module, names):
    """Columns of the summary that a module makes of its rows."""
    return lambda: values_of(summary_of(module, module.__name__), names.split())


USED = "stones pressed y_mm x_mm log_radius held_50 held_95 told inferred known"
STRUCK = "rms_um area_ratio correlation_smooth correlation_halves mcc_smooth mcc_halves mcc_height"
STOPPED = "studies stop patches found wrong covered missed"
LEFT_OUT = "contact_ratio f1 deepest_ratio map_difference force_moved loss_moved cases"
TABLES = {
    "## Numbers that others": rough_contact,
    "## Hundreds of patches": many_patches,
    "## Errors due to the two scales": two_scales_by_form,
    "## The load point and other errors": two_scales_by_load_point,
    "| changed |": two_scales_by_error,
    "| summits worn by a rule | mean": lambda: worth("summits"),
    "| worn by Archard's law |": lambda: worth("archard"),
    "## How was it used?": columns(use, USED),
    "| mean MCC (map error, µm) |": strengths,
    "## Effects that the contact of a patch": columns(left_out, LEFT_OUT),
    "**Does a smooth tool predict": columns(strikes, STRUCK),
    "| claim | worn on": lambda: claims_of_tests("power", power.OF_BARE),
    "| claim, use inferred |": lambda: claims_of_tests(
        "power_inferred", power.BY_RULE[1:]
    ),
    "## How many patches?": by_patches,
    "| way | found |": places_of_scans,
    "**Mistakes in the positions**": mistakes_in_places,
    "**Repeats.**": repeats,
    "**Breech faces.**": breech_faces,
    "## False stops": columns(false_stops, STOPPED),
}
DOCUMENTS = {"## Numbers that others": SOLVER, "## Hundreds of patches": CLUSTER}


@pytest.mark.parametrize("heading", TABLES)
def test_a_table_shows_the_rows(heading):
    shown = table(heading, DOCUMENTS.get(heading, EVIDENCE))
    for cells, exact in zip(shown, TABLES[heading](), strict=True):
        for cell, value in zip(cells[-len(exact) :], exact, strict=True):
            if value is not ...:
                assert_same(cell, value)


def claims_of_uses():
    rows = rows_of("use")
    unpressed = rows[rows.case.isin(use.UNPRESSED)]
    claimed = (unpressed.answer == use.PRESSED).sum()
    return claimed, len(unpressed), unpressed.log_score.isna().sum()


def regions():
    held = summary_of(use, "use")[["held_50", "held_95"]]
    return held.loc[["law", "control", "scatter", "stroke", "prior"]].to_numpy().ravel()


def errors_of_losses():
    return summary_of(use, "use").loc[
        "law", ["inferred", "known", "told", "inferred_ratio"]
    ]


def claimed_of_law():
    return summary_of(use, "use").loc["law", ["pressed", "stones"]]


def spreads():
    cases = summary_of(use, "use").loc[["scatter", "stroke"]]
    counts = cases[["spread_mm_95", "answered"]].to_numpy().ravel()
    control = summary_of(use, "use").log_radius["control"]
    return *counts, *cases.log_radius, control


def adopted_without_relation():
    rows = rows_of("power_inferred").drop_duplicates(["seed", "wear"])
    return rows.adopted.sum(), len(rows)


def interlayers():
    """How many studies find one, of those whose stones wore with one, and of the others."""
    tests = rates("power").set_index(["test", "wear"]).loc[INTERLAYER]
    others = tests.drop("interlayer")
    counts = (
        *tests.loc["interlayer", ["claims", "of"]],
        others.claims.sum(),
        others["of"].sum(),
    )
    return map(int, counts)


def not_certain():
    return found_places().loc[("by hand", "own"), ["not_certain", "number"]]


def uses_beyond_the_square():
    rows, side, reach = (
        rows_of("use"),
        5.0,
        1.96,
    )  # mm, of config/config.yaml; deviations
    middles, reaches, truths = (
        rows[[f"{name}_{axis}_mm" for axis in "yx"]].to_numpy()
        for name in ("mean", "sd", "true")
    )
    named, over = (
        np.stack([at - by < 0, at + by > side])
        for at, by in ((middles, reach * reaches), (truths, 0.0))
    )
    is_beyond = named.any(axis=(0, 2))
    outside = rows.case == "outside"
    law = rows.case == "law"
    counts = [
        count
        for case in (outside, law)
        for count in (is_beyond[case].sum(), case.sum())
    ]
    right = (named & over).any(axis=(0, 2)) & outside
    return *counts, right.sum(), (is_beyond & outside).sum()


def better_forms():
    score = rows_of("use").pivot_table(index="seed", columns="case", values="log_score")
    score = score[["true form", "two radii"]].dropna()
    return (score["true form"] > score["two radii"]).sum(), len(score)


def scales_in_detail():
    equilibrium, paper, highest, unfiltered = (
        scale_of(variant, points=512, trial=trial)
        for variant, trial in (
            ("equilibrium", "default"),
            ("paper", "default"),
            ("highest_equilibrium", "default"),
            ("equilibrium", "S-filter none"),
        )
    )
    pairs = [
        part
        for row in (equilibrium, paper)
        for part in (percent(row.misplaced), row.f1)
    ]
    return *pairs, highest.f1, unfiltered.f1


def edges():
    square = scale_of("paper")
    face = scale_of("equilibrium", radius=1000)
    shares = (
        square.edge_of_square,
        scale_of("true face").edge_of_square,
        face.edge_of_face,
    )
    return map(percent, shares)


def chances():
    rates = chance.rates(rows_of("chance"))
    claims = rates["claim", "mean"]
    held = rates["held", "mean"]
    return {
        "waves": claims["waves"],
        "pairs": claims["neighbours"],
        "mean": held["mean of 6"],
    }


def peers():
    cold, path = (pd.read_csv(RESULTS / f"{name}-76.csv") for name in ("rough", "path"))
    reached = cold[cold.reached == "yes"]
    fastest = reached.groupby(reached.code.str.split(",").str[0]).ratio.min()
    ratios = fastest[["aspher", "slippy", "ContactMechanics", "Tamaas"]]
    peer = path.ratio[~path.code.str.startswith("gstlib")].min()
    return cold.cpu_median[0], *ratios, path.cpu_median[0], peer


def uses_in_the_paper():
    law = summary_of(use, "use").loc["law"]
    return *law[["stones", "inferred", "known", "told"]], *claims_of_uses()[1::-1]


def law_and_best_baseline():
    models = verdict.model_table(rows_of("verdict")).set_index(["worn by", "model"])
    for worn_by in verdict.WORN_BY:
        reached = models["mean MCC"][worn_by]
        yield reached[verdict.BARE]
        yield max(reached[[*verdict.BASELINES]], key=lambda cell: values(cell)[0])


def strikes_apart():
    by_rms = summary_of(strikes, "strikes").sort_values("rms_um", kind="stable")
    return by_rms.correlation_strike


def placed_elsewhere():
    elsewhere = found_places().xs("one elsewhere", level="scans")
    told = round(20 * (1 - elsewhere.found_fraction["tied by the stage"]))
    return told, elsewhere.found_and_wrong["by hand"]


def runs_of_a_study():
    rows = pd.read_csv(RESULTS / "margin.csv")
    (count,) = set(rows.groupby("run")["values"].sum())
    return count, int(rows.margin.min())


def against_best(column, best):
    """The law beside the best baseline: of the stones worn by the law, and of those by the rule."""
    models = verdict.model_table(rows_of("verdict")).set_index(["worn by", "model"])
    for worn_by in reversed(verdict.WORN_BY):
        of_baselines = models.loc[worn_by].loc[[*verdict.BASELINES]]
        yield of_baselines[column][best(of_baselines)]


def most(column):
    return lambda models: models[column].map(lambda cell: values(cell)[0]).idxmax()


def of_law(column, best):
    return lambda: (values(*against_best(column, best)), stones_of("verdict"))


def stones_of(name):
    return [rows_of(name).seed.nunique()]


GAIN, MAPS, VOLUMES = (
    "law's gain",
    "law's map_error_um / its",
    "law's volume_error / its",
)


def of_gain(number):
    def made():
        gains = [*against_best(GAIN, most("mean MCC"))]
        return values(gains[number]), stones_of("verdict")

    return made


def of_strength():
    elastic, *_, weakest = [*strengths()][1]
    return [elastic[0], weakest[0]], [verdict.WITH_STRENGTHS]


def of_uses(cases, names):
    """Columns of the summary of uses, and how many stones there are of each case."""

    def made():
        rows = summary_of(use, "use").loc[cases]
        (stones,) = set(rows.stones)
        return rows[names].to_numpy().ravel(), [stones]

    return made


def of_claims_without_contact():
    claimed, count, _ = claims_of_uses()
    return [claimed], [count]


def of_outside():
    *counts, right, named = uses_beyond_the_square()
    return [right, named], [counts[1]]


def of_strikes(positions):
    def made():
        rows = summary_of(strikes, "strikes").reset_index()
        row = rows[(rows.positions == positions) & (rows.rms_um == 5)].squeeze()
        return [row.correlation_smooth, row.correlation_halves], [row.patches]

    return made


def of_level(name, wears):
    """The least and the largest rate of claims that are false."""

    def made():
        cells = [cell for row in claims_of_tests(name, wears) for cell in row]
        low, high = (end(cell[0] for cell in cells) for end in (min, max))
        stones = rates(name).set_index("wear").loc[[*wears]].specimens
        return [low, high], [stones.max()]

    return made


def of_test(test, wear, drawn=None):
    def made():
        rows = rates("power")
        rows = rows[(rows.test == test) & (rows.wear == wear)]
        rows = rows[rows.drawn.isna() if drawn is None else rows.drawn == drawn]
        row = rows.squeeze()
        shown = [row.rate] if drawn else [row.rate, row.low, row.high]
        return percent(shown), [row.specimens]

    return made


def of_interlayer():
    right, worn, wrong, others = interlayers()
    return [right, wrong], [worn, others]


def of_scale(*variants, held=False, **case):
    def made():
        rows = [scale_of(variant, **case) for variant in variants]
        (stones,) = stones_of("two_scales")
        names, count = ("held", 25 * stones) if held else ("misplaced", stones)
        return percent(*(row[names] for row in rows)), [count]

    return made


def of_scans(how):
    def made():
        row = found_places().loc[(how, "own")]
        return percent(row.found_fraction), [row.number]

    return made


def of_other_stones():
    others = found_places().query("scans in ('another', 'smooth')")
    return [(others.found_fraction * others.number).sum()], [others.number.sum()]


def of_mistakes():
    cells = next(mistakes_in_places())
    return [cells[4], cells[2], cells[5]], studies_of_places().studies.unique()


def of_stops():
    counts = summary_of(false_stops, "false_stops")
    return [counts.stop.sum()], [counts.studies.sum()]


def of_registration():
    row = (
        rows_of("registration")
        .set_index(["method", "condition"])
        .loc["gstlib", "of all"]
    )
    return [row.error_median_points, row.error_largest_points], [row.cases]


def of_breech_faces(*kinds, names):
    def made():
        counts = summary_of(measured_surfaces, "breech_faces").copy()
        # every match of an unrelated pair is wrong
        counts.loc["unrelated", "wrong"] = counts.loc["unrelated", "found"]
        counts = counts.loc[[*kinds]] if kinds else counts
        return [counts[names].sum()], [counts.pairs.sum()]

    return made


def of_repeats():
    rows = rows_of("repeats").query("found")
    is_little = rows[["loss_fraction", "gain_fraction"]].lt(0.005).all(axis=1)
    return [(is_little | ~rows.above_noise.astype(bool)).sum()], [len(rows)]


def measurements(*names):
    tables = [pd.read_csv(RESULTS / f"{name}.csv").assign(name=name) for name in names]
    rows = pd.concat(tables)
    return rows.assign(is_own=rows.code.str.startswith("gstlib"))


COLD = "rough-76", "rough-22", "hertz-256", "hertz-512"
PATHS, PERIODIC = ("path-76", "path-22"), ("periodic-76", "periodic-2000")


def of_accuracy():
    own = measurements(*COLD, *PATHS, *PERIODIC, "growth").query("is_own")
    return [1e9 * own.gap_error.max(), 10], [len(own)]


def of_speed(*names):
    def made():
        peers = measurements(*names).query("not is_own and reached == 'yes'")
        fastest = peers.groupby("name").ratio.min()
        return sorted({fastest.min(), fastest.max()}), [len(fastest)]

    return made


def of_tables():
    rows = pd.read_csv(RESULTS / "margin.csv")
    return [rows.changes.sum()], [runs_of_a_study()[0]]


LAW_WORN, ERRORS = ["law"], ["inferred", "told", "known"]
# The rows of the first table: the values of its numbers, and how many cases there are.
FIRST = {
    "locates it better": of_gain(0),
    "a rule without contact": of_gain(1),
    "depth maps": of_law(MAPS, most(MAPS)),
    "volumes of the best": of_law(VOLUMES, most(VOLUMES)),
    "mean volume": of_law(VOLUMES, lambda models: "mean_volume"),
    "a cap on the pressure": of_strength,
    "contain the true values": of_uses(LAW_WORN, ["held_95"]),
    "strikes scatter": of_uses(["scatter", "stroke"], ["held_95"]),
    "the middle half": of_uses(["scatter", "stroke", "control"], ["held_50"]),
    "not attributed": of_claims_without_contact,
    "if a load made": of_uses(LAW_WORN, ["pressed"]),
    "than the prior": of_uses(LAW_WORN, ERRORS),
    "twice the force": of_uses(["force", "squared", "root"], ["held_95"]),
    "right edge": of_outside,
    "new pieces": of_strikes("elsewhere"),
    "the same piece": of_strikes("again"),
    "unrelated to contact": of_level("power", power.BY_RULE[1:]),
    "load case is inferred": of_level("power_inferred", power.BY_RULE[1:]),
    "better than chance": of_test(SHOWN_TESTS[0], "archard"),
    "also shows that": of_test(SHOWN_TESTS[1], "archard"),
    "finds an interlayer": of_interlayer,
    "twelve patches": of_test(SHOWN_TESTS[-2], "summits", 12),
    "method of 2024": of_scale("equilibrium", "paper"),
    "by a millimetre": of_scale("equilibrium", distance=1),
    "intervals of pressure": of_scale("equilibrium", distance=1, held=True),
    "tied by the stage": of_scans("tied by the stage"),
    "placed by hand": of_scans("by hand"),
    "of another stone": of_other_stones,
    "wrong position, orientation": of_mistakes,
    "correct study": of_stops,
    "synthetic scans": of_registration,
    "turned by at most": of_breech_faces("related", names="found"),
    "a wrong match": of_breech_faces(names="wrong"),
    "measured repeats": of_repeats,
    "every state": of_accuracy,
    "an eighth": of_speed(*COLD, *PATHS),
    "two thirds": of_speed("periodic-2000"),
    "printed numbers": of_tables,
}


HELD = "true pressure of (\\S+ % \\[.*?\\]) of 500 patches, and of (\\S+ % \\[.*?\\]) of the 236"
WORDS = [
    (
        r"(\d+) % of its load lies .*? the truth has (\S+) % .*? carry too much \((\d+) %\)",
        edges,
    ),
    (
        r"equilibrium has (\S+ % \[.*?\]) and F1 (\S+ \[.*?\])\. The paper has (\S+ % \[.*?\]) and "
        r"(\S+ \[.*?\])\..*?have F1 (\S+) in equilibrium\..*?F1 is (\S+), and a quarter",
        scales_in_detail,
    ),
    (
        HELD,
        lambda: map(
            percent, scale_of("equilibrium", distance=1)[["held", "loaded_held"]]
        ),
    ),
    (
        r"error of volumes at 200 mm is (\S+ \[.*?\]) in equilibrium, (\S+ \[.*?\]) .*? and (\S+) "
        r"with",
        lambda: [
            scale_of(name).volume_error
            for name in ("equilibrium", "paper", "true face")
        ],
    ),
    (
        r"A load case was claimed in (\d+) of (\d+) such cases\. "
        r"In (\d+) of these, nothing could be inferred",
        claims_of_uses,
    ),
    (
        r"does so on (\d+) of (\d+) stones of \*outside\*, and on (\d+) of the (\d+) of \*law.*?"
        r"edge was right on (\d+) of the (\d+) stones",
        uses_beyond_the_square,
    ),
    (r"a round one on (\d+) of (\d+) stones", better_forms),
    (
        r"On \*law\*, (\d+) % of the true .*? and (\d+) % in the middle 95 %\. On \*control\*, "
        r"(\d+) and (\d+) % do, on \*scatter\* (\d+) and (\d+) %, and on \*stroke\* (\d+) and "
        r"(\d+) %\. If everything is drawn from the prior, (\d+) and (\d+) % do",
        regions,
    ),
    (
        r"with an error of (\S+)\. The error is (\S+) with the true load case, and (\S+) with "
        r"the prior\. The ratio .*? median of (\S+) over",
        errors_of_losses,
    ),
    (r"made the wear, one was claimed for (\d+) of (\d+) stones", claimed_of_law),
    (
        r"lies in the middle 95 % on (\d+) of (\d+) stones of \*scatter\*, and on (\d+) of (\d+) "
        r"of .*? ln R are (\S+) and (\S+), compared with (\S+) on",
        spreads,
    ),
    (
        r"in the config, (\d+) % of the true values .*? the true form (\d+) %",
        lambda: summary_of(use, "use").held_95[["two radii", "true form"]],
    ),
    (r"In (\d+) of the (\d+) cases, the study adopted", adopted_without_relation),
    (
        r"smooth contact at (\S+) to (\S+), (\S+) to (\S+) and (\S+) to (\S+)\.",
        strikes_apart,
    ),
    (
        r"The fault names that orientation in (\S+) % of all",
        lambda: [
            percent(
                studies_of_places().loc["default", 25].named[placement.ORIENTED].mean()
            )
        ],
    ),
    (r"None of (\S+) printed numbers changed.*? at least (\d+) times", runs_of_a_study),
    (
        r"r\.m\.s\. errors of (\S+), (\S+) and (\S+) µm",
        lambda: read_table(ROOT / "tests/baseline/tables/gridding.csv").left_out_rms_um,
    ),
    (
        r"the stage shows it on (\d+) of 20 stones\. .*?hand, (\d+) of these 20",
        placed_elsewhere,
    ),
    (
        r"test at 5 % claims a relation on (\S+) % of patches",
        lambda: [percent(chances()["waves"])],
    ),
    (
        r"a relation in (\S+) % of cases with twelve",
        lambda: [percent(chances()["pairs"])],
    ),
    (r"of normal numbers in (\S+) % of cases", lambda: [percent(chances()["mean"])]),
    (
        r"finds it on (\w+) of the (\w+) stones .*? on (\w+) of the (\w+) others",
        interlayers,
    ),
    (r"hand, (\d+) of (\d+) scans are \*not certain", not_certain),
    (
        r"With 2 GPa, up to (\d+) % of a patch's contact",
        lambda: [
            percent(
                read_table(CASES).query("quantity == 'share at the cap'").value.max()
            )
        ],
        CONFIG,
    ),
    (
        r"cold contact takes (\S+) times as long, the path (\S+) times",
        lambda: transforms.ratios(rows_of("transforms")).ratio[["rough-76", "path-76"]],
        README,
    ),
    (
        r"took `gstlib` (\S+) s of .*? aspher took (\S+) times .*? slippy (\S+), ContactMechanics "
        r"(\S+) and Tamaas (\S+)\. .*? took (\S+) s, and the fastest peer (\S+) times",
        peers,
        PAPER,
    ),
    (
        r"On (\d+) synthetic stones.*? error was (\S+) times .*? was (\S+) with the true load case "
        r"and (\S+) with .*? Of (\d+) cases .*?, (\d+) (?:was|were) claimed",
        uses_in_the_paper,
        PAPER,
    ),
    (
        r"coefficient of (\S+)\. The best fair baseline reaches (\S+), .*? coefficients are (\S+) "
        r"and (\S+)\.",
        law_and_best_baseline,
        PAPER,
    ),
]


@pytest.mark.parametrize("claim", WORDS, ids=lambda claim: claim[1].__name__)
def test_a_sentence_says_what_the_rows_show(claim):
    pattern, exact, *document = claim
    for shown, value in zip(words(pattern, *document), exact(), strict=True):
        in_digits = SPELLED.get(shown, shown)
        assert numbers(in_digits)
        assert_same(in_digits, value)


@pytest.mark.parametrize("part", FIRST)
def test_the_first_table_shows_the_rows(part):
    ((_, number, count, verdict_of_it),) = [
        row for row in table("# Evidence") if part in row[0]
    ]
    for cell, exact in zip((number, count), FIRST[part](), strict=True):
        for shown, value in zip(numbers(cell), exact, strict=True):
            assert_same(shown, value)
    assert verdict_of_it in ("holds", "does not hold", "not shown")


def test_the_first_table_has_a_check_for_each_row():
    assert len(table("# Evidence")) == len(FIRST)


def test_the_readme_repeats_the_first_table():
    first = [
        (numbers(f"{number} {count}"), holds)
        for _, number, count, holds in table("# Evidence")
    ]
    for _, number, holds in table("> **Status.**", ROOT / "README.md"):
        shown = numbers(number)
        assert any((shown, holds) == (own[: len(shown)], held) for own, held in first)


# --- Rows, and what they must show whatever the documents say ------------------------------------


def test_the_rows_are_those_that_their_program_made():
    kept = {file.stem: sha256(file)[:16] for file in RESULTS.glob("*.csv")}
    kept.pop("calibration")  # where a search for tolerances starts
    assert kept == {name: made["rows"] for name, made in age.read().items()}


def test_the_evidence_says_how_old_its_rows_are():
    shown = EVIDENCE.read_text().partition(age.BEGIN)[2].partition(age.END)[0]
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


@pytest.mark.parametrize("heading", ["| claim | worn on", "| claim, use inferred |"])
def test_no_false_claim_comes_more_often_than_its_level_beyond_chance(heading):
    random_and_waves = slice(1, 3) if "worn on" in heading else slice(None)
    for rates_of_one in TABLES[heading]():
        assert all(low <= 5 for _, low, _ in rates_of_one[random_and_waves])


def test_names_in_the_first_column_are_those_of_the_rows():
    for heading, names in (
        ("## How was it used?", summary_of(use, "use").index),
        ("**Repeats.**", rows_of("repeats").pair),
        ("| way | found |", found_places().xs("own", level="scans").index),
        (
            "## False stops",
            [f"{n} × {n}" for n in summary_of(false_stops, "false_stops").index],
        ),
    ):
        assert [cells[0] for cells in table(heading)] == list(names)
    sizes = pd.read_csv(RESULTS / "scale.csv", index_col="quantity")
    assert [cells[0] for cells in table("## Hundreds of patches", CLUSTER)] == list(
        sizes
    )


def test_the_force_in_the_square():
    shown = [cells[1] for cells in table("## Errors due to the two scales") if cells[1]]
    for cell, radius in zip(shown, (60, 200, 1000), strict=True):
        newtons = values(scale_of("true face", radius=radius).square_N)[0]
        assert_same(cell, 100 * newtons / 550)  # of config/config.yaml


def test_repeats_say_which_serve():
    answers = {True: "yes", False: "no"}
    rows = rows_of("repeats")
    shown = [cells[4:6] for cells in table("**Repeats.**")]
    assert shown == [
        [answers[answer] for answer in row]
        for row in rows[["above_noise", "serves"]].values
    ]


def test_power_makes_as_many_rows_as_are_committed():
    made = rows_of("power").groupby("wear").seed.nunique()
    assert {made[wear] for wear in power.OF_BARE} == {power.SPECIMENS}
    assert made["interlayer"] == power.INTERLAYERS
    assert set(rows_of("false_stops").seed) == {false_stops.STOPPED, *false_stops.SEEDS}
    assert summary_of(strikes, "strikes").patches.eq(20).all()


def test_nothing_printed_changed_in_any_run():
    rows = pd.read_csv(RESULTS / "margin.csv")
    assert {*rows.table} <= {Path(listed.file).name for listed in LISTED.values()}
    counts = rows.groupby("run")[["different", "changes"]].sum()
    assert counts.changes.eq(0).all()
    assert not counts.different["1 core"]


def test_the_picture_of_readme_shows_the_stored_study():
    """`docs/overview.py` draws it, and says in it of which scores."""
    with Image.open(ROOT / "docs/overview.png") as picture:
        shows = picture.text["scores"]
    assert shows == sha256(ROOT / "tests/baseline/tables/validation_patches.csv")


def test_scans_are_found_on_their_own_stone_alone():
    own = found_places().xs("own", level="scans")
    assert (own.held_fraction >= 0.9).all()
    # honest errors are not just large
    assert (own.stated_rms_um <= 1.5 * own.true_rms_um).all()
    others = found_places().query("scans in ('another', 'smooth')")
    assert len(others) == 6
    assert others.found_fraction.eq(0).all()


def test_mistakes_in_the_places():
    """As the evidence has them in words."""
    studies = studies_of_places()
    assert studies.xs("none", level="mistake").stopped.eq(0).all()
    every = studies.loc["default", 25]
    assert every.loc[[placement.EXCHANGED, *placement.MIRRORED], "stopped"].eq(1).all()
    stones = [row[0] for row in table("**Mistakes in the positions**")]
    shown = ["default", "default", "mesh noise 3 µm", "mesh edges 0.45 mm"]
    assert [stone.split()[-2:] for stone in stones[2:]] == [
        ["of", "noise"],
        ["0.45", "mm"],
    ]
    for stone, patches in zip(shown, (25, 4, 25, 25), strict=True):
        assert studies.loc[stone, patches].wrong_agree.eq(0).all()
