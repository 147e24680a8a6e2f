"""What `benchmarks/power.py` counts, and the specimens that it counts on."""

from dataclasses import replace

import numpy as np
import pandas as pd
import power
import pytest
import yaml
from power import OF_BARE, OF_INTERLAYER, main, p_values, rejection_rates
from runner import ROOT
from specimens import BY_RULE, WEARS, merged, specimen_config, specimen_studies

from gst.config.reading import config_problems
from gst.config.tables import columns_of
from gstlib.io.tables import read_table
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.specimen.stone import Stone
from gstlib.validation.summary import separated

TINY = ROOT / "config/tiny.yaml"
CONFIG = specimen_config(TINY)


def test_claims_are_counted_at_each_level():
    p = [0.05, 0.2, 0.9, np.nan]  # one is at a level, and one is no trial
    rows = pd.DataFrame({"p_value": p, "seed": range(4)})
    rates = rejection_rates(rows.assign(test="gain(f1)", drawn=np.nan, wear=""))
    rates = rates.set_index("level")
    assert rates.claims[[0.02, 0.05, 0.2]].to_list() == [0, 1, 2]
    assert set(rates["of"]) == {3}


def test_the_specimens_are_those_of_a_study_that_can_be_run():
    config = specimen_config(power.CONFIG)
    assert config_problems(config) == []
    assert config["interlayer"]["young_MPa"] < config["material"]["young_1_MPa"]


class Scored:
    """A study with ten patches, nine of which are in it."""

    number = np.arange(10)
    rising = number % 5.0  # also over the first four of the nine
    patches = pd.DataFrame({"patch": number.astype(str)})
    registration = patches.assign(
        loss_fraction=rising,
        mean_wear_depth_um=rising,
        above_noise=True,
        known_fraction=1.0,
    )
    selected = patches.assign(
        x_mm=1.0 * (number % 3),
        y_mm=1.0 * (number // 3),
        pressure_MPa=10.0 + number,
        in_study=number > 0,
    )

    def scored(self, *, seed, resamples):
        rows = [
            ("archard", "gain(mcc)", 0.1, 0.04),
            ("archard", "relative(map_error)", 1.2, 0.02),
            ("rigid", "mean(mcc)", 0.5, np.nan),
            ("", "spearman(pressure_MPa, loss_fraction)", 0.9, 0.001),
        ]
        columns = ["model", "statistic", "value", "p_value"]
        summary = separated(pd.DataFrame(rows, columns=columns))
        summary = summary.reindex(columns=columns_of("validation_summary")).assign(n=9)
        patches = self.patches.assign(contact_fraction=0.1, predicted_loss_um=0.1)
        return {"patches": patches, "summary": summary}


def test_a_difference_is_claimed_on_the_side_where_it_lies():
    table = p_values(Scored(), seed=[1, 5])
    alone = table[table.drawn.isna()].set_index("test").p_value
    expected = {
        "better: gain(mcc)": 0.02,
        "worse: gain(mcc)": 0.98,
        "better: relative(map_error)": 0.99,
        "worse: relative(map_error)": 0.01,
        "spearman(pressure_MPa, loss_fraction)": 0.001,
    }  # means are not tested
    assert alone.to_dict() == pytest.approx(expected)
    drawn = table.dropna(subset="drawn")
    assert set(drawn.drawn) == {4, 6, 8}  # never the one that is not in the study
    assert (drawn.patches == drawn.drawn).all()


@pytest.mark.parametrize("is_inferred", [False, True])
def test_the_later_studies_share_what_precedes_use_and_nothing_else(is_inferred):
    """The contact does not, where the wear says how the tool was used."""
    config = CONFIG if is_inferred else merged(CONFIG, {"use": None})
    row = {"patch": "a", "x_mm": 2.5, "y_mm": 2.5, "rotation_deg": 0.0, "t0": "a"}
    row |= {"t1": "b", "crop_x_mm": np.nan, "crop_y_mm": np.nan}
    stages = {}
    for wear, study in specimen_studies(config, pd.DataFrame([row]), 3):
        stages[wear] = {
            "change": study.changes["a"],
            "T0": study.prepared["a", "T0"],
            "T1": study.prepared["a", "T1"],
            "contact": study.contacts["a"],
            "pressures": study.pressures,
        }
    assert tuple(stages) == BY_RULE
    shared = {"T0"} if is_inferred else {"T0", "contact", "pressures"}
    first, *others = stages.values()
    for other in others:
        assert {stage for stage in first if other[stage] is first[stage]} == shared
        assert not any(other[stage].equals(first[stage]) for stage in ("change", "T1"))


def test_wear_without_relation_has_its_shape_and_does_not_follow_the_heights():
    parameters = SpecimenParameters(**CONFIG["specimen"])
    rows = []
    for seed in range(6):
        stone = Stone(replace(parameters, seed=seed), 5.0)
        depths = {name: WEARS[name](stone).astype(float) for name in BY_RULE}
        height = stone.detail.ravel()
        rows.append(
            {name: np.corrcoef(z.ravel(), height)[0, 1] for name, z in depths.items()}
        )
        moved, summits = (np.sort(depths[name], None) for name in ("random", "summits"))
        np.testing.assert_array_equal(moved, summits)
        worn = (depths["waves"] > 0).mean()
        assert worn == pytest.approx(parameters.wear_fraction, abs=1e-3)
    relation = pd.DataFrame(rows)
    unrelated = relation[["random", "waves"]]
    # on each stone, few and broad waves allow more
    assert (unrelated.mean().abs() < 3 * unrelated.sem()).all()
    assert relation.summits.min() > 3 * unrelated.abs().to_numpy().max()


@pytest.mark.slow
def test_two_specimens_from_their_making_to_the_rates(tmp_path, monkeypatch):
    """As small as that of the tiny study; one of them is studied with an interlayer, too."""
    sections = "patches", "specimen", "macroscale", "microscale"
    tiny = yaml.safe_load(TINY.read_text())
    changes = {name: tiny[name] for name in sections} | {"wear_steps": 2}
    small, rows = tmp_path / "small.yaml", tmp_path / "power.csv"
    small.write_text(yaml.safe_dump(changes))
    command = f"power.py --config {power.CONFIG} {small} --output {rows}"
    command += " --specimens 2 --interlayers 1"
    monkeypatch.setattr("sys.argv", command.split())
    main()
    table = read_table(rows)
    assert set(table.wear) == {*OF_BARE, *OF_INTERLAYER}
    assert table.groupby("test").seed.nunique()["tested_mean(mcc)"] == 2
    assert set(table.seed[table.test.str.endswith(power.WITH_INTERLAYER)]) == {2001}
