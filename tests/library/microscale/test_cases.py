"""Slip and a cap: closed forms, what they obey, and the rows of the table."""

import numpy as np
import pytest
from contacts import interface, rough
from gstlib.bem.closed_forms import Sphere
from gstlib.contact import Load, contact_at_pressure
from gstlib.microscale.slip_and_cap import (
    capped_numbers,
    case_table,
    slip_numbers,
    solve_capped,
    solve_slip,
)
from gstlib.surfaces.grid import make_surface

LOAD = Load(50.0)
SOURCE = {"modulus": 12820.0, "tolerance": 1e-9, "source": "surface.h5"}
GRINDING = {"friction": 0.4, "tangential_ratio": 0.5, "poisson": 0.3}
PRESSURE_CAP = 2000.0


FACES = interface(rough(5))


@pytest.fixture(scope="module")
def contact():
    return contact_at_pressure(FACES, LOAD, **SOURCE)


# Slip, with Cattaneo and Mindlin's sphere as the closed form.

RADIUS, SPACING, MODULUS, POISSON = 1.0, 0.004, 10000.0, GRINDING["poisson"]


@pytest.fixture(scope="module")
def sphere():
    centres = (np.arange(96) - 47.5) * SPACING
    height = make_surface(-(centres[:, None] ** 2 + centres**2) / (2 * RADIUS), SPACING)
    return contact_at_pressure(interface(height), Load(30.0), **SOURCE | {"modulus": MODULUS})


@pytest.mark.parametrize("ratio", [0.3, 0.6, 0.9])
def test_sphere_sticks_and_moves_as_cattaneo_and_mindlin_say(sphere, ratio):
    friction = GRINDING["friction"]
    slip = solve_slip(sphere, **GRINDING | {"tangential_ratio": ratio})
    found = slip_numbers(slip)
    force = 30.0 * sphere.pressure.size * SPACING**2
    exact = Sphere(force, RADIUS, MODULUS)
    radius, stick = exact.contact_radius, exact.stick_radius(ratio)
    assert 1 - found["slip share"] == pytest.approx((stick / radius) ** 2, abs=0.02)
    assert int(slip.slip.sum()) * SPACING**2 == pytest.approx(
        np.pi * (radius**2 - stick**2), rel=0.05
    )
    assert found["mean traction"] == pytest.approx(friction * ratio * 30.0, rel=1e-9)
    compliances = (2 - POISSON) / (2 * (1 - POISSON))
    closed = friction * compliances * (radius**2 - stick**2) / RADIUS
    assert found["tangential displacement"] == pytest.approx(1e3 * closed, rel=0.01)
    np.testing.assert_array_equal(slip.stick | slip.slip, sphere.pressure > 0)
    assert not (slip.stick & slip.slip).any()


def test_coulomb_holds_and_everything_slips_at_the_end(contact):
    limit = 0.4 * contact.pressure.values
    half, none, all_of_it = (
        solve_slip(contact, **GRINDING | {"tangential_ratio": ratio}) for ratio in (0.5, 0, 1)
    )
    assert np.all(half.traction <= limit)
    assert half.traction.min() > -1e-6 * limit.max()
    np.testing.assert_array_equal(half.traction.values[half.slip], limit[half.slip])
    assert half.stick.any()
    assert half.slip.any()
    assert not none.slip.any()
    assert not all_of_it.stick.any()
    np.testing.assert_allclose(all_of_it.traction, limit)


# A cap on the pressure.


def test_a_cap_holds_and_its_rows_agree_with_the_fields(contact):
    hardness = 0.3 * float(contact.pressure.max())
    limited = solve_capped(contact, pressure_cap=hardness)
    study, cap = capped_numbers(contact, limited)
    elastic, plastic = contact.pressure.values > 0, limited.pressure.values > 0
    at_cap = limited.pressure.values == hardness
    assert limited.pressure.max() == hardness
    assert float(limited.pressure.mean()) == pytest.approx(50.0, rel=1e-9)
    assert study["contact fraction"] == elastic.mean()
    assert cap["share at the cap"] == pytest.approx(at_cap.sum() / plastic.sum())
    assert cap["contact fraction"] == plastic.mean() > study["contact fraction"]
    assert cap["displacement"] > study["displacement"]
    assert cap["deepest yield"] == pytest.approx(-1e3 * float(limited.gap.min()))
    assert cap["deepest yield"] > 0


def test_a_patch_that_no_cap_lets_bear_its_load_is_left_out(contact, caplog):
    """Nothing else is lost: that its mean pressure is too high is known only when it is solved."""
    mean = float(contact.pressure.mean())
    table = case_table({"7": contact}, grinding=GRINDING, pressure_cap=mean)
    assert set(table.case[table.patch == "7"]) == {"grinding"}
    assert caplog.text.count("patch 7") == 1


# Both.


def test_slip_and_cap_of_two_rough_faces_are_those_of_their_sum():
    lower, upper = rough(1), rough(2)
    both = contact_at_pressure(interface(lower, upper), LOAD, **SOURCE)
    alone = contact_at_pressure(interface(both.interface.pressed), LOAD, **SOURCE)
    for solve, options in ((solve_slip, GRINDING), (solve_capped, {"pressure_cap": PRESSURE_CAP})):
        one, other = (solve(contact, **options) for contact in (both, alone))
        for name, variable in one.data_vars.items():
            np.testing.assert_allclose(variable, other[name], atol=1e-4)


# The table.


def test_the_cases_asked_for_are_those_that_are_solved(contact):
    """The study's own values stand first, and only where a case has others."""
    patches = {"7": contact, "5": contact}
    for grinding, hardness, cases in (
        (None, None, []),
        (GRINDING, None, ["grinding"]),
        (None, PRESSURE_CAP, ["study", "cap"]),
        (GRINDING, PRESSURE_CAP, ["study", "grinding", "cap"]),
    ):
        table = case_table(patches, grinding=grinding, pressure_cap=hardness)
        assert list(table.columns) == ["case", "patch", "quantity", "unit", "value"]
        assert table.case.unique().tolist() == cases
        assert table.patch[table.patch != ""].unique().tolist() == ["7", "5"] * bool(cases)
        assert not table.duplicated(["case", "patch", "quantity"]).any()
    settings = table[table.patch == ""].set_index("quantity").value.to_dict()
    assert settings == {"friction": 0.4, "tangential ratio": 0.5, "pressure cap": PRESSURE_CAP}
