"""The stone that wears by a law: at rest, where it is pressed, as much as it bears."""

from dataclasses import replace

import numpy as np
import pytest

from gstlib.specimen.law import worn_by_law
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.specimen.stone import Stone

MEAN_LOSS = 2e-4


@pytest.fixture(scope="module")
def stone():
    parameters = SpecimenParameters(
        seed=9,
        counterface_seed=None,
        mesh_edge_mm=0.6,
        cut_off_wavelength_mm=1.2,
        scan_points=32,
        scan_spacing_um=26.56,
        unmeasured_size_um=30.0,
        wear_placement="archard",
    )
    return Stone(parameters, 5.0)


def worn(stone, with_interlayer=False):
    return worn_by_law(stone, MEAN_LOSS, with_interlayer=with_interlayer)


@pytest.fixture(scope="module")
def bare(stone):
    return worn(stone)


@pytest.mark.parametrize(
    ("off_mm", "low", "high"), [(0.0, 1 - 1e-6, 1 + 1e-6), (2.5, 0.3, 0.8)]
)
def test_the_square_loses_in_proportion_to_its_share_of_the_force(
    stone, off_mm, low, high
):
    """Of a small tool in the middle it bears all, over its edge about half."""
    pressed = {"worn_off_middle_mm": (off_mm, 0.0), "worn_radius_mm": 60.0}
    other = Stone(replace(stone.parameters, **pressed), 5.0)
    assert low < worn(other).mean() / MEAN_LOSS < high


def test_it_lies_at_rest_and_not_on_its_mean_plane(stone, bare, monkeypatch):
    """A plane added to the stone makes no difference: it tilts back."""
    macroscale = stone.macroscale
    monkeypatch.setattr(
        stone, "macroscale", lambda y, x: macroscale(y, x) + 2e-3 * y[:, None]
    )
    assert np.abs(worn(stone) - bare).max() < 0.02 * bare.max()


def test_an_interlayer_wears_valleys_too(stone, bare):
    soft = worn(stone, with_interlayer=True)
    assert soft.mean() == pytest.approx(bare.mean(), rel=1e-6)
    assert (soft > 0).mean() > 1.3 * (bare > 0).mean()
