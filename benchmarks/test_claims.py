"""The figures of the documents are those of the committed rows: benchmarks/README.md lists them."""

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
import scale
import statistics_of_contact
import strikes
import transforms
import two_scales
import use
import verdict
from PIL import Image

from gst.config.tables import TABLES
from gstlib.io.files import sha256
from gstlib.io.tables import read_table

EVIDENCE = power.ROOT / "docs/explanation/evidence.md"
INFERRED = power.RESULT.with_name("power_inferred.csv")
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")


def numbers(text):
    return NUMBER.findall(str(text).replace("−", "-"))


def same(shown, found, factor=1.0):
    """Whether each number that is shown is the one that is found, rounded as it is shown."""
    pairs = zip(numbers(shown), numbers(found), strict=False)
    return bool(numbers(found)) and all(
        # half a digit, and what the found number itself was rounded by
        abs(float(a) - factor * float(b)) <= 0.56 * 10 ** -len(a.partition(".")[2])
        for a, b in pairs
    )


def table(heading, document=EVIDENCE):
    """The rows of cells of the first Markdown table below a heading, without its head."""
    text = document.read_text()
    lines = iter(text[text.index(heading) :].splitlines())
    rows = []
    for line in lines:
        if line.startswith("|"):
            rows.append([cell.strip() for cell in line.strip("|").split("|")])
        elif rows:
            break
    return rows[2:]


def test_the_rows_are_those_that_their_program_made():
    kept = {file.stem: sha256(file)[:16] for file in age.MADE.parent.glob("*.csv")}
    kept.pop("calibration")  # where a search for tolerances starts
    assert kept == {name: made["rows"] for name, made in age.read().items()}


def test_the_evidence_says_how_old_its_rows_are():
    text = EVIDENCE.read_text()
    shown = text.partition(age.BEGIN)[2].partition(age.END)[0]
    assert shown.strip() == age.said(), "run benchmarks/age.py"


def test_rows_are_of_the_program_until_a_module_changes(tmp_path, monkeypatch):
    monkeypatch.setattr(age, "MADE", tmp_path / "made.json")
    rows = tmp_path / "chance.csv"
    rows.write_text("case\n")
    age.record(rows)
    now, earlier = age.said().splitlines()
    assert "`chance.csv`" in now
    assert "`chance.csv`" not in earlier
    monkeypatch.setattr(age, "library_hash", lambda script: "another")
    assert "`chance.csv`" in age.said().splitlines()[-1]
    age.record(rows, adds=True)
    assert age.read()["chance"]["program"] == age.SEVERAL
    age.record(rows)
    assert age.read()["chance"]["program"] == "another"


def test_statistics_of_rough_contact():
    found = statistics_of_contact.summary(read_table(statistics_of_contact.ROWS))
    shown = table("## Numbers that others", power.ROOT / "docs/explanation/solver.md")
    for cells, row in zip(shown, found.itertuples(), strict=True):
        _, _, kappa, published, deviation, area, persson, gamma = cells
        assert same(kappa, f"{row.kappa} {row.error}")
        assert same(area, row.contact)
        assert same(persson, row.persson)
        assert same(gamma, row.gamma)
        assert bool(published) == (row.published == row.published)
        if published:
            assert same(
                deviation.replace("+", ""), f"{row.deviation_percent} {row.error_percent}"
            )
            assert same(published, row.published)


def evidence():
    return " ".join(EVIDENCE.read_text().split())


def said(pattern):
    """What the groups of a pattern are in the text of the evidence."""
    return re.search(pattern, evidence()).groups()


@pytest.fixture(scope="module")
def scales():
    rows = pd.read_csv(two_scales.ROWS)
    of = ["scan_points", "trial", "radius_mm", "distance_mm", "variant"]
    return two_scales.summary(rows).set_index(of).sort_index()


def test_two_scales_by_form(scales):
    shown = table("## What the two scales cost")
    cases = [
        (radius, variant) for radius in (60, 200, 1000) for variant in ("placed", "levelled")
    ]
    for (radius, variant), (*_, patch, of_all, f1) in zip(cases, shown, strict=True):
        found = scales.loc[128, "default", radius, 0, variant]
        assert same(patch, found.misplaced, 100)
        assert same(of_all, found.misplaced_of_all, 100)
        assert same(f1, found.f1)


