"""What is believed of a loss, and what is said where much rose."""

import numpy as np
import pytest
from gstlib.surface import make_surface
from gstlib.validation.change import height_change
from gstlib.validation.selection import registration_table

RULES = {"minimum_overlap": 0.7, "minimum_correlation": 0.5, "minimum_pressure_MPa": 1.0}


def changed(rose, fell, *, found=True):
    """A change of 60 × 70 points, so many of which rose and fell; nothing is known of T1's rest."""
    rng = np.random.default_rng(3)
    t0 = make_surface(rng.normal(0, 1e-3, (60, 70)), 1e-3)
    change = height_change(t0, t0 + rng.normal(0, 1e-5, t0.shape))
    order = np.arange(4200).reshape(60, 70)
    spots = {"loss": order < fell, "gain": (order >= fell) & (order < fell + rose)}
    change = change.assign({name: (("y", "x"), mask) for name, mask in spots.items()})
    more = {"overlap": 1.0, "correlation": 1.0, "detail_correlation": 1.0}
    return change.assign_attrs(registration_found=int(found), **more)


@pytest.mark.parametrize(
    ("rose", "fell", "believed", "words"),
    [
        (10, 100, True, []),
        (60, 100, False, ["60 % as much rose as fell", "minimum_points"]),
        (252, 42, False, ["far more rose than fell (6 % and 1 %", "t0 and t1", "residue"]),
        (252, 0, True, ["far more rose than fell (6 % and 0 %", "scans.mould.invert"]),
        (0, 0, True, []),
    ],
)
def test_a_loss_is_believed_if_it_exceeds_noise(rose, fell, believed, words, caplog):
    row = registration_table({"7": changed(rose, fell)}, RULES, most_noise=0.5).iloc[0]
    assert row.believed == believed
    assert row.noise_share == pytest.approx(rose / fell if fell else np.nan, nan_ok=True)
    assert bool(caplog.text) == bool(words)
    assert all(word in caplog.text for word in (["patch 7", *words] if words else []))
    assert not row.excluded


def test_where_no_change_is_known_no_loss_is_believed():
    change = changed(0, 0)
    unknown = change.assign(change=change.change * np.nan).assign_attrs(known_share=0.0)
    row = registration_table({"7": unknown}, RULES, most_noise=0.5).iloc[0]
    assert not row.believed
    lost = registration_table({"7": changed(0, 50, found=False)}, RULES, most_noise=0.5).iloc[0]
    assert (lost.excluded, lost.reason) == (True, "T1 was not found on T0")
