"""The configuration: every fault is found, and reported with key, value and remedy."""

import copy
import runpy
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml
from gst.config import (
    check_files,
    complete,
    config_problems,
    counterface_mesh,
    refuse_config,
    resolved,
)
from gst.patches import read_patches
from gstlib.contact import contact_moduli, study_poisson
from gstlib.errors import ConfigError
from snakemake.utils import update_config

ROOT = Path(__file__).parents[2]
SCHEMA = ROOT / "workflow/schemas/config.schema.yaml"
POINTS = [[0.0, 0.0, 0.0], [5.0, 0.0, 0.0], [0.0, 5.0, 0.0]]
SMALL = (np.array(POINTS) / 1000).tolist()
SECOND = {"mesh": "b.ply", "pose": {"matrix": np.eye(4).tolist()}}
MAT = {"young_MPa": 300.0, "poisson": 0.3, "thickness_um": 300.0}
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


def leaves(section, prefix=""):
    """Every key that is no section, by its full name, and its value."""
    for key, value in section.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def test_every_key_is_typed(config):
    """Each key in turn takes an impossible value."""
    for path, _ in leaves(config):
        spoiled = config_problems(changed(config, path, {"not": "this"}))
        assert spoiled[0].startswith(f"'{path}")
    without = config | {"specimen": None, "inputs": {"mesh": "a", "scan_folder": "b"}}
    assert "'inputs' lacks ['mesh_unit']" in config_problems(without)[0]


def test_the_template_states_every_default(config):
    """config/config.yaml, which users read, and the schema, from which the defaults are taken."""
    whole = complete({})
    stated, taken = dict(leaves(config)), dict(leaves(whole))
    assert stated == taken
    assert list(stated) == list(taken)


def test_the_keys_are_counted_with_every_alternative_and_stay_few():
    document = runpy.run_path(str(ROOT / "workflow/document.py"))
    number = {"type": "number"}
    choice = {
        "oneOf": [{"type": "null"}, {"type": "object", "properties": {"b": number, "c": number}}]
    }
    schema = {"properties": {"a": number, "choice": choice}}
    assert document["leaves"](schema) == ["a", "choice.b", "choice.c"]
    assert len(document["leaves"](yaml.safe_load(SCHEMA.read_text(encoding="utf-8")))) <= 85


def test_every_key_has_a_default_or_is_required_or_one_of_alternatives():
    schema = yaml.safe_load(SCHEMA.read_text(encoding="utf-8"))
    sections, odd = [("", schema)], []
    for prefix, section in sections:
        alternatives = {"anyOf", "minProperties"} & section.keys()
        for name, rule in section["properties"].items():
            rule = resolved(rule, schema)
            is_required = name in section.get("required", ())
            if ("default" in rule) + is_required != 1 and not alternatives:
                odd.append(f"{prefix}{name}")
            parts = (resolved(part, schema) for part in (rule, *rule.get("oneOf", ())))
            sections += [(f"{prefix}{name}.", part) for part in parts if "properties" in part]
    assert odd == []
    assert len(sections) > 20


@pytest.mark.parametrize("file", sorted(ROOT.glob("config/*.yaml")), ids=lambda file: file.stem)
def test_defaults_come_in_as_snakemake_merges_the_template(config, file):
    given = yaml.safe_load(file.read_text(encoding="utf-8"))
    before = copy.deepcopy(given)
    whole = complete(given)
    update_config(config, given)
    assert whole == complete(config)
    assert given == before