def test_load_at_a_cut_edge(scales):
    square, truth, face = said(
        r"\((\d+) % of its load lies .*? the truth has (\S+) % .*? carry too much \((\d+) %\)"
    )
    assert same(square, scales.loc[128, "default", 200, 0, "levelled"].edge_of_square, 100)
    assert same(truth, scales.loc[128, "default", 200, 0, "true face"].edge_of_square, 100)
    assert same(face, scales.loc[128, "default", 1000, 0, "placed"].edge_of_face, 100)


def test_two_scales_at_the_scans_own_resolution(scales):
    placed, f1, levelled, f1_levelled, highest, unfiltered = said(
        r"placed (\S+) % \[.*?\] and F1 (\S+) \[.*?levelled (\S+) % \[.*?\] and (\S+) \[.*?"
        r"have F1 (\S+) placed\..*?F1 (\S+), and a quarter"
    )
    found = scales.loc[512, "default", 200, 0]
    assert same(placed, found.misplaced["placed"], 100)
    assert same(levelled, found.misplaced["levelled"], 100)
    assert same(f1, found.f1["placed"])
    assert same(f1_levelled, found.f1["levelled"])
    assert same(highest, found.f1["highest_placed"])
    assert same(unfiltered, scales.loc[512, "S-filter none", 200, 0, "placed"].f1)


def test_two_scales_by_load_point(scales):
    shown = table("## The load point and other errors")
    for (radius, distance), (*_, placed, levelled) in zip(
        ((60, 1), (200, 1), (200, 3), (1000, 1)), shown, strict=True
    ):
        for variant, cell in (("placed", placed), ("levelled", levelled)):
            found = scales.loc[128, "default", radius, distance, variant]
            wrong, *_, of_all, f1 = re.sub(r" \[.*?\]", "", cell).split(", ")
            assert same(wrong, found.misplaced, 100)
            assert same(of_all, found.misplaced_of_all, 100)
            assert same(f1, found.f1)


def test_coverage_of_the_intervals(scales):
    found = scales.loc[128, "default", 200, 1, "placed"]
    of_all, of_loaded = said(
        r"true pressure of (\S+ % \[.*?\]) of 500 patches, and of (\S+ % \[.*?\]) of the 236"
    )
    assert same(of_all, found.held, 100)
    assert same(of_loaded, found.loaded_held, 100)


def test_what_pressures_are_worth_for_wear(scales):
    placed, alone, true = said(
        r"at 200 mm is (\S+) \[.*?equilibrium, (\S+) \[.*?and (\S+) with"
    )
    found = scales.loc[128, "default", 200, 0].volume_error
    assert same(placed, found["placed"])
    assert same(alone, found["levelled"])
    assert same(true, found["true face"])


def test_two_scales_by_error(scales):
    shown = table("| changed |")
    trials = [name for name in two_scales.TRIALS if not name.startswith("S-filter")]
    assert len(shown) == len(trials)
    of_shown = ("nothing", "mesh 0", "mesh 2", "mesh 10", "known", "± 100", "linear")
    for part, trial in zip(of_shown, trials, strict=True):
        (row,) = (row for row in shown if part in row[0])
        _, patch, f1, area, volumes, _, levelled = row
        found = scales.loc[128, trial, 200, 0, "placed"]
        assert same(patch, found.misplaced, 100)
        assert same(f1, found.f1)
        assert same(area, found.area_ratio)
        assert same(volumes, found.volume_error)
        other = scales.loc[128, trial, 200, 0, "levelled"]
        patch, f1 = levelled.split(",")
        assert same(patch, other.misplaced, 100)
        assert same(f1, other.f1)


def test_worth_of_the_prediction():
    found = verdict.model_table(read_table(verdict.RESULT))
    for worn_by, heading in (
        ("summits", "| summits worn by a rule | mean"),
        ("archard", "| worn by Archard's law |"),
    ):
        shown, rows = table(heading), found[found.iloc[:, 0] == worn_by]
        for cells, values in zip(shown, rows.to_numpy(), strict=True):
            for cell, value in zip(cells[1:], values[3:], strict=True):
                assert not cell or same(cell, value), (cells, value)


