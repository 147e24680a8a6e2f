"""How much wears: as on the square, and by a fit without the patch's own loss."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from contacts import pressed
from gstlib.bem import Layer
from gstlib.coupling import patch_pressures
from gstlib.errors import InputError
from gstlib.gesture import Gesture, stroke_poses
from gstlib.io.results import columns_of
from gstlib.study import score_wear, wear_stone
from gstlib.surface import make_surface
from gstlib.validation.wear_scores import wear_summary, wear_table
from gstlib.wear import fit_mat, wear_map, wear_patch, wear_patches, wear_square

SIDE, COUNT = 2.0, 40  # of the square: mm, elements
SETTINGS = {"contact_modulus_MPa": 1e4, "tolerance": 1e-9}
# Four patches that tile the square, and one that nothing touches.
PLACES = pd.DataFrame(
    {
        "patch": ["a", "b", "c", "d"],
        "x_mm": [0.5, 1.5, 0.5, 1.5],
        "y_mm": [0.5, 0.5, 1.5, 1.5],
        "rotation_deg": 0.0,
    }
)


@pytest.fixture(scope="module")
def square():
    generator = np.random.default_rng(3)
    rough = make_surface(0.004 * generator.standard_normal((COUNT, COUNT)), SIDE / COUNT)
    return pressed(rough, target_pressure_MPa=20.0, **SETTINGS)


@pytest.fixture(scope="module")
def pressures(square):
    return patch_pressures(square.pressure, PLACES, size_mm=1.0)


def worn(square, pressures, losses_um):
    return wear_square(square, pressures, losses_um, patch_mm=1.0, steps=8)


def lost(found):
    """The depth (mm) that the bare stone removes from each patch, along the path."""
    return found.path.pressed.sel(ratio=0, body="stone")


def test_patches_that_tile_the_square_lose_what_it_loses(square, pressures):
    found = worn(square, pressures, dict.fromkeys("abcd", 0.4))
    kappa = found.path.kappa.sel(ratio=0)
    np.testing.assert_allclose(lost(found).mean("patch"), 20.0 * kappa, rtol=1e-6)
    assert (lost(found).diff("step") >= 0).all()
    assert found.losers == list("abcd")
    assert float(found.path.kappa_of_all) == pytest.approx(0.4e-3 / 20.0, rel=1e-6)
    # Pressures even out as the patches that bear most sink.
    rates = lost(found).diff("step") / kappa.diff("step")
    assert float(rates[-1].std("patch")) < float(rates[0].std("patch"))


def test_the_coefficient_behind_the_losses_is_found_without_a_patch_of_its_own(square, pressures):
    found = worn(square, pressures, dict.fromkeys("abcd", 0.4))
    kappas = found.path.kappa.sel(ratio=0)
    kappa = 0.6 * float(kappas[-1])
    true = lost(found).interp(step=np.interp(kappa, kappas, np.arange(9)))
    losses = {patch: 1e3 * float(true.sel(patch=patch)) for patch in "abcd"}
    again = worn(square, pressures, losses)
    np.testing.assert_allclose(again.path.fitted, kappa, rtol=2e-3)
    # Whatever happened on a patch, its own prediction does not see it.
    other = worn(square, pressures, losses | {"b": 2 * losses["b"]})
    assert float(other.path.fitted.sel(patch="b")) == pytest.approx(kappa, rel=2e-3)
    assert float(other.path.fitted.sel(patch="a")) > 1.1 * kappa


def test_losses_that_the_square_cannot_give_are_refused(square, pressures):
    with pytest.raises(InputError, match="macroscale: its contact could not be solved: mean_loss"):
        worn(square, pressures, {"a": 1e5, "b": 1e5})


def patch_of(pressure_MPa, seed=0):
    generator = np.random.default_rng(seed)
    rough = make_surface(0.001 * generator.standard_normal((32, 32)), 0.01)
    return pressed(rough, target_pressure_MPa=pressure_MPa, **SETTINGS)


def test_a_patch_loses_what_the_square_takes_off_it(square, pressures):
    found = worn(square, pressures, dict.fromkeys("abcd", 0.4))
    contact, path = patch_of(float(pressures.pressure_MPa[0])), found.path
    depth = wear_patch(contact, found, "a")
    kappa = float(path.fitted.sel(patch="a"))
    expected = np.interp(kappa, path.kappa[0], lost(found).sel(patch="a"))
    assert float(depth.mean()) == pytest.approx(expected, rel=1e-9)
    assert float(depth.min()) == 0
    # It wears where it touches; on a grid, summits alone.
    assert float(contact.height.where(depth > 0).mean()) > float(contact.height.mean())
    after = wear_map(contact, found, None, "a").sel(model="archard")
    np.testing.assert_allclose(after.t1, contact.height - depth, atol=1e-15)
    spared = found._replace(path=path.assign(pressed=path.pressed.where(path.patch != "a", 0.0)))
    assert float(wear_patch(contact, spared, "a").max()) == 0


def changed(contact, depth_mm, level_mm=1e-6):
    """A height change without noise."""
    like = contact.height
    return xr.Dataset(
        {
            "change": like.copy(data=-depth_mm),
            "loss": like.copy(data=depth_mm > level_mm),
            "level_of_detection": like.copy(data=np.full(like.shape, level_mm)),
        }
    )


FIELD = "model", "y", "x"


@pytest.fixture(scope="module")
def tables():
    """Archard's law holds on patches a and b; c lost half of what it predicts."""
    contacts, changes, losses = {}, {}, {}
    pressure = pd.DataFrame({"patch": list("abc"), "pressure_MPa": [10.0, 20.0, 30.0]})
    for number, patch in enumerate("abc"):
        contact = contacts[patch] = patch_of(10.0, seed=number)
        depth = np.maximum(contact.height.values - 0.001, 0) * (number + 1)
        changes[patch] = changed(contact, depth if number < 2 else depth / 2)
        lost = contact.height.to_dataset(name="height").assign(depth=(FIELD, depth[None]))
        losses[patch] = lost.assign_coords(model=["archard"])
    measured = [-float(change.change.mean()) for change in changes.values()]
    square = pressure.assign(measured=measured).set_index("patch").to_xarray()
    return wear_table(contacts, changes, losses, square)


