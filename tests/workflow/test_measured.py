"""A study of measured files, with all that the generated one lacks.

Its files are those of a synthetic stone, as a laboratory has them: the mesh in µm, a second tool
elsewhere in space and in inches, two scans taken turned, one mirrored by nothing, and one to be cut
from a text without units; three patches scanned twice, and one never used. The stones differ, the
force acts beside the middle, the hand moves the tool as a table says, and a patch that is left out
of the study bears more than the hardness. So the same stone comes out; wear follows the gesture.
"""

import hashlib
import json
import re
import shutil

import numpy as np
import pandas as pd
import pytest
import trimesh
from gst.config.poses import read_poses
from gst.config.reading import read_config
from gstlib.change.change import Detection
from gstlib.contact import Contact
from gstlib.io.plu import write_plu
from gstlib.io.scans import read_scan
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_pressures, read_table
from gstlib.macroscale.gesture import Gesture
from gstlib.surfaces.footprints import PatchPosition, square_of
from gstlib.surfaces.grid import spacing_of
from gstlib.validation.summary import statistic_names
from gstlib.wear.fit import fit_wear
from specimens import merged

from .conftest import Study, assert_stored, fresh, in_memory, opened
from .expected import assert_as_expected

# Of the scans, from x towards y; and a patch whose scans the mould did not mirror.
TURNED, MIRRORED = {"10": -90, "13": 90}, "7"
ALL, WORN, TWICE = (
    ["5", "7", "10", "11", "13", "16"],
    ["5", "7", "10", "11", "13"],
    ["7", "10", "13"],
)
# A patch cut from a larger scan, a text that states nothing; and one that lies obliquely.
CUT, SPACING_MM, OBLIQUE = "16", 13.28e-3, "11"
# What takes the second tool to where it was measured, mm.
AWAY = trimesh.transformations.compose_matrix(angles=(0.4, -1.1, 2.0), translate=(30, -12, 5))
POSES = """x_mm,y_mm,rotation_deg,force_N,sliding_mm,turning_deg,weight
0,0,0,550,2,0,1
0.4,-0.2,5,400,1,5,3
-0.1,0.3,0,700,0.5,0,0.5
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
    study.succeed("results-tiny/macroscale/surface.h5")
    return study


def patch_table(study):
    path = study.folder / "config/patches_tiny.tsv"
    return pd.read_csv(path, sep="\t", comment="#", dtype=str, keep_default_na=False)


@pytest.fixture(scope="module")
def studied(generated, tmp_path_factory):
    study = fresh(tmp_path_factory.mktemp("measured"))
    specimen, scans = generated.results / "specimen", study.folder / "data/scans"
    rows = patch_table(generated)
    for patch, file in rows.melt("patch", ["t0", "t1", "repeat"])[["patch", "value"]].values:
        if file:
            scan = read_scan(specimen / "scans" / file)
            stone = np.rot90(scan.values[:, ::-1], TURNED.get(patch, 0) // 90)
            seen = stone if patch == MIRRORED else stone[:, ::-1]
            if patch == CUT:
                seen = 1e3 * np.pad(seen, ((3, 9), (5, 1)), "reflect")
                np.savetxt(scans / "16.txt", seen, delimiter="\t")
            else:
                write_plu(scans / file, seen, spacing_of(scan))
    rows["rotation_deg"] = rows.rotation_deg.astype(int) + rows.patch.map(TURNED).fillna(0)
    rows["flip"] = np.where(rows.patch == MIRRORED, "none", "")
    of_cut = {"t0": "16.txt", "crop_x_mm": 2 * SPACING_MM, "crop_y_mm": -3 * SPACING_MM}
    for name, value in of_cut.items():
        rows.loc[rows.patch == CUT, name] = value
    rows.to_csv(study.folder / "patches.csv", index=False)
    for name, unit_mm, moved in (("mesh", 1e-3, np.eye(4)), ("counterface", 25.4, AWAY)):
        mesh = trimesh.load(specimen / f"{name}.stl", process=False).apply_transform(moved)
        mesh.apply_scale(1 / unit_mm).export(study.folder / f"data/{name}.stl")
    (study.folder / "poses.csv").write_text(POSES)
    (study.folder / "published.csv").write_text(
        "quantity,patch,unit,value\nmean pressure,,MPa,5\ndisplacement,,um,20\n"
        "contact fraction,,1,0.1\npatch pressure,13,MPa,10\n"
    )
    # the two squares lie on each other, turned over about y
    pose = {"matrix": (np.diag([-1, 1, -1, 1]) @ np.linalg.inv(AWAY)).tolist()}
    second = {"mesh": "data/counterface.stl", "mesh_unit": "in", "pose": pose}
    study.change(
        results="results-measured",
        patches="patches.csv",
        published="published.csv",
        specimen=None,
        inputs={"mesh": "data/mesh.stl", "mesh_unit": "um", "scan_folder": "data/scans"},
        counterface=second | {"scan": "data/scans/5_T0.plu"},
        scans={"unit": "um", "spacing_um": 1e3 * SPACING_MM},
        gesture={"table": "poses.csv"},
        reference_realisations=2,
        **ASKED,
    )
    study.succeed()
    return study


def epochs_of(patch):
    return ["T0", *["T1"] * (patch in WORN), *["repeat"] * (patch in TWICE)]


@pytest.fixture
def stored(studied):
    return lambda name: read_dataset(studied.results / f"{name}.h5")


@pytest.fixture
def table(studied):
    return lambda name: read_table(studied.results / f"tables/{name}.csv")


@pytest.fixture
def same(studied, tmp_path):
    """A table is the stored one."""
    return lambda found, name: assert_stored(
        found, studied.results / f"tables/{name}.csv", tmp_path
    )


def kept(study):
    """The study by the library alone, from the stored contact on.

    With the digits that files have: one of the last may turn a point of a mask.
    """
    own = in_memory(study)
    own.face, own.composite, contact = (
        read_dataset(study.results / f"macroscale/{name}.h5")
        for name in ("surface", "composite", "contact")
    )
    own.contact = Contact.from_dataset(contact)
    own.pressures = read_pressures(study.results / "coupling/pressures.csv")
    own.registration = read_table(study.results / "tables/registration.csv")
    return own


@pytest.fixture(scope="module")
def own(studied):
    return kept(studied)


@pytest.fixture(scope="module")
def gesture(studied):
    second = read_dataset(studied.results / "macroscale/active_tool.h5").face
    poses = read_poses(studied.folder / "poses.csv", size_mm=5.0)
    return Gesture(second, second, 5.0, (2.0, 3.2), poses)


def test_the_study_is_as_expected(studied):
    assert_as_expected(studied.results, "measured")


def test_the_record_holds_every_measured_file(studied):
    record = json.loads((studied.results / "provenance.json").read_text())["inputs"]
    data = [*studied.folder.glob("data/**/*.*"), *studied.folder.glob("*.csv")]
    assert len(data) == 2 + 6 + 5 + 3 + 3
    assert record == {
        str(file.relative_to(studied.folder)): hashlib.sha256(file.read_bytes()).hexdigest()
        for file in data
    }


def test_every_contact_after_the_use_is_told_of_it(studied):
    """These six patches are too few to show by a number that it is."""
    for step in ("solve_macroscale", "press_poses_1", "couple_scales", "bound_pressures"):
        record = json.loads((studied.results / f"logs/{step}.json").read_text())
        assert "use/use.h5" in record["inputs"], step


# --- The same stone, however it is told -------------------------------------------------------


def test_the_stones_lie_on_each_other_as_they_were_made(generated, stored, table):
    for name, fields in {"surface": ["height", "counterface"], "active_tool": ["face"]}.items():
        made = read_dataset(generated.results / f"macroscale/{name}.h5")
        for field in fields:
            np.testing.assert_allclose(stored(f"macroscale/{name}")[field], made[field], atol=2e-5)
    made = read_table(generated.results / "tables/gridding.csv")
    pd.testing.assert_frame_equal(table("gridding"), made, rtol=2e-3)


def test_turned_and_mirrored_scans_lie_on_the_stone_as_they_were_taken(generated, stored, table):
    face = {"counterface": {"scan": "results-tiny/specimen/scans/5_T0.plu"}}
    plain = in_memory(generated, merged(read_config(generated.folder / generated.config), face))
    laid, made = stored("macroscale/composite"), plain.composite
    for patch in ALL:
        of, expected = laid.sel(patch=patch), made.sel(patch=patch)
        slopes = PatchPosition(0, 0, TURNED.get(patch, 0)).points(of.slope_y, of.slope_x)
        np.testing.assert_allclose(slopes, (expected.slope_y, expected.slope_x), atol=1e-6)
        near = {axis: abs(laid[axis] - of[f"{axis}_mm"]) < 0.35 for axis in "yx"}
        within = (
            field.height.isel({a: i.values for a, i in near.items()}) for field in (of, expected)
        )
        np.testing.assert_allclose(*within, atol=5e-5)
    pressures, expected = table("patch_pressures"), plain.pressures
    np.testing.assert_allclose(pressures.pressure_MPa, expected.pressure_MPa, rtol=1e-3, atol=1e-3)
    now, was = (of.set_index("patch") for of in (table("registration"), plain.registration))
    for patch in ALL:
        turned = TURNED.get(patch, 0)
        for epoch in epochs_of(patch):
            found, made = (
                stored(f"surfaces/{epoch}/1/{patch}_{epoch}"),
                plain.prepared[patch, epoch],
            )
            height = np.rot90(made.height, turned // 90)
            # what fills a hole depends a little on the turn
            good = ~np.rot90(made.filled | made.outlier, turned // 90)
            np.testing.assert_allclose(found.height.values[good], height[good], atol=5e-6)
            assert (found.filled.values == np.rot90(made.filled, turned // 90)).all()
        if patch in WORN:
            at = PatchPosition(0, 0, turned).points(*now.loc[patch, ["shift_y_um", "shift_x_um"]])
            np.testing.assert_allclose(at, was.loc[patch, ["shift_y_um", "shift_x_um"]], atol=1.0)
    seen = now.overlap > 0.7
    np.testing.assert_allclose(now[seen].loss_volume_um3, was[seen].loss_volume_um3, rtol=0.02)


# --- As the library has it, and physics -------------------------------------------------------


def test_its_stages_are_those_of_the_library(own, studied, stored, table, same):
    anew = in_memory(studied)
    np.testing.assert_allclose(
        stored("macroscale/contact").pressure, anew.contact.pressure, atol=1.0
    )
    tilts = (of.tilt_error_mrad for of in (stored("macroscale/composite"), anew.composite))
    np.testing.assert_allclose(*tilts, rtol=1e-6)
    same(own.selected, "patch_pressures")
    same(anew.registration, "registration")
    for variant, folder in {"equilibrium": "", "paper": "paper/"}.items():
        for patch in ALL:
            found = stored(f"microscale/{folder}1/{patch}")
            expected = own.contact_in(variant, patch).to_dataset()
            for name in ("height", "counterface", "surroundings", "slope_y", "slope_x"):
                np.testing.assert_allclose(found[name], expected[name], atol=1e-7)
            np.testing.assert_allclose(found.pressure, expected.pressure, atol=1.0)
            if patch in ("7", "13"):
                assert np.ptp(found.counterface.values) > 5e-3  # no flat, but a rough face
    # the noise of two scans of 0.1 µm, less what the laying of one on the other smooths
    found = stored("change/detection").attrs
    assert 0.10 < found["level_mm2"] ** 0.5 * 1e3 < 0.15
    assert own.detection == pytest.approx(tuple(Detection.of(found)))
    assert set(table("registration").detection) == {"repeat"}


def test_the_check_says_what_the_study_is(studied, stored, table):
    """By the files, the tables and the stored contact."""
    checked = studied.gst("check", studied.config)
    assert checked.returncode == 0, checked.stderr
    shown = dict(re.findall(r"^  (\S.{10}) (.*)$", checked.stdout, re.MULTILINE))
    numbers = {
        name.strip(): [float(number) for number in re.findall(r"\d+\.?\d*", text)]
        for name, text in shown.items()
    }
    assert "finished, with this config and these files" in checked.stdout
    assert numbers["load"] == [550, 22, 6]
    assert numbers["patches"] == [6, 0.85, 6, 5, 3]
    assert numbers["gesture"] == [3, 2 + 1 + 0.5]
    mesh = trimesh.load(studied.folder / "data/mesh.stl", process=False)
    assert numbers["mesh"][:3] == pytest.approx(1e-3 * mesh.extents, rel=1e-3)
    rough = table("inputs").Sq_um
    assert numbers["scans"][:4] == pytest.approx([64, 64, rough.min(), rough.max()], rel=1e-3)
    registration = table("registration")
    shifts = np.hypot(registration.shift_x_um, registration.shift_y_um)
    shifts = shifts[registration.found.astype(bool)]
    assert numbers["T1 on T0"][0] == len(shifts)
    assert numbers["T1 on T0"][-1] == pytest.approx(shifts.max(), rel=0.2)
    contact = stored("macroscale/contact")  # of the mesh with the scans
    share = square_of(contact, 5.0).pressure.sum() / contact.pressure.sum()
    assert numbers["at rest"][1] == pytest.approx(100 * float(share), abs=15)


def test_the_force_acts_where_it_is_said_on_stones_that_differ(studied, stored, table):
    contact, path = stored("macroscale/contact"), table("macroscale_path").iloc[-1]
    dy, dx = spacing_of(contact)
    assert float(contact.pressure.sum() * dy * dx) == pytest.approx(550, rel=1e-6)
    for axis, at in {"x": 3.2, "y": 2.0}.items():
        centre = float((contact.pressure * contact[axis]).sum() / contact.pressure.sum())
        assert centre == pytest.approx(at, abs=1e-5)
    # Johnson, Contact Mechanics, §4.2 and §7.2: the compliances of both stones, in 1/MPa
    poisson, shear = np.array([0.1, 0.4]), np.array([60e3, 30e3]) / 2 / np.array([1.1, 1.4])
    normal, tangential = ((1 - poisson) / shear / 2).sum(), ((2 - poisson) / shear / 4).sum()
    assert float(contact.contact_modulus) == pytest.approx(1 / normal, rel=1e-12)
    cases = table("cases").set_index(["case", "patch", "quantity"]).value.sort_index()
    assert "other modulus" not in cases.index
    for patch in ("7", "13"):  # the whole patch slides
        found, grinding = stored(f"microscale/1/{patch}"), cases.loc["grinding", patch]
        assert float(found.contact_modulus) == pytest.approx(1 / normal, rel=1e-12)
        moved_um = 0.3 * tangential / normal * cases["study", patch, "displacement"]
        assert grinding["tangential displacement"] == pytest.approx(moved_um, rel=1e-4)
        assert grinding["mean traction"] == pytest.approx(0.3 * float(found.mean_pressure), 1e-4)
        assert cases["cap", patch, "share at the cap"] > 0.9
    # patch 10, left out of the study, bears more than the hardness
    left_out = table("patch_pressures").set_index("patch").loc["10"]
    assert (left_out.pressure_MPa > 60, left_out.in_study) == (True, False)
    assert "10" not in set(table("cases").patch)
    assert "no patch enters" not in (studied.results / "logs/select_patches.log").read_text()
    # published figures stand beside those computed
    names = ["mean_pressure_MPa", "displacement_um", "contact_fraction"]
    expected = [*path[names], table("patch_pressures").pressure_MPa[4]]
    assert list(table("published").computed) == pytest.approx(expected)


def test_every_pose_is_pressed_as_the_table_says(stored, table, gesture):
    found, poses = stored("gesture/exposure"), gesture.poses
    area = float(np.prod(spacing_of(found)))
    forces = found.pressure.sum(["y", "x"]).values * area
    np.testing.assert_allclose(forces, poses.force_N, rtol=1e-6)
    for axis, start in {"x": 3.2, "y": 2.0}.items():  # the force goes with the tool
        at = (found.pressure * found[axis]).sum(["y", "x"]) * area / forces
        np.testing.assert_allclose(at, start + poses[f"{axis}_mm"], atol=1e-5)
    far = np.hypot(found.y - 2.5, found.x - 2.5)
    slid = [
        np.hypot(row.sliding_mm, np.radians(row.turning_deg) * far) for row in poses.itertuples()
    ]
    pressed, weights = found.pressure.values, poses.weight.to_numpy()[:, None, None]
    np.testing.assert_allclose(found.exposure, (weights * slid * pressed).sum(axis=0), rtol=1e-9)
    np.testing.assert_allclose(
        found.mean_pressure, (weights * pressed).sum(axis=0) / 4.5, rtol=1e-9
    )
    # the first pose is the single one
    pressures, of_gesture = table("patch_pressures"), table("exposure")
    np.testing.assert_allclose(
        found.patch_pressure[0], pressures.pressure_MPa, rtol=1e-4, atol=1e-6
    )
    np.testing.assert_allclose(
        of_gesture.mean_pressure_MPa,
        poses.weight @ found.patch_pressure.values / 4.5,
        rtol=1e-4,
        atol=1e-6,
    )


def test_wear_follows_the_gesture(own, studied, stored, table, gesture, same):
    """Patches lose in proportion to their exposure, as long as little is lost."""
    path, of_gesture = stored("wear/square"), table("exposure").set_index("patch")
    path = path.sel(ratio=0, reach=float(path.reach_of_all))
    first = path.pressed.sel(body="stone").isel(step=1).to_series()
    rate = first / float(path.kappa[1])
    share = of_gesture.exposure_N_per_mm[rate.index] / float(
        stored("gesture/exposure").exposure.mean()
    )
    np.testing.assert_allclose(rate, 5.5 * share, rtol=1e-3, atol=1e-4)
    scored = kept(studied)
    tables, options = (own.selected, own.registration), {"patch_mm": 0.85, "steps": 2}
    scored.worn_square = fit_wear(own.contact, *tables, **options, gesture=gesture)
    found = scored.scored(seed=1, resamples=199)
    same(found["wear"], "wear")
    same(found["profile"], "wear_profile")
    same(found["patches"], "validation_patches")
    summary = table("validation_summary")
    assert "expected_most_worn(7+13, pressure_MPa)" in set(statistic_names(summary))
    assert len(summary) == len(found["summary"])


@pytest.mark.browser
def test_the_other_stone_is_lifted_on_the_page(studied, browser):
    with opened(browser, studied.results / "index.html") as page:
        pictures = []
        for lifted in ("1", "4"):
            page.locator("#lift").fill(lifted)
            pictures.append(page.locator("#viewer canvas").screenshot())
    assert pictures[0] != pictures[1]


# --- With an interlayer --------------------------------------------------------------------


@pytest.fixture(scope="module")
def with_an_interlayer(studied, tmp_path_factory):
    """The interlayer takes the place of the gesture."""
    folder = tmp_path_factory.mktemp("interlayer") / "study"
    shutil.copytree(studied.folder, folder, copy_function=shutil.copy2)
    study = Study(folder, studied.config)
    interlayer = {"young_MPa": 300.0, "poisson": 0.3, "thickness_um": 300.0}
    study.change(gesture=None, interlayer=interlayer)
    study.succeed()
    return study


def test_its_wear_is_as_expected(with_an_interlayer):
    results = with_an_interlayer.results
    assert_as_expected(results, "interlayer", "wear", "validation_summary")
    models = set(read_table(results / "tables/wear.csv").model)
    assert {"archard", "interlayer", "archard_capped"} < models


def test_results_of_other_studies_are_refused(studied):
    own = (studied.folder / studied.config).read_text()
    studied.change(title="another stone", inputs={"mesh": "data/other.stl"})
    shutil.copy2(studied.folder / "data/mesh.stl", studied.folder / "data/other.stl")
    refused = studied.gst("study", studied.config)
    (studied.folder / studied.config).write_text(own)
    (studied.folder / "data/other.stl").unlink()
    assert refused.returncode == 2
    assert "another study" in refused.stderr