def test_how_was_it_used():
    found = use.summary(use.made(use.RESULT))
    columns = ["stones", "pressed", "y_mm", "x_mm", "log_radius", "held_50", "held_95", "told"]
    columns += ["inferred", "known"]
    shown = table("## How was it used?")
    assert [cells[0] for cells in shown] == list(found.index)
    for (_, *cells), (case, values) in zip(shown, found.iterrows(), strict=True):
        for cell, column in zip(cells, columns, strict=True):
            value = values.get(column)
            assert pd.isna(value) if cell == "" else same(cell, value), (case, column, cell)


def test_claims_where_nothing_was_pressed_and_where_it_lay_elsewhere():
    rows = use.made(use.RESULT)
    unpressed = rows[rows.case.isin(use.UNPRESSED)]
    cases, claimed = map(int, said(r"in (\d+) such cases, a use was claimed in (\d+)\."))
    assert (cases, claimed) == (len(unpressed), (unpressed.answer == use.PRESSED).sum())
    (without,) = map(int, said(r"In (\d+) of these, nothing could be inferred"))
    assert without == unpressed.log_score.isna().sum()
    side, reach = 5.0, 1.96  # of config/config.yaml, mm; standard deviations
    middles, reaches, truths = (
        rows[[f"{name}_{axis}_mm" for axis in "yx"]].to_numpy()
        for name in ("mean", "sd", "true")
    )
    named, over = (
        np.stack([at - by < 0, at + by > side])
        for at, by in ((middles, reach * reaches), (truths, 0.0))
    )
    is_beyond = named.any(axis=(0, 2))
    counts = said(
        r"on (\d+) of (\d+) such stones, and from losses on (\d+) of the (\d+) of \*law.*?"
        r"on (\d+) of the (\d+), the hand"
    )
    outside, law = rows.case == "outside", rows.case == "law"
    values = [count for case in (outside, law) for count in (is_beyond[case].sum(), case.sum())]
    right = (named & over).any(axis=(0, 2)) & outside
    assert [*map(int, counts)] == [*values, right.sum(), (is_beyond & outside).sum()]
    score = rows.pivot_table(index="seed", columns="case", values="log_score")
    score = score[["true form", "two radii"]].dropna()
    better, stones = said(r"a round one on (\d+) of (\d+) stones")
    assert int(stones) == len(score)
    assert int(better) == (score["true form"] > score["two radii"]).sum()


def test_strength_of_the_stone():
    found = verdict.strength_table(read_table(verdict.RESULT)).set_index(["worn_by", "model"])
    models = "archard", "2000 MPa", "1000 MPa", "300 MPa"
    shown = table("| mean MCC (map error, µm) |")
    for worn_by, (_, *cells) in zip(("summits", "archard"), shown, strict=True):
        for model, cell in zip(models, cells, strict=True):
            row = found.loc[(worn_by, model)]
            assert same(cell, f"{row.mcc} {row.map_error_um}"), (worn_by, model)


def test_what_a_contact_leaves_out():
    found = left_out.summary(read_table(left_out.ROWS))
    shown = table("## What a patch's contact leaves out")
    for (_, *cells), (_, *values) in zip(shown, found.itertuples(index=False), strict=True):
        for cell, value in zip(cells, values, strict=True):
            assert same(cell, value) if cell else value != value


def test_what_wear_sees_of_a_rough_tool():
    found = strikes.summary(read_table(strikes.ROWS))
    named = ["area_ratio", "correlation_smooth", "correlation_halves"]
    named += ["mcc_smooth", "mcc_halves", "mcc_height"]
    shown = table("**Is the contact with a smooth tool")
    for (_, rms, *cells), (_, row) in zip(shown, found.iterrows(), strict=True):
        assert (float(rms), row.patches) == (row.rms_um, 20)
        assert all(same(cell, row[name]) for cell, name in zip(cells, named, strict=True))
    single = said(r"smooth contact at (\S+) to (\S+), (\S+) to (\S+) and (\S+) to (\S+)\.")
    by_rms = found.sort_values("rms_um", kind="stable").correlation_strike
    assert all(same(cell, value) for cell, value in zip(single, by_rms, strict=True))


