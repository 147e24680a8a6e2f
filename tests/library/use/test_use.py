"""How a tool was used, from losses and grades that a known use made."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import scipy
import xarray as xr
from contacts import around
from gstlib.contact import Interface, Load
from gstlib.macroscale.active_tool import rounded_counterface
from gstlib.macroscale.ensemble import Case, patch_means, press_each
from gstlib.specimen.randomness import smooth_field
from gstlib.surfaces.grid import coarser
from gstlib.use.evidence import Grades, Losses, weigh
from gstlib.use.infer import (
    BETTER,
    CHANCE,
    CONSISTENT,
    UNKNOWN,
    StatedUse,
    _answer,
    _chance,
    _orders,
    infer_use,
)
from gstlib.use.outcome import (
    as_used,
    leave_one_out,
    losses_of,
    predicted_losses,
    use_of_study,
    use_table,
)
from gstlib.use.sampling import Sampling, effective_draws, sample

# A square of 3 mm in a face of 4.2 mm, with sixteen patches of 0.5 mm.
SIZE, ELEMENT, COUNT, PATCH = 3.0, 0.06, 70, 0.5
MODULUS, FORCE, RADIUS, POINT = 1e4, 150.0, 60.0, (1.7, 1.2)
STATED = StatedUse(FORCE, (1.4, 1.6), 0.4, 100.0, 0.6)
SAMPLING = Sampling(draws=40, rounds=12, seed=1, enough=50)


@pytest.fixture(scope="module")
def face():
    waves = smooth_field(np.random.default_rng(3), COUNT, ELEMENT, 0.5).astype(float)
    height = around(2e-3 * waves, ELEMENT, (COUNT * ELEMENT - SIZE) / 2)
    over = rounded_counterface(height, STATED.radius_mm, 2 * (SIZE / 2,))
    return xr.Dataset({"height": height, "counterface": over, "size_mm": SIZE})


@pytest.fixture(scope="module")
def patches():
    y, x = np.meshgrid(*2 * [np.linspace(0.4, 2.6, 4)], indexing="ij")
    names = [str(n) for n in range(y.size)]
    return pd.DataFrame({"patch": names, "x_mm": x.ravel(), "y_mm": y.ravel()}).assign(
        rotation_deg=0.0
    )


@pytest.fixture(scope="module")
def pressure(face, patches):
    """Of each patch, under the use that nobody stated."""
    height = coarser(face.height, 2)
    over = rounded_counterface(height, RADIUS, (SIZE / 2, SIZE / 2))
    case = Case(Interface(height, over), Load.of_force(FORCE, height, POINT), MODULUS)
    (contact,) = press_each([case], tolerance=1e-8, source="test")
    found = patch_means(height, patches, size_mm=PATCH) @ contact.pressure.values.ravel()
    assert (found > 0).sum() > 4
    assert (found == 0).any()
    return found


@pytest.fixture(scope="module")
def losses(pressure):
    scatter = np.random.default_rng(5).standard_normal(len(pressure))
    return Losses(0.01 * pressure * np.exp(0.2 * scatter) + 2e-3 * abs(scatter))


def infer(face, patches, evidence, stated=STATED, sampling=SAMPLING):
    settings = {"modulus": MODULUS, "patch_mm": PATCH, "sampling": sampling}
    return infer_use(face, patches, evidence, stated, **settings)


@pytest.fixture(scope="module")
def use(face, patches, losses):
    return infer(face, patches, losses)


def spread(use, name):
    values = use[name].values
    mean = float(use.weight.values @ values)
    return mean, float(np.sqrt(use.weight.values @ (values - mean) ** 2))


def test_losses_tell_where_the_tool_was_pressed(use):
    for name, true, stated in zip(("y_mm", "x_mm"), POINT, STATED.through, strict=True):
        mean, error = spread(use, name)
        assert abs(mean - true) < min(3 * error, abs(stated - true) / 2)
        assert error < STATED.load_point_mm / 2


def test_losses_tell_how_round_the_active_tool_was(use):
    mean, error = spread(use.assign(log=np.log(use.radius_mm)), "log")
    assert abs(mean - np.log(RADIUS)) < 3 * error
    assert error < STATED.radius_fraction / 2


def test_table_has_what_was_stated_beside_what_the_wear_says(use, pressure):
    table = use_table(use, STATED).set_index("parameter")
    assert table.stated["load_point_x"] == STATED.through[1]
    assert table.stated["radius"] == STATED.radius_mm
    prior = STATED.prior
    assert prior.mean == pytest.approx([*STATED.through, np.log(STATED.radius_mm)])
    errors = [STATED.load_point_mm] * 2 + [STATED.radius_fraction]
    assert prior.cov.diagonal() ** 0.5 == pytest.approx(errors)
    weight = use.weight.values
    for row, values in {"load_point_y": use.y_mm.values, "load_point_x": use.x_mm.values}.items():
        assert table["mean"][row] == pytest.approx(weight @ values)
        for limit, share in ((table.low[row], 0.025), (table.high[row], 0.975)):
            assert weight @ (values < limit) < share <= weight @ (values <= limit)
    radius = np.exp(weight @ np.log(use.radius_mm.values))
    assert table["mean"]["radius"] == pytest.approx(radius)
    assert table["mean"]["p_value"] < 0.05
    # patches are independent, so that the variance of their sum is that of all
    gains = (use.log_score - use.heights_log_score).values
    error = 1.96 * np.sqrt(len(gains) * gains.var(ddof=1))
    limits = table.loc["gain", ["low", "mean", "high"]].to_numpy(float)
    np.testing.assert_allclose(limits, gains.sum() + error * np.array([-1, 0, 1]))
    assert "within_95" not in table.index
    assert table.low["wear_coefficient"] < 0.01 < table.high["wear_coefficient"]


def test_patch_is_predicted_by_the_losses_of_the_others(face, patches, losses, use):
    found = predicted_losses(use, losses, seed=1)
    assert np.corrcoef(found.predicted_um, losses.depth_um)[0, 1] > 0.8
    within = use_table(use, STATED, found).set_index("parameter")["mean"]["within_95"]
    inside = (found.low_um < losses.depth_um) & (losses.depth_um < found.high_um)
    assert within == inside.mean() > 0.8
    # one loss that is wrong changes its own prediction hardly, and the answer little
    most = int(losses.depth_um.argmax())
    wrong = Losses(np.where(np.arange(len(patches)) == most, 0, losses.depth_um))
    again = infer(face, patches, wrong)
    own = predicted_losses(again, wrong, seed=1).predicted_um[most]
    assert own == pytest.approx(found.predicted_um[most], rel=0.25)
    assert own > losses.depth_um.max() / 3


def test_its_own_loss_weighs_no_use_that_predicts_it():
    """By hand: of two uses, its own loss would speak for the first, and the others' do not."""
    by_patch = {
        "pressure": [[1.0], [3.0]],
        "weight_without": [[0.0], [1.0]],
        "wear_coefficient_without": [[0.1], [0.2]],
        "scatter_without": [[0.01], [0.01]],
        "floor_without": [[0.0], [0.008]],
    }
    known = {name: (("draw", "patch"), values) for name, values in by_patch.items()}
    use = xr.Dataset({"weight": ("draw", [1.0, 0.0])} | known, {"patch": ["a"]})
    (row,) = predicted_losses(use, Losses(np.array([0.1])), seed=1).itertuples()
    assert row.predicted_um == pytest.approx(0.6)
    # 97.5 % of Student's t of four degrees of freedom, times the scatter of 6 nm and the floor
    limits = 0.6 + np.array([-1, 1]) * 2.776 * np.hypot(0.006, 0.008)
    assert [row.low_um, row.high_um] == pytest.approx(limits, abs=0.003)


