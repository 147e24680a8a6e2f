"""Matching: a map is found on the stone that it was taken from, and on no other."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from gst.check.aligning import Fit
from gst.check.matching import Match, _elsewhere, match_map, match_together
from gst.check.nearby import match_near
from gst.setup.finding import find_on_map, find_on_stone
from gstlib import self_affine_field
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.grid import make_surface
from scipy.ndimage import gaussian_filter, gaussian_filter1d, map_coordinates

LIKELY = Match(PatchPosition(1.0, 1.0), False, False, 0.9, 0.1, np.eye(3), found=True)
FINE, STEP, EDGE, FACE = 0.02, 0.05, 0.2, 9.0  # mm
OVERVIEW, PATCH = (1.9, 2.5), (0.85, 0.85)  # mm


def stone(seed):
    """A rough and rounded surface on fine elements, mm."""
    count = round(FACE / FINE)
    waves = {"hurst_exponent": 0.8, "roll_off": 2.0}
    rough = self_affine_field(np.random.default_rng(seed), 512, FINE, **waves)[:count, :count]
    y, x = np.indices(rough.shape) * FINE - FACE / 2
    return 0.03 * rough / rough.std() - (y**2 + x**2) / 2 / 60


def mesh(fine, seed=0):
    """What a mesh shows of it, with its noise."""
    at = (np.arange(round(FACE / STEP)) + 0.5) * STEP / FINE - 0.5
    smooth = gaussian_filter(fine, EDGE / 2 / FINE)
    seen = map_coordinates(smooth, np.meshgrid(at, at, indexing="ij"), order=1)
    noise = np.random.default_rng(seed).normal(size=seen.shape)
    noise = gaussian_filter(noise, 2)
    return make_surface(seen + 0.003 * noise / noise.std(), STEP, mesh_edge_mm=EDGE)


def scan(fine, place, mirrored, sides, spacing=0.01):
    """A map of it, tilted."""
    v, u = ((np.arange(n := round(side / spacing)) - (n - 1) / 2) * spacing for side in sides)
    y, x = place.points(v[:, None], (-u if mirrored else u)[None, :])
    heights = map_coordinates(fine, [y / FINE - 0.5, x / FINE - 0.5], order=3)
    return make_surface(heights + 0.02 * v[:, None] + 3, spacing)


def distance(place, other):
    return np.hypot(*np.subtract(place[:2], other[:2]))


def overview(fine, place, mirrored=False):
    return scan(fine, place, mirrored, OVERVIEW, 0.02)


@pytest.mark.parametrize(
    ("place", "mirrored"),
    [(PatchPosition(6.27, 2.58, 133.0), True), (PatchPosition(4.5, 4.5, -92.4), False)],
)
def test_a_map_is_found_where_it_was_taken(place, mirrored):
    fine = stone(2)
    surface = mesh(fine)
    surface[:10, :] = np.nan  # where there is no stone
    heights = overview(fine, place, mirrored)
    heights[20:30, 40:60] = np.nan
    match = match_map(surface, heights)
    off_mm = distance(match.place, place)
    turned = (match.place.rotation_deg - place.rotation_deg + 180) % 360 - 180
    assert match.found
    assert match.mirrored == mirrored
    assert off_mm < min(0.02, 4 * match.error_mm)
    assert abs(turned) < 1.5
    assert match.correlation > 0.9 > match.next_best
    assert not match_map(mesh(stone(1)), heights).found


def test_a_smooth_stone_shows_no_place():
    smooth = gaussian_filter(stone(5), 40)
    assert not match_map(mesh(smooth), overview(smooth, PatchPosition(4.0, 5.0))).found


def test_what_cannot_be_matched():
    surface, heights = mesh(stone(1)), overview(stone(1), PatchPosition(4.5, 4.5))
    with pytest.raises(ValueError, match="fewer than 12 elements"):
        match_map(surface, heights[:20, :20])
    with pytest.raises(ValueError, match="does not fit"):
        match_map(surface[:40, :40], heights)


def patch(fine, place, mirrored=False):
    """A scan of 0.85 mm, of a stone or of a mould of it."""
    return (-1 if mirrored else 1) * scan(fine, place, mirrored, PATCH)


PATCHES = np.array([(3.0, 3.2), (3.4, 5.6), (4.4, 4.1), (5.5, 6.2), (6.1, 3.3), (6.3, 5.0)])


def test_scans_that_the_stage_ties_together_are_found():
    """Whichever way its axes run; on another stone they are not."""
    fine, turn, centres = stone(2), -160.0, PATCHES[:3]
    scans = [patch(fine, PatchPosition(y, x, turn), True) for y, x in centres]
    v, u = PatchPosition(*centres.mean(axis=0), turn).seen(*centres.T)
    offsets = np.transpose([v, -u])
    readings = np.array([offsets * (-1, 1), offsets])
    match, reading = match_together(mesh(fine), scans, readings)
    assert match.found
    assert (reading, match.mirrored, match.inverted) == (1, True, True)
    for centre, offset in zip(centres, offsets, strict=True):
        assert match.place_of(*offset)[:2] == pytest.approx(centre, abs=0.03)
    assert not match_together(mesh(stone(9)), scans, readings)[0].found


@pytest.mark.parametrize("mirrored", [False, True])
def test_scans_near_places_by_hand_snap_together(mirrored):
    fine, rng = stone(3), np.random.default_rng(3)
    scans = [patch(fine, PatchPosition(*at, 30.0), mirrored) for at in PATCHES]
    scans[2] = patch(stone(4), PatchPosition(4.0, 4.0), mirrored)  # of another stone
    by_hand = [PatchPosition(*at, 23.0) for at in PATCHES + rng.uniform(-0.5, 0.5, PATCHES.shape)]
    matches = match_near(mesh(fine), scans, by_hand)
    assert {(each.mirrored, each.inverted) for each in matches} == {(mirrored, mirrored)}
    assert [each.found for each in matches] == [True, True, False, True, True, True]
    pairs = [
        (distance(match.place, at), match.error_mm)
        for match, at in zip(matches, PATCHES, strict=True)
        if match.found
    ]
    off_mm, error_mm = np.sqrt(np.square(pairs).mean(axis=0))
    assert off_mm < 0.05
    # scans err about as much as is said, which is along one axis
    assert 0.5 < off_mm / 2**0.5 / error_mm < 1.6
    assert matches[0].place.rotation_deg == pytest.approx(30, abs=4)


def test_scans_near_places_by_hand_are_found_if_nothing_speaks_against_it():
    """One turned by itself, hidden by rings, one is twice as high, and one fits worse."""
    fine, (first, *_) = stone(6), PATCHES
    y, x = np.indices(fine.shape) * FINE
    away = np.hypot(y - first[0], x - first[1])
    near = np.exp(-((away / 0.7) ** 6))
    fine = fine * (1 - near / 2) + near * 0.1 * np.cos(2 * np.pi * away / 0.8)
    scans = [patch(fine, PatchPosition(*at, 30.0)) for at in PATCHES]
    scans[0], scans[2] = patch(fine, PatchPosition(*first, 50.0)), 2 * scans[2]
    noise = gaussian_filter(np.random.default_rng(1).normal(size=scans[4].shape), 6)
    scans[4] = scans[4] + 0.5 * float(scans[4].std()) * noise / noise.std()
    near_by = mesh(fine, 6), scans, [PatchPosition(*at, 28.0) for at in PATCHES + 0.2]
    matches = match_near(*near_by)
    assert [each.found for each in matches] == [False, True, False, True, False, True]
    assert min(each.correlation for each in matches) > 0.8
    assert min(each.lead for each in matches) > 0.2


@pytest.mark.parametrize(("lead", "one", "two"), [(0.4, 1, 1), (0.3, 0, 1), (0.2, 0, 0)])
def test_one_scan_needs_a_larger_lead_than_several(lead, one, two):
    elsewhere = np.tanh(np.arctanh(0.9) - lead)
    assert [LIKELY.among([elsewhere], count).found for count in (1, 2)] == [one, two]


@pytest.mark.parametrize(("count", "score"), [(4, 0.7), (3, 0.6), (2, 0.0)])
def test_another_place_is_far_from_the_best_or_of_the_other_sign(count, score):
    peaks = np.array([[0.9, 4, 4], [0.8, 5, 4], [0.6, 9, 4], [-0.7, 4, 5]])[:count]
    assert _elsewhere(peaks, peaks[0], 3.0) == score


def rough(generator, shape, wave):
    """Smooth noise whose waves are about so long, mm, on elements of 0.05 mm."""
    noise = gaussian_filter(generator.normal(size=shape), wave / 0.05 / 4)
    return noise / noise.std()


def test_the_errors_of_a_place_and_of_the_lever_are_as_large_as_is_said():
    """Whatever the waves are that the surface shows besides the scan's own."""
    generator, scores = np.random.default_rng(1), []
    for _ in range(40):
        ground = rough(generator, (120, 120), 0.6)
        surface = make_surface(ground + 0.3 * rough(generator, ground.shape, 0.3), 0.05)
        scan = make_surface(ground[30:90, 30:90], 0.05)
        fit = Fit.of(surface, [scan], np.zeros((1, 2)), False).refined(PatchPosition(3.0, 3.0))
        match = replace(LIKELY, place=fit.place, covariance=fit.covariance)
        for lever in (np.zeros(2), np.array([0.0, 3.0])):
            moved = match.at(*lever)
            off = moved.place[:2] - lever - 3.0
            scores.append(off / np.sqrt(moved.covariance.diagonal()[:2]))
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.4


