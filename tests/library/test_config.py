import copy
from pathlib import Path

import pytest
import yaml

from gstlib.config import (
    alternative_contact_modulus,
    check_config,
    check_files,
    check_hardness,
    check_interpreter,
    study_contact_modulus,
    study_poisson,
)
from gstlib.errors import ConfigError

ROOT = Path(__file__).parents[2]
SCHEMA = ROOT / "workflow/schemas/config.schema.yaml"


@pytest.fixture
def config(monkeypatch):
    monkeypatch.chdir(ROOT)
    return yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))


def problems(config):
    with pytest.raises(ConfigError) as raised:
        check_config(config, SCHEMA, source="mine.yaml")
    message = str(raised.value)
    assert message.startswith("mine.yaml")
    return message


def test_default_is_good(config):
    check_config(config, SCHEMA, source="config.yaml")


def leaves(section, prefix=()):
    for key, value in section.items():
        if isinstance(value, dict):
            yield from leaves(value, (*prefix, key))
        else:
            yield (*prefix, key)


def test_every_key_is_typed_and_required(config):
    """Each key in turn takes an impossible value, then goes away: both are noticed and named."""
    for *sections, key in leaves(config):
        for edit in ("spoil", "remove"):
            changed = copy.deepcopy(config)
            section = changed
            for name in sections:
                section = section[name]
            if edit == "spoil":
                section[key] = {"not": "this"}
            else:
                del section[key]
            assert key in problems(changed), (sections, key, edit)


def test_all_problems_are_told_at_once(config):
    config["macroscale"]["grid"] = 1.5
    config["material"]["poisson_1"] = 0.7
    config["colour"] = "blue"
    message = problems(config)
    for word in ("macroscale.grid", "1.5", "material.poisson_1", "0.7", "colour"):
        assert word in message


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ("inputs", {"mesh": "a", "mesh_unit": "mm", "scan_folder": "b"}, "exactly one"),
        ("square.frame.x_axis", [0.0, 0.0, 1.0], "perpendicular"),
        ("square.frame.normal", [0.0, 0.0, 0.0], "length zero"),
        ("scans.size_mm", 6.0, "must fit"),
        ("patches", "nowhere.tsv", "does not exist"),
        ("hardness", 22.0, "not above macroscale.target_pressure_MPa of 22"),
        ("hardness", -5.0, "'hardness' is -5.0"),
        ("validation.height_quantiles", [0.9, 0.5], "rising order"),
        ("validation.gap_limits_um", [5.0, 1.0], "rising order"),
        ("validation.shifts", 99, "validation.shifts"),
        ("grinding", {"friction": 0.6, "tangential_ratio": 1.5}, "grinding.tangential_ratio"),
        ("grinding", {"friction": 0, "tangential_ratio": 0.5}, "grinding.friction"),
        ("inputs", {"mesh": "a", "mesh_unit": "feet", "scan_folder": "b"}, "feet"),
    ],
)
def test_contradictions_are_told(config, path, value, words):
    *sections, key = path.split(".")
    section = config
    for name in sections:
        section = section[name]
    section[key] = value
    assert words in problems(config)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"macroscale": {"steps": 5}}, "depends on macroscale.steps, only on grid"),
        ({"specimen": {"seed": 8}}, "'specimen' is no section that can be swept (those are mat"),
        ({"macroscale": 3}, "'macroscale' is no section"),
        ({"macroscale": {"grid": 5}}, "'macroscale.grid' is 5: 5 is less than the minimum of 8"),
        ({"texture": {"l_filter_um": 5.0}}, "no wave passes both filters"),
        ({"material": {"poisson_2": 0.1}}, "poisson_2 without effect while material.contact_mod"),
    ],
)
def test_a_sweep_that_makes_no_sense_is_told_with_factor_and_value(config, changes, words):
    good = {"macroscale": {"grid": 50}}
    message = problems(config | {"sweep": {"fine": [good], "my factor": [good, changes]}})
    assert "'sweep.my factor', value 2: " in message
    assert words in message
    assert message.count("'sweep.") == 1


def test_missing_files_are_listed(tmp_path):
    (tmp_path / "there").touch()
    with pytest.raises(ConfigError, match=r"1 of 2 files(.|\n)*scan: .*gone"):
        check_files({"mesh": f"{tmp_path}/there", "scan": f"{tmp_path}/gone"}, source="m.yaml")


def test_names_with_braces(config, tmp_path):
    scan = tmp_path / "7{1} 50% #a.plu"
    scan.touch()
    with pytest.raises(ConfigError, match=r"patch 7 at T0: .*7\{1\} 50% #a\.plu\n.*Rename"):
        check_files({"patch 7 at T0": str(scan)}, source="mine.yaml")
    table = tmp_path / "{rows.csv"
    table.touch()
    message = problems(config | {"patches": str(table), "published": None})
    assert f"'patches' names {table}: Snakemake" in message
    assert "rename" in message


@pytest.mark.parametrize(
    ("folder", "marks"), [("Meine Steine", "a space"), ("a&b", "'&'"), ("{a}", "'{', '}'")]
)
def test_a_python_that_no_step_can_be_started_with(folder, marks):
    check_interpreter("/home/Müller/stone-2.1_b+c@d/.venv/bin/python")
    with pytest.raises(ConfigError, match=f"has {marks} in it. Move the project's folder"):
        check_interpreter(f"/home/{folder}/.venv/bin/python")


def test_contact_modulus_of_the_paper():
    """The paper prints 12.82 GPa; the standard definition gives 10.35 GPa for its constants."""
    constants = {"young_1_MPa": 19500, "poisson_1": 0.24, "young_2_MPa": 19500, "poisson_2": 0.24}
    given = constants | {"contact_modulus_MPa": 12820.0}
    assert study_contact_modulus(given) == 12820.0
    assert alternative_contact_modulus(given) == pytest.approx(10345.9, abs=0.1)
    computed = constants | {"contact_modulus_MPa": None}
    assert study_contact_modulus(computed) == alternative_contact_modulus(given)
    assert alternative_contact_modulus(computed) is None


def test_grinding_and_hardness_may_be_left_out(config):
    check_config(
        config | {"grinding": None, "hardness": None, "counterface": {"scan": "a.plu"}},
        SCHEMA,
        source="mine.yaml",
    )


def test_a_hardness_below_a_patch_pressure_is_told_with_the_patch():
    pressures = {"3": 12.0, "7": 40.0}
    check_hardness(40.1, pressures, source="mine.yaml")
    check_hardness(None, pressures, source="mine.yaml")
    with pytest.raises(ConfigError, match=r"mine\.yaml: 'hardness' is 40 MPa.* patch 7 \(40 MPa\)"):
        check_hardness(40.0, pressures, source="mine.yaml")


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


@pytest.mark.parametrize(
    ("text", "number"), [("1e-9", "1.0e-09"), ("25e-10", "2.5e-09"), ("0,5", "0.5"), ("7e0", "7.0")]
)
def test_a_number_that_yaml_takes_for_text_is_written_out(config, text, number):
    config["microscale"]["tolerance"] = yaml.safe_load(text)
    assert f"write {number} " in problems(config)
    assert isinstance(yaml.safe_load(number), float)


@pytest.mark.parametrize(
    ("text", "hint"), [("20", "write 20 "), ("2,5", "write 2.5 "), ("inf", "")]
)
def test_a_whole_number_in_quotes_is_written_as_one(config, text, hint):
    config["microscale"]["steps"] = text
    told = problems(config)
    assert hint in told
    assert ("write" in told) == bool(hint)
