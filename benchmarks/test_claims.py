"""The figures of the documents are those of the committed rows, as docs/claims.md says."""

import re

import chance
import pandas as pd
import power
import pytest
import scale
import transforms
import two_scales
import verdict

from gstlib.io.tables import read_table

DOCS = power.ROOT / "docs"
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


def table(document, heading):
    """The rows of cells of the first Markdown table below a heading, without its head."""
    text = (DOCS / document).read_text()
    lines = iter(text[text.index(heading) :].splitlines())
    rows = []
    for line in lines:
        if line.startswith("|"):
            rows.append([cell.strip() for cell in line.strip("|").split("|")])
        elif rows:
            break
    return rows[2:]


@pytest.fixture(scope="module")
def scales():
    rows = pd.read_csv(two_scales.ROWS)
    of = ["scan_points", "trial", "radius_mm", "distance_mm", "variant"]
    return two_scales.summary(rows).set_index(of).sort_index()


def test_two_scales_by_form(scales):
    shown = table("two_scales.md", "## With the load point known")
    cases = [
        (radius, variant) for radius in (60, 200, 1000) for variant in ("placed", "levelled")
    ]
    for (radius, variant), (*_, patch, of_all, f1) in zip(cases, shown, strict=True):
        found = scales.loc[128, "default", radius, 0, variant]
        assert same(patch, found.misplaced, 100)
        assert same(of_all, found.misplaced_of_all, 100)
        assert same(f1, found.f1)


def test_load_at_a_cut_edge(scales):
    shown = table("two_scales.md", "## Load at a cut edge")
    for radius, (_, alone, in_face, face, _) in zip((60, 200, 1000), shown, strict=True):
        of = scales.loc[128, "default", radius, 0]
        assert same(alone, of.edge_of_square["levelled"], 100)
        assert same(in_face, of.edge_of_square["placed"], 100)
        assert same(face, of.edge_of_face["placed"], 100)


def test_two_scales_by_error(scales):
    shown = table("two_scales.md", "## Which error matters")
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
        ("summits", "| worn by rule, on"),
        ("archard", "| worn by Archard's law |"),
    ):
        shown, rows = table("explanation/evidence.md", heading), found[found.iloc[:, 0] == worn_by]
        for cells, values in zip(shown, rows.to_numpy(), strict=True):
            for cell, value in zip(cells[1:], values[3:], strict=True):
                assert not cell or same(cell, value), (cells, value)


def test_readme_quotes_the_worth_of_the_prediction():
    found = verdict.model_table(read_table(verdict.RESULT)).set_index(["worn by", "model"])
    text = " ".join((power.ROOT / "README.md").read_text().split())
    quoted = re.search(
        r"mean MCC of (\S+), and .*? pressure \((\S+)\)\. .*? them, (\S+) against (\S+)\.\s",
        text,
    )
    models = [
        (worn, model)
        for worn in ("summits", "archard")
        for model in ("archard", "pressure_volume")
    ]
    for value, model in zip(quoted.groups(), models, strict=True):
        assert same(value, found["mean MCC"][model])


def test_rates_of_the_tests():
    rates = power.rejection_rates(read_table(power.RESULT))
    rates = rates[(rates.level == power.SHOWN) & rates.drawn.isna()].set_index(["test", "wear"])
    tests = (
        "mcc",
        "tested_mean(mcc)",
        "better: gain(mcc)",
        "worse: gain(mcc)",
        "better: relative(map_error)",
        "better: relative(volume_error)",
        "spearman(pressure_MPa, loss_fraction)",
        "spearman(touched, mean_wear_depth_um)",
    )
    for test, (_, *cells) in zip(tests, table("explanation/evidence.md", "| claim |"), strict=True):
        for wear, cell in zip(power.OF_BARE, cells, strict=True):
            found = rates.loc[(test, wear)]
            assert same(cell, f"{found.rate} {found.low} {found.high}", 100), (test, wear)


def test_errors_of_the_griddings():
    found = read_table(power.ROOT / "tests/baseline/tables/gridding.csv").left_out_rms_um
    text = (DOCS / "explanation/method.md").read_text()
    said = re.search(r"r\.m\.s\. errors are (\S+), (\S+) and (\S+) µm", text).groups()
    assert all(map(same, said, found))


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
    found = verdict.model_table(read_table(verdict.RESULT)).set_index(["worn by", "model"])
    quoted = re.search(
        r"coefficient of (\S+), and its best fair baseline reaches (\S+): "
        r".*? it is (\S+) against (\S+)\.",
        text,
    ).groups()
    models = [
        (worn, model)
        for worn in ("summits", "archard")
        for model in ("archard", "pressure_volume")
    ]
    assert all(
        same(value, found["mean MCC"][of]) for value, of in zip(quoted, models, strict=True)
    )


def test_many_patches():
    rows = pd.read_csv(scale.ROWS, index_col="quantity")
    shown = table("how-to/cluster.md", "## Hundreds of patches")
    assert [int(cells[0]) for cells in shown] == [int(patches) for patches in rows]
    for patches, steps, plan_s, plan_mb, *of_run in shown:
        found = rows[patches]
        assert same(steps, found.plan_jobs)
        assert same(plan_s, found.plan_cpu_s)
        assert same(plan_mb, found.plan_peak_mb)
        run = [f"run_{of}" for of in ("cpu_s", "cpu_s_per_patch", "wall_s", "largest_job_mb")]
        for cell, value in zip(of_run, found[run], strict=True):
            assert pd.isna(value) if cell == "–" else same(cell, value), (patches, cell)


def test_rates_on_random_numbers():
    found = chance.rates(read_table(chance.ROWS))
    text = " ".join((DOCS / "explanation/method.md").read_text().split())
    claims, held = found["claim", "mean"], found["held", "mean"]
    for said, value in (
        (r"test at 5 % claims a relation on (\S+) % of patches", claims["waves"]),
        (r"a relation in (\S+) % of cases with twelve", claims["neighbours"]),
        (r"of normal numbers in (\S+) % of cases", held["mean of 6"]),
    ):
        assert same(re.search(said, text)[1], value, 100)