def test_a_scan_that_fits_at_two_places_is_not_certain():
    """Waves that repeat each 0.6 mm along x leave its place open, and it has alternatives."""
    rows, x = stone(3), np.arange(round(FACE / FINE)) * FINE
    even, odd = (rows[:, [n]] - gaussian_filter1d(rows[:, [n]], 40, axis=0) for n in (100, 300))
    fine = even * np.cos(2 * np.pi * x / 0.6) + odd * np.sin(2 * np.pi * x / 0.6)
    fine = 0.03 * fine / fine.std() + 0.3 * stone(4)
    scans = [patch(fine, PatchPosition(*at)) for at in PATCHES]
    matches = match_near(mesh(fine), scans, [PatchPosition(y, x) for y, x in PATCHES + 0.05])
    assert sum(match.is_uncertain for match in matches) >= 4
    for match, at in zip(matches, PATCHES, strict=True):
        assert match.found != match.is_uncertain
        off = [np.hypot(*(place[:2] - at)) for place in (match.place, *match.alternatives)]
        assert min(off[:1] if match.found else off) < 0.1


def test_scans_of_a_smooth_stone_do_not_snap():
    smooth = gaussian_filter(stone(5), 40)
    scans = [patch(smooth, PatchPosition(*at)) for at in PATCHES[:3]]
    by_hand = [PatchPosition(y + 0.2, x - 0.3) for y, x in PATCHES[:3]]
    assert not any(match.found for match in match_near(mesh(smooth), scans, by_hand))


