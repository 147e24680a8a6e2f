"""A surface in, a contact dataset out: a path, a pressure alone, and two rough faces."""

import numpy as np
import pytest
import xarray as xr
from contacts import around, interface, rough
from gstlib.contact import Contact, Load, contact_at_pressure, contact_path, turned_over
from gstlib.errors import InputError
from gstlib.microscale.patches import with_interface_stiffness

LOAD = Load(50.0)
SOURCE = {"modulus": 12820.0, "tolerance": 1e-9, "source": "surface.h5"}
PATH = SOURCE | {"steps": 4, "maximum_displacement_um": 50.0}


HEIGHT = rough(5)
FACES = interface(HEIGHT)


@pytest.fixture(scope="module")
def contact():
    return contact_path(FACES, LOAD, **PATH)


def test_fields_units_and_settings_of_a_path(contact):
    every = contact_path(FACES, LOAD, every_step=True, **PATH)
    stored, short = every.to_dataset(), contact.to_dataset()
    assert set(stored.data_vars) - set(short.data_vars) == {"path_pressure", "path_gap"}
    units = {"pressure": "MPa", "gap": "mm", "path_pressure": "MPa", "path_stiffness": "MPa/mm"}
    assert {name: stored[name].attrs["units"] for name in units} == units
    pressure = np.stack([state.pressure for state in every.states])
    np.testing.assert_allclose(pressure.mean((1, 2)), every.mean_pressure, rtol=1e-12)
    np.testing.assert_array_equal((pressure > 0).mean((1, 2)), every.contact_fraction)
    for found in (contact, every):
        assert (found.final.pressure == pressure[-1]).all()
        for name in ("displacement", "mean_pressure", "contact_fraction", "residual"):
            assert getattr(found.final, name) == getattr(every, name)[-1]


def same(one, other):
    """Two contacts, number by number."""
    xr.testing.assert_identical(one.to_dataset(), other.to_dataset())
    return True


@pytest.mark.parametrize(
    "faces",
    [
        interface(HEIGHT, rough(6)),
        interface(HEIGHT, slopes=(0.01, -0.02), surroundings=np.full(HEIGHT.shape, 1e-3)),
        interface(HEIGHT, rough(6), slopes=(0.01, 0.0), surroundings=np.zeros(HEIGHT.shape)),
    ],
    ids=["scanned face", "placed", "placed with a scanned face"],
)
def test_the_variables_of_a_contact_are_the_same_in_every_case(faces):
    """And it is the same contact when it has been stored."""
    found = contact_at_pressure(faces, LOAD, **SOURCE)
    stored, alike = (of.to_dataset() for of in (found, contact_at_pressure(FACES, LOAD, **SOURCE)))
    assert set(stored.variables) == set(alike.variables)
    for name, variable in stored.variables.items():
        told = variable.dims, variable.dtype, variable.attrs
        assert told == (alike[name].dims, alike[name].dtype, alike[name].attrs), name
    assert same(Contact.from_dataset(stored), found)


def test_the_force_acts_where_the_load_says_wherever_the_grid_begins():
    """A ball under a force on its summit stays as it is; beside it, it rolls there."""
    along = 0.1 * (np.arange(25) - 12)
    ball = around(-np.add.outer(along**2, along**2) / (2 * 50.0), 0.1, shift=3.0)
    summit = float(ball.y[12])
    for off in (0.0, 0.1):
        load = Load(5.0, load_point=(summit, summit + off))
        rests = contact_at_pressure(interface(ball), load, **SOURCE)
        plane = rests.interface.plane
        assert plane.slope_y == pytest.approx(0, abs=1e-7)
        assert plane.slope_x == pytest.approx(off / 50.0, rel=0.02, abs=1e-7)


@pytest.mark.parametrize("tolerance", [1e-10, 1e-8])
def test_a_contact_is_solved_as_exactly_as_it_says(tolerance):
    alone = contact_at_pressure(FACES, LOAD, **SOURCE | {"tolerance": tolerance})
    along = contact_path(FACES, LOAD, **PATH | {"tolerance": tolerance})
    assert max(alone.residual, along.final.residual) <= tolerance


