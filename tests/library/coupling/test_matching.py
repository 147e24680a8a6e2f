"""Matching: a map is found on the stone that it was taken from, and on no other."""

import numpy as np
import pytest
import scipy
from gstlib import self_affine_field
from gstlib.coupling.matching import match_map, match_near, match_together
from gstlib.surfaces.footprints import Place
from gstlib.surfaces.grid import make_surface

FINE, STEP, EDGE, FACE = 0.02, 0.05, 0.2, 9.0  # mm
HEIGHT, WIDTH = 1.9, 2.5  # of a map


def stone(seed):
    """A rough and rounded surface on fine elements, mm."""
    count = round(FACE / FINE)
    waves = {"hurst_exponent": 0.8, "roll_off": 2.0}
    rough = self_affine_field(np.random.default_rng(seed), 512, FINE, **waves)[:count, :count]
    y, x = np.indices(rough.shape) * FINE - FACE / 2
    return 0.03 * rough / rough.std() - (y**2 + x**2) / 2 / 60


def mesh(fine):
    """What a mesh shows of it, with its noise."""
    at = (np.arange(round(FACE / STEP)) + 0.5) * STEP / FINE - 0.5
    smooth = scipy.ndimage.gaussian_filter(fine, EDGE / 2 / FINE)
    seen = scipy.ndimage.map_coordinates(smooth, np.meshgrid(at, at, indexing="ij"), order=1)
    noise = scipy.ndimage.gaussian_filter(np.random.default_rng(0).normal(size=seen.shape), 2)
    return make_surface(seen + 0.003 * noise / noise.std(), STEP, mesh_edge_mm=EDGE)


def scan(fine, place, mirrored, spacing=0.02):
    """A map of it, tilted."""
    sides = HEIGHT, WIDTH
    v, u = ((np.arange(n := round(side / spacing)) - (n - 1) / 2) * spacing for side in sides)
    y, x = place.points(v[:, None], -u[None, :] if mirrored else u[None, :])
    heights = scipy.ndimage.map_coordinates(fine, [y / FINE - 0.5, x / FINE - 0.5], order=3)
    return make_surface(heights + 0.02 * v[:, None] + 3, spacing)


@pytest.mark.parametrize(
    ("seed", "place", "mirrored"),
    [
        (1, Place(3.11, 5.43, 0.0), False),
        (2, Place(6.27, 2.58, 133.0), True),
        (3, Place(4.5, 4.5, -92.4), False),
        (4, Place(2.2, 6.9, 180.0), True),
    ],
)
def test_a_map_is_found_where_it_was_taken(seed, place, mirrored):
    fine = stone(seed)
    surface = mesh(fine)
    surface[:10, :] = np.nan  # where there is no stone
    heights = scan(fine, place, mirrored)
    heights[20:30, 40:60] = np.nan
    match = match_map(surface, heights)
    off_mm = np.hypot(match.place.y_mm - place.y_mm, match.place.x_mm - place.x_mm)
    turned = (match.place.rotation_deg - place.rotation_deg + 180) % 360 - 180
    assert match.found
    assert match.mirrored == mirrored
    assert off_mm < 0.02
    assert off_mm < 4 * match.error_mm
    assert abs(turned) < 1.5
    assert match.correlation > 0.9 > match.next_best


@pytest.mark.parametrize("seed", [11, 12])
def test_a_map_of_another_stone_is_not_found(seed):
    heights = scan(stone(seed), Place(4.0, 5.0, 20.0), mirrored=False)
    assert not match_map(mesh(stone(1)), heights).found


def test_a_smooth_stone_shows_no_place():
    smooth = scipy.ndimage.gaussian_filter(stone(5), 40)
    assert not match_map(mesh(smooth), scan(smooth, Place(4.0, 5.0), mirrored=False)).found


def test_what_cannot_be_matched():
    surface, heights = mesh(stone(1)), scan(stone(1), Place(4.5, 4.5), mirrored=False)
    with pytest.raises(ValueError, match="fewer than 12 elements"):
        match_map(surface, heights[:20, :20])
    with pytest.raises(ValueError, match="does not fit"):
        match_map(surface[:40, :40], heights)


