"""Properties of a state and a path, fields like the heights, and doubts about the input."""

import warnings

import numpy as np
import pytest
import xarray as xr
from bem_reference import MODULUS, self_affine

from gstlib.bem import ContactInputError, ContactWarning, solve_contact

N, SIDE = 96, 0.85
SPACING = SIDE / N
HEIGHTS = self_affine(N, seed=3, roll_off=0.05)
# A piece of a surface with waves longer than it.
PIECE = self_affine(2 * N, seed=1, length=2 * SIDE, roll_off=2 * SIDE)[:N, :N]
INCLINED = 0.5 * SPACING * np.arange(N)[:, None] + HEIGHTS
SCAN = xr.DataArray(
    HEIGHTS[:, :80],
    dims=("y", "x"),
    coords={"y": 3 + 0.01 * np.arange(N), "x": 0.02 * np.arange(80)},
    attrs={"units": "mm", "instrument": "confocal"},
)
LOAD = {"contact_modulus": MODULUS, "mean_pressure": 20.0}


@pytest.mark.parametrize(
    ("heights", "spacing", "options", "doubt"),
    [
        (HEIGHTS, 1e3 * SPACING, {}, "of the surface touches"),
        (1e3 * HEIGHTS, SPACING, {}, "slope"),
        (INCLINED, SPACING, {}, "inclined"),
        (PIECE, SPACING, {}, "outer three"),
        (HEIGHTS, SPACING, {}, None),
        (INCLINED, SPACING, {"load_point": (0.4, 0.45)}, None),
    ],
)
def test_odd_input_is_warned_of_where_it_is_given(heights, spacing, options, doubt):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ContactWarning)
        solve_contact(heights, spacing, **LOAD, **options)
    assert (
        any(doubt in str(warning.message) for warning in caught)
        if doubt
        else not caught
    )
    assert all(warning.filename == __file__ for warning in caught)


def test_a_data_array_says_its_spacing_and_gets_its_like():
    state = solve_contact(SCAN, **LOAD)
    plain = solve_contact(SCAN.values, (0.01, 0.02), **LOAD)
    np.testing.assert_allclose(state.pressure, plain.pressure, rtol=1e-8)
    assert state.pressure.attrs == {"units": "MPa", "long_name": "contact pressure"}
    xr.testing.assert_equal(state.gap.y, SCAN.y)
    turned = solve_contact(SCAN.T, **LOAD)
    np.testing.assert_array_equal(turned.pressure.T, state.pressure)


@pytest.mark.parametrize(
    "change",
    [
        {"heights": HEIGHTS},
        {"heights": SCAN.assign_coords(x=SCAN.x.assign_attrs(units="µm"))},
        {"heights": SCAN.to_dataset(name="height")},
        {"spacing": 0.01},
    ],
)
def test_heights_without_a_certain_size_are_refused(change):
    with pytest.raises(ContactInputError):
        solve_contact(**({"heights": SCAN} | LOAD | change))
