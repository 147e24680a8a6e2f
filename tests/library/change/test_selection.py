"""Losses above their noise, patches that enter a study, and messages where much rose."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from contacts import written

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
    order = make_surface(np.arange(4200.0).reshape(60, 70), 1e-3)
    loss, gain = order < fell, (order >= fell) & (order < fell + rose)
    names = "overlap detail_correlation slope_correlation known_fraction"
    attrs = dict.fromkeys(names.split(), 1.0) | {"registration_found": is_reliable}
    return xr.Dataset(
        {"change": gain - 1.0 * loss, "loss": loss, "gain": gain}, attrs=attrs
    )


def table_of(changes):
    return registration_table(changes, RULES, max_gain_to_loss_ratio=0.5)


@pytest.mark.parametrize(
    ("rose", "fell", "ratio", "warned"),
    [
        (10, 100, 0.1, False),
        (60, 100, 0.6, True),
        # a little gain is noise beside a loss of zero; more is residue or a torn mould
        (0, 0, np.nan, False),
        (17, 0, np.nan, False),
        (42, 0, np.inf, True),
    ],
)
def test_a_loss_is_believed_if_it_exceeds_noise(rose, fell, ratio, warned):
    table = table_of({"7": changed(rose, fell)})
    row = table.iloc[0]
    assert row.above_noise != warned
    assert row.gain_to_loss_ratio == pytest.approx(ratio, nan_ok=True)
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
    changes |= {name: changed(2000, 0, is_reliable=False) for name in "45"}
    table = table_of(changes)
    assert table.reason[4] == "T1 was not found on T0"
    assert len(list(exchanged_epochs(table))) == faults
    warnings = list(rise_warnings(table, max_gain_to_loss_ratio=np.inf))
    assert [warning.startswith(words) for warning in warnings] == [True] * bool(words)


def test_patches_are_selected_by_pressure_overlap_and_correlation():
    table = written(
        """
        patch, pressure_MPa, overlap, detail_correlation, slope_correlation, found, reason
        1,     0,            0.52,    0.99,               0.9,               True,  no macroscale
        1,     0,            0.52,    0.99,               0.9,               True,  ; T0/T1 overlap
        3,     8,            0.52,    0.3,                0.9,               True,  correlation 0.30
        4,     22,           0.95,    0.99,               0.9,               True,
        5,     70,           0.9,     0.1,                0.1,               False, T1 was not found
        6,     70,           0.9,     0.9,                0.1,               False, striae match
        """
    )
    each = table.drop_duplicates("patch")
    selected = select_patches(each, each, RULES).set_index("patch").loc[table.patch]
    assert list(selected.in_study) == 3 * [False] + [True] + 2 * [False]
    assert all(map(str.__contains__, selected.reason, table.reason.fillna("")))


def test_without_t1_the_pressure_by_the_wear_of_the_others_decides():
    pressures = written(
        """
        patch, pressure_MPa, leave_one_out_MPa, by_others, alone
        1,     0,            ,                  False,     False
        2,     0.5,          2,                 True,      False
        3,     8,            ,                  True,      True
        4,     22,           0,                 False,     True
        5,     70,           0.5,               False,     True
        """
    )
    nothing = pd.DataFrame({"patch": []})
    in_study = select_patches(pressures, nothing, RULES).in_study
    assert list(in_study) == list(pressures.by_others)
    alone = pressures.drop(columns="leave_one_out_MPa")
    in_study = select_patches(alone, nothing, RULES).in_study
    assert list(in_study) == list(pressures.alone)
