"""Scores what each stage of the study recovered against the generated specimen's truth.

Every row is a quantity with its true and its recovered value. Scores of masks (precision, recall)
have 1 as their true value; r.m.s. errors have 0.
"""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import scipy.ndimage
import xarray as xr

from gstlib.errors import InputError
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.specimen.stone import fit_plane
from gstlib.specimen.truth import true_surface

__all__ = ["score_truth"]

# Of the larger one, kept in the difference of two numbers.
_ERROR_DIGITS = 7
_COLUMNS = ["stage", "quantity", "patch", "unit", "true", "recovered", "error"]
_UM = 1e3
_RULES = "window", "median"  # of gstlib.preprocess.outliers
# What a spike is held against: the points up to this far from it, and how many robust standard
# deviations it must stand above them to be touched before they are.
_AROUND, _STANDS_OUT = 5, 3.0

Results = str | Path | xr.Dataset


def score_truth(
    truth: Results,
    *,
    macroscale: Results | None = None,
    surfaces: Mapping[tuple[str, str], Results] | None = None,
    registered: Mapping[str, Results] | None = None,
    patch_pressures: str | Path | pd.DataFrame | None = None,
    true_pressures: pd.Series | None = None,
    placement: str | Path | pd.DataFrame | None = None,
) -> pd.DataFrame:
    """Hold what the stages recovered against the truth. Stages left out are not scored.

    Parameters
    ----------
    truth : path or Dataset
        ``truth.h5`` of `generate_specimen`.
    macroscale : path or Dataset, optional
        ``macroscale/surface.h5``: ``height`` (y, x) mm on the analysis grid.
    surfaces : mapping of (patch, epoch) to path or Dataset, optional
        Prepared scans, ``surfaces/{patch}_{epoch}.h5``, each with what was measured.
    registered : mapping of patch to path or Dataset, optional
        T1 laid over T0, ``registered/{patch}.h5``.
    patch_pressures : path or DataFrame, optional
        Recovered ``patch, x_mm, y_mm, pressure_MPa``.
    true_pressures : Series, optional
        True pressure (MPa) of each patch, indexed by its name: of the contact of the true
        macroscale surface (`true_surface`) over the true T0 places (`true_patches`).
    placement : path or DataFrame, optional
        Recovered ``patch, shift_x_um, shift_y_um`` (`gstlib.placement.place_patches`).

    Returns
    -------
    pandas.DataFrame
        ``stage, quantity, patch, unit, true, recovered, error`` (recovered - true); ``patch`` is
        empty for what is global.

    Raises
    ------
    InputError
        A result does not fit the truth: another patch, or another shape.
    """
    truth = _open(truth)
    rows: list[tuple] = []
    if macroscale is not None:
        rows += _score_macroscale(truth, _open(macroscale))
    for (patch, epoch), result in (surfaces or {}).items():
        rows += _score_surface(_patch(truth, patch), patch, epoch, _open(result))
    for patch, result in (registered or {}).items():
        at = _patch(truth, patch)
        rows += _score_registration(at, patch, _open(result))
        rows += _score_wear(at, patch, _open(result), truth.attrs["wear_threshold_um"])
    if placement is not None:
        rows += _score_placement(truth, _table(placement, "shift_x_um", "shift_y_um"))
    if patch_pressures is not None and true_pressures is not None:
        pressures = _table(patch_pressures, "x_mm", "y_mm", "pressure_MPa")
        rows += _score_pressures(truth, pressures, true_pressures)
    return pd.DataFrame([(*row, _error(*row[-2:])) for row in rows], columns=_COLUMNS)


def _error(true: float, recovered: float) -> float:
    """Difference, without the digits that are but rounding of two nearly equal numbers."""
    scale = max(abs(true), abs(recovered))
    if not 0 < scale < math.inf:
        return recovered - true
    return round(recovered - true, _ERROR_DIGITS - 1 - math.floor(math.log10(scale)))


def _open(result: Results) -> xr.Dataset:
    return result if isinstance(result, xr.Dataset) else read_dataset(result)


def _table(result: str | Path | pd.DataFrame, *columns: str) -> pd.DataFrame:
    if not isinstance(result, pd.DataFrame):
        result = read_table(result, ["patch", *columns])
    return result.set_index("patch")


def _patch(truth: xr.Dataset, patch: str) -> xr.Dataset:
    if patch not in truth.patch.values:
        raise InputError(
            "truth",
            f"patch {patch} is not in it (it has {', '.join(map(str, truth.patch.values))})",
            "Generate the specimen again with this patch table.",
        )
    return truth.sel(patch=patch)


