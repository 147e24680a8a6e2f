"""Intervals of the patches' pressures: each source of error alone, and cases with known answers."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from contacts import around, laid, mesh_face
from contacts import pressed as press
from gstlib.coupling.intervals import (
    Errors,
    Macroscale,
    draw_contact_moduli,
    draw_point,
    pressure_intervals,
)
from gstlib.coupling.pressures import patch_pressures
from gstlib.macroscale.active_tool import face_in_pose, rounded_counterface
from gstlib.macroscale.composite import compose_surface
from gstlib.surfaces.footprints import PatchPosition, places_of
from gstlib.surfaces.grid import axis_coordinates, coarser, make_surface
from gstlib.surfaces.leveling import remove_plane

COUNT, SPACING, PATCH = 24, 0.1, 0.6  # the square is 2.4 mm wide
STONES = {"young_1_MPa": 20000.0, "poisson_1": 0.25, "young_2_MPa": 20000.0, "poisson_2": 0.25}
PLACES = pd.DataFrame(
    {"patch": ["1", "2"], "x_mm": [0.8, 1.5], "y_mm": [0.9, 1.4], "rotation_deg": [0.0, 12.0]}
)
MODULUS, TARGET = 10000.0, 15.0  # MPa
FORCE = TARGET * (COUNT * SPACING) ** 2
MIDDLE = (COUNT * SPACING / 2, COUNT * SPACING / 2)
NO_ERRORS = Errors(
    young_log_sd=0.0,
    poisson=0.0,
    placement_um=0.0,
    pose_um=0.0,
    load_point_mm=0.0,
    radius_log_sd=0.0,
    force_log_sd=0.0,
)


def stone(y, x):
    return 2e-3 * np.sin(5 * x + 1) * np.cos(4 * y) + 1e-3 * np.sin(11 * x * y)


def mesh(error=0.0):
    at = axis_coordinates(COUNT, SPACING)
    height = remove_plane(make_surface(stone(at[:, None], at), SPACING))[0]
    return mesh_face(height, error, 200, seed=4)


def pressed(height, share=1.0, load_point=MIDDLE):
    """At rest, on elements as wide as those of the draws."""
    loading = {"modulus": share * MODULUS, "mean_pressure": TARGET}
    return press(coarser(height, 2), tolerance=1e-8, load_point=load_point, **loading)


def stated():
    return patch_pressures(pressed(mesh().height).pressure, PLACES, size_mm=PATCH)


@pytest.fixture
def intervals(monkeypatch):
    """Intervals where the contact moduli of the draws, over that of the study, are given."""

    def intervals(
        shares,
        *,
        error=0.0,
        composite=None,
        whole=None,
        counterface=None,
        used=(None, None),
        load_point=MIDDLE,
        **errors,
    ):
        drawn = np.asarray(shares)
        monkeypatch.setattr("gstlib.coupling.intervals.draw_contact_moduli", lambda *_, **__: drawn)
        return pressure_intervals(
            Macroscale(whole or mesh(error), composite, counterface, *used),
            stated(),
            STONES | {"contact_modulus_MPa": MODULUS},
            NO_ERRORS._replace(**errors),
            force_N=FORCE,
            load_point=load_point,
            patch_mm=PATCH,
            seed=1,
        )

    return intervals


def test_the_square_alone_is_pressed_on_its_mean_plane(intervals):
    """Where no load point is given, the stone does not tilt."""
    found = intervals(np.ones(2), load_point=None)
    alone = pressed(remove_plane(mesh().height)[0], load_point=None)
    expected = patch_pressures(alone.pressure, PLACES, size_mm=PATCH).pressure_MPa
    np.testing.assert_allclose(found.low_MPa, expected, rtol=1e-3)
    assert abs(found.low_MPa - found.pressure_MPa).max() > 0.5


def test_the_point_of_force_alone_gives_the_pressures_at_rest_under_it(intervals):
    found, drawn = intervals(np.ones(20), load_point_mm=0.1), []
    for draw in range(20):
        y, x = 0.1 * np.random.default_rng([1, 4, draw]).standard_normal(2)
        field = pressed(mesh().height, load_point=(MIDDLE[0] + y, MIDDLE[1] + x)).pressure
        drawn.append(patch_pressures(field, PLACES, size_mm=PATCH).pressure_MPa)
    assert_ends(found, drawn)


def assert_ends(found, drawn):
    """The interval is that of the pressures drawn."""
    low, high = np.percentile(drawn, (2.5, 97.5), axis=0)
    assert (high > 1.01 * low).any()
    np.testing.assert_allclose(found.low_MPa, low, rtol=1e-4)
    np.testing.assert_allclose(found.high_MPa, high, rtol=1e-4)


def test_constants_alone_give_the_pressures_of_their_solutions(intervals):
    fields = [pressed(mesh().height, share).pressure for share in (0.5, 2.0)]
    drawn = [patch_pressures(field, PLACES, size_mm=PATCH).pressure_MPa for field in fields]
    assert_ends(intervals([0.5, 2.0]), drawn)


def test_places_alone_give_the_pressures_at_those_places(intervals):
    """Each draw has its own generator, which gives the shifts along x, then along y."""
    found = intervals(np.ones(30), placement_um=60.0)
    field, drawn = pressed(mesh().height).pressure, []
    for draw in range(30):
        moved, generator = PLACES.copy(), np.random.default_rng([1, 1, draw])
        for axis in ("x_mm", "y_mm"):
            moved[axis] += 0.06 * generator.standard_normal(2)
        drawn.append(patch_pressures(field, moved, size_mm=PATCH).pressure_MPa)
    assert_ends(found, drawn)


def test_detail_between_the_scans_is_drawn_anew_and_planes_are_told(intervals):
    rough = 5e-4 * np.random.default_rng(3).standard_normal((32, 32))
    scans = {
        patch: laid(lambda y, x: stone(y, x) + rough, place, PATCH, 32)[0].to_dataset(name="height")
        for patch, place in places_of(PLACES).items()
    }
    settings = {"patch_mm": PATCH, "s_filter_um": None, "placement_um": 0.0, "seed": 1}
    composite = compose_surface(mesh(1e-5), PLACES, scans, **settings)
    found = intervals(np.ones(8), composite=composite)
    assert (found.high_MPa - found.low_MPa > 1e-3).all()
    np.testing.assert_allclose(found.tilt_error_mrad, composite.tilt_error_mrad)
    assert list(found.plane) == ["mesh" if known else "levelled" for known in composite.known]
    # the mesh's error moves the planes too: here no other height errs
    above = mesh(1e-3)
    near = np.hypot(above.vertex_y - 0.9, above.vertex_x - 0.8) < 0.1
    above = above.assign(left_out_error=above.left_out_error.where(near, 0.0))
    smooth = composite.assign(density=0 * composite.density)
    by_planes = intervals(np.ones(8), whole=above, composite=smooth)
    assert by_planes.high_MPa[0] - by_planes.low_MPa[0] > 0.5


def test_moduli_vary_as_their_stones_do():
    def draw(young_log_sd, poisson, stones=STONES):
        return draw_contact_moduli(
            stones,
            NO_ERRORS._replace(young_log_sd=young_log_sd, poisson=poisson),
            draws=20000,
            generator=np.random.default_rng(3),
        )

    np.testing.assert_allclose(draw(0.0, 0.0), 1.0, rtol=1e-12)
    # two like stones of half of the compliance each
    assert np.log(draw(0.1, 0.0)).std() == pytest.approx(0.1 / np.sqrt(2), rel=0.02)
    # of one stone alone, against a rigid one: lognormal, however wide
    alone = np.log(draw(0.5, 0.0, STONES | {"young_2_MPa": 1e15}))
    assert alone.mean() == pytest.approx(0, abs=0.02)
    assert alone.std() == pytest.approx(0.5, rel=0.02)
    # d(1 - ν²) = -2ν dν over 1 - ν²
    assert draw(0.0, 0.02).std() == pytest.approx(0.02 * 0.5 / 0.9375 / np.sqrt(2), rel=0.03)


def test_an_active_tool_adds_the_error_of_its_pose(intervals):
    """A flat face adds nothing; a rough one adds more, the less certain its position."""
    at = axis_coordinates(3 * COUNT, SPACING) - COUNT * SPACING

    def width(along_y, along_x, pose_um):
        heights = stone(along_y * at[:, None], along_x * at)
        face = around(heights, SPACING, COUNT * SPACING)
        over = face_in_pose(
            face, mesh().height, PatchPosition(0.0, 0.0, 0.0), size_mm=COUNT * SPACING
        )
        whole = mesh().assign(counterface=over)
        found = intervals(np.ones(8), whole=whole, counterface=face, pose_um=pose_um)
        return float((found.high_MPa - found.low_MPa).max())

    assert max(width(0, 0, 200.0), width(3, 2, 0.0)) < 1e-3 < width(3, 2, 50.0)
    assert min(width(3, 0, 200.0), width(0, 2, 200.0)) > 1.0


RADIUS = 60.0


def round_tool():
    """A flat stone under a round tool."""
    flat = mesh_face(make_surface(np.zeros((COUNT, COUNT)), SPACING), 0.0, 200, seed=4)
    return flat.assign(counterface=rounded_counterface(flat.height, RADIUS, MIDDLE))


def certain_use(pressure, at_centre):
    """A use through the middle, of which the wear tells the radius exactly."""
    by_draw = {"y_mm": [MIDDLE[0]], "x_mm": [MIDDLE[1]], "radius_mm": [RADIUS], "weight": [1.0]}
    by_both = {"pressure": [pressure], "pressure_at_centre": [at_centre]}
    return xr.Dataset(
        {name: ("draw", of) for name, of in by_draw.items()}
        | {name: (("draw", "patch"), of) for name, of in by_both.items()},
        {"patch": list(PLACES.patch)},
        {"adopted": 1},
    )


def under_round_tool():
    """Pressures of the patches as stated."""
    face = coarser(round_tool().height, 2), coarser(round_tool().counterface, 2)
    contact = press(*face, modulus=MODULUS, mean_pressure=TARGET, load_point=MIDDLE)
    return patch_pressures(contact.pressure, PLACES, size_mm=PATCH).pressure_MPa.to_numpy()


def test_wear_that_tells_the_radius_tells_where_a_stronger_force_is_borne(intervals):
    """Under F R / E* of the wear, all pressures grow with the force, and none with the modulus."""
    used = RADIUS, certain_use([0.0, 0.0], [0.0, 0.0])
    expected = under_round_tool()
    found = intervals([0.5, 2.0], whole=round_tool(), used=used)
    np.testing.assert_allclose([found.low_MPa, found.high_MPa], 2 * [expected], rtol=1e-4)
    found = intervals(np.ones(20), whole=round_tool(), used=used, force_log_sd=0.5)
    forces = np.exp(0.5 * np.random.default_rng([1, 3]).standard_normal(20))
    assert_ends(found, np.outer(forces, expected))
    # a radius as stated goes with any force, which then presses more of the stone
    stated_alone = intervals(np.ones(20), whole=round_tool(), used=(RADIUS, None), force_log_sd=0.5)
    assert (stated_alone.high_MPa / stated_alone.low_MPa < found.high_MPa / found.low_MPa).any()


def test_pressures_over_the_strikes_are_added_to_those_under_their_centre(intervals):
    used = RADIUS, certain_use([3.0, 1.0], [1.0, 1000.0])
    found = intervals(np.ones(2), whole=round_tool(), used=used)
    first = under_round_tool()[0] + 2.0
    # a pressure is never negative
    np.testing.assert_allclose(found.low_MPa, [first, 0.0], rtol=1e-4)
    np.testing.assert_allclose(found.high_MPa, [first, 0.0], rtol=1e-4)


def test_draws_in_which_the_stone_tips_over_are_left_out(intervals, caplog):
    beyond = intervals(np.ones(2), load_point=(-9.0, -9.0))
    assert beyond.high_MPa.isna().all()
    assert "in 2 of 2 draws the stone does not rest" in caplog.text


def test_the_force_is_not_drawn_to_where_there_is_no_stone():
    ends = np.where(axis_coordinates(COUNT, SPACING) < 1.5, np.zeros((COUNT, 1)), np.nan)
    face, middle = make_surface(ends, SPACING), (1.2, 1.2)
    drawn = [draw_point(face, middle, 2.0, np.random.default_rng(seed)) for seed in range(50)]
    assert (np.array(drawn) > 0).all()
    assert max(x for _, x in drawn) < 1.5 < max(y for y, _ in drawn) < COUNT * SPACING
    assert draw_point(face, middle, 0.0, np.random.default_rng(1)) == middle
