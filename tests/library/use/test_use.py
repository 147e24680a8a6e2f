"""How a tool was used, from losses and grades that a known use made."""

from functools import partial

import numpy as np
import pandas as pd
import pytest
import scipy
import xarray as xr
from contacts import around, written
from numpy.testing import assert_allclose, assert_array_equal

from gstlib.errors import InputError
from gstlib.macroscale.active_tool import rounded_counterface
from gstlib.macroscale.ensemble import patch_means
from gstlib.specimen.randomness import smooth_field
from gstlib.use import laws
from gstlib.use.evidence import Grades, Losses, likelihood
from gstlib.use.infer import (
    NOT_PRESSED,
    PERHAPS,
    PRESSED,
    UNKNOWN,
    StatedUse,
    _answer,
    infer_use,
    use_pressures,
)
from gstlib.use.outcome import (
    as_used,
    losses_of,
    predicted_losses,
    pressures_of_use,
    use_table,
)
from gstlib.use.sampling import Sampling, sample
from gstlib.use.spread import StrikePressures, Uses
from gstlib.use.tempering import tempered

# A square of 3 mm in a face of 4.2 mm, with sixteen patches of 0.5 mm.
SIZE, ELEMENT, COUNT, PATCH = 3.0, 0.06, 70, 0.5
MIDDLE = SIZE / 2, SIZE / 2
SETTINGS = {"modulus": 1e4, "patch_mm": PATCH}
RADIUS, POINT = 60.0, (1.7, 1.2)
STATED = StatedUse(150.0, (1.4, 1.6), 0.4, 100.0, 0.6, scatter_mm=0.3, stroke_mm=0.8)
# Beyond the face the stone tips over.
FAR = STATED._replace(load_point=(9.0, 9.0), load_point_mm=0.1)
SAMPLING = Sampling(draws=30, rounds=4, particles=200, seed=1)


@pytest.fixture(scope="module", autouse=True)
def _small_samples_of_the_laws():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(laws, "_DRAWS", 100)
        patch.setattr(laws, "_SAMPLES", 1)
        yield


@pytest.fixture(scope="module")
def face():
    waves = smooth_field(np.random.default_rng(3), COUNT, ELEMENT, 0.5).astype(float)
    height = around(2e-3 * waves, ELEMENT, (COUNT * ELEMENT - SIZE) / 2)
    over = rounded_counterface(height, STATED.radius_mm, MIDDLE)
    return xr.Dataset({"height": height, "counterface": over, "size_mm": SIZE})


def grid_of_places(along):
    """A table with a patch at every y and x (mm)."""
    y, x = np.meshgrid(along, along, indexing="ij")
    places = pd.DataFrame({"x_mm": x.ravel(), "y_mm": y.ravel(), "rotation_deg": 0.0})
    return places.assign(patch=places.index.astype(str))


@pytest.fixture(scope="module")
def patches():
    return grid_of_places(np.linspace(0.4, 2.6, 4))


@pytest.fixture(scope="module")
def pressure(face, patches):
    """Of each patch, under the use that nobody stated."""
    point = np.array([[*POINT, np.log(RADIUS)]])
    (pressure,) = use_pressures(point, face, patches, STATED, **SETTINGS)
    assert (pressure > 0).sum() > 4
    assert (pressure == 0).any()
    return pressure


@pytest.fixture(scope="module")
def losses(pressure):
    scatter = np.random.default_rng(5).standard_normal(len(pressure))
    return Losses(0.01 * pressure * np.exp(0.2 * scatter) + 2e-3 * abs(scatter))


def infer(face, patches, evidence, stated=STATED, sampling=SAMPLING):
    return infer_use(face, patches, evidence, stated, **SETTINGS, sampling=sampling)


@pytest.fixture(scope="module")
def use(face, patches, losses):
    return infer(face, patches, losses)


