"""The configuration: every fault is found, and reported with key, value and remedy."""

import copy
import re
import subprocess
import sys
from contextlib import nullcontext
from functools import reduce

import pytest
import yaml
from folders import fill
from snakemake.utils import update_config

from gst import ROOT
from gst.config.contradictions import counterface_mesh
from gst.config.reading import (
    complete,
    config_problems,
    read_config_file,
    read_study,
    refuse_study,
)
from gstlib.conditions import study_poisson
from gstlib.errors import ConfigError, InputsError

# Changes of a config, as they are written into it; a name with points is that of one key.
INPUTS = "inputs: {mesh: a, mesh_unit: mm, scan_folder: b}\n"
SECOND = """counterface:
  mesh: b.ply
  pose: {matrix: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}
"""
SCATTER = "gesture: {load_point_scatter_mm: 1.0, poses: 5}\n"
STROKE = "gesture: {stroke_mm: 2.0, poses: 5}\n"
INTERLAYER = "interlayer: {young_MPa: 300.0, poisson: 0.3, thickness_um: 300.0}\n"


@pytest.fixture
def config(monkeypatch):
    monkeypatch.chdir(ROOT)
    return yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))


def changed(config, text):
    """A copy with these changes."""
    result = copy.deepcopy(config)
    for path, value in yaml.safe_load(text).items():
        *sections, key = path.split(".")
        reduce(dict.__getitem__, sections, result)[key] = value
    return result


def leaves(section, prefix=""):
    """Every key that is no section, by its full name, and its value."""
    for key, value in section.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("{not: this}", ""),
        (".nan", "give a finite number"),
        (10**30, "give a finite number"),
    ],
)
def test_every_key_is_typed_and_finite(config, value, words):
    """Each key in turn; NaN is within any bounds that are tested by comparing."""
    for path, _ in leaves(config):
        problem, *_ = config_problems(changed(config, f"{path}: {value}"))
        assert problem.startswith(f"'{path}")
        assert words in problem


def test_the_template_states_every_default(config):
    """config/config.yaml, which users read, and the schema, from which the defaults are taken."""
    assert [*leaves(config)] == [*leaves(complete({}))]


def test_a_value_takes_the_place_of_a_default_as_snakemake_merges_them(config):
    mine = {"scans": {"mould": {"invert": False}}, "pressure_cap_MPa": None}
    whole = complete(mine)
    update_config(config, mine)
    assert whole == complete(config)
    assert mine == {"scans": {"mould": {"invert": False}}, "pressure_cap_MPa": None}
    assert counterface_mesh(complete(yaml.safe_load(SECOND)), "")["mesh_unit"] == "mm"
    whole["square"]["points_mm"][0][0] = 9.0  # of a default nothing is shared
    assert complete({})["square"]["points_mm"][0][0] == 2.5


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (INPUTS, "give exactly one of"),
        ("square.points_mm: [[0, 0, 0], [5, 0, 0], [9, 0, 0]]", "in line"),
        ("scans.size_mm: 6.0", "must fit"),
        ("material.young_1_MPa: 19.5", "1 GPa is 1000 MPa"),
        ("results: .", "contains the working folder"),
        ("results: my results", "letters without accents, digits, and . _ - /"),
        ("patches: nowhere.tsv", "nowhere.tsv does not exist: correct the path"),
        ("accept: ['placemnt:1']", "did you mean placement? write one of"),
        ("pressure_cap_MPa: 22.0", "the mean pressure on the square, 22 MPa"),
        ("texture.l_filter_um: 8.0", "no wave passes both filters"),
        (INTERLAYER + "interlayer.young_MPa: 19500.0", "not below the stones'"),
        (INTERLAYER + "interlayer.thickness_um: 0.5", "of the macroscale's elements"),
        ("counterface: {mesh: b.ply}", "'counterface.mesh' needs 'counterface.pose'"),
        (SECOND + "counterface.radius_mm: 200.0", "a radius and a mesh: give one"),
        ("counterface: {angle_deg: 30.0}", "'counterface.angle_deg' needs"),
        ("load.pressure_MPa: 22.0", "'load' has both of force_N and pressure_MPa"),
        ("load.at_mm: [10.1, 2.5]", "outside the face, which reaches from -5 to 10 mm"),
        ("macroscale.face_mm: 4.0", "is 4, less than the square's 5 mm"),
        ("microscale.tolerance: 1e-9", "such as 20 or 1.0e-9) ["),
        ("microscale.steps: 2,5", "with a point"),
        ("square.points_mm: [[2,5,2,5,0,0], [5,0,0], [0,5,0]]", "points, not commas"),
        ("macroscale.steppes: 3", "(steppes: did you mean steps? known"),
        ("gesture: {table: a.tsv, poses: 5}", "a table, or poses with stroke_mm or"),
        (SCATTER + "gesture.stroke_mm: 2.0", "give one of them"),
        # what can be used
        (STROKE, None),
        ("load: {force_N: null, pressure_MPa: 22.0, at_mm: null}", None),
        (SECOND + "counterface.scan: a.plu\ncounterface.mesh_unit: cm", None),
        ("counterface: {radius_mm: [169.0, 108.0], angle_deg: 30.0}", None),
        ("uncertainty.load_point_mm: 0.0", None),
    ],
)
def test_a_value_and_what_is_wrong_with_it(config, text, words):
    check_problems(changed(config, text), words)