def test_models_are_what_they_say(tables):
    table = tables[0]
    by = table.set_index(["patch", "model"])
    assert list(table.columns) == columns_of("wear")
    right = by.xs("archard", level="model")
    np.testing.assert_allclose(
        right.predicted_volume_um3 / right.measured_volume_um3, [1, 1, 2], rtol=1e-9
    )
    np.testing.assert_allclose(
        right.predicted_depth_um / right.measured_depth_um, [1, 1, 2], rtol=1e-2
    )
    assert right.rms_difference_um[:2].max() < 1e-12
    assert right.rms_difference_um["c"] > 0.01
    # Where it removes nothing, it makes no error, and all of a uniform loss is error.
    assert right.rms_out_of_contact_um.max() < 1e-12
    uniform_um = 1e3 * by.xs("uniform", level="model").predicted_volume_um3 / (32**2 * 1e5)
    np.testing.assert_allclose(
        by.xs("uniform", level="model").rms_out_of_contact_um, uniform_um, rtol=1e-9
    )
    # On a, whose summits were cut off as they stand, truncation is exact.
    cut = by.xs("truncation", level="model")
    assert cut.predicted_volume_um3["a"] == pytest.approx(right.measured_volume_um3["a"], rel=0.02)
    of = right.measured_volume_um3
    uniform = by.xs("uniform", level="model").predicted_volume_um3
    assert uniform["a"] == pytest.approx((of["b"] + of["c"]) / 2, rel=1e-9)
    pressed = by.xs("pressure", level="model").predicted_volume_um3
    assert pressed["a"] == pytest.approx((of["b"] + of["c"]) * 10 / 50, rel=1e-9)