def mean_and_error(use, name):
    """Of what the wear says; of the radius, of its logarithm."""
    values, weight = use[name].values, use.weight.values
    if name == "radius_mm":
        values = np.log(values)
    mean = float(weight @ values)
    return mean, float(np.sqrt(weight @ (values - mean) ** 2))


def assert_point_is_told(use):
    for name, true in zip(("y_mm", "x_mm"), POINT, strict=True):
        mean, error = mean_and_error(use, name)
        assert abs(mean - true) < 3 * error < 3 * STATED.load_point_mm


def test_losses_tell_where_and_against_how_round_a_tool_one_was_pressed(use):
    assert_point_is_told(use)
    mean, error = mean_and_error(use, "radius_mm")
    assert abs(mean - np.log(RADIUS)) < 3 * error
    assert error < STATED.radius_log_sd / 2
    assert use.answer == PRESSED
    best = use.competitor_log_score.sel(competitor=use.attrs["competitor"])
    assert 0 < use.log_score_gain == pytest.approx(float((use.log_score - best).sum()))


def test_grades_tell_where_the_tool_was_pressed(face, patches, pressure):
    use = infer(face, patches, Grades(np.searchsorted([0.1, 4, 12], pressure)))
    assert_point_is_told(use)
    assert "wear_coefficient" not in set(use_table(use, STATED).parameter)


def test_patches_that_tile_the_face_bear_the_force(face):
    """None that is beyond its middle is pressed by a strike that tips the stone over."""
    tiles = grid_of_places(np.arange(-0.3, 3.4, 0.6))
    points = np.array([[*MIDDLE, np.log(RADIUS)], [9.0, 9.0, np.log(RADIUS)]])
    settings = SETTINGS | {"patch_mm": 0.6}
    middle, beyond = use_pressures(points, face, tiles, STATED, **settings)
    assert middle.sum() * 0.6**2 == pytest.approx(STATED.force_N, rel=1e-6)
    assert not beyond.any()


def test_its_own_loss_weighs_no_use_that_predicts_it():
    """By hand: of two uses, its own loss would speak for the first, and the others' do not."""
    both = "draw", "patch"
    use = xr.Dataset(
        {
            "wear_coefficient": ("draw", [0.1, 0.2]),
            "scatter": ("draw", [0.01, 0.01]),
            "floor": ("draw", [0.0, 0.008]),
            "pressure": (both, [[1.0], [3.0]]),
            "weight_without": (both, [[0.0], [1.0]]),
            "effective_sample_size_without": ("patch", [1.0]),
        },
        {"patch": ["a"]},
    )
    (row,) = predicted_losses(use, Losses(np.array([0.1])), seed=1).itertuples()
    assert row.predicted_um == pytest.approx(0.6)
    # 97.5 % of Student's t of four degrees of freedom, times the scatter of 6 nm and the floor
    limits = 0.6 + np.array([-1, 1]) * 2.776 * np.hypot(0.006, 0.008)
    assert [row.low_um, row.high_um] == pytest.approx(limits, abs=0.003)


@pytest.mark.parametrize(
    ("gains", "answer", "is_taken"),
    [((9, 1.1), PRESSED, 1), ((0.9, 9), PERHAPS, 1), ((9, -0.1), NOT_PRESSED, 0)],
)
def test_a_use_is_claimed_above_the_best_competitor_alone(gains, answer, is_taken):
    """Two patches, whose gains differ by 1, so that their sum has a standard error of 1."""
    each = np.array([[gain - 1, gain + 1] for gain in gains]) / 2
    use = xr.Dataset(
        {
            "log_score": ("patch", [0.0, 0.0]),
            "competitor_log_score": (("competitor", "patch"), -each),
        },
        {"patch": ["a", "b"], "competitor": ["heights", "spot"]},
    )
    attributes = _answer(use)
    assert (attributes["answer"], attributes["adopted"]) == (answer, is_taken)
    assert attributes["log_score_gain"] == pytest.approx(min(gains))
    assert attributes["log_score_gain_error"] == pytest.approx(1.0)


