"""Selection of patches for the study: those under load whose second scan matches the first."""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike

from gstlib.change.change import wear_summary
from gstlib.change.registration import is_one_way, is_other
from gstlib.coupling.pressures import unseen
from gstlib.errors import FaultError

__all__ = [
    "exchanged_epochs",
    "is_more",
    "other_heights",
    "registration_table",
    "rise_warnings",
    "select_patches",
]

# Columns of each patch, in the order of the table, before the reasons to exclude it.
_REGISTRATION = [
    "patch",
    "found",
    "shift_x_um",
    "shift_y_um",
    "shift_x_error_um",
    "shift_y_error_um",
    "rotation_deg",
    "t1_x_um",
    "t1_y_um",
    "t1_size_x_um",
    "t1_size_y_um",
    "overlap",
    "correlation",
    "detail_correlation",
    "slope_correlation",
    "dale_depth_ratio",
    "residual_um",
    "change_sigma_um",
    "lateral_sigma_um",
    "level_of_detection_um",
    "cluster_points",
    "detection",
    "known_fraction",
    "loss_fraction",
    "gain_fraction",
    "loss_volume_um3",
    "mean_depth_where_worn_um",
    "mean_wear_depth_um",
    "gain_to_loss_ratio",
    "above_noise",
]
# Use removes material. No patch of synthetic specimens with correct T0 and T1 gained on a larger
# fraction of its points than it lost on. If T0 and T1 are exchanged, four of five patches gain by
# this factor or more.
_GAIN_OVER_LOSS = 1.2
_GAIN_LESS_LOSS = 0.015


def registration_table(
    changes: Mapping[str, xr.Dataset],
    selection: Mapping[str, float],
    *,
    max_gain_to_loss_ratio: float,
) -> pd.DataFrame:
    """Quality of each registration, the loss of each patch, and the patches that they exclude.

    `changes` are the height changes by patch; each is looked up once. A loss is above the noise if
    the area of gain is at most the fraction `max_gain_to_loss_ratio` of the area of loss.
    """
    rows = [
        {"patch": patch, "found": bool(change.attrs["registration_found"])}
        | change.attrs
        | wear_summary(change)
        for patch, change in changes.items()
    ]
    table = pd.DataFrame(rows, columns=_REGISTRATION)
    is_noise = table.gain_to_loss_ratio > max_gain_to_loss_ratio
    table["above_noise"] = ~is_noise & (table.known_fraction > 0)
    # The excluded patches and the reasons follow from the other columns.
    # The pressures have a table of their own, so all pass here.
    rules = {**selection, "minimum_pressure_MPa": 0.0}
    scored = select_patches(table.assign(pressure_MPa=1.0), table, rules)
    return table.assign(excluded=~scored.in_study, reason=scored.reason)


def exchanged_epochs(registration: pd.DataFrame) -> Iterator[FaultError]:
    """A `FaultError` if most patches gained more than they lost, because use only removes material.

    `registration` is from `registration_table`.
    """
    rose, found = registration[_rose(registration)], int(registration.found.sum())
    remedy = "Exchange t0 and t1 in the patch table, or correct scans.mould.invert."
    if 2 * rose.loss_fraction.median() > rose.gain_fraction.median():
        remedy = (
            "If a filter removed long waves from the scans, unworn parts seem to rise. Export the "
            f"scans with at most a plane removed. Otherwise: {remedy}"
        )
    if 2 * len(rose) > found:
        gain, loss = rose.gain_fraction.median(), rose.loss_fraction.median()
        yield FaultError(
            "epochs",
            "t0 and t1",
            f"on {len(rose)} of {found} patches more rose than fell from T0 to T1 (medians: "
            f"{100 * gain:.2g} % and {100 * loss:.2g} % of the area), but use only removes "
            "material",
            remedy,
        )


def other_heights(registration: pd.DataFrame) -> Iterator[FaultError]:
    """A `FaultError` for each patch whose T1 matches its T0, with heights that wear cannot cause.

    `registration` is from `registration_table`.
    """
    for row in registration[registration.found.astype(bool)].itertuples():
        if is_other(row.dale_depth_ratio):
            yield FaultError(
                "heights",
                f"patch {row.patch}, T1",
                f"its dales match the dales of T0, but are {row.dale_depth_ratio:.3g} times as "
                "deep, and wear does not cause that",
                "Give both scans in one unit and with one height calibration, or leave t1 empty in "
                "the patch table.",
                patches=(row.patch,),
            )