def test_skill_is_the_share_of_the_rivals_error_that_is_saved(tables):
    table, profile = tables
    summary = wear_summary(table, profile, None, seed=1, resamples=99)
    assert list(summary.columns) == columns_of("wear_summary")
    by = table.assign(error=(table.predicted_volume_um3 - table.measured_volume_um3).abs())
    errors = by.groupby("model").error.sum()
    found = summary[summary.statistic == "skill(volume)"].set_index("against").value
    for rival in ("pressure", "uniform", "truncation"):
        assert found[rival] == pytest.approx(1 - errors["archard"] / errors[rival])
    # Only a cut predicts a depth; the same loss everywhere does not.
    assert summary[summary.statistic == "skill(depth)"].against.tolist() == ["truncation"]
    exact, heights = (of[of.patch != "c"] for of in (table, profile))
    summary = wear_summary(exact, heights, None, seed=1, resamples=99)
    assert summary[summary.statistic == "skill(map)"].value.tolist() == pytest.approx([1, 1, 1])


def test_the_profile_is_the_mean_loss_of_quarters_of_the_points(tables):
    table, profile = tables
    assert list(profile.columns) == columns_of("wear_profile")
    heights = profile[profile.by == "height"].pivot(
        index=["patch", "model"], columns="band", values="loss_um"
    )
    by = table[table.model == "archard"].set_index("patch")
    element_um2 = 0.01**2 * 1e6
    for (patch, model), bands in heights.iterrows():
        volume = by[f"{'measured' if model == 'measured' else 'predicted'}_volume_um3"][patch]
        assert bands.mean() == pytest.approx(volume / (32**2 * element_um2), rel=1e-9)
        assert bands[1] > 0 == bands[3] == bands[4]  # only what is above 1 µm was cut
    summary = wear_summary(table, profile, None, seed=1, resamples=99)
    assert summary[summary.statistic == "lower_half"].value.tolist() == [0, 0]


@pytest.fixture(scope="module")
def worn_by_both():
    """Six patches that a mat wore too, at κ of 2e-5 mm/MPa, as the square gives their pressures."""
    mat = Layer(300.0, 0.3, 0.2)
    generator = np.random.default_rng(6)
    rough = make_surface(0.003 * generator.standard_normal((COUNT, COUNT)), SIDE / COUNT)
    contact = pressed(rough, target_pressure_MPa=20.0, **SETTINGS)
    places = pd.concat([PLACES, PLACES.iloc[:2].assign(patch=["e", "f"], y_mm=1.0)])
    by_patch = patch_pressures(contact.pressure, places, size_mm=1.0)
    guess = wear_square(
        contact, by_patch, dict.fromkeys("abcdef", 0.4), patch_mm=1.0, steps=6, mat=mat
    )
    contacts = {
        patch: patch_of(pressure, seed=number)
        for number, (patch, pressure) in enumerate(
            zip(by_patch.patch, by_patch.pressure_MPa, strict=True)
        )
    }
    changes = {}
    for patch, unworn in contacts.items():
        depth = wear_patch(unworn, guess, patch, ratio=1.0, kappa=2e-5)
        changes[patch] = changed(unworn, depth - np.median(depth))
    seen = {patch: 1e3 * float((-of.change).clip(0).mean()) for patch, of in changes.items()}
    worn = wear_square(contact, by_patch, seen, patch_mm=1.0, steps=6, mat=mat)
    return worn, contacts, changes


def test_a_mat_is_found_by_its_traces_with_both_coefficients(worn_by_both):
    worn, contacts, changes = worn_by_both
    fitted = fit_mat(worn, contacts, changes)
    assert fitted.ratio_of_all == 1.0
    np.testing.assert_array_equal(fitted.mat_ratio, 1.0)
    np.testing.assert_allclose(fitted.mat_kappa, 2e-5, rtol=0.05)
    losses = dict(wear_patches(worn, fitted, contacts))
    _, profile, summary = score_wear(contacts, changes, losses, worn, fitted, seed=1, resamples=99)
    skill = summary[summary.statistic == "skill(map)"].set_index(["model", "against"]).value
    assert skill["mat", "archard"] > 0.5
    assert (skill["mat"] > 0.5).all()
    told = summary[summary.statistic == "skill(out_of_contact)"].iloc[0]
    assert (told.model, told.against) == ("mat", "archard")
    assert told.value > 0.5
    assert told.p_value == pytest.approx(2 / 2**6)  # each of six patches says so
    assert set(profile.model) == {"measured", "archard", "mat"}
    ratio = summary[summary.statistic == "mat_ratio"].iloc[0]
    assert (ratio.value, ratio.low, ratio.high) == (1, 1, 1)