def test_pressures_after_wear_are_those_of_a_step_of_the_law(face, patches):
    """κ is known from the losses alone, and worn summits bear less."""
    pressed = partial(
        use_pressures, STATED.mean[None], face, patches, STATED, **SETTINGS
    )
    before, springs = pressed(), 2e-5
    (after,) = pressed(springs=springs)
    assert after.max() < before.max()
    told = Losses(1e3 * springs * after).springs(before)
    assert told == pytest.approx(springs, rel=0.05)


def test_a_strike_wears_by_the_coefficient_that_its_use_needs():
    """In the first round by that of the use as stated: less pressure takes more wear."""
    places, rounds = np.linspace(-2, 2, 8), []

    def pressures(strikes, springs):
        near = np.exp(-0.5 * (strikes[:, 1:] - places) ** 2)
        pressed = (5 + 2 * strikes[:, :1]) * near
        rounds.append(springs * pressed.sum(axis=1))
        return pressed

    prior = StatedUse(1.0, (0.0, 0.0), 1.0)
    losses = Losses(np.exp(-0.5 * places**2))
    settings = Sampling(draws=60, rounds=4, particles=100, seed=1)
    generator = np.random.default_rng(1)
    sample(prior, pressures, losses, settings, generator, springs=np.ones(1))
    first, *_, last = rounds
    assert np.ptp(first) > 5
    assert_allclose(last, 1e-3 * losses.depth_um.sum(), rtol=0.05)


def test_pressures_that_vanish_beside_those_of_the_latest_strikes_are_none():
    """Strikes that tip the stone over do not count, nor do many that are far from the use."""
    strikes = np.random.default_rng(1).uniform(-3, 3, (400, 2))
    pressed = np.exp(-0.5 * np.square(strikes).sum(axis=1))[:, None]
    pressed[:200] *= 100
    pressed[200:300] = 0.0
    process = StrikePressures.through(strikes, pressed)
    assert process.least == pytest.approx(0.1 * pressed[300:].mean())
    assert StrikePressures.through(strikes, 0 * pressed).least == 0


def test_particles_have_the_weights_and_scores_of_the_sum_over_all():
    """One unknown, seen with one error at three places, one of which is far off."""
    seen, errors = np.array([0.3, 0.5, 2.5]), np.array([0.4, 0.5, 0.6])

    def log_likelihood(standard):
        return scipy.stats.norm.logpdf(seen, standard[:, :1], errors)

    particles = tempered(log_likelihood, 1, 20_000, np.random.default_rng(1))
    at = np.linspace(-6, 6, 4001)
    each = np.exp(log_likelihood(at[:, None]))
    prior = scipy.stats.norm.pdf(at)
    whole = prior * each.prod(axis=1)
    x = particles.standard[:, 0]
    without = whole[:, None] / each
    means = at @ without / without.sum(axis=0)
    assert x @ particles.weights_without == pytest.approx(means, abs=0.03)
    scores = np.log(whole.sum() / without.sum(axis=0))
    assert particles.log_score == pytest.approx(scores, abs=0.05)


def test_pressures_between_strikes_are_means_over_a_scatter_and_a_stroke():
    """Against many strikes, where the pressure is a bump at a known place."""
    rng = np.random.default_rng(1)

    def pressures(strikes):
        apart = np.square(strikes[:, :2] - [0.3, -0.2]).sum(axis=1)
        return 5 * np.exp(-0.5 * apart)[:, None]

    solved = rng.uniform(-4, 4, (400, 2))
    process = StrikePressures.through(solved, pressures(solved))
    use = Uses(np.array([[0.0, 0.5]]), np.array([0.4]), np.array([[1.5, 1.0]]))
    strikes = Uses(*(np.repeat(values, 200_000, axis=0) for values in use)).strikes(rng)
    expected = pytest.approx(pressures(strikes).mean(), rel=0.01)
    assert process.mean_pressures(use).item() == expected
    covariance = 0.16 * np.eye(2) + np.outer([1.5, 1.0], [1.5, 1.0]) / 12
    assert_allclose(np.cov(strikes.T), covariance, atol=0.005)
    assert use.spread_mm == pytest.approx((np.trace(covariance) / 2) ** 0.5)


