"""Does each T1 show its patch, and after use? What a study of coarser scans says, in words."""

import logging
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gst.patches import at_epoch
from gstlib.change.form import form_warning
from gstlib.change.registration import register
from gstlib.change.selection import exchanged_epochs, rise_warnings
from gstlib.coupling.placement import ORIENTATIONS, oriented
from gstlib.errors import FaultError, GstError, InputError
from gstlib.study import Study
from gstlib.surfaces.filtering import low_pass
from gstlib.surfaces.grid import make_surface, spacing_of

__all__ = ["EPOCHS", "epochs_on_each_other", "found_as"]

_log = logging.getLogger(__name__)

EPOCHS = "epochs"  # the fault's name, as which a config accepts it
# T1 that other software has laid on T0 is off by half a point at most: of a scan four times as fine
# as the coarse one, with the error of its registration, a hundredth.
_CO_LOCATED = 0.15
# Registering a scan takes a tenth of a second.
_MOST_TRIED = 100
# Long waves that may have been removed from a scan: those longer than these shares of its side.
_CUTS = 1 / 4, 1 / 13
# ASSUME: if two scans match in their short waves alone, and one has less than this share of the
# other's long waves, a filter removed them. Wear leaves more of them (see `gstlib.change.form`).
_MISSING = 0.3
_FLAT_MM = 1e-12


def epochs_on_each_other(study: Study) -> tuple[list[GstError], str]:
    """What is wrong with scans after use, and in words how far the others are shifted.

    What else is odd is logged as a warning. A T1 that cannot be registered leaves the study.
    """
    problems: list[GstError] = [*_unregistered(study)]
    table = study.registration
    problems += _unlike_their_patch(study, table)
    problems += exchanged_epochs(table)
    # that much may be noise is no news of scans so coarse
    for odd in rise_warnings(table, max_noise_fraction=np.inf):
        _log.warning("%s", odd)
    return problems, _shifts(study, table[table.found.astype(bool)])


def found_as(before: xr.DataArray, after: xr.DataArray, *, maximum_shift_mm: float) -> str:
    """The orientation in which a scan is found on an earlier one; empty if there is none.

    Both are level (mm), and the later scan is not found as it is.
    """
    dy, dx = spacing_of(after)
    for name, (_, turn) in list(ORIENTATIONS.items())[1:]:
        steps = (dx, dy) if turn % 180 else (dy, dx)
        turned = make_surface(oriented(after.values, name), steps)
        if _is_found(before, turned, maximum_shift_mm=maximum_shift_mm):
            return name
    return ""


def _is_found(before: xr.DataArray, after: xr.DataArray, **settings: float) -> bool:
    try:
        return register(before, after, **settings).found
    except InputError:  # another spacing, or other heights
        return False


def _unregistered(study: Study) -> Iterator[InputError]:
    """Why a T1 cannot be registered, by its file; without these, the study has a table."""
    rows = {row.patch: row for row in study.patches.itertuples()}
    for patch in list(study.worn):
        try:
            study.changes[patch]
        except InputError as error:
            study.worn.remove(patch)
            scans = [study.prepared[patch, epoch].height for epoch in ("T0", "T1")]
            if removed := _without_long_waves(*scans, **study.config["registration"]):
                yield _filtered(rows[patch], removed)
            else:
                problem = f"patch {patch}: {error.problem}"
                yield InputError(rows[patch].t1, problem, error.remedy)


def _unlike_their_patch(study: Study, table: pd.DataFrame) -> Iterator[InputError]:
    """Why a T1 is not on its T0, and on which it is; warnings of others, or without their form."""
    found, tried = table.set_index("patch").found, 0
    for row in study.patches[study.patches.patch.isin(found.index)].itertuples():
        scans = [study.prepared[row.patch, epoch].height for epoch in ("T0", "T1")]
        doubt = form_warning(*scans)
        if found[row.patch]:
            removed = _without_long_waves(*scans, **study.config["registration"])
            if doubt:
                _log.warning("%s: patch %s: %s", row.t1, row.patch, doubt)
            elif removed:
                _log.warning("%s", InputError.__str__(_filtered(row, removed)))
            continue
        reason = _reason(study, row, scans, most=_MOST_TRIED - tried)
        tried += len(_CUTS) + len(ORIENTATIONS) + len(study.patches)
        if reason:
            yield reason
            continue
        remedy = (
            "check both names in the patch table, registration.maximum_shift_mm, and that no "
            "form was taken out of one of the two"
        )
        _log.warning(
            "%s: as T1 of patch %s, it is not found on %s: %s",
            row.t1,
            row.patch,
            row.t0,
            doubt or remedy,
        )


