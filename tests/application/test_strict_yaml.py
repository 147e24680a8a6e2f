"""The YAML of a user's files: what programs read alike is read, and all else is refused."""

import math

import pytest
import yaml

from gst.config.strict_yaml import as_yaml, parse_yaml
from gstlib.errors import ConfigError

NUMBERS = {
    "550": 550,
    "+550": 550,
    "550.": 550.0,
    "05.50": 5.5,
    ".5e3": 500.0,
    "1e-9": 1e-9,
}
TEXTS = ["y", "none", "550,0", "550 N", "2024-05-01", "nan", "1.2.3", "a_1", "1-2"]
OTHERS = {
    "true": True,
    "False": False,
    "~": None,
    "": None,
    '"0550"': "0550",
    "'no'": "no",
}
NUMBERS_ELSEWHERE = ["0550", "-007", "09", "0x226", "0b11", "5_50", "2024_05", "9:10"]
NUMBERS_ELSEWHERE += ["1:30:00.5", "-.INF", ".nan", "٥٥٠", "５５０", "−550"]
TRUTHS_ELSEWHERE = ["yes", "No", "ON", "off"]


def refused(text, *parts):
    with pytest.raises(ConfigError) as caught:
        parse_yaml(text, "mine.yaml")
    for part in ("mine.yaml", *parts):
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("written", "value"),
    [*NUMBERS.items(), *OTHERS.items(), *((text, text) for text in TEXTS)],
)
def test_a_value_that_is_read_alike(written, value):
    read = parse_yaml(f"load:\n  value: {written}  # mine\n", "mine.yaml")["load"][
        "value"
    ]
    assert (read, type(read)) == (value, type(value))


@pytest.mark.parametrize("written", [*NUMBERS_ELSEWHERE, *TRUTHS_ELSEWHERE])
def test_a_value_that_programs_read_differently(written):
    remedy = "true or false" if written in TRUTHS_ELSEWHERE else "decimal number"
    refused(
        f"# mine\nload:\n  value: {written}\n", "line 3: load.value is", written, remedy
    )
    refused(f"list: [1, {written}]\n", "line 1: list.1 is")
    refused(f"{written}: 1\n", "line 1: ", "not a name")


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("a: 1\nb: 2\na: 1\n", ["line 3: a is given in line 1"]),
        ("load:\n  force_N: 1\n  Force_n: 2\n", ["line 3: load.Force_n", "line 2"]),
        ("höhe: 1\nho\u0308he: 2\n", ["line 2:", "line 1"]),
        ("{force_N: 550,0}\n", ["line 1: the key 0 is not a name", "decimal points"]),
        ("a: 1\n<<: {b: 2}\n", ["line 2: the key << is not a name"]),
        ("a: &b 1\nc: *b\n", ["line 2: repeats a value by an alias"]),
        ("a: !!str 1\n", ["line 1: has the tag", "without it"]),
        ("a: 1\n---\nb: 2\n", ["line 2", "another document", "one document a file"]),
        ("a: 01\nb: 02\n", ["\n  - line 1: a is 01", "\n  - line 2: b is 02"]),
    ],
)
def test_keys_and_constructs_that_hide_what_is_meant(text, parts):
    refused(text, *parts)


def test_what_is_written_is_read_back_by_this_and_other_readers():
    values = [
        *NUMBERS,
        *TEXTS,
        *OTHERS,
        *NUMBERS_ELSEWHERE,
        *TRUTHS_ELSEWHERE,
        "=",
        "<<",
        "1 #2",
    ]
    whole = {"texts": values, "others": [True, None, 1e-9, 1e22, math.pi, 550, -1]}
    for flow in (True, False):
        text = as_yaml(whole, default_flow_style=flow)
        assert parse_yaml(text, "mine.yaml") == whole == yaml.safe_load(text)
