"""Which patches enter the study: those under load whose second scan matches the first."""

from collections.abc import Mapping

import pandas as pd
import xarray as xr

from gstlib.validation.change import wear_summary

__all__ = ["registration_table", "select_patches"]


def registration_table(
    changes: Mapping[str, xr.Dataset], selection: Mapping[str, float]
) -> pd.DataFrame:
    """How well T1 matches T0 on each patch, how much was lost, and which patches that excludes.

    `changes` are the height changes by patch; each is looked up once.
    """
    quality = [
        "shift_x_um",
        "shift_y_um",
        "rotation_deg",
        "overlap",
        "correlation",
        "detail_correlation",
        "height_scale",
        "residual_um",
        "change_sigma_um",
        "lateral_sigma_um",
        "level_of_detection_um",
        "known_share",
    ]
    wear = ["loss_fraction", "gain_fraction", "loss_volume_um3", "loss_depth_um"]
    rows = []
    for patch, change in changes.items():
        worn = wear_summary(change)
        rows.append(
            {"patch": patch, "found": bool(change.attrs["registration_found"])}
            | {name: change.attrs[name] for name in quality}
            | {name: worn[name] for name in wear}
        )
    table = pd.DataFrame(rows, columns=["patch", "found", *quality, *wear])
    # the pressures have a table of their own: here all pass
    rules = {**selection, "minimum_pressure_MPa": 0.0}
    judged = select_patches(table.assign(pressure_MPa=1.0), table, rules)
    return table.assign(excluded=~judged.in_study, reason=judged.reason)


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
        if match[
            "found"
        ]:  # of the detail: the long waves of a stone match wherever T1 is laid
            values["correlation"] = match.get("detail_correlation")
        else:
            found.append("T1 was not found on T0")
        for name, value in values.items():
            if value is not None and value < (least := selection[f"minimum_{name}"]):
                found.append(f"T0/T1 {name} {value:.2f} below {least:.2f}")
        reasons.append("; ".join(found))
    return pressures.assign(in_study=[not text for text in reasons], reason=reasons)
