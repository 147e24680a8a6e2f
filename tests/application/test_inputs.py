"""All that is wrong with files is found in one go, and what is right is described."""

import math

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner
from gst.check.inputs import Asked, check_inputs
from gst.check.inspecting import inspect_file
from gst.cli import main
from gst.config.patches import ScanFile
from gstlib.errors import NOTE, InputsError
from gstlib.io.plu import write_plu
from gstlib.surfaces.footprints import Place, square_of
from PIL import Image

SPACING = 0.01
SETTINGS = {
    "mesh_unit": "mm",
    "face": {"size_mm": 4.0, "points_mm": [[3.0, 3.0, 4.9], [7.0, 3.0, 4.9], [3.0, 7.0, 4.9]]}
    | {"grid": 20, "face_mm": 6.0},
    "rounded": (50.0, 0.0),
    "scan_settings": {"size_mm": 0.5, "unit": None, "spacing_um": None}
    | {"mould": {"invert": False, "flip": None}},
    "maximum_unmeasured": 0.05,
    "placed": True,
    "reference": False,
    "interlayer": None,
    "active_tool": None,
}


def noise(seed, points=50):
    return 1e-3 * np.random.default_rng(seed).standard_normal((points, points))


def stone(halvings):
    box = trimesh.creation.box(extents=(20.0, 20.0, 10.0))
    for _ in range(halvings):
        box = box.subdivide()
    return box


@pytest.fixture
def folder(tmp_path):
    stone(halvings=5).export(tmp_path / "stone.stl")
    for seed, name in enumerate(("1_T0", "1_T1", "2_T0", "2_T1")):
        write_plu(tmp_path / f"{name}.plu", noise(seed), SPACING)
    return tmp_path


def scans(folder):
    return [
        ScanFile(folder / f"{patch}_{epoch}.plu", patch, epoch)
        for patch in ("1", "2")
        for epoch in ("T0", "T1")
    ]


def problems_of(folder, uses, mesh="stone.stl", **settings):
    """What is wrong, in sentences."""
    path = mesh and folder / mesh
    return list(map(str, check_inputs(path, uses, Asked(**SETTINGS | settings)).problems))


def test_a_square_off_the_stone_may_be_a_wrong_unit(folder):
    """A mesh in mm that is read in cm: the points, in mm, are off it."""
    (said, *_) = problems_of(folder, [], mesh_unit="cm")
    assert "with mesh_unit: mm it would be on the stone" in said
    far = [[300.0, 3.0, 4.9], [304.0, 3.0, 4.9], [300.0, 7.0, 4.9]]
    (said, *_) = problems_of(folder, [], face=SETTINGS["face"] | {"points_mm": far})
    assert "mesh_unit" not in said


def test_a_folder_is_inspected_by_its_scans_and_meshes(folder):
    (folder / "notes.pdf").write_bytes(b"-")
    result = CliRunner().invoke(main, ["inspect", str(folder)])
    assert result.exit_code == 0
    assert all(name in result.output for name in ("stone.stl", "1_T0.plu", "2_T1.plu"))
    assert "notes" not in result.output
    (folder / "empty").mkdir()
    result = CliRunner().invoke(main, ["inspect", str(folder / "empty")])
    assert result.exit_code == 2
    assert "no file with the ending" in result.stderr


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


def test_every_problem_is_named_once(folder):
    (folder / "stone.stl").write_bytes(b"no mesh")
    (folder / "1_T0.plu").write_bytes(b"no scan")
    write_plu(folder / "1_T1.plu", noise(1)[:40], SPACING)
    for name, unmeasured in (("2_T0", 10), ("again", 15)):
        holes = noise(1)
        holes[:unmeasured] = np.nan
        write_plu(folder / f"{name}.plu", holes, SPACING)
    uses = [*scans(folder), ScanFile(folder / "again.plu", "1", "repeat")]
    found = check_inputs(folder / "stone.stl", uses, Asked(**SETTINGS))
    assert found.face is None
    assert list(found.scans.patch + found.scans.epoch) == ["2T1"]
    message = str(InputsError(found.problems))
    assert message.startswith("5 problems\n  - ")
    for name, problem in [
        ("stone.stl", "STL"),
        ("1_T0.plu", "less than a .plu header"),
        # with its folder: names may be the same
        ("1_T1.plu (patch 1 at T1): ", "0.5 × 0.4 mm, smaller"),
        ("2_T0.plu (patch 2 at T0): ", "20 % of the points are unmeasured"),
        ("again.plu (repeat of patch 1): ", "30 % of the points are unmeasured"),
    ]:
        (line,) = [line for line in message.splitlines() if f"{folder}/{name}" in line]
        assert problem in line


