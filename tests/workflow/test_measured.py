"""A study of measured files, with all that the generated one lacks.

Its files are those of a synthetic stone, as a laboratory has them: the mesh in µm, a second tool
elsewhere in space and in inches, two scans taken turned, one mirrored by nothing, and one to be cut
from a text without units; three patches scanned twice, and one never used. The stones differ, the
force acts beside the middle, the hand moves the tool as a table says, and a patch that is left out
of the study bears more than the hardness. So the same stone comes out; wear follows the gesture.
"""

import json
import shutil

import numpy as np
import pandas as pd
import pytest
import trimesh
from numpy.testing import assert_allclose
from specimens import merged

from gst.config.reading import read_config
from gstlib.io.plu import write_plu
from gstlib.io.scans import read_scan
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.grid import spacing_of
from gstlib.validation.summary import statistic_names

from .conftest import Study, fresh, in_memory
from .expected import assert_as_expected

# Of the scans, from x towards y; and a patch whose scans the mould did not mirror.
TURNED, MIRRORED = {"10": -90, "13": 90}, "7"
ALL = ["5", "7", "10", "11", "13", "16"]
WORN, TWICE = ALL[:-1], ["7", "10", "13"]
# A patch cut from a larger scan, a text that states nothing; and one that lies obliquely.
CUT, SPACING_MM, OBLIQUE = "16", 13.28e-3, "11"
# What takes the second tool to where it was measured, mm.
AWAY = trimesh.transformations.compose_matrix(
    angles=(0.4, -1.1, 2.0), translate=(30, -12, 5)
)
POSES = """x_mm,y_mm,rotation_deg,force_N,sliding_mm,turning_deg,weight
0,0,0,550,2,0,1
0.4,-0.2,5,400,1,5,3
-0.1,0.3,0,700,0.5,0,0.5
"""
PUBLISHED = """quantity,patch,unit,value
mean pressure,,MPa,5
displacement,,um,20
contact fraction,,1,0.1
patch pressure,13,MPa,10
"""
ASKED = {
    "material": {
        "young_1_MPa": 60000.0,
        "poisson_1": 0.1,
        "young_2_MPa": 30000.0,
        "poisson_2": 0.4,
        "contact_modulus_MPa": None,
    },
    "load": {"force_N": 550.0, "at_mm": [3.2, 2.0]},
    "uncertainty": {"pose_um": 200.0},
    "texture": {"s_filter_um": 30.0, "l_filter_um": 200.0},
    "grinding": {"friction": 0.3, "tangential_ratio": 1.0},
    "pressure_cap_MPa": 60.0,  # of which patch 10 bears more
    "validation": {"expected_most_worn": ["7", "13"]},
    "wear_steps": 2,
}


@pytest.fixture(scope="module")
def generated(tmp_path_factory):
    """The stones and their scans, and the one laid on the other."""
    study = fresh(tmp_path_factory.mktemp("generated"))
    rows = patch_table(study)
    rows["repeat"] = np.where(rows.patch.isin(TWICE), rows.patch + "_again.plu", "")
    rows.loc[~rows.patch.isin(WORN), "t1"] = ""
    rows["rotation_deg"] = np.where(rows.patch == OBLIQUE, 10, 0)
    rows.to_csv(study.folder / "config/patches_tiny.tsv", sep="\t", index=False)
    study.change(specimen={"counterface_seed": 8}, **ASKED)
    study.run("results-tiny/macroscale/surface.h5")
    return study


def patch_table(study):
    path = study.folder / "config/patches_tiny.tsv"
    return pd.read_csv(path, sep="\t", comment="#", dtype=str, keep_default_na=False)


