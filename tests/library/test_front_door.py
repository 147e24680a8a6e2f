"""What `import gstlib` offers: few names, each documented, and none loaded before it is used."""

import ast
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
import pytest

import gstlib
from gstlib.errors import InputError


def test_the_names_are_few_and_documented():
    assert 40 < len(gstlib.__all__) <= 60
    for name in gstlib.__all__:
        thing = getattr(gstlib, name)
        summary = (thing.__doc__ or "").partition("\n")[0]
        assert len(summary) > 10, name
        # as dataclasses without a docstring have it
        assert not summary.startswith(f"{name}(")
        assert isinstance(thing, ModuleType) or ">>>" in thing.__doc__, name


def test_nothing_is_loaded_before_it_is_used():
    """Each job of the workflow is a fresh interpreter."""
    program = """
import sys, gstlib
def loaded(): return {name.partition(".")[0] for name in sys.modules} & {"numpy", "scipy", "xarray"}
print(sorted(loaded()), gstlib.contact_modulus(1, 0, 1, 0), gstlib.bem.__name__, sorted(loaded()))
"""
    printed = subprocess.check_output([sys.executable, "-c", program], text=True)
    assert printed == "[] 0.5 gstlib.bem ['numpy', 'scipy']\n"


def opened(settings, table):
    """A study whose files are never read."""
    readers = {"read_mesh": lambda: None, "read_scan": lambda *_: None}
    return gstlib.Study(settings, table, **readers)


def test_a_study_opens_without_a_config_and_refuses_wrong_settings():
    empty = pd.DataFrame({"patch": [], "t1": []})
    for settings in (gstlib.Settings(), {"seed": 1.0}):
        assert opened(settings, empty).config["load"]["force_N"] == 550
    for settings, problems in (
        ({"seed": "5", "colour": 1}, "(?s)seed.*colour"),
        ({"load": {}, "counterface": {"mesh": "a"}}, "(?s)pose.*load"),
    ):
        with pytest.raises(ValueError, match=problems):
            opened(settings, empty)


@pytest.mark.parametrize(
    "columns",
    [
        {"patch": [1, 2], "t1": ["b", np.nan], "repeat": np.nan, "flip": None},
        {"patch": ["1", "2"], "t1": ["b", ""], "rotation_deg": np.nan},
    ],
)
def test_a_study_takes_a_table_as_pandas_reads_it(columns):
    table = pd.DataFrame(columns | {"x_mm": 1.0, "y_mm": 1.0})
    study = opened({}, table)
    assert study.worn == ["1"]
    texts = ["patch", "repeat", "flip", "rotation_deg"]
    expected = [["1", "", "", 0.0], ["2", "", "", 0.0]]
    assert study.patches[texts].values.tolist() == expected
    with pytest.raises(InputError, match="patch 1 is there twice"):
        opened({}, table.assign(patch=1))


def test_the_program_itself_goes_by_the_rooms():
    """What a step runs on is read from its imports, which the front door would hide."""
    root = Path(__file__).parents[2]
    for file in (*root.glob("src/**/*.py"), *root.glob("workflow/**/*.py")):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            match node:
                case ast.ImportFrom(module="gstlib" | "gstlib.bem", names=names):
                    assert [name.name for name in names] == ["__version__"], file
                case ast.Attribute(value=ast.Name(id="gstlib"), attr=name):
                    assert name in {"__file__", "__version__"}, file
