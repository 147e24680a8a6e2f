"""The configuration: every fault is found, and reported with key, value and remedy."""

import copy
import math
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml
from gst import SHIPPED
from gst.config.contradictions import counterface_mesh
from gst.config.named_files import check_files
from gst.config.reading import (
    asked_of_files,
    complete,
    config_problems,
    read_config_file,
    read_study,
    refuse_study,
)
from gst.config.user_tables import rows_of
from gstlib.conditions import study_poisson
from gstlib.errors import ConfigError, InputsError
from gstlib.settings import json_schema
from snakemake.utils import update_config

ROOT = Path(__file__).parents[2]
POINTS = [[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.0, 5.0, 0.0]]
SMALL = (np.array(POINTS) / 1000).tolist()
SECOND = {"mesh": "b.ply", "pose": {"matrix": np.eye(4).tolist()}}
INTERLAYER = {"young_MPa": 300.0, "poisson": 0.3, "thickness_um": 300.0}
INPUTS = {"mesh": "a", "mesh_unit": "mm", "scan_folder": "b"}


@pytest.fixture
def config(monkeypatch):
    monkeypatch.chdir(ROOT)
    return yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))


def changed(config, path, value):
    """A copy with the key `path` replaced."""
    *sections, key = path.split(".")
    section = result = copy.deepcopy(config)
    for name in sections:
        section = section[name]
    section[key] = value
    return result


def impossible(config, path, value):
    """The one problem with a config whose key `path` takes a value that no config may have."""
    (problem,) = config_problems(changed(config, path, value))
    assert problem.startswith(f"'{path}")
    assert len(problem) < 300
    return problem


def leaves(section, prefix=""):
    """Every key that is no section, by its full name, and its value."""
    for key, value in section.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def test_the_keys_stay_few():
    """Counted with every alternative."""
    count = runpy.run_path(str(ROOT / "workflow/document.py"))["leaves"]
    assert len(count(json_schema())) <= 91


def test_every_key_is_typed(config):
    """Each key in turn takes an impossible value."""
    for path, _ in leaves(config):
        spoiled = config_problems(changed(config, path, {"not": "this"}))
        assert spoiled[0].startswith(f"'{path}")
    without = config | {"specimen": None, "inputs": {"mesh": "a", "scan_folder": "b"}}
    assert "'inputs' lacks ['mesh_unit']" in config_problems(without)[0]


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 10**30], ids="abcd")
def test_numbers_are_finite(config, value):
    """Each key in turn; NaN is within any bounds that are tested by comparing."""
    config["counterface"] = SECOND | {"radius_mm": 200.0}
    config |= {"interlayer": INTERLAYER, "gesture": {"load_point_scatter_mm": 1.0, "poses": 5}}
    for path, _ in leaves(config):
        assert "give a finite number" in impossible(config, path, value)
    (corner,) = config_problems(changed(config, "square.points_mm", [[0, value, 0], *POINTS[1:]]))
    assert corner.startswith("'square.points_mm.0.1' is ")


def test_the_template_states_every_default(config):
    """config/config.yaml, which users read, and the schema, from which the defaults are taken."""
    whole = complete({})
    stated, taken = dict(leaves(config)), dict(leaves(whole))
    assert stated == taken
    assert list(stated) == list(taken)