def test_grades_tell_where_the_tool_was_pressed(face, patches, pressure):
    grade = np.searchsorted([0.1, 4, 12], pressure)
    assert len(set(grade)) > 2
    use = infer(face, patches, Grades(grade))
    for name, true in zip(("y_mm", "x_mm"), POINT, strict=True):
        mean, error = spread(use, name)
        assert abs(mean - true) < 3 * error < 3 * STATED.load_point_mm
    assert "wear_coefficient" not in set(use_table(use, STATED).parameter)


def test_chance_is_asked_of_uses_that_do_not_know_the_wear(face, patches, losses, monkeypatch):
    """Later rounds draw where the wear has pointed."""
    asked = []
    monkeypatch.setattr(
        "gstlib.use.infer._chance", lambda evidence, pressure, *_: asked.append(pressure) or 1.0
    )
    use = infer(face, patches, losses)
    np.testing.assert_array_equal(asked[0], use.pressure[: SAMPLING.draws])


@pytest.mark.parametrize(("count", "shuffled"), [(90, False), (90, True), (210, False)])
def test_chance_is_the_share_of_orders_that_a_use_explains_as_well(count, shuffled):
    """A tenth of the patches wore, those under the highest pressure.

    Uses that touch nothing explain that far better, but every other order alike.
    """
    rng = np.random.default_rng(2)
    places = pd.DataFrame(rng.uniform(0, 5, (count, 2)), columns=["y_mm", "x_mm"])
    pressure = rng.uniform(9, 11, count)
    worn = pressure > np.quantile(pressure, 0.9)
    losses = Losses((rng.permutation(worn) if shuffled else worn).astype(float))
    p_value = _chance(losses, np.stack([pressure, 0 * pressure]), places, rng)
    assert 0.05 < p_value < 0.95 if shuffled else p_value == 1 / 200