def _level(heights: np.ndarray) -> np.ndarray:
    steps = [np.arange(size, dtype=float) for size in heights.shape]
    return heights - fit_plane(heights, *steps)[2]


def _matching(true: np.ndarray, recovered: np.ndarray, what: str) -> None:
    if true.shape != recovered.shape:
        raise InputError(
            what,
            f"it has shape {recovered.shape}, the truth {true.shape}",
            "Generate the specimen again, or score the results that belong to it.",
        )


def _score_macroscale(truth: xr.Dataset, macroscale: xr.Dataset) -> list[tuple]:
    """The gridded mesh against the true macroscale surface, planes removed from both."""
    true, found = true_surface(truth).values, macroscale["height"].values
    _matching(true, found, "macroscale surface")
    true, found = _level(true) * _UM, _level(found) * _UM
    return [
        ("macroscale", "Sq", "", "um", float(true.std()), float(found.std())),
        ("macroscale", "highest", "", "um", float(true.max()), float(found.max())),
        ("macroscale", "height_rms_error", "", "um", 0.0, float((found - true).std())),
        ("macroscale", "height_correlation", "", "1", 1.0, _correlation(true, found)),
    ]


def _score_surface(at: xr.Dataset, patch: str, epoch: str, surface: xr.Dataset) -> list[tuple]:
    """A prepared scan: tilt, filled points, outliers by each rule; at T0 heights as well."""
    at_epoch = at.sel(epoch=epoch)
    outlier, unmeasured = at_epoch.outlier.values, at_epoch.unmeasured.values
    found = surface["outlier"].values.astype(bool)
    filled = surface["filled"].values.astype(bool)
    _matching(outlier, found, f"surface of patch {patch} at {epoch}")
    precision, recall = _precision_recall(outlier, found)
    stage = "preprocessing"
    rows = [
        (stage, f"{epoch} {name}", patch, unit, float(true), float(recovered))
        for name, unit, true, recovered in (
            ("tilt_x", "mrad", at_epoch.plane_x_mrad, surface.attrs["tilt_x_mrad"]),
            ("tilt_y", "mrad", at_epoch.plane_y_mrad, surface.attrs["tilt_y_mrad"]),
            ("filled", "1", unmeasured.sum(), filled.sum()),
            ("filled_elsewhere", "1", 0, (filled & ~unmeasured).sum()),
            ("outliers", "1", outlier.sum(), found.sum()),
            ("outlier_precision", "1", 1, precision),
            ("outlier_recall", "1", 1, recall),
        )
    ]
    scale = surface.attrs["outlier_scale_um"] / _UM
    for rule in _RULES:  # whichever was in force
        found = surface[f"outlier_{rule}"].values.astype(bool)
        precision, recall = _precision_recall(outlier, found)
        spikes = _leftover_spikes(
            surface["measured"].values, outlier & ~found, outlier | unmeasured, scale
        )
        rows += [
            (stage, f"{epoch} {rule}_{name}", patch, "1", float(true), float(recovered))
            for name, true, recovered in (
                ("precision", 1, precision),
                ("recall", 1, recall),
                ("leftover_spikes", 0, spikes),
            )
        ]
    if epoch == "T0":
        true, height = _level(at.height.values) * _UM, _level(surface["height"].values) * _UM
        rows += [
            ("microscale input", "T0 Sq", patch, "um", float(true.std()), float(height.std())),
            ("microscale input", "T0 highest", patch, "um", float(true.max()), float(height.max())),
            (
                "microscale input",
                "T0 height_rms_error",
                patch,
                "um",
                0.0,
                float((height - true).std()),
            ),
        ]
    return rows


def _leftover_spikes(heights: np.ndarray, missed: np.ndarray, bad: np.ndarray, scale: float) -> int:
    """How many spikes were missed that stand out of their surroundings: these are touched first.

    Parameters
    ----------
    heights : (ny, nx) ndarray
        As measured, up towards the active stone, mm.
    missed : (ny, nx) ndarray of bool
        True outliers that were not found.
    bad : (ny, nx) ndarray of bool
        All points that say nothing about the surroundings: true outliers, unmeasured ones.
    scale : float
        Robust standard deviation of a point from its surroundings, mm.
    """
    high = np.zeros_like(missed)
    for row, column in np.argwhere(missed):
        around = tuple(slice(max(at - _AROUND, 0), at + _AROUND + 1) for at in (row, column))
        good = heights[around][~bad[around]]
        high[row, column] = (
            good.size == 0 or heights[row, column] - np.median(good) > _STANDS_OUT * scale
        )
    return scipy.ndimage.label(high, np.ones((3, 3)))[1]