@pytest.mark.parametrize("name", SHIPPED)
def test_defaults_come_in_as_snakemake_merges_the_template(config, name):
    given = yaml.safe_load((ROOT / f"config/{name}.yaml").read_text(encoding="utf-8"))
    before = copy.deepcopy(given)
    whole = complete(given)
    update_config(config, given)
    assert whole == complete(config)
    assert given == before


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("inputs", INPUTS, "give exactly one of"),
        ("inputs", INPUTS | {"mesh_unit": "feet"}, "'inputs.mesh_unit' is 'feet'"),
        ("square.points_mm", [*POINTS[:2], [9.0, 0.0, 0.0]], "in line"),
        ("scans.size_mm", 6.0, "must fit"),
        ("material.young_1_MPa", 19.5, "1 GPa is 1000 MPa"),
        ("results", ".", "contains the working folder"),
        ("results", "config", "contains the patch table (config/patches.tsv)"),
        ("patches", "nowhere.tsv", "'patches': nowhere.tsv does not exist: correct the path"),
        ("patches", "{nowhere}.tsv", "contains braces"),
        ("accept", ["placemnt:1"], "no fault has that name: did you mean placement? write one of"),
        ("pressure_cap_MPa", 22.0, "not above the mean pressure on the square, 22 MPa"),
        ("texture.l_filter_um", 8.0, "no wave passes both filters"),
        (
            "interlayer",
            INTERLAYER | {"young_MPa": 19500.0},
            "'interlayer.young_MPa' is 19500, not below the stones'",
        ),
        ("counterface", {"mesh_unit": "mm"}, "'counterface.mesh_unit' needs 'counterface.mesh'"),
        ("counterface", {"mesh": "b.ply"}, "'counterface.mesh' needs 'counterface.pose'"),
        ("counterface", SECOND | {"radius_mm": 200.0}, "a radius and a mesh: give one of them"),
        ("counterface.radius_mm", [200.0, 0.5], "'counterface.radius_mm.1' is 0.5"),
        ("counterface", {"angle_deg": 30.0}, "'counterface.angle_deg' needs"),
        ("load.pressure_MPa", 22.0, "'load' has both of force_N and pressure_MPa"),
        ("load.force_N", None, "'load' has neither of force_N and pressure_MPa"),
        ("load.force_N", 5e6, "'load.force_N' is 5000000.0"),  # 5 MN
        ("load.at_mm", [10.1, 2.5], "outside the face, which reaches from -5 to 10 mm"),
        ("load.at_mm", [2.5, -5.0], "'load.at_mm' is [2.5, -5.0], outside the face"),
        ("macroscale.face_mm", 4.0, "'macroscale.face_mm' is 4, less than the square's 5 mm"),
        ("results", "my results", "letters without accents, digits, and . _ - /"),
        ("microscale.tolerance", "1e-9", "such as 20 or 1.0e-9) ["),
        ("colour", "blue", "unknown keys ['colour']"),
        ("macroscale.steppes", 3, "did you mean steps for steppes?"),
        ("gesture", {"table": "a.tsv", "poses": 5}, "give a table, or poses with stroke_mm or"),
        (
            "gesture",
            {"stroke_mm": 2.0, "load_point_scatter_mm": 1.0, "poses": 5},
            "give one of them",
        ),
        ("gesture", {"stroke_mm": 2.0}, "'gesture.stroke_mm' needs 'gesture.poses'"),
        (
            "gesture",
            {"load_point_scatter_mm": 2.0},
            "'gesture.load_point_scatter_mm' needs 'gesture.poses'",
        ),
        # what can be used
        ("gesture", {"stroke_mm": 2.0, "poses": 5}, None),
        ("gesture", {"load_point_scatter_mm": 1.0, "poses": 5}, None),
        ("gesture", {"table": "a.tsv"}, None),
        ("grinding", None, None),
        ("load", {"force_N": None, "pressure_MPa": 22.0, "at_mm": None}, None),
        ("load.at_mm", [9.9, -4.9], None),
        ("macroscale.face_mm", 5.0, None),
        ("counterface", {"scan": "a.plu", "radius_mm": 50.0}, None),
        ("counterface", SECOND | {"scan": "a.plu", "mesh_unit": "cm"}, None),
        ("counterface", {"radius_mm": [169.0, 108.0], "angle_deg": 30.0}, None),
        ("counterface", None, None),
        ("interlayer", INTERLAYER, None),
        ("uncertainty.load_point_mm", 0.0, None),
        ("uncertainty.radius_log_sd", 0.0, None),
    ],
)
def test_a_value_and_what_is_wrong_with_it(config, path, value, words):
    found = config_problems(changed(config, path, value))
    assert found == [] if words is None else words in "\n".join(found)


def test_what_is_given_takes_the_place_of_a_default():
    given = {
        "grinding": {"friction": 0.3},
        "counterface": SECOND,
        "scans": {"mould": {"invert": False}},
        "square": 5,  # not a section
        "pressure_cap_MPa": None,
    }
    whole = complete(given)
    assert whole["grinding"] == {"friction": 0.3, "tangential_ratio": 0.5}
    assert counterface_mesh(whole, "") == SECOND | {"mesh_unit": "mm"}
    assert complete({"load": {"pressure_MPa": 22.0}})["load"]["force_N"] is None
    assert whole["scans"]["mould"] == {"invert": False, "flip": "x"}
    assert (whole["scans"]["size_mm"], whole["pressure_cap_MPa"]) == (0.85, None)
    (problem,) = config_problems(whole)
    assert problem.startswith("'square' is 5: 5 is not of type 'object'")
    complete({})["square"]["points_mm"][0][0] = 9.0  # of a default nothing is shared
    assert complete({})["square"]["points_mm"][0][0] == 2.5


