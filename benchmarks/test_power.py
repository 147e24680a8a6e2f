"""Claims on made-up patches; their rates, exact where known, and honest about clustered trials."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from contacts import contact_of
from hypothesis import given, settings
from hypothesis import strategies as st
from power import CONFIG as OF_SPECIMENS
from power import (
    LEVELS,
    law_p_values,
    main,
    p_values,
    rejection_rates,
    specimen_config,
    specimen_p_values,
    specimen_studies,
)
from scipy.stats import binomtest

from gst.config import config_problems
from gst.sweep import merged
from gstlib.io.tables import read_table
from gstlib.specimen.randomness import smooth_field
from gstlib.specimen.stone import WEAR_LAWS, WEAR_PLACEMENTS
from gstlib.study import Study
from gstlib.surface import make_surface
from gstlib.validation.change import height_change

FOLDER, SEED = Path(__file__).parents[1] / "config", [1, 5]
DEFAULT, TINY = (yaml.safe_load((FOLDER / f"{n}.yaml").read_text()) for n in ("config", "tiny"))
CONFIG = merged(merged(DEFAULT, TINY), {"validation": {"shifts": 199}})


def rates_of(by_specimen):
    """Rates by level, for lists of the p-values of each specimen."""
    rows = [(seed, p) for seed, values in enumerate(by_specimen) for p in values]
    table = pd.DataFrame(rows, columns=["seed", "p_value"]).assign(
        test="f1", drawn=np.nan, wear=""
    )
    return rejection_rates(table).set_index("level")


def test_one_trial_a_specimen_is_counted_as_it_is():
    drawn = np.append(np.random.default_rng(1).random(39), 0.05)  # at a level: a claim
    rates = rates_of([*drawn[:, None], [np.nan]])  # a missing p-value is no trial
    assert list(rates.index) == list(LEVELS)
    for level, row in rates.iterrows():
        claims = int((drawn <= level).sum())
        exact = binomtest(claims, 40).proportion_ci(method="exact")
        assert (row.claims, row.of, row.specimens, row.rate) == (claims, 40, 40, claims / 40)
        assert (row.low, row.high) == pytest.approx((exact.low, exact.high), abs=1e-9)


def test_trials_that_repeat_each_other_count_once_and_independent_ones_each():
    """Ten patches of a specimen with one p-value tell no more than one patch would."""
    drawn = np.random.default_rng(2).random((30, 1))
    once, tenfold = (rates_of(np.repeat(drawn, times, axis=1)).loc[0.3] for times in (1, 10))
    assert tenfold.rate == once.rate
    assert tenfold[["low", "high"]].to_list() == pytest.approx([once.low, once.high], abs=0.01)
    row = rates_of(np.random.default_rng(3).random((200, 10))).loc[0.3]
    exact = binomtest(int(row.claims), 2000).proportion_ci(method="exact")
    assert row.high - row.low == pytest.approx(exact.high - exact.low, rel=0.1)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.lists(st.floats(0, 1), min_size=1, max_size=6), min_size=1, max_size=12))
def test_rates_grow_with_the_level_and_lie_in_their_intervals(by_specimen):
    rates = rates_of(by_specimen)
    assert (rates.rate.diff().dropna() >= 0).all()
    ordered = rates.assign(zero=0, one=1)[["zero", "low", "rate", "high", "one"]]
    assert (np.diff(ordered.to_numpy(float), axis=1) >= -1e-12).all()


def claims(wear="summits", moved=()):
    """Tests on nine patches; pressure, contact and loss grow together, at random they do not."""
    names = [str(number) for number in range(9)]
    places = pd.DataFrame({"patch": names, "x_mm": np.tile([0.0, 1, 2], 3), "in_study": True})
    places = places.assign(y_mm=np.repeat([0.0, 1, 2], 3), pressure_MPa=10.0 + np.arange(9))
    made: dict = {("selected",): places}
    for number, name in enumerate(names):
        rng = np.random.default_rng(number)
        height = make_surface(smooth_field(rng, 48, 0.01, 0.05).astype(float) * 1e-3, 0.01)
        depth = height - np.quantile(height, 0.95 - 0.01 * number)
        fields = {"height": height, "pressure": depth.clip(0) * 1e6, "gap": (-depth).clip(0)}
        fields |= {field: fields[field].roll(y=9, x=12, roll_coords=False) for field in moved}
        more = number if wear == "summits" else (7 * number + 3) % 9
        lost = height.values > np.quantile(height, 0.9 - 0.01 * more)
        if wear == "random":
            lost = np.roll(lost, (19, 23), (0, 1))
        change = height_change(height, height - 1e-3 * lost + rng.normal(0, 1e-5, height.shape))
        contact = contact_of(**fields, displacement=float(depth.max()))
        made |= {("patch_contact", name): contact, ("change", name): change}
    return p_values_of(places, made)


def p_values_of(places, made):
    study = Study(CONFIG, places.assign(t1="t1"), read_mesh=None, read_scan=None, kept=made)
    return p_values(study, seed=SEED)


def test_a_relation_is_found_and_no_other(monkeypatch):
    tests, patches = claims()
    elsewhere, _ = claims("random")
    assert len(patches) == 9
    for test in ("f1", "roc_auc", "mean(f1)", "spearman(pressure_MPa, loss_fraction)"):
        there, other = (
            t.p_value[(t.test == test) & t.drawn.isna()] for t in (tests, elsewhere)
        )
        assert there.max() <= 0.005 < other.min(), test
    drawn = tests.dropna(subset="drawn")
    assert set(drawn.drawn) == {4, 6, 8}
    assert (drawn.patches == drawn.drawn).all()
    monkeypatch.setattr("power.spatial_p_value", lambda *given, permuted: given)
    given = claims()[0].p_value[tests.test.str.endswith("for")].iloc[0]
    columns = ["pressure_MPa", "loss_fraction", "x_mm", "y_mm"]
    counted = patches.loc[patches.believed, columns]
    assert len(counted) == 8  # the loss of one is noise as likely as not
    np.testing.assert_array_equal(np.column_stack(given), counted)


@pytest.mark.parametrize(
    ("moved", "claimed"), [(["pressure", "gap"], False), (["height"], True)]
)
def test_a_gain_is_claimed_only_where_contact_is_better(moved, claimed):
    """Contact laid elsewhere is worse than the highest points; rivals elsewhere are worse."""
    tests, _ = claims(moved=moved)
    gain = tests.p_value[tests.test == "gain(f1)"].item()
    assert gain < 0.01 if claimed else gain > 0.99


def test_a_law_is_claimed_where_it_errs_less_than_every_rival():
    """One-sided, and the largest of the p-values against the rivals."""
    columns = ["model", "statistic", "value", "p_value", "n", "against"]
    rows = [
        ("archard", "skill(map)", 0.3, 0.02, 9, "pressure"),
        ("archard", "skill(map)", 0.1, 0.08, 9, "uniform"),
        ("archard", "skill(volume)", -0.3, 0.02, 9, "pressure"),
        ("mat", "skill(map)", 0.4, 0.01, 9, "pressure"),
        (
            "mat",
            "skill(map)",
            0.2,
            np.nan,
            9,
            "archard",
        ),  # no test: it may fit as well by chance
        ("mat", "skill(out_of_contact)", -0.1, 0.20, 9, "archard"),
    ]

    class Worn:
        def wear(self, **chance):
            return None, None, pd.DataFrame(rows, columns=columns)

    found = law_p_values(Worn(), seed=1).set_index("test")
    assert found.p_value.to_dict() == pytest.approx({"law(archard)": 0.04, "law(mat)": 0.9})
    assert found.patches.tolist() == [9, 9]


def test_a_specimen_without_patches_claims_nothing():
    places = pd.DataFrame(columns=["patch", "x_mm", "y_mm", "pressure_MPa"])
    places = places.assign(in_study=np.array([], bool))
    assert all(table.empty for table in p_values_of(places, {("selected",): places}))


def test_the_later_studies_share_what_precedes_use_and_nothing_else():
    row = {"patch": ["a"], "x_mm": 2.5, "y_mm": 2.5, "rotation_deg": 0.0, "t0": "a", "t1": "b"}
    patches = pd.DataFrame(row | {"crop_x_mm": np.nan, "crop_y_mm": np.nan})
    found = {}
    for wear, study in specimen_studies(CONFIG, patches, 3):
        assert ("worn_square",) not in study.kept
        study.kept["worn_square",] = wear  # as if it had been asked for
        stages = {"change": study.change("a"), "T0": study.prepared("a", "T0")}
        stages |= {"T1": study.prepared("a", "T1"), "contact": study.patch_contact("a")}
        found[wear] = stages | {"square": study.contact(), "places": study.pressures()}
        found[wear]["selected"] = study.selected()
    assert tuple(found) == WEAR_PLACEMENTS
    summits = found.pop("summits")
    for other in found.values():
        shared = {stage for stage in summits if other[stage] is summits[stage]}
        assert shared == {"T0", "contact", "square", "places"}
        assert not any(other[stage].equals(summits[stage]) for stage in ("change", "T1"))


def test_the_specimens_are_those_of_a_study_that_can_be_run():
    config = specimen_config(OF_SPECIMENS)
    assert config_problems(config) == []
    assert config["mat"]["young_MPa"] < config["material"]["young_1_MPa"]
    coarse, fine = (of["specimen"]["scan_points"] for of in (config, DEFAULT))
    assert coarse < fine


@pytest.mark.parametrize("laws", [False, True])
def test_laws_are_asked_only_of_the_specimens_that_wear_by_them(monkeypatch, laws):
    row = pd.DataFrame({"drawn": [np.nan], "p_value": 0.5})
    monkeypatch.setattr("power.specimen_studies", lambda *of: ((wear, None) for wear in of[-1]))
    monkeypatch.setattr("power.p_values", lambda *_, seed: (row.assign(test=str(seed)), None))
    monkeypatch.setattr("power.law_p_values", lambda *_, seed: row.assign(test="law"))
    table = specimen_p_values({"seed": 1}, row, 2005, laws=laws)
    found = table.groupby("test").wear.agg(set).to_dict()
    asked = {"law": {*WEAR_PLACEMENTS, *WEAR_LAWS}} if laws else {}
    assert found == {"[1, 2005]": set(WEAR_PLACEMENTS)} | asked
    assert set(table.seed) == {2005}
    assert len(rejection_rates(table)) == len(LEVELS) * len(table)


@pytest.mark.slow
def test_two_specimens_from_their_making_to_the_rates(tmp_path):
    """As small as that of the tiny study; one of them wears by laws, too."""
    tiny = yaml.safe_load((FOLDER / "tiny.yaml").read_text())
    sections = {
        name: tiny[name] for name in ("patches", "specimen", "macroscale", "microscale")
    }
    small, rates = tmp_path / "small.yaml", tmp_path / "power.csv"
    small.write_text(yaml.safe_dump(sections | {"wear_steps": 2}))
    config = ["--config", str(OF_SPECIMENS), str(small)]
    main([*config, "--specimens", "2", "--laws", "1", "--output", str(rates)])
    found = read_table(rates)
    laws = {"law(archard)", "law(mat)"}
    assert set(found.wear) == {*WEAR_PLACEMENTS, *WEAR_LAWS}
    assert set(found.test[found.wear.isin(WEAR_LAWS)]) == laws
    assert set(found.specimens[found.test.isin(laws)]) == {1}
    assert set(found.specimens[found.test == "f1"]) == {2}
    assert found[["rate", "low", "high"]].stack().between(0, 1).all()
