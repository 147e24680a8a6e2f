"""The scripts of the gallery run, draw, and print figures that agree with closed forms."""

import math
import re
import runpy
from pathlib import Path

import numpy as np
import pytest
from gstlib.bem import solve_contact
from gstlib.bem.closed_forms import BUSH_SLOPE, PERSSON_SLOPE, Sphere
from gstlib.io.plu import write_plu

DOCS = Path(__file__).parents[2] / "docs"
MODULUS = 19500 / (2 * (1 - 0.24**2))  # of sandstone on sandstone


@pytest.fixture
def run(tmp_path, monkeypatch, capsys):
    """Run a script in an empty folder: the numbers that it prints, line by line, and its names."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")

    def run(name):
        script = DOCS / "gallery" / f"{name}.py"
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
    assert (radius, peak) == pytest.approx((said_radius, said_peak), rel=5e-3)
    exact = Sphere(20.0, 10.0, MODULUS)
    expected = exact.contact_radius, exact.peak_pressure
    assert (said_radius, said_peak) == pytest.approx(expected, rel=1e-3)


def test_a_patch_of_ones_own_is_the_one_that_is_pressed(run, tmp_path):
    spacing, n, radius = 0.004, 200, 20.0
    x = (np.arange(n) - (n - 1) / 2) * spacing
    write_plu(tmp_path / "rough_patch.plu", -(x**2 + x[:, None] ** 2) / (2 * radius), spacing)
    ((contact,), (peak,), _), _ = run("rough_patch")
    exact = Sphere(22.0 * (n * spacing) ** 2, radius, MODULUS)
    assert contact == pytest.approx(
        100 * math.pi * (exact.contact_radius / n / spacing) ** 2, rel=0.01
    )
    assert peak == pytest.approx(exact.peak_pressure, rel=0.01)


def test_a_rough_patch_is_between_the_theories(run):
    (_, _, (kappa, *theories)), _ = run("rough_patch")
    assert theories == pytest.approx([PERSSON_SLOPE, BUSH_SLOPE], abs=5e-3)
    assert theories[0] < kappa < theories[1]


def test_area_grows_between_the_theories_and_to_perssons(run):
    (_, (kappa, *theories), (last, persson)), names = run("area_and_load")
    assert theories == pytest.approx([PERSSON_SLOPE, BUSH_SLOPE], abs=5e-3)
    assert theories[0] < kappa < theories[1]
    assert last == pytest.approx(persson, rel=0.05)
    # summits by themselves touch as Persson says, too, and less than the surface
    load, summits = names["spheres"]
    summits = np.interp(0.01, load[:-1], summits[:-1])
    assert (
        0.01 * theories[0]
        < summits
        < np.interp(0.01, names["loads"] / names["scale"], names["area"])
    )
    step = np.diff(names["pressure"])[0]
    carried = (names["pressure"] * names["density"]).sum() * step
    assert carried == pytest.approx(names["state"].mean_pressure, rel=0.01)


def test_a_scan_bears_at_its_rim_alone_what_its_surface_does_not(run):
    ((area,), (inside,), (alone, lowered), (warned,)), names = run("rim")
    assert area == pytest.approx(100 * (1 - (250 / 256) ** 2), abs=0.05)
    assert lowered == inside < alone / 2
    assert warned == pytest.approx(alone, abs=0.5)
    pressures = names["embedded"].pressure, names["inside"]
    np.testing.assert_allclose(*pressures, atol=1e-3 * names["inside"].max())


def test_partial_slip(run):
    ((stick, said), (force, asked)), _ = run("partial_slip")
    sphere = Sphere(50 * 0.6**2, 10.0, 10345)
    assert said == pytest.approx(sphere.stick_radius(0.6), rel=1e-3)
    assert stick == pytest.approx(said, rel=5e-3)
    assert (force, asked) == (pytest.approx(0.6, abs=1e-3), 0.6)


def test_a_worn_patch_loses_what_archard_says(run):
    ((volume, said), (new, worn), (sharp, blunt)), _ = run("patch_wear")
    assert said == pytest.approx(2e-8 * 22 * 850**2 * 1e6, rel=1e-4)  # k p s L², µm³
    assert volume == pytest.approx(said, rel=1e-4)
    assert new < worn
    assert sharp > blunt


def test_two_tools_are_pressed_as_the_sum_of_their_gaps(run):
    ((difference,), (flat,), (both,)), names = run("two_tools")
    assert difference < 1e-6
    assert both < flat
    slab, handstone = (names[name].values for name in ("slab", "handstone"))
    modulus = 1 / ((1 - 0.24**2) / 19500 + (1 - 0.17**2) / 60000)
    state = solve_contact(slab + handstone[:, ::-1], 0.85 / 256, modulus, mean_pressure=22.0)
    assert both == pytest.approx(100 * state.contact_fraction, abs=5e-3)


def test_waves_without_end_are_westergaards_and_a_piece_is_not(run):
    ((difference,), (said,), (periodic, free), (rim,)), names = run("waves")
    assert difference < 2 / 64  # two elements of a wave
    assert (said, periodic) == (0.5, pytest.approx(0.5, abs=1e-3))
    assert free < periodic - 0.05
    assert rim > 20
    pressure = names["wave"].pressure(names["x"], names["loads"][6])
    found = names["periodic"].states[6].pressure[0]
    np.testing.assert_allclose(found, pressure, atol=0.05 * pressure.max())


def test_a_cap_leads_from_the_elastic_to_the_plastic_contact(run):
    ((elastic, peak), (cap, touching), (_, plastic)), names = run("pressure_cap")
    assert (cap, plastic) == (100.0, 22.0)
    assert plastic < touching < 1.05 * plastic
    highest = [float(state.pressure.max()) for state in names["states"]]
    assert highest == pytest.approx(np.minimum(names["caps"], peak), rel=1e-3)
    assert names["contact"][0] == pytest.approx(elastic / 100, abs=1e-4)


def test_a_body_tilts_until_its_pressures_balance_the_force(run):
    ((tilt, said), (centre, force)), _ = run("tilting")
    assert said == pytest.approx(3e3 * 20 * 0.16 / (4 * 10345 * 0.48**3), rel=1e-4)
    assert tilt == pytest.approx(said, rel=0.01)  # elements along the rim of the punch
    assert centre == pytest.approx(force, abs=1e-4)


def test_a_thick_layer_is_a_half_space_and_a_thin_one_hardly_there(run):
    ((bare, thick), (soft,), (sharp, blunt)), names = run("layer")
    assert thick == pytest.approx(soft, abs=0.1)
    assert bare < 100 * names["contact"][0] < thick
    assert (np.diff(names["contact"]) > -1e-4).all()
    assert sharp > 10 * blunt
