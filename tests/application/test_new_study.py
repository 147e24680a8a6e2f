"""`gst new FOLDER --mesh M --scans S`: what files tell is written, and the rest is asked."""

import shutil

import numpy as np
import pandas as pd
import pytest
import trimesh
import yaml
from scan_files import write_plu_at
from scipy.ndimage import gaussian_filter
from shell import command
from stones import TURN, rough_stone, taken

from gstlib.io.meshes import read_mesh
from gstlib.io.plu import write_plu
from gstlib.surfaces.frames import find_frame

SPACING = 0.0133  # mm
POINTS = 64
NEW = "new study --mesh stone.stl"


def run(words, code=0):
    result = command(words)
    assert result.exit_code == code, result.output
    return result.output


def ground(seed):
    """A rough surface, mm."""
    return 0.02 * gaussian_filter(
        np.random.default_rng(seed).normal(size=(POINTS, POINTS)), 1.5
    )


def used(surface, seed):
    """The same with its summits lost, and the noise of another scan."""
    noise = 2e-5 * np.random.default_rng(seed).normal(size=surface.shape)
    return np.minimum(surface, np.quantile(surface, 0.9)) + noise


def write_scan(path, heights, stage_mm=(0.0, 0.0), date=""):
    write_plu_at(path, heights, SPACING, stage_mm)
    path.write_bytes(date.encode() + path.read_bytes()[len(date) :])


def write_stone(path, longest=60.0):
    box = trimesh.creation.box(extents=(longest, 0.8 * longest, 0.2 * longest))
    for _ in range(5):
        box = box.subdivide()
    box.export(path)


