"""`gst new FOLDER --mesh M --scans S`: what files tell is written, and the rest is asked."""

import shutil

import numpy as np
import pandas as pd
import pytest
import trimesh
import yaml
from click.testing import CliRunner
from gst.cli import main
from gst.config.reading import complete, config_problems, read_config
from gstlib.io.meshes import read_mesh
from gstlib.io.plu import write_plu
from gstlib.surfaces.frames import find_frame
from scan_files import write_plu_at
from scipy.ndimage import gaussian_filter
from stones import TURN, rough_stone, taken

SPACING = 0.0133  # mm
POINTS = 64


def run(*arguments, code=0):
    result = CliRunner().invoke(main, list(map(str, arguments)))
    assert result.exit_code == code, result.output
    return result.output


def ground(seed):
    """A rough surface, mm."""
    return 0.02 * gaussian_filter(np.random.default_rng(seed).normal(size=(POINTS, POINTS)), 1.5)


def used(surface, seed):
    """The same with its summits lost, and the noise of another scan."""
    noise = 2e-5 * np.random.default_rng(seed).normal(size=surface.shape)
    return np.minimum(surface, np.quantile(surface, 0.9)) + noise


def write_scan(path, heights, stage_mm=(0.0, 0.0), date=None):
    write_plu_at(path, heights, SPACING, stage_mm)
    if date:
        path.write_bytes(date.encode() + path.read_bytes()[24:])


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


def write_pairs(lab, name, sign=1, **options):
    """Three places before and after use, named by a function of place and epoch."""
    for place in range(3):
        before = ground(place)
        for epoch, heights in enumerate((before, used(before, 10 + place))):
            path = lab / "scans" / name(place, epoch)
            write_scan(path, sign * heights, **{k: of(place, epoch) for k, of in options.items()})


def new(lab, *options):
    """What is said, the config and the rows of a study that is made anew."""
    shutil.rmtree(lab / "study", ignore_errors=True)
    said = run("new", "study", "--mesh", "stone.stl", "--scans", "scans", *options)
    config = yaml.safe_load((lab / "study/study.yaml").read_text())
    table = pd.read_csv(lab / "study/patches.csv", sep=";", dtype=str, keep_default_na=False)
    return said, config, table.to_dict("records")


def by_word(place, epoch):
    return f"Stone_loc{place}_{('before', 'after')[epoch]}.plu"


def scans_of(rows):
    return [(row["patch"], row["t0"], row["t1"]) for row in rows]


def test_what_files_tell_is_written_and_the_rest_is_asked(lab, monkeypatch):
    write_pairs(lab, by_word)
    (lab / "scans/notes.pdf").write_bytes(b"-")
    said, config, rows = new(lab)
    expected = [(f"loc{n}", by_word(n, 0), by_word(n, 1)) for n in range(3)]
    assert scans_of(rows) == expected
    assert config["inputs"] == {
        "mesh": "../stone.stl",
        "mesh_unit": "mm",
        "scan_folder": "../scans",
    }
    assert config["scans"]["size_mm"] == pytest.approx(POINTS * SPACING, rel=5e-3)
    assert config["scans"]["mould"]["invert"] is False  # heights fell
    assert "3 of 3 lost height" in said
    assert "notes.pdf" in said
    # refused by its keys, from here or there, before any file is read
    (lab / "stone.stl").unlink()
    for where in ("study", "study/study.yaml"):
        refused = run("check", where, code=2)
        assert "square.points_mm" in refused
        assert "x_mm and y_mm in lines 2 to 4" in refused
        monkeypatch.chdir(lab)


def test_a_filled_in_study_has_no_problem(lab, monkeypatch):
    write_pairs(lab, by_word)
    new(lab)
    text = (lab / "study/study.yaml").read_text()
    assert "# of the stone that it was used against" in text  # comments are there
    corners = "[[2.5, -2.5, 6], [7.5, -2.5, 6], [2.5, 2.5, 6]]"
    (lab / "study/study.yaml").write_text(text.replace("points_mm: TODO", f"points_mm: {corners}"))
    table = (lab / "study/patches.csv").read_text().replace("TODO", "2,5")
    (lab / "study/patches.csv").write_text(table)
    monkeypatch.chdir(lab / "study")
    assert config_problems(read_config("study.yaml")) == []


def test_a_pattern_names_the_scans_where_words_do_not(lab):
    write_pairs(lab, lambda place, epoch: f"{place}{'ab'[epoch]}.plu")
    assert all("TODO" in row["t1"] for row in new(lab)[2])
    _, config, rows = new(lab, "--names", "{patch}{epoch}")
    assert scans_of(rows) == [(f"{n}", f"{n}a.plu", f"{n}b.plu") for n in range(3)]
    assert config["scans"]["mould"]["invert"] is False


