"""How much wears: as on the square, and by a fit without the patch's own loss."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from contacts import around, pressed, rough, tiles
from gstlib.bem import Layer, wear_path
from gstlib.conditions import Law
from gstlib.coupling.embedding import surroundings
from gstlib.coupling.pressures import covered_pressures, patch_pressures
from gstlib.errors import InputError
from gstlib.macroscale.gesture import Gesture, stroke_poses
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.grid import make_surface
from gstlib.validation.summary import score_wear, statistic_names
from gstlib.wear.archard import Interlayer, WornSquare, wear_patch, wear_square
from gstlib.wear.fit import PatchMaps, Prediction, fit_wear, predict_wear, wear_map
from gstlib.wear.interlayer import fit_interlayer

SIDE, COUNT = 2.0, 40  # of the square: mm, elements
SETTINGS = {"modulus": 1e4, "tolerance": 1e-9}
PLACES, GRID = tiles(SIDE), {"shape": (COUNT, COUNT), "spacing": SIDE / COUNT}


@pytest.fixture(scope="module")
def square():
    return pressed(rough(3, **GRID, rms_mm=0.004), mean_pressure=20.0, **SETTINGS)


@pytest.fixture(scope="module")
def pressures(square):
    return patch_pressures(square.pressure, PLACES, size_mm=1.0)


def worn(square, pressures, losses_um):
    return wear_square(square, pressures, losses_um, patch_mm=1.0, steps=8)


def lost(found):
    """The depth (mm) that the bare stone removes from each patch, along the path of all."""
    return of_all(found).pressed.sel(body="stone")


def of_all(found):
    return found.path.sel(ratio=0, reach=found.path.reach_of_all)


def test_patches_that_tile_the_square_lose_what_it_loses(square, pressures):
    found = worn(square, pressures, dict.fromkeys("abcd", 0.4))
    kappa = of_all(found).kappa
    np.testing.assert_allclose(lost(found).mean("patch"), 20.0 * kappa, rtol=1e-6)
    assert (lost(found).diff("step") >= 0).all()
    assert found.fitted_to == list("abcd")
    assert float(found.path.kappa_of_all) == pytest.approx(0.4e-3 / 20.0, rel=1e-6)
    # Pressures even out as the patches that bear most sink.
    rates = lost(found).diff("step") / kappa.diff("step")
    assert float(rates[-1].std("patch")) < float(rates[0].std("patch"))


def test_the_coefficient_behind_the_losses_is_found_without_a_patch_of_its_own(square, pressures):
    found = worn(square, pressures, dict.fromkeys("abcd", 0.4))
    kappas = of_all(found).kappa
    kappa = 0.6 * float(kappas[-1])
    true = lost(found).interp(step=np.interp(kappa, kappas, np.arange(9)))
    losses = {patch: 1e3 * float(true.sel(patch=patch)) for patch in "abcd"}
    again = worn(square, pressures, losses)
    np.testing.assert_allclose(again.path.fitted, kappa, rtol=2e-3)
    # Whatever happened on a patch, its own prediction does not see it, not by a bit.
    other = worn(square, pressures, losses | {"b": 2 * losses["b"]})
    assert len(other.path.reach) > len(again.path.reach) == 1
    for name in ("fitted", "kappa", "pressed"):
        one, two = again.along("b", 0)[name], other.along("b", 0)[name]
        np.testing.assert_array_equal(one, two)
    assert float(other.path.fitted.sel(patch="a")) > 1.1 * kappa


def rates(path):
    """The pressure (MPa) on the bare stone in each step."""
    return (path.pressed.sel(body="stone").diff("step") / path.kappa.diff("step")).values


@pytest.mark.parametrize("layer", [None, Layer(300.0, 0.3, 0.2)])
def test_a_patch_is_pressed_as_the_wear_of_the_others_says(square, pressures, layer):
    """And its own loss moves nothing of it, with an interlayer neither."""
    options = {"patch_mm": 1.0, "steps": 8, "interlayer": layer}
    losses = dict.fromkeys("abcd", 0.4)
    stated = wear_square(square, pressures, losses, **options)
    first, *_, last = rates(of_all(stated))
    sinks = "abcd"[np.argmax(first - last)]
    before = rates(stated.along(sinks, 0))
    less = (before[0] + before[-1]) / 2  # of which the last step has too little
    told = pressures.set_index("patch", drop=False)
    told["leave_one_out_MPa"] = told.pressure_MPa.where(told.patch == sinks) - less
    found = wear_square(square, told, losses, **options)
    after = rates(found.along(sinks, 0))
    assert found.along(sinks, 0).reach == stated.along(sinks, 0).reach
    assert after[0] > 0 == after[-1]
    np.testing.assert_allclose(after, np.maximum(before - less, 0), atol=1e-9)
    assert wear_patch(patch_of(20.0), found, sinks).mean() > 0
    again = wear_square(square, told, losses | {sinks: 0.8}, **options)
    for ratio in found.path.ratio.values:
        one, two = (of.along(sinks, ratio) for of in (found, again))
        np.testing.assert_array_equal(one.pressed, two.pressed)
        np.testing.assert_array_equal(one.fitted, two.fitted)


def in_poses(square):
    """A gesture, and the contact of a stone that is symmetric: at rest however much has worn."""
    height = square.interface.height
    height = height.copy(data=height.values + height.values[::-1, ::-1])
    wide = around(np.zeros((COUNT + 40, COUNT + 40)), SIDE / COUNT, 1.0)
    moves = stroke_poses(stroke_mm=1.0, poses=2, force_N=20.0 * SIDE**2)
    gesture = Gesture(height, wide, SIDE, (SIDE / 2, SIDE / 2), moves.assign(x_mm=0.0))
    return pressed(height, mean_pressure=20.0, **SETTINGS), gesture


@pytest.mark.parametrize("is_gesture", [False, True])
def test_the_coefficient_is_fitted_over_what_both_scans_cover(square, pressures, is_gesture):
    """T1 covers a quarter of each patch: κ is that of patches there, and the outlines wear."""
    gesture = None
    if is_gesture:
        square, gesture = in_poses(square)
        pressures = patch_pressures(square.pressure, PLACES, size_mm=1.0)
    registration = pd.DataFrame({"patch": list("abcd"), "found": True, "above_noise": True})
    of_t1 = {"t1_x_um": 250.0, "t1_y_um": 250.0, "t1_size_x_um": 500.0, "t1_size_y_um": 500.0}
    registration = registration.assign(**of_t1, rotation_deg=0.0, mean_wear_depth_um=0.2)
    quarters = PLACES.assign(x_mm=PLACES.x_mm + 0.25, y_mm=PLACES.y_mm + 0.25)
    quarters = patch_pressures(square.pressure, quarters, size_mm=0.5)
    given = square.pressure, registration
    table = covered_pressures(pressures.assign(in_study=True), *given, patch_mm=1.0)
    np.testing.assert_allclose(table.covered_MPa, quarters.pressure_MPa)
    options, losses = {"steps": 2, "gesture": gesture}, dict.fromkeys("abcd", 0.2)
    found = fit_wear(square, table, registration, patch_mm=1.0, **options)
    expected = wear_square(square, quarters, losses, patch_mm=0.5, **options)
    np.testing.assert_allclose(found.path.fitted, expected.path.fitted)
    whole = wear_square(square, pressures, losses, patch_mm=1.0, **options)
    assert not np.allclose(found.path.fitted, whole.path.fitted, rtol=1e-3)
    np.testing.assert_allclose(lost(found).mean("patch"), 20.0 * of_all(found).kappa, rtol=1e-6)
    # the pressures that the other patches say are over the same area
    told = table.assign(leave_one_out_MPa=table.covered_MPa)
    same = fit_wear(square, told, registration, patch_mm=1.0, **options)
    np.testing.assert_allclose(same.path.pressed, found.path.pressed)


def test_losses_that_the_square_cannot_give_are_refused(square, pressures):
    with pytest.raises(InputError, match="macroscale: its contact could not be solved: mean_loss"):
        worn(square, pressures, {"a": 1e5, "b": 1e5})


def patch_of(pressure_MPa, seed=0):
    return pressed(rough(seed, (32, 32), rms_mm=0.001), mean_pressure=pressure_MPa, **SETTINGS)


def changed(contact, depth_mm, level_mm=1e-6):
    """The change without noise, of which scans see what exceeds the median."""
    like, seen = contact.interface.height, depth_mm - np.median(depth_mm)
    return xr.Dataset(
        {
            "change": like.copy(data=-seen),
            "loss": like.copy(data=seen > level_mm),
            "level_of_detection": like.copy(data=np.full(like.shape, level_mm)),
        }
    )


def test_a_patch_loses_what_the_square_takes_off_it(square, pressures):
    found = worn(square, pressures, dict.fromkeys("abcd", 0.4))
    contact, path = patch_of(float(pressures.pressure_MPa[0])), found.path
    depth = wear_patch(contact, found, "a")
    kappa = float(path.fitted.sel(patch="a"))
    at = found.along("a", 0)
    expected = np.interp(kappa, at.kappa, at.pressed.sel(body="stone"))
    assert float(depth.mean()) == pytest.approx(expected, rel=1e-9)
    assert float(depth.min()) == 0
    # It wears where it touches; on a grid, summits alone.
    assert float(contact.interface.height.where(depth > 0).mean()) > float(
        contact.interface.height.mean()
    )
    np.testing.assert_array_equal(wear_map(contact, found, "a").depth[0], depth)
    spared = found._replace(path=path.assign(pressed=path.pressed.where(path.patch != "a", 0.0)))
    assert float(wear_patch(contact, spared, "a").max()) == 0


@pytest.fixture(scope="module")
def worn_by_both():
    """Six patches that an interlayer wore too, at κ of 2e-5 mm/MPa, as the square presses them."""
    interlayer = Layer(300.0, 0.3, 0.2)
    contact = pressed(rough(6, **GRID, rms_mm=0.003), mean_pressure=20.0, **SETTINGS)
    places = pd.concat([PLACES, PLACES.iloc[:2].assign(patch=["e", "f"], y_mm=1.0)])
    by_patch = patch_pressures(contact.pressure, places, size_mm=1.0)
    options, losses = {"patch_mm": 1.0, "steps": 6}, dict.fromkeys("abcdef", 0.4)
    guess = wear_square(contact, by_patch, losses, **options, interlayer=interlayer)
    contacts, changes = {}, {}
    for number, patch in enumerate(by_patch.itertuples()):
        unworn = contacts[patch.patch] = patch_of(patch.pressure_MPa, seed=number)
        depth = wear_patch(unworn, guess, patch.patch, ratio=1.0, kappa=2e-5)
        changes[patch.patch] = changed(unworn, depth)
    registration = pd.DataFrame(
        {"patch": list(changes), "above_noise": True, "known_fraction": 1.0}
    )
    registration["mean_wear_depth_um"] = [
        1e3 * float((-of.change).clip(0).mean()) for of in changes.values()
    ]
    registration["loss_fraction"] = [float(of.loss.mean()) for of in changes.values()]
    tables = by_patch.assign(in_study=True), registration
    layer = {"young_MPa": 300.0, "poisson": 0.3, "thickness_um": 200.0}
    worn = fit_wear(contact, *tables, PatchMaps(contacts, changes), **options, interlayer=layer)
    assert worn.interlayer.layer == interlayer
    # under something soft, more of the square bears the same force
    assert float(worn.interlayer.pressure.mean()) == pytest.approx(20.0, rel=1e-6)
    assert (worn.interlayer.pressure > 0).mean() > 1.5 * (contact.pressure > 0).mean()
    return worn, contacts, changes, worn.interlayer.fitted, tables


def test_an_interlayer_is_found_by_its_traces_with_both_coefficients(worn_by_both):
    worn, contacts, changes, fitted, tables = worn_by_both
    assert fitted.ratio_of_all == 1.0
    np.testing.assert_array_equal(fitted.interlayer_ratio, 1.0)
    np.testing.assert_allclose(fitted.interlayer_kappa, 2e-5, rtol=0.05)
    prediction = Prediction.of(dict(predict_wear(contacts, worn)), worn)
    found = score_wear(contacts, changes, prediction, *tables, seed=1, resamples=99)
    error = found["wear"].pivot(index="patch", columns="model", values="map_error_um")
    assert (error["interlayer"] < 0.5 * error["archard"]).all()
    rows = found["summary"]
    rows = rows.set_index(["model", statistic_names(rows)])
    told = rows.loc["interlayer", "relative(out_of_contact)"]
    assert told.value < 0.5
    assert told.p_value == pytest.approx(2 / 2**6)  # each of six patches says so
    assert rows.loc[("interlayer", "interlayer_ratio"), "value"] == 1
    assert set(found["profile"].model) == {"measured", "archard", "interlayer"}


def with_fitted(worn, fitted):
    """The square with another interlayer's coefficient."""
    return worn._replace(interlayer=worn.interlayer._replace(fitted=fitted))


