"""The scoring script, called as a function: its tables, and what they rest on."""

import importlib.util
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import read_table, write_table
from gstlib.surface import make_surface
from gstlib.validation.change import height_change

SCRIPT = Path(__file__).parents[2] / "workflow/scripts/score_patches.py"
PATCHES = ["1", "2", "3", "4", "5", "6", "7", "8"]
NAMES = "patches", "gains", "failures", "summary"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("score_patches", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def main(script):
    return script.main


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Patches whose summits wear in proportion to their pressure; 8 and 5 are the hardest."""
    folder = tmp_path_factory.mktemp("study")
    rng = np.random.default_rng(0)
    pressures = dict(zip(PATCHES, [8.0, 23, 12, 5, 71, 26, 11, 76], strict=True))
    for patch, pressure in pressures.items():
        t0 = make_surface(rng.normal(0, 1e-3, (30, 32)), 2e-3)
        touching = t0.values > np.quantile(t0.values, 1 - pressure / 400)
        fields = {
            "pressure": (("y", "x"), 1e3 * touching, "MPa"),
            "gap": (("y", "x"), 1e-3 * ~touching, "mm"),
            "displacement": ("step", [1e-3], "mm"),
        }
        contact = xr.Dataset(
            {"height": t0}
            | {
                name: (dims, values, {"units": units, "long_name": name})
                for name, (dims, values, units) in fields.items()
            }
        )
        t1 = t0 - 5e-3 * touching + rng.normal(0, 1e-5, t0.shape)
        write_dataset(folder / f"contact_{patch}.h5", contact, {})
        write_dataset(folder / f"registered_{patch}.h5", height_change(t0, t1), {})
    write_table(
        folder / "microscale.csv",
        pd.DataFrame(
            {
                "patch": PATCHES,
                "mean_pressure_MPa": pressures.values(),
                "stiffness_MPa_per_um": [2 * pressure for pressure in pressures.values()],
            }
        ),
    )
    return folder


def run(main, study, out, patches=PATCHES, worst=()):
    out.mkdir()
    main(
        {patch: study / f"contact_{patch}.h5" for patch in patches},
        {patch: study / f"registered_{patch}.h5" for patch in patches},
        study / "microscale.csv",
        *(out / f"{name}.csv" for name in NAMES),
        places={patch: [float(k % 3), float(k // 3)] for k, patch in enumerate(patches)},
        worst=worst,
        seed=1,
        resamples=199,
        shifts=999,
        most_noise=1.0,
        height_quantiles=[0.5, 0.9],
        gap_limits_um=[1.0],
        neighbourhood_um=6.0,
        curvature_length_um=4.0,
    )
    return {name: read_table(out / f"{name}.csv") for name in NAMES}


def test_tables_of_a_study(main, study, tmp_path):
    tables = run(main, study, tmp_path / "a", worst=["5", "8"])
    assert list(tables["patches"].patch) == PATCHES
    assert len(tables["gains"]) == 8 * len(PATCHES)
    assert len(tables["failures"]) == (3 + 3) * len(PATCHES)
    summary = tables["summary"].set_index("statistic")
    assert summary.loc["mean(mcc)", "p_value"] < 0.01
    assert summary.loc["spearman(pressure_MPa, loss_fraction)", "value"] > 0.7
    claim = summary.loc["expected_worst(5+8, loss_fraction)"]
    assert (claim.value, claim.n) == (1, 8)
    assert claim.p_value == pytest.approx(1 / 28, rel=1e-4)
    again = run(main, study, tmp_path / "b", worst=["5", "8"])
    for name in NAMES:
        pd.testing.assert_frame_equal(tables[name], again[name])


def test_a_patch_scores_the_same_whichever_others_are_there(main, study, tmp_path):
    every = run(main, study, tmp_path / "a")
    few = run(main, study, tmp_path / "b", patches=["2", "5"])
    for name in ("patches", "gains", "failures"):
        table = every[name]
        expected = table[table.patch.isin(["2", "5"])].reset_index(drop=True)
        pd.testing.assert_frame_equal(few[name], expected, check_dtype=False)


def test_nothing_is_said_of_a_claim_that_was_not_made(main, study, tmp_path):
    summary = run(main, study, tmp_path / "a", patches=["2"])["summary"]
    assert not summary.statistic.str.startswith("expected_worst").any()
    # one patch: scores, and no statistics over patches
    assert summary.low.isna().all()


def test_exchanged_epochs_are_asked_about(script, study, tmp_path, caplog):
    """T1 in place of T0: what was lost has risen."""
    for patch in ("5", "8"):
        (tmp_path / f"contact_{patch}.h5").symlink_to(study / f"contact_{patch}.h5")
        change = read_dataset(study / f"registered_{patch}.h5")
        swapped = change.assign(change=-change.change, loss=change.gain, gain=change.loss)
        write_dataset(tmp_path / f"registered_{patch}.h5", swapped, {})
    (tmp_path / "microscale.csv").symlink_to(study / "microscale.csv")
    run(script.main, tmp_path, tmp_path / "out", patches=["5", "8"])
    told = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert [message.split(":")[0] for message in told] == ["patch 5", "patch 8"]
    assert caplog.text.count("t0 and t1 exchanged") == 2
