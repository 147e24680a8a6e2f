import numpy as np
import pytest

from gstlib.bem import load_path
from gstlib.contact import (
    contact_dataset,
    final_state,
    load_path_table,
    solve_at_pressure,
    solve_path,
)
from gstlib.errors import InputError
from gstlib.surface import make_surface

SPACING = 0.01
HEIGHT = make_surface(0.002 * np.random.default_rng(5).standard_normal((24, 32)), SPACING)
SETTINGS = {
    "source": "surface.h5",
    "contact_modulus_MPa": 12820.0,
    "target_pressure_MPa": 50.0,
    "steps": 4,
    "tolerance": 1e-8,
    "maximum_displacement_um": 50.0,
}


def test_fields_and_units_of_the_dataset():
    path = solve_path(HEIGHT, keep_states=True, **SETTINGS)
    contact = contact_dataset(HEIGHT, path, every_step=True)
    assert contact.pressure.shape == (4, 24, 32)
    assert {name: v.attrs["units"] for name, v in contact.data_vars.items()} == {
        "height": "mm",
        "pressure": "MPa",
        "gap": "mm",
        "displacement": "mm",
        "mean_pressure": "MPa",
        "contact_fraction": "1",
        "stiffness": "MPa/mm",
        "residual": "1",
        "iterations": "1",
    }
    means = contact.pressure.mean(("y", "x"))
    np.testing.assert_allclose(means, contact.mean_pressure, rtol=1e-12)
    final = contact_dataset(HEIGHT, path, every_step=False)
    assert (final.pressure == contact.pressure[-1]).all()


# the study's own functions leave this warning out; the bare solver gives it
@pytest.mark.filterwarnings("ignore::gstlib.bem.DomainTooSmallWarning")
def test_table_converts_to_micrometres():
    contact = contact_dataset(
        HEIGHT, solve_path(HEIGHT, keep_states=False, **SETTINGS), every_step=False
    )
    bare = load_path(HEIGHT.values, SPACING, 12820.0, target_pressure=50.0, steps=4, tolerance=1e-8)
    table = load_path_table(contact)
    np.testing.assert_allclose(table.displacement_um, bare.displacement * 1000)
    np.testing.assert_allclose(table.stiffness_MPa_per_um, bare.stiffness / 1000)
    assert table.step.tolist() == [1, 2, 3, 4]


def test_state_alone_is_the_end_of_the_path():
    path = solve_path(HEIGHT, keep_states=False, **SETTINGS)
    alone = {name: SETTINGS[name] for name in ("source", "contact_modulus_MPa", "tolerance")}
    state, pressure = solve_at_pressure(HEIGHT, target_pressure_MPa=50.0, **alone)
    assert state.displacement == pytest.approx(path.displacement[-1], rel=1e-6)
    assert float(pressure.mean()) == pytest.approx(50.0, rel=1e-9)


def test_final_state_is_the_stored_one_and_costs_no_iteration():
    path = solve_path(HEIGHT, keep_states=False, **SETTINGS)
    contact = contact_dataset(HEIGHT, path, every_step=False).assign_attrs(SETTINGS)
    again = final_state(contact, source="contact.h5")
    assert again.iterations == 0
    assert again.convolutions == 2  # one in each precision
    np.testing.assert_array_equal(again.contact, path.final.contact)
    np.testing.assert_allclose(again.pressure, path.final.pressure, rtol=1e-12)
    assert again.displacement == pytest.approx(path.displacement[-1], rel=1e-12)


def test_a_ceiling_holds_at_the_same_mean_pressure():
    alone = {name: SETTINGS[name] for name in ("source", "contact_modulus_MPa", "tolerance")}
    elastic, _ = solve_at_pressure(HEIGHT, target_pressure_MPa=50.0, **alone)
    ceiling = 0.5 * elastic.pressure.max()
    state, pressure = solve_at_pressure(
        HEIGHT, target_pressure_MPa=50.0, pressure_limit_MPa=ceiling, **alone
    )
    assert float(pressure.max()) == ceiling
    assert float(pressure.mean()) == pytest.approx(50.0, rel=1e-9)
    assert state.ceiling_share > 0


def test_errors_of_the_solver_are_said_for_the_user():
    with pytest.raises(InputError, match=r"surface\.h5.*5000 MPa cannot be reached.*Lower"):
        solve_path(
            HEIGHT,
            keep_states=False,
            **SETTINGS | {"target_pressure_MPa": 5e3, "maximum_displacement_um": 1.0},
        )
    holed = HEIGHT.copy()
    holed[3, 3] = np.nan
    with pytest.raises(InputError, match=r"surface\.h5: its contact could not be solved"):
        solve_path(holed, keep_states=False, **SETTINGS)
