"""A command that cannot do what it is asked for says so in a line, with exit code 2."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from folders import fill
from shell import command

import gst
from gstlib.bem.closed_forms import Sphere
from gstlib.io.plu import write_plu


@pytest.mark.parametrize(
    ("done", "words"),
    [
        (f"new {'a' * 300}", "File name too long"),
        ("new here --like mine", "'mine' is not one of"),
        ("study gone.yaml", "gone.yaml: cannot be opened"),
        ("inspect a\udcff.plu", "no such file"),
        ("press gone.plu --pressure 0", "not in the range"),
        ("press full --pressure 1", "full: is a folder"),
        ("check in_loop.yaml", "loop"),
        ("place gone", "gone: cannot be opened"),
        ("diff full gone", "gone: has no tables"),
        ("export full", "holds no finished study"),
        ("package full", "no finished study"),
    ],
)
def test_a_command_that_cannot_be_done_says_why(tmp_path, monkeypatch, done, words):
    patches = gst.ROOT / "config/patches_tiny.tsv"
    files = {
        "full.yaml": f"results: full\npatches: {patches}\n",
        "in_loop.yaml": f"results: loop\npatches: {patches}\n",
        "full/tables/a.csv": "patch,x\n1,2\n",
    }
    fill(tmp_path, files)
    (tmp_path / "loop").symlink_to("loop")
    monkeypatch.chdir(tmp_path)
    result = command(done)
    assert result.exit_code == 2
    assert words in result.stderr
    assert (tmp_path / "full/tables/a.csv").exists()


def test_press_says_the_curve_and_its_doubts(tmp_path, monkeypatch):
    """A sphere's cap: the pressure of Hertz; of a bowl that bears on its border: a warning."""
    monkeypatch.chdir(tmp_path)
    spacing, n, radius = 0.008, 50, 20.0
    x = (np.arange(n) - (n - 1) / 2) * spacing
    bowl = (x**2 + x[:, None] ** 2) / (2 * radius)
    write_plu("cap.plu", -bowl, spacing)
    result = command("press cap.plu --pressure 22 --modulus 1e4")
    assert (result.exit_code, result.stderr) == (0, "")
    assert Path("cap.plu.png").stat().st_size > 5000
    curve = pd.read_csv("cap.plu_curve.csv")
    assert curve.mean_pressure_MPa.iloc[-1] == pytest.approx(22)
    assert all(name in result.stdout for name in curve)
    exact = Sphere(22.0 * (n * spacing) ** 2, radius, 1e4)
    peak = float(re.search(r"peak pressure (\S+) MPa", result.stdout)[1])
    assert peak == pytest.approx(exact.peak_pressure, rel=0.03)
    assert "E* 10000 MPa" in result.stdout
    write_plu("bowl.plu", bowl, spacing)
    result = command("press bowl.plu --pressure 5")
    assert result.stderr.startswith("WARNING: bowl.plu: ")
    assert "Give --periodic if it repeats itself" in result.stderr
    assert "periodic=" not in result.stderr


@pytest.mark.parametrize(
    ("options", "remedy"),
    [
        ("--spacing-um 4", "Set --unit to "),
        ("--unit um", "Set --spacing-um to "),
        ("--unit m --spacing-um 4", "Check --unit"),
    ],
)
@pytest.mark.parametrize("asked", ["press a.txt --pressure 5", "change a.txt a.txt"])
def test_a_scan_alone_is_told_of_options_and_not_of_a_config(
    tmp_path, monkeypatch, asked, options, remedy
):
    monkeypatch.chdir(tmp_path)
    np.savetxt("a.txt", np.random.default_rng(1).normal(size=(30, 30)))
    result = command(f"{asked} {options}")
    assert result.exit_code == 2
    assert remedy in result.stderr
    for word in ("config", "scans.", "patch", "accept"):
        assert word not in result.stderr
