"""What `benchmarks/power.py` counts, and the specimens that it counts on."""

from dataclasses import replace

import numpy as np
import pandas as pd
import power
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from power import LEVELS, OF_BARE, OF_INTERLAYER, main, p_values, rejection_rates
from runner import ROOT
from scipy.stats import binomtest
from specimens import BY_RULE, WEARS, merged, specimen_config, specimen_studies

from gst.config.reading import config_problems
from gst.config.tables import columns_of
from gstlib.io.tables import read_table
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.specimen.stone import Stone
from gstlib.validation.summary import separated

DEFAULT, TINY = (
    yaml.safe_load((ROOT / f"config/{name}.yaml").read_text()) for name in ("config", "tiny")
)
CONFIG = merged(DEFAULT, TINY)


def rates_of(by_specimen):
    """Rates by level, for lists of the p-values of each specimen."""
    rows = [(seed, p) for seed, values in enumerate(by_specimen) for p in values]
    table = pd.DataFrame(rows, columns=["seed", "p_value"])
    return rejection_rates(table.assign(test="f1", drawn=np.nan, wear="")).set_index("level")


def exact_interval(claims, trials):
    return binomtest(int(claims), trials).proportion_ci(method="exact")


def test_one_trial_a_specimen_is_counted_as_it_is():
    drawn = np.append(np.random.default_rng(1).random(39), 0.05)  # at a level: a claim
    rates = rates_of([*drawn[:, None], [np.nan]])  # a missing p-value is no trial
    assert list(rates.index) == list(LEVELS)
    for level, row in rates.iterrows():
        claims = int((drawn <= level).sum())
        assert (row.claims, row.of, row.specimens, row.rate) == (claims, 40, 40, claims / 40)
        assert (row.low, row.high) == pytest.approx(exact_interval(claims, 40), abs=1e-9)


def test_trials_that_repeat_each_other_count_once_and_independent_ones_each():
    """Ten patches of a specimen with one p-value tell no more than one patch would."""
    drawn = np.random.default_rng(2).random((30, 1))
    once, tenfold = (rates_of(np.repeat(drawn, times, axis=1)).loc[0.3] for times in (1, 10))
    assert tenfold.rate == once.rate
    assert tenfold[["low", "high"]].to_list() == pytest.approx([once.low, once.high], abs=0.01)
    row = rates_of(np.random.default_rng(3).random((200, 10))).loc[0.3]
    assert row.high - row.low == pytest.approx(
        np.ptp(exact_interval(row.claims, 2000)), rel=0.1
    )


@settings(max_examples=25, deadline=None)
@given(st.lists(st.lists(st.floats(0, 1), min_size=1, max_size=6), min_size=1, max_size=12))
def test_rates_grow_with_the_level_and_lie_in_their_intervals(by_specimen):
    rates = rates_of(by_specimen)
    assert (rates.rate.diff().dropna() >= 0).all()
    ordered = rates.assign(zero=0, one=1)[["zero", "low", "rate", "high", "one"]]
    assert (np.diff(ordered.to_numpy(float), axis=1) >= -1e-12).all()