def test_likelihood_of_a_loss_is_a_density_and_no_load_is_impossible():
    pressure, standard = np.array([[10.0, 3.0]]), np.array([[0.3, -0.5, 0.2]])
    losses = Losses(np.array([0.3, 0.1]))
    parameters = losses.parameters(pressure, standard).values()
    expected, width = losses.expected(pressure, *parameters)
    density = scipy.stats.t.logpdf(losses.depth_um, 4, expected, width)
    assert losses.log_likelihood(pressure, standard) == pytest.approx(density)
    assert np.isneginf(likelihood(losses, 0 * pressure, standard)).all()


def test_the_study_is_pressed_as_the_wear_says_where_that_is_taken(face, use):
    pressed, load_point = as_used(face, use.assign_attrs(adopted=1), STATED.load_point)
    means = [mean_and_error(use, name)[0] for name in ("y_mm", "x_mm", "radius_mm")]
    assert load_point == pytest.approx(tuple(means[:2]))
    radius = np.exp(means[2])
    expected = rounded_counterface(face.height, radius, MIDDLE)
    assert_allclose(pressed.counterface, expected)
    for stated in (use.assign_attrs(adopted=0), None):
        assert as_used(face, stated, STATED.load_point) == (face, STATED.load_point)


def test_patches_that_lost_nothing_count_and_excluded_ones_do_not(patches):
    registration = written(
        """
        patch, mean_wear_depth_um, excluded, above_noise, t1_x_um
        3,     0.3,                False,    True,        3
        1,     0,                  False,    False,       1
        2,     0.2,                True,     True,        2
        """
    )
    registration[["found", "rotation_deg", "t1_y_um"]] = True, 0.0, 0.0
    registration[["t1_size_x_um", "t1_size_y_um"]] = 850.0
    measured, losses = losses_of(patches, registration)
    assert list(measured.patch) == ["1", "3"]
    assert list(measured.t1_x_um) == [1.0, 3.0]  # a loss is of the area that T1 covers
    assert_array_equal(losses.depth_um, [0.0, 0.3])
    assert_array_equal(losses.above_noise, [False, True])


def test_table_has_what_the_wear_says_and_how_well_patches_predict_each_other(
    losses, use
):
    predicted = predicted_losses(use, losses, seed=1)
    assert np.corrcoef(predicted.predicted_um, losses.depth_um)[0, 1] > 0.8
    table = use_table(use, STATED, predicted).set_index("parameter")
    weight, y = use.weight.values, use.y_mm.values
    row = table.loc["load_point_y"]
    assert row.prior == STATED.load_point[0]
    assert row["posterior_mean"] == pytest.approx(weight @ y)
    for limit, share in ((row.low, 0.025), (row.high, 0.975)):
        assert weight @ (y < limit) < share <= weight @ (y <= limit)
    log_radius, _ = mean_and_error(use, "radius_mm")
    assert table["posterior_mean"]["radius"] == pytest.approx(np.exp(log_radius))
    assert table.low["wear_coefficient"] < 0.01 < table.high["wear_coefficient"]
    assert table["posterior_mean"]["within_95"] > 0.8