def test_scans_of_two_instruments_that_cannot_be_compared_are_named(lab):
    for place in range(2):
        write_scan(lab / f"scans/E{place}_T0.plu", ground(place))
        write_plu(lab / f"scans/E{place}_T1.plu", ground(place)[::2, ::2], 2 * SPACING)
    said, _, rows = new(lab)
    assert scans_of(rows) == [(f"E{n}", f"E{n}_T0.plu", f"E{n}_T1.plu") for n in range(2)]
    assert "differ in spacing" in said
    assert "is found by its heights" not in said  # they were not compared


def test_dates_in_the_files_tell_moulds_from_exchanged_epochs(lab):
    write_pairs(lab, by_word, sign=-1)
    said, config, _ = new(lab)
    assert config["scans"]["mould"]["invert"] == "TODO"
    assert "or t0 and t1 are exchanged" in said
    days = "Mon Apr 19 11:40:13 2021", "Tue May 18 11:40:13 2021"
    write_pairs(lab, by_word, sign=-1, date=lambda _, epoch: days[epoch])
    assert new(lab)[1]["scans"]["mould"] == {"invert": True, "flip": "x"}
    write_pairs(lab, by_word, date=lambda _, epoch: days[1 - epoch])
    said, _, rows = new(lab)
    assert all(t1.startswith("TODO ") for _, _, t1 in scans_of(rows))
    assert "later date" in said


def test_scans_that_do_not_show_what_their_names_say_are_asked(lab):
    write_pairs(lab, by_word)
    scans = lab / "scans"
    (scans / by_word(0, 1)).rename(scans / "kept")
    (scans / by_word(1, 1)).rename(scans / by_word(0, 1))
    (scans / "kept").rename(scans / by_word(1, 1))
    said, _, rows = new(lab)
    doubtful = [f"TODO {by_word(n, 1)}" for n in range(2)]
    assert [t1 for _, _, t1 in scans_of(rows)] == [*doubtful, by_word(2, 1)]
    assert f"{by_word(0, 1)} shows the place of {by_word(1, 0)}" in said


def test_a_larger_map_after_use_is_found_on_the_smaller_one(lab):
    """It has points enough for a coarser search, and the smaller one has not."""
    rough = 0.02 * gaussian_filter(np.random.default_rng(3).normal(size=(300, 300)), 3)
    write_scan(lab / "scans/1_T0.plu", rough[60:260, 40:240])
    write_scan(lab / "scans/1_T1.plu", used(rough, 4))
    assert "1_T1.plu  by name and heights" in new(lab)[0]


PLACES = [(-40.0, 12.0), (-38.5, 12.25), (-39.0, 14.0)]


def test_the_stage_gives_the_distances_of_patches(lab):
    write_pairs(lab, by_word, stage_mm=lambda place, _: PLACES[place])
    _, config, rows = new(lab)
    given = np.array([[float(row["x_mm"]), float(row["y_mm"])] for row in rows])
    np.testing.assert_allclose(given - given[0], np.subtract(PLACES, PLACES[0]), atol=1e-4)
    assert config["square"] == {"size_mm": 5.0, "points_mm": "TODO"}
    half = POINTS * SPACING / 2
    assert half < given.min() < given.max() < 5 - half


def test_one_stage_for_different_patches_is_no_place(lab):
    write_pairs(lab, by_word, stage_mm=lambda *_: PLACES[0])
    said, _, rows = new(lab)
    assert {row["x_mm"] for row in rows} == {"TODO"}
    assert "the same for different places" in said


@pytest.mark.parametrize(
    ("longest", "unit"), [(60.0, "mm"), (0.06, "m"), (6e4, "um"), (8.0, "TODO"), (25.0, "TODO")]
)
def test_a_mesh_is_in_the_unit_that_makes_a_stone(lab, longest, unit):
    write_stone(lab / "stone.stl", longest)
    said = run("new", "study", "--mesh", "stone.stl")
    config = yaml.safe_load((lab / "study/study.yaml").read_text())
    assert config["inputs"]["mesh_unit"] == unit
    assert ("its unit not stated" in said) == (unit == "TODO")
    config["square"]["points_mm"] = [[0, 0, 6], [5, 0, 6], [0, 5, 6]]
    problems = config_problems(complete(config))  # the study proposes where to scan
    assert [problem.split("'")[1] for problem in problems] == ["inputs.mesh_unit"] * (
        unit == "TODO"
    )


