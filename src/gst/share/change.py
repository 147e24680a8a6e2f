"""Two scans of one surface compared, without a study: the loss and the gain of height."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from gstlib.change.change import estimate_detection_limit, register_patch, wear_summary
from gstlib.change.registration import is_other
from gstlib.errors import InputError
from gstlib.io.scans import read_scan
from gstlib.preprocess.scans import prepare_scan
from gstlib.settings import Settings
from gstlib.surfaces.grid import spacing_of

# Points that were not measured are not compared, so that many of them do no harm.
_MOST_UNMEASURED = 0.9
# T1 is looked for as far as it covers a quarter of T0, however large the scans are.
_LARGEST_SHIFT = 0.75
# Share of T0 below which the user is told that T1 misses the rest.
_LEAST_COVERED = 0.75


def compare_scans(
    t0: Path,
    t1: Path,
    repeat: Path | None = None,
    *,
    unit: str | None = None,
    spacing_um: float | None = None,
    mould: bool = False,
) -> tuple[xr.DataArray, xr.Dataset]:
    """Register T1 to T0 and take the height change, with the default settings of a study.

    `repeat` is a second scan of the surface at T0, without use between the two: the detection limit
    then comes from it, and otherwise from the unchanged part of T1. `unit` and `spacing_um` are as
    in `gstlib.io.scans.read_scan`; the heights of a `mould` are turned over.

    The result is the prepared T0 (y, x), mm, and the dataset of
    `gstlib.change.change.register_patch`. Raises an `InputError` if T1 is not found on T0 or has
    heights in another unit, or if the repeat does not show the surface of T0.
    """
    settings = Settings()
    before, after = (_prepared(path, unit, spacing_um, mould) for path in (t0, t1))
    sides = np.multiply(spacing_of(before.height), before.height.shape)
    search: dict[str, Any] = {
        "maximum_shift_mm": _LARGEST_SHIFT * float(max(sides)),
        "minimum_cluster_points": settings.detection.minimum_cluster_points,
    }
    detection = None
    if repeat is not None:
        again = {repeat.name: _prepared(repeat, unit, spacing_um, mould)}
        detection = estimate_detection_limit({repeat.name: before}, again, **search)
        if detection is None:
            problem = (
                f"does not show the surface of {t0.name}, scanned again without use"
            )
            raise InputError(repeat, problem, "Give another --repeat, or leave it out.")
    change = register_patch(before, after, patch=t1.name, detection=detection, **search)
    if not change.attrs["registration_found"]:
        problem = f"was not found on {t0}: the same details do not appear in both"
        raise InputError(
            t1, problem, "Look at both with `gst inspect --pictures FOLDER`."
        )
    if is_other(ratio := change.attrs["dale_depth_ratio"]):
        problem = (
            f"shows the surface of {t0}, but with dales {ratio:.3g} times as deep, "
            "which no wear causes"
        )
        remedy = (
            "Export both scans in one unit and with one height calibration. --unit gives "
            "the unit of files that state none."
        )
        raise InputError(t1, problem, remedy)
    return before["height"], change


def _prepared(
    path: Path, unit: str | None, spacing_um: float | None, mould: bool
) -> xr.Dataset:
    """A scan, cleaned and level, as a study prepares it."""
    raw = read_scan(path, unit=unit, spacing_um=spacing_um)
    return prepare_scan(raw, mould_invert=mould, maximum_unmeasured=_MOST_UNMEASURED)


def describe_change(change: xr.Dataset) -> Iterator[str]:
    """The result of `compare_scans` in lines of text."""
    facts, extent = change.attrs, wear_summary(change)
    yield (
        f"position    x {facts['shift_x_um']:.2f} ± {facts['shift_x_error_um']:.2g} µm, "
        f"y {facts['shift_y_um']:.2f} ± {facts['shift_y_error_um']:.2g} µm, "
        f"turned by {facts['rotation_deg']:.2f}°"
    )
    yield (
        f"overlap     {100 * facts['overlap']:.0f} % of T0, "
        f"correlation {facts['correlation']:.3f}"
    )
    if facts["overlap"] < _LEAST_COVERED:
        yield (
            "NOTE: the change of the rest of T0 is not measured. Scan the same area at T0 and T1 "
            "if you need all of it"
        )
    if not facts["known_fraction"]:
        yield "change      none, because hardly any point has a height of its own in both scans"
        return
    source = (
        "the repeat" if facts["detection"] == "repeat" else "the unchanged part of T1"
    )
    yield f"detectable  more than {facts['level_of_detection_um']:.3g} µm, from {source}"
    yield (
        f"loss        {100 * extent['loss_fraction']:.2g} % of the area, "
        f"{extent['loss_volume_um3']:.4g} µm³, mean depth {extent['mean_wear_depth_um']:.3g} µm"
    )
    yield f"gain        {100 * extent['gain_fraction']:.2g} % of the area"
    ratio = extent["gain_to_loss_ratio"]
    if extent["gain_fraction"] > extent["loss_fraction"]:
        yield (
            "NOTE: more of the area rose than fell. Give --mould if the scans show moulds, and "
            "check that T0 is the earlier scan"
        )
    elif ratio > Settings().validation.max_gain_to_loss_ratio:
        yield (
            f"NOTE: the area that rose is {ratio:.2f} times the area that fell, so the loss may "
            "be noise"
        )