def test_errors_of_the_solver_name_the_file_and_the_remedy():
    high, little = Load(5e3), {"maximum_displacement_um": 1.0}
    with pytest.raises(InputError, match=r"surface\.h5.*5000 MPa cannot be reached.*Lower"):
        contact_path(FACES, high, **PATH | little)
    needed_um = 1e3 * contact_path(FACES, LOAD, **PATH).final.displacement
    contact_path(FACES, LOAD, **PATH | {"maximum_displacement_um": 1.01 * needed_um})
    with pytest.raises(InputError, match="cannot be reached"):
        contact_path(FACES, LOAD, **PATH | {"maximum_displacement_um": 0.99 * needed_um})
    beside = Load(50.0, load_point=(0.12, 0.33))
    with pytest.raises(
        InputError, match=r"surface\.h5: the stone tips over.*x 0\.33, y 0\.12 mm.*at_mm"
    ):
        contact_at_pressure(FACES, beside, **SOURCE)
    spike = HEIGHT.copy()
    spike[3, 3] = np.inf
    with pytest.raises(InputError, match=r"surface\.h5: its contact could not be solved"):
        contact_at_pressure(interface(spike), LOAD, **SOURCE)


def test_full_contact_is_warned_of(caplog):
    """Heights a thousandth of the true ones, in nm for µm, are flat to the solver."""
    contact_path(FACES, LOAD, **PATH)
    assert caplog.messages == []
    contact_path(interface(1e-3 * HEIGHT), LOAD, **PATH)
    (warning,) = caplog.messages
    assert "surface.h5: 100 %" in warning


def test_without_pressure_the_contact_is_empty():
    nothing = Load(0.0)
    empty = contact_path(FACES, nothing, **PATH)
    for name in ("displacement", "mean_pressure", "contact_fraction", "residual"):
        assert not getattr(empty, name).any()
        assert getattr(empty.final, name) == 0
    assert not empty.stiffness.any()
    assert not empty.final.pressure.any()
    np.testing.assert_allclose(empty.final.gap, HEIGHT.max() - HEIGHT, rtol=1e-6)
    assert not contact_at_pressure(FACES, nothing, **SOURCE).pressure.any()


# A patch as it lies on the stone.


def test_a_plane_and_the_surroundings_enter_the_contact_and_not_the_stored_height():
    y, x = (axis - axis.mean() for axis in (HEIGHT.y, HEIGHT.x))
    plane, sunk = 0.02 * y - 0.05 * x, 1e-3 * (x / x.max()) ** 2 + 0 * y
    sunk = sunk.transpose("y", "x").values
    laid = interface(HEIGHT, slopes=(0.02, -0.05), surroundings=sunk)
    heights = (HEIGHT + plane).transpose("y", "x")
    np.testing.assert_allclose(laid.laid, heights, atol=1e-12)
    np.testing.assert_allclose(laid.pressed, heights - sunk, atol=1e-12)
    found = contact_at_pressure(laid, LOAD, **SOURCE)
    summed = interface(HEIGHT.copy(data=heights - sunk))
    alone = contact_at_pressure(summed, LOAD, **SOURCE)
    np.testing.assert_allclose(found.pressure, alone.pressure, atol=1e-6)
    assert found.interface.height.equals(HEIGHT)


def test_the_stiffness_of_the_interface_leaves_out_that_of_a_flat_punch():
    """1.1516 E*/side for a square punch (Borodachev 1976); compliances add."""
    square = contact_path(interface(rough(3, (64, 64))), LOAD, **PATH)
    punch = 1.1516 * 12820.0 / 0.64
    whole = square.stiffness
    alone = with_interface_stiffness(square).interface_stiffness
    np.testing.assert_allclose(1 / whole - 1 / alone, 1 / punch, rtol=6e-3)  # 64 elements a side
    assert (alone > whole).all()


# Two rough faces.

FILES = {"source": "counterface.h5", "patch_source": "7_T0.h5"}
LIGHT = SOURCE | {"tolerance": 1e-10}


def pressed(lower, upper):
    """The two, where `upper` is turned over onto `lower`."""
    faces = interface(lower, turned_over(upper, lower, **FILES))
    return contact_at_pressure(faces, Load(40.0), **LIGHT)


def test_who_presses_whom_does_not_matter():
    """Seen from above its own face, each has the pressures of the other, mirrored along x."""
    a, b = rough(1), rough(2)
    onto_a, onto_b = pressed(a, b), pressed(b, a)
    assert (onto_a.pressure > 0).any()
    np.testing.assert_allclose(
        onto_a.pressure, onto_b.pressure.values[:, ::-1], atol=1e-6 * float(onto_a.pressure.max())
    )
    np.testing.assert_array_equal(onto_a.interface.pressed, a.values + b.values[:, ::-1])


@pytest.mark.parametrize("other", [rough(2, shape=(20, 23)), rough(2, (20, 24), spacing=0.0101)])
def test_another_grid_is_refused(other):
    message = r"counterface\.h5: .*7_T0\.h5 has 24 × 20 points every 0.01"
    with pytest.raises(InputError, match=message):
        turned_over(other, rough(1, (20, 24)), **FILES)
