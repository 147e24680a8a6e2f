"""How a tool was used, from losses and grades that a known use made."""

from functools import partial

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
from gstlib.use.competitors import COMPETITORS, competitor_scores
from gstlib.use.evidence import Grades, Losses
from gstlib.use.infer import (
    FEWEST_DRAWS,
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
    strikes_of,
    use_of_study,
    use_table,
)
from gstlib.use.sampling import Prior, Sampling, sample
from gstlib.use.spread import StrikePressures, Uses
from gstlib.use.tempering import Particles, effective_sample_size, tempered

# A square of 3 mm in a face of 4.2 mm, with sixteen patches of 0.5 mm.
SIZE, ELEMENT, COUNT, PATCH = 3.0, 0.06, 70, 0.5
MODULUS, FORCE, RADIUS, POINT = 1e4, 150.0, 60.0, (1.7, 1.2)
STATED = StatedUse(FORCE, (1.4, 1.6), 0.4, 100.0, 0.6, scatter_mm=0.3, stroke_mm=0.8)
SAMPLING = Sampling(draws=30, rounds=6, particles=300, seed=1)
QUICK = Sampling(draws=30, rounds=4, particles=200, seed=1)


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
    for name, true, stated in zip(("y_mm", "x_mm"), POINT, STATED.load_point, strict=True):
        mean, error = spread(use, name)
        assert abs(mean - true) < min(3 * error, abs(stated - true) / 2)
        assert error < STATED.load_point_mm / 2


def test_losses_tell_how_round_the_active_tool_was(use):
    mean, error = spread(use.assign(log=np.log(use.radius_mm)), "log")
    assert abs(mean - np.log(RADIUS)) < 3 * error
    assert error < STATED.radius_log_sd / 2


def test_table_has_what_was_stated_beside_what_the_wear_says(use, pressure):
    table = use_table(use, STATED).set_index("parameter")
    assert table.prior["load_point_x"] == STATED.load_point[1]
    assert table.prior["radius"] == STATED.radius_mm
    weight = use.weight.values
    for row, values in {"load_point_y": use.y_mm.values, "load_point_x": use.x_mm.values}.items():
        assert table["posterior_mean"][row] == pytest.approx(weight @ values)
        for limit, share in ((table.low[row], 0.025), (table.high[row], 0.975)):
            assert weight @ (values < limit) < share <= weight @ (values <= limit)
    radius = np.exp(weight @ np.log(use.radius_mm.values))
    assert table["posterior_mean"]["radius"] == pytest.approx(radius)
    assert "within_95" not in table.index
    assert table.low["wear_coefficient"] < 0.01 < table.high["wear_coefficient"]


def test_patch_is_predicted_by_the_losses_of_the_others(face, patches, losses, use):
    found = predicted_losses(use, losses, seed=1)
    assert np.corrcoef(found.predicted_um, losses.depth_um)[0, 1] > 0.8
    within = use_table(use, STATED, found).set_index("parameter")["posterior_mean"]["within_95"]
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
    by_draw = {
        "weight": [1.0, 0.0],
        "wear_coefficient": [0.1, 0.2],
        "scatter": [0.01, 0.01],
        "floor": [0.0, 0.008],
    }
    by_both = {"pressure": [[1.0], [3.0]], "weight_without": [[0.0], [1.0]]}
    use = xr.Dataset(
        {name: ("draw", values) for name, values in by_draw.items()}
        | {name: (("draw", "patch"), values) for name, values in by_both.items()}
        | {"effective_sample_size_without": ("patch", [1.0])},
        {"patch": ["a"]},
    )
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
    found = _answer(use)
    assert (found["answer"], found["adopted"]) == (answer, is_taken)
    assert found["log_score_gain"] == pytest.approx(min(gains))
    assert found["gain_error"] == pytest.approx(1.0)


def wear_without_contact(name, face, patches):
    """Losses as a competitor has them."""
    height = coarser(face.height, 2)
    y, x = np.meshgrid(height.y, height.x, indexing="ij")
    if name == "spot":
        return 0.3 * np.exp(-np.square(patches[["y_mm", "x_mm"]] - [1.0, 2.0]).sum(axis=1) / 0.5)
    tilted = height.values + (2e-3 * (y + x) if name == "tilted" else 0)
    above = np.maximum(tilted - np.quantile(tilted, 0.6), 0).ravel()
    return 100 * (patch_means(height, patches, size_mm=PATCH) @ above)


