"""Places to scan, on fields of which the best places are known."""

import numpy as np
import pytest
import xarray as xr
from contacts import around
from numpy.testing import assert_allclose

from gstlib.macroscale.sampling_sites import (
    CONTROL,
    COUNTS,
    EXPOSED,
    concentration,
    propose_places,
)

SIZES = {"size_mm": 5.0, "patch_mm": 0.8}
ELEMENT = 0.1


@pytest.fixture
def fields():
    """A face of 9 mm around a square of 5; nothing touches."""
    zeros = around(np.zeros((90, 90)), ELEMENT, 2.0)
    return xr.Dataset({"exposure": zeros, "touched": zeros.copy()})


def rub(fields, y_mm, x_mm, size_mm, exposure):
    """Expose a square spot about a place, from corner to corner of elements."""
    spot = (abs(fields.y - y_mm) < size_mm / 2) & (abs(fields.x - x_mm) < size_mm / 2)
    fields["exposure"] += exposure * spot
    fields["touched"] = fields.touched.where(~spot, 0.5)


def test_spots_are_proposed_in_the_order_of_their_exposure(fields):
    rub(fields, 1.0, 4.0, 0.8, 10.0)
    rub(fields, 3.0, 2.0, 0.8, 40.0)
    # half as wide: a quarter of the mean, touching the corner
    rub(fields, 4.6, 0.4, 0.4, 40.0)
    rub(fields, -1.0, 2.0, 0.8, 90.0)  # outside the square
    places = propose_places(fields, **SIZES)
    exposed = places[places.kind == EXPOSED]
    assert_allclose(exposed.exposure_N_per_mm, [40, 10, 10], rtol=1e-12)
    assert (exposed.x_mm.iloc[0], exposed.y_mm.iloc[0]) == pytest.approx((2.0, 3.0))
    assert places.place.tolist()[:4] == ["E1", "E2", "E3", "C1"]


def test_places_do_not_overlap_and_lie_in_the_square(fields):
    noise = np.random.default_rng(3).exponential(size=fields.exposure.shape)
    half = fields.x < 2.5
    fields["exposure"] += noise * half.values
    fields["touched"] += 1.0 * half
    places = propose_places(fields, **SIZES)
    assert places.kind.value_counts().to_dict() == COUNTS
    at = places[["x_mm", "y_mm"]].to_numpy()
    apart = abs(at[:, None] - at).max(axis=-1)
    assert apart[~np.eye(len(at), dtype=bool)].min() > 0.8 - 1e-9
    assert abs(at - 2.5).max() < 2.1 + 1e-9
    assert places.exposure_N_per_mm[places.kind == EXPOSED].is_monotonic_decreasing


def test_controls_are_never_touched_and_lie_far_from_what_is(fields, caplog):
    """The first lies as far as it can from all that is touched, measured between outlines."""
    rub(fields, 2.5, 0.5, 1.0, 5.0)
    for at in ((45, 30), (62, 58)):
        # one element of one pose, whose exposure rounds to 0
        fields["touched"][at] = 1e-3
    places = propose_places(fields, **SIZES)
    controls = places[places.kind == CONTROL]
    assert len(controls) == COUNTS[CONTROL]
    assert (controls[["touched", "exposure_N_per_mm"]] == 0).all(axis=None)
    exposed = places[places.kind == EXPOSED][["y_mm", "x_mm"]].to_numpy()
    touched = np.argwhere(fields.touched.values > 0) * ELEMENT - 2.0 + ELEMENT / 2

    def free(*centre):
        near = abs(touched - centre).max(axis=1).min() - 0.35
        return min(near, abs(exposed - centre).max(axis=1).min() - 0.8)

    along = np.arange(0.4, 4.61, ELEMENT)
    farthest = max(free(y, x) for y in along for x in along)
    first = controls.iloc[0]
    assert free(first.y_mm, first.x_mm) == pytest.approx(farthest)
    # the one spot holds fewer than are asked for
    assert "exposed positions fit" in caplog.text


def test_patches_of_broken_elements_are_summed_exactly(fields):
    """Elements at the edge count by the share of their area inside."""
    fields["exposure"] += 7.0
    fields["touched"] += 1.0
    places = propose_places(fields, size_mm=5.0, patch_mm=0.85)
    assert_allclose(places.exposure_N_per_mm, 7.0, rtol=1e-12)
    (whole,) = propose_places(fields, size_mm=5.0, patch_mm=5.0).itertuples()
    assert (whole.x_mm, whole.y_mm) == (2.5, 2.5)


def test_exposure_beside_the_square_is_warned_of(fields, caplog):
    rub(fields, 2.5, 2.5, 0.8, 1.0)
    rub(fields, -1.0, 2.5, 0.8, 3.0)
    held = concentration(fields, propose_places(fields, **SIZES), **SIZES)
    assert "75 % of the exposure lies outside the square" in caplog.text
    area = 0.8**2 / 25
    assert held == pytest.approx((0.25, 0.5 * area, 1.0, area), rel=0.05)


def test_where_nothing_is_touched_no_position_is_exposed(fields):
    places = propose_places(fields, **SIZES)
    assert not (places.kind == EXPOSED).any()
    assert places.x_mm.empty
