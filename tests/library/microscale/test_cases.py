"""Slip and a cap: closed forms, conditions that hold, and the rows of the table."""

import numpy as np
import pytest
from bem_reference import sphere
from contacts import pressed, rough
from numpy.testing import assert_allclose, assert_array_equal

from gstlib.bem.closed_forms import Sphere
from gstlib.bem.errors import ContactInputError
from gstlib.microscale.slip_and_cap import (
    capped_numbers,
    case_table,
    slip_numbers,
    solve_capped,
    solve_slip,
)
from gstlib.surfaces.grid import make_surface

GRINDING = {"friction": 0.4, "tangential_ratio": 0.5, "poisson": 0.3}
MEAN_MPa = 50.0


@pytest.fixture(scope="module")
def contact():
    return pressed(rough(5), mean_pressure=MEAN_MPa, modulus=12820.0, tolerance=1e-9)


@pytest.mark.parametrize("ratio", [0.3, 0.9])
def test_sphere_sticks_and_moves_as_cattaneo_and_mindlin_say(ratio):
    spacing, radius, modulus = 0.004, 1.0, 1e4
    ball = make_surface(sphere(96, spacing, radius), spacing)
    contact = pressed(ball, mean_pressure=30.0, modulus=modulus, tolerance=1e-9)
    slip = solve_slip(contact, **GRINDING | {"tangential_ratio": ratio})
    exact = Sphere(30.0 * ball.size * spacing**2, radius, modulus)
    contact_mm, stick_mm = exact.contact_radius, exact.stick_radius(ratio)
    numbers = slip_numbers(slip)
    assert 1 - numbers["slip share"] == pytest.approx(
        (stick_mm / contact_mm) ** 2, abs=0.02
    )
    assert numbers["mean traction"] == pytest.approx(0.4 * ratio * 30.0, rel=1e-9)
    compliances = (2 - 0.3) / (2 * (1 - 0.3))
    closed_mm = 0.4 * compliances * (contact_mm**2 - stick_mm**2) / radius
    assert numbers["tangential displacement"] == pytest.approx(
        1e3 * closed_mm, rel=0.01
    )
    assert_array_equal(slip.stick ^ slip.slip, contact.pressure > 0)


@pytest.mark.parametrize(
    ("name", "value"),
    [("tangential_ratio", np.nan), ("friction", 0.0), ("poisson", 2.0)],
)
def test_a_grinding_force_beyond_its_range_is_refused(contact, name, value):
    with pytest.raises(ContactInputError, match=f"{name} must .* got {value}"):
        solve_slip(contact, **GRINDING | {name: value})


def test_coulomb_holds_and_everything_slips_at_the_end(contact):
    limit = 0.4 * contact.pressure.values
    half, none, full = (
        solve_slip(contact, **GRINDING | {"tangential_ratio": ratio})
        for ratio in (0.5, 0, 1)
    )
    assert np.all(half.traction <= limit)
    assert half.traction.min() > -1e-6 * limit.max()
    assert_array_equal(half.traction.values[half.slip], limit[half.slip])
    assert half.stick.any()
    assert half.slip.any()
    assert not none.slip.any()
    assert not full.stick.any()
    assert_allclose(full.traction, limit)


def test_a_cap_holds_and_its_rows_agree_with_the_fields(contact):
    hardness = 0.3 * float(contact.pressure.max())
    limited = solve_capped(contact, pressure_cap=hardness)
    pressure = limited.pressure.values
    assert pressure.max() == hardness
    assert pressure.mean() == pytest.approx(MEAN_MPa, rel=1e-9)
    elastic, plastic = capped_numbers(contact, limited)
    touching = pressure > 0
    assert elastic["contact fraction"] == (contact.pressure.values > 0).mean()
    assert plastic["contact fraction"] == touching.mean() > elastic["contact fraction"]
    at_cap = (pressure == hardness).sum() / touching.sum()
    assert plastic["share at the cap"] == pytest.approx(at_cap)
    assert plastic["displacement"] > elastic["displacement"]
    assert plastic["deepest yield"] == pytest.approx(-1e3 * float(limited.gap.min()))
    assert plastic["deepest yield"] > 0


def test_a_patch_that_no_cap_lets_bear_its_load_is_left_out(contact, caplog):
    """Nothing else is lost: its mean pressure is known only when it is solved."""
    mean = contact.load.mean_pressure
    table = case_table({"7": contact}, grinding=GRINDING, pressure_cap=mean)
    assert set(table.case[table.patch == "7"]) == {"grinding"}
    assert caplog.text.count("patch 7") == 1


@pytest.mark.parametrize(
    ("grinding", "pressure_cap", "cases"),
    [(GRINDING, None, ["grinding"]), (GRINDING, 2000.0, ["study", "grinding", "cap"])],
)
def test_the_cases_asked_for_are_those_that_are_solved(
    contact, grinding, pressure_cap, cases
):
    """The study's own values stand first, and only where a case has others."""
    table = case_table({"7": contact}, grinding=grinding, pressure_cap=pressure_cap)
    assert table.case.unique().tolist() == cases
    settings = table[table.patch == ""].set_index("quantity").value
    caps = [] if pressure_cap is None else [pressure_cap]
    assert settings.tolist() == [0.4, 0.5, *caps]
