"""All that is wrong with files is found in one go, and what is right is described."""

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from gst.cli import main
from gst.inputs import Asked, check_inputs, inspect_file
from gst.patches import ScanFile
from gstlib.errors import InputsError
from gstlib.geometry import Place, square_of
from gstlib.io.plu import write_plu
from PIL import Image

SPACING = 0.01
SETTINGS = {
    "mesh_unit": "mm",
    "square": {"size_mm": 4.0, "points_mm": [[3.0, 3.0, 4.9], [7.0, 3.0, 4.9], [3.0, 7.0, 4.9]]},
    "grid": {"grid": 20, "face_mm": 6.0, "radius_mm": 50.0},
    "scan_settings": {
        "size_mm": 0.5,
        "unit": None,
        "spacing_um": None,
        "mould": {"invert": False, "flip": None},
    },
    "maximum_unmeasured": 0.05,
    "placed": True,
    "reference": False,
    "mat": None,
    "second_stone": None,
}


def stone(halvings):
    box = trimesh.creation.box(extents=(20.0, 20.0, 10.0))
    for _ in range(halvings):
        box = box.subdivide()
    return box


@pytest.fixture
def folder(tmp_path):
    stone(halvings=5).export(tmp_path / "stone.stl")
    for seed, name in enumerate(("1_T0", "1_T1", "2_T0", "2_T1")):
        heights = 1e-3 * np.random.default_rng(seed).standard_normal((50, 50))
        write_plu(tmp_path / f"{name}.plu", heights, SPACING)
    return tmp_path


def scans(folder):
    return [
        ScanFile(folder / f"{patch}_{epoch}.plu", patch, epoch)
        for patch in ("1", "2")
        for epoch in ("T0", "T1")
    ]


def test_good_files_are_described(folder):
    found = check_inputs(folder / "stone.stl", scans(folder), Asked(**SETTINGS))
    assert found.problems == []
    assert found.face.height.shape == (30, 30)
    square = square_of(found.face.height, 4.0)
    assert square.shape == (20, 20)
    assert float(square.mean()) == pytest.approx(0, abs=1e-9)  # level
    assert float(found.face.counterface[0, 0]) == pytest.approx(-2 * 2.9**2 / (2 * 50.0))
    assert list(found.scans.patch + found.scans.epoch) == ["1T0", "1T1", "2T0", "2T1"]
    assert (found.scans.points_x == 50).all()
    assert found.scans.spacing_x_um.to_numpy() == pytest.approx(10)
    assert found.stone.extents[2] == pytest.approx(10)
    assert found.scans.range_um.between(6, 9).all()  # of 2500 normal numbers


def test_a_second_stone_that_misses_the_first_is_a_problem(folder):
    aside = stone(halvings=5).apply_translation((0, 0, 10))
    aside.export(folder / "other.stl")
    still = np.eye(4)
    second = {"mesh": folder / "other.stl", "mesh_unit": "mm", "reach_mm": 1.0}
    settings = SETTINGS | {"second_stone": second | {"pose": {"matrix": still.tolist()}}}
    assert check_inputs(folder / "stone.stl", scans(folder), Asked(**settings)).problems == []
    still[2, 3] = 1.0
    settings = SETTINGS | {"second_stone": second | {"pose": {"matrix": still.tolist()}}}
    (problem,) = check_inputs(folder / "stone.stl", scans(folder), Asked(**settings)).problems
    assert "1 mm away from the passive one" in str(problem)


def test_every_problem_is_named_once(folder):
    (folder / "stone.stl").write_bytes(b"no mesh")
    (folder / "1_T0.plu").write_bytes(b"no scan")
    write_plu(folder / "1_T1.plu", 1e-3 * np.random.default_rng(1).random((40, 50)), SPACING)
    holes = 1e-3 * np.random.default_rng(1).random((50, 50))
    holes[:10] = np.nan
    write_plu(folder / "2_T0.plu", holes, SPACING)
    found = check_inputs(folder / "stone.stl", scans(folder), Asked(**SETTINGS))
    assert found.face is None
    assert list(found.scans.patch + found.scans.epoch) == ["2T1"]
    message = str(InputsError(found.problems))
    assert message.startswith("4 problems\n  - ")
    for name, problem in [
        ("stone.stl", "STL"),
        ("1_T0.plu", "less than a .plu header"),
        # with its folder: names may be the same
        ("1_T1.plu (patch 1 at T1): ", "0.5 × 0.4 mm, smaller"),
        ("2_T0.plu (patch 2 at T0): ", "20 % of the points are unmeasured"),
    ]:
        (line,) = [line for line in message.splitlines() if f"{folder}/{name}" in line]
        assert problem in line


