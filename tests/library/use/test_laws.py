"""Which law of wear predicts losses, of losses that a known law made."""

import numpy as np
import pytest

from gstlib.conditions import ARCHARD, Law
from gstlib.use import laws
from gstlib.use.evidence import Losses
from gstlib.use.laws import BASE, UNDECIDED, law_scores, law_table


@pytest.fixture(autouse=True)
def _one_small_sample(monkeypatch):
    """Each law has one mode where the load is known."""
    monkeypatch.setattr(laws, "_DRAWS", 300)
    monkeypatch.setattr(laws, "_SAMPLES", 1)


def pressures(generator, patches):
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
    ],
)
def test_the_law_behind_the_losses_is_found(law, answers, name):
    generator = np.random.default_rng(1)
    answered = []
    for _ in range(6):
        pressure = pressures(generator, 16)
        losses = lost(law, pressure, generator)
        table = law_table(None, pressure, losses, seed=1).set_index("law")
        answered.append(table.answer[BASE])
        if name:
            row = table.loc[name]
            assert row.low / 2 <= getattr(law, row.parameter) <= row.high * 2
    assert {*answered} <= {*answers, UNDECIDED}
    # closer to Archard's law, the others are hard to tell from it
    assert len(answered) - answered.count(UNDECIDED) >= (1 if law == ARCHARD else 3)


def test_a_law_is_found_under_loads_that_are_not_known():
    """Losses grow as the third power of the pressure of one of many possible loads.

    The radius is known well. Otherwise a smaller one explains such losses by Archard's law.
    """
    places = np.linspace(0, 4, 12)

    def hertz(standard):
        centre = 2.2 + 0.5 * standard[:, :1]
        radius = np.exp(0.4 + 0.05 * standard[:, 1:])
        off = (places - centre) / radius
        return 60 * np.sqrt(np.maximum(1 - off**2, 0)) / radius

    generator = np.random.default_rng(3)
    (pressure,) = hertz(np.array([[-0.4, 0.5]]))
    losses = lost(Law(exponent=3.0), pressure, generator, scatter=0.05)
    use = law_scores(hertz, 2, losses, generator).assign_attrs(adopted=1)
    _, low, high = use.law_parameter.sel(law="higher exponent").values
    assert low < 3.0 < high
    table = law_table(use, pressure, losses, seed=1).set_index("law")
    assert table.log_score_gain["higher exponent"] > 2
