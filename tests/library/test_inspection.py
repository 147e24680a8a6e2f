"""`gst inspect`: facts of scans and meshes, thumbnails, and what it says of bad files."""

import json
import math

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from gstlib.cli import main
from gstlib.inspection import (
    held_height,
    inspect_file,
    mesh_facts,
    scan_facts,
    text_thumbnail,
)
from gstlib.io.plu import write_plu
from gstlib.surface import make_surface

TILT_X, TILT_Y = 2e-3, -1e-3


def tilted(ny=40, nx=60, spacing=1.66e-3):
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:ny, :nx] * spacing
    return TILT_X * x + TILT_Y * y + 1e-4 * rng.standard_normal((ny, nx))


@pytest.fixture
def scan_file(tmp_path):
    heights = tilted()
    heights[:4, :6] = math.nan
    write_plu(tmp_path / "a.plu", heights, (1.66e-3, 1.66e-3))
    return tmp_path / "a.plu"


def test_facts_of_a_scan(scan_file):
    facts, level = inspect_file(scan_file)
    assert (facts["points_x"], facts["points_y"]) == (60, 40)
    assert facts["spacing_x_um"] == pytest.approx(1.66)
    assert facts["size_x_mm"] == pytest.approx(60 * 1.66e-3)
    assert facts["unmeasured"] == pytest.approx(24 / 2400)
    assert facts["Sq_um"] == pytest.approx(0.1, rel=0.05)
    assert facts["tilt_x_mrad"] == pytest.approx(TILT_X * 1e3, abs=0.1)
    assert facts["tilt_y_mrad"] == pytest.approx(TILT_Y * 1e3, abs=0.1)
    assert facts["objective"]
    assert facts["unit"] == "in the file"
    assert level.shape == (40, 60)


def test_sq_does_not_see_a_plane():
    flat, steep = (
        scan_facts(make_surface(tilted() + slope * np.arange(60), 1.66e-3)) for slope in (0, 1e-2)
    )
    assert steep["Sq_um"] == pytest.approx(flat["Sq_um"])


def test_facts_of_a_mesh(tmp_path):
    box = trimesh.creation.box(extents=(30.0, 20.0, 10.0))
    box.export(tmp_path / "a.stl")
    facts, relief = inspect_file(tmp_path / "a.stl")
    assert (facts["vertices"], facts["faces"], facts["bodies"]) == (8, 12, 1)
    assert [facts[f"size_{axis}_mm"] for axis in "xyz"] == pytest.approx([30, 20, 10])
    assert facts["closed"] == "yes"
    assert mesh_facts(box.slice_plane([0, 0, 0], [0, 0, 1]))["closed"] == "no"
    assert float(relief.max()) == pytest.approx(10)  # seen along the shortest side
    inches, _ = inspect_file(tmp_path / "a.stl", unit="in")
    assert inches["size_x_mm"] == pytest.approx(30 * 25.4)


def test_thumbnail_has_high_points_dark_and_holes_marked():
    heights = np.add.outer(np.zeros(32), np.arange(64.0))
    heights[:, :16] = math.nan
    lines = text_thumbnail(make_surface(heights, 1.0), width=32).splitlines()
    assert len(lines) == 8
    assert all(len(line) == 32 for line in lines)
    assert lines[0].startswith("·" * 8 + " ")
    assert lines[0].endswith("█")


def run(*arguments):
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def test_command_shows_the_facts(scan_file, tmp_path):
    result = run("inspect", scan_file, "--picture", tmp_path / "a.png")
    assert result.exit_code == 0, result.output
    assert "points_x" in result.output
    assert "█" in result.output
    assert (tmp_path / "a.png").stat().st_size > 1000


def test_command_speaks_json_and_goes_on_after_a_bad_file(scan_file, tmp_path):
    (tmp_path / "bad.plu").write_bytes(b"nothing")
    result = run("inspect", "--json", tmp_path / "bad.plu", scan_file)
    assert result.exit_code == 1
    assert "bad.plu: 7 bytes are less than a .plu header" in result.stderr
    (line,) = result.stdout.splitlines()
    assert json.loads(line)["points_y"] == 40


def test_picture_is_a_png_by_its_name_too(scan_file, tmp_path):
    result = run("inspect", scan_file, "--picture", tmp_path / "a.jpg")
    assert result.exit_code == 2
    assert "name it .png, not 'a.jpg'" in result.stderr
    assert not (tmp_path / "a.jpg").exists()


def test_matrix_and_scattered_points_ask_for_the_spacing(tmp_path):
    np.savetxt(tmp_path / "a.txt", np.random.default_rng(1).normal(size=(9, 9)))
    assert "that is --unit." in run("inspect", tmp_path / "a.txt").stderr
    assert "that is --spacing-um." in run("inspect", "--unit", "um", tmp_path / "a.txt").stderr
    np.savetxt(tmp_path / "a.xyz", np.random.default_rng(1).uniform(size=(50, 3)))
    assert "that is --spacing-um." in run("inspect", "--unit", "um", tmp_path / "a.xyz").stderr
    result = run("inspect", "--unit", "um", "--spacing-um", "2", tmp_path / "a.txt")
    assert result.exit_code == 0, result.output


def test_text_without_a_unit_asks_for_one(tmp_path):
    rows, columns = np.indices((20, 30))
    points = np.stack([2.0 * columns, 2.0 * rows, rows % 3], axis=-1).reshape(-1, 3)
    np.savetxt(tmp_path / "a.xyz", points)
    assert "that is --unit." in run("inspect", tmp_path / "a.xyz").stderr
    result = run("inspect", "--unit", "um", tmp_path / "a.xyz")
    assert result.exit_code == 0, result.output
    assert "spacing_x_um  2\n" in result.output
    assert "um, as told" in result.output


class TestHeldHeight:
    @pytest.fixture
    def heights(self):
        return 1e-3 * np.random.default_rng(1).standard_normal((64, 64))

    @pytest.mark.parametrize("height_um", [0.0, -999.0])
    def test_unmeasured_points_stored_as_a_number(self, heights, height_um):
        heights.flat[::200] = height_um * 1e-3
        assert held_height(make_surface(heights, 0.01)) == pytest.approx((height_um, 21 / 4096))

    def test_measured_heights_in_few_steps_are_not_held(self, heights):
        for step in (0.0, 1e-6, 1e-4, 1e-3):
            coarse = np.round(heights / step) * step if step else heights
            assert held_height(make_surface(coarse, 0.01)) is None

    def test_what_is_not_measured_is_not_held(self, heights):
        heights[:] = np.nan
        assert held_height(make_surface(heights, 0.01)) is None
        heights[5:] = 1e-3  # a sheet of glass, or nothing at all
        assert held_height(make_surface(heights, 0.01)) == pytest.approx((1.0, 59 / 64))
