"""The stone that wears by a law: at rest, where it is pressed, as much as it bears."""

from dataclasses import replace

import numpy as np
import pytest
from gstlib.specimen.law import worn_by_law
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.specimen.stone import Stone


@pytest.fixture(scope="module")
def stone():
    parameters = SpecimenParameters(
        seed=9,
        counterface_seed=None,
        mesh_edge_mm=0.6,
        cut_off_wavelength_mm=1.2,
        scan_points=64,
        scan_spacing_um=13.28,
        unmeasured_size_um=30.0,
        wear_placement="archard",
    )
    return Stone(parameters, 5.0)


@pytest.fixture(scope="module")
def bare(stone):
    return worn_by_law(stone, 2e-4, with_interlayer=False)


def test_it_loses_at_its_summits(stone, bare):
    assert bare.shape == stone.detail.shape
    assert bare.min() == 0
    assert (bare > 0).mean() < 0.3
    assert stone.detail[bare > 0].mean() > stone.detail.std()


def test_the_square_loses_in_proportion_to_its_share_of_the_force(stone, bare):
    """Of a small tool in the middle it bears all, over its edge about half."""
    assert lost(stone, 0.0) == pytest.approx(2e-4, rel=1e-6)
    assert 0.3 < lost(stone, 2.5) / 2e-4 < 0.8
    assert bare.mean() < 2e-4


def lost(stone, off_mm):
    """Mean loss of the square, pressed by a small tool so far off its middle."""
    pressed = {"worn_off_middle_mm": (off_mm, 0.0), "worn_radius_mm": 60.0}
    other = Stone(replace(stone.parameters, **pressed), 5.0)
    return worn_by_law(other, 2e-4, with_interlayer=False).mean()


def test_it_lies_at_rest_and_not_on_its_mean_plane(stone, bare):
    """A plane added to the stone makes no difference: it tilts back."""
    tilted = Stone(stone.parameters, 5.0)
    tilted.macroscale = lambda y, x: stone.macroscale(y, x) + 2e-3 * np.asarray(y)[:, None]
    tilted.face_means = lambda count, around: (
        stone.face_means(count, around)
        + 2e-3 * (np.arange(count + 2 * around) - around + 0.5)[:, None] * 5.0 / count
    )
    again = worn_by_law(tilted, 2e-4, with_interlayer=False)
    assert np.abs(again - bare).max() < 0.02 * bare.max()


def test_an_interlayer_wears_valleys_too(stone, bare):
    soft = worn_by_law(stone, 2e-4, with_interlayer=True)
    assert soft.mean() == pytest.approx(bare.mean(), rel=1e-6)
    assert (soft > 0).mean() > 1.3 * (bare > 0).mean()
