"""Matching: a map is found on the stone that it was taken from, and on no other."""

import numpy as np
import pytest
import scipy
from gstlib import self_affine_field
from gstlib.coupling.matching import match_map
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
