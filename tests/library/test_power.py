"""Claims on made-up patches; their rates, exact where known, and honest about clustered trials."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binomtest

from gstlib.figures import power_figure
from gstlib.power import LEVELS, Trial, p_values, rejection_rates
from gstlib.specimen.randomness import smooth_field
from gstlib.surface import make_surface
from gstlib.validation.change import height_change

CHANCE = {
    "seed": [1, 5],
    "shifts": 199,
    "neighbourhood_um": 30.0,
    "curvature_length_um": 20.0,
    "most_noise": 0.2,
}


def drawn_p_values(by_specimen, *, wear="random", test="test"):
    """A row for each p-value; `by_specimen`: lists of them."""
    return pd.DataFrame(
        [
            {"test": test, "drawn": np.nan, "wear": wear, "seed": seed, "p_value": p}
            for seed, values in enumerate(by_specimen)
            for p in values
        ]
    )


def test_one_trial_a_specimen_is_counted_as_it_is():
    rng = np.random.default_rng(1)
    drawn = rng.random(40)
    rates = rejection_rates(drawn_p_values(drawn[:, None])).set_index("level")
    assert list(rates.index) == list(LEVELS)
    for level, row in rates.iterrows():
        claims = int((drawn <= level).sum())
        exact = binomtest(claims, 40).proportion_ci(method="exact")
        assert (row.claims, row.of, row.rate) == (claims, 40, claims / 40)
        assert (row.low, row.high) == pytest.approx((exact.low, exact.high), abs=1e-9)


def test_a_p_value_at_the_level_is_a_claim():
    rates = rejection_rates(drawn_p_values([[0.05], [0.051]]), levels=[0.05])
    assert rates.claims.item() == 1


def test_a_missing_p_value_is_no_trial():
    rates = rejection_rates(drawn_p_values([[0.01, np.nan], [np.nan]]), levels=[0.05])
    assert (rates.claims.item(), rates.of.item(), rates.specimens.item()) == (1, 1, 1)


def test_trials_that_repeat_each_other_count_once():
    """Ten patches of a specimen with one p-value tell no more than one patch would."""
    drawn = np.random.default_rng(2).random((30, 1))
    once = rejection_rates(drawn_p_values(drawn), levels=[0.3])
    tenfold = rejection_rates(drawn_p_values(np.repeat(drawn, 10, axis=1)), levels=[0.3])
    assert tenfold.rate.item() == once.rate.item()
    for bound in ("low", "high"):
        assert tenfold[bound].item() == pytest.approx(once[bound].item(), abs=0.01)


def test_independent_trials_count_each():
    drawn = np.random.default_rng(3).random((200, 10))
    row = rejection_rates(drawn_p_values(drawn), levels=[0.3]).iloc[0]
    exact = binomtest(row.claims, 2000).proportion_ci(method="exact")
    assert row.high - row.low == pytest.approx(exact.high - exact.low, rel=0.1)


@settings(max_examples=25, deadline=None)
@given(
    st.lists(
        st.lists(st.floats(0, 1), min_size=1, max_size=6),
        min_size=1,
        max_size=12,
    )
)
def test_rates_grow_with_the_level_and_lie_in_their_intervals(by_specimen):
    rates = rejection_rates(drawn_p_values(by_specimen))
    assert (rates.rate.diff().dropna() >= 0).all()
    assert (rates.low <= rates.rate + 1e-12).all()
    assert (rates.rate <= rates.high + 1e-12).all()
    assert rates[["low", "high"]].to_numpy().min() >= 0
    assert rates[["low", "high"]].to_numpy().max() <= 1


def made_up_trials(patches):
    """Pressure, contact and loss grow together; at random the loss lies and grows otherwise."""
    for number in range(patches):
        rng = np.random.default_rng(number)
        height = make_surface(smooth_field(rng, 48, 0.01, 0.05).astype(float) * 1e-3, 0.01)
        depth = height.values - np.quantile(height.values, 0.95 - 0.01 * number)
        contact = xr.Dataset(
            {
                "height": height,
                "pressure": (height.dims, np.clip(depth, 0, None) * 1e6),
                "gap": (height.dims, np.clip(-depth, 0, None)),
                "displacement": float(height.max() - height.values.max() + depth.max()),
            }
        )
        amount = {"summits": number, "random": (7 * number + 3) % patches}
        for wear, more in amount.items():
            lost = height.values > np.quantile(height.values, 0.9 - 0.01 * more)
            if wear == "random":
                lost = np.roll(lost, (19, 23), (0, 1))
            noise = rng.normal(0, 1e-5, height.shape)
            change = height_change(height, height - 1e-3 * lost + noise)
            place = (float(number % 3), float(number // 3))
            yield Trial(wear, str(number), *place, 10.0 + number, contact, change)


@pytest.fixture(scope="module")
def made_up():
    return p_values(made_up_trials(9), **CHANCE)


def test_a_relation_is_found_and_no_other(made_up):
    tests, patches = made_up
    assert len(patches) == 18
    found = tests[tests.drawn.isna()]
    for test in ("f1", "roc_auc", "mean(f1)", "spearman(pressure_MPa, loss_fraction)"):
        of = found[found.test == test].groupby("wear").p_value
        assert of.max()["summits"] <= 0.005, test
        assert of.min()["random"] > 0.005, test


def test_a_gain_is_claimed_only_where_contact_is_better():
    """Contact laid elsewhere is worse than the highest points on every patch: no gain at all."""
    wrong = []
    for trial in made_up_trials(9):
        fields = {name: trial.contact[name] for name in ("pressure", "gap")}
        moved = {name: field.roll(y=9, x=12, roll_coords=False) for name, field in fields.items()}
        wrong.append(trial._replace(contact=trial.contact.assign(moved)))
    for trials, claimed in ((wrong, False), (made_worse(), True)):
        tests, _ = p_values(trials, **CHANCE)
        gain = tests[(tests.test == "gain(f1)") & (tests.wear == "summits")].p_value.item()
        assert gain < 0.01 if claimed else gain > 0.99


def made_worse():
    """Every rival looks at heights that say nothing: contact alone knows where loss is."""
    for trial in made_up_trials(9):
        heights = trial.contact["height"].roll(y=9, x=12, roll_coords=False)
        yield trial._replace(contact=trial.contact.assign(height=heights))


def test_fewer_patches_are_drawn_where_there_are_as_many(made_up):
    tests, _ = made_up
    drawn = tests.dropna(subset="drawn")
    assert set(drawn.drawn) == {4, 6, 8}
    assert (drawn.patches == drawn.drawn).all()


def test_a_specimens_claims_are_the_same_again(made_up):
    again = p_values(made_up_trials(9), **CHANCE)
    for one, other in zip(made_up, again, strict=True):
        pd.testing.assert_frame_equal(one, other)


def test_a_specimen_without_patches_claims_nothing():
    tests, patches = p_values([], **CHANCE)
    assert tests.empty
    assert patches.empty
    assert "p_value" in tests


def test_the_figure_shows_the_rates(made_up):
    rates = rejection_rates(made_up[0].assign(seed=5))
    figure = power_figure(rates)
    panel = figure.axes[0]
    assert "F1" in panel.get_title()
    of_f1 = rates[(rates.test == "f1") & rates.drawn.isna()]
    drawn = [tuple(bars.lines[0].get_ydata()) for bars in panel.containers]
    assert drawn == [tuple(of_f1.rate[of_f1.wear == wear]) for wear in ("summits", "random")]
