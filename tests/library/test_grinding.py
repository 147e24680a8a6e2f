"""Stick and slip of a stored contact, with Cattaneo and Mindlin's sphere as the closed form."""

import numpy as np
import pytest

from gstlib.contact import contact_dataset, solve_path
from gstlib.grinding import slip_dataset, slip_summary
from gstlib.surface import make_surface

RADIUS, SPACING, MODULUS, POISSON = 1.0, 0.004, 10000.0, 0.3
SETTINGS = {
    "contact_modulus_MPa": MODULUS,
    "target_pressure_MPa": 30.0,
    "steps": 1,
    "tolerance": 1e-9,
    "maximum_displacement_um": 100.0,
}


@pytest.fixture(scope="module")
def sphere():
    centres = (np.arange(96) - 47.5) * SPACING
    height = make_surface(-(centres[:, None] ** 2 + centres**2) / (2 * RADIUS), SPACING)
    path = solve_path(height, source="sphere", keep_states=False, **SETTINGS)
    return contact_dataset(height, path, every_step=False).assign_attrs(SETTINGS)


@pytest.mark.parametrize("ratio", [0.3, 0.6, 0.9])
def test_sphere_sticks_and_moves_as_cattaneo_and_mindlin_say(sphere, ratio):
    friction = 0.4
    slip = slip_dataset(
        sphere, source="sphere", friction=friction, tangential_ratio=ratio, poisson=POISSON
    )
    row = slip_summary(slip)
    force = 30.0 * sphere.height.size * SPACING**2
    radius = (3 * force * RADIUS / (4 * MODULUS)) ** (1 / 3)
    # stick radius over contact radius is (1 - Q/μP)^(1/3)
    assert row["stick_share"] == pytest.approx((1 - ratio) ** (2 / 3), abs=0.02)
    assert row["stick_share"] + row["slip_share"] == pytest.approx(1)
    assert row["slip_area_fraction"] * sphere.height.size * SPACING**2 == pytest.approx(
        np.pi * radius**2 * (1 - (1 - ratio) ** (2 / 3)), rel=0.05
    )
    assert row["mean_traction_MPa"] == pytest.approx(friction * ratio * 30.0, rel=1e-9)
    compliances = (2 - POISSON) / (2 * (1 - POISSON))
    closed = friction * compliances * radius**2 / RADIUS * (1 - (1 - ratio) ** (2 / 3))
    assert row["tangential_displacement_um"] == pytest.approx(1e3 * closed, rel=0.01)


def test_stick_and_slip_make_up_the_stored_contact(sphere):
    slip = slip_dataset(
        sphere, source="sphere", friction=0.4, tangential_ratio=0.5, poisson=POISSON
    )
    np.testing.assert_array_equal(slip.stick | slip.slip, sphere.pressure > 0)
    assert not (slip.stick & slip.slip).any()
    assert slip.attrs["friction"] == 0.4
    assert all(v.attrs["units"] and v.attrs["long_name"] for v in slip.data_vars.values())
