"""A surface in, a contact dataset out: a path, a pressure alone, and two rough faces."""

import numpy as np
import pytest
import xarray as xr
from gstlib.contact import (
    contact_at_pressure,
    contact_path,
    interface_stiffness,
    laid_height,
    load_path_table,
    pressed_height,
    turned_over,
)
from gstlib.errors import InputError
from gstlib.surface import make_surface

ALONE = {
    "source": "surface.h5",
    "contact_modulus_MPa": 12820.0,
    "target_pressure_MPa": 50.0,
    "tolerance": 1e-9,
}
SETTINGS = ALONE | {"steps": 4, "maximum_displacement_um": 50.0}


def rough(seed, shape=(24, 32), spacing=0.01):
    return make_surface(0.002 * np.random.default_rng(seed).standard_normal(shape), spacing)


HEIGHT = rough(5)
FACES = HEIGHT.to_dataset(name="height")


@pytest.fixture(scope="module")
def contact():
    return contact_path(FACES, **SETTINGS)


def test_fields_units_and_settings_of_a_path(contact):
    every = contact_path(FACES, every_step=True, **SETTINGS)
    assert every.pressure.dims == every.gap.dims == ("step", "y", "x")
    assert {name: v.attrs["units"] for name, v in every.data_vars.items()} == {
        "height": "mm",
        "pressure": "MPa",
        "gap": "mm",
        "displacement": "mm",
        "mean_pressure": "MPa",
        "contact_fraction": "1",
        "stiffness": "MPa/mm",
        "residual": "1",
    }
    np.testing.assert_allclose(every.pressure.mean(("y", "x")), every.mean_pressure, rtol=1e-12)
    np.testing.assert_array_equal((every.pressure > 0).mean(("y", "x")), every.contact_fraction)
    assert (contact.pressure == every.pressure[-1]).all()
    assert (contact.gap == every.gap[-1]).all()
    assert contact.attrs == {name: v for name, v in ALONE.items() if name != "source"}


def test_table_converts_to_micrometres(contact):
    table = load_path_table(contact)
    assert table.step.tolist() == [1, 2, 3, 4]
    np.testing.assert_allclose(table.displacement_um, contact.displacement * 1000)
    np.testing.assert_allclose(table.stiffness_MPa_per_um, contact.stiffness / 1000)
    np.testing.assert_array_equal(table.mean_pressure_MPa, contact.mean_pressure)
    np.testing.assert_array_equal(table.contact_fraction, contact.contact_fraction)


def test_a_pressure_alone_is_the_end_of_the_path(contact):
    alone = contact_at_pressure(FACES, **ALONE)
    assert float(alone.displacement) == pytest.approx(float(contact.displacement[-1]), rel=1e-9)
    np.testing.assert_allclose(alone.pressure, contact.pressure, atol=1e-6)
    np.testing.assert_allclose(alone.gap, contact.gap, atol=1e-9)
    assert float(alone.contact_fraction) == float((alone.pressure > 0).mean())
    assert float(alone.residual) <= 1e-9
    assert alone.height.identical(HEIGHT)


def test_errors_of_the_solver_name_the_file_and_the_remedy():
    low = SETTINGS | {"target_pressure_MPa": 5e3, "maximum_displacement_um": 1.0}
    with pytest.raises(InputError, match=r"surface\.h5.*5000 MPa cannot be reached.*Lower"):
        contact_path(FACES, **low)
    holed = HEIGHT.copy()
    holed[3, 3] = np.nan
    with pytest.raises(InputError, match=r"surface\.h5: its contact could not be solved"):
        contact_at_pressure(holed.to_dataset(name="height"), **ALONE)


def test_full_contact_is_warned_of(caplog):
    """Heights a thousandth of the true ones, in nm for µm, are flat to the solver."""
    contact_path(FACES, **SETTINGS)
    assert caplog.messages == []
    contact_path(1e-3 * FACES, **SETTINGS)
    (warning,) = caplog.messages
    assert "surface.h5: 100 %" in warning


