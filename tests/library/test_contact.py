"""A surface in, a contact dataset out: a path, a pressure alone, and two rough faces."""

import numpy as np
import pytest
from contacts import rough
from gstlib.bem import load_path
from gstlib.contact import (
    Loading,
    contact_at_pressure,
    contact_path,
    faces_of,
    laid_height,
    load_path_table,
    pressed_height,
    turned_over,
)
from gstlib.errors import InputError
from gstlib.microscale.patches import with_interface_stiffness

LOADING = Loading(contact_modulus_MPa=12820.0, target_pressure_MPa=50.0, tolerance=1e-9)
SOURCE = {"source": "surface.h5"}
PATH = SOURCE | {"steps": 4, "maximum_displacement_um": 50.0}


HEIGHT = rough(5)
FACES = faces_of(HEIGHT)


@pytest.fixture(scope="module")
def contact():
    return contact_path(FACES, LOADING, **PATH)


def test_fields_units_and_settings_of_a_path(contact):
    every = contact_path(FACES, LOADING, every_step=True, **PATH)
    assert set(every.data_vars) - set(contact.data_vars) == {"path_pressure", "path_gap"}
    units = {"pressure": "MPa", "gap": "mm", "path_pressure": "MPa", "path_stiffness": "MPa/mm"}
    assert {name: every[name].attrs["units"] for name in units} == units
    pressure, gap = every.path_pressure, every.path_gap
    np.testing.assert_allclose(pressure.mean(("y", "x")), every.path_mean_pressure, rtol=1e-12)
    np.testing.assert_array_equal((pressure > 0).mean(("y", "x")), every.path_contact_fraction)
    for found in (contact, every):
        assert (found.pressure == pressure[-1]).all()
        assert (found.gap == gap[-1]).all()
        for name in ("displacement", "mean_pressure", "contact_fraction", "residual"):
            assert found[name] == every[f"path_{name}"][-1]
        assert Loading.of(found) == LOADING


@pytest.mark.parametrize(
    "faces",
    [
        faces_of(HEIGHT, rough(6)),
        faces_of(HEIGHT, slopes=(0.01, -0.02), surroundings=np.full(HEIGHT.shape, 1e-3)),
        faces_of(HEIGHT, rough(6), slopes=(0.01, 0.0), surroundings=np.zeros(HEIGHT.shape)),
    ],
    ids=["scanned face", "placed", "placed with a scanned face"],
)
def test_the_variables_of_a_contact_are_the_same_in_every_case(faces):
    found = contact_at_pressure(faces, LOADING, **SOURCE)
    alike = contact_at_pressure(FACES, LOADING, **SOURCE)
    assert set(found.variables) == set(alike.variables)
    for name, variable in found.variables.items():
        told = variable.dims, variable.dtype, variable.attrs
        assert told == (alike[name].dims, alike[name].dtype, alike[name].attrs), name


def test_a_patch_is_placed_even_where_its_surroundings_press_nothing():
    assert not FACES.placed
    assert faces_of(HEIGHT, surroundings=np.zeros(HEIGHT.shape)).placed


def test_table_converts_to_micrometres(contact):
    """Against the solver's own path."""
    path = load_path(HEIGHT.values, 0.01, 12820.0, target_pressure=50.0, steps=4, tolerance=1e-9)
    table = load_path_table(contact)
    assert table.step.tolist() == [1, 2, 3, 4]
    np.testing.assert_allclose(table.displacement_um, path.displacement * 1000)
    np.testing.assert_allclose(table.stiffness_MPa_per_um, path.stiffness / 1000)
    np.testing.assert_allclose(table.mean_pressure_MPa, path.mean_pressure)
    np.testing.assert_array_equal(table.contact_fraction, path.contact_fraction)


def test_errors_of_the_solver_name_the_file_and_the_remedy():
    high, little = LOADING._replace(target_pressure_MPa=5e3), {"maximum_displacement_um": 1.0}
    with pytest.raises(InputError, match=r"surface\.h5.*5000 MPa cannot be reached.*Lower"):
        contact_path(FACES, high, **PATH | little)
    beside = LOADING._replace(through=(0.12, 0.33))
    with pytest.raises(
        InputError, match=r"surface\.h5: the stone tips over.*x 0\.33, y 0\.12 mm.*at_mm"
    ):
        contact_at_pressure(FACES, beside, **SOURCE)
    spike = HEIGHT.copy()
    spike[3, 3] = np.inf
    with pytest.raises(InputError, match=r"surface\.h5: its contact could not be solved"):
        contact_at_pressure(faces_of(spike), LOADING, **SOURCE)