def test_a_mat_thinner_than_a_scan_point_is_refused(folder):
    mat = {"young_MPa": 20.0, "poisson": 0.2, "thickness_um": 9.0}
    files = folder / "stone.stl", scans(folder)
    (problem,) = check_inputs(*files, Asked(**SETTINGS | {"mat": mat})).problems
    assert "mat.thickness_um: 9 µm is less than the 10 µm between two points" in str(problem)
    thicker = SETTINGS | {"mat": mat | {"thickness_um": 10.0}}
    assert not check_inputs(*files, Asked(**thicker)).problems


def test_a_mesh_too_coarse_for_the_square_and_a_scan_that_is_missing(folder):
    stone(halvings=3).export(folder / "stone.stl")
    (folder / "1_T0.plu").unlink()
    coarse, missing = map(
        str, check_inputs(folder / "stone.stl", scans(folder), Asked(**SETTINGS)).problems
    )
    assert f"{folder}/stone.stl: the mesh has" in coarse
    assert "vertices in the square of 4 mm" in coarse
    assert f"{folder}/1_T0.plu: no such file" in missing


def test_a_scan_is_read_once_for_all_its_pieces(folder, monkeypatch):
    import gst.inputs

    read = []
    whole = gst.inputs.read_scan
    monkeypatch.setattr(
        gst.inputs, "read_scan", lambda path, **k: read.append(path) or whole(path, **k)
    )
    large = folder / "large.plu"
    heights = 1e-3 * np.random.default_rng(1).random((120, 120))
    heights[40, 90] = 5e-3  # in the piece 1 alone
    write_plu(large, heights, SPACING)
    pieces = [ScanFile(large, str(k), "T0", (0.0, 0.3 * k)) for k in (-1, 0, 1, 2)]
    found = check_inputs(folder / "stone.stl", pieces, Asked(**SETTINGS))
    assert read == [large]
    assert list(found.scans.patch) == ["-1", "0", "1"]
    assert (found.scans.points_x == 50).all()
    assert list(found.scans.range_um > 4) == [False, False, True]
    (problem,) = found.problems
    assert "sticks out" in str(problem)


def test_both_epochs_need_one_spacing(folder):
    write_plu(folder / "1_T1.plu", 1e-3 * np.random.default_rng(1).random((100, 100)), SPACING / 2)
    (problem,) = check_inputs(folder / "stone.stl", scans(folder), Asked(**SETTINGS)).problems
    assert "1_T1.plu" in str(problem)
    assert "5 µm apart" in str(problem)
    assert "10 µm" in str(problem)


def test_a_counterface_needs_the_points_of_the_patches(folder):
    for points, count in ((50, 0), (49, 1)):
        face = ScanFile(folder / f"face{points}.plu", "counterface", "")
        heights = 1e-3 * np.random.default_rng(9).standard_normal((points, points))
        write_plu(face.path, heights, 0.5 / points)
        uses = [*scans(folder), face]
        problems = check_inputs(folder / "stone.stl", uses, Asked(**SETTINGS)).problems
        assert len(problems) == count
    assert "face49.plu: the counterface has 49 × 49 points" in str(problems[0])
    assert "1_T0.plu has 50 × 50 points" in str(problems[0])


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_epochs_in_different_units_are_refused(folder, factor):
    heights = 1e-3 * np.random.default_rng(8).standard_normal((50, 50))
    for of_patch, scale in (("1", factor), ("2", 3.0)):  # use and another calibration may do three
        write_plu(folder / f"{of_patch}_T1.plu", scale * heights, SPACING)
    (problem,) = check_inputs(None, scans(folder), Asked(**SETTINGS)).problems
    assert "1_T1.plu" in str(problem)
    assert "scans.unit" in str(problem)