def test_the_coefficients_of_a_patch_come_from_all_others(worn_by_both):
    """Whatever its own map and loss are; of a patch that nothing is fitted to, from all."""
    worn, contacts, changes, fitted, _ = worn_by_both
    path = worn.path
    bare = 40 * wear_patch(contacts["a"], worn, "a", kappa=2e-5)  # which outweighs the others
    odd = changes | {"a": changed(contacts["a"], bare)}
    lost = path.measured.where(path.patch != "a", float(bare.mean()))
    other = worn._replace(path=path.assign(measured=lost))
    again = fit_interlayer(other, contacts, odd)
    for name in ("interlayer_ratio", "interlayer_kappa"):
        assert float(again[name].sel(patch="a")) == float(fitted[name].sel(patch="a"))
    assert (again.interlayer_kappa != fitted.interlayer_kappa).sum() == 5
    maps = wear_map(contacts["a"], with_fitted(other, again), "a", pressure_cap=1e6).depth
    ratio, kappa = (
        float(again[name].sel(patch="a")) for name in ("interlayer_ratio", "interlayer_kappa")
    )
    expected = wear_patch(contacts["a"], other, "a", ratio=ratio, kappa=kappa)
    np.testing.assert_array_equal(maps.sel(model="interlayer"), expected)
    np.testing.assert_array_equal(
        maps.sel(model="archard_capped"), expected
    )  # nothing yields so early
    out = again.sel(patch=list("bcdef"))
    depth = wear_map(contacts["a"], with_fitted(other, out), "a").sel(model="interlayer").depth
    ratio, kappa = float(out.ratio_of_all), float(out.kappa_of_all)
    expected = wear_patch(contacts["a"], other, "a", ratio=ratio, kappa=kappa)
    np.testing.assert_array_equal(depth, expected)
    # what neither body can press, is not lost
    soft = wear_patch(contacts["a"], worn, "a", ratio=1.0, kappa=1e-6, pressure_cap=10.0)
    assert soft.mean() == pytest.approx(1e-6 * 9.0, rel=1e-6)


