"""All faults of files are reported in one go, and files without faults are described."""

import numpy as np
import pytest
import trimesh
import yaml
from folders import fill
from PIL import Image
from shell import command

from gst.check.inputs import Asked, check_inputs
from gst.check.inspecting import inspect_file
from gst.config.patches import ScanFile
from gst.config.reading import asked_of_files, complete
from gstlib.io.plu import write_plu
from gstlib.surfaces.footprints import PatchPosition

SPACING = 0.01
CONFIG = complete(
    yaml.safe_load("""
square: {size_mm: 4.0, points_mm: [[3, 3, 4.9], [7, 3, 4.9], [3, 7, 4.9]]}
macroscale: {grid: 20, face_mm: 6.0}
counterface: {radius_mm: 50.0}
scans: {size_mm: 0.5, mould: {invert: false, flip: null}}
preprocessing: {maximum_unmeasured: 0.05}
reference_realisations: null
""")
)


def noise(seed, points=50):
    return 1e-3 * np.random.default_rng(seed).standard_normal((points, points))


def stone(halvings=5):
    box = trimesh.creation.box(extents=(20.0, 20.0, 10.0))
    for _ in range(halvings):
        box = box.subdivide()
    return box


@pytest.fixture
def folder(tmp_path):
    stone().export(tmp_path / "stone.stl")
    for seed, name in enumerate(("1_T0", "1_T1", "2_T0", "2_T1")):
        write_plu(tmp_path / f"{name}.plu", noise(seed), SPACING)
    return tmp_path


def problems_of(folder, uses=None, mesh="stone.stl", **settings):
    """The sentences of all problems, by default of all scans that lie there."""
    every = [(f"{n}_{epoch}", n, epoch) for n in "12" for epoch in ("T0", "T1")]
    every += [("face", "counterface", ""), ("again", "1", "repeat")]
    there = [ScanFile(folder / f"{name}.plu", *use) for name, *use in every]
    uses = uses or [scan for scan in there if scan.path.exists()]
    asked = Asked(**asked_of_files(CONFIG, "mm", None) | settings)
    inputs = check_inputs(mesh and folder / mesh, uses, asked)
    return list(map(str, inputs.problems))


def test_every_problem_is_named_once(folder):
    assert problems_of(folder) == []
    (folder / "stone.stl").write_bytes(b"no mesh")
    (folder / "1_T0.plu").write_bytes(b"no scan")
    write_plu(folder / "1_T1.plu", noise(1)[:40], SPACING)
    heights = noise(1)
    heights[:10] = np.nan
    write_plu(folder / "2_T0.plu", heights, SPACING)
    problems = problems_of(folder)
    words = {
        "stone.stl": "STL",
        "1_T0.plu": "truncated",
        "1_T1.plu (patch 1 at T1)": "0.5 × 0.4 mm",
        "2_T0.plu (patch 2 at T0)": "20 %",
    }
    for problem, (name, word) in zip(problems, words.items(), strict=True):
        assert f"{folder}/{name}" in problem
        assert word in problem


@pytest.mark.parametrize(
    ("name", "heights", "spacing", "words"),
    [
        ("1_T1", noise(9, 100)[:, :50], (SPACING / 2, SPACING), "5 × 10 µm apart"),
        ("1_T1", 1e3 * noise(9), SPACING, "scans.unit"),
        # use and another calibration may do that
        ("1_T1", 3.0 * noise(9), SPACING, None),
        ("1_T1", noise(0), SPACING, "patch 1 at T0 and patch 1 at T1"),
        ("2_T0", noise(1), SPACING, "patch 1 at T1 and patch 2 at T0"),
        ("face", noise(9, 49), 0.5 / 49, "49 × 49 points"),
        ("again", noise(9), SPACING, None),
        ("again", noise(0), SPACING, "Leave t1 or repeat empty"),
    ],
)
def test_scans_that_do_not_go_together_are_refused(
    folder, name, heights, spacing, words
):
    write_plu(folder / f"{name}.plu", heights, spacing)
    problems = problems_of(folder)
    assert len(problems) == (words is not None)
    assert all(words in problem and f"{name}.plu" in problem for problem in problems)