@pytest.mark.parametrize("name", ["heights", "tilted", "spot"])
def test_wear_that_nothing_pressed_is_predicted_by_a_competitor(face, patches, name):
    losses = Losses(np.asarray(wear_without_contact(name, face, patches)))
    scores = competitor_scores(face.height, patches, losses, patch_mm=PATCH, seed=1)
    totals = {other: score.sum() for other, score in scores.items()}
    assert set(totals) == set(COMPETITORS)
    assert max(totals, key=totals.get) == name
    use = infer(face, patches, losses, sampling=QUICK)
    assert use.attrs["answer"] != PRESSED


def test_pressures_after_wear_are_those_of_a_step_of_the_law(face, patches):
    """κ is known from the losses alone, and worn summits bear less."""
    settings = {"modulus": MODULUS, "patch_mm": PATCH}
    pressed = partial(use_pressures, STATED.prior.mean[None], face, patches, STATED, **settings)
    (before,), true = pressed(), 2e-5
    (after,) = pressed(springs=true)
    assert after.max() < before.max()
    known = Losses(1e3 * true * after).springs(before)
    assert known == pytest.approx(true, rel=0.05)


def test_where_contacts_are_not_known_a_use_is_not_claimed(face, patches, losses, monkeypatch):
    monkeypatch.setattr("gstlib.use.infer._MOST_CONTACT_ERROR", 1e-3)
    assert "of their mean pressure" in infer(face, patches, losses, sampling=QUICK).answer
    heights = patch_means(face.height, patches, size_mm=PATCH) @ face.height.values.ravel()
    higher = Losses(30 * (heights - heights.min()))
    assert infer(face, patches, higher, sampling=QUICK).answer == NOT_PRESSED


def test_losses_by_chance_are_not_taken_for_a_use(face, patches, losses):
    # the wear of a use, but each patch has that of another
    shuffled = losses.permuted(np.random.default_rng(1).permutation(len(patches)))
    assert infer(face, patches, shuffled, sampling=QUICK).attrs["answer"] != PRESSED


def test_strikes_that_scatter_are_not_taken_for_a_rounder_tool(face, patches, use):
    """The wear is that of the mean over many strikes; one in a place is the control."""
    scatter = 0.4
    offsets = scatter * np.random.default_rng(2).standard_normal((100, 2))
    points = np.column_stack([POINT + offsets, np.full(100, np.log(RADIUS))])
    settings = {"modulus": MODULUS, "patch_mm": PATCH}
    pressure = use_pressures(points, face, patches, STATED, **settings).mean(axis=0)
    scattered = infer(face, patches, Losses(0.01 * pressure))
    mean, error = spread(scattered.assign(log=np.log(scattered.radius_mm)), "log")
    assert abs(mean - np.log(RADIUS)) < 3 * error
    found, uncertain = spread(scattered, "spread_mm")
    assert abs(found - scatter) < 3 * uncertain
    assert found > 2 * spread(use, "spread_mm")[0]


# Beyond the face the stone tips over.
FAR = STATED._replace(load_point=(9.0, 9.0), load_point_mm=0.1)


@pytest.mark.parametrize(
    ("stated", "sampling", "remedy"),
    [(STATED, Sampling(50, 1, 200, 1), "use.rounds"), (FAR, SAMPLING, "load.at_mm")],
)
def test_too_few_draws_are_no_answer(face, patches, losses, stated, sampling, remedy, caplog):
    use = infer(face, patches, losses, stated, sampling)
    assert_nothing_is_inferred(use, face, losses, stated)
    assert remedy in caplog.text


def assert_nothing_is_inferred(use, face, losses, stated):
    """The study goes on as stated, and its table has the reason."""
    table = use_table(use, stated)
    assert table.answer.str.startswith(f"{UNKNOWN}, because ").all()
    assert table["posterior_mean"].isna().all()
    assert predicted_losses(use, losses, seed=1).empty
    assert as_used(face, use, stated.load_point)[1] == stated.load_point


def test_a_few_strikes_that_touch_a_patch_lead_to_others():
    """The stone tips over under most strikes of the first round."""
    prior = Prior(np.zeros(2), np.ones(2), 0.0, 0.0)

    def pressures(points):
        return np.maximum(points[:, :1] - 1.0, 0) * np.exp(points[:, 1:] * [1.0, -1.0])

    evidence = Losses(np.array([0.2, 0.3]))
    generator = np.random.default_rng(1)
    draws = sample(prior, pressures, evidence, Sampling(40, 10, 500, 1), generator)
    assert draws.touching > 0.25 * draws.contacts
    weight = draws.particles.weights
    assert effective_sample_size(weight) > 50
    assert weight @ (draws.uses.points[:, 0] > 0.5) > 0.8