def test_what_is_given_takes_the_place_of_a_default():
    given = {
        "specimen": None,
        "inputs": INPUTS,
        "grinding": {"friction": 0.3},
        "counterface": SECOND,
        "scans": {"mould": {"invert": False}},
        "square": 5,  # not a section
        "hardness": None,
        "macroscale": {"steppes": 3},  # not a key
    }
    whole = complete(given)
    assert whole["specimen"] is None
    assert whole["inputs"] == INPUTS
    assert whole["grinding"] == {"friction": 0.3, "tangential_ratio": 0.5}
    assert whole["counterface"] == SECOND
    assert counterface_mesh(whole, "") == SECOND | {"mesh_unit": "mm"}
    assert whole["load"] == {"force_N": 550.0, "pressure_MPa": None, "at_mm": None}
    assert complete({"load": {"pressure_MPa": 22.0}})["load"]["force_N"] is None
    assert whole["scans"]["mould"] == {"invert": False, "flip": "x"}
    assert whole["scans"]["size_mm"] == 0.85
    assert whole["hardness"] is None
    first, second = config_problems(whole)
    assert "did you mean steps for steppes?" in first
    assert second.startswith("'square' is 5: 5 is not of type 'object'")


def test_defaults_are_not_shared():
    complete({})["square"]["points_mm"][0][0] = 9.0
    assert complete({})["square"]["points_mm"][0][0] == 2.5


def test_all_problems_are_told_at_once(config):
    config["macroscale"]["grid"] = 1.5
    config["material"]["poisson_1"] = 0.7
    config["colour"] = "blue"
    with pytest.raises(ConfigError) as raised:
        refuse_config(config_problems(config), source="mine.yaml")
    said = str(raised.value)
    assert said.startswith("mine.yaml: the configuration cannot be used\n  - ")
    for word in ("macroscale.grid", "1.5", "material.poisson_1", "0.7", "colour", "README"):
        assert word in said


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("inputs", INPUTS, "give exactly one of"),
        ("inputs", INPUTS | {"mesh_unit": "feet"}, "'inputs.mesh_unit' is 'feet'"),
        ("square.points_mm", [*POINTS[:2], [9.0, 0.0, 0.0]], "in line"),
        ("square.points_mm", POINTS[:2], "[Three points [x, y, z]"),
        ("square.points_mm", [1.0, 2.0, 3.0], "points_mm.0' is 1.0"),
        ("scans.size_mm", 6.0, "must fit"),
        ("material.young_1_MPa", 19.5, "1 GPa is 1000 MPa"),
        ("results", ".", "contains the working folder"),
        ("results", "..", "contains the working folder"),
        ("results", "config", "contains the patch table (config/patches.tsv)"),
        ("patches", "nowhere.tsv", "'patches': nowhere.tsv does not exist: correct the path"),
        ("patches", "{nowhere}.tsv", "contains braces"),
        ("hardness", 22.0, "not above the mean pressure on the square, 22 MPa"),
        ("hardness", -5.0, "'hardness' is -5.0"),
        ("texture.l_filter_um", 8.0, "no wave passes both filters"),
        ("validation.resamples", 9, "validation.resamples"),
        ("mat", MAT | {"young_MPa": 19500.0}, "'mat.young_MPa' is 19500, not below the stones'"),
        ("mat", MAT | {"thickness_um": 1.5}, "'mat.thickness_um': 1.5 µm is less than the 1.66 µm"),
        ("mat", MAT | {"poisson": 0.6}, "'mat.poisson' is 0.6"),
        ("counterface", {"mesh_unit": "mm"}, "'mesh' is a dependency of 'mesh_unit'"),
        ("counterface", {}, "'counterface' is {}"),
        ("counterface", {"mesh": "b.ply"}, "'pose' is a dependency of 'mesh'"),
        ("counterface", SECOND | {"pose": {}}, "'counterface.pose' is {}"),
        ("counterface", SECOND | {"radius_mm": 200.0}, "a radius and a mesh: give one of them"),
        ("counterface", {"radius_mm": 0.0}, "'counterface.radius_mm' is 0.0"),
        ("load.pressure_MPa", 22.0, "'load' has both of force_N and pressure_MPa"),
        ("load.force_N", None, "'load' has neither of force_N and pressure_MPa"),
        ("load.force_N", 5e6, "'load.force_N' is 5000000.0"),  # 5 MN
        ("load.force_N", 5e-3, "'load.force_N' is 0.005"),  # 5 mN
        ("load.force_N", 0.0, "'load.force_N' is 0.0"),
        ("load.pressure_MPa", 0.0, "'load.pressure_MPa' is 0.0"),
        ("load.at_mm", [10.1, 2.5], "outside the face, which reaches from -5 to 10 mm"),
        ("load.at_mm", [2.5, -5.0], "'load.at_mm' is [2.5, -5.0], outside the face"),
        ("load.at_mm", [2.5], "'load.at_mm' is [2.5]"),
        ("macroscale.face_mm", 4.0, "'macroscale.face_mm' is 4, less than the square's 5 mm"),
        ("grinding", {"friction": 0.6, "tangential_ratio": 1.5}, "grinding.tangential_ratio"),
        ("grinding", {"friction": 0, "tangential_ratio": 0.5}, "grinding.friction"),
        ("load.force_N", 5e4, "with 2000 MPa on average, and no stone bears that"),
        ("square.size_mm", 4.0, "corners 5 and 5 mm apart, and square.size_mm is 4"),
        ("square.points_mm", SMALL, "corners 0.005 and 0.005 mm apart"),
        ("counterface", {"mesh": "b.ply", "pose": {"points_mm": SMALL}}, "'counterface.pose.p"),
        ("results", "my results", "letters without accents, digits, and . _ - /"),
        # YAML takes for text a number with an exponent but no point
        ("microscale.tolerance", "1e-9", "such as 20 or 1.0e-9) ["),
        ("colour", "blue", "unknown keys ['colour']"),
    ],
)
def test_a_value_that_cannot_be_used(config, path, value, words):
    assert words in "\n".join(config_problems(changed(config, path, value)))