@pytest.mark.parametrize(
    ("rows", "heading", "wears"),
    [
        (power.RESULT, "| claim |", power.OF_BARE),
        (INFERRED, "| claim, use inferred |", power.BY_RULE[1:]),
    ],
)
def test_rates_of_the_tests(rows, heading, wears):
    rates = power.rejection_rates(read_table(rows))
    rates = rates[(rates.level == power.SHOWN) & rates.drawn.isna()].set_index(["test", "wear"])
    tests = (
        "tested_mean(mcc)",
        "better: gain(mcc)",
        "worse: gain(mcc)",
        "better: relative(map_error)",
        "better: relative(volume_error)",
        "spearman(pressure_MPa, loss_fraction)",
        "spearman(touched, mean_wear_depth_um)",
    )
    for test, (_, *cells) in zip(tests, table(heading), strict=True):
        for wear, cell in zip(wears, cells, strict=True):
            found = rates.loc[(test, wear)]
            assert same(cell, f"{found.rate} {found.low} {found.high}", 100), (test, wear)


def test_how_many_patches():
    rates = power.rejection_rates(read_table(power.RESULT))
    rates = rates[(rates.test == "spearman(pressure_MPa, loss_fraction)") & rates.drawn.notna()]
    of = rates[(rates.level == power.SHOWN) & (rates.wear == "summits")].set_index("drawn").rate
    shown = said(
        r"six in (\S+) % of cases, with eight in (\S+) %, with ten in (\S+) %, .* (\S+) %\."
    )
    for patches, cell in zip((6, 8, 10, 12), shown, strict=True):
        assert same(cell, of[patches], 100)
    assert of[4] == 0


def test_power_makes_as_many_rows_as_are_committed():
    made = read_table(power.RESULT).groupby("wear").seed.nunique()
    assert {made[wear] for wear in power.OF_BARE} == {power.SPECIMENS}
    assert made["interlayer"] == power.INTERLAYERS


def test_the_same_tables():
    """The rows are of tables that there are; nothing printed changed in any run."""
    rows = pd.read_csv(power.ROOT / "benchmarks/results/margin.csv")
    assert {*rows.table} <= {Path(listed.file).name for listed in TABLES.values()}
    numbers, times = said(r"None of (\S+) printed numbers changed.*? at least (\d+) times")
    found = rows.groupby("run")[["values", "different", "changes"]].sum()
    assert (found["values"] == int(numbers.replace(",", ""))).all()
    assert found.changes.eq(0).all()
    assert not found.different["1 core"]
    assert int(times) == rows.margin.min()


def test_the_picture_of_readme_shows_the_stored_study():
    """`docs/overview.py` draws it, and says in it of which scores."""
    with Image.open(power.ROOT / "docs/overview.png") as picture:
        shows = picture.text["scores"]
    assert shows == sha256(power.ROOT / "tests/baseline/tables/validation_patches.csv")


def test_errors_of_the_griddings():
    found = read_table(power.ROOT / "tests/baseline/tables/gridding.csv").left_out_rms_um
    shown = said(r"r\.m\.s\. errors of (\S+), (\S+) and (\S+) µm")
    assert all(map(same, shown, found))


def test_what_scipy_loses_against_ducc0():
    rows = read_table(transforms.ROWS).groupby(["case", "transforms"]).cpu_s.median().unstack()
    text = " ".join((transforms.ROWS.parents[1] / "README.md").read_text().split())
    said = re.search(
        r"cold contact takes (\S+) times as long, the path (\S+) times", text
    ).groups()
    ratio = rows.SciPy / rows.ducc0
    assert same(said[0], ratio["rough-76"])
    assert same(said[1], ratio["path-76"])
    assert ratio.max() <= 1.15


