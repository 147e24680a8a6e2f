"""Workbooks and containers made to break their readers: read, or refused in a sentence.

The numbers of files are few, to be quick. All of them take some minutes:
``HOSTILE_WORKBOOKS=600 HOSTILE_CONTAINERS=200 pytest tests/library/io/test_hostile_files.py``
"""

import os
import subprocess
import sys
from pathlib import Path

import openpyxl
import pytest
from gst.config.patches import read_patches
from gst.config.strict_yaml import parse_yaml
from gstlib.errors import ConfigError, InputError
from gstlib.io.store import read_attributes, read_dataset
from gstlib.io.tables import read_table

SECONDS, MEGABYTES = 10, 1000


@pytest.mark.parametrize(("kind", "count"), [("workbooks", 25), ("containers", 36)])
def test_hostile_files_end_in_a_sentence(tmp_path, kind, count):
    """In a process of its own, whose memory is then known."""
    count = int(os.environ.get(f"HOSTILE_{kind.upper()}", count))
    script = Path(__file__).with_name("hostile_files.py")
    done = subprocess.run(
        [sys.executable, script, kind, tmp_path, str(count)],
        capture_output=True,
        text=True,
        check=True,
    )
    *results, memory = done.stdout.splitlines()
    assert len(results) == count
    for result in results:
        assert result.split("\t")[1] in ("read", "refused"), result
        assert float(result.split("\t")[2]) < SECONDS, result
    assert int(memory.removeprefix("MB ")) < MEGABYTES


@pytest.mark.parametrize("read", [read_dataset, read_attributes, read_table])
def test_a_result_that_is_a_pipe_is_not_waited_for(tmp_path, read):
    os.mkfifo(tmp_path / "a.h5")
    with pytest.raises(InputError, match=r"a\.h5"):
        read(tmp_path / "a.h5")


def workbook(path, cells):
    book = openpyxl.Workbook()
    for row in (["patch", "x_mm", "y_mm", "t0"], [1, 1, 1, "a"], [2, 3, 1, "b"]):
        book.active.append(row)
    for place, value in cells.items():
        book.active[place] = value
    book.save(path)
    return path


def test_formats_of_far_cells_are_no_cells_but_values_are(tmp_path):
    path = workbook(tmp_path / "a.xlsx", {})
    book = openpyxl.load_workbook(path)
    book.active["XFD1048576"].number_format = "0.00"
    book.save(path)
    assert len(read_patches(path, size_mm=5.0, patch_size_mm=0.85)) == 2
    for far in ("XFD1048576", "XFD2", "A1048576"):
        with pytest.raises(ConfigError, match=r"beyond column|line 1048576"):
            read_patches(workbook(path, {far: "a"}), size_mm=5.0, patch_size_mm=0.85)


@pytest.mark.parametrize(
    "text", ["[" * 80_000, "- " * 40_000, "a: {b: " * 9000, "a: " + "1" * 90_000 + "x"]
)
def test_yaml_that_would_take_minutes(text):
    """Time grows with the square of the depth, or with that of a number's digits."""
    if text.endswith("x"):
        assert parse_yaml(text, "a.yaml")["a"][-1] == "x"
    else:
        with pytest.raises(ConfigError, match=r"a\.yaml"):
            parse_yaml(text, "a.yaml")