def test_full_contact_is_warned_of(caplog):
    """Heights a thousandth of the true ones, in nm for µm, are flat to the solver."""
    contact_path(FACES, LOADING, **PATH)
    assert caplog.messages == []
    contact_path(faces_of(1e-3 * HEIGHT), LOADING, **PATH)
    (warning,) = caplog.messages
    assert "surface.h5: 100 %" in warning


def test_without_pressure_the_contact_is_empty():
    nothing = LOADING._replace(target_pressure_MPa=0.0)
    empty = contact_path(FACES, nothing, **PATH)
    assert not any(empty[name].any() for name in empty if name.startswith("path_"))
    for name in ("displacement", "mean_pressure", "contact_fraction", "residual"):
        assert empty[name] == 0
    assert not empty.pressure.any()
    np.testing.assert_array_equal(empty.gap, np.float32(HEIGHT.max() - HEIGHT))
    assert not contact_at_pressure(FACES, nothing, **SOURCE).pressure.any()


# A patch as it lies on the stone.


def test_a_plane_and_the_surroundings_enter_the_contact_and_not_the_stored_height():
    y, x = (axis - axis.mean() for axis in (HEIGHT.y, HEIGHT.x))
    plane, sunk = 0.02 * y - 0.05 * x, 1e-3 * (x / x.max()) ** 2 + 0 * y
    sunk = sunk.transpose("y", "x").values
    laid = faces_of(HEIGHT, slopes=(0.02, -0.05), surroundings=sunk)
    heights = (HEIGHT + plane).transpose("y", "x")
    np.testing.assert_allclose(laid_height(laid), heights, atol=1e-12)
    np.testing.assert_allclose(pressed_height(laid), heights - sunk, atol=1e-12)
    found = contact_at_pressure(laid, LOADING, **SOURCE)
    summed = faces_of(HEIGHT.copy(data=heights - sunk))
    alone = contact_at_pressure(summed, LOADING, **SOURCE)
    np.testing.assert_allclose(found.pressure, alone.pressure, atol=1e-6)
    assert found.height.equals(HEIGHT)


def test_the_stiffness_of_the_interface_leaves_out_that_of_a_flat_punch():
    """1.1516 E*/side for a square punch (Borodachev 1976); compliances add."""
    square = contact_path(faces_of(rough(3, (64, 64))), LOADING, **PATH)
    punch = 1.1516 * 12820.0 / 0.64
    whole = square.path_stiffness.values
    alone = with_interface_stiffness(square).path_interface_stiffness.values
    np.testing.assert_allclose(1 / whole - 1 / alone, 1 / punch, rtol=6e-3)  # 64 elements a side
    assert (alone > whole).all()


# Two rough faces.

FILES = {"source": "counterface.h5", "patch_source": "7_T0.h5"}
LIGHT = LOADING._replace(target_pressure_MPa=40.0, tolerance=1e-10)


def pressed(lower, upper):
    """The two, where `upper` is turned over onto `lower`."""
    faces = faces_of(lower, turned_over(upper, lower, **FILES))
    return contact_at_pressure(faces, LIGHT, **SOURCE)


def test_who_presses_whom_does_not_matter():
    """Seen from above its own face, each has the pressures of the other, mirrored along x."""
    a, b = rough(1), rough(2)
    onto_a, onto_b = pressed(a, b), pressed(b, a)
    assert (onto_a.pressure > 0).any()
    np.testing.assert_allclose(
        onto_a.pressure, onto_b.pressure.values[:, ::-1], atol=1e-6 * float(onto_a.pressure.max())
    )
    np.testing.assert_array_equal(pressed_height(onto_a), a.values + b.values[:, ::-1])


@pytest.mark.parametrize("other", [rough(2, shape=(20, 23)), rough(2, (20, 24), spacing=0.0101)])
def test_another_grid_is_refused(other):
    message = r"counterface\.h5: .*7_T0\.h5 has 24 × 20 points every 0.01"
    with pytest.raises(InputError, match=message):
        turned_over(other, rough(1, (20, 24)), **FILES)