def write_scans(rows, specimen, scans):
    """The scans of a specimen as they were taken: turned, mirrored, one as text in µm."""
    for patch, file in rows.melt("patch", ["t0", "t1", "repeat"])[
        ["patch", "value"]
    ].values:
        if not file:
            continue
        scan = read_scan(specimen / "scans" / file)
        seen = np.rot90(scan.values[:, ::-1], TURNED.get(patch, 0) // 90)
        if patch != MIRRORED:
            seen = seen[:, ::-1]
        if patch == CUT:
            seen = 1e3 * np.pad(seen, ((3, 9), (5, 1)), "reflect")
            np.savetxt(scans / "16.txt", seen, delimiter="\t")
        else:
            write_plu(scans / file, seen, spacing_of(scan))


@pytest.fixture(scope="module")
def studied(generated, tmp_path_factory):
    study = fresh(tmp_path_factory.mktemp("measured"))
    specimen, data = generated.results / "specimen", study.folder / "data"
    rows = patch_table(generated)
    write_scans(rows, specimen, data / "scans")
    rows["rotation_deg"] = rows.rotation_deg.astype(int) + rows.patch.map(
        TURNED
    ).fillna(0)
    rows["flip"] = np.where(rows.patch == MIRRORED, "none", "")
    of_cut = {"t0": "16.txt", "crop_x_mm": 2 * SPACING_MM, "crop_y_mm": -3 * SPACING_MM}
    for name, value in of_cut.items():
        rows.loc[rows.patch == CUT, name] = value
    rows.to_csv(study.folder / "patches.csv", index=False)
    for name, unit_mm, moved in (
        ("mesh", 1e-3, np.eye(4)),
        ("counterface", 25.4, AWAY),
    ):
        mesh = trimesh.load(specimen / f"{name}.stl", process=False).apply_transform(
            moved
        )
        mesh.apply_scale(1 / unit_mm).export(data / f"{name}.stl")
    (study.folder / "poses.csv").write_text(POSES)
    (study.folder / "published.csv").write_text(PUBLISHED)
    # the two squares lie on each other, turned over about y
    pose = {"matrix": (np.diag([-1, 1, -1, 1]) @ np.linalg.inv(AWAY)).tolist()}
    second = {"mesh": "data/counterface.stl", "mesh_unit": "in", "pose": pose}
    study.change(
        results="results-measured",
        patches="patches.csv",
        published="published.csv",
        specimen=None,
        inputs={
            "mesh": "data/mesh.stl",
            "mesh_unit": "um",
            "scan_folder": "data/scans",
        },
        counterface=second | {"scan": "data/scans/5_T0.plu"},
        scans={"unit": "um", "spacing_um": 1e3 * SPACING_MM},
        gesture={"table": "poses.csv"},
        reference_realisations=2,
        **ASKED,
    )
    study.run()
    return study


@pytest.fixture
def stored(studied):
    return lambda name: read_dataset(studied.results / f"{name}.h5")


@pytest.fixture
def table(studied):
    return lambda name: read_table(studied.results / f"tables/{name}.csv")


def test_the_study_is_as_expected(studied):
    assert_as_expected(studied.results, "measured")


def test_every_contact_after_the_use_is_told_of_it(studied):
    """These six patches are too few to show by a number that it is."""
    for step in (
        "solve_macroscale",
        "press_poses_1",
        "couple_scales",
        "bound_pressures",
    ):
        record = json.loads((studied.results / f"logs/{step}.json").read_text())
        assert "use/use.h5" in record["inputs"], step


# --- The same stone, however it is told -------------------------------------------------------


def test_the_stones_lie_on_each_other_as_they_were_made(generated, stored, table):
    for name, fields in {
        "surface": ["height", "counterface"],
        "active_tool": ["face"],
    }.items():
        made = read_dataset(generated.results / f"macroscale/{name}.h5")
        for field in fields:
            assert_allclose(stored(f"macroscale/{name}")[field], made[field], atol=2e-5)
    made = read_table(generated.results / "tables/gridding.csv")
    pd.testing.assert_frame_equal(table("gridding"), made, rtol=2e-3)


def test_turned_and_mirrored_scans_lie_on_the_stone_as_they_were_taken(
    generated, stored, table
):
    face = {"counterface": {"scan": "results-tiny/specimen/scans/5_T0.plu"}}
    plain = in_memory(
        generated, merged(read_config(generated.folder / generated.config), face)
    )
    laid, made = stored("macroscale/composite"), plain.composite
    for patch in ALL:
        turned, expected = TURNED.get(patch, 0), made.sel(patch=patch)
        slopes = laid.sel(patch=patch)[["slope_y", "slope_x"]].to_array().values
        slopes = PatchPosition(0, 0, turned).points(*slopes)
        assert_allclose(slopes, (expected.slope_y, expected.slope_x), atol=1e-6)
        near_y = abs(made.y - expected.y_mm) < 0.35
        near_x = abs(made.x - expected.x_mm) < 0.35
        is_near = (near_y & near_x).values
        heights = laid.height.values[is_near], made.height.values[is_near]
        assert_allclose(*heights, atol=5e-5)
    now = table("registration").set_index("patch")
    before = plain.registration.set_index("patch")
    for patch in WORN:
        shift = now.loc[patch, ["shift_y_um", "shift_x_um"]]
        shift = PatchPosition(0, 0, TURNED.get(patch, 0)).points(*shift)
        expected = before.loc[patch, ["shift_y_um", "shift_x_um"]]
        assert_allclose(shift, expected, atol=1.0)
    seen = now.overlap > 0.7
    lost, expected = now[seen].loss_volume_um3, before[seen].loss_volume_um3
    assert_allclose(lost, expected, rtol=0.02)


# --- Physics -----------------------------------------------------------------------------------


def test_two_stones_yield_and_slide_as_their_compliances_say(stored, table):
    """Johnson, Contact Mechanics, §4.2 and §7.2."""
    poisson, young = np.array([0.1, 0.4]), np.array([60e3, 30e3])
    shear = young / 2 / (1 + poisson)
    normal = ((1 - poisson) / shear / 2).sum()  # 1/MPa
    tangential = ((2 - poisson) / shear / 4).sum()
    cases = table("cases").set_index(["case", "patch", "quantity"]).value
    for patch in ("7", "13"):  # the whole patch slides
        modulus = float(stored(f"microscale/1/{patch}").contact_modulus)
        assert modulus == pytest.approx(1 / normal, rel=1e-12)
        moved_um = 0.3 * tangential / normal * cases["study", patch, "displacement"]
        grinding = cases["grinding", patch, "tangential displacement"]
        assert grinding == pytest.approx(moved_um, rel=1e-4)


def test_wear_follows_the_gesture(stored, table):
    """Patches lose in proportion to their exposure, as long as little is lost."""
    path, of_gesture = stored("wear/square"), table("exposure").set_index("patch")
    path = path.sel(ratio=0, reach=float(path.reach_of_all))
    first = path.pressed.sel(body="stone").isel(step=1).to_series()
    rate = first / float(path.kappa[1])
    mean = float(stored("gesture/exposure").exposure.mean())
    share = of_gesture.exposure_N_per_mm[rate.index] / mean
    assert_allclose(rate, 5.5 * share, rtol=1e-3, atol=1e-4)
    statistics = set(statistic_names(table("validation_summary")))
    assert "expected_most_worn(7+13, pressure_MPa)" in statistics


# --- With an interlayer --------------------------------------------------------------------


@pytest.fixture(scope="module")
def with_an_interlayer(studied, tmp_path_factory):
    """The interlayer takes the place of the gesture."""
    folder = tmp_path_factory.mktemp("interlayer") / "study"
    shutil.copytree(studied.folder, folder, copy_function=shutil.copy2)
    study = Study(folder, studied.config)
    interlayer = {"young_MPa": 300.0, "poisson": 0.3, "thickness_um": 300.0}
    study.change(gesture=None, interlayer=interlayer)
    tables = "wear", "validation_summary"
    study.run(*(f"results-measured/tables/{name}.csv" for name in tables))
    return study


def test_its_wear_is_as_expected(with_an_interlayer):
    results = with_an_interlayer.results
    assert_as_expected(results, "interlayer", "wear", "validation_summary")
    models = set(read_table(results / "tables/wear.csv").model)
    assert {"archard", "interlayer", "archard_capped"} < models