@pytest.mark.parametrize(
    ("path", "value", "name"),
    [
        ("load.force_N", 4e4, "pressure"),
        ("square.size_mm", 5.6, "square"),
        ("square.points_mm", SMALL, "square"),
        ("interlayer", INTERLAYER | {"thickness_um": 1.5}, "interlayer"),
        ("scans.size_mm", 3.0, "overlap"),
    ],
)
def test_what_is_improbable_can_be_accepted(config, tmp_path, path, value, name):
    table = tmp_path / "patches.csv"
    table.write_text("patch,x_mm,y_mm\na,1.5,2.5\nb,2.5,2.5\n")
    study = changed(config, path, value) | {"patches": str(table), "published": None}
    with pytest.raises(InputsError, match=rf"accept: \[{name}"):
        read_study(study, "study.yaml")
    assert len(read_study(study | {"accept": [name]}, "study.yaml")) == 2
    if name == "overlap":  # of the later of two patches
        assert len(read_study(study | {"accept": ["overlap:b"]}, "study.yaml")) == 2


def test_decimal_commas(config):
    """YAML takes a number with one for text, and in a list for two numbers."""
    points = yaml.safe_load("[[2,5, 2,5, 0,0], [1, 2, 3], [0, 1, 2]]")
    steps, corner = config_problems(
        changed(changed(config, "square.points_mm", points), "microscale.steps", "2,5")
    )
    assert steps.startswith("'microscale.steps' is '2,5'")
    assert "with a point" in steps
    assert corner.startswith("'square.points_mm.0' is ")
    assert "decimal points, not commas" in corner


def test_the_square_alone_knows_no_active_tool_and_no_gesture(config):
    """Nor does it care for the face, and where in it the force acts."""
    alone = config | {"coupling": "paper"}
    assert config_problems(alone) == []
    (second,) = config_problems(alone | {"counterface": SECOND})
    assert "'counterface.mesh' (or specimen.counterface_seed) needs a stone at rest" in second
    made = alone["specimen"] | {"counterface_seed": 8}
    assert config_problems(alone | {"specimen": made}) == [second]
    (moved,) = config_problems(alone | {"gesture": {"load_point_scatter_mm": 1.0, "poses": 5}})
    assert "'gesture' needs a stone at rest" in moved
    both = {"counterface": SECOND, "gesture": {"table": "poses.tsv"}, "interlayer": INTERLAYER}
    assert "cannot wear a stone together" in "".join(config_problems(config | both))
    for name in ("gesture", "interlayer"):
        for law in ({"exponent": 2.0}, {"threshold_MPa": 5.0}):
            other = changed(config, name, both[name]) | {"wear_law": config["wear_law"] | law}
            assert "'wear_law' is not Archard's" in "".join(config_problems(other))
            assert not config_problems(other | {name: None})
    small = changed(changed(alone, "macroscale.face_mm", 4.0), "load.at_mm", [50.0, 0.0])
    assert config_problems(small) == []
    # the whole square is not pressed at the scans' resolution, which takes one grid and memory
    asked = [asked_of_files(of, "mm", None)["reference"] for of in (config, alone)]
    assert asked == [True, False]


def test_strikes_that_are_inferred_stay_on_the_face_and_include_the_gesture(config):
    face_mm = config["macroscale"]["face_mm"]
    widest = config["use"] | {"scatter_mm": face_mm / 2, "stroke_mm": face_mm}
    assert config_problems(config | {"use": widest}) == []
    for key, most_mm in (("scatter_mm", face_mm / 2), ("stroke_mm", face_mm)):
        impossible(config, f"use.{key}", 1.01 * most_mm)
    for key, gesture in (
        ("scatter_mm", {"load_point_scatter_mm": 1.0, "poses": 5}),
        ("stroke_mm", {"stroke_mm": 2.0, "poses": 5}),
    ):
        impossible(config | {"gesture": gesture}, f"use.{key}", 0.0)
        still = changed(config, f"use.{key}", 0.0)
        assert config_problems(still) == []
        for without in ({"use": None}, {"use": widest}):
            assert config_problems(still | {"gesture": gesture} | without) == []


