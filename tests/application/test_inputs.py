"""All faults of files are reported in one go, and files without faults are described."""

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
from gstlib.surfaces.footprints import PatchPosition, square_of
from PIL import Image

SPACING = 0.01
FACE = {
    "size_mm": 4.0,
    "points_mm": [[3.0, 3.0, 4.9], [7.0, 3.0, 4.9], [3.0, 7.0, 4.9]],
    "grid": 20,
    "face_mm": 6.0,
}
SCANS = {"size_mm": 0.5, "unit": None, "spacing_um": None, "mould": {"invert": False, "flip": None}}


def asked(**settings):
    usual = Asked(
        mesh_unit="mm",
        face=FACE,
        rounded=(50.0, 0.0),
        scan_settings=SCANS,
        maximum_unmeasured=0.05,
        placed=True,
        reference=False,
        interlayer=None,
        active_tool=None,
    )
    return Asked(**(vars(usual) | settings))


def noise(seed, points=50):
    return 1e-3 * np.random.default_rng(seed).standard_normal((points, points))


def stone(halvings=5):
    box = trimesh.creation.box(extents=(20.0, 20.0, 10.0))
    for _ in range(halvings):
        box = box.subdivide()
    return box


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    path = tmp_path_factory.mktemp("stone") / "stone.stl"
    stone().export(path)
    return path.read_bytes()


@pytest.fixture
def folder(tmp_path, exported):
    (tmp_path / "stone.stl").write_bytes(exported)
    for seed, name in enumerate(("1_T0", "1_T1", "2_T0", "2_T1")):
        write_plu(tmp_path / f"{name}.plu", noise(seed), SPACING)
    return tmp_path


def scans(folder):
    names = [(patch, epoch) for patch in "12" for epoch in ("T0", "T1")]
    return [ScanFile(folder / f"{patch}_{epoch}.plu", patch, epoch) for patch, epoch in names]


def problems_of(folder, uses, mesh="stone.stl", **settings):
    """The sentences of all problems."""
    path = mesh and folder / mesh
    return list(map(str, check_inputs(path, uses, asked(**settings)).problems))


def test_a_square_off_the_stone_may_be_a_wrong_unit(folder):
    (problem,) = problems_of(folder, [], mesh_unit="cm")
    assert "mesh_unit: mm" in problem
    far = [[x + 297.0, y, z] for x, y, z in FACE["points_mm"]]
    (problem,) = problems_of(folder, [], face=FACE | {"points_mm": far})
    assert "mesh_unit" not in problem


def test_good_files_are_described(folder):
    inputs = check_inputs(folder / "stone.stl", scans(folder), asked())
    assert inputs.problems == []
    height = inputs.face.height
    assert height.shape == (30, 30)
    assert float(square_of(height, 4.0).mean()) == pytest.approx(0, abs=1e-9)  # level
    assert float(inputs.face.counterface[0, 0]) == pytest.approx(-2 * 2.9**2 / (2 * 50.0))
    assert list(inputs.scans.patch + inputs.scans.epoch) == ["1T0", "1T1", "2T0", "2T1"]
    assert inputs.scans.range_um.between(6, 9).all()  # of 2500 normal numbers


def test_every_problem_is_named_once(folder):
    (folder / "stone.stl").write_bytes(b"no mesh")
    (folder / "1_T0.plu").write_bytes(b"no scan")
    write_plu(folder / "1_T1.plu", noise(1)[:40], SPACING)
    for name, unmeasured in (("2_T0", 10), ("again", 15)):
        heights = noise(1)
        heights[:unmeasured] = np.nan
        write_plu(folder / f"{name}.plu", heights, SPACING)
    uses = [*scans(folder), ScanFile(folder / "again.plu", "1", "repeat")]
    inputs = check_inputs(folder / "stone.stl", uses, asked())
    assert inputs.face is None
    assert list(inputs.scans.patch + inputs.scans.epoch) == ["2T1"]
    message = str(InputsError(inputs.problems))
    for name, problem in {
        "stone.stl": "STL",
        "1_T0.plu": ".plu header",
        "1_T1.plu (patch 1 at T1)": "0.5 × 0.4 mm",
        "2_T0.plu (patch 2 at T0)": "20 %",
        "again.plu (repeat of patch 1)": "30 %",
    }.items():
        (line,) = [line for line in message.splitlines() if f"{folder}/{name}" in line]
        assert problem in line


