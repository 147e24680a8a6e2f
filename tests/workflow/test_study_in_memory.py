"""`gstlib.study.Study` on the tiny study's files: it agrees, and every setting counts.

Files, rules and scripts pass on what the config says, and nothing else; what the library makes of
it is tested with the library.
"""

import numpy as np
import pytest
import yaml
from gstlib.change.texture import measure_texture
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_pressures, read_table
from gstlib.validation.single_scale import two_scales_table
from power import merged
from sweep import main, outcomes

from .conftest import assert_stored, in_memory, intervals_of

BEFORE_PRESSURES = {"face", "composite", "contact", "prepared", "change"}


@pytest.fixture(scope="module")
def own(finished_tiny):
    return in_memory(finished_tiny)


@pytest.fixture
def same(results, tmp_path):
    """A table is the stored one."""
    return lambda found, name: assert_stored(found, results / f"tables/{name}.csv", tmp_path)


def test_its_tables_are_the_stored_ones(own, finished_tiny, config, table, same):
    same(own.selected(), "patch_pressures")
    same(own.registration(), "registration")
    again = in_memory(finished_tiny)
    again.kept |= {key: of for key, of in own.kept.items() if key[0] in BEFORE_PRESSURES}
    # with the digits that files have: one of the last may turn a point of a mask
    again.kept["pressures",] = read_pressures(finished_tiny.results / "coupling/pressures.csv")
    again.kept["registration",] = table("registration")
    judged = again.judged(seed=config["seed"], resamples=config["validation"]["resamples"])
    found = {"wear": judged["wear"], "wear_profile": judged["profile"]}
    found |= {f"validation_{name}": judged[name] for name in ("patches", "summary")}
    scans, changes = (
        {patch: of(patch) for patch in own.worn}
        for of in (lambda patch: own.prepared(patch, "T0"), own.change)
    )
    found["texture"] = measure_texture(scans, changes, **config["texture"])
    for name, rows in found.items():
        same(rows, name)


def test_its_patches_are_pressed_as_the_stored_ones(own, results, same):
    variants = {"placed": "", "levelled": "levelled/"}
    contacts = {
        variant: {
            patch: read_dataset(results / f"microscale/{folder}1/{patch}.h5") for patch in own.worn
        }
        for variant, folder in variants.items()
    }
    for variant, of_patches in contacts.items():
        for patch, stored in of_patches.items():
            found = own.contact_in(variant, patch)
            for name in ("height", "counterface", "surroundings", "slope_y", "slope_x"):
                np.testing.assert_allclose(stored[name], found[name], atol=1e-7)
            np.testing.assert_allclose(stored.pressure, found.pressure, atol=1.0)
    same(two_scales_table(contacts, read_dataset(results / "reference/patches.h5")), "two_scales")


def test_the_intervals_are_those_of_the_errors_that_the_config_states(finished_tiny, same):
    same(intervals_of(finished_tiny), "patch_intervals")


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
def test_a_changed_value_moves_the_outcomes(own, finished_tiny, config, changes, moved):
    before, after = map(outcomes, (own, in_memory(finished_tiny, merged(config, changes))))
    one, other = (t.result[t.output == moved].to_numpy() for t in (before, after))
    assert not np.allclose(one, other, rtol=1e-4)


def test_a_setting_of_a_sweep_is_the_study_with_that_config(
    own, finished_tiny, config, tmp_path, monkeypatch
):
    change = {"load": {"force_N": 660.0}}
    settings, rows = tmp_path / "settings.yaml", tmp_path / "sweep.csv"
    settings.write_text(yaml.safe_dump({"force": [change]}))
    monkeypatch.chdir(finished_tiny.folder)
    files = ["--settings", str(settings), "--output", str(rows)]
    main(["--config", finished_tiny.config, *files])
    found = read_table(rows)
    swept = found[found.output == "pressure_MPa"]
    changed = in_memory(finished_tiny, merged(config, change))
    for study, is_it in ((own, swept.factor.isna()), (changed, swept.factor == "force")):
        expected = study.pressures().pressure_MPa
        np.testing.assert_allclose(swept.result[is_it], expected, rtol=1e-4, atol=1e-9)
    moved = set(found.output[found.change.abs() > 1e-9])
    assert {"pressure_MPa", "mean(mcc)"} <= moved
    assert set(found.value.dropna()) == {"load: {force_N: 660.0}"}
