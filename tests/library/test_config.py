import copy
from pathlib import Path

import pytest
import yaml

from gstlib.config import (
    alternative_contact_modulus,
    check_config,
    check_files,
    study_contact_modulus,
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


def test_missing_files_are_listed(tmp_path):
    (tmp_path / "there").touch()
    with pytest.raises(ConfigError, match=r"1 of 2 files(.|\n)*scan: .*gone"):
        check_files({"mesh": f"{tmp_path}/there", "scan": f"{tmp_path}/gone"}, source="m.yaml")


def test_contact_modulus_of_the_paper():
    """The paper prints 12.82 GPa; the standard definition gives 10.35 GPa for its constants."""
    constants = {"young_1_MPa": 19500, "poisson_1": 0.24, "young_2_MPa": 19500, "poisson_2": 0.24}
    given = constants | {"contact_modulus_MPa": 12820.0}
    assert study_contact_modulus(given) == 12820.0
    assert alternative_contact_modulus(given) == pytest.approx(10345.9, abs=0.1)
    computed = constants | {"contact_modulus_MPa": None}
    assert study_contact_modulus(computed) == alternative_contact_modulus(given)
    assert alternative_contact_modulus(computed) is None
