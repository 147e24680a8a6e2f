"""The whole of a study on coarse grids: what its files hold, by other means than the study's own.

That its tables are those of the library: test_measured.py. What its page says of them:
test_tiny_page.py.
"""

import importlib.util
import json

import gstlib
import numpy as np
import pytest
from gst.config.tables import TABLES, write_table
from gst.run.provenance import commit, program_hash
from gstlib.conditions import study_modulus
from gstlib.contact import Interface, Load, contact_at_pressure
from gstlib.io.files import sha256
from gstlib.io.store import read_attributes, read_dataset
from gstlib.io.tables import read_table
from gstlib.specimen.score import true_face
from gstlib.surfaces.grid import spacing_of
from gstlib.use.outcome import use_of_study
from gstlib.validation.single_scale import solve_reference
from PIL import Image
from specimens import merged, specimen_config, specimen_studies, worn_patches
from sweep import outcomes

from .conftest import ROOT, in_memory
from .expected import assert_as_expected

# Of the tables listed, those that this study has no use for.
ABSENT = {"exposure", "places", "published"}


@pytest.fixture(scope="module")
def truth(results):
    return read_dataset(results / "specimen/truth.h5")


def test_the_study_is_as_expected(results):
    assert_as_expected(results, "tiny")


# --- Tables -----------------------------------------------------------------------------------


def test_every_table_is_there_and_no_other(results):
    files = {file.relative_to(results).as_posix(): file for file in results.rglob("*.csv")}
    assert set(files) == {one.file for name, one in TABLES.items() if name not in ABSENT}
    # five patches are too few to tell how the tool was used, and by which law they wore
    empty = {name for name, file in files.items() if not len(read_table(file))}
    assert empty == {"tables/predicted_losses.csv", "tables/laws.csv"}


def test_a_dataset_names_the_step_whose_record_names_it(results):
    files = [file for file in results.rglob("*.h5") if "specimen" not in file.parts]
    assert len(files) > 20
    for file in files:
        attributes, name = read_attributes(file), file.relative_to(results).as_posix()
        records = results.glob(f"logs/{attributes['step']}*.json")
        assert any(name in json.loads(record.read_text())["outputs"] for record in records), name
        assert attributes["gstlib_version"] == gstlib.__version__


def test_every_step_has_the_settings_of_the_config(results, config):
    modulus = study_modulus(config["material"])
    s_filter_um, seed = config["microscale"]["s_filter_um"], config["seed"]
    expected = {
        "compose_surface": {"s_filter_um": s_filter_um, "seed": seed}
        | {"placement_um": config["uncertainty"]["placement_um"]},
        "grid_macroscale/gridding": config["square"] | {"grid": 40, "face_mm": 10.0},
        "solve_macroscale": {"modulus": modulus},
        "solve_macroscale/solving": {"steps": 6},
        "solve_patches_1/microscale": {"contact_modulus_MPa": modulus} | config["microscale"],
        "register_patches_1": {
            "maximum_shift_mm": config["registration"]["maximum_shift_mm"],
            "minimum_cluster_points": config["detection"]["minimum_cluster_points"],
        },
        "prepare_scans_T1_1": {"settings": config["scans"]}
        | {"preprocessing": config["preprocessing"]},
        "fit_wear/wear": {"steps": 4, "interlayer": None, "patch_mm": 0.85},
        "predict_wear_1": {"pressure_cap": 800.0},
        "solve_reference/drawn": {"s_filter_um": s_filter_um, "seed": seed},
    }
    for name, values in expected.items():
        step, _, section = name.partition("/")
        params = json.loads((results / f"logs/{step}.json").read_text())["params"]
        params = params[section] if section else params
        assert {key: params.get(key, "lost") for key in values} == values, name


def test_the_record_holds_the_whole_config_and_the_program(results, config):
    record = json.loads((results / "provenance.json").read_text())
    assert record["config"] == config
    found = {name: record["software"][name] for name in ("commit", "program")}
    assert found == {"commit": commit(ROOT), "program": program_hash()}