def by_hand(stone, interlayer, kappa=1e-5):
    """A square that presses patch a (MPa) by stone and interlayer as said, step by step."""
    pressed = kappa / len(stone) * np.cumsum([[0.0, *stone], [0.0, *interlayer]], axis=1)
    numbers = {"x_mm": 0.5, "y_mm": 0.5, "rotation_deg": 0.0, "pressure_MPa": 20.0}
    path = xr.Dataset(
        {
            "kappa": (("reach", "ratio", "step"), [2 * [np.linspace(0, kappa, len(stone) + 1)]]),
            "pressed": (("reach", "ratio", "body", "step", "patch"), [2 * [pressed[..., None]]]),
            "patch_mm": 0.32,
            "reach_of": ("patch", [kappa]),
        }
        | {name: ("patch", [at]) for name, at in numbers.items()},
        coords={
            "reach": [kappa],
            "ratio": [0.0, 1.0],
            "body": ["stone", "interlayer"],
            "patch": ["a"],
        },
    )
    field = make_surface(np.zeros((COUNT, COUNT)), SIDE / COUNT)
    field[10, 16] = 2000.0  # beside the patch, within reach of the interlayer
    return WornSquare(path, Interlayer(Layer(300.0, 0.3, 0.2), field))


def test_a_patch_is_worn_at_its_pressure_in_each_step():
    contact, stone = patch_of(20.0), [0.0, 0.0, 20.0, 60.0]
    depth = wear_patch(contact, by_hand(stone, stone), "a", kappa=1e-5)
    options = {"mean_pressure": stone, "mean_loss": 1e-5 * 20.0, "steps": 4, "tolerance": 1e-9}
    path = wear_path(contact.interface.height.values, 0.01, 1e4, **options)
    np.testing.assert_allclose(depth, path.depth, atol=1e-12)


