"""Intervals of the patches' pressures: cases whose answer is known, solutions one by one."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from gstlib.contact import contact_at_pressure
from gstlib.coupling import patch_pressures
from gstlib.surface import make_surface
from gstlib.uncertainty import draw_contact_moduli, pressure_intervals, pressures_of_moduli

SPACING = 0.05  # mm; the square is 5 mm wide
STONES = {"young_1_MPa": 20000.0, "poisson_1": 0.25, "young_2_MPa": 20000.0, "poisson_2": 0.25}
PATCHES = pd.DataFrame(
    {
        "patch": ["1", "2"],
        "x_mm": [1.5, 3.2],
        "y_mm": [2.5, 1.7],
        "rotation_deg": [0.0, 12.0],
    }
)
TIMES_SD = 1.959964  # half of a normal 95 % interval


def square(of_place):
    centres = (np.arange(100) + 0.5) * SPACING
    y, x = np.meshgrid(centres, centres, indexing="ij")
    return make_surface(of_place(y, x), SPACING)


def patchy(seed=1):
    generator = np.random.default_rng(seed)
    values = generator.exponential(100.0, (100, 100)) * (generator.uniform(size=(100, 100)) < 0.2)
    return square(lambda y, x: values)


def intervals(pressures, shares, placement_um, seed=1):
    patches = patch_pressures(pressures.sel(share=1), PATCHES, size_mm=0.85)
    return pressure_intervals(
        patches,
        pressures,
        shares,
        size_mm=0.85,
        placement_um=placement_um,
        generator_of=lambda patch: np.random.default_rng([seed, *patch.encode()]),
    )


def at_one(pressure):
    return pressure.expand_dims(share=[1.0])


def test_in_a_plane_field_the_interval_is_slope_times_placement():
    slope_x, slope_y, sd = 30.0, 40.0, 0.03
    plane = square(lambda y, x: 200.0 + slope_x * x + slope_y * y)
    found = intervals(at_one(plane), np.ones(20000), placement_um=sd * 1e3)
    half = TIMES_SD * np.hypot(slope_x, slope_y) * sd
    for end, sign in (("low", -1), ("high", 1)):
        expected = found.pressure_MPa + sign * half
        np.testing.assert_allclose(found[f"{end}_MPa"], expected, atol=0.04 * half)
        np.testing.assert_allclose(found[f"placement_{end}_MPa"], found[f"{end}_MPa"])
        np.testing.assert_allclose(found[f"material_{end}_MPa"], found.pressure_MPa)


def test_without_uncertainty_the_interval_is_the_pressure():
    found = intervals(at_one(patchy()), np.ones(100), placement_um=0.0)
    for column in found.columns[2:]:
        np.testing.assert_allclose(found[column], found.pressure_MPa, rtol=1e-12)


class Shifts:
    """Stands for a random generator whose draws (y, x) are known."""

    def __init__(self, shifts):
        self.shifts = shifts

    def standard_normal(self, shape):
        return np.broadcast_to(self.shifts, shape)


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.5, 0.5), (1.5, 2.0), (2.5, 3.0)])  # elements
@pytest.mark.parametrize(
    ("x_mm", "y_mm", "rotation_deg", "signs"),
    [
        (1.5, 2.5, 0.0, (1, 1)),
        (3.2, 1.7, 12.0, (1, 1)),
        (0.425, 4.575, 0.0, (-1, 1)),
        (0.425, 4.575, 0.0, (1, -1)),  # outwards
        (4.57, 4.56, 0.0, (-1, -1)),
    ],
)
def test_a_shifted_patch_is_the_patch_at_that_place(x_mm, y_mm, rotation_deg, signs, shift):
    """Anywhere in the square, and at its edges, where it stays."""
    field, shift = patchy(), SPACING * np.multiply(shift, signs)
    stated = pd.DataFrame(
        {"patch": ["1"], "x_mm": x_mm, "y_mm": y_mm, "rotation_deg": rotation_deg}
    )

    def end(shift):
        found = pressure_intervals(
            stated.assign(pressure_MPa=0.0),
            at_one(field),
            np.ones(1),
            size_mm=0.85,
            placement_um=1000.0,
            generator_of=lambda patch: Shifts(shift),
        )
        return found.low_MPa[0]

    moved = patch_pressures(field, stated, size_mm=0.85, shift_um=1e3 * shift[::-1])
    assert end(shift) == pytest.approx(moved.pressure_MPa[0], rel=1e-9)


def test_moduli_vary_as_their_stones_do():
    def draw(young_share, poisson, stones=STONES):
        return draw_contact_moduli(
            stones,
            young_share=young_share,
            poisson=poisson,
            draws=20000,
            generator=np.random.default_rng(3),
        )

    np.testing.assert_allclose(draw(0.0, 0.0), 1.0, rtol=1e-12)
    # two like stones of half of the compliance each
    assert np.log(draw(0.1, 0.0)).std() == pytest.approx(0.1 / np.sqrt(2), rel=0.02)
    # of one stone alone, against a rigid one: lognormal, however wide
    alone = np.log(draw(0.5, 0.0, STONES | {"young_2_MPa": 1e15}))
    assert alone.mean() == pytest.approx(0, abs=0.02)
    assert alone.std() == pytest.approx(0.5, rel=0.02)
    # d(1 - ν²) = -2ν dν over 1 - ν²
    assert draw(0.0, 0.02).std() == pytest.approx(0.02 * 0.5 / 0.9375 / np.sqrt(2), rel=0.03)


def test_between_the_moduli_pressures_are_linear_in_their_logarithm():
    field = patchy()
    fields = xr.concat([0.9 * field, field, 1.1 * field], pd.Index([0.5, 1.0, 2.0], name="share"))
    found = intervals(fields, np.array([np.sqrt(2)]), placement_um=0.0)
    np.testing.assert_allclose(found.material_low_MPa, 1.05 * found.pressure_MPa, rtol=1e-9)


def test_pressures_between_the_moduli_are_those_of_a_solution():
    generator = np.random.default_rng(5)
    rough = square(lambda y, x: 2e-3 * np.sin(3 * x) * np.cos(2 * y)).copy()
    rough += 1e-4 * generator.standard_normal(rough.shape)
    settings = {"contact_modulus_MPa": 10000.0, "target_pressure_MPa": 5.0, "tolerance": 1e-8}

    def solved(share):
        scaled = settings | {"contact_modulus_MPa": share * 10000.0}
        return contact_at_pressure(rough, source="here", **scaled).pressure

    shares = np.array([0.7, 0.93, 1.2])
    fields = pressures_of_moduli(rough, solved(1.0), shares, source="here", **settings)
    assert (np.diff(fields.share) > 0).all()
    assert fields.share.min() == pytest.approx(0.7)
    assert fields.share.max() == pytest.approx(1.2)
    np.testing.assert_allclose(fields.mean(["y", "x"]), 5.0, rtol=1e-6)
    # one draw alone: both ends of its interval are the pressure at its modulus
    for share in shares:
        found = intervals(fields, np.array([share]), placement_um=0.0)
        expected = patch_pressures(solved(share), PATCHES, size_mm=0.85).pressure_MPa
        np.testing.assert_allclose(found.low_MPa, expected, rtol=0.02)
        np.testing.assert_allclose(found.low_MPa, found.material_high_MPa)