def test_the_report_holds_every_figure_and_caption(finished_tiny, tmp_path):
    report = tmp_path / "report.html"
    finished_tiny.succeed("--report", str(report))
    text = report.read_text(encoding="utf-8")
    for figure in finished_tiny.results.glob("figures/**/*.png"):
        assert str(figure.relative_to(finished_tiny.folder)) in text
    assert "{{" not in text.split("<script")[0]
    assert "results-tiny/index.html" in text  # which has the answer


def in_square(field):
    """The part of a field of the face (10 mm) that lies in the square: its middle 40 elements."""
    assert field.shape[-2:] == (80, 80)
    return field[..., 20:60, 20:60]


def force_on(contact):
    """Of a contact, in N."""
    dy, dx = spacing_of(contact)
    return float(contact.pressure.sum()) * dy * dx


# --- Contacts ---------------------------------------------------------------------------------


def test_every_patch_is_solved_up_to_its_own_pressure(results, table, config):
    summary, paths = (table(f"microscale_{name}") for name in ("summary", "paths"))
    pressures = table("patch_pressures")
    assert list(summary.patch) == list(pressures.patch[pressures.in_study])
    for row in summary.itertuples():
        steps = paths[paths.patch == row.patch]
        assert list(steps.step) == list(range(1, config["microscale"]["steps"] + 1))
        for name in ("displacement_um", "stiffness_MPa_per_um"):
            assert steps[name].iloc[-1] == getattr(row, name)


def test_the_whole_square_lies_in_the_true_face_at_rest(results, truth, config):
    """Its force is its share of the load; it lies as the stone does, among what presses around."""
    whole = read_dataset(results / "reference/contact.h5")
    true = read_dataset(results / "specimen/surface.h5").height.astype(float)
    over = read_dataset(results / "macroscale/surface.h5").counterface
    interface = Interface(true_face(truth), over)
    load = Load.of_force(config["load"]["force_N"], interface.height, (2.5, 2.5))
    to = {"modulus": study_modulus(config["material"]), "tolerance": 1e-9}
    face = contact_at_pressure(interface, load, source="truth", **to)
    share = float(in_square(face.pressure).sum() / face.pressure.sum())
    assert 0.5 < share <= 1
    assert force_on(whole) == pytest.approx(share * config["load"]["force_N"], rel=0.01)
    pressed = solve_reference(true, face)
    np.testing.assert_allclose(whole.height, pressed.height, atol=1e-6)
    np.testing.assert_allclose(whole.pressure, pressed.pressure, atol=1.0)


def test_cases_are_those_of_the_stored_contacts(results, table, config):
    """What they obey: tests/library/microscale/test_cases.py."""
    cases, pressures = table("cases"), table("patch_pressures")
    of_stone = cases[cases.patch.isna()].set_index(["case", "quantity"]).value
    for key, expected in {
        ("grinding", "friction"): config["grinding"]["friction"],
        ("grinding", "tangential ratio"): config["grinding"]["tangential_ratio"],
        ("cap", "pressure cap"): config["pressure_cap_MPa"],
    }.items():
        assert of_stone[key] == pytest.approx(expected, rel=1e-4), key
    rows = cases.set_index(["patch", "case", "quantity"]).value
    studied = list(pressures.patch[pressures.in_study])
    of_patches = cases[cases.case.isin(["grinding", "cap"])].patch.dropna()
    assert of_patches.unique().tolist() == studied
    for patch in studied:
        row, contact = rows[patch], read_dataset(results / f"microscale/1/{patch}.h5")
        pressure = contact.pressure.values
        share = np.prod([*config["grinding"].values()])
        assert row["grinding", "mean traction"] == pytest.approx(share * pressure.mean(), 1e-4)
        assert row["study", "peak pressure"] == pytest.approx(pressure.max(), 1e-4)
        assert row["study", "contact fraction"] == pytest.approx((pressure > 0).mean(), 1e-4)
        assert row["cap", "displacement"] > row["study", "displacement"]