def test_an_interlayer_lies_among_the_pressures_that_are_under_it():
    """What it takes off does not depend on what the bare stone would press around the patch."""
    worn, alone = by_hand([0.0] * 4, [20.0] * 4), patch_of(20.0)
    interlayer, shape = worn.interlayer, alone.pressure.shape
    options = {"size_mm": 0.32, "contact_modulus_MPa": 1e4, "layer": interlayer.layer}
    sunk = surroundings(interlayer.pressure, PatchPosition(0.5, 0.5, 0.0), shape, **options)
    assert np.ptp(sunk) > 1e-3
    face = alone.interface
    lower = replace(alone, interface=replace(face, height=face.height - sunk))
    expected = wear_patch(lower, worn, "a", ratio=1.0, kappa=1e-5)
    assert expected.mean() == pytest.approx(1e-5 * 20.0 / 2)  # the interlayer's share of κ is half
    ramp = 2e-3 * np.linspace(0, 1, shape[1]) * np.ones(shape)
    among = replace(alone, interface=replace(face, surroundings=ramp))
    depth = wear_patch(among, worn, "a", ratio=1.0, kappa=1e-5)
    np.testing.assert_allclose(depth, expected, atol=1e-12)


@pytest.mark.parametrize(
    "law", [Law(exponent=2.0), Law(exponent=0.0), Law(threshold_MPa=18.8), Law(15.0, 0.5)]
)
def test_a_patch_loses_as_the_law_says_of_its_pressure(square, pressures, law):
    """While pressures are as before use; so a threshold between them spares some patches."""
    before = pressures.pressure_MPa.to_numpy()
    losses = dict.fromkeys("abcd", 1e-5)
    found = wear_square(square, pressures, losses, patch_mm=1.0, steps=2, law=law)
    kappa = float(found.path.kappa_of_all)
    contacts = dict(zip("abcd", map(patch_of, before), strict=True))
    depths = [wear_patch(contacts[name], found, name, kappa=kappa) for name in contacts]
    expected = np.maximum(before - law.threshold_MPa, 0) ** law.exponent
    expected = expected * (before > law.threshold_MPa)
    assert law.threshold_MPa < 18 or 0 < (expected > 0).sum() < 4
    measured = np.mean(depths, axis=(1, 2))
    np.testing.assert_allclose(measured, 4e-8 * expected / expected.sum(), rtol=2e-3)
    # a cap takes what the law says of the pressure that is borne
    capped = wear_patch(patch_of(30.0), found, "a", kappa=kappa, pressure_cap=before[0] / 0.9 - 2)
    share = law.rate(before[0] - 1.8) / law.rate(before[0]) if measured[0] else 1.0
    assert capped.mean() == pytest.approx(share * measured[0], rel=2e-3)