FREE = {"uncertainty": ("load_point_mm", "radius_log_sd"), "use": ("scatter_mm", "stroke_mm")}


def test_something_is_left_to_infer(config):
    config["counterface"] = {"radius_mm": 200.0}
    for section, keys in FREE.items():
        config[section] |= dict.fromkeys(keys, 0.0)
    (problem,) = config_problems(config)
    assert "leave nothing to infer" in problem
    for section, keys in FREE.items():
        for key in keys:
            assert config_problems(changed(config, f"{section}.{key}", 0.5)) == []
    # a mesh has no radius to infer
    config |= {"counterface": SECOND, "uncertainty": config["uncertainty"] | {"radius_log_sd": 0.7}}
    assert config_problems(config) == [problem]


def test_scans_need_their_folder_and_grades_do_not(config, tmp_path):
    table = tmp_path / "patches.csv"
    without = INPUTS | {"scan_folder": None}
    gesture = {"load_point_scatter_mm": 1.0, "poses": 60}
    changes = {"specimen": None, "inputs": without, "patches": str(table), "gesture": gesture}
    mine = complete(config | changes | {"published": None})
    grades = [2, 0, 1, 3, 0, 0]
    rows = [f"{n},{1 + n % 3},{1 + 2 * (n // 3)},{grade}\n" for n, grade in enumerate(grades)]
    table.write_text(f"patch,x_mm,y_mm,wear_grade\n{''.join(rows)}")
    assert read_study(mine, "m.yaml").wear_grade.tolist() == grades
    for scans in ("patch,x_mm,y_mm,t0\nA,1,1,a.plu\n", "patch,x_mm,y_mm\nA,1,1\n"):
        table.write_text(scans)
        with pytest.raises(ConfigError, match="lacks scan_folder"):
            read_study(mine, "m.yaml")


@pytest.mark.parametrize(("results", "inside"), [("a/b", "mesh"), ("a/b/scans", "scans")])
def test_results_do_not_go_where_measured_files_are(config, results, inside):
    files = {"mesh": "a/b/stone.ply", "mesh_unit": "mm", "scan_folder": "a/b/scans"}
    mine = config | {"specimen": None, "inputs": files, "results": results}
    (problem,) = config_problems(mine)
    assert f"the {inside} (" in problem
    assert config_problems(mine | {"results": "a/b2"}) == []


def test_files_that_cannot_be_used_are_listed_with_those_of_like_names(config, tmp_path):
    for name in ("mesh.stl", "s5_t0.plu", "S5_T1.plu", "s7-T0.plu", "8{1}.plu"):
        (tmp_path / name).touch()
    config["inputs"] = {"mesh": f"{tmp_path}/mesh.stl", "scan_folder": f"{tmp_path}/"}
    config["counterface"] = {"scan": f"{tmp_path}/S5_T1.plu"}

    def patches(*rows):
        named = [dict(zip(("patch", "t0", "t1", "repeat"), row, strict=True)) for row in rows]
        return rows_of("patches", dict(enumerate(named)))

    check_files(config, patches(("5", "s5_t0.plu", "", "")), source="m.yaml")
    rows = [("5", "s5_T0.plu", "", "again.plu"), ("6", "other.sur", "S5_T1.plu", "")]
    rows += [("7", "s7_T0.plu", "8{1}.plu", "")]
    config["counterface"] = {"scan": "gone.plu"}
    with pytest.raises(ConfigError) as raised:
        check_files(config, patches(*rows), source="m.yaml")
    first, *lines, remedy = str(raised.value).splitlines()
    assert first == "m.yaml: 6 of 8 files cannot be used"
    assert "relative to the working folder" in remedy
    listed = {line.split(":")[0][4:]: line for line in lines}
    assert "gone.plu does not exist" in listed["counterface's scan"]
    assert "s5_T0.plu does not exist (did you mean s5_t0.plu?)" in listed["patch 5 at T0"]
    assert "again.plu does not exist" in listed["repeat of patch 5"]
    assert listed["patch 6 at T0"].endswith("other.sur does not exist")
    assert "did you mean s7-T0.plu?" in listed["patch 7 at T0"]
    assert "braces, which Snakemake reads as a placeholder" in listed["patch 7 at T1"]