def test_the_same_problem_of_two_files_is_told_once(folder):
    for epoch in ("T0", "T1"):
        (folder / f"1_{epoch}.csv").write_text("1,2,4\n3,4,0\n7,1,2\n", encoding="utf-8")
    files = [ScanFile(folder / f"1_{epoch}.csv", "1", epoch) for epoch in ("T0", "T1")]
    message = str(InputsError(check_inputs(None, files, asked(reference=True)).problems))
    for word in ("1_T0.csv, ", "1_T1.csv: ", "scans.unit", "scans.spacing_um"):
        assert message.count(word) == 1


def test_pieces_of_one_scan_are_checked_apart(folder):
    heights = noise(1, 120)
    heights[40, 90] = 2e-2  # in the piece 1 alone
    write_plu(folder / "large.plu", heights, SPACING)
    uses = [ScanFile(folder / "large.plu", str(k), "T0", (0.0, 0.3 * k)) for k in (-1, 0, 1, 2)]
    inputs = check_inputs(None, uses, asked())
    assert list(inputs.scans.patch) == ["-1", "0", "1"]
    assert list(inputs.scans.range_um > 15) == [False, False, True]
    (problem,) = inputs.problems
    assert "sticks out" in str(problem)


@pytest.mark.parametrize(
    ("name", "heights", "spacing", "words"),
    [
        ("1_T1", noise(9, 100), SPACING / 2, "5 µm apart"),
        ("1_T1", noise(9, 100)[:, :50], (SPACING / 2, SPACING), "5 × 10 µm apart"),
        ("1_T1", 1e3 * noise(9), SPACING, "scans.unit"),
        ("1_T1", 1e-3 * noise(9), SPACING, "scans.unit"),
        ("1_T1", 3.0 * noise(9), SPACING, None),  # use and another calibration may do that
        ("1_T1", noise(0), SPACING, "leave t1 empty"),
        ("2_T0", noise(1), SPACING, "patch 2 at T0 has the same heights as patch 1 at T1"),
        ("face", noise(9), SPACING, None),
        ("face", noise(9, 49), 0.5 / 49, "49 × 49 points"),
        ("again", noise(9), SPACING, None),
        ("again", noise(0), SPACING, "leave repeat empty"),
        ("again", noise(1), SPACING, "otherwise t1"),
        ("again", 1e3 * noise(9), SPACING, "another unit"),
    ],
)
def test_scans_that_do_not_go_together_are_refused(folder, name, heights, spacing, words):
    write_plu(folder / f"{name}.plu", heights, spacing)
    uses = scans(folder)
    uses += [ScanFile(folder / "face.plu", "counterface", "")]
    uses += [ScanFile(folder / "again.plu", "1", "repeat")]
    problems = problems_of(folder, [use for use in uses if use.path.exists()])
    assert len(problems) == (words is not None)
    assert all(words in problem and f"{name}.plu" in problem for problem in problems)


def test_one_file_of_two_patches_or_epochs_is_a_problem(folder):
    for at, words in ((2, "patch 2 at T0"), (1, "leave t1 empty")):
        uses = scans(folder)
        uses[at] = uses[at]._replace(path=uses[0].path)
        (problem,) = problems_of(folder, uses)
        assert words in problem
    write_plu(folder / "large.plu", noise(1, 120), SPACING)  # of which T0 alone is cut
    for epoch in ("T1", "repeat"):
        piece = ScanFile(folder / "large.plu", "1", "T0", (0.0, 0.3))
        (problem,) = problems_of(folder, [piece, piece._replace(epoch=epoch)])
        assert "large.plu" in problem


def test_many_equal_scans_are_two_short_problems(folder):
    write_plu(folder / "1_T1.plu", noise(0), SPACING)
    first, second, *_ = scans(folder)
    uses = [use._replace(patch=str(n)) for n in range(40) for use in (first, second)]
    inputs = check_inputs(folder / "stone.stl", uses, asked())
    for fault, count in zip(inputs.problems, (77, 39), strict=True):
        assert f"{count} more" in fault.problem
        assert len(fault.problem) < 500
        assert set(fault.patches) == {str(n) for n in range(40)}


@pytest.mark.parametrize("up_mm", [0.0, 1.0])
def test_an_active_tool_that_misses_the_passive_one_is_a_problem(folder, up_mm):
    stone().apply_translation((0, 0, 10)).export(folder / "other.stl")
    pose = np.eye(4)
    pose[2, 3] = up_mm
    tool = {"mesh": folder / "other.stl", "mesh_unit": "mm", "reach_mm": 1.0}
    problems = problems_of(folder, [], active_tool=tool | {"pose": {"matrix": pose.tolist()}})
    assert len(problems) == (up_mm > 0)
    assert all("1 mm away" in problem for problem in problems)