def test_decimal_commas_are_one_problem(config):
    """YAML takes a number with one for text, and in a list for two numbers."""
    corner = yaml.safe_load("[2,5, 2,5, 0,0]")
    points = changed(config, "square.points_mm", [corner, [1, 2, 3], corner])
    (problem,) = config_problems(changed(points, "microscale.steps", "2,5"))
    for word in ("decimal points", "microscale.steps", "points_mm.0", "points_mm.2"):
        assert word in problem


@pytest.mark.parametrize(
    ("material", "modulus"),
    [
        ({}, 12820.0),
        ({"young_1_MPa": 70000.0, "poisson_1": 0.1}, None),
        ({"young_1_MPa": 70000.0, "contact_modulus_MPa": 9000.0}, 9000.0),
    ],
)
def test_a_contact_modulus_that_is_left_out_follows_from_the_constants(material, modulus):
    """The default is that of the paper, for its constants alone."""
    assert complete({"material": material})["material"]["contact_modulus_MPa"] == modulus


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("square.points_mm", POINTS),
        ("grinding", None),
        ("hardness", None),
        ("load", {"force_N": None, "pressure_MPa": 22.0, "at_mm": None}),
        ("load.at_mm", [9.9, -4.9]),
        ("macroscale.face_mm", 5.0),
        ("counterface", None),
        ("counterface", {"scan": "a.plu"}),
        ("counterface", {"scan": "a.plu", "radius_mm": 50.0}),
        ("counterface", SECOND | {"scan": "a.plu", "mesh_unit": "cm"}),
        ("mat", MAT),
        ("published", None),
        ("texture.l_filter_um", None),
    ],
)
def test_a_config_that_can_be_used(config, path, value):
    assert config_problems(config) == []
    assert config_problems(changed(config, path, value)) == []


