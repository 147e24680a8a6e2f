"""Loops over patches: in order, each scan looked up once, and each patch as it was asked for."""

import numpy as np
import pandas as pd
import pytest
from contacts import pressed
from gstlib.contact import ContactPath
from gstlib.io.store import Stored
from gstlib.microscale.patches import (
    EQUILIBRIUM,
    PAPER,
    Microscale,
    microscale_tables,
    solve_patches,
)
from gstlib.surfaces.filtering import s_filtered
from gstlib.surfaces.grid import make_surface

SETTINGS = Microscale(
    contact_modulus_MPa=1e4,
    tolerance=1e-8,
    s_filter_um=None,
    steps=None,
    maximum_displacement_um=50.0,
)
PRESSURES = pd.DataFrame(
    {"patch": list("abc"), "pressure_MPa": [5.0, 9.0, 0.0], "square_pressure_MPa": [6.0, 8.0, 7.0]}
)


def rough(seed):
    heights = 1e-3 * np.random.default_rng(seed).standard_normal((16, 16))
    return make_surface(heights, 0.05).to_dataset(name="height")


class Read(Stored):
    """Scans that say when they are looked up."""

    def __init__(self, scans):
        super().__init__(scans)
        self.scans, self.looked_up = scans, []

    def __getitem__(self, patch):
        self.looked_up.append(patch)
        return self.scans[patch]


@pytest.fixture
def scans():
    return Read({"c": rough(3), "a": rough(1)})


@pytest.fixture(scope="module")
def stone():
    """A composite with the places and planes of its patches, and its contact."""
    square = rough(9).assign(counterface=0 * rough(9).height, patch_mm=0.3)
    planes = {"y_mm": 0.4, "x_mm": 0.4, "rotation_deg": 0.0, "slope_y": 0.01, "slope_x": 0.0}
    square = square.assign({name: ("patch", [of] * 3) for name, of in planes.items()})
    square = square.assign_coords(patch=list("abc"))
    return {"composite": square, "contact": pressed(square.height, mean_pressure=5.0)}


def test_patches_are_solved_in_order_and_each_scan_is_read_once(scans, stone):
    found = solve_patches(scans, PRESSURES, SETTINGS, variants=[EQUILIBRIUM, PAPER], **stone)
    assert scans.looked_up == []
    order = []
    for patch, variant, contact in found:
        assert scans.looked_up == (["c"] if patch == "c" else ["c", "a"])
        order.append((patch, variant))
        interface = contact.interface
        assert (interface.surroundings is not None) == (variant == EQUILIBRIUM)
        name = "pressure_MPa" if variant == EQUILIBRIUM else "square_pressure_MPa"
        target = PRESSURES.set_index("patch")[name][patch]
        assert contact.load.mean_pressure == target
        assert float(contact.pressure.mean()) == pytest.approx(target, rel=1e-6)
        np.testing.assert_array_equal(interface.height, scans.scans[patch].height)
        assert (interface.plane.slope_y == 0.01) == (variant == EQUILIBRIUM)
    assert order == [("c", EQUILIBRIUM), ("c", PAPER), ("a", EQUILIBRIUM), ("a", PAPER)]


def test_the_studys_own_variant_has_a_path_and_the_other_has_none(scans, stone):
    settings = SETTINGS._replace(steps=3)
    found = solve_patches(scans, PRESSURES, settings, variants=[PAPER, EQUILIBRIUM], **stone)
    for _, variant, contact in found:
        assert isinstance(contact, ContactPath) == (variant == PAPER)


def test_the_scan_of_the_active_stone_is_turned_over_onto_every_patch(scans):
    face, settings = rough(5).height, SETTINGS._replace(s_filter_um=120.0)
    for patch, _, contact in solve_patches(
        scans, PRESSURES, settings, variants=[PAPER], counterface=face
    ):
        own, other = (s_filtered(of, 120.0).values for of in (scans.scans[patch].height, face))
        np.testing.assert_allclose(contact.interface.pressed, own + other[:, ::-1], atol=1e-15)


@pytest.mark.parametrize(
    ("residual", "stated"), [(3e-9, 1e-8), (1e-8, 1e-8), (0.9e-7, 1e-7), (0, 0)]
)
def test_a_residual_is_stated_as_no_less_than_it_is(scans, stone, residual, stated):
    settings = SETTINGS._replace(steps=2)
    found = solve_patches(scans, PRESSURES, settings, variants=[EQUILIBRIUM], **stone)
    of = {patch: contact.to_dataset().assign(residual=residual) for patch, _, contact in found}
    states, _ = microscale_tables(of)
    assert states.residual.tolist() == pytest.approx([stated] * len(of))
