"""Which patches enter the study: those under load whose second scan matches the first."""

from collections.abc import Iterator, Mapping

import pandas as pd
import xarray as xr

from gstlib.change.change import wear_summary

__all__ = ["registration_table", "rise_warnings", "select_patches"]

# Of each patch, in the order of the table, before it is said whether that excludes the patch.
_REGISTRATION = ["patch", "found", "shift_x_um", "shift_y_um", "rotation_deg", "overlap"]
_REGISTRATION += ["correlation", "detail_correlation", "height_scale", "residual_um"]
_REGISTRATION += ["change_sigma_um", "lateral_sigma_um", "level_of_detection_um", "detection"]
_REGISTRATION += ["known_fraction", "loss_fraction", "gain_fraction", "loss_volume_um3"]
_REGISTRATION += [
    "mean_depth_where_worn_um",
    "mean_wear_depth_um",
    "noise_fraction",
    "above_noise",
]
# Noise raises as often as it lowers: if this many times as much rose as fell, something is wrong.
_BEYOND_NOISE = 2


def registration_table(
    changes: Mapping[str, xr.Dataset],
    selection: Mapping[str, float],
    *,
    max_noise_fraction: float,
) -> pd.DataFrame:
    """How well T1 matches T0 on each patch, how much was lost, and which patches that excludes.

    `changes` are the height changes by patch; each is looked up once. A loss is above the noise
    if the area that rose is at most the share `max_noise_fraction` of the area that fell;
    `rise_warnings` says where more rose.
    """
    rows = []
    for patch, change in changes.items():
        of = wear_summary(change)
        said = {"found": bool(change.attrs["registration_found"])}
        said["above_noise"] = (
            not of["noise_fraction"] > max_noise_fraction and change.attrs["known_fraction"] > 0
        )
        rows.append({**change.attrs, **of, "patch": patch, **said})
    # what is excluded, and why, follows from the rest
    table = pd.DataFrame(rows, columns=_REGISTRATION)
    # the pressures have a table of their own: here all pass
    rules = {**selection, "minimum_pressure_MPa": 0.0}
    scored = select_patches(table.assign(pressure_MPa=1.0), table, rules)
    return table.assign(excluded=~scored.in_study, reason=scored.reason)


def rise_warnings(registration: pd.DataFrame, *, max_noise_fraction: float) -> Iterator[str]:
    """Sentences about patches where much rose, for use only removes material.

    `registration` is from `registration_table`, which has taken the same `max_noise_fraction`.
    """
    for row in registration.itertuples():
        rose, fell, noise = (
            100 * of for of in (row.gain_fraction, row.loss_fraction, row.noise_fraction)
        )
        if rose > _BEYOND_NOISE * fell:
            yield (
                f"patch {row.patch}: far more rose than fell ({rose:.2g} % and {fell:.2g} % of the "
                "area), but use only removes material. If this is so on all patches, check "
                "scans.mould.invert; if on some, check for t0 and t1 exchanged in the patch table, "
                "or for residue on the stone."
            )
        elif noise > 100 * max_noise_fraction:
            yield (
                f"patch {row.patch}: {noise:.0f} % as much rose as fell, so the loss may be noise, "
                "which mimics wear of the highest points. It is not tested against chance, and "
                "left out of the statistics over patches. A larger traces.minimum_points removes "
                "noise."
            )


def select_patches(
    pressures: pd.DataFrame, registration: pd.DataFrame, selection: Mapping[str, float]
) -> pd.DataFrame:
    """Which patches enter the study, by their pressure and by how well T1 matches T0.

    Patches that `registration` (from `registration_table`) lacks have no T1: their pressure alone
    decides. The result is `pressures` with ``in_study`` and ``reason``, empty where a patch is in.
    """
    known = registration.set_index("patch").to_dict("index")
    pressure_MPa = selection["minimum_pressure_MPa"]
    reasons = []
    for row in pressures.itertuples(index=False):
        found = []
        if not row.pressure_MPa > 0:
            found.append("no macroscale contact")
        elif row.pressure_MPa < pressure_MPa:
            found.append(f"pressure {row.pressure_MPa:.3g} below {pressure_MPa:g} MPa")
        match = known.get(row.patch, {"found": True})
        values = {"overlap": match.get("overlap")}
        if match["found"]:  # of the detail: the long waves of a stone match wherever T1 is laid
            values["correlation"] = match.get("detail_correlation")
        else:
            found.append("T1 was not found on T0")
        for name, value in values.items():
            if value is not None and value < (least := selection[f"minimum_{name}"]):
                found.append(f"T0/T1 {name} {value:.2f} below {least:.2f}")
        reasons.append("; ".join(found))
    return pressures.assign(in_study=[not text for text in reasons], reason=reasons)