def test_without_pressure_the_contact_is_empty():
    empty = contact_path(FACES, **SETTINGS | {"target_pressure_MPa": 0.0})
    for name in ("displacement", "mean_pressure", "contact_fraction", "stiffness", "residual"):
        assert empty[name].values.tolist() == [0, 0, 0, 0]
    assert not empty.pressure.any()
    np.testing.assert_array_equal(empty.gap, HEIGHT.max() - HEIGHT)
    assert not contact_at_pressure(FACES, **ALONE | {"target_pressure_MPa": 0.0}).pressure.any()


# A patch as it lies on the stone.


def test_a_plane_and_the_surroundings_enter_the_contact_and_not_the_stored_height():
    y, x = (axis - axis.mean() for axis in (HEIGHT.y, HEIGHT.x))
    plane, sunk = 0.02 * y - 0.05 * x, 1e-3 * (x / x.max()) ** 2 + 0 * y
    laid = FACES.assign(surroundings=sunk.transpose("y", "x"))
    laid = laid.assign_attrs(slope_y=0.02, slope_x=-0.05)
    heights = (HEIGHT + plane).transpose("y", "x")
    np.testing.assert_allclose(laid_height(laid), heights, atol=1e-12)
    np.testing.assert_allclose(pressed_height(laid), heights - laid.surroundings, atol=1e-12)
    found = contact_at_pressure(laid, **ALONE)
    summed = heights - laid.surroundings
    alone = contact_at_pressure(HEIGHT.copy(data=summed).to_dataset(name="height"), **ALONE)
    np.testing.assert_allclose(found.pressure, alone.pressure, atol=1e-6)
    assert found.height.identical(HEIGHT)
    level = contact_at_pressure(FACES, **ALONE)
    assert abs(found.pressure - level.pressure).max() > 10


def test_the_stiffness_of_the_interface_leaves_out_that_of_a_flat_punch(contact):
    """1.1516 E*/side for a square punch (Borodachev 1976); compliances add."""
    square = contact_path(rough(3, (64, 64)).to_dataset(name="height"), **SETTINGS)
    punch = 1.1516 * 12820.0 / 0.64
    whole, alone = square.stiffness.values, interface_stiffness(square).values
    np.testing.assert_allclose(1 / whole - 1 / alone, 1 / punch, rtol=6e-3)  # 64 elements a side
    assert (alone > whole).all()


# Two rough faces.

FILES = {"source": "counterface.h5", "patch_source": "7_T0.h5"}


def pressed(lower, upper):
    """Contact where `upper` is turned over onto `lower`."""
    settings = ALONE | {"target_pressure_MPa": 40.0, "tolerance": 1e-10}
    return contact_at_pressure(faced(lower, upper), **settings)


def faced(lower, upper):
    return xr.Dataset({"height": lower, "counterface": turned_over(upper, lower, **FILES)})


def test_who_presses_whom_does_not_matter():
    """Seen from above its own face, each has the pressures of the other, mirrored along x."""
    a, b = rough(1), rough(2)
    onto_a, onto_b = pressed(a, b), pressed(b, a)
    assert (onto_a.pressure > 0).any()
    np.testing.assert_allclose(
        onto_a.pressure, onto_b.pressure.values[:, ::-1], atol=1e-6 * float(onto_a.pressure.max())
    )
    np.testing.assert_array_equal(pressed_height(onto_a), a.values + b.values[:, ::-1])
    path = contact_path(faced(a, b), **SETTINGS | {"target_pressure_MPa": 40.0})
    np.testing.assert_allclose(path.pressure, onto_a.pressure, atol=1e-4)
    assert path.height.identical(a)
    assert path.counterface.identical(onto_a.counterface)


def test_a_summit_of_the_counterface_is_pressed_on_the_mirrored_place():
    flat = make_surface(np.zeros((20, 24)), 0.01)
    summit = flat.copy()
    summit[3, 5] = 0.001
    pressure = pressed(flat, summit).pressure.values
    assert np.unravel_index(pressure.argmax(), pressure.shape) == (3, 24 - 1 - 5)


@pytest.mark.parametrize("other", [rough(2, shape=(20, 23)), rough(2, (20, 24), spacing=0.0101)])
def test_another_grid_is_refused(other):
    message = r"counterface\.h5: .*7_T0\.h5 has 24 × 20 points every 0.01"
    with pytest.raises(InputError, match=message):
        turned_over(other, rough(1, (20, 24)), **FILES)
