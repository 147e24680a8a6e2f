"""How much wears: as on the square, and by a fit without the patch's own loss."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from contacts import around, pressed, rough, tiles
from numpy.testing import assert_allclose, assert_array_equal

from gstlib.bem import Layer, wear_path
from gstlib.conditions import Law
from gstlib.coupling.embedding import surroundings
from gstlib.coupling.pressures import covered_pressures, patch_pressures
from gstlib.errors import InputError
from gstlib.macroscale.gesture import Gesture, stroke_poses
from gstlib.surfaces.footprints import PatchPosition
from gstlib.wear.archard import _bounded, wear_patch, wear_square
from gstlib.wear.fit import fit_wear, predict_wear, wear_map
from gstlib.wear.interlayer import fit_interlayer

SIDE, COUNT = 2.0, 40  # of the square: mm, elements
GRID = {"shape": (COUNT, COUNT), "spacing": SIDE / COUNT}
SETTINGS = {"modulus": 1e4, "tolerance": 1e-9}
PLACES = tiles(SIDE)
LOSSES = dict.fromkeys("abcd", 0.4)
INTERLAYER = Layer(300.0, 0.3, 0.2)
OPTIONS = {"patch_mm": 1.0, "steps": 6}


def depth_of(*patch, **options):
    """The depth (mm) that a patch loses."""
    return wear_patch(*patch, **options)[-1]


@pytest.fixture(scope="module")
def square():
    return pressed(rough(3, **GRID, rms_mm=0.004), mean_pressure=20.0, **SETTINGS)


@pytest.fixture(scope="module")
def pressures(square):
    return patch_pressures(square.pressure, PLACES, size_mm=1.0)


@pytest.fixture(scope="module")
def worn(square, pressures):
    return wear_square(square, pressures, LOSSES, **OPTIONS)


def registered(losses, **columns):
    """The table ``registration`` of patches that lost height."""
    table = pd.DataFrame({"patch": list("abcd"), "above_noise": True} | columns)
    return table.assign(mean_wear_depth_um=losses)


def of_all(worn):
    """The path of the square to which all losses lead, with the bare stone."""
    return worn.path.sel(ratio=0, reach=worn.path.reach_of_all)


def lost(worn):
    """The depth (mm) that the bare stone removes from each patch, along the path of all."""
    return of_all(worn).pressed.sel(body="stone")


def rates(path):
    """The pressure (MPa) on the bare stone in each step."""
    depths = path.pressed.sel(body="stone").diff("step")
    return (depths / path.kappa.diff("step")).values


def test_patches_that_tile_the_square_lose_what_it_loses(worn):
    assert_allclose(lost(worn).mean("patch"), 20.0 * of_all(worn).kappa, rtol=1e-6)
    assert worn.fitted_to == list("abcd")
    assert float(worn.path.kappa_of_all) == pytest.approx(0.4e-3 / 20.0, rel=1e-6)


def test_the_coefficient_behind_the_losses_is_found_without_a_patch_of_its_own(
    square, pressures, worn
):
    kappas = of_all(worn).kappa
    kappa = 0.6 * float(kappas[-1])
    at = np.interp(kappa, kappas, np.arange(7))
    true = 1e3 * lost(worn).interp(step=at)
    losses = dict(zip("abcd", true.values, strict=True))
    again = wear_square(square, pressures, losses, **OPTIONS)
    assert_allclose(again.path.fitted, kappa, rtol=2e-3)
    # Whatever happened on a patch, its own prediction does not see it, not by a bit.
    other = wear_square(square, pressures, losses | {"b": 2 * losses["b"]}, **OPTIONS)
    for name in ("fitted", "kappa", "pressed"):
        one, two = again.along("b", 0)[name], other.along("b", 0)[name]
        assert_array_equal(one, two)
    assert float(other.path.fitted.sel(patch="a")) > 1.1 * kappa


def test_a_patch_is_pressed_as_the_wear_of_the_others_says(square, pressures):
    """And its own loss moves nothing of it, with an interlayer neither."""
    options = {"patch_mm": 1.0, "steps": 2, "interlayer": INTERLAYER}
    stated = wear_square(square, pressures, LOSSES, **options)
    first, *_, last = rates(of_all(stated))
    sinks = "abcd"[np.argmax(first - last)]
    before = rates(stated.along(sinks, 0))
    less = (before[0] + before[-1]) / 2  # of which the last step has too little
    own = pressures.pressure_MPa.where(pressures.patch == sinks)
    table = pressures.assign(leave_one_out_MPa=own - less)
    worn = wear_square(square, table, LOSSES, **options)
    after = rates(worn.along(sinks, 0))
    assert after[0] > 0 == after[-1]
    assert_allclose(after, np.maximum(before - less, 0), atol=1e-9)
    again = wear_square(square, table, LOSSES | {sinks: 0.8}, **options)
    for ratio in worn.path.ratio.values:
        one, two = worn.along(sinks, ratio), again.along(sinks, ratio)
        assert_array_equal(one.pressed, two.pressed)
        assert_array_equal(one.fitted, two.fitted)


def test_the_coefficient_is_fitted_over_what_both_scans_cover(square, pressures):
    """T1 covers a quarter of each patch: κ is that of patches there, and the outlines wear."""
    registration = registered(0.2, found=True, rotation_deg=0.0)
    registration[["t1_x_um", "t1_y_um"]] = 250.0
    registration[["t1_size_x_um", "t1_size_y_um"]] = 500.0
    quarters = PLACES.assign(x_mm=PLACES.x_mm + 0.25, y_mm=PLACES.y_mm + 0.25)
    quarters = patch_pressures(square.pressure, quarters, size_mm=0.5)
    table = pressures.assign(in_study=True)
    table = covered_pressures(table, square.pressure, registration, patch_mm=1.0)
    assert_allclose(table.covered_MPa, quarters.pressure_MPa)
    worn = fit_wear(square, table, registration, patch_mm=1.0, steps=2)
    losses = dict.fromkeys("abcd", 0.2)
    expected = wear_square(square, quarters, losses, patch_mm=0.5, steps=2)
    assert_allclose(worn.path.fitted, expected.path.fitted)
    assert_allclose(lost(worn).mean("patch"), 20.0 * of_all(worn).kappa, rtol=1e-6)
    # the pressures that the other patches say are over the same area
    table["leave_one_out_MPa"] = table.covered_MPa
    same = fit_wear(square, table, registration, patch_mm=1.0, steps=2)
    assert_allclose(same.path.pressed, worn.path.pressed)


def test_losses_that_the_square_cannot_give_are_refused(square, pressures):
    with pytest.raises(
        InputError, match="macroscale: its contact could not be solved: mean_loss"
    ):
        wear_square(square, pressures, {"a": 1e5, "b": 1e5}, **OPTIONS)


def patch_of(pressure_MPa, seed=0):
    return pressed(
        rough(seed, (24, 24), rms_mm=0.001), mean_pressure=pressure_MPa, **SETTINGS
    )


def changed(contact, depth_mm):
    """The change without noise, of which scans see what exceeds the median."""
    seen = depth_mm - np.median(depth_mm)
    return xr.Dataset({"change": contact.interface.height.copy(data=-seen)})


@pytest.fixture(scope="module")
def worn_by_both():
    """Four patches that an interlayer wore too, at κ of 2e-5 mm/MPa, as the square presses them."""
    contact = pressed(rough(6, **GRID, rms_mm=0.003), mean_pressure=20.0, **SETTINGS)
    table = patch_pressures(contact.pressure, PLACES, size_mm=1.0)
    guess = wear_square(contact, table, LOSSES, **OPTIONS, interlayer=INTERLAYER)
    contacts, changes, losses = {}, {}, []
    for number, patch in enumerate(table.itertuples()):
        unworn = patch_of(patch.pressure_MPa, seed=number)
        depth = depth_of(unworn, guess, patch.patch, ratio=1.0, kappa=2e-5)
        contacts[patch.patch], changes[patch.patch] = unworn, changed(unworn, depth)
        losses.append(1e3 * float((-changes[patch.patch].change).clip(0).mean()))
    tables, maps = (
        (table.assign(in_study=True), registered(losses)),
        (contacts, changes),
    )
    layer = {"young_MPa": 300.0, "poisson": 0.3, "thickness_um": 200.0}
    return fit_wear(contact, *tables, *maps, **OPTIONS, interlayer=layer), *maps


def test_an_interlayer_is_found_by_its_traces_with_both_coefficients(worn_by_both):
    worn, *_ = worn_by_both
    fitted = worn.interlayer
    assert worn.layer == INTERLAYER
    assert fitted.ratio_of_all == 1.0
    assert_array_equal(fitted.interlayer_ratio, 1.0)
    assert_allclose(fitted.interlayer_kappa, 2e-5, rtol=0.05)


def test_the_coefficients_of_a_patch_come_from_all_others(worn_by_both):
    """Whatever its own map and loss are; of a patch that nothing is fitted to, from all."""
    worn, contacts, changes = worn_by_both
    contact, fitted = contacts["a"], worn.interlayer
    bare = 40 * depth_of(contact, worn, "a", kappa=2e-5)  # which outweighs the others
    measured = worn.path.measured.where(worn.path.patch != "a", float(bare.mean()))
    other = worn._replace(path=worn.path.assign(measured=measured))
    again = fit_interlayer(other, contacts, changes | {"a": changed(contact, bare)})
    is_same = again.interlayer_kappa == fitted.interlayer_kappa
    assert again.patch[is_same].values.tolist() == ["a"]
    out = again.sel(patch=list("bcd"))
    layer = {name: fitted[name] for name in set(fitted) - set(again)}
    for table, ratio, kappa in (
        (again, again.interlayer_ratio[0], again.interlayer_kappa[0]),
        (out, out.ratio_of_all, out.kappa_of_all),
    ):
        stone = other._replace(interlayer=table.assign(layer))
        maps = wear_map(contact, stone, "a").depth
        expected = depth_of(contact, other, "a", ratio=float(ratio), kappa=float(kappa))
        assert_array_equal(maps.sel(model="interlayer"), expected)


def test_a_patch_is_worn_at_its_pressure_in_each_step(worn):
    contact, path = patch_of(20.0), worn.path
    pressures = np.array([0.0, 0.0, 20.0, 60.0, 0.0, 10.0])
    kappas = worn.along("a", 0).kappa.values
    depths = np.cumsum([0.0, *np.diff(kappas) * pressures])
    path = path.assign(pressed=0 * path.pressed + xr.DataArray(depths, dims="step"))
    depth = depth_of(contact, worn._replace(path=path), "a", kappa=kappas[-1])
    options = {"mean_pressure": pressures, "mean_loss": depths[-1], "steps": 6}
    expected = wear_path(
        contact.interface.height.values, 0.01, 1e4, **options, tolerance=1e-9
    )
    assert_allclose(depth, expected.depth, atol=1e-12)
    spared = worn._replace(path=path.assign(pressed=0 * path.pressed))
    assert depth_of(contact, spared, "a").max() == 0


def test_an_interlayer_lies_among_the_pressures_that_are_under_it(worn_by_both):
    """What it takes off does not depend on what the bare stone would press around the patch."""
    worn, contacts, _ = worn_by_both
    alone, path = contacts["a"], worn.path
    soft = path.assign(pressed=path.pressed.where(path.body == "interlayer", 0.0))
    worn, face = worn._replace(path=soft), alone.interface
    options = {"size_mm": 1.0, "contact_modulus_MPa": 1e4, "layer": INTERLAYER}
    place, shape = PatchPosition.from_dataset(soft.sel(patch="a")), face.height.shape
    sunk = surroundings(worn.interlayer.pressure, place, shape, **options)
    assert np.ptp(sunk) > 1e-4
    lower = replace(alone, interface=replace(face, height=face.height - sunk))
    expected = depth_of(lower, worn, "a", ratio=1.0, kappa=1e-5)
    ramp = 2e-3 * np.linspace(0, 1, shape[1]) * np.ones(shape)
    among = replace(alone, interface=replace(face, surroundings=ramp))
    depth = depth_of(among, worn, "a", ratio=1.0, kappa=1e-5)
    assert_allclose(depth, expected, atol=1e-12)


@pytest.mark.parametrize(
    "law", [Law(exponent=2.0), Law(threshold_MPa=18.8), Law(15.0, 0.5)]
)
def test_a_patch_loses_as_the_law_says_of_the_pressure_from_the_others(
    square, pressures, law
):
    """While pressures are as before use; so a threshold between them spares some patches."""
    before = pressures.pressure_MPa * [1.2, 0.8, 1.1, 0.9]
    table, losses = (
        pressures.assign(leave_one_out_MPa=before),
        dict.fromkeys("abcd", 1e-5),
    )
    worn = wear_square(square, table, losses, patch_mm=1.0, steps=2, law=law)
    kappa, contact = float(worn.path.kappa_of_all), patch_of(20.0)
    expected = np.maximum(before - law.threshold_MPa, 0) ** law.exponent
    measured = [depth_of(contact, worn, name, kappa=kappa).mean() for name in "abcd"]
    assert_allclose(measured, 4e-8 * expected / expected.sum(), rtol=2e-3)


def test_summits_that_yield_spread_the_same_loss_wider(worn, pressures):
    contact = patch_of(float(pressures.pressure_MPa[0]))
    ((_, maps),) = predict_wear({"a": contact}, worn, pressure_cap=100.0)
    elastic, yielding = maps.depth.values
    assert_array_equal(elastic, depth_of(contact, worn, "a"))
    assert yielding.mean() == pytest.approx(elastic.mean(), rel=1e-9)
    assert yielding.max() < elastic.max()
    # a cap above all pressures, 481 MPa here, changes nothing, and one just below them does
    for pressure_cap in (480.0, 482.0):
        capped = depth_of(contact, worn, "a", pressure_cap=pressure_cap)
        assert np.array_equal(capped, elastic) == (pressure_cap > 481)


def test_a_patch_that_bears_more_than_the_cap_loses_less():
    """Of 20 and 60 MPa in two steps, with a cap of 50 MPa, of which nine tenths are borne."""
    options = {"mean_pressure": np.array([20.0, 60.0]), "mean_loss": 1e-3}
    bounded = _bounded(options, 50.0, 45.0, Law(exponent=2.0))
    assert_allclose(bounded["mean_pressure"], [20.0, 45.0])
    expected = 1e-3 * (20**2 + 45**2) / (20**2 + 60**2)
    assert bounded["mean_loss"] == pytest.approx(expected)
    assert bounded["pressure_cap"] == 50.0


def test_summits_yield_in_the_last_of_the_models_alone(worn_by_both):
    worn, contacts, _ = worn_by_both
    depth = wear_map(contacts["a"], worn, "a", pressure_cap=1e4).depth
    assert list(depth.model) == ["archard", "interlayer", "archard_capped"]
    interlayer, capped = depth.values[1:]
    assert_array_equal(capped, interlayer)  # nothing reaches this cap


def test_without_two_worn_patches_nothing_is_fitted(square, pressures, caplog):
    # the change of b is not known, and that of d is noise
    registration = registered([0.4, np.nan, 0.4, 0.1])
    registration.loc[3, "above_noise"] = False
    pressures, options = pressures.assign(in_study=True), {"patch_mm": 1.0, "steps": 2}
    worn = fit_wear(square, pressures, registration, **options)
    assert worn.fitted_to == ["a", "c"]
    pressures.loc[2, "pressure_MPa"] = 0
    assert fit_wear(square, pressures, registration, **options) is None
    assert "fewer than two patches in the study lost" in caplog.text


def test_a_gesture_that_stays_in_place_wears_as_the_single_pose_does(square):
    """Its explicit steps differ from the implicit ones by less and less."""
    height = square.interface.height
    # at rest however much has worn
    symmetric = height.copy(data=height.values + height.values[::-1, ::-1])
    square = pressed(symmetric, mean_pressure=20.0, **SETTINGS)
    table = patch_pressures(square.pressure, PLACES, size_mm=1.0)
    wide = around(np.zeros((COUNT + 40, COUNT + 40)), SIDE / COUNT, 1.0)
    poses = stroke_poses(stroke_mm=1.0, poses=2, force_N=20.0 * SIDE**2)
    poses["x_mm"] = 0.0
    gesture = Gesture(symmetric, wide, SIDE, (SIDE / 2, SIDE / 2), poses)
    errors = []
    for steps in (4, 8):
        options = {"patch_mm": 1.0, "steps": steps}
        one = wear_square(square, table, LOSSES, **options)
        many = wear_square(square, table, LOSSES, gesture=gesture, **options)
        errors.append(float(abs(lost(many) - lost(one)).max() / lost(one).max()))
    assert errors[1] < 0.7 * errors[0] < 0.05