@pytest.mark.parametrize("name", ["tilted", "spot"])
def test_wear_that_nothing_pressed_is_no_use(face, patches, name, monkeypatch, caplog):
    """It is best predicted by a competitor, whatever the contacts err by."""
    monkeypatch.setattr("gstlib.use.infer._MOST_CONTACT_ERROR", 0.0)
    monkeypatch.setattr("gstlib.use.infer.FEWEST_DRAWS", SAMPLING.particles + 1)
    apart = patches[["y_mm", "x_mm"]].to_numpy() - [1.0, 2.0]
    depth = 0.3 * np.exp(-np.square(apart).sum(axis=1) / 0.5)
    if name == "tilted":
        height = face.height + 2e-3 * (face.height.y + face.height.x)
        above = np.maximum(height - height.quantile(0.6), 0)
        means = patch_means(height, patches, size_mm=PATCH)
        depth = 100 * (means @ above.values.ravel())
    use = infer(face, patches, Losses(depth))
    totals = use.competitor_log_score.sum("patch")
    assert totals.competitor[totals.values.argmax()] == name
    assert use.answer == NOT_PRESSED
    # the predictions of all patches rest on too few draws
    assert "use.particles" in caplog.text


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"sampling": Sampling(50, 1, 200, 1)}, "use.rounds"),
        ({"stated": FAR}, "load.at_mm"),
        ({"stated": STATED._replace(load_point_mm=1.5)}, "load.at_mm"),
        ({"evidence": Losses(np.ones(5))}, "only 5 patches"),
        ({"evidence": Losses(np.ones(16), np.arange(16) < 3)}, "fewer than 4 of"),
    ],
)
def test_of_too_little_nothing_is_inferred(
    face, patches, losses, changed, words, caplog, monkeypatch
):
    """The study goes on as stated, and its table has the reason."""
    if words == "load.at_mm":
        monkeypatch.setattr("gstlib.use.infer._FEWEST", 10**6)
    settings = {"evidence": losses} | changed
    use = infer(face, patches[: len(settings["evidence"].depth_um)], **settings)
    assert words in caplog.text
    table = use_table(use, STATED)
    assert table.answer.str.startswith(f"{UNKNOWN}, because ").all()
    assert table["posterior_mean"].isna().all()
    assert predicted_losses(use, losses, seed=1).empty
    assert as_used(face, use, STATED.load_point) == (face, STATED.load_point)


@pytest.mark.parametrize("depth", [[1.0, np.nan], [[1.0, 2.0]], 1.0])
def test_losses_that_are_not_known_are_refused(depth):
    assert Losses([0.1, 0.2, 0.3, 0.4]).tells
    with pytest.raises(InputError, match=r"depth_um: of shape .* NaN or infinite"):
        Losses(depth)


@pytest.mark.parametrize("evidence", [Losses(np.ones(9)), Grades(np.arange(9))])
def test_evidence_is_of_as_many_patches_as_the_table(face, patches, evidence):
    with pytest.raises(InputError, match="is of 9 patches, but the table has 16"):
        infer(face, patches, evidence)


def test_pressures_of_a_patch_are_over_the_strikes_of_what_the_others_tell(
    patches, use
):
    table = patches.assign(pressure_MPa=5.0)
    adopted = use.assign_attrs(adopted=1).assign_coords(scanned=list(patches.patch))
    adopted["stated_pressure"] = "scanned", np.arange(16.0)
    row = pressures_of_use(table, adopted, patch_mm=PATCH).set_index("patch").loc["9"]
    told = use.sel(patch="9")
    # the inferred contacts are after wear: only their differences belong to a table before wear
    at_centre = float(told.weight @ told.pressure_at_centre)
    expected = 5 + float(told.weight_without @ told.pressure) - at_centre
    assert row.leave_one_out_MPa == pytest.approx(max(expected, 0), abs=1e-6)
    expected = 5 + float(told.weight @ told.pressure) - at_centre
    assert row.pressure_MPa == pytest.approx(max(expected, 0), abs=1e-6)
    assert row.force_N == pytest.approx(row.pressure_MPa * PATCH**2)
    assert row.stated_MPa == 9.0
    assert pressures_of_use(table, use.assign_attrs(adopted=0), patch_mm=PATCH) is table