@pytest.fixture
def lab(tmp_path, monkeypatch):
    """A folder with a mesh and an empty one for scans, in which commands run."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scans").mkdir()
    write_stone(tmp_path / "stone.stl", 64.0)
    return tmp_path


def by_word(place, epoch):
    return f"Stone_loc{place}_{('before', 'after')[epoch]}.plu"


def write_pairs(lab, name=by_word, sign=1, stages=3 * [(0.0, 0.0)], dates=("", "")):
    """Three places before and after use, named by a function of place and epoch."""
    for place in range(3):
        before = ground(place)
        for epoch, heights in enumerate((before, used(before, 10 + place))):
            path = lab / "scans" / name(place, epoch)
            write_scan(path, sign * heights, stages[place], dates[epoch])


def new(lab, options=""):
    """What is said, the config and the table of a study that is made anew."""
    shutil.rmtree(lab / "study", ignore_errors=True)
    text = run(f"{NEW} --scans scans {options}")
    config = yaml.safe_load((lab / "study/study.yaml").read_text())
    table = lab / "study/patches.csv"
    return text, config, pd.read_csv(table, sep=";", dtype=str, keep_default_na=False)


def places_of(rows):
    return rows[["x_mm", "y_mm"]].to_numpy(float)


def test_what_files_tell_is_written_and_the_rest_is_asked(lab):
    write_pairs(lab)
    (lab / "scans/notes.pdf").write_bytes(b"-")
    text, config, rows = new(lab)
    assert rows[["patch", "t0", "t1"]].values.tolist() == [
        [f"loc{n}", by_word(n, 0), by_word(n, 1)] for n in range(3)
    ]
    files = {"mesh": "../stone.stl", "mesh_unit": "mm", "scan_folder": "../scans"}
    assert config["inputs"] == files
    assert config["scans"]["size_mm"] == pytest.approx(POINTS * SPACING, rel=5e-3)
    assert config["scans"]["mould"]["invert"] is False
    assert "3 of 3 lost height" in text
    assert "notes.pdf" in text
    assert "exists already" in run(NEW, code=2)
    # refused by its keys before any file is read
    (lab / "stone.stl").unlink()
    refused = run("check study", code=2)
    assert "square.points_mm" in refused
    for key in ("load.force_N", "counterface.radius_mm", "material.young_2_MPa"):
        assert f"'{key}' is still TODO" in refused  # only the user knows it
    assert "x_mm in 3 lines from 2 to 4" in refused


def test_dates_in_the_files_tell_moulds_from_exchanged_epochs(lab):
    write_pairs(lab, sign=-1)
    text, config, _ = new(lab)
    assert config["scans"]["mould"]["invert"] == "TODO"
    assert "or t0 and t1 are exchanged" in text
    days = "Mon Apr 19 11:40:13 2021", "Tue May 18 11:40:13 2021"
    write_pairs(lab, sign=-1, dates=days)
    _, config, _ = new(lab)
    assert config["scans"]["mould"] == {"invert": True, "flip": "x"}
    write_pairs(lab, dates=days[::-1])
    text, _, rows = new(lab)
    assert rows.t1.str.startswith("TODO ").all()
    assert "later date" in text


def test_scans_that_do_not_show_what_their_names_say_are_asked(lab):
    write_pairs(
        lab, lambda place, epoch: by_word((1, 0, 2)[place] if epoch else place, epoch)
    )
    names = ["Stone_loc0_before_repeat.plu", "Stone_loc1_before_repeat.plu"]
    for name, place in zip(names, (0, 2), strict=True):
        write_scan(lab / "scans" / name, used(ground(place), 20))
    text, _, rows = new(lab)
    expected = [f"TODO {by_word(0, 1)}", f"TODO {by_word(1, 1)}", by_word(2, 1)]
    assert [*rows.t1] == expected
    assert f"{by_word(0, 1)} does not show the surface of {by_word(0, 0)}" in text
    assert [*rows["repeat"]] == [names[0], f"TODO {names[1]}", ""]
    assert f"{names[1]} is named as a repeat of {by_word(1, 0)}" in text


def test_the_stage_gives_the_distances_of_patches(lab):
    stages = np.array([(-40.0, 12.0), (-38.5, 12.25), (-39.0, 14.0)])
    write_pairs(lab, stages=stages)
    _, config, rows = new(lab)
    places = places_of(rows)
    np.testing.assert_allclose(places - places[0], stages - stages[0], atol=1e-4)
    assert config["square"] == {"size_mm": 5.0, "points_mm": "TODO"}
    half = POINTS * SPACING / 2
    assert half < places.min() < places.max() < 5 - half
    # not those of a stage that hardly moved
    write_pairs(lab, stages=[*stages[:2], (-38.4, 12.25)])
    _, _, rows = new(lab)
    assert {*rows.x_mm} == {"TODO"}


@pytest.mark.parametrize(
    ("longest", "unit"), [(60.0, "mm"), (0.06, "m"), (8.0, "TODO")]
)
def test_a_mesh_is_in_the_unit_that_makes_a_stone(lab, longest, unit):
    write_stone(lab / "stone.stl", longest)
    run(NEW)
    config = yaml.safe_load((lab / "study/study.yaml").read_text())
    assert config["inputs"]["mesh_unit"] == unit


def test_text_is_in_the_unit_that_makes_a_scan(lab):
    y, x = np.indices((POINTS, POINTS)).reshape(2, -1) * SPACING
    np.savetxt(
        lab / "scans/0_T0.xyz", np.transpose([x, y, ground(0).ravel()]), fmt="%.6f"
    )
    _, config, _ = new(lab)
    assert config["scans"]["unit"] == "mm"
    np.savetxt(lab / "scans/1_T0.csv", ground(1), delimiter=",", fmt="%.6f")
    _, config, _ = new(lab)
    assert config["scans"]["unit"] == config["scans"]["spacing_um"] == "TODO"
    assert (
        config["scans"]["size_mm"] == f"TODO {POINTS * SPACING:.3g}"
    )  # as of the other


def test_patches_are_cut_from_rectangles_that_contain_them(lab):
    """Rounding up the shorter side would leave no room for any patch."""
    for place in range(2):
        heights = np.tile(ground(place), (1, 2))[:, :81]
        write_scan(lab / f"scans/{place}_T0.plu", heights)
    _, config, rows = new(lab)
    assert config["scans"]["size_mm"] == 0.851  # of 0.8512
    assert {*rows.crop_x_mm, *rows.crop_y_mm} == {"0"}


def test_scans_are_found_on_an_overview_and_it_on_the_mesh(lab):
    heights = rough_stone(lab / "stone.stl")
    centres = np.array([(9.1, 13.2), (10.4, 12.1), (9.6, 11.8)])
    larger = taken(heights, (9.75, 12.5), 40.0, 2.8, 0.02, mirrored=True)
    write_plu(lab / "overview.plu", larger, 0.02)
    for patch, centre in enumerate(centres):
        scan = taken(heights, centre, 40.0, 0.85, SPACING, mirrored=True)
        write_scan(lab / f"scans/{patch}_T0.plu", scan)
    write_scan(lab / "scans/3_T0.plu", used(0 * ground(0), 3))
    text, config, rows = new(lab, "--overview overview.plu")
    assert rows.x_mm[3] == "TODO"  # it is smooth and shows no place
    assert "3: not found" in text
    rows = rows[:3]
    # the square is the map's
    assert rows.rotation_deg.astype(float).abs().max() < 1
    assert config["scans"]["mould"] == {"invert": False, "flip": "x"}
    assert 1 <= config["uncertainty"]["placement_um"] < 40
    stone = read_mesh(lab / "stone.stl", unit="mm")
    frame = find_frame(config["square"]["points_mm"], stone, size_mm=5.0)
    on_stone = np.array(frame.origin) + places_of(rows) @ frame.axes[:2]
    x, y, _ = (on_stone @ TURN[:3, :3]).T  # where they were scanned
    np.testing.assert_allclose(np.transpose([y, x]), centres, atol=0.04)