def test_the_whole_square_needs_one_grid_and_the_memory(folder, monkeypatch):
    def is_named(**settings):
        problems = problems_of(folder, scans(folder), mesh=None, **settings)
        return "reference_realisations" in "".join(problems)

    assert not is_named(reference=True)
    with monkeypatch.context() as small:
        small.setattr("os.sysconf", {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": 10}.__getitem__)
        assert is_named(reference=True)
    write_plu(folder / "2_T0.plu", noise(9, 25), 2 * SPACING)
    assert is_named(reference=True)
    assert not is_named(reference=False)


@pytest.fixture
def wavy(folder):
    """The problems of scans of 2 mm of a stone with waves, at places, times factors."""

    def waves(x):  # as long as a patch and a half
        return 0.02 * np.sin(2 * np.pi * x / 2.8)

    def problems(halvings, *patches, **settings):
        box = stone(halvings)
        above = 5 + waves(box.vertices[:, 0])
        box.vertices[:, 2] = np.where(box.vertices[:, 2] > 4.9, above, -5)
        box.export(folder / "stone.stl")
        uses, rng = [], np.random.default_rng(1)
        for number, (place, factor) in enumerate(patches, start=1):
            x = 3.0 + place.x_mm - 1.0 + 0.04 * (np.arange(50) + 0.5)
            heights = waves(x) + 1e-4 * rng.standard_normal((50, 50))
            uses.append(ScanFile(folder / f"{number}.plu", str(number), "T0", None, place))
            write_plu(uses[-1].path, factor * heights, 0.04)
        return problems_of(folder, uses, scan_settings=SCANS | {"size_mm": 2.0}, **settings)

    return problems


@pytest.mark.parametrize("halvings", [5, 6])  # edges of a third of a patch's side, and of a sixth
def test_scans_and_mesh_in_different_units(wavy, caplog, halvings):
    """Where both see the same waves, scans are as high as the mesh, and not a thousand times."""
    place = PatchPosition(2.0, 1.5)
    assert wavy(halvings, (place, 1.0)) == []
    # one that is a little lower is as wrong as the others, and no more
    rows = [
        (PatchPosition(y, 1.5), factor) for y, factor in ((1.2, 1e-3), (2.0, 8e-4), (2.8, 1e-3))
    ]
    for patches in ([(place, 1e3)], rows):
        (problem,) = wavy(halvings, *patches)
        assert "scans.unit" in problem
        assert "2.plu" not in problem
    caplog.clear()
    assert wavy(halvings, (place, 1e-3), placed=False) == []
    assert "scans.unit" in caplog.text


@pytest.mark.parametrize("factor", [1e-3, 200.0, 20.0, 6.0, 1.5])
@pytest.mark.parametrize("mesh", [None, "stone.stl"])
def test_one_scan_in_another_unit(wavy, folder, caplog, mesh, factor):
    """Its heights are compared with those of the others, whether the mesh shows them or not."""
    patches = [
        (PatchPosition(1.2, 2.0), 1.0),
        (PatchPosition(2.0, 2.0), factor),
        (PatchPosition(2.8, 2.0), 1.0),
    ]
    problems = wavy(5, *patches, mesh=mesh)
    assert len(problems) == (factor in (1e-3, 200.0) or (mesh is not None and factor == 20.0))
    assert all("2.plu" in problem for problem in problems)
    assert (f"{folder}/2.plu" in caplog.text) == (not problems and factor > 1.5)


@pytest.mark.parametrize(("halvings", "is_told"), [(5, True), (6, False)])
def test_units_that_the_mesh_is_too_coarse_to_check_are_told(folder, caplog, halvings, is_told):
    caplog.set_level(NOTE)
    stone(halvings).export(folder / "stone.stl")
    write_plu(folder / "1_T0.plu", 1e3 * noise(8), 0.02)
    use = [ScanFile(folder / "1_T0.plu", "1", "T0", None, PatchPosition(2.0, 2.0))]
    problems_of(folder, use, scan_settings=SCANS | {"size_mm": 1.0})
    assert ("could not be checked" in caplog.text) == is_told


@pytest.mark.parametrize(("size", "count"), [(30.0, 1), (1.0, 0)])
def test_a_turntable_in_the_mesh_is_told_and_no_speck(folder, caplog, size, count):
    below = trimesh.creation.box((size, size, 1.0)).apply_translation((0, 0, -8))
    trimesh.util.concatenate([stone(), below]).export(folder / "stone.stl")
    assert problems_of(folder, []) == []
    assert len(caplog.records) == count


# --- gst inspect ------------------------------------------------------------------------------

TILT_X, TILT_Y = 2e-3, -1e-3
DY, DX = 2.49e-3, 1.66e-3


def inspect(*arguments):
    return CliRunner().invoke(main, ["inspect", *map(str, arguments)])


def test_facts_of_a_scan(tmp_path):
    """Noise of 0.1 µm on a plane, of which a hundredth was not measured."""
    y, x = np.mgrid[:40, :60] * np.reshape((DY, DX), (2, 1, 1))
    heights = TILT_X * x + TILT_Y * y + 1e-4 * np.random.default_rng(3).standard_normal(x.shape)
    heights[:4, :6] = math.nan
    write_plu(tmp_path / "a.plu", heights, (DY, DX))
    facts, level = inspect_file(tmp_path / "a.plu")
    expected = {"points_x": 60, "points_y": 40, "unmeasured": 0.01}
    expected |= {"spacing_x_um": 1.66, "spacing_y_um": 2.49}
    expected |= {"size_x_mm": 60 * DX, "size_y_mm": 40 * DY}
    assert {name: facts[name] for name in expected} == pytest.approx(expected)
    spread_um = 1e3 * float(level.std())  # without the plane
    assert (facts["Sq_um"], spread_um) == pytest.approx((0.1, 0.1), rel=0.05)
    tilt = [facts[f"tilt_{axis}_mrad"] for axis in "xy"]
    assert tilt == pytest.approx([TILT_X * 1e3, TILT_Y * 1e3], abs=0.1)


def test_facts_of_a_mesh(tmp_path):
    box = trimesh.creation.box(extents=(30.0, 20.0, 10.0))
    box.export(tmp_path / "a.stl")
    facts, _ = inspect_file(tmp_path / "a.stl")
    expected = {"vertices": 8, "faces": 12, "bodies": 1, "closed": "yes"}
    assert {name: facts[name] for name in expected} == expected
    assert [facts[f"size_{axis}_mm"] for axis in "xyz"] == pytest.approx([30, 20, 10])
    box.slice_plane([0, 0, 0], [0, 0, 1]).export(tmp_path / "half.stl")
    half, _ = inspect_file(tmp_path / "half.stl", unit="in")
    assert (half["size_x_mm"], half["closed"]) == (pytest.approx(30 * 25.4), "no")


@pytest.mark.parametrize(
    ("name", "unit", "words"),
    [
        ("a.stl", None, "not stated"),
        ("a.ply", None, "not stated"),
        ("a.glb", None, "in the file"),
        ("a.stl", "cm", "cm, as given"),
    ],
)
def test_an_assumed_unit_is_told_as_such(tmp_path, name, unit, words):
    sphere = trimesh.creation.icosphere(radius=0.02 if name == "a.glb" else 20.0)
    sphere.export(tmp_path / name)
    assert words in inspect_file(tmp_path / name, unit=unit)[0]["unit"]


def test_options_stand_in_place_of_keys_of_a_config(tmp_path):
    trimesh.creation.icosphere(radius=0.02).export(tmp_path / "small.stl")
    np.savetxt(tmp_path / "a.txt", noise(1, 9))
    assert "--unit m" in inspect(tmp_path / "small.stl").stderr
    assert "--unit" in inspect(tmp_path / "a.txt").stderr
    assert "--spacing-um" in inspect("--unit", "um", tmp_path / "a.txt").stderr
    result = inspect("--unit", "um", "--spacing-um", "2", tmp_path / "a.txt")
    assert result.exit_code == 0, result.output
    assert "spacing_x_um  2\n" in result.output


def test_a_folder_is_inspected_as_far_as_it_can_be_read(folder):
    for name in ("notes.pdf", "bad.plu"):
        (folder / name).write_bytes(b"-")
    result = inspect(folder)
    assert result.exit_code == 2
    assert "bad.plu" in result.stderr
    assert all(name in result.stdout for name in ("stone.stl", "1_T0.plu", "2_T1.plu"))
    assert "notes" not in result.output
    (folder / "empty").mkdir()
    assert inspect(folder / "empty").exit_code == 2


@pytest.mark.parametrize("name", ["P$_{$.plu", "a\\alpha$x$^2.plu", "b\udc80c.plu", "a.ply"])
def test_a_picture_has_the_name_of_its_file(tmp_path, name):
    """Whatever is in it; nothing of it is a formula."""
    if name.endswith("ply"):
        trimesh.creation.icosphere(radius=20.0).export(tmp_path / name)
    else:
        write_plu(tmp_path / "a.plu", noise(1), SPACING)
        (tmp_path / "a.plu").rename(tmp_path / name)
    result = inspect("--pictures", tmp_path / "seen", tmp_path)
    assert result.exit_code == 0, result.exception
    pixels = np.asarray(Image.open(tmp_path / f"seen/{name}.png").convert("L"))
    assert 0.05 < (pixels < 250).mean() < 0.95
