"""Patches are solved in order, and each as it was asked for."""

import pandas as pd
import pytest
from contacts import pressed, rough
from numpy.testing import assert_allclose, assert_array_equal

from gstlib.contact import ContactPath
from gstlib.microscale.patches import (
    EQUILIBRIUM,
    PAPER,
    Microscale,
    microscale_tables,
    solve_patches,
)
from gstlib.surfaces.filtering import s_filtered

SETTINGS = Microscale(
    contact_modulus_MPa=1e4,
    tolerance=1e-8,
    s_filter_um=None,
    steps=None,
    maximum_displacement_um=50.0,
)
PRESSURES = pd.DataFrame(
    {
        "patch": list("abc"),
        "pressure_MPa": [5.0, 9.0, 0.0],
        "square_pressure_MPa": [6.0, 8.0, 7.0],
    }
)


PATCH = 0.3


def scan(seed, side=PATCH):
    return rough(seed, (16, 16), side / 16, 1e-3).to_dataset(name="height")


@pytest.fixture
def scans():
    return {"c": scan(3), "a": scan(1)}


@pytest.fixture(scope="module")
def stone():
    """A composite with the places and planes of its patches, and its contact."""
    square = scan(9, side=0.8)
    square = square.assign(counterface=0 * square.height, patch_mm=PATCH)
    place = {"y_mm": 0.4, "x_mm": 0.4, "rotation_deg": 0.0}
    plane = {"slope_y": 0.01, "slope_x": 0.0}
    columns = {name: ("patch", 3 * [value]) for name, value in (place | plane).items()}
    square = square.assign(columns).assign_coords(patch=list("abc"))
    return {"composite": square, "contact": pressed(square.height, mean_pressure=5.0)}


def test_patches_are_solved_in_order_at_the_pressures_of_their_variants(scans, stone):
    contacts = solve_patches(
        scans, PRESSURES, SETTINGS, variants=[EQUILIBRIUM, PAPER], **stone
    )
    targets, order = PRESSURES.set_index("patch"), []
    for patch, variant, contact in contacts:
        order.append((patch, variant))
        is_equilibrium, interface = variant == EQUILIBRIUM, contact.interface
        assert (interface.surroundings is not None) == is_equilibrium
        assert (interface.plane.slope_y == 0.01) == is_equilibrium
        assert_array_equal(interface.height, scans[patch].height)
        target = targets["pressure_MPa" if is_equilibrium else "square_pressure_MPa"][
            patch
        ]
        assert float(contact.pressure.mean()) == pytest.approx(target, rel=1e-6)
    assert order == [("c", EQUILIBRIUM), ("c", PAPER), ("a", EQUILIBRIUM), ("a", PAPER)]


def test_the_scan_of_the_active_stone_is_turned_over_onto_every_patch(scans):
    face, settings = scan(5).height, SETTINGS._replace(s_filter_um=120.0)
    contacts = solve_patches(
        scans, PRESSURES, settings, variants=[PAPER], counterface=face
    )
    for patch, _, contact in contacts:
        own = s_filtered(scans[patch].height, 120.0).values
        other = s_filtered(face, 120.0).values[:, ::-1]
        assert_allclose(contact.interface.pressed, own + other, atol=1e-15)


@pytest.mark.parametrize(
    ("residual", "stated"), [(3e-9, 1e-8), (1e-8, 1e-8), (0, 1e-12)]
)
def test_the_studys_own_variant_has_a_path_and_states_no_less_than_its_residual(
    scans, stone, residual, stated
):
    settings = SETTINGS._replace(steps=2)
    contacts = solve_patches(
        scans, PRESSURES, settings, variants=[PAPER, EQUILIBRIUM], **stone
    )
    stored = {}
    for patch, variant, contact in contacts:
        assert isinstance(contact, ContactPath) == (variant == PAPER)
        if variant == PAPER:
            stored[patch] = contact.to_dataset().assign(residual=residual)
    states, _ = microscale_tables(stored)
    assert states.residual.tolist() == pytest.approx(2 * [stated])