def test_the_paper_quotes_the_benchmarks():
    """Of the contact and the path at 76 MPa; and what the prediction of wear is worth."""
    text = " ".join((power.ROOT / "paper.md").read_text().split())
    said = re.search(
        r"gstlib` took (\S+) s of .*? aspher (\S+) times .*? slippy (\S+), ContactMechanics (\S+) "
        r"and Tamaas (\S+); .*? it took (\S+) s and the fastest peer (\S+) times",
        text,
    ).groups()
    cold, path = (
        pd.read_csv(transforms.ROWS.parent / f"{of}-76.csv") for of in ("rough", "path")
    )
    own, reached = cold.cpu_median[0], cold[cold.reached == "yes"]
    fastest = reached.groupby(reached.code.str.split(",").str[0]).cpu_median.min()
    ratios = [
        fastest[name] / own for name in ("aspher", "slippy", "ContactMechanics", "Tamaas")
    ]
    own_path, peer = (
        path.cpu_median[0],
        path.cpu_median[~path.code.str.startswith("gstlib")].min(),
    )
    found = [own, *ratios, own_path, peer / own_path]
    assert all(abs(float(a) / b - 1) < 0.01 for a, b in zip(said, found, strict=True))
    rows = use.made(use.RESULT)
    law = use.summary(rows).loc["law"]
    quoted = re.search(
        r"On (\d+) synthetic stones .*? error of (\S+) of .*? against (\S+) with the use known and "
        r"(\S+) as told; and of (\d+) cases .*?, (\d+) (?:was|were) claimed",
        text,
    ).groups()
    assert all(map(same, quoted, law[["stones", "inferred", "known", "told"]]))
    unpressed = rows[rows.case.isin(use.UNPRESSED)]
    claimed = (unpressed.answer == use.PRESSED).sum()
    assert (int(quoted[4]), int(quoted[5])) == (len(unpressed), claimed)
    found = verdict.model_table(read_table(verdict.RESULT)).set_index(["worn by", "model"])
    quoted = re.search(
        r"coefficient of (\S+), and its best fair baseline reaches (\S+): "
        r".*? it is (\S+) against (\S+)\.",
        text,
    ).groups()
    for worn_by, law, baseline in (("summits", *quoted[:2]), ("archard", *quoted[2:])):
        reached = found["mean MCC"][worn_by]
        assert same(law, reached[verdict.BARE])
        best = max(reached[[*verdict.BASELINES]], key=lambda of: float(numbers(of)[0]))
        assert same(baseline, best)


def test_many_patches():
    rows = pd.read_csv(scale.ROWS, index_col="quantity")
    shown = table("## Hundreds of patches", power.ROOT / "docs/how-to/cluster.md")
    assert [int(cells[0]) for cells in shown] == [int(patches) for patches in rows]
    for patches, steps, plan_s, plan_mb, *of_run in shown:
        found = rows[patches]
        assert same(steps, found.plan_jobs)
        assert same(plan_s, found.plan_cpu_s)
        assert same(plan_mb, found.plan_peak_mb)
        run = [f"run_{of}" for of in ("cpu_s", "cpu_s_per_patch", "wall_s", "largest_job_mb")]
        for cell, value in zip(of_run, found[run], strict=True):
            assert pd.isna(value) if cell == "–" else same(cell, value), (patches, cell)


def test_places_by_heights():
    """As the evidence has them in words."""
    found = pd.read_csv(power.ROOT / "benchmarks/results/finding.csv").set_index(
        ["how", "scans"]
    )
    own = found.xs("own", level="scans")
    assert (own.held_fraction >= 0.9).all()
    assert (
        own.stated_rms_um <= 1.5 * own.true_rms_um
    ).all()  # honest errors are not just large
    shown = table("| way | found |")
    assert [cells[0] for cells in shown] == [*own.index]
    columns = ["off_median_um", "off_p95_um", "stated_rms_um", "true_rms_um"]
    for (how, part, *cells, held, wrong), row in zip(shown, own.itertuples(), strict=True):
        assert part == f"{row.found_fraction:.0%}".replace("%", " %"), how
        assert [*map(float, cells)] == [round(getattr(row, name)) for name in columns]
        assert held == f"{row.held_fraction:.0%}".replace("%", " %")
        assert int(wrong) == row.found_and_wrong
    others = found[found.index.isin(["another", "smooth"], level="scans")]
    assert len(others) == 6
    assert others.found_fraction.eq(0).all()
    elsewhere = found.xs("one elsewhere", level="scans")
    told, wrong = said(r"the stage shows it on (\d+) of 20; .*?hand, (\d+) of these 20")
    assert int(told) == round(20 * (1 - elsewhere.found_fraction["tied by the stage"]))
    assert int(wrong) == elsewhere.found_and_wrong["by hand"]