def test_text_is_in_the_unit_that_makes_a_scan(lab):
    y, x = np.indices((POINTS, POINTS)).reshape(2, -1) * SPACING
    for place in (0, 1):
        points = np.transpose([x, y, ground(place).ravel()])
        np.savetxt(lab / f"scans/{place}_T0.xyz", points, fmt="%.6f")
    assert new(lab)[1]["scans"]["unit"] == "mm"
    np.savetxt(lab / "scans/2_T0.csv", ground(1), delimiter=",", fmt="%.6f")
    scans = new(lab)[1]["scans"]
    assert [scans[key] for key in ("unit", "spacing_um")] == 2 * ["TODO"]
    assert scans["size_mm"] == f"TODO {POINTS * SPACING:.3g}"  # as of the other
    write_plu(lab / "scans/overview.plu", np.tile(ground(1), (3, 3)), SPACING)
    assert "overview.plu, once the units" in new(lab)[0]


def test_maps_that_are_not_square_are_cut(lab):
    write_scan(lab / "scans/1_T0.plu", ground(0)[:48])
    _, config, rows = new(lab)
    assert config["scans"]["size_mm"] == pytest.approx(48 * SPACING, abs=1e-3)
    assert (rows[0]["crop_x_mm"], rows[0]["crop_y_mm"]) == ("0", "0")


CENTRES = {"1": (9.1, 13.2), "2": (10.4, 12.1), "3": (9.6, 11.8)}


def distances(at):
    """Of each two places."""
    return np.linalg.norm(at[:, np.newaxis] - at, axis=-1)


def test_scans_are_found_on_an_overview_and_it_on_the_mesh(lab):
    heights = rough_stone(lab / "stone.stl")
    larger = taken(heights, (9.8, 12.5), 40.0, 3.6, 0.02, mirrored=True)
    write_plu(lab / "scans/overview.plu", larger, 0.02)
    for patch, centre in CENTRES.items():
        write_scan(lab / f"scans/{patch}_T0.plu", taken(heights, centre, 40.0, 0.85, SPACING, True))
    flat = 1e-4 * np.random.default_rng(3).normal(size=(POINTS, POINTS))
    write_scan(lab / "scans/4_T0.plu", flat)
    said, config, rows = new(lab)
    *rows, smooth = rows
    assert smooth["x_mm"] == "TODO"  # it shows no place
    assert "4: not found" in said
    found = np.array([[float(row[axis]) for axis in ("y_mm", "x_mm")] for row in rows])
    expected = distances(np.array([*CENTRES.values()]))
    np.testing.assert_allclose(distances(found), expected, atol=0.01)
    assert all(abs(float(row["rotation_deg"])) < 1 for row in rows)  # the square is the map's
    assert config["scans"]["mould"] == {"invert": False, "flip": "x"}
    assert 1 <= config["uncertainty"]["placement_um"] < 40
    stone = read_mesh(lab / "stone.stl", unit="mm")
    frame = find_frame(config["square"]["points_mm"], stone, size_mm=5.0)
    on_stone = np.array(frame.origin) + found[:, ::-1] @ frame.axes[:2]
    x, y, _ = (on_stone @ TURN[:3, :3]).T  # where they were scanned
    np.testing.assert_allclose(np.transpose([y, x]), [*CENTRES.values()], atol=0.04)


def test_an_overview_of_another_stone_gives_no_place(lab):
    heights = rough_stone(lab / "stone.stl")
    other = taken(heights[::-1, ::-1].T[::3, ::3], (3.8, 4.5), 0.0, 3.6, 0.02)
    write_plu(lab / "overview.plu", other, 0.02)
    for patch, centre in CENTRES.items():
        write_scan(lab / f"scans/{patch}_T0.plu", taken(heights, centre, 0.0, 0.85, SPACING))
    said, config, rows = new(lab, "--overview", "overview.plu")
    assert {row["x_mm"] for row in rows} == {"TODO"}
    assert config["square"]["points_mm"] == "TODO"
    assert "overview.plu, on the mesh: not found" in said


def test_a_study_is_not_overwritten(lab):
    write_pairs(lab, by_word)
    new(lab)
    assert "exists already" in run("new", "study", "--mesh", "stone.stl", code=2)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--scans", "scans"], "needs the --mesh"),
        (["--like", "own", "--mesh", "stone.stl"], "not both"),
        (["--mesh", "gone.stl"], "gone.stl: no such file"),
        (["--mesh", "stone.stl", "--scans", "gone"], "gone: no such file or folder"),
        (["--mesh", "stone.stl", "--scans", "scans"], "holds no scan"),
    ],
)
def test_what_cannot_be_set_up(lab, options, said):
    assert said in run("new", "study", *options, code=2)


def test_a_folder_with_a_blank_is_quoted(lab):
    assert "cd 'Stein 1'" in run("new", "Stein 1")
