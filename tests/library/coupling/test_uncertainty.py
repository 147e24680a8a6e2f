"""Intervals of the patches' pressures: each source of error alone, and cases with known answers."""

import numpy as np
import pytest
import xarray as xr
from contacts import around, laid, mesh_face, written
from contacts import pressed as press
from numpy.testing import assert_allclose

from gstlib.coupling.intervals import (
    Errors,
    Macroscale,
    draw_contact_moduli,
    pressure_intervals,
)
from gstlib.coupling.pressures import patch_pressures
from gstlib.macroscale.active_tool import rounded_counterface
from gstlib.macroscale.composite import compose_surface
from gstlib.surfaces.footprints import places_of
from gstlib.surfaces.grid import axis_coordinates, coarser, make_surface
from gstlib.surfaces.leveling import remove_plane

COUNT, SPACING, PATCH = 24, 0.1, 0.6  # the square is 2.4 mm wide
STONES = {"young_1_MPa": 2e4, "young_2_MPa": 2e4, "poisson_1": 0.25, "poisson_2": 0.25}
PLACES = written(
    """
    patch, x_mm, y_mm, rotation_deg
    1,     0.8,  0.9,  0
    2,     1.5,  1.4,  12
    """
)
MODULUS, TARGET, RADIUS = 10000.0, 15.0, 60.0  # MPa, MPa, mm
MIDDLE = (COUNT * SPACING / 2, COUNT * SPACING / 2)
NO_ERRORS = Errors(*7 * [0.0])


def stone(y, x):
    return 2e-3 * np.sin(5 * x + 1) * np.cos(4 * y) + 1e-3 * np.sin(11 * x * y)


def mesh(error=0.0):
    at = axis_coordinates(COUNT, SPACING)
    height = remove_plane(make_surface(stone(at[:, None], at), SPACING))[0]
    return mesh_face(height, error, 200, seed=4)


def pressures(height, over=None, load_point=MIDDLE, places=PLACES):
    """Of the patches at rest, on elements as wide as those of the draws."""
    faces = [None if face is None else coarser(face, 2) for face in (height, over)]
    contact = press(*faces, mean_pressure=TARGET, load_point=load_point)
    return patch_pressures(contact.pressure, places, size_mm=PATCH).pressure_MPa


@pytest.fixture
def intervals(monkeypatch):
    """Intervals; `shares` are the contact moduli of the draws, over that of the study."""

    def intervals(*macroscale, shares=8 * (1.0,), load_point=MIDDLE, **errors):
        name = "gstlib.coupling.intervals.draw_contact_moduli"
        monkeypatch.setattr(name, lambda *_, **__: np.asarray(shares))
        return pressure_intervals(
            Macroscale(*macroscale or (mesh(), None, None)),
            PLACES.assign(pressure_MPa=0.0),
            STONES | {"contact_modulus_MPa": MODULUS},
            NO_ERRORS._replace(**errors),
            force_N=TARGET * (COUNT * SPACING) ** 2,
            load_point=load_point,
            patch_mm=PATCH,
            seed=1,
        )

    return intervals


def assert_ends(table, drawn):
    """The interval is that of the pressures drawn."""
    low, high = np.percentile(drawn, (2.5, 97.5), axis=0)
    assert (high > 1.01 * low).any()
    assert_allclose(table[["low_MPa", "high_MPa"]].T, [low, high], rtol=1e-4)


def assert_certain(table, expected):
    limits = table[["low_MPa", "high_MPa"]].T
    assert_allclose(limits, 2 * [np.asarray(expected)], rtol=1e-3)


def test_the_square_alone_is_pressed_on_its_mean_plane(intervals):
    """Where no load point is given, the stone does not tilt."""
    alone = pressures(remove_plane(mesh().height)[0], load_point=None)
    assert abs(alone - pressures(mesh().height)).max() > 0.5
    assert_certain(intervals(load_point=None), alone)


def normal(source, shape):
    """Errors of eight draws, each of which has its own generator."""
    draws = [np.random.default_rng([1, source, draw]) for draw in range(8)]
    return [draw.standard_normal(shape) for draw in draws]


def test_the_point_of_force_alone_gives_the_pressures_at_rest_under_it(intervals):
    points = [tuple(MIDDLE + 0.1 * error) for error in normal(4, 2)]
    drawn = [pressures(mesh().height, load_point=point) for point in points]
    assert_ends(intervals(load_point_mm=0.1), drawn)


def test_places_alone_give_the_pressures_at_those_places(intervals):
    """A generator gives the shifts along x, then along y."""
    drawn = []
    for x, y in normal(1, (2, 2)):
        moved = PLACES[["x_mm", "y_mm"]] + 0.06 * np.c_[x, y]
        drawn.append(pressures(mesh().height, places=PLACES.assign(**moved)))
    assert_ends(intervals(placement_um=60.0), drawn)