@pytest.mark.parametrize(
    ("gesture", "words"),
    [
        ({"stroke_mm": 2.0, "poses": 5}, None),
        ({"wander_mm": 1.0, "poses": 5}, None),
        ({"table": "poses.tsv"}, None),
        ({"table": "poses.tsv", "poses": 5}, "give a table, or poses with stroke_mm or"),
        ({"stroke_mm": 2.0, "wander_mm": 1.0, "poses": 5}, "too many properties"),
        ({"stroke_mm": 2.0}, "'poses' is a dependency of 'stroke_mm'"),
        ({"wander_mm": 2.0}, "'poses' is a dependency of 'wander_mm'"),
        ({"poses": 5}, "give a table, or poses with stroke_mm or"),
    ],
)
@pytest.mark.parametrize("counterface", [SECOND, {"radius_mm": 200.0}, None])
def test_a_gesture_is_a_table_a_stroke_or_a_wandering_hand(config, counterface, gesture, words):
    found = config_problems(config | {"counterface": counterface, "gesture": gesture})
    assert found == [] if words is None else words in "".join(found)


def test_the_square_alone_knows_no_second_stone_and_no_gesture(config):
    """Nor does it care for the face, and where in it the force acts."""
    alone = config | {"coupling": "levelled"}
    assert config_problems(alone) == []
    (second,) = config_problems(alone | {"counterface": SECOND})
    assert "'counterface.mesh' (or specimen.counterface_seed) needs a stone at rest" in second
    made = alone["specimen"] | {"counterface_seed": 8}
    assert config_problems(alone | {"specimen": made}) == [second]
    (moved,) = config_problems(alone | {"gesture": {"wander_mm": 1.0, "poses": 5}})
    assert "'gesture' needs a stone at rest" in moved
    small = changed(changed(alone, "macroscale.face_mm", 4.0), "load.at_mm", [50.0, 0.0])
    assert config_problems(small) == []


def test_a_gesture_and_a_mat_do_not_go_together(config):
    both = {"counterface": SECOND, "gesture": {"table": "poses.tsv"}, "mat": MAT}
    assert "cannot wear a stone together" in "".join(config_problems(config | both))


@pytest.mark.parametrize(("results", "inside"), [("a/b", "mesh"), ("a/b/scans", "scans")])
def test_results_do_not_go_where_measured_files_are(config, results, inside):
    files = {"mesh": "a/b/stone.ply", "mesh_unit": "mm", "scan_folder": "a/b/scans"}
    mine = config | {"specimen": None, "inputs": files, "results": results}
    (problem,) = config_problems(mine)
    assert f"the {inside} (" in problem
    assert config_problems(mine | {"results": "a/b2"}) == []


def test_files_that_cannot_be_used_are_listed(config, tmp_path):
    patches = read_patches(ROOT / "config/patches_tiny.tsv", size_mm=5.0, patch_size_mm=0.85).head(
        2
    )
    names = [*patches.t0, *patches.t1, "mesh.stl", "face.plu"]
    for name in names:
        (tmp_path / name).touch()
    config["inputs"] = {"mesh": f"{tmp_path}/mesh.stl", "scan_folder": str(tmp_path)}
    config["counterface"] = {"scan": f"{tmp_path}/face.plu"}
    check_files(config, patches, source="m.yaml")
    (tmp_path / "mesh.stl").unlink()
    patches.loc[0, "t1"] = "7{1}.plu"
    (tmp_path / "7{1}.plu").touch()
    config["counterface"] = {"scan": "gone.plu"}
    with pytest.raises(ConfigError) as raised:
        check_files(config, patches, source="m.yaml")
    first, *listed, remedy = str(raised.value).splitlines()
    assert first == "m.yaml: 3 of 6 files cannot be used"
    assert [line.split(": ")[0] for line in listed] == [
        "  - mesh",
        "  - counterface's scan",
        f"  - patch {patches.patch[0]} at T1",
    ]
    assert "gone.plu does not exist" in listed[1]
    assert "braces, which Snakemake reads as a placeholder" in listed[2]
    assert "relative to the working folder" in remedy