def test_the_whole_square_needs_one_grid_and_the_memory(folder, monkeypatch):
    def is_named(**settings):
        problems = problems_of(folder, mesh=None, **settings)
        return "reference_realisations" in "".join(problems)

    assert not is_named(reference=True)
    with monkeypatch.context() as small:
        small.setattr(
            "os.sysconf", {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": 10}.__getitem__
        )
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
            uses.append(
                ScanFile(folder / f"{number}.plu", str(number), "T0", None, place)
            )
            write_plu(uses[-1].path, factor * heights, 0.04)
        return problems_of(
            folder, uses, scan_settings=CONFIG["scans"] | {"size_mm": 2.0}, **settings
        )

    return problems


@pytest.mark.parametrize(
    "halvings", [5, 6]
)  # edges of a third of a patch's side, and of a sixth
def test_scans_and_mesh_in_different_units(wavy, caplog, halvings):
    """Where both see the same waves, scans are as high as the mesh, and not a thousand times."""
    place = PatchPosition(2.0, 1.5)
    assert wavy(halvings, (place, 1.0)) == []
    (problem,) = wavy(halvings, (place, 1e3))
    assert "scans.unit" in problem
    caplog.clear()
    assert wavy(halvings, (place, 1e-3), placed=False) == []
    assert "scans.unit" in caplog.text


@pytest.mark.parametrize(
    ("factor", "mesh", "outcome"),
    [
        (1e-3, None, "fault"),
        (20.0, None, "warning"),
        (20.0, "stone.stl", "fault"),
        (6.0, "stone.stl", "warning"),
        (1.5, "stone.stl", "nothing"),
    ],
)
def test_one_scan_in_another_unit(wavy, folder, caplog, factor, mesh, outcome):
    """Its heights are compared with those of the others, whether the mesh shows them or not."""
    patches = [
        (PatchPosition(1.2, 2.0), 1.0),
        (PatchPosition(2.0, 2.0), factor),
        (PatchPosition(2.8, 2.0), 1.0),
    ]
    problems = wavy(5, *patches, mesh=mesh)
    assert ["2.plu" in problem for problem in problems] == [True] * (outcome == "fault")
    assert (f"{folder}/2.plu" in caplog.text) == (outcome == "warning")


# --- gst inspect ------------------------------------------------------------------------------


def test_facts_of_a_scan(tmp_path):
    """Noise of 1 µm on a plane, of which a hundredth was not measured."""
    y, x = np.mgrid[:50, :50]
    heights = 2e-5 * x - 2e-5 * y + noise(3)
    heights[:5, :5] = np.nan
    write_plu(tmp_path / "a.plu", heights, (2e-3, 1e-3))
    facts, level = inspect_file(tmp_path / "a.plu")
    assert (facts["size_x_mm"], facts["size_y_mm"]) == pytest.approx((0.05, 0.1))
    assert facts["unmeasured"] == pytest.approx(0.01)
    spread_um = 1e3 * float(level.std())  # without the plane
    assert (facts["Sq_um"], spread_um) == pytest.approx((1, 1), rel=0.05)
    tilt = facts["tilt_x_mrad"], facts["tilt_y_mrad"]
    assert tilt == pytest.approx((20, -10), rel=0.3)


def test_a_folder_is_inspected_as_far_as_it_can_be_read(folder):
    """With pictures that have the names of their files, in which nothing is a formula."""
    fill(folder, {"notes.pdf": "-", "bad.plu": "-"})
    (folder / "again").mkdir()
    (folder / "1_T0.plu").rename(folder / "again/1_T1.plu")
    (folder / "2_T0.plu").rename(folder / "P$_{$\\alpha^2.plu")
    result = command("inspect --pictures", folder / "seen", folder)
    assert result.exit_code == 2
    assert "bad.plu" in result.stderr
    assert "notes" not in result.output
    names = {
        "stone.stl",
        "P$_{$\\alpha^2.plu",
        "1_T1.plu",
        "again_1_T1.plu",
        "2_T1.plu",
    }
    assert {file.stem for file in (folder / "seen").iterdir()} == names
    for file in (folder / "seen").iterdir():
        pixels = np.asarray(Image.open(file).convert("L"))
        assert 0.05 < (pixels < 250).mean() < 0.95