def _reason(
    study: Study, row: Any, scans: Sequence[xr.DataArray], *, most: int
) -> InputError | None:
    """Why a T1 is not found on its T0, by at `most` so many registrations; None if none tells."""
    settings = study.config["registration"]
    most -= len(_CUTS) + len(ORIENTATIONS)
    if most < 0:
        return None
    # a form that is missing is told by a warning, whether T1 is found or not
    if not form_warning(*scans) and (removed := _without_long_waves(*scans, **settings)):
        return _filtered(row, removed)
    if orientation := found_as(*scans, **settings):
        return _turned(row, orientation)
    others = [name for name in study.patches.patch if name != row.patch]
    for other in others[:most]:
        if _is_found(study.prepared[other, "T0"].height, scans[1], **settings):
            problem = (
                f"as T1 of patch {row.patch}, it is not found on {row.t0}, but on T0 of patch "
                f"{other}"
            )
            return InputError(row.t1, problem, "Correct t1 in the patch table.")
    return None


def _without_long_waves(
    before: xr.DataArray, after: xr.DataArray, **settings: float
) -> tuple[str, float] | None:
    """The epoch whose long waves were removed, and how long these are (mm), if that is so.

    Then the short waves of both scans lie on each other, as high as they may be.
    """
    scans, spacing = (before, after), spacing_of(before)
    side = min(n * step for n, step in zip(before.shape, spacing, strict=True))
    for cut in _CUTS:
        long = [low_pass(scan.values, spacing, cut * side) for scan in scans]
        short = [scan.copy(data=scan.values - w) for scan, w in zip(scans, long, strict=True)]
        for epoch, (one, other) in {"T0": (0, 1), "T1": (1, 0)}.items():
            lower, apart = _times(long, one, other), _times(short, one, other)
            # polish lowers short waves alone, and another unit both alike
            if max(lower, lower / apart) < _MISSING:
                alike = short[1] / _times(short, 1, 0)
                if _is_found(short[0], alike, **settings):
                    return epoch, cut * side
    return None


def _times(waves: Sequence[Any], one: int, other: int) -> float:
    """How many times as high (r.m.s.) the waves of one scan are as those of the other."""
    heights = (max(float(waves[n].std()), _FLAT_MM) for n in (one, other))
    return next(heights) / next(heights)


def _filtered(row: Any, removed: tuple[str, float]) -> FaultError:
    """One of the two scans of a patch without its long waves."""
    epoch, length_mm = removed
    other, file = ("T0", row.t1) if epoch == "T1" else ("T1", row.t0)
    length_um = float(f"{length_mm * 1e3:.2g}")
    return FaultError(
        EPOCHS,
        f"{file} ({at_epoch(row.patch, epoch)})",
        f"it fits {other} only in waves shorter than {length_um:g} µm, as after a filter that "
        "removes the longer ones",
        "Export both scans with no more than a plane removed.",
    )


def _turned(row: Any, orientation: str) -> FaultError:
    return FaultError(
        EPOCHS,
        f"{row.t1} ({at_epoch(row.patch, 'T1')})",
        f"it is found on T0 only if it is {orientation}",
        "Turn or mirror this map so that it lies as T0 does, and export it again; or leave t1 "
        "empty in the patch table.",
    )


def _shifts(study: Study, found: pd.DataFrame) -> str:
    """How far each T1 that was found is shifted."""
    if found.empty:
        return ""
    shifts_um = np.hypot(found.shift_x_um, found.shift_y_um)
    points_um = [1e3 * max(spacing_of(study.prepared[patch, "T0"])) for patch in found.patch]
    together = int((shifts_um < _CO_LOCATED * np.array(points_um)).sum())
    most = float(f"{shifts_um.max():.2g}")
    said = f"found on {len(found)} patches, shifted by up to {most:g} µm"
    if together:
        which = "all" if together == len(found) else f"{together} of them"
        said += f"; {which} co-located already (shifted by less than half a point)"
    return said