@pytest.mark.parametrize("halvings", [5, 6])  # edges of a third of a patch's side, and of a sixth
def test_scans_and_mesh_in_different_units(folder, caplog, halvings):
    """Where both see the same waves, scans are as high as the mesh, and not a thousand times."""

    def height(x):
        return 5 + 0.02 * np.sin(2 * np.pi * x / 2.8)

    box = stone(halvings)
    box.vertices[:, 2] = np.where(box.vertices[:, 2] > 4.9, height(box.vertices[:, 0]), -5)
    box.export(folder / "stone.stl")
    place, spacing = Place(2.0, 1.5), 0.04
    settings = SETTINGS | {"scan_settings": SETTINGS["scan_settings"] | {"size_mm": 2.0}}
    at = 3.0 + place.x_mm - 1.0 + spacing * (np.arange(50) + 0.5)
    for factor, wrong in ((1.0, 0), (1e3, 1), (1e-3, 1)):
        waves = factor * np.tile(height(at) - 5, (50, 1))
        write_plu(folder / "1_T0.plu", waves, spacing)
        use = [ScanFile(folder / "1_T0.plu", "1", "T0", None, place)]
        problems = check_inputs(folder / "stone.stl", use, Asked(**settings)).problems
        assert len(problems) == wrong
        assert all("scans.unit" in str(problem) for problem in problems)
    caplog.clear()
    levelled = settings | {"placed": False}
    assert check_inputs(folder / "stone.stl", use, Asked(**levelled)).problems == []
    assert "scans.unit" in caplog.text


@pytest.mark.parametrize(("factor", "said"), [(1e-3, 1), (200.0, 1), (6.0, 0), (1.5, 0)])
@pytest.mark.parametrize("halvings", [2, 6])  # a mesh that does not resolve a patch, and one
def test_one_scan_in_another_unit(folder, caplog, halvings, factor, said):
    """Its heights are compared with those of the others, whether the mesh shows them or not."""
    box = stone(halvings=6)
    z = 5 + 0.02 * np.sin(2 * np.pi * box.vertices[:, 0] / 2.8)
    box.vertices[:, 2] = np.where(box.vertices[:, 2] > 4.9, z, -5)
    box.export(folder / "stone.stl")
    settings = SETTINGS | {"scan_settings": SETTINGS["scan_settings"] | {"size_mm": 2.0}}
    rng, uses = np.random.default_rng(1), []
    for patch, y_mm in (("1", 1.2), ("2", 2.0), ("3", 2.8)):
        at = 3.0 + 2.0 - 1.0 + 0.04 * (np.arange(50) + 0.5)
        waves = np.tile(0.02 * np.sin(2 * np.pi * at / 2.8), (50, 1))
        waves = (factor if patch == "2" else 1) * (waves + 1e-4 * rng.normal(size=waves.shape))
        uses.append(ScanFile(folder / f"{patch}.plu", patch, "T0", None, Place(y_mm, 2.0)))
        write_plu(uses[-1].path, waves, 0.04)
    mesh = folder / "stone.stl" if halvings == 6 else None
    problems = check_inputs(mesh, uses, Asked(**settings)).problems
    assert len(problems) == said
    assert all("2.plu: its heights" in str(problem) for problem in problems)
    assert (f"{folder}/2.plu" in caplog.text) == (factor == 6.0)


@pytest.mark.parametrize(("halvings", "told"), [(5, True), (6, False)])
def test_units_that_the_mesh_is_too_coarse_to_check_are_told(folder, caplog, halvings, told):
    stone(halvings).export(folder / "stone.stl")
    settings = SETTINGS | {"scan_settings": SETTINGS["scan_settings"] | {"size_mm": 1.0}}
    place, heights = Place(2.0, 2.0), np.random.default_rng(8).standard_normal((50, 50))
    write_plu(folder / "1_T0.plu", heights, 0.02)
    use = [ScanFile(folder / "1_T0.plu", "1", "T0", None, place)]
    for mesh, is_told in ((folder / "stone.stl", told), (None, False)):
        caplog.clear()
        check_inputs(mesh, use, Asked(**settings))
        assert ("could not be checked" in caplog.text) == is_told


