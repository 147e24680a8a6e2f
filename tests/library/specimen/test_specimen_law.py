"""The stone that wears by a law: at rest, where it is pressed, as much as it bears."""

from dataclasses import replace

import numpy as np
import pytest

from gstlib.specimen import law
from gstlib.specimen.law import worn_by_law
from gstlib.specimen.stone import Stone

MEAN_LOSS = 2e-4


@pytest.fixture(scope="module")
def stone(parameters):
    coarse = {"scan_points": 32, "scan_spacing_um": 26.56}
    return Stone(replace(parameters, **coarse, wear_placement="archard"), 5.0)


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


def test_it_lies_at_rest_and_not_on_its_mean_plane(stone, bare):
    """A plane added to the stone makes no difference: it tilts back."""
    tilted = Stone(stone.parameters, 5.0)
    tilted.macroscale = lambda along: stone.macroscale(along) + 2e-3 * along[:, None]
    assert np.abs(worn(tilted) - bare).max() < 0.02 * bare.max()


def test_an_interlayer_wears_valleys_too(stone, bare):
    """The stone loses the same volume, up to the rounding of depths to 1 nm."""
    soft = worn(stone, with_interlayer=True)
    assert soft.mean() == pytest.approx(bare.mean(), rel=2e-5)
    assert (soft > 0).mean() > 1.3 * (bare > 0).mean()


def test_elements_lose_what_their_points_would(stone, monkeypatch):
    """Elements of 2 × 2 points cut summits as single points do, and an interlayer wears valleys."""
    monkeypatch.setattr(law, "_TOLERANCE", 1e-7)
    small = {"scan_spacing_um": 3.32, "cut_off_wavelength_mm": 0.6}
    small |= {"macroscale_rms_um": 1.0, "worn_off_middle_mm": (0.0, 0.0)}
    fine = Stone(replace(stone.parameters, **small), 1.0)
    elements, soft = worn(fine), worn(fine, with_interlayer=True)
    monkeypatch.setattr(law, "_LARGEST_UM", 3.32)
    points = worn(fine)
    error = elements - points
    assert 0 < np.sqrt(np.square(error).mean() / np.square(points).mean()) < 0.01
    assert elements.mean() == pytest.approx(points.mean(), rel=5e-3)
    assert soft.mean() == pytest.approx(points.mean(), rel=5e-3)
    high, low = (fine.detail > np.quantile(fine.detail, share) for share in (0.9, 0.5))
    assert (elements[high] > 0).mean() > 2 * (elements[~low] > 0).mean()
    assert (soft[~low] > 0).mean() > 3 * (elements[~low] > 0).mean()