def rise_warnings(
    registration: pd.DataFrame, *, max_gain_to_loss_ratio: float
) -> Iterator[str]:
    """Warnings about patches with as much gain as loss. If most patches have it, see the fault.

    `registration` is from `registration_table` with the same `max_gain_to_loss_ratio`.
    """
    is_rise = _rose(registration)
    is_noisy = ~is_rise & (registration.gain_to_loss_ratio > max_gain_to_loss_ratio)
    rose, noisy = registration[is_rise], registration[is_noisy]
    if 0 < 2 * len(rose) <= registration.found.sum():
        yield (
            f"{_named(rose)}: more rose than fell from T0 to T1 (up to "
            f"{100 * rose.gain_fraction.max():.2g} % of the area), but use only removes material. "
            "Check whether t0 and t1 are exchanged in the patch table, a filter removed long "
            "waves, or residue covers the stone"
        )
    if len(noisy):
        least = 100 * noisy.gain_to_loss_ratio.min()
        yield (
            f"{_named(noisy)}: at least {least:.0f} % as much rose as fell, "
            "so the loss may be noise, which mimics wear of the highest points. It is not tested "
            "against chance, and is left out of the statistics over patches. A larger "
            "detection.minimum_cluster_points removes noise"
        )


def is_more(one: ArrayLike, other: ArrayLike) -> np.ndarray:
    """Whether a fraction of a patch, such as the gain, clearly exceeds the other, the loss."""
    other = np.asarray(other)
    return np.asarray(one) > np.maximum(
        _GAIN_OVER_LOSS * other, other + _GAIN_LESS_LOSS
    )


def _rose(registration: pd.DataFrame) -> pd.Series:
    """Whether each patch gained height on more of its area than it lost on."""
    more = is_more(registration.gain_fraction, registration.loss_fraction)
    return registration.found.astype(bool) & more


def _named(rows: pd.DataFrame) -> str:
    return f"patch{'es' * (len(rows) > 1)} {', '.join(rows.patch)}"


def select_patches(
    pressures: pd.DataFrame, registration: pd.DataFrame, selection: Mapping[str, float]
) -> pd.DataFrame:
    """Select the patches of the study, by their pressure and by the match of T1 to T0.

    The pressure is independent of the patch's own wear (`gstlib.coupling.pressures`), so that no
    patch is selected because it wore. Patches without a row in `registration` (from
    `registration_table`) have no T1, and their pressure alone decides. The result is `pressures`
    with ``in_study`` and ``reason``, which is empty for selected patches.

    Examples
    --------
    >>> import gstlib, pandas as pd
    >>> pressures = pd.DataFrame({"patch": ["1", "2"], "pressure_MPa": [0.4, 20.0]})
    >>> row = {"patch": "2", "found": True, "overlap": 0.9, "detail_correlation": 0.8}
    >>> rules = {"minimum_overlap": 0.7, "minimum_correlation": 0.5}
    >>> rules["minimum_pressure_MPa"] = 1.0
    >>> table = gstlib.select_patches(pressures, pd.DataFrame([row]), rules)
    >>> table.in_study.tolist(), table.reason[0]
    ([False, True], 'pressure 0.4 below 1 MPa')
    """
    matches = registration.set_index("patch").to_dict("index")
    least_MPa = selection["minimum_pressure_MPa"]
    by = ", by the wear of the others" * ("leave_one_out_MPa" in pressures)
    reasons = []
    for patch, pressure_MPa in zip(pressures.patch, unseen(pressures), strict=True):
        faults = []
        if not pressure_MPa > 0:
            faults.append("no macroscale contact")
        elif pressure_MPa < least_MPa:
            faults.append(f"pressure {pressure_MPa:.3g} below {least_MPa:g} MPa{by}")
        match = matches.get(patch)
        values = {} if match is None else {"overlap": match["overlap"]}
        if match and match["found"]:
            # of the detail: the long waves of a stone match wherever T1 is laid
            values["correlation"] = match["detail_correlation"]
        elif match and is_one_way(
            match["detail_correlation"], match["slope_correlation"]
        ):
            faults.append(
                "T1 was not found on T0: its striae match, but nothing shows where along them"
            )
        elif match:
            faults.append("T1 was not found on T0")
        for name, value in values.items():
            if value < (least := selection[f"minimum_{name}"]):
                faults.append(f"T0/T1 {name} {value:.2f} below {least:.2f}")
        reasons.append("; ".join(faults))
    return pressures.assign(in_study=[not text for text in reasons], reason=reasons)
