"""What is above the noise of a loss, and what is said where much rose."""

import numpy as np
import pandas as pd
import pytest
from gstlib.change.change import height_change
from gstlib.change.selection import (
    exchanged_epochs,
    registration_table,
    rise_warnings,
    select_patches,
)
from gstlib.surfaces.grid import make_surface

RULES = {"minimum_overlap": 0.7, "minimum_correlation": 0.5, "minimum_pressure_MPa": 1.0}


def changed(rose, fell, *, found=True):
    """A change of 60 × 70 points, so many of which rose and fell; nothing is known of T1's rest."""
    rng = np.random.default_rng(3)
    t0 = make_surface(rng.normal(0, 1e-3, (60, 70)), 1e-3)
    change = height_change(t0, t0 + rng.normal(0, 1e-5, t0.shape))
    order = np.arange(4200).reshape(60, 70)
    spots = {"loss": order < fell, "gain": (order >= fell) & (order < fell + rose)}
    change = change.assign({name: (("y", "x"), mask) for name, mask in spots.items()})
    alike = ["overlap", "correlation", "detail_correlation", "slope_correlation"]
    more = dict.fromkeys(alike, 1.0)
    return change.assign_attrs(registration_found=int(found), **more)


@pytest.mark.parametrize(
    ("rose", "fell", "above_noise", "warned"),
    [
        (10, 100, True, False),
        (60, 100, False, True),
        (252, 42, False, False),  # a fault, or no fault of this patch alone
        (0, 0, True, False),
    ],
)
def test_a_loss_is_believed_if_it_exceeds_noise(rose, fell, above_noise, warned):
    table = registration_table({"7": changed(rose, fell)}, RULES, max_gain_to_loss_ratio=0.5)
    warnings, row = "".join(rise_warnings(table, max_gain_to_loss_ratio=0.5)), table.iloc[0]
    assert row.above_noise == above_noise
    assert row.gain_to_loss_ratio == pytest.approx(rose / fell if fell else np.nan, nan_ok=True)
    assert ("patch 7" in warnings) == warned
    assert not row.excluded


@pytest.mark.parametrize(
    ("rising", "faults", "words"),
    [(0, 0, ""), (1, 0, "patch 0: more rose"), (2, 0, "patches 0, 1: more rose"), (3, 1, "")],
)
def test_epochs_exchanged_on_most_patches_are_a_fault_and_on_few_a_warning(rising, faults, words):
    changes = {str(n): changed(0, 300) for n in range(5)}
    changes |= {str(n): changed(300, 100) for n in range(rising)}
    changes["3"] = changed(1, 0)  # unworn, but for noise
    changes["4"] = changed(2000, 0, found=False)
    table = registration_table(changes, RULES, max_gain_to_loss_ratio=0.5)
    assert len(list(exchanged_epochs(table))) == faults
    said = [*rise_warnings(table, max_gain_to_loss_ratio=np.inf)]
    assert len(said) == bool(words)
    assert all(text.startswith(words) for text in said)


def test_where_no_change_is_known_no_loss_is_believed():
    change = changed(0, 0)
    unknown = change.assign(change=change.change * np.nan).assign_attrs(known_fraction=0.0)
    row = registration_table({"7": unknown}, RULES, max_gain_to_loss_ratio=0.5).iloc[0]
    assert not row.above_noise
    lost = registration_table(
        {"7": changed(0, 50, found=False)}, RULES, max_gain_to_loss_ratio=0.5
    ).iloc[0]
    assert (lost.excluded, lost.reason) == (True, "T1 was not found on T0")


def test_patches_are_selected_by_pressure_overlap_and_correlation():
    pressures = pd.DataFrame(
        {"patch": list("123456"), "pressure_MPa": [0.0, 0.5, 8.0, 22.0, 70.0, 70.0]}
    )
    registration = pd.DataFrame({"patch": list("13456"), "overlap": [0.52, 0.52, 0.95, 0.9, 0.9]})
    registration["detail_correlation"] = [0.99, 0.3, 0.99, 0.1, 0.9]
    registration["slope_correlation"] = [0.9, 0.9, 0.9, 0.1, 0.1]
    registration["found"] = [True, True, True, False, False]
    table = select_patches(pressures, registration, RULES)
    words = ["no macroscale contact; T0/T1 overlap", "pressure 0.5", "correlation 0.30"]
    words += ["", "T1 was not found on T0", "striae match"]
    assert all(map(str.__contains__, table.reason, words))
    assert list(table.in_study) == [False, False, False, True, False, False]
    # not by the pressure that the patch's own wear tells, where another is known
    others = pressures.assign(leave_one_out_MPa=[np.nan, 2.0, np.nan, 0.0, 0.5, 70.0])
    known = select_patches(others, registration[:0], RULES).in_study
    assert list(known) == [False, True, True, False, False, True]
    without_t1 = select_patches(pressures, registration[:0], RULES)
    assert list(without_t1.in_study) == [False, False, True, True, True, True]