def test_a_file_that_is_missing_is_asked_after_by_a_like_name(config, tmp_path):
    folder = tmp_path / "scans"
    folder.mkdir()
    for name in ("../mesh.stl", "s5_t0.plu", "S5_T1.plu", "s7-T0.plu", "notes.txt"):
        (folder / name).touch()
    config["inputs"] = {"mesh": f"{tmp_path}/mesh.stl", "scan_folder": f"{folder}/"}
    patches = pd.DataFrame(
        [
            ("5", "S5_T0.PLU", "", "S5_again.plu"),
            ("6", "S6_T1.plu", "S5_T1.plu", ""),
            ("7", "s7_T0.plu", "gone.xyz", ""),
        ],
        columns=["patch", "t0", "t1", "repeat"],
    )
    with pytest.raises(ConfigError) as raised:
        check_files(config, patches, source="m.yaml")
    listed = {line.split(":")[0][4:]: line for line in str(raised.value).splitlines()[1:-1]}
    assert "S5_T0.PLU does not exist (did you mean s5_t0.plu?)" in listed["patch 5 at T0"]
    assert "S5_T1" not in listed["patch 6 at T0"]  # it is patch 6 at T1
    assert "did you mean s7-T0.plu?" in listed["patch 7 at T0"]
    assert listed["patch 7 at T1"].endswith("gone.xyz does not exist")
    assert "S5_again.plu does not exist" in listed["repeat of patch 5"]


def test_contact_moduli_of_the_paper():
    """The paper prints 12.82 GPa; the standard definition gives 10.35 GPa for its constants."""
    constants = {"young_1_MPa": 19500, "poisson_1": 0.24, "young_2_MPa": 19500, "poisson_2": 0.24}
    used, standard = contact_moduli(constants | {"contact_modulus_MPa": 12820.0})
    assert used == 12820.0
    assert standard == pytest.approx(10345.9, abs=0.1)
    assert contact_moduli(constants | {"contact_modulus_MPa": None}) == (standard, None)


@pytest.mark.parametrize(
    ("first", "second"),
    [((2e4, 0.2), (2e4, 0.2)), ((2e4, 0.2), (8e4, 0.35)), ((1e3, 0.0), (9e5, 0.5))],
)
def test_poisson_stands_for_the_compliances_of_both_stones(first, second):
    material = {"young_1_MPa": first[0], "poisson_1": first[1]}
    material |= {"young_2_MPa": second[0], "poisson_2": second[1]}
    tangential = normal = 0.0
    for young, poisson in (first, second):
        shear = young / (2 * (1 + poisson))
        tangential += (2 - poisson) / (4 * shear)
        normal += (1 - poisson) / (2 * shear)
    one = study_poisson(material)
    assert (2 - one) / (2 * (1 - one)) == pytest.approx(tangential / normal)


MESH_ONLY = {"patches": None, "gesture": {"wander_mm": 1.0, "poses": 60}}


def test_without_patches_a_mesh_is_enough(config):
    assert config_problems(config | MESH_ONLY) == []
    mesh = {"specimen": None, "inputs": {"mesh": "a", "mesh_unit": "mm"}}
    assert config_problems(complete(config | MESH_ONLY | mesh)) == []
    (problem,) = config_problems(complete(config | mesh))
    assert "'inputs' lacks ['scan_folder']" in problem


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"gesture": None}, "'patches' and 'gesture' are null: where to scan depends on"),
        (
            {"published": "config/published_m12.csv"},
            "'patches' is null, and published needs scanned patches",
        ),
        ({"counterface": {"scan": "b.plu"}}, "and counterface.scan needs scanned patches"),
        (
            {"published": "config/published_m12.csv", "sweep": {"seed": [{"seed": 2}]}},
            "published and sweep need scanned patches",
        ),
    ],
)
def test_what_needs_patches_is_told_where_there_are_none(config, change, words):
    (problem,) = config_problems(config | MESH_ONLY | change)
    assert words in problem