def test_summits_that_yield_spread_the_same_loss_wider(square, pressures):
    found = worn(square, pressures, dict.fromkeys("abcd", 0.4))
    contact = patch_of(float(pressures.pressure_MPa[0]))
    maps = wear_map(contact, found, "a", pressure_cap=100.0)
    elastic, yielding = maps.depth.values
    np.testing.assert_array_equal(elastic, wear_patch(contact, found, "a"))
    assert dict(predict_wear({"a": contact}, found, pressure_cap=100.0))["a"].identical(maps)
    assert yielding.mean() == pytest.approx(elastic.mean(), rel=1e-9)
    assert yielding.max() < elastic.max()
    # a cap above all pressures, 607 MPa here, changes nothing, and one just below them does
    for pressure_cap in (600.0, 610.0):
        with_cap = wear_patch(contact, found, "a", pressure_cap=pressure_cap)
        assert np.array_equal(with_cap, elastic) == (pressure_cap > 607)
    # each step takes off at most what the cap allows
    early = {"kappa": 1e-6, "pressure_cap": 60.0}
    few = wear_patch(contact, found, "a", **early)
    assert few.max() == pytest.approx(1e-6 * 60.0)
    assert (few > 0).sum() > 1.1 * (wear_patch(contact, found, "a", kappa=1e-6) > 0).sum()


