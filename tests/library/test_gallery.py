"""The scripts of the gallery run, draw, and print figures that agree with closed forms."""

import re
import runpy
from pathlib import Path

import numpy as np
import pytest
from bem_reference import sphere

from gstlib.bem.closed_forms import Sphere
from gstlib.io.plu import write_plu

DOCS = Path(__file__).parents[2] / "docs"
# Of each script: which of the numbers that it prints, in order, are equal to which others, and
# within what share of them.
EQUAL = {
    "hertz": ([(0, 1), (2, 3)], 5e-3),
    "area_and_load": ([(4, 5)], 0.05),  # at the highest load, as Persson says
    "rim": ([(1, 3), (2, 4)], 0.02),
    "partial_slip": ([(0, 1), (2, 3)], 5e-3),
    "patch_wear": ([(0, 1)], 1e-4),
    "two_tools": ([], 0),
    "waves": ([(1, 2)], 2e-3),
    "pressure_cap": ([(3, 5)], 0.05),  # nearly all of it yields
    "tilting": ([(0, 1), (2, 3)], 0.01),
    "layer": ([(1, 2)], 2e-3),  # a thick one is a half-space
    "rough_patch": ([], 0),
}


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run a script in an empty folder: the numbers that it prints."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")

    def run(name):
        runpy.run_path(str(DOCS / "gallery" / f"{name}.py"), run_name="__main__")
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        printed = capsys.readouterr().out
        return [
            float(number)
            for number in re.findall(r"(?<![\w.])\d[\d.]*(?:e-\d+)?", printed)
        ]

    return run


def test_the_page_links_every_script():
    page = (DOCS / "gallery.md").read_text("utf-8")
    assert sorted(EQUAL) == sorted(path.stem for path in DOCS.glob("gallery/*.py"))
    assert all(f"\n[gallery/{name}.py]" in page for name in EQUAL)


@pytest.mark.parametrize("name", EQUAL)
def test_a_script_prints_equal_numbers(run, name):
    pairs, tolerance = EQUAL[name]
    numbers = run(name)
    for number, other in pairs:
        assert numbers[number] == pytest.approx(numbers[other], rel=tolerance)
    if name == "rough_patch":  # between the theories of Persson and of Bush
        assert numbers[3] < numbers[2] < numbers[4]
    if name == "two_tools":  # who presses whom does not matter
        assert numbers[0] < 1e-6


def test_a_patch_of_ones_own_is_the_one_that_is_pressed(run, tmp_path):
    spacing, n, radius = 0.008, 100, 20.0
    write_plu(tmp_path / "rough_patch.plu", sphere(n, spacing, radius), spacing)
    exact = Sphere(22.0 * (n * spacing) ** 2, radius, 19500 / (2 * (1 - 0.24**2)))
    percent = 100 * np.pi * (exact.contact_radius / n / spacing) ** 2
    assert run("rough_patch")[:2] == pytest.approx(
        [percent, exact.peak_pressure], rel=0.02
    )