class Scored:
    """A study with ten patches, nine of which are in it, and with these values and p-values."""

    def __init__(self, **values):
        rows = [("archard", name, value, p, 9) for name, (value, p) in values.items()]
        rows.append(("rigid", "mean(mcc)", 0.5, np.nan, 9))
        rows.append(("", "spearman(pressure_MPa, loss_fraction)", 0.9, 0.001, 9))
        names = ["model", "statistic", "value", "p_value", "n"]
        summary = pd.DataFrame(rows, columns=names)
        self.summary = separated(summary).reindex(columns=columns_of("validation_summary"))
        number, rising = (
            np.arange(10),
            np.arange(10.0) % 5,
        )  # also over the first four of the nine
        lost = {"loss_fraction": rising, "mean_wear_depth_um": rising}
        self.registration = self.table(**lost, above_noise=True, known_fraction=1.0)
        places = {"x_mm": 1.0 * (number % 3), "y_mm": 1.0 * (number // 3)}
        self.selected = self.table(**places, pressure_MPa=10.0 + number, in_study=number > 0)

    def table(self, **columns):
        return pd.DataFrame({"patch": [str(number) for number in range(10)]} | columns)

    def scored(self, *, seed, resamples):
        patches = self.table(contact_fraction=0.1, predicted_loss_um=0.1)
        return {"patches": patches, "summary": self.summary}


def test_a_difference_is_claimed_on_the_side_where_it_lies():
    study = Scored(**{"gain(mcc)": (0.1, 0.04), "relative(map_error)": (1.2, 0.02)})
    table = p_values(study, seed=[1, 5])
    expected = {
        "better: gain(mcc)": 0.02,
        "worse: gain(mcc)": 0.98,
        "better: relative(map_error)": 0.99,
        "worse: relative(map_error)": 0.01,
        "spearman(pressure_MPa, loss_fraction)": 0.001,
    }  # means are not tested
    alone = table[table.drawn.isna()].set_index("test").p_value
    assert alone.to_dict() == pytest.approx(expected)
    drawn = table.dropna(subset="drawn")
    assert set(drawn.drawn) == {4, 6, 8}  # never the one that is not in the study
    assert (drawn.patches == drawn.drawn).all()
    of_four = [
        p_values(study, seed=[1, seed]).query("drawn == 4").p_value.item() for seed in range(4)
    ]
    assert np.ptp(of_four) > 0.2  # other patches each time


@pytest.mark.parametrize("inferred", [False, True])
def test_the_later_studies_share_what_precedes_use_and_nothing_else(inferred):
    """The contact does not, where the wear says how the tool was used."""
    config = CONFIG if inferred else merged(CONFIG, {"use": None})
    row = {"patch": ["a"], "x_mm": 2.5, "y_mm": 2.5, "rotation_deg": 0.0, "t0": "a", "t1": "b"}
    patches = pd.DataFrame(row | {"crop_x_mm": np.nan, "crop_y_mm": np.nan})
    stages = {}
    for wear, study in specimen_studies(config, patches, 3):
        assert "worn_square" not in vars(study)
        study.worn_square = wear  # as if it had been asked for
        of_wear = {"change": study.changes["a"], "T0": study.prepared["a", "T0"]}
        of_wear |= {"T1": study.prepared["a", "T1"], "contact": study.contacts["a"]}
        of_wear |= {"square": study.contact, "places": study.pressures}
        stages[wear] = of_wear | {"selected": study.selected}
    assert tuple(stages) == BY_RULE
    summits = stages.pop("summits")
    for other in stages.values():
        shared = {stage for stage in summits if other[stage] is summits[stage]}
        assert shared == {"T0"} | (set() if inferred else {"contact", "square", "places"})
        assert not any(other[stage].equals(summits[stage]) for stage in ("change", "T1"))


def test_the_specimens_are_those_of_a_study_that_can_be_run():
    config = specimen_config(power.CONFIG)
    assert config_problems(config) == []
    assert config["interlayer"]["young_MPa"] < config["material"]["young_1_MPa"]


@pytest.mark.parametrize(("interlayer", "wears"), [(False, OF_BARE), (True, OF_INTERLAYER)])
def test_an_interlayer_is_asked_for_only_where_it_is_said(monkeypatch, interlayer, wears):
    rows = pd.DataFrame({"drawn": [np.nan], "p_value": 0.5, "test": "mcc"})
    asked = []

    class Study:
        use = None

    def studies(config, patches, seed, wears):
        asked.append(config["interlayer"])
        return [(wear, Study) for wear in wears]

    monkeypatch.setattr(power, "specimen_studies", studies)
    monkeypatch.setattr(power, "p_values", lambda study, seed: rows)
    config = {"seed": 1, "interlayer": "soft"}
    table = power.specimen_p_values(config, rows, 2005, interlayer)
    assert asked == ["soft" if interlayer else None]
    assert list(table.wear) == list(wears)
    assert set(table.test) == {"mcc, with an interlayer" if interlayer else "mcc"}
    assert set(table.seed) == {2005}
    some = power.specimen_p_values(config, rows, 2005, interlayer, wears=["summits"])
    assert set(some.wear) == {"summits"}


def test_wear_without_relation_has_its_shape_and_does_not_follow_the_heights():
    parameters = SpecimenParameters(**CONFIG["specimen"])
    relation = {placement: [] for placement in BY_RULE}
    for seed in range(6):
        stone = Stone(replace(parameters, seed=seed), 5.0)
        depths = {name: WEARS[name](stone).astype(float) for name in relation}
        for placement, depth in depths.items():
            relation[placement].append(np.corrcoef(depth.ravel(), stone.detail.ravel())[0, 1])
        # the modulus of the spectrum is that of all shifts, and of hardly anything else
        spectra = {
            name: np.abs(np.fft.rfft2(depth - depth.mean())) for name, depth in depths.items()
        }
        atol = 1e-9 * spectra["summits"].max()
        np.testing.assert_allclose(spectra["random"], spectra["summits"], atol=atol)
        # up to four cycles over the square: waves longer than a patch
        long = {name: (of[:5, :5] ** 2).sum() / (of**2).sum() for name, of in spectra.items()}
        assert long["waves"] > 1.5 * long["summits"]
        assert (depths["waves"] > 0).mean() == pytest.approx(parameters.wear_fraction, abs=1e-3)
    for placement in ("random", "waves"):
        mean, spread = np.mean(relation[placement]), np.std(relation[placement], ddof=1)
        assert abs(mean) < 3 * spread / np.sqrt(6)  # on each, few and broad waves allow more
        assert min(relation["summits"]) > 3 * np.abs(relation[placement]).max()


@pytest.mark.slow
def test_two_specimens_from_their_making_to_the_rates(tmp_path, capsys):
    """As small as that of the tiny study; one of them is studied with an interlayer, too."""
    sections = {
        name: TINY[name] for name in ("patches", "specimen", "macroscale", "microscale")
    }
    small, rows = tmp_path / "small.yaml", tmp_path / "power.csv"
    small.write_text(yaml.safe_dump(sections | {"wear_steps": 2}))
    config = ["--config", str(power.CONFIG), str(small), "--output", str(rows)]
    main([*config, "--specimens", "2", "--interlayers", "1"])
    table = read_table(rows)
    assert set(table.wear) == {*OF_BARE, *OF_INTERLAYER}
    assert table.groupby("test").seed.nunique()["tested_mean(mcc)"] == 2
    assert set(table.seed[table.test.str.endswith(power.WITH_INTERLAYER)]) == {2001}
    assert table.p_value.dropna().between(0, 1).all()
    printed = capsys.readouterr().out
    main([*config, "--tables"])
    assert capsys.readouterr().out in printed