def test_a_turntable_in_the_mesh_is_told(folder, caplog):
    whole = stone(halvings=5)
    check_inputs(folder / "stone.stl", [], Asked(**SETTINGS))
    assert len(caplog.records) == 0
    for size, told in ((30.0, 1), (1.0, 1)):  # a table, and then a speck
        below = trimesh.creation.box(extents=(size, size, 1.0)).apply_translation((0, 0, -8))
        trimesh.util.concatenate([whole, below]).export(folder / "stone.stl")
        check_inputs(folder / "stone.stl", [], Asked(**SETTINGS))
        assert len(caplog.records) == told


def test_two_patches_need_two_scans(folder):
    uses = scans(folder)
    uses[2] = uses[2]._replace(path=uses[0].path)
    (problem,) = check_inputs(folder / "stone.stl", uses, Asked(**SETTINGS)).problems
    assert "1_T0.plu: patch 2 at T0 has the same heights as patch 1 at T0" in str(problem)
    copied = folder / "copy.plu"
    copied.write_bytes(uses[1].path.read_bytes())
    uses[2] = uses[2]._replace(path=copied)
    (problem,) = check_inputs(folder / "stone.stl", uses, Asked(**SETTINGS)).problems
    assert "copy.plu: patch 2 at T0 has the same heights as patch 1 at T1" in str(problem)


def test_both_epochs_with_the_same_heights_are_refused(folder):
    (folder / "1_T1.plu").write_bytes((folder / "1_T0.plu").read_bytes())
    uses = [*scans(folder)[:3], ScanFile(folder / "2_T0.plu", "2", "T1")]
    first, second = map(str, check_inputs(folder / "stone.stl", uses, Asked(**SETTINGS)).problems)
    assert "1_T1.plu: patch 1 has the same heights at T1 as at T0 (" in first
    assert "1_T0.plu)" in first
    assert "2_T0.plu: patch 2 has the same heights at T1 as at T0" in second
    assert "leave t1 empty" in second


def test_a_repeat_is_compared_with_both_epochs(folder):
    """As a repeat, T0 itself would show no error; and T1 of a patch was used in between."""
    again = ScanFile(folder / "again.plu", "1", "repeat")
    uses = [*scans(folder)[:2], again]
    heights = 1e-3 * np.random.default_rng(9).standard_normal((50, 50))
    write_plu(again.path, heights, SPACING)
    found = check_inputs(folder / "stone.stl", uses, Asked(**SETTINGS))
    assert found.problems == []
    assert found.scans.epoch.tolist() == ["T0", "T1", "repeat"]
    for epoch, remedy in (("T0", "leave repeat empty"), ("T1", "if the patch was used in")):
        again.path.write_bytes((folder / f"1_{epoch}.plu").read_bytes())
        (problem,) = check_inputs(folder / "stone.stl", uses, Asked(**SETTINGS)).problems
        said = f"again.plu: patch 1 has the same heights in its repeat as at {epoch} ("
        assert said in str(problem)
        assert remedy in str(problem)
    write_plu(again.path, 1e3 * heights, SPACING)
    (problem,) = check_inputs(folder / "stone.stl", uses, Asked(**SETTINGS)).problems
    assert "another unit" in str(problem)
    heights[:10] = np.nan
    write_plu(again.path, heights, SPACING)
    (problem,) = check_inputs(folder / "stone.stl", uses, Asked(**SETTINGS)).problems
    assert "again.plu (repeat of patch 1): 20 % of the points are unmeasured" in str(problem)


# --- gst inspect ------------------------------------------------------------------------------

TILT_X, TILT_Y = 2e-3, -1e-3
DY, DX = 2.49e-3, 1.66e-3


