"""Scores of the predicted loss of a patch, as a mask, a map and a volume, beside its baselines.

The scored loss of each patch is predicted from the other patches (`gstlib.wear.fit.wear_map`). Its
*mask* contains the points where it exceeds the level of detection. Matthews' correlation
coefficient measures the agreement of this mask with the lost area (`gstlib.validation.masks`). The
error of the *map* is the r.m.s. of the predicted minus the measured loss, over all points. The
*volume* is the part that two scans can show. The baselines use the same data as the prediction
(`gstlib.validation.baselines`).

Chance is the agreement of the masks of other patches (`gstlib.validation.nulls`). Noise mimics
agreement: a point raised by noise at T0 is predicted to wear, and looks worn at T1. Other patches
cannot show this. But noise raises as often as it lowers. If noise may explain the loss by the area
that rose, the patch is not tested. The remaining noise makes a test of one patch claim more often
than its level, so only all patches together are tested.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.contact import Contact
from gstlib.coupling.pressures import unseen
from gstlib.surfaces.grid import spacing_of
from gstlib.validation.baselines import BASELINES, ORACLE, Others, baseline_depths
from gstlib.validation.masks import mask_counts, mask_scores, ratio
from gstlib.validation.nulls import Places, swapped_mcc
from gstlib.wear.archard import BARE, INTERLAYER, seen_depth

__all__ = ["ScoredPatch", "by_chance", "other_patches", "own_model", "score_patch"]
__all__ += ["score_tables"]

# Bands with equal numbers of points, beginning with the highest points.
_BANDS = 4


@dataclass(frozen=True)
class ScoredPatch:
    """Scores of one patch."""

    # Of validation_patches.csv. ``untested`` says why chance is not tested: "noise" or "undefined";
    # empty if it is.
    row: dict[str, Any]
    models: list[dict[str, Any]]  # rows of wear.csv
    bands: list[dict[str, Any]]  # rows of wear_profile.csv
    places: Places  # of the study's own prediction, and of the loss


def own_model(models: Sequence[str]) -> str:
    """The study's own prediction: with the interlayer, if there is one."""
    return INTERLAYER if INTERLAYER in models else BARE


def other_patches(
    pressures: pd.DataFrame,
    registration: pd.DataFrame,
    fitted: Sequence[str],
    contacts: Mapping[str, Contact],
    changes: Mapping[str, xr.Dataset],
) -> Others:
    """Data for the baselines about the patches that the prediction is `fitted` to.

    The tables are ``patch_pressures`` and ``registration``. Each contact and each change of these
    patches is looked up once.
    """
    measured = registration.set_index("patch")
    table = measured[["loss_fraction"]].assign(
        pressure_MPa=unseen(pressures.set_index("patch")),
        loss_mm=measured.mean_wear_depth_um * 1e-3,
    )
    depths = {}
    for patch in fitted:
        height = contacts[patch].interface.laid.values
        depths[patch] = height.max() - height[np.isfinite(changes[patch].change.values)]
    return Others.tabulated(table.loc[list(fitted)], depths)