def test_without_two_worn_patches_there_is_a_sentence(square, pressures, caplog):
    registration = pd.DataFrame(
        {
            "patch": list("abc"),
            "above_noise": [True, True, False],
            "mean_wear_depth_um": [0.4, 0.0, 0.4],
        }
    )
    pressures, options = pressures.assign(in_study=True), {"patch_mm": 1.0, "steps": 2}
    assert fit_wear(square, pressures, registration, **options) is None
    assert "wear is not predicted: fewer than two patches" in caplog.text
    registration["above_noise"] = True
    registration["mean_wear_depth_um"] = [0.4, np.nan, 0.4]  # the change of b is not known
    worn = fit_wear(square, pressures, registration, **options)
    assert worn.fitted_to == ["a", "c"]
    assert worn.path.measured.sel(patch="c") == pytest.approx(0.4e-3)
    assert float(worn.path.fitted.sel(patch="a")) > 0
    out = pressures.assign(in_study=pressures.patch != "c")
    assert fit_wear(square, out, registration, **options) is None
    bare = pressures.assign(pressure_MPa=pressures.pressure_MPa.where(pressures.patch != "c", 0))
    assert fit_wear(square, bare, registration, **options) is None


def test_a_gesture_that_stays_in_place_wears_as_the_single_pose_does(square):
    """Its explicit steps differ from the implicit ones by less and less."""
    square, gesture = in_poses(square)
    pressures = patch_pressures(square.pressure, PLACES, size_mm=1.0)
    losses = dict.fromkeys("abcd", 0.2)
    errors = []
    for steps in (8, 16):
        options = {"patch_mm": 1.0, "steps": steps}
        one = wear_square(square, pressures, losses, **options)
        many = wear_square(square, pressures, losses, gesture=gesture, **options)
        np.testing.assert_allclose(lost(many).mean("patch"), 20.0 * of_all(many).kappa, rtol=1e-6)
        errors.append(float(abs(lost(many) - lost(one)).max() / lost(one).max()))
    assert errors[1] < 0.7 * errors[0] < 0.05