@pytest.fixture
def tilted(tmp_path):
    """Noise of 0.1 µm on a plane."""
    y, x = np.mgrid[:40, :60] * np.reshape((DY, DX), (2, 1, 1))
    heights = TILT_X * x + TILT_Y * y + 1e-4 * np.random.default_rng(3).standard_normal(x.shape)
    heights[:4, :6] = math.nan
    write_plu(tmp_path / "a.plu", heights, (DY, DX))
    return tmp_path / "a.plu"


def test_facts_of_a_scan(tilted):
    facts, level = inspect_file(tilted)
    assert (facts["points_x"], facts["points_y"]) == (60, 40)
    assert [facts[f"spacing_{axis}_um"] for axis in "xy"] == pytest.approx([1.66, 2.49])
    assert [facts[f"size_{axis}_mm"] for axis in "xy"] == pytest.approx([60 * DX, 40 * DY])
    assert facts["unmeasured"] == pytest.approx(24 / 2400)
    assert facts["Sq_um"] == pytest.approx(0.1, rel=0.05)  # without the plane
    assert facts["tilt_x_mrad"] == pytest.approx(TILT_X * 1e3, abs=0.1)
    assert facts["tilt_y_mrad"] == pytest.approx(TILT_Y * 1e3, abs=0.1)
    assert facts["objective"]
    assert facts["unit"] == "in the file"
    assert level.shape == (40, 60)


def test_facts_of_a_mesh(tmp_path):
    box = trimesh.creation.box(extents=(30.0, 20.0, 10.0))
    box.export(tmp_path / "a.stl")
    facts, mesh = inspect_file(tmp_path / "a.stl")
    assert (facts["vertices"], facts["faces"], facts["bodies"]) == (8, 12, 1)
    assert [facts[f"size_{axis}_mm"] for axis in "xyz"] == pytest.approx([30, 20, 10])
    assert facts["closed"] == "yes"
    assert mesh.extents == pytest.approx([30, 20, 10])
    box.slice_plane([0, 0, 0], [0, 0, 1]).export(tmp_path / "half.stl")
    half, _ = inspect_file(tmp_path / "half.stl", unit="in")
    assert half["size_x_mm"] == pytest.approx(30 * 25.4)
    assert half["closed"] == "no"


def inspect(*arguments):
    return CliRunner().invoke(main, ["inspect", *(str(argument) for argument in arguments)])


def test_command_shows_the_facts(tilted, tmp_path):
    trimesh.creation.icosphere(radius=20.0).export(tmp_path / "a.ply")
    result = inspect(tilted, tmp_path / "a.ply")
    assert result.exit_code == 0, result.output
    assert "points_x" in result.output
    assert "vertices" in result.output


def test_command_draws_the_files(tilted, tmp_path):
    """The tilt is taken out, and points that were not measured stay pale."""
    trimesh.creation.icosphere(radius=20.0).export(tmp_path / "a.ply")
    result = inspect("--pictures", tmp_path / "seen", tilted, tmp_path / "a.ply")
    assert result.exit_code == 0, result.output
    assert f"{tmp_path}/seen/a.plu.png" in result.output
    scan, mesh = (
        np.asarray(Image.open(tmp_path / f"seen/{name}.png").convert("RGB"), dtype=int)
        for name in ("a.plu", "a.ply")
    )
    scan = scan[: round(120 * (0.3 + 3.6))]  # without the scale of colours below the map
    blue, yellow = scan[..., 2] - scan[..., 0] > 40, scan[..., 0] - scan[..., 2] > 40
    left = np.arange(scan.shape[1]) < scan.shape[1] / 2
    assert 0.6 < (blue & left).sum() / (blue & ~left).sum() < 1.6  # noise, not a slope
    assert yellow.sum() > 1000
    pale = (scan == 0xE4).all(axis=-1)
    assert pale.sum() == pytest.approx(0.01 * (3.6 * 120) ** 2, rel=0.1)  # 24 of 2400 points
    thirds = np.array_split((mesh < 250).any(axis=-1), 3, axis=1)
    assert all(0.2 < third.mean() < 0.8 for third in thirds)  # a ball, three times


