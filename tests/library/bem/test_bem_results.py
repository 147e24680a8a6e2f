"""What a state and a path tell their user, and doubts about what he meant."""

import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from bem_reference import MODULUS, self_affine, sphere
from gstlib.bem import (
    ContactInputError,
    ContactWarning,
    TippingError,
    load_path,
    solve_contact,
    wear_path,
)
from gstlib.bem.closed_forms import Sphere
from matplotlib.figure import Figure

N, SIDE = 96, 0.85
HEIGHTS = self_affine(N, seed=3, roll_off=0.05)
SURFACE = HEIGHTS, SIDE / N, MODULUS
# A piece of a surface with waves longer than it.
PIECE = self_affine(2 * N, seed=1, length=2 * SIDE, roll_off=2 * SIDE)[:N, :N]
INCLINED = 0.5 * SIDE / N * np.arange(N)[:, None] + HEIGHTS
# Surface on every other element only.
SIEVE = np.full((129, 129), -np.inf)
SIEVE[1::2, 1::2] = 1e-3 * np.random.default_rng(0).random((64, 64))
SCAN = xr.DataArray(
    HEIGHTS[:, :80],
    dims=("y", "x"),
    coords={"y": 3 + 0.01 * np.arange(N), "x": 0.02 * np.arange(80)},
    attrs={"units": "mm", "instrument": "confocal"},
)


def test_the_rim_is_the_outer_three_elements():
    with pytest.warns(ContactWarning, match="outer three"):
        state = solve_contact(PIECE, *SURFACE[1:], mean_pressure=60.0)
    counted = sum(
        state.pressure[i, j]
        for i in range(N)
        for j in range(N)
        if min(i, j, N - 1 - i, N - 1 - j) < 3
    )
    assert state.rim_fraction == pytest.approx(counted / state.pressure.sum())
    assert state.rim_area == pytest.approx(1 - (90 / 96) ** 2)
    assert solve_contact(*SURFACE, mean_pressure=60.0, periodic=True).rim_fraction == 0
    assert solve_contact(*SURFACE, mean_pressure=0.0).rim_fraction == 0


@pytest.mark.parametrize(
    ("heights", "spacing", "options", "doubt"),
    [
        (HEIGHTS, 1e3 * SIDE / N, {}, "of the surface touches"),
        (1e3 * HEIGHTS, SIDE / N, {}, "slope"),
        (INCLINED, SIDE / N, {}, "inclined"),
        (PIECE, SIDE / N, {}, "rim|outer"),
        (HEIGHTS, SIDE / N, {}, None),
        (HEIGHTS, SIDE / N, {"periodic": True}, None),
        (INCLINED, SIDE / N, {"load_point": (0.4, 0.45)}, None),
        (0 * HEIGHTS, SIDE / N, {}, None),
        (SIEVE, SIDE / 129, {}, None),
        (sphere(N, SIDE / N, 20.0), SIDE / N, {}, None),
    ],
)
def test_what_was_hardly_meant_is_told(heights, spacing, options, doubt):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        solve_contact(heights, spacing, MODULUS, mean_pressure=20.0, **options)
    texts = [str(warning.message) for warning in said if warning.category is ContactWarning]
    if doubt is None:
        assert texts == []
    else:
        with pytest.warns(ContactWarning, match=doubt):
            solve_contact(heights, spacing, MODULUS, mean_pressure=20.0, **options)
        assert all(warning.filename == __file__ for warning in said)


def test_heights_on_a_steep_plane_are_not_called_tipping():
    steep = HEIGHTS + 2 * SIDE / N * np.arange(N)
    with pytest.raises(ContactInputError, match="63°") as refused:
        solve_contact(steep, *SURFACE[1:], mean_pressure=20.0, load_point=(0.4, 0.45))
    assert not isinstance(refused.value, TippingError)


def test_a_data_array_says_its_spacing_and_gets_its_like():
    array, spacing = SCAN.values, (0.01, 0.02)
    load = {"contact_modulus": MODULUS, "mean_pressure": 20.0}
    state, plain = solve_contact(SCAN, **load), solve_contact(array, spacing, **load)
    np.testing.assert_allclose(state.pressure.values, plain.pressure, rtol=1e-8)
    assert state.pressure.name == "pressure"
    assert state.pressure.attrs["units"] == "MPa"
    xr.testing.assert_equal(state.gap.y, SCAN.y)
    assert state.rim_fraction == pytest.approx(plain.rim_fraction)
    path = load_path(SCAN, contact_modulus=MODULUS, target_pressure=20.0, steps=2, keep_states=True)
    assert path.final.pressure.dims == path.states[0].gap.dims == ("y", "x")
    worn = wear_path(SCAN, **load, mean_loss=1e-4, steps=2, keep_depths=True)
    assert worn.depth.attrs == {"units": "mm", "long_name": "height lost by wear"}
    assert float(worn.depths[0].mean()) == pytest.approx(5e-5)
    turned = solve_contact(SCAN.T, **load)
    assert solve_contact(SCAN.T, **load, initial_pressure=turned.pressure).iterations < 3
    assert turned.pressure.dims == ("x", "y")
    np.testing.assert_array_equal(turned.pressure.T, state.pressure)