def check_problems(config, words):
    problems = config_problems(config)
    assert problems == [] if words is None else words in "\n".join(problems)


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("load.force_N: 4.0e+4", "pressure"),
        ("square.points_mm: [[0, 0, 0], [0.005, 0, 0], [0, 0.005, 0]]", "square"),
        (INTERLAYER + "interlayer.thickness_um: 1.5", "interlayer"),
        ("scans.size_mm: 3.0", "overlap"),
    ],
)
def test_what_is_improbable_can_be_accepted(config, tmp_path, text, name):
    table = tmp_path / "patches.csv"
    table.write_text("patch,x_mm,y_mm\na,1.5,2.5\nb,2.5,2.5\n")
    study = changed(config, text) | {"patches": str(table), "published": None}
    with pytest.raises(InputsError, match=rf"accept: \[{name}"):
        read_study(study, "study.yaml")
    assert len(read_study(study | {"accept": [name]}, "study.yaml")) == 2
    if name == "overlap":  # of the later of two patches
        assert len(read_study(study | {"accept": ["overlap:b"]}, "study.yaml")) == 2


CURVED = "wear_law.exponent: 2.0\n"
PAPER = "coupling: paper\n"
FIXED = """counterface: {radius_mm: 200.0}
uncertainty.load_point_mm: 0.0
uncertainty.radius_log_sd: 0.0
use.scatter_mm: 0.0
use.stroke_mm: 0.0
"""
TOGETHER = [
    # the square alone has no active tool, no gesture, and no face in which a force acts
    (PAPER + SECOND, "does not go with coupling paper"),
    (PAPER + "specimen.counterface_seed: 8", "does not go with coupling paper"),
    (PAPER + SCATTER, "does not go with coupling paper"),
    (PAPER + "macroscale.face_mm: 4.0\nload.at_mm: [50.0, 0.0]", None),
    # a gesture and an interlayer wear apart, and by Archard's law
    (STROKE + INTERLAYER, "cannot be combined"),
    (CURVED, None),
    (CURVED + SCATTER, "'wear_law' is not Archard's"),
    (CURVED + INTERLAYER, "'wear_law' is not Archard's"),
    # strikes that are inferred stay on the face, and include the gesture
    ("use.scatter_mm: 7.5\nuse.stroke_mm: 15.0", None),
    ("use.scatter_mm: 7.6", "'use.scatter_mm"),
    ("use.stroke_mm: 15.2", "'use.stroke_mm"),
    ("use.scatter_mm: 0.0", None),
    ("use.scatter_mm: 0.0\n" + SCATTER, "'use.scatter_mm"),
    ("use.stroke_mm: 0.0\n" + STROKE, "'use.stroke_mm"),
    # something is left to infer; a mesh has no radius to infer
    (FIXED, "leave nothing to infer"),
    (FIXED + "uncertainty.load_point_mm: 0.5", None),
    (FIXED + "uncertainty.radius_log_sd: 0.5", None),
    (FIXED + "use.stroke_mm: 0.5", None),
    (FIXED + SECOND + "uncertainty.radius_log_sd: 0.5", "leave nothing to infer"),
]


@pytest.mark.parametrize(("text", "words"), TOGETHER)
def test_values_that_do_not_go_together(config, text, words):
    check_problems(changed(config, text), words)


def measured(config, text):
    """A config of measured files, which need no published figures."""
    return changed(config, f"specimen:\npublished:\n{INPUTS}{text}")