def test_a_unit_that_no_file_states_is_no_fact(tmp_path):
    sphere = trimesh.creation.icosphere(radius=20.0)
    for name, said in (("a.stl", "not stated"), ("a.ply", "not stated"), ("a.glb", "in the file")):
        sphere.apply_scale(1e-3 if name == "a.glb" else 1).export(tmp_path / name)
        assert said in inspect_file(tmp_path / name)[0]["unit"]
    assert inspect_file(tmp_path / "a.stl", unit="cm")[0]["unit"] == "cm, as given"
    sphere.export(tmp_path / "small.stl")  # in m
    assert "set --unit m" in inspect(tmp_path / "small.stl").stderr


@pytest.mark.parametrize("ending", ["plu", "plux", "txt", "xyz", "stl", "ply", "obj", "off"])
def test_an_empty_file_is_called_empty(tmp_path, ending):
    (tmp_path / f"a.{ending}").touch()
    assert "the file is empty" in inspect(tmp_path / f"a.{ending}").stderr


def test_a_mesh_that_is_not_read_gets_advice_about_meshes(tmp_path):
    (tmp_path / "a.fbx").write_bytes(b"PK")
    result = inspect(tmp_path / "a.fbx")
    assert result.exit_code == 1
    assert ".glb" in result.stderr


def test_command_goes_on_after_a_bad_file(tilted, tmp_path):
    (tmp_path / "bad.plu").write_bytes(b"nothing")
    result = inspect(tmp_path / "bad.plu", tilted)
    assert result.exit_code == 1
    assert "bad.plu: 7 bytes are less than a .plu header" in result.stderr
    assert "points_y" in result.stdout


def test_text_asks_for_what_it_does_not_state(tmp_path):
    heights = np.random.default_rng(1).normal(size=(9, 9))
    np.savetxt(tmp_path / "a.txt", heights)
    assert "Set --unit to" in inspect(tmp_path / "a.txt").stderr
    assert "Set --spacing-um" in inspect("--unit", "um", tmp_path / "a.txt").stderr
    result = inspect("--unit", "um", "--spacing-um", "2", tmp_path / "a.txt")
    assert result.exit_code == 0, result.output
    assert "spacing_x_um  2\n" in result.output
    assert "um, as given" in result.output


def test_a_reference_that_the_memory_cannot_hold_is_a_problem(folder, monkeypatch):
    settings = SETTINGS | {"reference": True}
    assert check_inputs(None, scans(folder), Asked(**settings)).problems == []
    monkeypatch.setattr("os.sysconf", {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": 10}.__getitem__)
    (problem,) = check_inputs(None, scans(folder), Asked(**settings)).problems
    assert "reference_draws" in str(problem)


def test_a_reference_needs_scans_of_one_grid(folder):
    coarse = 1e-3 * np.random.default_rng(9).standard_normal((25, 25))
    write_plu(folder / "2_T0.plu", coarse, 2 * SPACING)
    found = check_inputs(None, scans(folder), Asked(**SETTINGS | {"reference": True}))
    assert any("reference_draws" in str(problem) for problem in found.problems)
    found = check_inputs(None, scans(folder), Asked(**SETTINGS))
    assert not any("reference_draws" in str(problem) for problem in found.problems)


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="threads are counted on Linux")
def test_the_linear_algebra_has_one_thread():
    """Also in the step to which Snakemake gives all cores."""
    count = "import gst.inputs, os; print(len(os.listdir('/proc/self/task')))"
    several = os.environ | {"OPENBLAS_NUM_THREADS": "2"}
    found = subprocess.check_output([sys.executable, "-c", count], env=several)
    assert int(found) == 1


def test_what_is_wrong_with_all_files_is_said_once(folder):
    for epoch in ("T0", "T1"):
        (folder / f"1_{epoch}.csv").write_text("1,2,4\n3,4,0\n7,1,2\n", encoding="utf-8")
    files = [ScanFile(folder / f"1_{epoch}.csv", "1", epoch) for epoch in ("T0", "T1")]
    found = check_inputs(None, files, Asked(**SETTINGS))
    message = str(InputsError(found.problems))
    assert "problems" not in message
    for word in ("1_T0.csv, ", "1_T1.csv: ", "scans.unit", "scans.spacing_um"):
        assert message.count(word) == 1
