"""Matching: a map is found on the stone that it was taken from, and on no other."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.ndimage import gaussian_filter, gaussian_filter1d
from stones import FINE, taken

from gst.check.matching import (
    Match,
    _Lying,
    _Shared,
    match_map,
    match_near,
    match_together,
)
from gst.check.sliding import Refined
from gst.setup.finding import Matches, _laid_alike, find_on_map, find_on_stone, seen_in
from gstlib import self_affine_field
from gstlib.surfaces.footprints import PatchPosition, outline
from gstlib.surfaces.frames import Frame
from gstlib.surfaces.grid import coarser, make_surface

LIKELY = Match(
    PatchPosition(1.0, 1.0), False, False, 0.9, 0.1, np.eye(3), is_found=True
)
EDGE, FACE, OVERVIEW, PATCH = 0.2, 9.0, 2.2, 0.85  # mm
PATCHES = np.array(
    [(3.0, 3.2), (3.4, 5.6), (4.4, 4.1), (5.5, 6.2), (6.1, 3.3), (6.3, 5.0)]
)


def stone(seed):
    """A rough and rounded surface on fine elements, mm."""
    rng, count = np.random.default_rng(seed), round(FACE / FINE)
    rough = self_affine_field(rng, 512, FINE, hurst_exponent=0.8, roll_off=2.0)[
        :count, :count
    ]
    along = np.arange(count) * FINE - FACE / 2
    return 0.03 * rough / rough.std() - np.add.outer(along**2, along**2) / 120


SMOOTH = gaussian_filter(stone(5), 40)


def mesh(fine):
    """What a mesh shows of it, with its noise."""
    smooth = gaussian_filter(fine, EDGE / 2 / FINE)
    surface = coarser(make_surface(smooth, FINE, mesh_edge_mm=EDGE), 3)
    noise = gaussian_filter(np.random.default_rng(0).normal(size=surface.shape), 2)
    return surface + 0.003 * noise / noise.std()


def scan(fine, centre, turn=0.0, mirrored=False, side=PATCH):
    """A map of it."""
    step = side / 85
    return make_surface(taken(fine, centre, turn, side, step, mirrored), step)


def found_near(fine, scans, places, turn=0.0):
    return match_near(mesh(fine), scans, [PatchPosition(*at, turn) for at in places])


def distance(match, centre):
    return np.hypot(*np.subtract(match.place[:2], centre))


def are_found(matches):
    return [match.is_found for match in matches]


def test_a_map_is_found_where_it_was_taken():
    fine, centre = stone(2), (6.27, 2.58)
    surface = mesh(fine)
    surface[:10, :] = np.nan  # where there is no stone
    heights = scan(fine, centre, 133.0, True, OVERVIEW)
    heights[20:30, 40:60] = np.nan
    match = match_map(surface, heights)
    assert (match.is_found, match.mirrored) == (True, True)
    assert distance(match, centre) < min(0.02, 4 * match.error_mm)
    assert match.place.rotation_deg == pytest.approx(133, abs=1.5)
    assert match.correlation > 0.9 > match.next_best
    assert not match_map(mesh(stone(1)), heights).is_found


@pytest.mark.parametrize(
    ("fine", "turns"),
    [(SMOOTH, (0.0, 0.0, 0.0)), (stone(2), (-11.5, 11.5))],
    ids=["smooth", "turned otherwise"],
)
def test_scans_without_a_common_position_are_not_found(fine, turns):
    scans = [scan(fine, at, turn) for at, turn in zip(PATCHES, turns, strict=False)]
    assert not any(are_found(found_near(fine, scans, PATCHES[: len(scans)])))


def test_scans_that_the_stage_ties_together_are_found():
    """Whichever way its axes run. A scan of another stone is not, nor does it move the others."""
    fine, turn, centres = stone(2), -160.0, PATCHES
    scans = [-scan(fine, at, turn, mirrored=True) for at in centres]  # of a mould
    scans[5] = -scan(stone(9), (4.0, 4.0), mirrored=True)
    v, u = PatchPosition(*centres.mean(axis=0), turn).seen(*centres.T)
    offsets = np.transpose([v, -u])
    readings = np.array([offsets * (-1, 1), offsets])
    match, reading = match_together(mesh(fine), scans, readings)
    matches = match.each(offsets)
    assert (match.mirrored, match.inverted, reading) == (True, True, 1)
    assert are_found([match, *matches]) == [*[True] * 6, False]
    places = [each.place[:2] for each in matches]
    np.testing.assert_allclose(places, centres, atol=0.03)


def test_scans_near_places_by_hand_snap_together():
    fine = stone(2)
    scans = [-scan(fine, at, 30.0, mirrored=True) for at in PATCHES]
    scans[2] = -scan(stone(4), (4.0, 4.0), mirrored=True)  # of another stone
    off = np.random.default_rng(3).uniform(-0.5, 0.5, PATCHES.shape)
    matches = found_near(fine, scans, PATCHES + off, 23.0)
    assert all(match.mirrored and match.inverted for match in matches)
    assert are_found(matches) == [True, True, False, True, True, True]
    assert matches[0].place.rotation_deg == pytest.approx(30, abs=4)
    right = [0, 1, 3, 4, 5]
    off_mm = [distance(matches[n], PATCHES[n]) for n in right]
    error_mm = [matches[n].error_mm for n in right]
    assert np.linalg.norm(off_mm) < 0.05 * 5**0.5
    # scans err about as much as is said, which is along one axis
    ratio = np.linalg.norm(off_mm) / np.linalg.norm(error_mm) / 2**0.5
    assert 0.5 < ratio < 1.2


def is_taken(correlation=0.9, squares=20e-6, scale=1.0, own_turn=0.0, is_clear=True):
    """Whether a scan that fits at one place, and turns by itself, is found there."""
    place, each = PatchPosition(1.0, 2.0, 10.0), np.array([correlation])
    shape = np.diag([1.0, 4.0])
    fit = Refined(place, correlation, each, shape, squares, 20.0, scale, 1e-9)
    turned = place._replace(rotation_deg=10.0 + own_turn)
    free = fit._replace(place=turned, shape=np.diag([1.0, 4.0, 1.0]))
    shared = _Shared(variance=1e-6, freedom=100.0, scale=1.0, of_turn=1e-6)
    match = shared.match(_Lying([fit], free), LIKELY, is_clear)
    assert not match.is_uncertain
    return match.is_found


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("is_clear", False),  # another way to lay all scans is as good
        ("correlation", 0.79),
        ("squares", 60e-6),  # three times the variance
        ("scale", 1.41),
        ("scale", 1 / 1.41),
        ("own_turn", -10.1),
    ],
)
def test_each_reason_alone_leaves_a_scan_where_it_was_put(name, value):
    assert is_taken()
    assert not is_taken(**{name: value})


def test_a_scan_that_fits_at_two_places_is_not_certain():
    """Waves that repeat each 0.6 mm along x leave its place open, and it has alternatives."""
    columns = stone(3)[:, [100, 300]]
    even, odd = (columns - gaussian_filter1d(columns, 40, axis=0)).T
    phase = 2 * np.pi * np.arange(len(columns)) * FINE / 0.6
    waves = np.outer(even, np.cos(phase)) + np.outer(odd, np.sin(phase))
    fine = 0.03 * waves / waves.std() + 0.1 * stone(4)
    scans = [scan(fine, at) for at in PATCHES]
    matches = found_near(fine, scans, PATCHES + 0.05)
    for match, at in zip(matches, PATCHES, strict=True):
        assert (match.is_found, match.is_uncertain) == (False, True)
        places = np.array([match.place, *match.alternatives])
        assert np.hypot(*(places[:, :2] - at).T).min() < 0.1


@pytest.mark.parametrize(
    ("lead", "alone", "together"),
    [(0.4, True, True), (0.3, False, True), (0.15, False, False)],
)
def test_one_scan_needs_a_larger_lead_than_several(lead, alone, together):
    elsewhere = np.tanh(np.arctanh(LIKELY.correlation) - lead)
    matches = [LIKELY.among([elsewhere], count) for count in (1, 2)]
    assert are_found(matches) == [alone, together]


def test_an_error_of_the_rotation_grows_with_the_lever():
    assert LIKELY.at(0.0, 3.0).error_mm == pytest.approx(10**0.5)


def test_the_stage_places_what_heights_do_not(monkeypatch):
    alone = {"a": LIKELY, "b": replace(LIKELY, is_found=False)}
    together = replace(LIKELY, place=PatchPosition(5.0, 5.0), own=(0.9, 0.9))
    offsets = np.array([[[-1.0, 0.0], [1.0, 0.0]]])
    monkeypatch.setattr("gst.setup.finding.match_map", lambda _, scan: alone[scan])
    monkeypatch.setattr("gst.setup.finding.match_together", lambda *_: (together, 0))
    both = find_on_map(None, {"a": "a", "b": "b"}, offsets)
    assert both["a"] is alone["a"]
    assert both["b"].place == PatchPosition(6.0, 5.0)
    assert find_on_map(None, {"a": "a", "b": "b"}, None) == alone


def test_a_scan_that_lies_otherwise_than_most_is_not_found():
    matches = {name: LIKELY for name in "abc"} | {"d": replace(LIKELY, mirrored=True)}
    assert are_found(_laid_alike(matches).values()) == [True, True, True, False]


def test_what_fits_two_sides_of_a_stone_alike_is_not_found(monkeypatch):
    monkeypatch.setattr("gst.setup.finding.match_together", lambda *_: (LIKELY, 0))
    box = trimesh.creation.box((9.0, 7.0, 5.0))
    lying = find_on_stone(
        box, [scan(SMOOTH, (4.5, 4.5), side=OVERVIEW)], np.zeros((1, 1, 2))
    )
    assert (lying.match.is_found, lying.match.lead) == (False, 0)


@pytest.mark.parametrize(
    ("outside", "inside"), [(False, True), (True, False), (True, True)]
)
def test_a_scan_on_a_map_lies_where_its_points_do_on_the_stone(outside, inside):
    """Mirrored and turned as both are: the map on the stone, and the scan on the map."""
    match = replace(LIKELY, covariance=np.diag([9e-4, 9e-4, 0.0]))
    outer = replace(match, place=PatchPosition(7.0, 3.0, 25.0), mirrored=outside)
    inner = replace(match, place=PatchPosition(1.2, 1.1, -70.0), mirrored=inside)
    whole = outer.carrying(inner, (0.9, 1.4))
    assert whole.mirrored == (outside != inside)
    for point in ((0.0, 0.0), (0.3, 0.0), (0.0, 0.2)):
        y, x, _ = inner.place_of(*point)
        expected = outer.place_of(y - 0.9, x - 1.4)
        assert whole.place_of(*point)[:2] == pytest.approx(expected[:2])
    assert whole.error_mm == pytest.approx(0.03 * 2**0.5)


def test_what_is_found_on_one_square_lies_there_on_another():
    match = replace(LIKELY, place=PatchPosition(1.0, 2.0, 150.0))
    turned = Frame((1.0, 2.0, 3.0), (0.0, 0.6, 0.8), (1.0, 0.0, 0.0))
    square = Frame((1.0, 0.5, 2.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0))
    seen = seen_in(square, Matches(turned, None, {"A": match}))["A"]
    assert -180 <= seen.rotation_deg < 180
    ours = outline(seen, PATCH) @ square.axes[:2] + square.origin
    theirs = outline(match.place, PATCH) @ turned.axes[:2] + turned.origin
    np.testing.assert_allclose(ours, theirs, atol=1e-12)