BAD_TABLE, BAD_POSES = "patch,x_mm,y_mm,t0\n1,9,1,a\n", "x_mm,y_mm\n1,1\n"
BAD_VALUES = "quantity,patch,unit,value\nload,,MPa,22\n"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, None),
        ({"seed": -1}, "'seed' is -1"),
        ({"accept": ["epochs", "placement:7"]}, None),
        ({"accept": ["placement:77"]}, "has that name: did you mean 7? write placement for"),
        ({"patches": "bad.csv"}, "bad.csv: 1 problem in this table"),
        ({"gesture": {"table": "poses.csv"}}, "poses.csv: missing columns"),
        ({"gesture": {"table": "gone.csv"}}, "gone.csv: cannot be read"),
        ({"published": "values.csv"}, "line 2: quantity is 'load'"),
        ({"specimen": None, "inputs": INPUTS}, "files cannot be used\n  - mesh: a does not exist"),
    ],
)
def test_what_would_stop_a_run_before_its_first_step(tmp_path, monkeypatch, change, words):
    (tmp_path / "bad.csv").write_text(BAD_TABLE)
    (tmp_path / "poses.csv").write_text(BAD_POSES)
    (tmp_path / "values.csv").write_text(BAD_VALUES)
    monkeypatch.chdir(tmp_path)
    whole = complete({"patches": str(ROOT / "config/patches_tiny.tsv")} | change)
    if words is None:
        refuse_study(whole, "mine.yaml")
        return
    with pytest.raises(ConfigError) as caught:
        refuse_study(whole, "mine.yaml")
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, None),
        ({"specimen": None, "inputs": {"mesh": "a", "mesh_unit": "mm"}}, None),
        ({"gesture": None}, "'patches' and 'gesture' are null: where to scan depends on"),
        ({"counterface": {"scan": "b.plu"}}, "and counterface.scan needs scanned patches"),
        ({"published": "config/published_m12.csv"}, "and published needs scanned patches"),
    ],
)
def test_without_patches_a_mesh_is_enough_for_what_needs_none(config, change, words):
    mesh_only = {"patches": None, "gesture": {"load_point_scatter_mm": 1.0, "poses": 60}}
    found = config_problems(complete(config | mesh_only | change))
    assert found == [] if words is None else words in found[0]


@pytest.mark.parametrize(
    ("first", "second"),
    [((2e4, 0.2), (2e4, 0.2)), ((2e4, 0.2), (8e4, 0.35)), ((1e3, 0.0), (9e5, 0.5))],
)
def test_poisson_stands_for_the_compliances_of_both_stones(first, second):
    material = {"young_1_MPa": first[0], "poisson_1": first[1]}
    material |= {"young_2_MPa": second[0], "poisson_2": second[1]}
    tangential = sum((2 - poisson) * (1 + poisson) / young for young, poisson in (first, second))
    normal = sum((1 - poisson) * (1 + poisson) / young for young, poisson in (first, second))
    one = study_poisson(material)
    assert (2 - one) / (2 * (1 - one)) == pytest.approx(tangential / normal / 2)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"# a stone\ntitle: my: stone\n", "line 2, column 10: title: my: stone"),
        (b"square:\n\tsize_mm: 5\n", "line 2"),
        (b'title: "\x07"\n', "#x0007"),
        (b"seed: " + 5000 * b"1", "digits"),
        (b"load: &a {f: [*a]}\n", "by an alias (*)"),
        (b"# a stone\ntitle: Fl\xe4che\n", "byte 0xe4"),
        (b"- a\n- b\n", "holds ['a', 'b'], not keys"),
        (b"# nothing\n", "holds None"),
        (b'inputs: {mesh: "a\\0.stl"}\n', "'inputs.mesh' is 'a\\x00.stl'"),
        (b'title: "half \\uD800"\n', "U+D800"),
        (None, "cannot be opened"),
    ],
)
def test_what_is_no_config(tmp_path, content, problem):
    path = tmp_path / "mine.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"mine\.yaml: ") as caught:
        read_config_file(path)
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_config_is_read_without_the_packages_of_the_stages():
    """Snakemake reads the rules anew for each job of a cluster, within the memory of the job."""
    program = "import sys, gst.config.reading; print([*sys.modules])"
    result = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True
    )
    heavy = "scipy.stats", "scipy.optimize", "matplotlib", "trimesh", "shapely", "skimage"
    assert not {name for name in heavy if f"'{name}'" in result.stdout}