@pytest.mark.parametrize(
    "change",
    [
        {"heights": HEIGHTS},
        {"heights": SCAN.assign_attrs(units="µm")},
        {"heights": SCAN.assign_coords(x=SCAN.x.assign_attrs(units="µm"))},
        {"heights": SCAN.assign_coords(x=SCAN.x**2)},
        {"heights": SCAN.assign_coords(x=SCAN.x.assign_attrs(spacing=0.01))},
        {"heights": SCAN[::-1]},
        {"heights": SCAN[:1]},
        {"heights": SCAN.drop_vars("x")},
        {"heights": SCAN.to_dataset(name="height")},
        {"spacing": 0.01},
        {"contact_modulus": None},
    ],
)
def test_what_does_not_say_its_size_is_refused(change):
    arguments = {"heights": SCAN, "contact_modulus": MODULUS} | change
    with pytest.raises(ContactInputError):
        solve_contact(**arguments, mean_pressure=20.0)


@pytest.mark.parametrize("periodic", [False, True])
def test_a_path_at_given_loads_is_the_contact_at_each(periodic):
    loads = [0.0, 1.0, 4.0, 50.0]
    path = load_path(*SURFACE, loads=loads, periodic=periodic, tolerance=1e-9)
    np.testing.assert_allclose(path.mean_pressure, loads, rtol=1e-12)
    for index, load in enumerate(loads):
        state = solve_contact(*SURFACE, mean_pressure=load, periodic=periodic)
        assert path.contact_fraction[index] == pytest.approx(state.contact_fraction, abs=2 / N**2)
        assert path.displacement[index] == pytest.approx(state.displacement, rel=1e-5)
    for wrong in ({"loads": [2.0, 1.0]}, {"loads": []}, {"loads": loads, "target_pressure": 1.0}):
        with pytest.raises(ContactInputError):
            load_path(*SURFACE, **wrong)


def test_wear_by_its_rate_and_the_sliding():
    pressures = np.array([10.0, 30.0])
    # 2e-6 mm³/(N·m) over 5 m at 20 MPa on average: 0.2 µm
    path = wear_path(*SURFACE, mean_pressure=pressures, wear_rate=2e-6, sliding=5.0, steps=2)
    np.testing.assert_allclose(path.mean_loss, [5e-5, 2e-4])
    for wrong in ({}, {"wear_rate": 1e-6}, {"wear_rate": 1e-6, "sliding": 1.0, "mean_loss": 1e-4}):
        with pytest.raises(ContactInputError, match="mean_loss"):
            wear_path(*SURFACE, mean_pressure=pressures, steps=2, **wrong)


def test_tables_have_units_and_representations_are_short():
    path = load_path(*SURFACE, target_pressure=20.0, steps=3)
    table = path.table()
    assert table.mean_pressure_MPa.iloc[-1] == pytest.approx(20.0)
    np.testing.assert_allclose(table.displacement_um, 1e3 * path.displacement)
    slope = np.diff(table.mean_pressure_MPa) / np.diff(table.displacement_um)
    assert table.stiffness_MPa_per_um.iloc[1] < slope[-1] < table.stiffness_MPa_per_um.iloc[2]
    worn = wear_path(*SURFACE, mean_pressure=20.0, mean_loss=1e-4, steps=3)
    np.testing.assert_allclose(worn.table().mean_loss_um, [0.1 / 3, 0.2 / 3, 0.1])
    assert all(len(repr(result)) < 250 for result in (path, path.final, worn))


def test_results_are_drawn_on_the_axes_that_are_given():
    options = {"contact_modulus": MODULUS, "mean_pressure": 20.0}
    state, worn = solve_contact(SCAN, **options), wear_path(SCAN, **options, mean_loss=1e-4)
    for field, plot in (
        (state.pressure.where(state.contact), state.plot),
        (state.gap.where(~state.contact), lambda **on: state.plot("gap", **on)),
        (worn.depth.where(worn.depth > 0), worn.plot),
    ):
        axes = Figure().subplots()
        assert plot(axes=axes) is axes
        np.testing.assert_array_equal(axes.images[0].get_array().filled(np.nan), field)
    path = load_path(*SURFACE, target_pressure=20.0, steps=3)
    axes = path.plot("stiffness_MPa_per_um", axes=Figure().subplots())
    np.testing.assert_allclose(axes.lines[0].get_ydata(), 1e-3 * path.stiffness)


def test_the_corrected_area_takes_off_the_sides_of_an_edge():
    state = solve_contact(*SURFACE, mean_pressure=20.0, periodic=True)
    block = np.zeros((N, N))
    block[-1, 4:7] = block[50, 50] = 1.0  # eight sides, three of them across the border; four
    factor = (math.pi - 1 + math.log(2)) / 24
    found = replace(state, pressure=block).corrected_fraction
    assert found == pytest.approx((4 - 12 * factor) / N**2)
    found = replace(state, pressure=block, periodic=False).corrected_fraction
    assert found == pytest.approx((4 - 9 * factor) / N**2)


def test_pressures_of_a_sphere_are_distributed_evenly_in_their_squares():
    """Hertz: p² falls evenly with the area, so the density is 2p/p₀² of the contact."""
    exact = Sphere(20.0, 10.0, MODULUS)
    side = 3 * exact.contact_radius
    state = solve_contact(
        sphere(256, side / 256, 10.0), side / 256, MODULUS, mean_pressure=20.0 / side**2
    )
    at, density = state.distribution("pressure", 12)
    expected = 2 * at / exact.peak_pressure**2 * state.contact_fraction
    np.testing.assert_allclose(density[1:], expected[1:], rtol=0.05)
    gaps, density = state.distribution("gap", 2000)
    assert density.sum() * (gaps[1] - gaps[0]) == pytest.approx(1 - state.contact_fraction)
