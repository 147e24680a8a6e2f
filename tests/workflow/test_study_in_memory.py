"""`gstlib.study.Study` on the tiny study's files: it agrees, and every setting counts."""

import numpy as np
import pandas as pd
import pytest
import yaml
from gst.patches import read_patches
from gst.sweep import merged, outcomes
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import read_scan
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_pressures, read_table, write_table
from gstlib.study import Study
from gstlib.uncertainty import Errors, Macroscale, pressure_intervals

BEFORE_PRESSURES = {"face", "composite", "contact", "prepared", "change"}


@pytest.fixture(scope="module")
def config(finished_tiny):
    folder = finished_tiny.folder / "config"
    return merged(*(yaml.safe_load((folder / f"{n}.yaml").read_text()) for n in ("config", "tiny")))


@pytest.fixture(scope="module")
def study_of(finished_tiny, config):
    files = finished_tiny.results / "specimen"
    patches = read_patches(
        finished_tiny.folder / config["patches"],
        size_mm=config["square"]["size_mm"],
        patch_size_mm=config["scans"]["size_mm"],
    )

    def study_of(config):
        return Study(
            config,
            patches,
            read_mesh=lambda: read_mesh(files / "mesh.stl", unit="mm"),
            read_scan=lambda *of: read_scan(files / "scans/{}_{}.plu".format(*of)),
        )

    return study_of


@pytest.fixture(scope="module")
def own(study_of, config):
    return study_of(config)


@pytest.fixture(scope="module")
def stored(finished_tiny):
    return lambda name: read_table(finished_tiny.results / f"tables/{name}.csv")


def same(found, table, file):
    """As they are written."""
    write_table(file, found)
    pd.testing.assert_frame_equal(read_table(file), table, rtol=1e-4, atol=1e-9)


def test_its_tables_are_the_stored_ones(own, study_of, finished_tiny, config, stored, tmp_path):
    """Files, rules and scripts pass on what the config says, and nothing else."""
    same(own.selected(), stored("patch_pressures"), tmp_path / "selected.csv")
    same(own.registration(), stored("registration"), tmp_path / "registration.csv")
    again = study_of(config)
    again.kept |= {key: of for key, of in own.kept.items() if key[0] in BEFORE_PRESSURES}
    # with the digits that files have: one of the last may turn a point of a mask
    again.kept["pressures",] = read_pressures(finished_tiny.results / "coupling/pressures.csv")
    again.kept["registration",] = stored("registration")
    judged = again.judged(seed=config["seed"], resamples=config["validation"]["resamples"])
    found = {"wear": judged["wear"], "wear_profile": judged["profile"]}
    found |= {f"validation_{name}": judged[name] for name in ("patches", "summary")}
    for name, table in found.items():
        same(table, stored(name), tmp_path / f"{name}.csv")


def test_the_intervals_are_those_of_the_errors_that_the_config_states(
    finished_tiny, config, stored, tmp_path
):
    face, composite = (
        read_dataset(finished_tiny.results / f"macroscale/{name}.h5")
        for name in ("surface", "composite")
    )
    found = pressure_intervals(
        Macroscale(face, composite, None),
        read_pressures(finished_tiny.results / "coupling/pressures.csv"),
        errors=Errors(**config["uncertainty"]),
        force_N=config["load"]["force_N"],
        through=(2.5, 2.5),
        material=config["material"],
        patch_mm=config["scans"]["size_mm"],
        seed=config["seed"],
    )
    same(found, stored("patch_intervals"), tmp_path / "intervals.csv")


@pytest.mark.parametrize(
    ("changes", "moved"),
    [
        ({"material": {"contact_modulus_MPa": None}}, "mean(mcc)"),
        ({"macroscale": {"grid": 30}}, "pressure_MPa"),
        ({"coupling": "levelled"}, "pressure_MPa"),
        ({"microscale": {"s_filter_um": 50.0}}, "mean(mcc)"),
        ({"preprocessing": {"outlier_rule": "window"}}, "mean(mcc)"),
        ({"traces": {"minimum_points": 6}}, "mean(mcc)"),
        ({"texture": {"l_filter_um": 150.0}}, "mean_change(Sq_um)"),
    ],
)
def test_a_changed_value_moves_the_outcomes(own, study_of, config, changes, moved):
    before, after = outcomes(own), outcomes(study_of(merged(config, changes)))
    one, other = (t.result[t.output == moved].to_numpy() for t in (before, after))
    assert not np.allclose(one, other, rtol=1e-4)


def test_a_setting_of_a_sweep_is_the_study_with_that_config(tiny, own, study_of, config):
    change = {"load": {"force_N": 660.0}}
    tiny.change(sweep={"force": [change]})
    tiny.succeed("sweep")
    table = read_table(tiny.results / "tables/sweep.csv")
    swept = table[table.output == "pressure_MPa"]
    for study, is_it in (
        (own, swept.factor.isna()),
        (study_of(merged(config, change)), swept.factor == "force"),
    ):
        expected = study.pressures().pressure_MPa
        np.testing.assert_allclose(swept.result[is_it], expected, rtol=1e-4, atol=1e-9)
    moved = set(table.output[table.change.abs() > 1e-9])
    assert {"pressure_MPa", "mean(mcc)"} <= moved
    assert (tiny.results / "figures/sweep.png").stat().st_size > 0