@pytest.mark.parametrize(("mirror", "shift_mm"), [(1, 0), (-1, 0), (1, -0.95)])
def test_chance_lays_the_wear_elsewhere_mirrored_and_shifted(mirror, shift_mm):
    """Two halves that are each other's image, mirrored or shifted, change their places."""
    half = np.random.default_rng(1).uniform(0, (1, 3 if mirror < 0 else 1), (8, 2))
    half[:2, 0] = 0.02, 1.0
    image = half * (-1, 1) if mirror < 0 else np.add(half, (1, 0))
    both = np.append(half, image, axis=0)
    shift = np.array([shift_mm, 0]) / np.ptp(both[:, 0])
    drawn = SimpleNamespace(  # no turn
        uniform=lambda low, high, size=0: shift if size else 0.0,
        choice=lambda signs: signs[0 if mirror < 0 else 1],
    )
    order = next(_orders(pd.DataFrame(both, columns=["y_mm", "x_mm"]), drawn))
    change = mirror < 0 or shift_mm
    np.testing.assert_array_equal(order, np.roll(np.arange(16), 8 if change else 0))


@pytest.mark.parametrize(
    ("p_value", "gain", "told"),
    [(0.06, 9, (CHANCE, 0)), (0.05, 1.7, (BETTER, 1)), (0.05, 1.6, (CONSISTENT, 1))],
)
def test_a_use_is_better_than_heights_if_its_gain_is_clear(p_value, gain, told):
    assert tuple(_answer(p_value, gain, gain_error=1.0).values()) == told


def test_load_point_alone_where_the_face_of_the_active_tool_is_known(face, patches, losses):
    height = face.height
    known = face.assign(counterface=rounded_counterface(height, RADIUS, 2 * (SIZE / 2,)))
    stated = STATED._replace(radius_mm=None)
    use = infer(known, patches, losses, stated)
    assert np.isnan(use.radius_mm).all()
    assert "radius" not in set(use_table(use, stated).parameter)
    assert abs(spread(use, "x_mm")[0] - POINT[1]) < 3 * spread(use, "x_mm")[1]


def test_losses_by_chance_are_not_taken_for_a_use(face, patches, losses):
    # the wear of a use, but each patch has that of another
    shuffled = losses.permuted(np.random.default_rng(1).permutation(len(patches)))
    assert infer(face, patches, shuffled).attrs["answer"] == CHANCE


def test_heights_alone_explain_wear_of_the_heights(face, patches):
    height = coarser(face.height, 2)
    above = np.maximum(height.values - np.quantile(height, 0.8), 0).ravel()
    lost = Losses(100 * (patch_means(height, patches, size_mm=PATCH) @ above))
    use = infer(face, patches, lost)
    assert use.attrs["gain"] < 0
    assert not use.attrs["taken"]


# Beyond the face the stone tips over.
FAR = STATED._replace(through=(9.0, 9.0), load_point_mm=0.1)