def test_a_scan_is_read_once_for_all_its_pieces(folder, monkeypatch):
    import gst.check.inputs

    read = []
    whole = gst.check.inputs.read_scan
    monkeypatch.setattr(
        gst.check.inputs, "read_scan", lambda path, **k: read.append(path) or whole(path, **k)
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


SAME = "has the same heights"
# What is written as which file, and the problem with that.
WRITTEN = [
    ("1_T1", noise(9, 100), SPACING / 2, "5 µm apart"),
    ("1_T1", noise(9, 100)[:, :50], (SPACING / 2, SPACING), "5 × 10 µm apart"),
    ("1_T1", 1e3 * noise(9), SPACING, "scans.unit"),
    ("1_T1", 1e-3 * noise(9), SPACING, "scans.unit"),
    ("1_T1", 3.0 * noise(9), SPACING, None),  # use and another calibration may do that
    ("1_T1", noise(0), SPACING, f"1_T1.plu: patch 1 {SAME} at T1 as at T0 ("),
    ("2_T0", noise(1), SPACING, f"2_T0.plu: patch 2 at T0 {SAME} as patch 1 at T1"),
    ("face", noise(9), SPACING, None),
    ("face", noise(9, 49), 0.5 / 49, "face.plu: the counterface has 49 × 49 points"),
    ("again", noise(9), SPACING, None),
    ("again", noise(0), SPACING, f"again.plu: patch 1 {SAME} in its repeat as at T0 ("),
    ("again", noise(1), SPACING, f"again.plu: patch 1 {SAME} in its repeat as at T1 ("),
    ("again", 1e3 * noise(9), SPACING, "another unit"),
]


@pytest.mark.parametrize(("name", "heights", "spacing", "said"), WRITTEN)
def test_scans_that_do_not_go_together_are_refused(folder, name, heights, spacing, said):
    write_plu(folder / f"{name}.plu", heights, spacing)
    face = ScanFile(folder / "face.plu", "counterface", "")
    again = ScanFile(folder / "again.plu", "1", "repeat")
    found = problems_of(folder, [*scans(folder), *(f for f in (face, again) if f.path.exists())])
    assert len(found) == (said is not None)
    assert all(said in problem and f"{name}.plu" in problem for problem in found)


def test_a_file_is_of_one_patch_and_epoch(folder):
    for at, said in ((2, f"1_T0.plu: patch 2 at T0 {SAME}"), (1, "leave t1 empty")):
        uses = scans(folder)
        uses[at] = uses[at]._replace(path=uses[0].path)
        (problem,) = problems_of(folder, uses)
        assert said in problem


@pytest.mark.parametrize("epoch", ["T1", "repeat"])
def test_a_larger_scan_is_not_its_own_later_one(folder, epoch):
    """Of which T0 alone is cut."""
    write_plu(folder / "large.plu", noise(1, 120), SPACING)
    uses = [ScanFile(folder / "large.plu", "1", when, (0.0, 0.3)) for when in ("T0", epoch)]
    (problem,) = problems_of(folder, uses)
    assert "large.plu" in problem


def test_many_equal_scans_are_a_problem_of_few_words(folder):
    uses = [
        ScanFile(folder / f"1_{epoch}.plu", str(patch), epoch)
        for patch in range(40)
        for epoch in ("T0", "T1")
    ]
    write_plu(folder / "1_T1.plu", noise(0), SPACING)
    copied, same = problems_of(folder, uses)
    assert f"patch 0 {SAME} at T1 as at T0" in copied
    assert "and so have 39 more: patch 1, patch 2, patch 3, patch 4, …." in copied
    assert f"patch 1 at T0 {SAME} as patch 0 at T0" in same
    assert "and so have 77 more: patch 2 at T0, patch 3 at T0, " in same


@pytest.mark.parametrize("up_mm", [0.0, 1.0])
def test_an_active_tool_that_misses_the_first_is_a_problem(folder, up_mm):
    stone(halvings=5).apply_translation((0, 0, 10)).export(folder / "other.stl")
    pose = np.eye(4)
    pose[2, 3] = up_mm
    second = {"mesh": folder / "other.stl", "mesh_unit": "mm", "reach_mm": 1.0}
    found = problems_of(folder, [], active_tool=second | {"pose": {"matrix": pose.tolist()}})
    assert len(found) == (up_mm > 0)
    assert all("1 mm away from the passive one" in problem for problem in found)


def test_the_whole_square_needs_one_grid_and_the_memory(folder, monkeypatch):
    asked = {"mesh": None, "reference": True}
    assert problems_of(folder, scans(folder), **asked) == []
    monkeypatch.setattr("os.sysconf", {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": 10}.__getitem__)
    (problem,) = problems_of(folder, scans(folder), **asked)
    assert "reference_draws" in problem
    monkeypatch.undo()
    write_plu(folder / "2_T0.plu", noise(9, 25), 2 * SPACING)
    assert "reference_draws" in "".join(problems_of(folder, scans(folder), **asked))
    assert "reference_draws" not in "".join(problems_of(folder, scans(folder), mesh=None))


def waves(x, factor=1.0):
    """Of 20 µm, and as long as a patch and a half."""
    return factor * 0.02 * np.sin(2 * np.pi * x / 2.8)


@pytest.fixture
def wavy(folder):
    """Scans of 2 mm of a stone with waves, at (x, y), times a factor; their problems."""

    def problems(halvings, *of, **settings):
        box = stone(halvings)
        above = 5 + waves(box.vertices[:, 0])
        box.vertices[:, 2] = np.where(box.vertices[:, 2] > 4.9, above, -5)
        box.export(folder / "stone.stl")
        uses, rng = [], np.random.default_rng(1)
        for number, (place, factor) in enumerate(of, start=1):
            at = 3.0 + place.x_mm - 1.0 + 0.04 * (np.arange(50) + 0.5)
            heights = np.tile(waves(at), (50, 1)) + 1e-4 * rng.standard_normal((50, 50))
            uses.append(ScanFile(folder / f"{number}.plu", str(number), "T0", None, place))
            write_plu(uses[-1].path, factor * heights, 0.04)
        scan_settings = SETTINGS["scan_settings"] | {"size_mm": 2.0}
        return problems_of(folder, uses, scan_settings=scan_settings, **settings)

    return problems


@pytest.mark.parametrize("halvings", [5, 6])  # edges of a third of a patch's side, and of a sixth
def test_scans_and_mesh_in_different_units(wavy, caplog, halvings):
    """Where both see the same waves, scans are as high as the mesh, and not a thousand times."""
    for factor, wrong in ((1.0, 0), (1e3, 1), (1e-3, 1)):
        found = wavy(halvings, (Place(2.0, 1.5), factor))
        assert len(found) == wrong
        assert all("scans.unit" in problem for problem in found)
    # one that is a little lower is as wrong as the others, and no more
    rows = [(Place(y, 1.5), factor) for y, factor in ((1.2, 1e-3), (2.0, 8e-4), (2.8, 1e-3))]
    (problem,) = wavy(halvings, *rows)
    assert "scans.unit" in problem
    assert "2.plu" not in problem
    caplog.clear()
    assert wavy(halvings, (Place(2.0, 1.5), 1e-3), placed=False) == []
    assert "scans.unit" in caplog.text


@pytest.mark.parametrize(("factor", "said"), [(1e-3, 1), (200.0, 1), (6.0, 0), (1.5, 0)])
@pytest.mark.parametrize("mesh", [None, "stone.stl"])
def test_one_scan_in_another_unit(wavy, folder, caplog, mesh, factor, said):
    """Its heights are compared with those of the others, whether the mesh shows them or not."""
    of = [(Place(1.2, 2.0), 1.0), (Place(2.0, 2.0), factor), (Place(2.8, 2.0), 1.0)]
    found = wavy(6, *of, mesh=mesh)
    assert len(found) == said
    assert all("2.plu: its heights" in problem for problem in found)
    assert (f"{folder}/2.plu" in caplog.text) == (factor == 6.0)


@pytest.mark.parametrize(("halvings", "told"), [(5, True), (6, False)])
def test_units_that_the_mesh_is_too_coarse_to_check_are_told(folder, caplog, halvings, told):
    caplog.set_level(NOTE)
    stone(halvings).export(folder / "stone.stl")
    write_plu(folder / "1_T0.plu", 1e3 * noise(8), 0.02)
    use = [ScanFile(folder / "1_T0.plu", "1", "T0", None, Place(2.0, 2.0))]
    problems_of(folder, use, scan_settings=SETTINGS["scan_settings"] | {"size_mm": 1.0})
    assert ("could not be checked" in caplog.text) == told


@pytest.mark.parametrize(("size", "told"), [(None, 0), (30.0, 1), (1.0, 0)])
def test_a_turntable_in_the_mesh_is_told_and_no_speck(folder, caplog, size, told):
    whole = stone(halvings=5)
    if size:
        below = trimesh.creation.box((size, size, 1.0)).apply_translation((0, 0, -8))
        whole = trimesh.util.concatenate([whole, below])
    whole.export(folder / "stone.stl")
    assert problems_of(folder, []) == []
    assert len(caplog.records) == told


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
    assert (facts["points_x"], facts["points_y"], *level.shape) == (60, 40, 40, 60)
    assert [facts[f"spacing_{axis}_um"] for axis in "xy"] == pytest.approx([1.66, 2.49])
    assert [facts[f"size_{axis}_mm"] for axis in "xy"] == pytest.approx([60 * DX, 40 * DY])
    assert facts["unmeasured"] == pytest.approx(24 / 2400)
    assert facts["Sq_um"] == pytest.approx(0.1, rel=0.05)  # without the plane
    tilt = [facts[f"tilt_{axis}_mrad"] for axis in "xy"]
    assert tilt == pytest.approx([TILT_X * 1e3, TILT_Y * 1e3], abs=0.1)
    assert facts["unit"] == "in the file"


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


@pytest.mark.parametrize("name", ["P$_{$.plu", "a\\alpha$x$^2.plu", "b\udc80c.plu"])
def test_a_picture_has_the_name_of_its_file(tmp_path, name):
    """Whatever is in it; nothing of it is a formula."""
    write_plu(tmp_path / "a.plu", noise(1), SPACING)
    (tmp_path / "a.plu").rename(tmp_path / name)
    result = inspect("--pictures", tmp_path / "seen", tmp_path)
    assert result.exit_code == 0, result.exception
    assert (tmp_path / f"seen/{name}.png").stat().st_size > 1000


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
    side = 120 * 2.8  # of the map, in pixels
    scan = scan[: round(120 * 0.3 + side)]  # without the scale of colours below the map
    blue, yellow = scan[..., 2] - scan[..., 0] > 40, scan[..., 0] - scan[..., 2] > 40
    left = np.arange(scan.shape[1]) < scan.shape[1] / 2
    assert 0.6 < (blue & left).sum() / (blue & ~left).sum() < 1.6  # noise, not a slope
    assert yellow.sum() > 1000
    pale = (scan == 0xE4).all(axis=-1)
    assert pale.sum() == pytest.approx(0.01 * side**2, rel=0.1)  # 24 of 2400 points
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


def test_text_asks_for_what_it_does_not_state(tmp_path):
    heights = np.random.default_rng(1).normal(size=(9, 9))
    np.savetxt(tmp_path / "a.txt", heights)
    assert "Set --unit to" in inspect(tmp_path / "a.txt").stderr
    assert "Set --spacing-um" in inspect("--unit", "um", tmp_path / "a.txt").stderr
    result = inspect("--unit", "um", "--spacing-um", "2", tmp_path / "a.txt")
    assert result.exit_code == 0, result.output
    assert "spacing_x_um  2\n" in result.output
    assert "um, as given" in result.output


def test_command_goes_on_after_files_that_it_cannot_read(tilted, tmp_path):
    (tmp_path / "bad.plu").write_bytes(b"nothing")
    (tmp_path / "empty.stl").touch()
    result = inspect(*(tmp_path / name for name in ("bad.plu", "empty.stl")), tilted)
    assert result.exit_code == 2
    assert "bad.plu: 7 bytes are less than a .plu header" in result.stderr
    assert "the file is empty" in result.stderr
    assert "points_y" in result.stdout


def test_what_is_wrong_with_all_files_is_said_once(folder):
    for epoch in ("T0", "T1"):
        (folder / f"1_{epoch}.csv").write_text("1,2,4\n3,4,0\n7,1,2\n", encoding="utf-8")
    files = [ScanFile(folder / f"1_{epoch}.csv", "1", epoch) for epoch in ("T0", "T1")]
    found = check_inputs(None, files, Asked(**SETTINGS | {"reference": True}))
    message = str(InputsError(found.problems))
    assert "problems" not in message
    for word in ("1_T0.csv, ", "1_T1.csv: ", "scans.unit", "scans.spacing_um"):
        assert message.count(word) == 1
