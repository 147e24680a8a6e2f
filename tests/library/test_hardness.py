"""A contact with a ceiling on its pressure beside the elastic one."""

import numpy as np
import pytest

from gstlib.contact import contact_dataset, solve_path
from gstlib.hardness import hardness_dataset, hardness_summary
from gstlib.surface import make_surface

SETTINGS = {
    "contact_modulus_MPa": 12820.0,
    "target_pressure_MPa": 50.0,
    "steps": 1,
    "tolerance": 1e-8,
    "maximum_displacement_um": 50.0,
}


@pytest.fixture(scope="module")
def contact():
    height = make_surface(0.002 * np.random.default_rng(5).standard_normal((24, 32)), 0.01)
    path = solve_path(height, source="surface.h5", keep_states=False, **SETTINGS)
    return contact_dataset(height, path, every_step=False).assign_attrs(SETTINGS)


def test_a_hardness_out_of_reach_changes_nothing(contact):
    beyond = 2 * float(contact.pressure.max())
    limited = hardness_dataset(contact, source="x", hardness_MPa=beyond)
    row = hardness_summary(contact, limited)
    np.testing.assert_allclose(limited.pressure, contact.pressure, atol=1e-4)
    assert row["dice"] == row["iou"] == 1
    assert row["ceiling_share"] == row["deepest_yield_um"] == 0
    assert row["displacement_um"] == pytest.approx(row["elastic_displacement_um"], rel=1e-6)


def test_the_row_says_what_the_fields_say(contact):
    hardness = 0.3 * float(contact.pressure.max())
    limited = hardness_dataset(contact, source="x", hardness_MPa=hardness)
    row = hardness_summary(contact, limited)
    elastic, plastic = contact.pressure.values > 0, limited.pressure.values > 0
    at_ceiling = limited.pressure.values == hardness
    assert row["elastic_peak_pressure_MPa"] == contact.pressure.max()
    assert row["ceiling_share"] == pytest.approx(at_ceiling.sum() / plastic.sum())
    assert row["contact_fraction"] > row["elastic_contact_fraction"]
    assert row["displacement_um"] > row["elastic_displacement_um"]
    assert row["iou"] == pytest.approx((elastic & plastic).sum() / (elastic | plastic).sum())
    assert row["dice"] == pytest.approx(2 * row["iou"] / (1 + row["iou"]))
    assert row["deepest_yield_um"] == pytest.approx(-1e3 * float(limited.gap.min()))
    assert row["deepest_yield_um"] > 0
    assert all(v.attrs["units"] and v.attrs["long_name"] for v in limited.data_vars.values())