def _score_registration(at: xr.Dataset, patch: str, registered: xr.Dataset) -> list[tuple]:
    """Where T1 was found to lie, along the axes of the T0 scan."""
    t0, t1 = at.sel(epoch="T0"), at.sel(epoch="T1")
    turn = np.deg2rad(float(t0.rotation_deg))
    dx, dy = float(t1.x_mm - t0.x_mm), float(t1.y_mm - t0.y_mm)
    shift_x = np.cos(turn) * dx + np.sin(turn) * dy
    shift_y = np.cos(turn) * dy - np.sin(turn) * dx
    missed = np.hypot(
        registered.attrs["shift_x_um"] - shift_x * _UM,
        registered.attrs["shift_y_um"] - shift_y * _UM,
    )
    spacing_um = float(at.y.attrs["spacing"]) * _UM
    return [
        ("registration", name, patch, unit, float(true), float(recovered))
        for name, unit, true, recovered in (
            ("shift_x", "um", shift_x * _UM, registered.attrs["shift_x_um"]),
            ("shift_y", "um", shift_y * _UM, registered.attrs["shift_y_um"]),
            ("offset_error", "points", 0, missed / spacing_um),
            (
                "rotation",
                "deg",
                t1.rotation_deg - t0.rotation_deg,
                registered.attrs["rotation_deg"],
            ),
            ("overlap", "1", at.overlap, registered.attrs["overlap"]),
            ("found", "1", 1, registered.attrs["registration_found"]),
        )
    ]


def _score_wear(
    at: xr.Dataset, patch: str, registered: xr.Dataset, threshold_um: float
) -> list[tuple]:
    """The measured height change, where it is known.

    Traces shallower than the level of detection are neither to be found nor false where they are:
    what was found is held against all wear, and what was to be found is that deeper than
    `threshold_um`.
    """
    change = registered["change"].values * _UM
    depth = at.wear_depth.values * _UM
    _matching(depth, change, f"registered surface of patch {patch}")
    known = np.isfinite(change)
    if not known.any():
        return []
    change, depth = change[known], depth[known]
    loss = registered["loss"].values.astype(bool)[known]
    worn, deep = depth > 0, depth > threshold_um
    error = change + depth
    return [
        ("wear", name, patch, unit, float(true), float(recovered))
        for name, unit, true, recovered in (
            ("change_bias", "um", 0, error.mean()),
            ("change_bias_unworn", "um", 0, _mean(error[~worn])),
            ("change_bias_worn", "um", 0, _mean(error[deep])),
            ("change_rms_error", "um", 0, np.sqrt(np.mean(error**2))),
            ("worn_share", "1", deep.mean(), (loss & (-change > threshold_um)).mean()),
            ("loss_precision", "1", 1, _precision_recall(worn, loss)[0]),
            ("loss_recall", "1", 1, _precision_recall(deep, loss)[1]),
            ("false_loss_share", "1", 0, _mean(loss[~worn])),
            ("mean_depth", "um", depth.mean(), np.where(loss, -change, 0.0).mean()),
        )
    ]


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if values.size else np.nan


def _score_placement(truth: xr.Dataset, found: pd.DataFrame) -> list[tuple]:
    """How far each patch truly lies from its nominal place, and how far it was found to."""
    rows = []
    for patch in map(str, truth.patch.values):
        at = _patch(truth, patch).sel(epoch="T0")
        rows += [
            (
                "placement",
                f"shift_{axis}",
                patch,
                "um",
                float(at[f"{axis}_mm"] - at[f"nominal_{axis}_mm"]) * _UM,
                float(found[f"shift_{axis}_um"][patch]),
            )
            for axis in "xy"
        ]
    return rows


def _score_pressures(truth: xr.Dataset, found: pd.DataFrame, true: pd.Series) -> list[tuple]:
    """Patch pressures, and by how much the place that they were taken at misses the true one."""
    rows = []
    for patch, row in found.iterrows():
        at = _patch(truth, patch).sel(epoch="T0")
        rows += [
            ("coupling", f"place_{axis}", patch, "mm", float(at[f"{axis}_mm"]), row[f"{axis}_mm"])
            for axis in "xy"
        ]
        rows.append(("coupling", "pressure", patch, "MPa", float(true[patch]), row.pressure_MPa))
    return rows


def _precision_recall(true: np.ndarray, found: np.ndarray) -> tuple[float, float]:
    """Of what was found, the share that is true; of what is true, the share that was found.

    NaN where nothing was found, or nothing was there.
    """
    hits = float((true & found).sum())
    return (
        hits / found.sum() if found.any() else np.nan,
        hits / true.sum() if true.any() else np.nan,
    )


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    if a.std() == 0 or b.std() == 0:
        return np.nan
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])