def test_detail_between_the_scans_is_drawn_anew(intervals):
    rough = 5e-4 * np.random.default_rng(3).standard_normal((32, 32))
    scans = {}
    for patch, place in places_of(PLACES).items():
        height, _ = laid(lambda y, x: stone(y, x) + rough, place, PATCH, 32)
        scans[patch] = height.to_dataset(name="height")
    settings = {"patch_mm": PATCH, "s_filter_um": None, "placement_um": 0.0, "seed": 1}
    composite = compose_surface(mesh(1e-5), PLACES, scans, **settings)
    table = intervals(mesh(), composite, None)
    assert (table.high_MPa - table.low_MPa > 1e-3).all()
    assert_allclose(table.tilt_error_mrad, composite.tilt_error_mrad)
    assert set(table.plane) == {"mesh"}


def test_moduli_vary_as_their_stones_do():
    def draw(young_log_sd, poisson, **stones):
        errors = NO_ERRORS._replace(young_log_sd=young_log_sd, poisson=poisson)
        drawn = {"draws": 20000, "generator": np.random.default_rng(3)}
        return draw_contact_moduli(STONES | stones, errors, **drawn)

    # two like stones of half of the compliance each
    assert np.log(draw(0.1, 0.0)).std() == pytest.approx(0.1 / np.sqrt(2), rel=0.02)
    # of one stone alone, against a rigid one: lognormal, however wide
    alone = np.log(draw(0.5, 0.0, young_2_MPa=1e15))
    assert [alone.mean(), alone.std()] == pytest.approx([0, 0.5], abs=0.01)
    # d(1 - ν²) = -2ν dν over 1 - ν²
    expected = 0.02 * 0.5 / 0.9375 / np.sqrt(2)
    assert draw(0.0, 0.02).std() == pytest.approx(expected, rel=0.03)


def test_an_active_tool_adds_the_error_of_its_pose(intervals):
    """A flat face adds nothing; a rough one adds more, the less certain its position."""
    at = axis_coordinates(3 * COUNT, SPACING) - COUNT * SPACING

    def width(along_y, along_x, pose_um):
        heights = stone(along_y * at[:, None], along_x * at)
        over = around(heights, SPACING, COUNT * SPACING)
        table = intervals(mesh(), None, over, pose_um=pose_um)
        return float((table.high_MPa - table.low_MPa).max())

    assert max(width(0, 0, 200.0), width(3, 2, 0.0)) < 1e-3
    assert min(width(3, 0, 200.0), width(0, 2, 200.0)) > 1.0


@pytest.fixture(scope="module")
def under_round_tool():
    """A flat stone under a round tool, and the pressures of the patches as stated."""
    flat = mesh_face(make_surface(np.zeros((COUNT, COUNT)), SPACING), 0.0, 200, seed=4)
    face = flat.assign(counterface=rounded_counterface(flat.height, RADIUS, MIDDLE))
    return face, pressures(face.height, face.counterface)


def certain_use(pressure, at_centre):
    """A use through the middle, of which the wear tells the radius exactly."""
    use = {"y_mm": MIDDLE[0], "x_mm": MIDDLE[1], "radius_mm": RADIUS, "weight": 1.0}
    use |= {"pressure": ("patch", pressure), "pressure_at_centre": ("patch", at_centre)}
    stored = xr.Dataset(use, {"patch": [*PLACES.patch]}, {"adopted": 1})
    return stored.expand_dims("draw")


def test_wear_that_tells_the_radius_tells_where_a_stronger_force_is_borne(
    intervals, under_round_tool
):
    """Under F R / E* of the wear, all pressures grow with the force, and none with the modulus."""
    face, expected = under_round_tool
    used = face, None, None, RADIUS, certain_use([0.0, 0.0], [0.0, 0.0])
    assert_certain(intervals(*used, shares=[0.5, 2.0]), expected)
    forces = np.exp(0.5 * np.random.default_rng([1, 3]).standard_normal(8))
    table = intervals(*used, force_log_sd=0.5)
    assert_ends(table, np.outer(forces, expected))


def test_pressures_over_the_strikes_are_added_to_those_under_their_centre(
    intervals, under_round_tool
):
    face, expected = under_round_tool
    used = face, None, None, RADIUS, certain_use([3.0, 1.0], [1.0, 1000.0])
    # a pressure is never negative
    assert_certain(intervals(*used), [expected[0] + 2.0, 0.0])


def test_draws_in_which_the_stone_tips_over_are_left_out(intervals, caplog):
    assert intervals(load_point=(-9.0, -9.0)).high_MPa.isna().all()
    assert "in 8 of 8 draws the stone does not rest" in caplog.text
