"""`gstlib.study.Study`, in memory and without Snakemake, gives what the workflow stores.

Both call the same stages; the workflow also passes every value through rules and scripts.
"""

import numpy as np
import pandas as pd
import pytest
import yaml
from gst.patches import read_patches
from gst.sweep import merged, outcomes
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import read_scan
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.study import Study, bound_pressures, score_patches


@pytest.fixture(scope="module")
def config(finished_tiny):
    folder = finished_tiny.folder / "config"
    return merged(*(yaml.safe_load((folder / f"{n}.yaml").read_text()) for n in ("config", "tiny")))


@pytest.fixture(scope="module")
def make_study(finished_tiny, config):
    results = finished_tiny.results
    patches = read_patches(
        finished_tiny.folder / config["patches"],
        size_mm=config["square"]["size_mm"],
        patch_size_mm=config["scans"]["size_mm"],
    )

    def make(config):
        return Study(
            config,
            patches,
            read_mesh=lambda: read_mesh(results / "specimen/mesh.stl", unit="mm"),
            read_scan=lambda *of: read_scan(results / "specimen/scans/{}_{}.plu".format(*of)),
            worn=list(patches.patch),
        )

    return make


@pytest.fixture(scope="module")
def anew(make_study, config):
    return make_study(config)


def test_every_stage_is_that_of_the_workflow(anew, finished_tiny):
    results = finished_tiny.results
    stored = read_dataset(results / "macroscale/surface.h5")
    np.testing.assert_array_equal(anew.surface().height, stored.height)
    composite = read_dataset(results / "macroscale/composite.h5")
    np.testing.assert_allclose(anew.composite().height, composite.height, atol=1e-9)
    np.testing.assert_allclose(anew.composite().slope_x, composite.slope_x, atol=1e-9)
    square = read_dataset(results / "macroscale/contact.h5").isel(step=-1)
    peak = float(square.pressure.max())
    np.testing.assert_allclose(anew.contact().pressure, square.pressure, atol=1e-6 * peak)
    selected = read_table(results / "tables/patch_pressures.csv")
    np.testing.assert_allclose(anew.selected().pressure_MPa, selected.pressure_MPa, rtol=1e-4)
    by_mesh = anew.selected().mesh_pressure_MPa
    np.testing.assert_allclose(by_mesh, selected.mesh_pressure_MPa, rtol=1e-4)
    assert list(anew.selected().in_study) == list(selected.in_study)
    for patch in selected.patch:
        for epoch in ("T0", "T1"):
            surface = read_dataset(results / f"surfaces/{patch}_{epoch}.h5")
            np.testing.assert_array_equal(anew.prepared(patch, epoch).height, surface.height)
        change = read_dataset(results / f"registered/{patch}.h5")
        np.testing.assert_allclose(anew.change(patch)["change"], change["change"], atol=1e-9)
        np.testing.assert_array_equal(anew.change(patch).loss, change.loss)
        for variant, folder in (("placed", "microscale"), ("levelled", "microscale/levelled")):
            stored = read_dataset(results / folder / f"{patch}.h5")
            found = anew.patch_contact(patch, variant)
            peak = max(float(stored.pressure.max()), 1.0)
            np.testing.assert_allclose(found.pressure, stored.pressure, atol=1e-3 * peak)
            displacement = float(np.ravel(stored.displacement)[-1])
            assert float(found.displacement) == pytest.approx(displacement, rel=1e-3, abs=1e-9)


def test_scores_are_those_of_the_workflow(anew, finished_tiny, config):
    tables = {
        name: read_table(finished_tiny.results / f"tables/validation_{name}.csv")
        for name in ("patches", "gains", "summary", "variants")
    }

    def contacts(folder):
        for patch in anew.scored():
            yield (
                patch,
                read_dataset(finished_tiny.results / f"{folder}/{patch}.h5"),
                read_dataset(finished_tiny.results / f"registered/{patch}.h5"),
            )

    stored = score_patches(
        {"placed": contacts("microscale"), "levelled": contacts("microscale/levelled")},
        anew.selected(),
        read_table(finished_tiny.results / "tables/microscale_summary.csv"),
        worst=[],
        seed=config["seed"],
        **{k: v for k, v in config["validation"].items() if k != "expected_worst"},
    )
    for name, table in tables.items():
        found = stored[name]
        assert list(found.columns) == list(table.columns), name
        for column in table.select_dtypes("number"):
            np.testing.assert_allclose(
                pd.to_numeric(found[column], errors="coerce"),  # text may be empty throughout
                table[column],
                rtol=2e-4,
                atol=1e-9,
                err_msg=column,
            )


def test_intervals_are_those_of_the_workflow(finished_tiny, config):
    results = finished_tiny.results
    surface = read_dataset(results / "macroscale/surface.h5")
    pressures = read_table(results / "coupling/pressures.csv")
    intervals = bound_pressures(
        surface,
        read_dataset(results / "macroscale/composite.h5"),
        pressures,
        material=config["material"],
        uncertainty=config["uncertainty"],
        patch_mm=config["scans"]["size_mm"],
        seed=config["seed"],
        contact_modulus_MPa=config["material"]["contact_modulus_MPa"],
        target_pressure_MPa=config["macroscale"]["target_pressure_MPa"],
    )
    stored = read_table(results / "tables/patch_intervals.csv")
    for column in stored.select_dtypes("number"):
        np.testing.assert_allclose(intervals[column], stored[column], rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "moved"),
    [
        ({"material": {"contact_modulus_MPa": None}}, "mean(f1)"),
        ({"macroscale": {"grid": 30}}, "pressure_MPa"),
        ({"coupling": "levelled"}, "pressure_MPa"),
        ({"microscale": {"s_filter_um": 50.0}}, "mean(f1)"),
        ({"preprocessing": {"outlier_rule": "window"}}, "mean(f1)"),
        ({"traces": {"minimum_points": 6}}, "mean(f1)"),
        ({"texture": {"l_filter_um": 150.0}}, "mean_change(Sq_um)"),
    ],
)
def test_a_changed_value_moves_the_outcomes(anew, make_study, config, changes, moved):
    before, after = outcomes(anew), outcomes(make_study(merged(config, changes)))
    one, other = (t.result[t.output == moved].to_numpy() for t in (before, after))
    assert not np.allclose(one, other, rtol=1e-4)