def test_particles_have_the_weights_and_scores_of_the_sum_over_all():
    """One unknown, seen with one error at three places, one of which is far off."""
    seen, errors = np.array([0.3, 0.5, 2.5]), np.array([0.4, 0.5, 0.6])

    def log_likelihood(standard):
        return scipy.stats.norm.logpdf(seen, standard[:, :1], errors)

    found = tempered(log_likelihood, 1, 20_000, np.random.default_rng(1))
    at = np.linspace(-6, 6, 4001)
    each = np.exp(log_likelihood(at[:, None]))
    prior = scipy.stats.norm.pdf(at)
    whole = prior * each.prod(axis=1)
    x = found.standard[:, 0]
    assert found.weights @ x == pytest.approx((whole @ at) / whole.sum(), abs=0.02)
    for place in range(3):
        without = prior * np.delete(each, place, axis=1).prod(axis=1)
        mean = found.weights_without[:, place] @ x
        assert mean == pytest.approx((without @ at) / without.sum(), abs=0.03)
        score = np.log(whole.sum() / without.sum())
        assert found.log_score[place] == pytest.approx(score, abs=0.05)


def test_weights_of_particles_are_bounded():
    """However wrong one place is, no draw has the weight of all."""
    likelihood = np.array([[-1.0, -1.0], [-1.0, -700.0], [-1.0, -1.0]])
    found = Particles(np.zeros((3, 1)), likelihood, np.zeros(2))
    assert found.weights_without.max() <= 1
    assert np.isfinite(found.log_score).all()


def test_pressures_between_strikes_are_means_over_a_scatter_and_a_stroke():
    """Against many strikes, where the pressure is a bump at a known place."""
    rng = np.random.default_rng(1)

    def pressures(strikes):
        return 5 * np.exp(-0.5 * np.square(strikes[:, :2] - [0.3, -0.2]).sum(axis=1))[:, None]

    solved = rng.uniform(-4, 4, (400, 2))
    process = StrikePressures.through(solved, pressures(solved))
    use = Uses(np.array([[0.0, 0.5]]), np.array([0.4]), np.array([[1.5, 1.0]]))
    many = Uses(*(np.repeat(values, 200_000, axis=0) for values in use))
    strikes = many.strikes(rng)
    assert process.of(use).item() == pytest.approx(pressures(strikes).mean(), rel=0.01)
    covariance = 0.16 * np.eye(2) + np.outer([1.5, 1.0], [1.5, 1.0]) / 12
    np.testing.assert_allclose(np.cov(strikes.T), covariance, atol=0.005)
    assert use.spread_mm == pytest.approx((np.trace(covariance) / 2) ** 0.5)
    far = Uses(np.array([[40.0, 0.0]]), np.zeros(1), np.zeros((1, 2)))
    assert process.of(far).item() == pytest.approx(0, abs=1e-6)


def test_strikes_of_a_use_lie_along_its_stroke(use):
    one = use.isel(draw=[0] * 50_000).assign(
        scatter_mm=("draw", np.zeros(50_000)), stroke_mm=("draw", np.full(50_000, 2.0))
    )
    strikes = strikes_of(one, np.random.default_rng(1))
    centre = strikes.mean(axis=0)
    assert centre == pytest.approx([float(one.x_mm[0]), float(one.y_mm[0])], abs=0.02)
    (_, size, direction) = np.linalg.svd(strikes - centre, full_matrices=False)
    assert size[0] / len(strikes) ** 0.5 == pytest.approx(2 / 12**0.5, rel=0.02)
    angle = np.degrees(np.arctan2(direction[0, 1], direction[0, 0])) % 180
    assert angle == pytest.approx(float(one.stroke_angle_deg[0]), abs=0.5)


def test_likelihood_of_a_loss_is_a_density():
    pressure, standard = np.array([[10.0, 3.0]]), np.array([[0.3, -0.5, 0.2]])
    losses = Losses(np.array([0.3, 0.1]))
    depths = np.linspace(-60, 60, 200_001)
    of = losses.parameters(pressure, standard)
    expected = of["wear_coefficient"] * 3.0
    width = np.hypot(of["scatter"] * expected, of["floor"])
    density = scipy.stats.t.pdf((depths - expected) / width, 4) / width
    assert np.trapezoid(density, depths) == pytest.approx(1, abs=1e-3)
    given = np.exp(losses.log_likelihood(pressure, standard)[0, 1])
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


