"""A surface in, a contact dataset out: a path, a pressure alone, and two rough faces."""

import numpy as np
import pytest
import xarray as xr
from bem_reference import sphere
from contacts import around, interface, rough
from numpy.testing import assert_allclose, assert_array_equal

from gstlib.contact import Contact, Load, contact_at_pressure, contact_path, turned_over
from gstlib.errors import InputError
from gstlib.microscale.patches import with_interface_stiffness

LOAD = Load(50.0)
SOURCE = {"modulus": 12820.0, "tolerance": 1e-9, "source": "surface.h5"}
PATH = SOURCE | {"steps": 4, "maximum_displacement_um": 50.0}
HEIGHT = rough(5)
FACES = interface(HEIGHT)


@pytest.fixture(scope="module")
def path():
    return contact_path(FACES, LOAD, every_step=True, **PATH)


def test_fields_and_units_of_a_path(path):
    stored = path.to_dataset()
    units = {
        "pressure": "MPa",
        "gap": "mm",
        "path_pressure": "MPa",
        "path_stiffness": "MPa/mm",
    }
    assert {name: stored[name].attrs["units"] for name in units} == units
    assert_array_equal(path.final.pressure, stored.path_pressure[-1])
    assert_allclose(stored.path_pressure.mean(("y", "x")), path.mean_pressure)
    assert path.final.displacement == path.displacement[-1]


@pytest.mark.parametrize(
    "faces",
    [
        interface(HEIGHT, rough(6)),
        interface(
            HEIGHT, slopes=(0.01, -0.02), surroundings=np.full(HEIGHT.shape, 1e-3)
        ),
    ],
    ids=["scanned face", "placed"],
)
def test_a_contact_is_the_same_when_it_has_been_stored(faces, path):
    """Its variables are the same in every case."""
    contact = contact_at_pressure(faces, LOAD, **SOURCE)
    assert contact.residual <= 1e-9
    stored, plain = contact.to_dataset(), path.final.to_dataset()
    for name, variable in stored.variables.items():
        assert variable.dtype == plain[name].dtype
        assert variable.attrs == plain[name].attrs
    again = Contact.from_dataset(stored)
    assert again.interface.plane == contact.interface.plane
    xr.testing.assert_identical(again.to_dataset(), stored)


def test_the_force_acts_where_the_load_says_wherever_the_grid_begins():
    """A ball under a force on its summit stays as it is; beside it, it rolls there."""
    ball = around(sphere(25, 0.1, 50.0), 0.1, shift=3.0)
    summit = float(ball.y[12])
    for off in (0.0, 0.1):
        load = Load(5.0, load_point=(summit, summit + off))
        plane = contact_at_pressure(interface(ball), load, **SOURCE).interface.plane
        assert plane.slope_y == pytest.approx(0, abs=1e-7)
        assert plane.slope_x == pytest.approx(off / 50.0, rel=0.02, abs=1e-7)


def test_errors_of_the_solver_name_the_file_and_the_remedy(path):
    needed_um = 1e3 * path.final.displacement
    contact_path(FACES, LOAD, **PATH | {"maximum_displacement_um": 1.01 * needed_um})
    with pytest.raises(
        InputError, match=r"surface\.h5.*50 MPa cannot be reached.*Lower"
    ):
        contact_path(
            FACES, LOAD, **PATH | {"maximum_displacement_um": 0.99 * needed_um}
        )
    beside = Load(50.0, load_point=(0.12, 0.33))
    with pytest.raises(
        InputError, match=r"surface\.h5: the stone tips.*x 0\.33, y 0\.12 mm"
    ):
        contact_at_pressure(FACES, beside, **SOURCE)
    spike = HEIGHT.copy()
    spike[3, 3] = np.inf
    with pytest.raises(
        InputError, match=r"surface\.h5: its contact could not be solved"
    ):
        contact_at_pressure(interface(spike), LOAD, **SOURCE)


def test_full_contact_is_warned_of(caplog):
    """Heights a thousandth of the true ones, in nm for µm, are flat to the solver."""
    contact_path(interface(1e-3 * HEIGHT), LOAD, **PATH)
    (warning,) = caplog.messages
    assert "surface.h5: 100 %" in warning


def test_without_pressure_the_contact_is_empty():
    empty = contact_path(FACES, Load(0.0), **PATH)
    assert not empty.displacement.any()
    assert not empty.stiffness.any()
    assert not empty.final.pressure.any()
    assert_allclose(empty.final.gap, HEIGHT.max() - HEIGHT, rtol=1e-6)


def test_the_stiffness_of_the_interface_leaves_out_that_of_a_flat_punch():
    """1.1516 E*/side for a square punch (Borodachev 1976); compliances add."""
    path = contact_path(interface(rough(3, (64, 64))), LOAD, **PATH)
    punch = 1.1516 * 12820.0 / 0.64
    alone = with_interface_stiffness(path).interface_stiffness
    difference = 1 / path.stiffness - 1 / alone
    assert_allclose(difference, 1 / punch, rtol=6e-3)  # 64 elements a side


def test_another_grid_is_refused():
    files = {"source": "counterface.h5", "patch_source": "7_T0.h5"}
    with pytest.raises(
        InputError, match=r"counterface\.h5: .*7_T0\.h5 has 24 × 20 points every"
    ):
        turned_over(rough(2, (20, 24), spacing=0.0101), rough(1, (20, 24)), **files)