@pytest.mark.parametrize(
    ("stated", "sampling", "remedy"),
    [(STATED, Sampling(10, 1, 1), "use.draws"), (FAR, SAMPLING, "load.at_mm")],
)
def test_too_few_draws_are_no_answer(face, patches, losses, stated, sampling, remedy, caplog):
    use = infer(face, patches, losses, stated, sampling)
    assert_nothing_is_inferred(use, face, losses, stated)
    assert remedy in caplog.text


def assert_nothing_is_inferred(use, face, losses, stated):
    """The study goes on as stated, and its table has the reason."""
    table = use_table(use, stated)
    assert table.answer.str.startswith(f"{UNKNOWN}, because ").all()
    assert table["mean"].isna().all()
    assert predicted_losses(use, losses, seed=1).empty
    assert as_used(face, use, stated.through)[1] == stated.through


@pytest.mark.parametrize("touching", [1, 2])
def test_a_few_draws_that_touch_a_patch_lead_to_others(touching):
    """Their covariance is singular: the stone tips over under all other uses."""
    prior = scipy.stats.multivariate_normal(np.zeros(2), np.eye(2))
    generator = np.random.default_rng(1)
    far = np.sort(prior.rvs(40, np.random.default_rng(1))[:, 0])[-touching] - 1e-6

    def pressures(points):
        is_far = points[:, :1] > far
        return np.where(is_far, np.exp(points[:, 1:] * [1.0, -1.0]), 0.0)

    evidence = Losses(np.array([0.2, 0.3]))
    draws = sample(prior, pressures, evidence, Sampling(40, 12, 1, 50), generator)
    assert (draws.pressure[:40] > 0).any(axis=1).sum() == touching
    weight = draws.seen.weights(draws.log_prior)
    assert effective_draws(weight) > 50
    assert (draws.points[weight > 0, 0] > far).all()


@pytest.mark.parametrize(
    "evidence", [Losses(np.array([0.2, 0.0, 0.5])), Grades(np.array([1, 0, 2]))]
)
def test_leave_one_out_is_that_of_all_nodes_and_draws(evidence):
    rng = np.random.default_rng(1)
    pressure, log_prior = rng.exponential(10, (5, 3)), np.log(rng.dirichlet(np.ones(5)))
    likelihood = np.exp(evidence.log_likelihood(pressure))
    joint = np.exp(log_prior)[:, None] * likelihood.prod(axis=2)
    seen = weigh(evidence, pressure)
    np.testing.assert_allclose(seen.weights(log_prior), joint.sum(axis=1) / joint.sum(), rtol=1e-10)
    for patch in range(3):
        without = joint / likelihood[..., patch]
        np.testing.assert_allclose(
            seen.weights_without(log_prior)[:, patch],
            without.sum(axis=1) / without.sum(),
            rtol=1e-10,
        )
        score = np.log(joint.sum() / without.sum())
        np.testing.assert_allclose(seen.log_score(log_prior)[patch], score, rtol=1e-10)


def test_likelihood_of_a_loss_is_a_density():
    pressure = np.array([[10.0, 3.0]])
    depths = np.linspace(-60, 60, 200_001)
    nodes = Losses(np.array([0.3, 0.1])).nodes(pressure)
    at = 20
    expected = nodes["wear_coefficient"][0, at] * 3.0
    width = np.hypot(nodes["scatter"][0, at] * expected, nodes["floor"][0, at])
    density = scipy.stats.t.pdf((depths - expected) / width, 4) / width
    assert np.trapezoid(density, depths) == pytest.approx(1, abs=1e-3)
    given = np.exp(Losses(np.array([0.3, 0.1])).log_likelihood(pressure)[0, at, 1])
    assert given == pytest.approx(np.interp(0.1, depths, density), rel=1e-3)


def test_grades_are_read_without_the_wear_of_the_whole_tool_too(face, patches, use, monkeypatch):
    pressed = []
    monkeypatch.setattr(
        "gstlib.use.outcome.infer_use", lambda of, *_, **__: pressed.append(of) or use
    )
    bent = face.assign(height=face.height - face.height.x**2 / 50)
    options = {"stated": STATED._asdict(), "sampling": SAMPLING._asdict()}
    graded = patches.assign(wear_grade=1)
    use_of_study(bent, graded, None, **options, modulus=MODULUS, patch_mm=PATCH)
    curvatures = [float(of.height.polyfit("x", 2).polyfit_coefficients[0].mean()) for of in pressed]
    assert curvatures == pytest.approx([-1 / 50, 0], abs=1e-3)