def test_mistakes_in_the_places():
    """As the evidence has them in words."""
    keys = ["stone", "patches", "mistake"]
    found = pd.read_csv(power.ROOT / "benchmarks/results/placement.csv").set_index(keys)
    found = found.sort_index()
    assert found.xs("none", level="mistake").stopped.eq(0).all()
    every = found.loc["default", 25]
    text = " ".join(EVIDENCE.read_text().split())
    text = text[text.index("Mistakes in the places") :]
    turned = every.loc[placement.ORIENTED].mean()
    assert every.wrong_agree.eq(0).all()
    assert every.loc[[placement.EXCHANGED, *placement.MIRRORED], "stopped"].eq(1).all()
    half = found.xs(placement.SOME[1], level="mistake").stopped
    noisy, coarse = ((stone, 25) for stone in ("mesh noise 3 µm", "mesh edges 0.45 mm"))
    agreeing = found.xs("none", level="mistake").right_agree
    for share, words in (
        (every.right_agree["none"], "In studies of 25 patches, {} of the patches agree"),
        (turned.stopped, "orientations, {} of the studies stop, and the fault"),
        (turned.named, "names that orientation in {}"),
        (every.stopped[placement.ELSEWHERE], "another place stops {}"),
        (half["default", 4], "With four patches, a half turn stops {}"),
        (agreeing[noisy], "of noise, {} of the patches agree"),
        (half[noisy], "agree and a half turn stops {}"),
        (agreeing[coarse], "0.45 mm, {} of the patches agree"),
        (half[coarse], "of the patches agree and it stops {}"),
    ):
        assert words.format(f"{100 * share:.0f} %") in text


def test_rates_on_random_numbers():
    found = chance.rates(read_table(chance.ROWS))
    claims, held = found["claim", "mean"], found["held", "mean"]
    for pattern, value in (
        (r"test at 5 % claims a relation on (\S+) % of patches", claims["waves"]),
        (r"a relation in (\S+) % of cases with twelve", claims["neighbours"]),
        (r"of normal numbers in (\S+) % of cases", held["mean of 6"]),
    ):
        assert same(*said(pattern), value, 100)


def test_repeats_on_measured_surfaces():
    rows = read_table(measured_surfaces.RESULTS / "repeats.csv")
    shown = table("**Repeats.**")
    assert [cells[0] for cells in shown] == list(rows.pair)
    for (name, shift, loss, gain, *said_of, neighbours, white), row in zip(
        shown, rows.itertuples(), strict=True
    ):
        points = np.array([row.shift_x_um, row.shift_y_um]) / row.spacing_um
        assert same(shift, f"{points[0]:.6f} {points[1]:.6f}"), name
        assert said_of == [
            {True: "yes", False: "no"}[of] for of in (row.above_noise, row.serves)
        ]
        if not row.found:
            assert {loss, gain, neighbours, white} == {"–"}, name
            continue
        for share, found in ((loss, row.loss_fraction), (gain, row.gain_fraction)):
            assert same(share, found, 100), name
        assert same(neighbours, f"{row.neighbours_x} {row.neighbours_y}"), name
        assert same(white, f"{row.white_loss} {row.white_gain}", 100), name


def test_breech_faces_on_each_other():
    found = measured_surfaces.summary(
        read_table(measured_surfaces.RESULTS / "breech_faces.csv")
    )
    kinds = "related", "related, turned far", "unrelated"
    for kind, (_, *cells) in zip(kinds, table("**Breech faces.**"), strict=True):
        assert cells == [
            "" if (kind, name) == ("unrelated", "wrong") else f"{number:,}"
            for name, number in found.loc[kind].items()
        ]


def test_false_stops():
    rows = read_table(false_stops.ROWS)
    assert set(rows.seed) == {false_stops.STOPPED, *false_stops.SEEDS}
    found = false_stops.summary(rows).drop(columns="largest_error_um")
    shown = table("## False stops")
    assert [int(cells[0].split()[0]) for cells in shown] == list(found.index)
    for (_, *cells), (_, counts) in zip(shown, found.iterrows(), strict=True):
        assert cells == [f"{number:,.0f}" for number in counts]
