"""All that is wrong with a study's files is found in one go, and what is right is described."""

import numpy as np
import pytest
import trimesh

from gstlib.errors import InputsError
from gstlib.inputs import ScanFile, check_inputs
from gstlib.io.plu import write_plu

SPACING = 0.01
SETTINGS = {
    "mesh_unit": "mm",
    "square": {
        "size_mm": 4.0,
        "frame": {
            "origin_mm": [3.0, 3.0, 5.0],
            "x_axis": [1.0, 0.0, 0.0],
            "normal": [0.0, 0.0, 1.0],
            "points_mm": None,
            "marker": None,
        },
    },
    "macroscale": {"grid": 20, "margin_mm": 0.5},
    "scan_settings": {
        "size_mm": 0.5,
        "unit": None,
        "spacing_um": None,
        "scatter_spacing_um": None,
        "scatter_extent_mm": None,
        "mould": {"invert": False, "flip": None},
    },
    "maximum_unmeasured": 0.05,
}


@pytest.fixture
def folder(tmp_path):
    stone = trimesh.creation.box(extents=(20.0, 20.0, 10.0))
    stone.subdivide().subdivide().export(tmp_path / "stone.stl")
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
    found = check_inputs(folder / "stone.stl", scans(folder), **SETTINGS)
    assert found.problems == ()
    found.raise_problems()
    assert found.square.shape == (20, 20)
    assert list(found.scans.patch + found.scans.epoch) == ["1T0", "1T1", "2T0", "2T1"]
    assert (found.scans.points_x == 50).all()
    assert found.scans.spacing_x_um.to_numpy() == pytest.approx(10)
    assert found.mesh["size_z_mm"] == pytest.approx(10)
    assert len(found.ranges_um) == 4
    assert 6 < min(found.ranges_um) <= max(found.ranges_um) < 9  # of 2500 normal numbers


def test_every_problem_is_named_once(folder):
    (folder / "stone.stl").write_bytes(b"no mesh")
    (folder / "1_T0.plu").write_bytes(b"no scan")
    write_plu(folder / "1_T1.plu", 1e-3 * np.random.default_rng(1).random((50, 70)), SPACING)
    holes = 1e-3 * np.random.default_rng(1).random((50, 50))
    holes[:10] = np.nan
    write_plu(folder / "2_T0.plu", holes, SPACING)
    found = check_inputs(folder / "stone.stl", scans(folder), **SETTINGS)
    assert found.square is None
    assert list(found.scans.patch + found.scans.epoch) == ["2T1"]
    with pytest.raises(InputsError) as caught:
        found.raise_problems()
    message = str(caught.value)
    assert message.startswith("4 problems\n  - ")
    for name, problem in [
        ("stone.stl", "STL"),
        ("1_T0.plu", "less than a .plu header"),
        ("1_T1.plu", "0.7 × 0.5 mm"),
        ("2_T0.plu", "20 % of the points are unmeasured"),
    ]:
        (line,) = [line for line in message.splitlines() if name in line]
        assert problem in line


def test_one_problem_is_said_without_a_list(folder):
    (folder / "2_T1.plu").unlink()
    found = check_inputs(folder / "stone.stl", scans(folder), **SETTINGS)
    with pytest.raises(InputsError, match=r"2_T1\.plu: no such file"):
        found.raise_problems()


def test_scans_are_looked_at_without_a_mesh(folder):
    (folder / "1_T0.plu").write_bytes(b"no scan")
    found = check_inputs(None, scans(folder), **SETTINGS)
    assert (found.mesh, found.square) == (None, None)
    (problem,) = found.problems
    assert "1_T0.plu" in str(problem)