def test_likelihood_of_a_grade_is_that_of_its_interval():
    """Of two grades, the limit lies between the second and the third pressure."""
    pressure, standard = np.array([1.0, 9.0, 2.0, 8.0]), np.array([[-1.0], [0.0], [1.0]])
    seen = np.log(pressure / 5.0 + 0.03)
    away = (seen - seen[2:].mean()) * [-1, 1, -1, 1]
    error = 0.5 * np.exp(0.5 * standard)
    expected = np.log(0.9 * scipy.stats.norm.cdf(away / error) + 0.05)
    grades = Grades(np.array([0, 1, 0, 1]))
    likelihood = grades.log_likelihood(np.repeat(pressure[np.newaxis], 3, axis=0), standard)
    np.testing.assert_allclose(likelihood, expected)


def test_the_study_is_pressed_as_the_wear_says_where_that_is_taken(face, use):
    adopted, told = use.assign_attrs(adopted=1), use.assign_attrs(adopted=0)
    pressed, load_point = as_used(face, adopted, STATED.load_point)
    weight = use.weight.values
    assert load_point == pytest.approx((weight @ use.y_mm.values, weight @ use.x_mm.values))
    radius = np.exp(weight @ np.log(use.radius_mm.values))
    expected = rounded_counterface(face.height, radius, (SIZE / 2, SIZE / 2))
    np.testing.assert_allclose(pressed.counterface, expected)
    for stated in (told, None):
        same, point = as_used(face, stated, STATED.load_point)
        assert same is face
        assert point == STATED.load_point


def test_pressures_of_a_patch_are_over_the_strikes_of_what_the_others_tell(patches, use):
    table = patches.assign(pressure_MPa=5.0, force_N=5.0 * PATCH**2)
    adopted = use.assign_attrs(adopted=1).assign_coords(scanned=list(patches.patch))
    adopted["stated_pressure"] = "scanned", np.arange(len(patches), dtype=float)
    found = pressures_of_use(table, adopted, patch_mm=PATCH).set_index("patch")
    for patch in ("0", "9"):
        one = use.sel(patch=patch)
        expected = float(one.weight_without.values @ one.pressure.values)
        assert found.leave_one_out_MPa[patch] == pytest.approx(expected, abs=1e-6)
        added = float(one.weight.values @ (one.pressure - one.pressure_at_centre).values)
        assert found.pressure_MPa[patch] == pytest.approx(max(5 + added, 0), abs=1e-6)
        assert found.stated_MPa[patch] == float(patch)
    np.testing.assert_allclose(found.force_N, found.pressure_MPa * PATCH**2)
    unknown = pressures_of_use(table.assign(patch="new"), adopted, patch_mm=PATCH)
    assert unknown.leave_one_out_MPa.isna().all()
    assert (unknown.pressure_MPa == 5).all()
    assert pressures_of_use(table, use.assign_attrs(adopted=0), patch_mm=PATCH) is table


def test_patches_that_lost_nothing_count_and_excluded_ones_do_not(patches):
    lost = pd.DataFrame({"patch": ["3", "1", "2"], "mean_wear_depth_um": [0.3, 0.0, 0.2]})
    lost = lost.assign(excluded=[False, False, True], above_noise=[True, False, True])
    t1 = {"t1_x_um": [3.0, 1.0, 2.0], "t1_y_um": 0.0, "t1_size_x_um": 850.0, "t1_size_y_um": 850.0}
    known, losses = losses_of(patches, lost.assign(**t1, found=True, rotation_deg=0.0))
    assert list(known.patch) == ["1", "3"]
    assert list(known.t1_x_um) == [1.0, 3.0]  # a loss is of the area that T1 covers
    np.testing.assert_array_equal(losses.depth_um, [0.0, 0.3])
    np.testing.assert_array_equal(losses.above_noise, [False, True])


def test_four_worn_patches_of_six_tell_something(face, patches, pressure):
    six = [*np.flatnonzero(pressure == 0)[:2], *np.argsort(pressure)[-4:]]
    use = infer(face, patches.iloc[six], Losses(0.01 * pressure[six]), sampling=QUICK)
    assert not use.attrs["answer"].startswith(UNKNOWN)


@pytest.mark.parametrize(("particles", "warns"), [(FEWEST_DRAWS - 1, True), (400, False)])
def test_predictions_that_rest_on_few_draws_are_warned_of(
    face, patches, monkeypatch, caplog, particles, warns
):
    places = patches[["y_mm", "x_mm"]].to_numpy()

    def pressures(points, *_, **__):
        apart = np.square(points[:, None, :2] - places).sum(axis=2)
        return 20 * np.exp(-0.5 * apart)

    monkeypatch.setattr("gstlib.use.infer.use_pressures", pressures)
    losses = Losses(0.01 * pressures(np.array([POINT]))[0])
    use = infer(face, patches, losses, sampling=Sampling(20, 3, particles, 1))
    assert (use.effective_sample_size_without < FEWEST_DRAWS).any() == warns
    assert ("use.particles" in caplog.text) == warns


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