AROUND = np.array([(4.1, 4.0), (4.2, 5.1), (4.85, 4.5), (4.6, 5.2)])
ON_MAP = AROUND - 4.5 + np.array(OVERVIEW) / 2


def test_a_scan_that_is_not_found_on_a_map_is_where_the_stage_says():
    fine, centres = stone(1), AROUND[:3]
    scans = dict(zip("abc", (patch(fine, PatchPosition(*at)) for at in centres), strict=True))
    noise = gaussian_filter(np.random.default_rng(1).normal(size=scans["c"].shape), 8)
    scans["c"] = scans["c"] + 0.02 * noise / noise.std()
    on_map = overview(fine, PatchPosition(4.5, 4.5))
    alone = find_on_map(on_map, scans, None)
    assert [match.found for match in alone.values()] == [True, True, False]
    # heights say more exactly than the stage where a scan lies
    tied = find_on_map(on_map, scans, (centres - centres.mean(axis=0))[np.newaxis])
    assert all(match.found for match in tied.values())
    places = [match.place[:2] for match in tied.values()]
    np.testing.assert_allclose(places, ON_MAP[:3], atol=0.02)


def test_a_scan_of_another_stone_does_not_lie_where_the_stage_says():
    """Nor does it move the others, or turn them."""
    scans = [patch(stone(1), PatchPosition(*at)) for at in AROUND]
    scans[3] = patch(stone(2), PatchPosition(*AROUND[3]))
    on_map, offsets = overview(stone(1), PatchPosition(4.5, 4.5)), AROUND - AROUND.mean(axis=0)
    match, _ = match_together(on_map, scans, offsets[np.newaxis])
    assert match.found
    each = match.each(offsets)
    assert [one.found for one in each] == [True, True, True, False]
    np.testing.assert_allclose([one.place[:2] for one in each], ON_MAP, atol=0.001)


def test_what_fits_two_sides_of_a_stone_alike_is_not_found(monkeypatch):
    monkeypatch.setattr("gst.setup.finding.match_together", lambda *_: (LIKELY, 0))
    heights = overview(stone(1), PatchPosition(4.5, 4.5))
    found = find_on_stone(trimesh.creation.box((9.0, 7.0, 5.0)), [heights], np.zeros((1, 1, 2)))
    assert (found.match.found, found.match.lead) == (False, 0)


@pytest.mark.parametrize("mirrored", [(False, False), (False, True), (True, False), (True, True)])
def test_a_scan_on_a_map_lies_where_its_points_do_on_the_stone(mirrored):
    """Mirrored and turned as both are: the map on the stone, and the scan on the map."""
    middle, covariance = (0.9, 1.4), np.diag([9e-4, 9e-4, 0.0])
    places = PatchPosition(7.0, 3.0, 25.0), PatchPosition(1.2, 1.1, -70.0)
    outer, inner = (
        replace(LIKELY, place=place, mirrored=is_mirrored, covariance=covariance)
        for place, is_mirrored in zip(places, mirrored, strict=True)
    )
    whole = outer.carrying(inner, middle)
    for point in ((0.0, 0.0), (0.3, 0.0), (0.0, 0.2)):
        y, x, _ = inner.place_of(*point)
        on_map = y - middle[0], x - middle[1]
        assert whole.place_of(*point)[:2] == pytest.approx(outer.place_of(*on_map)[:2])
    assert whole.mirrored == (mirrored[0] != mirrored[1])
    assert whole.error_mm == pytest.approx(0.03 * 2**0.5)
