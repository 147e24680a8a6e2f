"""The evaluator against integrals and a direct sum; one measurement from end to end, at 32².

Needs this project's environment only: ``python -m pytest benchmarks``.
"""

import numpy as np
import pytest
import report
from cases import CODES, GOAL
from evaluate import displacement, evaluate, kernel, periodic_displacement
from measure import levels_of, run
from problems import MODULUS, Surface
from runner import RESULTS
from scipy.integrate import dblquad

SPACING = 0.01


def test_kernel_is_the_integral_over_the_element():
    row = 2
    column = 1
    half = SPACING / 2
    integral, _ = dblquad(
        lambda x, y: 1 / np.hypot(row * SPACING - y, column * SPACING - x),
        -half,
        half,
        -half,
        half,
        epsabs=1e-14,
    )
    influence = kernel((4, 4), SPACING, MODULUS)
    assert influence[row, column] == pytest.approx(
        integral / (np.pi * MODULUS), rel=1e-9
    )
    own = 4 * np.arcsinh(1) * SPACING / (np.pi * MODULUS)
    assert influence[0, 0] == pytest.approx(own, rel=1e-14)


def test_displacement_is_the_direct_sum():
    pressure = np.random.default_rng(1).random((6, 9))
    influence = kernel(pressure.shape, SPACING, MODULUS)
    row, column = np.indices(pressure.shape).reshape(2, -1)
    dense = influence[abs(row[:, None] - row), abs(column[:, None] - column)]
    direct = (dense @ pressure.ravel()).reshape(pressure.shape)
    np.testing.assert_allclose(
        displacement(pressure, SPACING, MODULUS), direct, rtol=1e-13
    )


def test_displacement_of_a_wave():
    """A wave p of length L sinks in by p L/(π E*) in any direction; a uniform pressure does not."""
    row, column = np.indices((8, 12))
    wave = np.cos(2 * np.pi * (row / 8 + 2 * column / 12))
    length = SPACING / np.hypot(1 / 8, 2 / 12)
    sunk = periodic_displacement(3.0 + wave, SPACING, MODULUS)
    exact = wave * length / (np.pi * MODULUS)
    np.testing.assert_allclose(sunk, exact, atol=1e-15 * length)


def test_a_wrong_pressure_is_seen():
    spacing = Surface("rough", 32).spacing
    rng = np.random.default_rng(2)
    pressure = rng.random((32, 32)) * (rng.random((32, 32)) < 0.5) * 100
    # Heights made so that the gap closes exactly where there is pressure and is open elsewhere.
    heights = displacement(pressure, spacing, MODULUS) - 0.001 * (pressure == 0)
    far_field = heights.max()
    load = pressure.mean()

    def gap_error(pressure, **control):
        return evaluate(pressure, heights, spacing, MODULUS, **control).gap_error

    assert gap_error(pressure, far_field=far_field) < 1e-12
    assert gap_error(pressure, load=load) < 1e-12
    moved = gap_error(pressure, far_field=far_field + 1e-5)
    assert moved == pytest.approx(1e-5 / heights.std(), rel=1e-6)
    # Contact where the gap is open by a micrometre.
    pressure[np.unravel_index(np.argmin(pressure), pressure.shape)] = 1e-9
    assert gap_error(pressure, load=load) > 0.1


@pytest.mark.parametrize(
    ("label", "steps", "periodic"),
    [
        ("gstlib, load", 1, True),
        ("gstlib, displacement", 1, False),
        ("gstlib, load", 3, False),
    ],
)
def test_runner_of_gstlib(label, steps, periodic):
    surface = Surface("rough", 32, periodic=periodic)
    result = run(CODES[label], surface, levels_of(surface, 76.0, steps), 1e-11)
    assert result.gap_error < GOAL
    assert 0 < result.contact_fraction < 0.5
    assert result.convolutions > 0
    assert result.peak_mb > 10


def test_the_readme_shows_the_rows(tmp_path, monkeypatch):
    readme = tmp_path / "README.md"
    shown = report.README.read_text("utf-8")
    readme.write_text(shown, "utf-8")
    monkeypatch.setattr(report, "README", readme)
    report.write_report(RESULTS)
    assert readme.read_text("utf-8") == shown
