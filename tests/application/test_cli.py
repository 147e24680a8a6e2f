"""A command that cannot do what it is asked for says so in a line, with exit code 2."""

import math
import os

import gst
import numpy as np
import pytest
from click.testing import CliRunner
from gst.cli import main
from gstlib.bem.closed_forms import Sphere
from gstlib.io.plu import write_plu

LONG = "a" * 300
TOO_LONG = "File name too long"


def run(*arguments, said=""):
    return CliRunner().invoke(main, arguments, input=said)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["new", LONG], TOO_LONG),
        (["new", "here", "--like", "mine"], "'mine' is not one of"),
        (["check", "gone.yaml"], "gone.yaml: cannot be opened"),
        (["study", "gone.yaml"], "gone.yaml: cannot be opened"),
        (["clean", "gone.yaml"], "gone.yaml: cannot be opened"),
        (["clean", "full.yaml"], "Broken off"),
        (["inspect", LONG], TOO_LONG),
        (["inspect", "gone.plu"], "gone.plu: no such file"),
        (["inspect", "gone.txt", "--spacing-um", "0"], "not in the range"),
        (["inspect", b"a\xff.plu"], "no such file"),
        (["press", "gone.plu", "--pressure", "5"], "gone.plu: no such file"),
        (["press", "gone.plu", "--pressure", "0"], "not in the range"),
        (["check", "a\0b"], "cannot be the path of a file"),
        (["new", "loop", "--like", "tiny"], "is a loop of links"),
        (["package", "loop"], "is a loop of links"),
        (["check", "in_loop.yaml"], "loop"),
        (["place", "gone"], "gone: cannot be opened"),
        (["diff", "full", "gone"], "gone: has no tables"),
        (["diff", "full", "full", "--tolerance", "-1"], "not in the range"),
        (["export", "full"], "holds no finished study"),
        (["package", "full"], "no finished study"),
        (["nothing"], "No such command"),
        ([], "Usage:"),
    ],
)
def test_what_cannot_be_done(tmp_path, monkeypatch, arguments, said):
    patches = gst.ROOT / "config/patches_tiny.tsv"
    (tmp_path / "full.yaml").write_text(f"results: full\npatches: {patches}\n")
    (tmp_path / "full/tables").mkdir(parents=True)
    (tmp_path / "full/tables/a.csv").write_text("patch,x\n1,2\n")
    (tmp_path / "full/logs").mkdir()
    (tmp_path / "full/logs/a.json").write_text('{"outputs": {"tables/a.csv": "a1"}}')
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "in_loop.yaml").write_text(f"results: loop\npatches: {patches}\n")
    monkeypatch.chdir(tmp_path)
    result = run(*map(os.fsdecode, arguments))
    assert result.exit_code == 2
    assert said in result.stderr
    assert (tmp_path / "full/tables/a.csv").exists()


def test_press_says_the_curve_and_its_doubts(tmp_path, monkeypatch):
    """A sphere's cap: the area of Hertz; a ridge along the border: a warning, not if it repeats."""
    monkeypatch.chdir(tmp_path)
    spacing, n, radius = 0.004, 100, 20.0
    x = (np.arange(n) - (n - 1) / 2) * spacing
    write_plu(tmp_path / "cap.plu", -(x**2 + x[:, None] ** 2) / (2 * radius), spacing)
    given = "--pressure", "22", "--modulus", "1e4"
    result = run("press", "cap.plu", *given)
    assert result.exit_code == 0, result.stderr
    assert result.stderr == ""
    assert (tmp_path / "cap.plu.png").stat().st_size > 5000
    *_, last = [line.split() for line in result.stdout.splitlines() if "e-" in line]
    exact = Sphere(22.0 * (n * spacing) ** 2, radius, 1e4)
    area = math.pi * (exact.contact_radius / n / spacing) ** 2
    assert [float(value) for value in last[1:3]] == pytest.approx([22, area], rel=0.02)
    waves = np.cos(2 * np.pi * np.arange(n) / n) + 0 * x[:, None]
    write_plu(tmp_path / "ridge.plu", 1e-3 * waves, spacing)
    assert "outer three" in run("press", "ridge.plu", *given, "--output", "r.png").stderr
    assert run("press", "ridge.plu", *given, "--periodic").stderr == ""
