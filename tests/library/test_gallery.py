"""The scripts of the gallery run, draw, and print figures that agree with closed forms."""

import math
import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from gstlib.bem import solve_contact
from gstlib.io.plu import write_plu

DOCS = Path(__file__).parents[2] / "docs"
MODULUS = 19500 / (2 * (1 - 0.24**2))  # of sandstone on sandstone


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run a script in an empty folder: the numbers that it prints, line by line, and its names."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")

    def run(name, *arguments):
        script = DOCS / "gallery" / f"{name}.py"
        monkeypatch.setattr(sys, "argv", [str(script), *arguments])
        names = runpy.run_path(str(script), run_name="__main__")
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        lines = capsys.readouterr().out.splitlines()
        figures = [re.findall(r"(?<![\w.])\d[\d.]*(?:e-\d+)?", line) for line in lines]
        return [[float(figure) for figure in line] for line in figures], names

    return run


def test_the_page_links_every_script():
    linked = re.findall(r"^\[gallery/(\w+)\.py\]", (DOCS / "gallery.md").read_text("utf-8"), re.M)
    assert sorted(linked) == sorted(path.stem for path in DOCS.glob("gallery/*.py"))


def test_hertz(run):
    ((radius, said_radius), (peak, said_peak)), _ = run("hertz")
    assert radius == pytest.approx(said_radius, rel=5e-3)
    assert said_radius == pytest.approx((0.75 * 20 * 10 / MODULUS) ** (1 / 3), rel=1e-3)
    assert peak == pytest.approx(said_peak, rel=2e-3)
    assert said_peak == pytest.approx((6 * 20 * MODULUS**2 / math.pi**3 / 100) ** (1 / 3), rel=1e-3)


def test_a_rough_patch_is_between_the_theories(run):
    ((contact,), (peak,), (kappa, *theories)), names = run("rough_patch")
    assert theories == [pytest.approx(math.sqrt(of), abs=5e-3) for of in (8 / math.pi, 2 * math.pi)]
    assert theories[0] < kappa < theories[1]
    heights = names["height"].values
    state = solve_contact(heights, 0.00166, MODULUS, mean_pressure=22.0)
    assert contact == pytest.approx(100 * state.contact_fraction, abs=5e-3)
    assert peak == pytest.approx(state.pressure.max(), abs=0.5)


def test_a_patch_of_ones_own_is_the_one_that_is_pressed(run, tmp_path):
    spacing, n, radius = 0.004, 200, 20.0
    x = (np.arange(n) - (n - 1) / 2) * spacing
    write_plu(tmp_path / "own.plu", -(x**2 + x[:, None] ** 2) / (2 * radius), spacing)
    ((contact,), (peak,), _), _ = run("rough_patch", "own.plu")
    side, force = n * spacing, 22.0 * (n * spacing) ** 2
    hertz = (0.75 * force * radius / MODULUS) ** (1 / 3)
    assert contact == pytest.approx(100 * math.pi * (hertz / side) ** 2, rel=0.01)
    assert peak == pytest.approx(1.5 * force / (math.pi * hertz**2), rel=0.01)
    assert not (tmp_path / "rough_patch.plu").exists()


def test_partial_slip(run):
    ((stick, said), (force, asked)), names = run("partial_slip")
    contact = (0.75 * 50 * 0.6**2 * 10 / 10345) ** (1 / 3)
    assert said == pytest.approx(contact * 0.4 ** (1 / 3), rel=1e-3)
    assert stick == pytest.approx(said, rel=5e-3)
    assert (force, asked) == (pytest.approx(0.6, abs=1e-3), 0.6)
    # the traction in the middle: μ p₀ (1 − c/a)
    middle = 0.5 * 1.5 * 50 * 0.6**2 / (math.pi * contact**2) * (1 - 0.4 ** (1 / 3))
    assert float(names["slip"].traction[128, 128]) == pytest.approx(middle, rel=5e-3)


def test_a_worn_patch_loses_what_archard_says_and_gains_nothing(run):
    ((volume, said), (new, worn), (sharp, blunt)), names = run("patch_wear")
    assert said == pytest.approx(2e-8 * 22 * 850**2 * 1e6, rel=1e-4)  # k p s L², µm³
    assert volume == pytest.approx(said, rel=1e-4)
    assert new < worn
    assert sharp > blunt
    depth, height = names["worn"].depth, names["height"]
    assert depth.min() == 0
    # what is left carries the load with the pressures that the script says
    left = solve_contact(height - depth, 0.85 / 256, MODULUS, mean_pressure=22.0)
    assert 100 * left.contact_fraction == pytest.approx(worn, abs=0.05)
    assert left.pressure.max() == pytest.approx(blunt, rel=0.01)


def test_two_stones_are_pressed_as_the_sum_of_their_gaps(run):
    ((difference,), (flat,), (both,)), names = run("two_stones")
    assert difference < 1e-6
    assert both < flat
    slab, handstone = (names[name].values for name in ("slab", "handstone"))
    modulus = 1 / ((1 - 0.24**2) / 19500 + (1 - 0.17**2) / 60000)
    gaps = slab + handstone[:, ::-1]
    state = solve_contact(gaps, 0.85 / 256, modulus, mean_pressure=22.0, tolerance=1e-9)
    assert both == pytest.approx(100 * state.contact_fraction, abs=5e-3)
    np.testing.assert_allclose(names["on_slab"], state.pressure, atol=1e-4)