def test_a_scan_is_read_once_for_all_its_pieces(folder, monkeypatch):
    import gstlib.inputs

    read = []
    whole = gstlib.inputs.read_scan
    monkeypatch.setattr(
        gstlib.inputs, "read_scan", lambda path, **k: read.append(path) or whole(path, **k)
    )
    large = folder / "large.plu"
    write_plu(large, 1e-3 * np.random.default_rng(1).random((120, 120)), SPACING)
    pieces = [ScanFile(large, str(k), "T0", (0.3 * k, 0.0)) for k in (-1, 0, 1, 2)]
    found = check_inputs(folder / "stone.stl", pieces, **SETTINGS)
    assert read == [large]
    assert list(found.scans.patch) == ["-1", "0", "1"]
    (problem,) = found.problems
    assert "sticks out" in str(problem)


def test_both_epochs_need_one_spacing(folder):
    write_plu(folder / "1_T1.plu", 1e-3 * np.random.default_rng(1).random((100, 100)), SPACING / 2)
    (problem,) = check_inputs(folder / "stone.stl", scans(folder), **SETTINGS).problems
    assert "1_T1.plu" in str(problem)
    assert "5 µm apart" in str(problem)
    assert "10 µm" in str(problem)


def test_one_height_of_many_points_is_warned_of_once(folder, caplog):
    for seed, name in enumerate(("1_T0", "2_T1")):
        heights = 1e-3 * np.random.default_rng(seed).standard_normal((50, 50))
        heights.flat[::100] = -0.999
        write_plu(folder / f"{name}.plu", heights, SPACING)
    found = check_inputs(folder / "stone.stl", scans(folder), **SETTINGS)
    assert found.problems == ()
    (warning,) = caplog.messages
    assert "1_T0.plu and 1 more: up to 1 % of the points" in warning
    assert "-999 µm" in warning


def test_a_counterface_needs_the_points_of_the_patches(folder):
    for points, count in ((50, 0), (49, 1)):
        face = ScanFile(folder / f"face{points}.plu", "counterface", "")
        heights = 1e-3 * np.random.default_rng(9).standard_normal((points, points))
        write_plu(face.path, heights, 0.5 / points)
        problems = check_inputs(folder / "stone.stl", [*scans(folder), face], **SETTINGS).problems
        assert len(problems) == count
    assert "face49.plu: the counterface has 49 × 49 points" in str(problems[0])
    assert "1_T0.plu has 50 × 50 points" in str(problems[0])


def test_both_epochs_with_the_same_heights_are_refused(folder):
    (folder / "1_T1.plu").write_bytes((folder / "1_T0.plu").read_bytes())
    both = ScanFile(folder / "2_T0.plu", "2", "T1")
    uses = [*scans(folder)[:3], both]
    first, second = map(str, check_inputs(folder / "stone.stl", uses, **SETTINGS).problems)
    assert "1_T1.plu: patch 1 has the same heights at T1 as at T0 (" in first
    assert "1_T0.plu)" in first
    assert "2_T0.plu: patch 2 has the same heights at T1 as at T0, from this one file" in second
    assert "leave t1 empty" in second


def test_two_patches_with_the_same_heights_are_warned_of(folder, caplog):
    (folder / "2_T0.plu").write_bytes((folder / "1_T0.plu").read_bytes())
    assert check_inputs(folder / "stone.stl", scans(folder), **SETTINGS).problems == ()
    (warning,) = caplog.messages
    assert warning.startswith("patches 1, 2 have the same heights (")
    assert "2_T0.plu" in warning


def test_files_of_one_name_are_told_apart(folder):
    uses = []
    for epoch in ("T0", "T1"):
        path = folder / epoch / "7.plu"
        path.parent.mkdir()
        write_plu(path, 1e-3 * np.random.default_rng(len(uses)).random((50, 70)), SPACING)
        uses.append(ScanFile(path, "7", epoch))
    problems = check_inputs(folder / "stone.stl", uses, **SETTINGS).problems
    assert [str(problem).split(": ")[0] for problem in problems] == [
        f"{folder}/{epoch}/7.plu (patch 7 at {epoch})" for epoch in ("T0", "T1")
    ]