def score_patch(
    patch: str,
    contact: Contact,
    change: xr.Dataset,
    predicted: xr.Dataset,
    others: Others,
    *,
    pressure_MPa: float,
    above_noise: bool = True,
    in_statistics: bool = True,
) -> ScoredPatch:
    """Score the predicted loss of one patch against the measured loss, known at some points.

    Parameters
    ----------
    patch : str
        Id of the patch.
    contact : Contact
        Contact of the patch before use: ``pressure`` (y, x) in MPa, and its heights. The baselines
        use the heights as the patch lies on the stone (`gstlib.contact.Interface.laid`).
    change : xarray.Dataset
        From `gstlib.change.change.height_change`.
    predicted : xarray.Dataset
        ``depth`` (model, y, x), mm, from `gstlib.wear.fit.wear_map`.
    others : Others
        From `other_patches`.
    pressure_MPa : float
        Pressure of the patch before use.
    above_noise : bool
        Whether the loss exceeds the noise. If not, it is not tested against chance.
    in_statistics : bool
        Whether the patch is in the statistics.
    """
    valid = np.isfinite(change.change.values)
    lost = -change.change.values[valid]
    level = change.level_of_detection.values[valid]
    loss = change.loss.values.astype(bool) & valid
    laid = contact.interface.laid.values
    height = laid[valid]
    is_lost = loss[valid]
    own = {
        str(depth.model.values): seen_depth(depth.values[valid])
        for depth in predicted.depth
    }
    depths = own | baseline_depths(
        height,
        level,
        summit=float(laid.max()),
        pressure_MPa=pressure_MPa,
        worn_fraction=float(is_lost.mean()),
        others=others.without(patch),
    )
    element_um3 = float(np.prod(spacing_of(change))) * 1e9
    unworn = own[BARE] < level  # where the bare stone takes off less than is detected
    models: dict[str, dict[str, Any]] = {}
    for model, depth in depths.items():
        scores = mask_scores(*mask_counts(depth > level, is_lost))
        error = depth - lost
        models[model] = {
            "patch": patch,
            "model": model,
            "predicted_worn_fraction": float((depth > level).mean()),
            "mcc": float(scores["mcc"]),
            "attainable_mcc": float(scores["attainable_mcc"]),
            "predicted_volume_um3": float(depth.clip(0).sum()) * element_um3,
            "measured_volume_um3": float(lost[is_lost].sum()) * element_um3,
            "map_error_um": _rms_um(error),
        }
        if INTERLAYER in own:  # only its map is compared there
            models[model]["out_of_contact_um"] = _rms_um(error[unworn])
    name = own_model([*own])
    chosen = models[name]
    area_um2 = element_um3 * 1e-3 * height.size
    no_loss_um = models["none"]["map_error_um"]
    mask = np.zeros(valid.shape, dtype=bool)
    mask[valid] = own[name] > level
    is_defined = math.isfinite(chosen["mcc"]) and mask.any()
    row = {
        "patch": patch,
        "in_statistics": in_statistics,
        "contact_fraction": float((contact.pressure.values > 0).mean()),
        "predicted_loss_um": chosen["predicted_volume_um3"] / area_um2,
        "mcc": chosen["mcc"],
        "attainable_mcc": chosen["attainable_mcc"],
        "map_error": float(ratio(chosen["map_error_um"], no_loss_um)),
        **{f"{model}_mcc": models[model]["mcc"] for model in (*BASELINES, ORACLE)},
        "untested": "noise" if not above_noise else "" if is_defined else "undefined",
    }
    compared = {"measured": np.where(is_lost, lost, 0.0), **own}
    bands = [{"patch": patch} | band for band in _bands(compared, height)]
    places = Places.packed(mask, loss, valid)
    return ScoredPatch(row, [*models.values()], bands, places)


def by_chance(scored: Sequence[ScoredPatch]) -> dict[str, np.ndarray]:
    """MCC of each testable patch, by patch: the own prediction, then chance.

    See `gstlib.validation.nulls.swapped_mcc`.
    """
    predicted = {
        one.row["patch"]: one.places for one in scored if one.places.bits[0].any()
    }
    tested = [one.row["patch"] for one in scored if not one.row["untested"]]
    return {patch: swapped_mcc(patch, predicted) for patch in tested}


def score_tables(scored: Sequence[ScoredPatch]) -> dict[str, pd.DataFrame]:
    """The tables ``patches``, ``wear`` and ``profile``; empty without patches."""
    rows = {
        "patches": [one.row for one in scored],
        "wear": [row for one in scored for row in one.models],
        "profile": [row for one in scored for row in one.bands],
    }
    return {name: pd.DataFrame(of_table) for name, of_table in rows.items()}


def _bands(
    depths: Mapping[str, np.ndarray], height: np.ndarray
) -> Iterator[dict[str, Any]]:
    """Mean loss, µm, by model, of the bands of a patch's points by height."""
    order = np.array_split(np.argsort(-height, kind="stable"), _BANDS)
    for band, points in enumerate(order, start=1):
        for model, depth in depths.items():
            mean_um = (
                1e3 * float(depth.clip(0)[points].mean()) if points.size else math.nan
            )
            yield {"band": band, "model": model, "loss_um": mean_um}


def _rms_um(depth: np.ndarray) -> float:
    """R.m.s. (µm) of depths in mm; NaN if there are none."""
    return 1e3 * float(np.sqrt(np.mean(depth**2))) if depth.size else math.nan
