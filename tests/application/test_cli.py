"""A command that cannot do what it is asked for says so in a line, with exit code 2."""

import math

import gst
import numpy as np
import pytest
from click.testing import CliRunner
from gst.cli import main
from gstlib.bem.closed_forms import Sphere
from gstlib.io.plu import write_plu


def run(*arguments):
    return CliRunner().invoke(main, arguments, input="")


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (f"new {'a' * 300}", "File name too long"),
        ("new here --like mine", "'mine' is not one of"),
        ("check gone.yaml", "gone.yaml: cannot be opened"),
        ("study gone.yaml", "gone.yaml: cannot be opened"),
        ("clean gone.yaml", "gone.yaml: cannot be opened"),
        ("clean full.yaml", "Broken off"),
        ("inspect gone.plu", "gone.plu: no such file"),
        ("inspect gone.txt --spacing-um 0", "not in the range"),
        ("inspect a\udcff.plu", "no such file"),
        ("press gone.plu --pressure 5", "gone.plu: no such file"),
        ("press gone.plu --pressure 0", "not in the range"),
        ("check a\0b", "cannot be the path of a file"),
        ("new loop --like tiny", "is a loop of links"),
        ("check in_loop.yaml", "loop"),
        ("place gone", "gone: cannot be opened"),
        ("diff full gone", "gone: has no tables"),
        ("diff full full --tolerance -1", "not in the range"),
        ("export full", "holds no finished study"),
        ("package full", "no finished study"),
        ("nothing", "No such command"),
        ("", "Usage:"),
    ],
)
def test_a_command_that_cannot_be_done_says_why(tmp_path, monkeypatch, command, words):
    patches = gst.ROOT / "config/patches_tiny.tsv"
    for file, text in {
        "full.yaml": f"results: full\npatches: {patches}\n",
        "in_loop.yaml": f"results: loop\npatches: {patches}\n",
        "full/tables/a.csv": "patch,x\n1,2\n",
        "full/logs/a.json": '{"outputs": {"tables/a.csv": "a1"}}',
    }.items():
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_text(text)
    (tmp_path / "loop").symlink_to("loop")
    monkeypatch.chdir(tmp_path)
    result = run(*command.split())
    assert result.exit_code == 2
    assert words in result.stderr
    assert (tmp_path / "full/tables/a.csv").exists()


def test_press_says_the_curve_and_its_doubts(tmp_path, monkeypatch):
    """A sphere's cap: the area of Hertz; a ridge along the border: a warning, not if it repeats."""
    monkeypatch.chdir(tmp_path)
    spacing, n, radius = 0.004, 100, 20.0
    x = (np.arange(n) - (n - 1) / 2) * spacing
    write_plu(tmp_path / "cap.plu", -(x**2 + x[:, None] ** 2) / (2 * radius), spacing)
    result = run("press", "cap.plu", "--pressure", "22", "--modulus", "1e4")
    assert (result.exit_code, result.stderr) == (0, "")
    assert (tmp_path / "cap.plu.png").stat().st_size > 5000
    *_, last = [line.split() for line in result.stdout.splitlines() if "e-" in line]
    exact = Sphere(22.0 * (n * spacing) ** 2, radius, 1e4)
    area = math.pi * (exact.contact_radius / n / spacing) ** 2
    assert [float(value) for value in last[1:3]] == pytest.approx([22, area], rel=0.02)
    waves = np.cos(2 * np.pi * np.arange(n) / n) + 0 * x[:, None]
    write_plu(tmp_path / "ridge.plu", 1e-3 * waves, spacing)
    for options, is_told in (["--output", "r.png"], True), (["--periodic"], False):
        result = run("press", "ridge.plu", "--pressure", "22", *options)
        assert bool(result.stderr) == is_told
