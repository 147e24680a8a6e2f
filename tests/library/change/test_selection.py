"""Losses above their noise, patches that enter a study, and messages where much rose."""

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

RULES = {
    "minimum_overlap": 0.7,
    "minimum_correlation": 0.5,
    "minimum_pressure_MPa": 1.0,
}


def changed(rose, fell, *, is_reliable=True):
    """A change of 60 × 70 points, so many of which rose and fell."""
    rng = np.random.default_rng(3)
    t0 = make_surface(rng.normal(0, 1e-3, (60, 70)), 1e-3)
    change = height_change(t0, t0 + rng.normal(0, 1e-5, t0.shape))
    order = np.arange(4200).reshape(60, 70)
    change["loss"] = ("y", "x"), order < fell
    change["gain"] = ("y", "x"), (order >= fell) & (order < fell + rose)
    names = "overlap", "correlation", "detail_correlation", "slope_correlation"
    attrs = dict.fromkeys(names, 1.0)
    return change.assign_attrs(attrs, registration_found=int(is_reliable))


def table_of(changes):
    return registration_table(changes, RULES, max_gain_to_loss_ratio=0.5)


@pytest.mark.parametrize(
    ("rose", "fell", "above_noise", "warned"),
    [(10, 100, True, False), (60, 100, False, True), (0, 0, True, False)],
)
def test_a_loss_is_believed_if_it_exceeds_noise(rose, fell, above_noise, warned):
    table = table_of({"7": changed(rose, fell)})
    row = table.iloc[0]
    assert row.above_noise == above_noise
    assert row.gain_to_loss_ratio == pytest.approx(
        rose / fell if fell else np.nan, nan_ok=True
    )
    assert not row.excluded
    warnings = "".join(rise_warnings(table, max_gain_to_loss_ratio=0.5))
    assert ("patch 7" in warnings) == warned


@pytest.mark.parametrize(
    ("rising", "faults", "words"), [(2, 0, "patches 0, 1: more rose"), (3, 1, None)]
)
def test_epochs_exchanged_on_most_patches_are_a_fault_and_on_few_a_warning(
    rising, faults, words
):
    changes = {str(n): changed(0, 300) for n in range(3)}
    changes |= {str(n): changed(300, 100) for n in range(rising)}
    changes["3"] = changed(1, 0)  # unworn, but for noise
    changes["4"] = changed(2000, 0, is_reliable=False)
    table = table_of(changes)
    assert table.reason[4] == "T1 was not found on T0"
    assert len(list(exchanged_epochs(table))) == faults
    warnings = list(rise_warnings(table, max_gain_to_loss_ratio=np.inf))
    assert [warning.startswith(words) for warning in warnings] == [True] * bool(words)


def test_patches_are_selected_by_pressure_overlap_and_correlation():
    pressures = pd.DataFrame({"patch": list("123456")})
    pressures["pressure_MPa"] = [0.0, 0.5, 8.0, 22.0, 70.0, 70.0]
    registration = pd.DataFrame({"patch": list("13456")})
    registration["overlap"] = [0.52, 0.52, 0.95, 0.9, 0.9]
    registration["detail_correlation"] = [0.99, 0.3, 0.99, 0.1, 0.9]
    registration["slope_correlation"] = [0.9, 0.9, 0.9, 0.1, 0.1]
    registration["found"] = [True, True, True, False, False]
    table = select_patches(pressures, registration, RULES)
    assert list(table.in_study) == [False, False, False, True, False, False]
    reasons = [
        "no macroscale contact; T0/T1 overlap",
        "pressure 0.5",
        "correlation 0.30",
    ]
    reasons += ["", "T1 was not found on T0", "striae match"]
    assert all(map(str.__contains__, table.reason, reasons))
    # not by the pressure that the patch's own wear tells, where another is known
    others = pressures.assign(leave_one_out_MPa=[np.nan, 2.0, np.nan, 0.0, 0.5, 70.0])
    without_t1 = registration[:0]
    in_study = select_patches(others, without_t1, RULES).in_study
    assert list(in_study) == [False, True, True, False, False, True]
    in_study = select_patches(pressures, without_t1, RULES).in_study
    assert list(in_study) == [False, False, True, True, True, True]