def test_a_mat_that_saves_a_hundredth_of_the_error_is_not_told(tables):
    """Errors of measurement let a mat gain as much on stones that never saw one."""
    table, profile = tables
    bare = table[table.model == "archard"].assign(rms_difference_um=1.0, rms_out_of_contact_um=1.0)
    for of in ("volume_um3", "depth_um"):
        bare[f"predicted_{of}"] = 1.1 * bare[f"measured_{of}"]
    mat = bare.assign(model="mat", rms_difference_um=0.9, rms_out_of_contact_um=0.99)
    rivals = table[table.model != "archard"]
    both = pd.concat([bare, mat, rivals], ignore_index=True)
    heights = pd.concat([profile, profile[profile.model == "archard"].assign(model="mat")])
    heights = heights.reset_index(drop=True)
    summary = wear_summary(both, heights, None, seed=1, resamples=99)
    told = summary[summary.statistic == "skill(out_of_contact)"].iloc[0]
    assert told.value == pytest.approx(1 - 0.99 / 0.98)
    nested = summary[(summary.model == "mat") & (summary.against == "archard")]
    assert nested.p_value.notna().tolist() == [False, False, False, True]


def test_what_surrounds_the_bare_stone_does_not_lower_the_patch_under_the_mat(worn_by_both):
    worn, contacts, *_ = worn_by_both
    path = worn.path
    mat_alone = worn._replace(path=path.assign(pressed=path.pressed.where(path.body == "mat", 0.0)))
    flat = contacts["a"].height * 0
    depths = [
        wear_patch(
            contacts["a"].assign(surroundings=lowered, placed=True),
            mat_alone,
            "a",
            ratio=1.0,
            kappa=2e-5,
        )
        for lowered in (flat, flat + 0.05 * flat.x)
    ]
    assert depths[0].max() > 0
    np.testing.assert_allclose(depths[0], depths[1], atol=1e-6 * depths[0].max())


def test_without_two_worn_patches_there_is_a_sentence(square, pressures, caplog):
    scores = pd.DataFrame(
        {"patch": list("abc"), "believed": [True, True, False], "loss_per_area_um": [0.4, 0.0, 0.4]}
    )
    options = {"patch_mm": 1.0, "steps": 2}
    assert wear_stone(square, pressures, scores, **options) is None
    assert "wear is not predicted: fewer than two patches" in caplog.text
    scores["believed"] = True
    scores["loss_per_area_um"] = [0.4, np.nan, 0.4]  # the change of b is not known
    worn = wear_stone(square, pressures, scores, **options)
    assert worn.losers == ["a", "c"]
    assert worn.path.measured.sel(patch="c") == pytest.approx(0.4e-3)
    assert float(worn.path.fitted.sel(patch="a")) > 0


def test_a_gesture_of_one_pose_on_a_flat_wears_as_the_single_pose_does(square):
    """Its explicit steps differ from the implicit ones by less and less.

    The stone is symmetric, so that it is at rest however much has worn.
    """
    height = square.height.copy(data=square.height.values + square.height.values[::-1, ::-1])
    square = pressed(height, target_pressure_MPa=20.0, **SETTINGS)
    pressures = patch_pressures(square.pressure, PLACES, size_mm=1.0)
    wide = make_surface(np.zeros((COUNT + 40, COUNT + 40)), SIDE / COUNT)
    wide = wide.assign_coords({axis: wide[axis].copy(data=wide[axis] - 1.0) for axis in "yx"})
    poses = stroke_poses(stroke_mm=1.0, poses=1, force_N=20.0 * SIDE**2)
    gesture = Gesture(wide, True, SIDE, (SIDE / 2, SIDE / 2), poses)
    losses = dict.fromkeys("abcd", 0.2)
    errors = []
    for steps in (8, 16):
        options = {"patch_mm": 1.0, "steps": steps}
        one = wear_square(square, pressures, losses, **options)
        many = wear_square(square, pressures, losses, gesture=gesture, **options)
        np.testing.assert_allclose(lost(many).mean("patch"), 20.0 * many.path.kappa[0], rtol=1e-6)
        errors.append(float(abs(lost(many) - lost(one)).max() / lost(one).max()))
    assert errors[1] < 0.7 * errors[0] < 0.05