def test_more_worn_patches_bore_more_pressure():
    pressure = np.array([[1.0, 5.0, 9.0, 20.0], [20.0, 9.0, 5.0, 1.0]])
    rising = weigh(Grades(np.array([0, 1, 1, 2])), pressure).log_evidence
    assert rising[0] > rising[1] + 2
    # a grade at random is never impossible
    falling = weigh(Grades(np.array([0, 1, 1, 0])), pressure).log_evidence
    assert (falling > 4 * np.log(0.1 / 2)).all()


def test_likelihood_of_a_grade_is_that_of_its_interval():
    """Of two grades, the limit lies between the second and the third pressure."""
    pressure = np.array([1.0, 9.0, 2.0, 8.0])
    seen = np.log(pressure / 5.0 + 0.03)
    away = (seen - seen[2:].mean()) * [-1, 1, -1, 1]
    expected = np.log(0.9 * scipy.stats.norm.cdf(away / np.array([[0.25], [0.5], [1.0]])) + 0.05)
    likelihood = Grades(np.array([0, 1, 0, 1])).log_likelihood(pressure[np.newaxis])
    np.testing.assert_allclose(likelihood[0], expected)


def test_use_that_tips_the_stone_over_counts_nothing():
    seen = weigh(Losses(np.array([0.1, 0.2])), np.array([[0.0, 0.0], [1.0, 2.0]]))
    np.testing.assert_array_equal(seen.weights(np.zeros(2)), [0, 1])


def test_the_study_is_pressed_as_the_wear_says_where_that_is_taken(face, use):
    taken, told = use.assign_attrs(taken=1), use.assign_attrs(taken=0)
    pressed, through = as_used(face, taken, STATED.through)
    weight = use.weight.values
    assert through == pytest.approx((weight @ use.y_mm.values, weight @ use.x_mm.values))
    radius = np.exp(weight @ np.log(use.radius_mm.values))
    expected = rounded_counterface(face.height, radius, (SIZE / 2, SIZE / 2))
    np.testing.assert_allclose(pressed.counterface, expected)
    for stated in (told, None):
        same, point = as_used(face, stated, STATED.through)
        assert same is face
        assert point == STATED.through


def test_the_pressure_of_a_patch_is_that_which_the_others_tell(patches, use):
    table = patches.assign(pressure_MPa=1.0)
    found = leave_one_out(table, use.assign_attrs(taken=1)).set_index("patch").leave_one_out_MPa
    for patch in ("0", "9"):
        one = use.sel(patch=patch)
        expected = float(one.weight_without.values @ one.pressure.values)
        assert found[patch] == pytest.approx(expected, abs=1e-6)
    unknown = leave_one_out(table.assign(patch="new"), use.assign_attrs(taken=1))
    assert unknown.leave_one_out_MPa.isna().all()
    assert "leave_one_out_MPa" not in leave_one_out(table, use.assign_attrs(taken=0))


def test_patches_that_lost_nothing_count_and_excluded_ones_do_not(patches):
    lost = pd.DataFrame({"patch": ["3", "1", "2"], "mean_wear_depth_um": [0.3, 0.0, 0.2]})
    lost = lost.assign(excluded=[False, False, True], above_noise=[True, False, True])
    known, losses = losses_of(patches, lost)
    assert list(known.patch) == ["1", "3"]
    np.testing.assert_array_equal(losses.depth_um, [0.0, 0.3])
    np.testing.assert_array_equal(losses.above_noise, [False, True])


def test_four_worn_patches_of_six_tell_something(face, patches):
    losses = Losses(np.array([0.0, 0.3, 0.1, 0.0, 0.2, 0.2]))
    assert not infer(face, patches[:6], losses).attrs["answer"].startswith(UNKNOWN)


@pytest.mark.parametrize(
    "losses",
    [
        Losses(np.zeros(16), np.full(16, True)),
        Losses(np.ones(5)),
        Losses(np.ones(16), np.arange(16) < 3),
    ],
)
def test_nothing_is_inferred_from_too_little(face, patches, losses):
    use = infer(face, patches[: len(losses.depth_um)], losses)
    assert_nothing_is_inferred(use, face, losses, STATED)
