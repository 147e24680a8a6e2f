"""Places to scan, on fields of which the best places are known."""

import logging

import numpy as np
import pytest
import xarray as xr
from contacts import around
from gstlib.macroscale.sampling_sites import CONTROL, COUNTS, EXPOSED, concentration, propose_places

SIZES = {"size_mm": 5.0, "patch_mm": 0.8}
ELEMENT = 0.1


@pytest.fixture
def found():
    """A face of 9 mm around a square of 5; nothing touches."""
    field = around(np.zeros((90, 90)), ELEMENT, 2.0)
    return xr.Dataset({"exposure": field, "touched": field.copy()})


def rub(found, y_mm, x_mm, size_mm, exposure):
    """Expose a square spot about a place, from corner to corner of elements."""
    at = (abs(found.y - y_mm) < size_mm / 2) & (abs(found.x - x_mm) < size_mm / 2)
    found["exposure"] += exposure * at
    found["touched"] = found.touched.where(~at, 0.5)
    return found


def gaps(places):
    """How far (mm) the outlines of any two places lie apart along the axis on which they do."""
    x, y = (places[axis].to_numpy() for axis in ("x_mm", "y_mm"))
    apart = np.maximum(abs(x[:, None] - x), abs(y[:, None] - y)) - SIZES["patch_mm"]
    return apart[~np.eye(len(places), dtype=bool)]


def test_spots_are_found_in_the_order_of_their_exposure(found):
    rub(found, 1.0, 4.0, 0.8, 10.0)
    rub(found, 3.0, 2.0, 0.8, 40.0)
    rub(found, 4.6, 0.4, 0.4, 40.0)  # half as wide: a quarter of the mean, touching the corner
    rub(found, -1.0, 2.0, 0.8, 90.0)  # outside the square
    places = propose_places(found, **SIZES)
    exposed = places[places.kind == EXPOSED]
    np.testing.assert_allclose(exposed.exposure_N_per_mm, [40, 10, 10], rtol=1e-12)
    np.testing.assert_allclose(exposed.iloc[0][["x_mm", "y_mm"]].astype(float), [2.0, 3.0])
    assert places.place.tolist()[:4] == ["E1", "E2", "E3", "C1"]
    assert (exposed.touched == 0.5).all()


def test_places_do_not_overlap_and_lie_in_the_square(found):
    noise = np.random.default_rng(3).exponential(size=found.exposure.shape)
    found["exposure"] += noise * (found.x.values < 2.5)
    found["touched"] += 1.0 * (found.x < 2.5)
    places = propose_places(found, **SIZES)
    assert places.kind.value_counts().to_dict() == COUNTS
    assert gaps(places).min() > -1e-9
    for axis in ("x_mm", "y_mm"):
        assert places[axis].between(0.4 - 1e-9, 4.6 + 1e-9).all()
    assert places.exposure_N_per_mm[places.kind == EXPOSED].is_monotonic_decreasing


def test_controls_are_never_touched_and_lie_far_from_what_is(found, caplog):
    rub(found, 2.5, 0.5, 1.0, 5.0)
    for at in ((45, 30), (62, 58)):
        found["touched"][at] = 1e-3  # one element of one pose, whose exposure rounds to 0
    places = propose_places(found, **SIZES)
    controls = places[places.kind == CONTROL]
    assert len(controls) == COUNTS[CONTROL]
    assert (controls.touched == 0).all()
    assert (controls.exposure_N_per_mm == 0).all()
    # each lies as far (between outlines) from what is touched and from the places before as it can
    rubbed = np.argwhere(found.touched.values > 0) * ELEMENT - 2.0 + ELEMENT / 2
    centres = np.stack(np.meshgrid(*2 * [np.arange(0.4, 4.61, ELEMENT)], indexing="ij"), axis=-1)
    for count in controls.index:
        before = places[["y_mm", "x_mm"]].to_numpy()[:count]
        apart = [abs(centres - at).max(axis=-1) - 0.35 for at in rubbed]
        apart += [abs(centres - at).max(axis=-1) - 0.8 for at in before]
        free, own = np.min(apart, axis=0), places.loc[count, ["y_mm", "x_mm"]].astype(float)
        at = abs(centres - own.to_numpy()).max(axis=-1) < 1e-6
        assert free[at] == pytest.approx(free.max())
        assert free[at] > 0
    assert "exposed places fit" in caplog.text  # the one spot holds fewer than are asked for


def test_patches_of_broken_elements_are_summed_exactly(found):
    """Elements at the edge count by the share of their area inside."""
    found["exposure"] += 7.0
    found["touched"] += 1.0
    places = propose_places(found, size_mm=5.0, patch_mm=0.85)
    np.testing.assert_allclose(places.exposure_N_per_mm, 7.0, rtol=1e-12)
    (whole,) = propose_places(found, size_mm=5.0, patch_mm=5.0).itertuples()
    assert (whole.x_mm, whole.y_mm) == (2.5, 2.5)


def test_what_lies_beside_the_square_is_said(found, caplog):
    rub(found, 2.5, 2.5, 0.8, 1.0)
    rub(found, -1.0, 2.5, 0.8, 3.0)
    places = propose_places(found, **SIZES)
    with caplog.at_level(logging.WARNING):
        held = concentration(found, places, **SIZES)
    assert "75 % of the exposure lies outside the square" in caplog.text
    assert held.in_square == pytest.approx(0.25)
    assert held.half_area == pytest.approx(0.5 * 0.8**2 / 25, rel=0.05)
    assert held.in_places == pytest.approx(1.0)
    assert held.places_area == pytest.approx(0.8**2 / 25)