def test_scans_need_their_folder_and_grades_do_not(config, tmp_path):
    table = tmp_path / "patches.csv"
    mine = measured(config, f"inputs.scan_folder:\npatches: {table}\n{SCATTER}")
    rows = "0,1,1,2\n1,2,1,0\n2,3,1,1\n3,1,3,3\n4,2,3,0\n5,3,3,0\n"
    table.write_text(f"patch,x_mm,y_mm,wear_grade\n{rows}")
    assert read_study(mine, "m.yaml").wear_grade.tolist() == [2, 0, 1, 3, 0, 0]
    table.write_text("patch,x_mm,y_mm,t0\nA,1,1,a.plu\n")
    with pytest.raises(ConfigError, match="lacks scan_folder"):
        read_study(mine, "m.yaml")


@pytest.mark.parametrize(
    ("results", "inside"), [("a/b", "mesh"), ("a/b/scans", "scans")]
)
def test_results_do_not_go_where_measured_files_are(config, results, inside):
    files = "inputs.mesh: a/b/stone.ply\ninputs.scan_folder: a/b/scans"
    mine = measured(config, files)
    (problem,) = config_problems(mine | {"results": results})
    assert f"the {inside} (" in problem
    assert config_problems(mine | {"results": "a/b2"}) == []


BAD_TABLES = {
    "ab": "",
    "bad.csv": "patch,x_mm,y_mm,t0\n1,9,1,a\n",
    "poses.csv": "x_mm,y_mm\n1,1\n",
    "values.csv": "quantity,patch,unit,value\nload,,MPa,22\n",
    "named.csv": "quantity,patch,value\npatch pressure,77,8\nmean pressure,7,8\n",
    "nm.csv": "quantity,patch,unit,value\nmean pressure,,,8\ndisplacement,,MPa,22\n",
}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("accept: [epochs, 'placement:7']", None),
        ("accept: ['placement:77']", "did you mean 7? write placement for"),
        ("patches: bad.csv", "bad.csv: 1 problem in this table"),
        ("gesture: {table: poses.csv}", "poses.csv: missing columns"),
        ("published: values.csv", "line 2: quantity is 'load'"),
        ("published: named.csv", "line 2 (patch 77): the patch"),
        ("published: named.csv", "line 3 (patch 7): patch is '7': leave it"),
        ("published: nm.csv", "1 problem in this table\n  - line 3: unit is 'MPa'"),
        ("specimen:\n" + INPUTS, "a does not exist (did you mean ab?)"),
        ("specimen:\n" + INPUTS + "inputs.mesh: '{1}'", "mesh: {1} contains braces"),
    ],
)
def test_what_would_stop_a_run_before_its_first_step(
    tmp_path, monkeypatch, change, words
):
    fill(tmp_path, BAD_TABLES)
    monkeypatch.chdir(tmp_path)
    whole = complete({"patches": str(ROOT / "config/patches_tiny.tsv")})
    with pytest.raises(ConfigError) if words else nullcontext() as caught:
        refuse_study(changed(whole, change), "mine.yaml")
    assert words is None or words in str(caught.value)


def test_without_patches_a_mesh_is_enough_for_what_needs_none(config):
    mine = measured(config, "inputs.scan_folder:\npatches:")
    assert config_problems(changed(mine, SCATTER)) == []
    (problem,) = config_problems(mine)
    assert "'patches' and 'gesture' are null: proposed positions depend on" in problem


def test_poisson_stands_for_the_compliances_of_both_stones():
    elastic = {"young_1_MPa": 1e3, "poisson_1": 0.0}
    elastic |= {"young_2_MPa": 9e5, "poisson_2": 0.5}
    tangential = 2 * 1 / 1e3 + 1.5 * 1.5 / 9e5
    normal = 1 * 1 / 1e3 + 0.5 * 1.5 / 9e5
    one = study_poisson(elastic)
    assert (2 - one) / (1 - one) == pytest.approx(tangential / normal)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (b"seed: " + 5000 * b"1", "digits"),
        (b"# a stone\ntitle: Fl\xe4che\n", "byte 0xe4"),
        (b'inputs: {mesh: "a\\0.stl"}\n', "'inputs.mesh' is 'a\\x00.stl'"),
        (b'title: "half \\uD800"\n', "U+D800"),
    ],
)
def test_what_is_no_config(tmp_path, content, problem):
    path = tmp_path / "mine.yaml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=r"mine\.yaml: ") as caught:
        read_config_file(path)
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_config_is_read_without_the_packages_of_the_stages():
    """Snakemake reads the rules anew for each job of a cluster, within the memory of the job."""
    program = "import sys, gst.config.reading; print([*sys.modules])"
    loaded = subprocess.check_output([sys.executable, "-c", program], text=True)
    heavy = r"scipy\.(stats|optimize)|matplotlib|trimesh|shapely|skimage"
    assert re.findall(f"'({heavy})'", loaded) == []
