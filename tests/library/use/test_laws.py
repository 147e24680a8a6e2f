"""Which law of wear predicts losses, of losses that a known law made."""

import numpy as np
import pytest
import scipy
from gstlib.conditions import ARCHARD, Law
from gstlib.use import laws
from gstlib.use.evidence import Losses
from gstlib.use.laws import BASE, UNDECIDED, law_scores, law_table

PATCHES = 12


@pytest.fixture(autouse=True)
def _one_small_sample(monkeypatch):
    """Each law has one mode where the load is known."""
    monkeypatch.setattr(laws, "_DRAWS", 400)
    monkeypatch.setattr(laws, "_SAMPLES", 1)


def pressures(generator, patches=PATCHES):
    """Of a contact that touches some patches, MPa."""
    touched = generator.random(patches) < 0.8
    touched[:5] = True
    return 20 * generator.gamma(1.5, 1, patches) * touched


def lost(law, pressure, generator, scatter=0.15):
    depth = law.equivalent(pressure) / pressure.mean()
    depth = depth * generator.lognormal(0, scatter, len(pressure))
    return Losses(depth + 0.02 * abs(generator.standard_normal(len(pressure))))


@pytest.mark.parametrize(
    ("law", "answers", "name"),
    [
        (ARCHARD, {BASE}, None),
        (Law(exponent=2.0), {"higher exponent", "threshold"}, "higher exponent"),
        (Law(exponent=0.5), {"lower exponent", "touched"}, "lower exponent"),
        (Law(threshold_MPa=20.0), {"threshold", "higher exponent"}, "threshold"),
        (Law(exponent=0.0), {"touched", "lower exponent"}, None),
    ],
)
def test_the_law_behind_the_losses_is_found(law, answers, name):
    generator = np.random.default_rng(1)
    known = []
    for _ in range(12):
        pressure = pressures(generator, 16)
        losses = lost(law, pressure, generator)
        table = law_table(None, pressure, losses, seed=1)
        known.append(table.answer.iloc[0])
        if name:
            row = table.set_index("law").loc[name]
            value = getattr(law, row.parameter)
            assert row.low / 2 <= value <= row.high * 2
    assert {*known} <= {*answers, UNDECIDED}
    # closer to Archard's law, the others are hard to tell from it
    assert sum(answer != UNDECIDED for answer in known) >= (3 if law == ARCHARD else 7)


@pytest.mark.parametrize(("patches", "scatter"), [(6, 0.4), (20, 0.4)])
def test_losses_by_archard_are_rarely_called_another_law(patches, scatter):
    """The level of the claim is 5 %."""
    generator = np.random.default_rng(2)
    wrong, sets = 0, 25
    for _ in range(sets):
        pressure = pressures(generator, patches)
        losses = lost(ARCHARD, pressure, generator, scatter)
        wrong += law_table(None, pressure, losses, seed=1).answer.iloc[0] not in (BASE, UNDECIDED)
    assert wrong <= scipy.stats.binom.isf(0.01, sets, 0.05)


def test_a_law_is_found_under_loads_that_are_not_known():
    """Losses grow as the third power of the pressure of one of many possible loads.

    The radius is known well. Otherwise a smaller one explains such losses by Archard's law.
    """
    places = np.linspace(0, 4, PATCHES)

    def hertz(standard):
        centre, radius = 2.2 + 0.5 * standard[:, :1], np.exp(0.4 + 0.05 * standard[:, 1:])
        return 60 * np.sqrt(np.maximum(1 - ((places - centre) / radius) ** 2, 0)) / radius

    generator = np.random.default_rng(3)
    (true,) = hertz(np.array([[-0.4, 0.5]]))
    losses = lost(Law(exponent=3.0), true, generator, scatter=0.05)
    scores = law_scores(hertz, 2, losses, generator).assign_attrs(adopted=1)
    gains = (scores.law_log_score - scores.law_log_score.sel(law=BASE)).sum("patch")
    assert float(gains.sel(law="higher exponent")) > 2
    _, low, high = scores.law_parameter.sel(law="higher exponent").values
    assert low < 3.0 < high
    table = law_table(scores, true, losses, seed=1).set_index("law")
    assert table.log_score_gain["higher exponent"] == pytest.approx(
        float(gains.sel(law="higher exponent")), abs=1e-6
    )
    # the load in the config is scored alone if no use is adopted
    alone = law_table(scores.assign_attrs(adopted=0), true, losses, seed=1).set_index("law")
    assert alone.log_score["higher exponent"] > table.log_score["higher exponent"]


@pytest.mark.parametrize("why", ["few patches", "few worn", "nothing touched"])
def test_too_little_to_compare_is_an_empty_table(why):
    generator = np.random.default_rng(4)
    pressure = pressures(generator)
    depth = lost(ARCHARD, pressure, generator).depth_um
    if why == "few patches":
        pressure, depth = pressure[:5], depth[:5]
    elif why == "few worn":
        depth = depth * (np.arange(PATCHES) < 3)
    else:
        pressure = 0 * pressure
    assert law_table(None, pressure, Losses(depth), seed=1).empty