# --- Wear and scores --------------------------------------------------------------------------


def test_every_stage_is_scored_against_the_truth(table):
    rows = table("truth")
    np.testing.assert_allclose(
        rows.error, rows.recovered - rows.true, atol=1e-4 * (1 + rows.true.abs().max())
    )
    recovered = rows[rows.quantity == "pressure"].set_index("patch").recovered
    np.testing.assert_allclose(
        recovered, table("patch_pressures").set_index("patch").pressure_MPa[recovered.index]
    )
    true = rows[rows.quantity == "pressure"].set_index("patch").true
    known = table("two_scales").query("variant == 'equilibrium'").set_index("patch")
    np.testing.assert_array_equal(true, known.reference_pressure_MPa[true.index])
    assert np.abs(true - recovered).max() > 0.1


def test_losses_tell_how_a_tool_was_used_as_expected(tmp_path):
    """In memory, of more patches, which wore under a load point and a radius that none stated."""
    config = specimen_config(ROOT / "config/tiny.yaml")
    config["use"] |= {"draws": 40, "rounds": 6, "particles": 500}
    patches = worn_patches(config | {"patches": str(ROOT / "config/patches.tsv")})[::2]
    patches = patches.reset_index(drop=True)
    config["specimen"] |= {"worn_off_middle_mm": (-0.8, 0.6), "worn_radius_mm": 120.0}
    ((_, study),) = specimen_studies(config, patches, config["specimen"]["seed"], ["archard"])
    settings = study.settings["infer_use"]
    _, table, _ = use_of_study(study.composite, patches, study.registration, **settings)
    write_table(tmp_path / "tables/use.csv", table)
    assert_as_expected(tmp_path, "losses", "use")
    rows = table.set_index("parameter").loc[["load_point_y", "load_point_x", "radius"]]
    true = np.array([2.5 - 0.8, 2.5 + 0.6, 120.0])
    assert ((rows.low < true) & (true < rows.high)).all()


# --- Figures ----------------------------------------------------------------------------------


def test_the_picture_of_readme_is_drawn(results, tmp_path):
    """That of the default study, by the same script."""
    spec = importlib.util.spec_from_file_location("overview", ROOT / "docs/overview.py")
    overview = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(overview)
    overview.main(results, tmp_path / "overview.png")
    with Image.open(tmp_path / "overview.png") as picture:
        assert picture.text["scores"] == sha256(results / "tables/validation_patches.csv")


# --- In memory: every setting counts ----------------------------------------------------------


@pytest.fixture(scope="module")
def before(finished_tiny):
    return outcomes(in_memory(finished_tiny))


@pytest.mark.parametrize(
    ("changes", "moved"),
    [
        (
            {"material": {"contact_modulus_MPa": 12820.0}, "texture": {"l_filter_um": 150.0}},
            ["mean(mcc)", "mean_change(Sq_um)"],
        ),
        ({"macroscale": {"grid": 30}}, ["pressure_MPa"]),
        ({"coupling": "paper"}, ["pressure_MPa"]),
        ({"microscale": {"s_filter_um": 50.0}}, ["mean(mcc)"]),
        ({"preprocessing": {"outlier_rule": "window"}}, ["mean(mcc)"]),
        ({"detection": {"minimum_cluster_points": 6}}, ["mean(mcc)"]),
    ],
)
def test_a_changed_value_moves_the_outcomes(before, finished_tiny, config, changes, moved):
    after = outcomes(in_memory(finished_tiny, merged(config, changes)))
    for output in moved:
        one, other = (table.result[table.output == output] for table in (before, after))
        assert not np.allclose(one, other, rtol=1e-4)