def patch(fine, place, mirrored):
    """A scan of 0.85 mm, of a stone or of a mould of it."""
    v = (np.arange(85) - 42) * 0.01
    y, x = place.points(v[:, None], -v if mirrored else v)
    heights = scipy.ndimage.map_coordinates(fine, [y / FINE - 0.5, x / FINE - 0.5], order=3)
    return make_surface(-heights if mirrored else heights, 0.01)


PATCHES = np.array([(3.0, 3.2), (3.4, 5.6), (4.4, 4.1), (5.5, 6.2), (6.1, 3.3), (6.3, 5.0)])


@pytest.mark.parametrize(("seed", "turn", "mirrored"), [(1, 7.0, False), (2, -160.0, True)])
def test_scans_that_the_stage_ties_together_are_found(seed, turn, mirrored):
    """Whichever way its axes run; on another stone they are not."""
    fine = stone(seed)
    scans = [patch(fine, Place(y, x, turn), mirrored) for y, x in PATCHES]
    middle = PATCHES.mean(axis=0)
    v, u = Place(*middle, turn).seen(*PATCHES.T)
    offsets = np.transpose([v, -u if mirrored else u])
    readings = np.array([offsets * (-1, 1), offsets])
    match, reading = match_together(mesh(fine), scans, readings)
    assert match.found
    assert (reading, match.mirrored, match.inverted) == (1, mirrored, mirrored)
    for (y, x), offset in zip(PATCHES, offsets, strict=True):
        assert match.place_of(*offset)[:2] == pytest.approx((y, x), abs=0.03)
    assert not match_together(mesh(stone(9)), scans, readings)[0].found


@pytest.mark.parametrize("mirrored", [False, True])
def test_scans_near_places_by_hand_snap_together(mirrored):
    fine, rng = stone(3), np.random.default_rng(3)
    scans = [patch(fine, Place(y, x, 30.0), mirrored) for y, x in PATCHES]
    scans[2] = patch(stone(4), Place(4.0, 4.0), mirrored)  # of another stone
    by_hand = [Place(y, x, 23.0) for y, x in PATCHES + rng.uniform(-0.5, 0.5, PATCHES.shape)]
    matches = match_near(mesh(fine), scans, by_hand)
    assert {(each.mirrored, each.inverted) for each in matches} == {(mirrored, mirrored)}
    assert [each.found for each in matches] == [True, True, False, True, True, True]
    off = [
        np.hypot(*np.subtract(one.place[:2], at)) for one, at in zip(matches, PATCHES, strict=True)
    ]
    assert np.median(off) < 0.05
    assert max(far for far, match in zip(off, matches, strict=True) if match.found) < 0.1
    assert matches[0].place.rotation_deg == pytest.approx(30, abs=4)


def test_scans_of_a_smooth_stone_do_not_snap():
    smooth = scipy.ndimage.gaussian_filter(stone(5), 40)
    scans = [patch(smooth, Place(y, x), mirrored=False) for y, x in PATCHES]
    found = match_near(mesh(smooth), scans, [Place(y + 0.2, x - 0.3) for y, x in PATCHES])
    assert not any(match.found for match in found)


@pytest.mark.slow
def test_of_twenty_stones_and_as_many_strangers():
    """All are found, 95 % within 20 µm; none is found on another stone."""
    off_um, shares, strangers = [], [], []
    for seed in range(20, 40):
        rng, fine = np.random.default_rng(seed), stone(seed)
        place = Place(*rng.uniform(2.0, FACE - 2.0, 2), rng.uniform(-180, 180))
        mirrored = bool(rng.integers(2))
        match = match_map(mesh(fine), scan(fine, place, mirrored))
        assert match.found
        assert match.mirrored == mirrored
        off = np.subtract(match.place[:2], place[:2])
        off_um.append(1e3 * np.hypot(*off))
        shares.append(off / match.error_mm)
        other = match_map(mesh(fine), scan(stone(100 + seed), place, mirrored))
        strangers.append(other.found)
    assert np.quantile(off_um, 0.95) < 20
    assert np.sqrt(np.mean(np.square(shares))) < 2  # the error that is stated is about right
    assert not any(strangers)
