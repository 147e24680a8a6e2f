"""Scores of the results of each stage against the truth of the synthetic specimen.

Every row is a quantity with its true and its recovered value. Scores of masks (precision, recall)
have 1 as their true value; biases and r.m.s. errors have 0.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.contact import Contact, Interface, contact_at_pressure
from gstlib.surfaces.footprints import PatchPosition, square_of
from gstlib.surfaces.grid import MM_TO_UM, spacing_of
from gstlib.surfaces.leveling import remove_plane

__all__ = ["score_truth", "true_contact"]

# Significant digits of the larger number that are kept in the difference of two numbers.
_ERROR_DIGITS = 7
# A missed spike is compared with the points up to this distance from it. The counterface touches it
# first if it is this many robust standard deviations above them.
_AROUND, _STANDS_OUT = 5, 3.0

# quantity, unit, true, recovered
_Row = tuple[str, str, float, float]


def score_truth(
    truth: xr.Dataset,
    *,
    face: xr.Dataset,
    scans: Mapping[tuple[str, str], xr.Dataset],
    changes: Mapping[str, xr.Dataset],
    placement: pd.DataFrame,
    pressures: pd.DataFrame,
    two_scales: pd.DataFrame | None,
    use: pd.DataFrame | None = None,
) -> pd.DataFrame:
    """Compare the results of the stages with the truth.

    The true pressure of a patch comes from the contact of the whole true surface at the scans'
    resolution. It refers to the true position of the patch at T0.

    Parameters
    ----------
    truth : xarray.Dataset
        From `gstlib.specimen.generate.make_specimen`.
    face : xarray.Dataset
        ``height`` (y, x), mm, of the square and its surroundings on the analysis grid.
    scans, changes : mapping to xarray.Dataset
        Prepared scans by patch and epoch, and height changes by patch; each is looked up once.
    placement, pressures, two_scales, use : pandas.DataFrame
        ``placement.csv``, ``patch_pressures.csv`` and, if they exist, ``two_scales.csv``, which has
        the true pressures, and ``use.csv``.

    Returns
    -------
    pandas.DataFrame
        ``truth.csv``; ``patch`` is empty for the macroscale and the shift common to all patches.
    """
    rows: list[tuple] = []

    def add(stage: str, patch: str, scores: Iterable[_Row]) -> None:
        for quantity, unit, *pair in scores:
            rows.append((stage, quantity, patch, unit, *map(float, pair)))

    surface = truth.macroscale_height.rename(macroscale_y="y", macroscale_x="x")
    square = square_of(face["height"], spacing_of(surface)[0] * len(surface.y))
    add("macroscale", "", _macroscale_scores(_level(surface), _level(square)))
    for patch, epoch in sorted(scans, key=lambda scan: scan[1]):  # T0 first
        prepared = scans[patch, epoch]
        at = truth.sel(patch=patch, epoch=epoch)
        add("preprocessing", patch, _preparation_scores(at, epoch, prepared))
        if epoch == "T0":
            heights = _level(at.height), _level(prepared["height"])
            add("microscale input", patch, _height_scores("T0 ", *heights))
    for patch, change in changes.items():
        at = truth.sel(patch=patch)
        add("registration", patch, _registration_scores(at, change.attrs))
        add("wear", patch, _wear_scores(at, change))
    stated = pressures.set_index("patch")
    for axis in "xy":
        name = f"{axis}_mm"
        off = truth[name].sel(epoch="T0") - stated[name].loc[truth.patch.values]
        recovered = placement[f"shift_{axis}_um"].iloc[-1]
        shift = float(off.mean()) * MM_TO_UM
        add("placement", "", [(f"shared shift_{axis}", "um", shift, recovered)])
    if two_scales is not None:
        of_patches = two_scales.drop_duplicates("patch").set_index("patch")
        true_MPa = of_patches.reference_pressure_MPa
        for patch, recovered in stated.pressure_MPa.items():
            add("coupling", patch, [("pressure", "MPa", true_MPa[patch], recovered)])
    add("use", "", _use_scores(truth.attrs, use))
    columns = "stage quantity patch unit true recovered"
    table = pd.DataFrame(rows, columns=columns.split())
    return table.assign(error=list(map(_error, table.true, table.recovered)))


def true_contact(
    truth: xr.Dataset,
    counterface: xr.DataArray,
    contact: Contact,
    *,
    source: str | Path = "truth",
) -> Contact:
    """The contact of the true face under the load of `contact`, of the measured face."""
    height = truth.face_height.reset_coords(drop=True).rename(face_y="y", face_x="x")
    return contact_at_pressure(
        Interface(height, counterface),
        contact.load,
        modulus=contact.modulus,
        tolerance=contact.tolerance,
        source=source,
    )


def _error(true: float, recovered: float) -> float:
    """Difference of two numbers, without the digits that are only rounding."""
    scale = max(abs(true), abs(recovered))
    if not 0 < scale < math.inf:
        return recovered - true
    return round(recovered - true, _ERROR_DIGITS - 1 - math.floor(math.log10(scale)))


def _level(heights: xr.DataArray) -> np.ndarray:
    """Heights (µm, from mm) without their plane."""
    level, _ = remove_plane(heights.astype(float))
    return level.values * MM_TO_UM


def _height_scores(
    epoch: str, true: np.ndarray, recovered: np.ndarray
) -> Iterator[_Row]:
    """Levelled heights (µm) against the true heights."""
    yield f"{epoch}Sq", "um", true.std(), recovered.std()
    yield f"{epoch}highest", "um", true.max(), recovered.max()
    yield f"{epoch}height_rms_error", "um", 0, (recovered - true).std()


def _macroscale_scores(true: np.ndarray, heights: np.ndarray) -> Iterator[_Row]:
    """The gridded mesh against the true macroscale surface, both levelled, µm."""
    yield from _height_scores("", true, heights)
    flat = heights.std() == 0 or true.std() == 0
    correlation = math.nan if flat else np.corrcoef(true.ravel(), heights.ravel())[0, 1]
    yield "height_correlation", "1", 1, correlation


def _preparation_scores(at: xr.Dataset, epoch: str, scan: xr.Dataset) -> Iterator[_Row]:
    """A prepared scan: the removed tilt, the filled points, the detected outliers."""
    outlier = at.outlier.values
    unmeasured = at.unmeasured.values
    recovered = scan["outlier"].values.astype(bool)
    yield f"{epoch} tilt_x", "mrad", at.plane_x_mrad, scan.attrs["tilt_x_mrad"]
    yield f"{epoch} tilt_y", "mrad", at.plane_y_mrad, scan.attrs["tilt_y_mrad"]
    yield f"{epoch} filled", "1", unmeasured.sum(), scan["filled"].values.sum()
    yield f"{epoch} outlier_precision", "1", 1, _mean(outlier[recovered])
    yield f"{epoch} outlier_recall", "1", 1, _mean(recovered[outlier])
    scale_um = scan.attrs.get("outlier_scale_um", math.nan)
    if math.isnan(scale_um):  # the window rule has no scale of the surroundings
        return
    # Missed spikes that are above the well-measured points around them, and so touch first.
    heights = scan["measured"].values
    high = np.zeros_like(outlier)
    least = _STANDS_OUT * scale_um / MM_TO_UM
    is_good = ~(outlier | unmeasured)
    for missed in zip(*np.nonzero(outlier & ~recovered), strict=True):
        around = tuple(slice(max(i - _AROUND, 0), i + _AROUND + 1) for i in missed)
        good = heights[around][is_good[around]]
        high[missed] = not good.size or heights[missed] - np.median(good) > least
    _, spikes = scipy.ndimage.label(high, np.ones((3, 3)))
    yield f"{epoch} leftover_spikes", "1", 0, spikes


def _use_scores(truth: Mapping[str, float], use: pd.DataFrame | None) -> Iterator[_Row]:
    """The load case, if a law wore the tool and the study inferred it."""
    if use is None or "use_x_mm" not in truth:
        return
    recovered = use.set_index("parameter")["posterior_mean"]
    for name, true in (
        ("load_point_x", "x"),
        ("load_point_y", "y"),
        ("radius", "radius"),
    ):
        if np.isfinite(recovered.get(name, math.nan)):
            yield name, "mm", truth[f"use_{true}_mm"], recovered[name]


def _registration_scores(at: xr.Dataset, recovered: dict) -> Iterator[_Row]:
    """The recovered position of T1, along the axes of the T0 scan."""
    t0, t1 = (PatchPosition.from_dataset(at.sel(epoch=epoch)) for epoch in ("T0", "T1"))
    shift_y, shift_x = t0.seen(t1.y_mm, t1.x_mm)
    for axis, shift in (("x", shift_x), ("y", shift_y)):
        yield f"shift_{axis}", "um", shift * MM_TO_UM, recovered[f"shift_{axis}_um"]
    turn = t1.rotation_deg - t0.rotation_deg
    yield "rotation", "deg", turn, recovered["rotation_deg"]
    yield "overlap", "1", at.overlap, recovered["overlap"]


def _wear_scores(at: xr.Dataset, registered: xr.Dataset) -> Iterator[_Row]:
    """The measured height change, if it is known.

    Wear below the threshold need not be detected; if it is, it does not count as a false loss.
    Precision counts all wear, recall only the deeper wear.
    """
    threshold_um = at.attrs["wear_threshold_um"]
    change = registered["change"].values * MM_TO_UM
    depth = at.wear_depth.values * MM_TO_UM
    is_measured = np.isfinite(change)
    if not is_measured.any():
        return
    change = change[is_measured]
    depth = depth[is_measured]
    loss = registered["loss"].values.astype(bool)[is_measured]
    worn = depth > 0
    deep = depth > threshold_um
    error = change + depth
    yield "change_bias_unworn", "um", 0, _mean(error[~worn])
    yield "change_bias_worn", "um", 0, _mean(error[deep])
    yield "change_rms_error", "um", 0, np.sqrt(np.mean(error**2))
    yield "worn_fraction", "1", deep.mean(), (loss & (-change > threshold_um)).mean()
    yield "loss_precision", "1", 1, _mean(worn[loss])
    yield "loss_recall", "1", 1, _mean(loss[deep])
    yield "false_loss_fraction", "1", 0, _mean(loss[~worn])
    yield "mean_depth", "um", depth.mean(), np.where(loss, -change, 0.0).mean()


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if values.size else math.nan
