"""`make sweep`: a setting gives what the study gives with that config."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest
import yaml
from conftest import ROOT

from gstlib.io.tables import read_table
from gstlib.sweep.factors import merged
from gstlib.sweep.outcomes import StoredStudy, outcomes

SWEEP = {
    "placement along x": [{"placement": {"shift_x_um": 30.0}}],
    "size of traces": [{"traces": {"minimum_points": 6}}],
}


def stored(study, patches):
    """What a finished study has stored."""
    results = study.results
    ids = list(patches)

    def files(pattern, *folder):
        return {patch: results.joinpath(*folder, pattern.format(patch)) for patch in ids}

    contacts = {
        patch: file for patch, file in files("{}.h5", "microscale").items() if file.exists()
    }
    return StoredStudy(
        mesh=results / "specimen/mesh.stl",
        mesh_unit="mm",
        surface=results / "macroscale/surface.h5",
        contact=results / "macroscale/contact.h5",
        pressures=results / "tables/patch_pressures.csv",
        texture=results / "tables/texture.csv",
        crops=dict.fromkeys(ids),
        t0_scans=files("{}_T0.plu", "specimen/scans"),
        t1_scans=files("{}_T1.plu", "specimen/scans"),
        t0=files("{}_T0.h5", "surfaces"),
        t1=files("{}_T1.h5", "surfaces"),
        registered=files("{}.h5", "registered"),
        contacts=contacts,
        counterface_scan=None,
        counterface=None,
    )


def config_of(study):
    return json.loads((study.results / "provenance.json").read_text())["config"]


def test_computed_anew_or_read_the_outcomes_are_the_study_s(finished_tiny):
    config = config_of(finished_tiny)
    pressures = read_table(finished_tiny.results / "tables/patch_pressures.csv")
    study = stored(finished_tiny, pressures.patch)
    read = outcomes(study, config, config)
    anew = outcomes(study, {}, config)  # compared with no config, everything is changed
    assert list(anew.output) == list(read.output)
    np.testing.assert_allclose(anew.result, read.result, rtol=1e-4, atol=1e-9)

    found = read.set_index("output").result
    np.testing.assert_allclose(found["pressure_MPa"], pressures.pressure_MPa)
    assert found["studied"] == pressures.in_study.sum()
    summary = read_table(finished_tiny.results / "tables/validation_summary.csv")
    known = summary.set_index("statistic").value
    for output in ("gain(f1)", "gain(roc_auc)", "mean(f1)", "mean(fss)"):
        assert found[output] == pytest.approx(known[output], rel=1e-4), output
    pair = "spearman(pressure_MPa, loss_fraction)"
    assert found[pair] == pytest.approx(known[pair])
    texture = read_table(finished_tiny.results / "tables/texture.csv")
    changes = texture.Sq_um[texture.epoch == "change"]
    assert found["mean_change(Sq_um)"] == pytest.approx(changes.mean())


@pytest.mark.parametrize(
    ("changes", "moved"),
    [
        ({"material": {"contact_modulus_MPa": None}}, "pressure_MPa"),
        ({"macroscale": {"grid": 30}}, "pressure_MPa"),
        ({"placement": {"shift_y_um": -40.0}}, "pressure_MPa"),
        ({"preprocessing": {"outlier_rule": "window"}}, "mean(f1)"),
        ({"traces": {"minimum_points": 6}}, "mean(f1)"),
        ({"texture": {"l_filter_um": 150.0}}, "mean_change(Sq_um)"),
    ],
)
def test_what_is_not_computed_anew_does_not_depend_on_the_change(finished_tiny, changes, moved):
    config = config_of(finished_tiny)
    changed = merged(config, changes)
    pressures = read_table(finished_tiny.results / "tables/patch_pressures.csv")
    study = stored(finished_tiny, pressures.patch)
    partly, anew = (outcomes(study, base, changed) for base in (config, {}))
    np.testing.assert_allclose(partly.result, anew.result, rtol=1e-4, atol=1e-9)
    of_study = outcomes(study, config, config)
    one, other = (t.result[t.output == moved].to_numpy() for t in (partly, of_study))
    assert not np.allclose(one, other, rtol=1e-3)


def test_a_setting_is_the_study_with_that_config(tiny):
    tiny.change(sweep=SWEEP)
    assert tiny.planned().isdisjoint({"try_setting", "tabulate_sweep", "plot_sweep"})
    result = tiny.run("sweep")
    assert result.returncode == 0, result.stderr
    table = read_table(tiny.results / "tables/sweep.csv")
    assert (tiny.results / "figures/sweep.png").stat().st_size > 0
    assert set(table.factor.dropna()) == set(SWEEP)
    moved = table[table.change != 0].groupby("factor").output.unique()
    assert "pressure_MPa" in moved["placement along x"]
    assert "pressure_MPa" not in moved["size of traces"]
    assert "mean(f1)" in moved["size of traces"]

    swept = table[(table.factor == "placement along x") & (table.output == "pressure_MPa")]
    tiny.change(placement={"shift_x_um": 30.0})
    pressures = "results-tiny/tables/patch_pressures.csv"
    sensitivity = "results-tiny/tables/sensitivity.csv"
    result = tiny.run(pressures, sensitivity)
    assert result.returncode == 0, result.stderr
    study = read_table(tiny.folder / pressures)
    assert (study.place == "shifted").all()
    np.testing.assert_allclose(swept.result, study.pressure_MPa)
    # beside the other contact modulus, patches lie where they lie in the study
    beside = read_table(tiny.folder / sensitivity)
    beside = beside[(beside.contact_modulus == "used") & (beside.quantity == "patch pressure")]
    np.testing.assert_allclose(beside.value, study.pressure_MPa, rtol=1e-4)


def test_the_shipped_sweep_is_planned(study):
    study.config = "config/sweep.yaml"
    result = study.run("sweep", "--dry-run")
    assert result.returncode == 0, result.stderr
    settings = yaml.safe_load((study.folder / study.config).read_text())["sweep"].values()
    count = 1 + sum(map(len, settings))
    assert re.search(rf"^try_setting +{count}$", result.stdout + result.stderr, re.MULTILINE)


def test_a_config_without_the_section_is_told(study):
    command = [sys.executable, str(ROOT / "workflow/read_config.py"), "--needs", "sweep"]
    for name, code in (("tiny", 1), ("sweep", 0)):
        config = study.folder / f"config/{name}.yaml"
        result = subprocess.run(
            [*command, str(config)], capture_output=True, text=True, check=False
        )
        assert result.returncode == code
        assert ("has no section 'sweep'" in result.stderr) == bool(code)
        assert "Traceback" not in result.stderr
