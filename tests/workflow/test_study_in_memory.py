"""`gstlib.study.Study` on the tiny study's files: it agrees, and every setting counts."""

import numpy as np
import pytest
import yaml
from gst.patches import read_patches
from gst.sweep import merged, outcomes
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import read_scan
from gstlib.io.tables import read_table
from gstlib.study import Study


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


def test_its_pressures_are_the_stored_ones(own, finished_tiny):
    stored = read_table(finished_tiny.results / "tables/patch_pressures.csv")
    for name in ("pressure_MPa", "square_pressure_MPa"):
        np.testing.assert_allclose(own.selected()[name], stored[name], rtol=1e-4)
    assert list(own.selected().in_study) == list(stored.in_study)


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
