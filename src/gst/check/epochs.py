"""Does each T1 show its patch, and after use? What a study of coarser scans says, in words."""

import itertools
import logging
from collections.abc import Iterator

import numpy as np
import pandas as pd
import xarray as xr

from gst.check.sliding import sides_of
from gst.config.patches import at_epoch
from gstlib.change.form import form_warning
from gstlib.change.registration import Registration, is_one_way, register
from gstlib.change.selection import exchanged_epochs, other_heights, rise_warnings
from gstlib.coupling.orientations import AS_GIVEN, LOOKS, ORIENTATIONS, oriented
from gstlib.errors import FaultError, GstError, InputError
from gstlib.preprocess.scans import mould_of
from gstlib.study import Study
from gstlib.surfaces.filtering import low_pass
from gstlib.surfaces.grid import make_surface, spacing_of

_log = logging.getLogger(__name__)

# T1 that other software has laid on T0 is off by half a point at most: of a scan four times as fine
# as the coarse one, with the error of its registration, a hundredth.
_CO_LOCATED = 0.15
# Registering a scan takes a tenth of a second.
_MOST_TRIED = 100
UNMATCHED = "unmatched"  # the fault's name, as which a config accepts it
# Of so many T1 that do not match as they are, it is tried whether they match if laid otherwise.
_MOST_LAID = 4
# Among so many trials, an unrelated scan is found by chance: its correlation, times the root of the
# overlap, seldom exceeds 0.3.
_SURE_MATCH = 0.5
# ASSUME: T1 of another patch. A T1 that shows at least 60 % of the T0 of another patch belongs to
# that patch. Reason: Scans of different patches overlap less.
_MOSTLY = 0.6
# Long waves that may have been removed from a scan: those longer than these shares of its side.
_CUTS = 1 / 4, 1 / 13
# ASSUME: Filtered long waves. Two scans may match in their short waves alone. If the long waves of
# one have less than 0.3 times the height of the other's, a filter removed them. Reason: Wear leaves
# more of them (see `gstlib.change.form`).
_MISSING = 0.3


def epochs_on_each_other(study: Study) -> tuple[list[GstError], str]:
    """Problems of scans after use, and in words the shifts of the others.

    Other oddities are logged as warnings. A T1 that cannot be registered leaves the study.
    """
    problems: list[GstError] = [*_unregistered(study)]
    table = study.registration
    unlike = [*_unlike_their_patch(study, table)]
    named = {patch for fault in unlike for patch in fault.patches}
    problems += [*unlike, *other_heights(table[~table.patch.isin(named)])]
    problems += exchanged_epochs(table)
    # that much may be noise is no news of scans so coarse
    for doubt in rise_warnings(table, max_gain_to_loss_ratio=np.inf):
        _log.warning("%s", doubt)
    return problems, _shifts(study, table[table.found.astype(bool)])


def _unregistered(study: Study) -> Iterator[InputError]:
    """Why a T1 cannot be registered, by its file; without these, the study has a table."""
    files = study.patches.set_index("patch").t1
    for patch in list(study.worn):
        try:
            study.changes[patch]
        except InputError as error:
            study.worn.remove(patch)
            yield error.about(files[patch], f"patch {patch}: {error.problem}")


def _unlike_their_patch(study: Study, table: pd.DataFrame) -> Iterator[FaultError]:
    """Faults of the T1 that match otherwise, or nowhere if none matches; warnings of the others."""
    rows = study.patches.set_index("patch")
    lost = table.patch[~table.found.astype(bool)].tolist()
    filtered, doubted = set(), set()
    for row in table.itertuples():
        patch, doubt = row.patch, form_warning(*_heights(study, row.patch))
        if doubt is None and (removed := _without_long_waves(study, patch)):
            filtered.add(patch)
            epoch, other, length_um = removed
            yield FaultError(
                UNMATCHED,
                f"{rows.loc[patch, epoch.lower()]} ({at_epoch(patch, epoch)})",
                f"it fits {other} only in waves shorter than {length_um:g} µm, as after a filter "
                "that removes the longer ones",
                "Export both scans with no more than a plane removed.",
                [patch],
            )
        elif not row.found and is_one_way(
            row.detail_correlation, row.slope_correlation
        ):
            doubt = doubt or (
                "its striae match T0, but detail does not fix the position along them. Scan a "
                "larger area, or one with a pit or a scar"
            )
        if doubt:
            doubted.add(patch)
            _log.warning("%s: patch %s: %s", rows.t1[patch], patch, doubt)
    lost = [patch for patch in lost if patch not in filtered]
    laid = _laid_otherwise(study, [patch for patch in lost if patch not in doubted])
    for look, patches in laid.items():
        lost = [patch for patch in lost if patch not in patches]
        who = f"T1 of patch {', '.join(patches)} match{'es' * (len(patches) == 1)} T0"
        if len(patches) == len(study.worn) > 1:
            who = f"all {len(patches)} T1 match their T0"
        remedy = (
            "scans.mould and flip apply to both epochs. Export T1 in the orientation of T0, or "
            "scan both epochs on the stone, or both on moulds."
        )
        files = ", ".join(rows.t1[patches])
        yield FaultError(UNMATCHED, files, f"{who} only {look}", remedy, patches)
    others = _other_patches(study, lost)
    for patch, other in others.items():
        problem = (
            f"as T1 of patch {patch}, it is not found on {rows.t0[patch]}, but on T0 of patch "
            f"{other}"
        )
        remedy = "Correct t1 in the patch table."
        yield FaultError(UNMATCHED, rows.t1[patch], problem, remedy, [patch])
    lost = [patch for patch in lost if patch not in others]
    remedy = (
        "Check the names in the patch table and registration.maximum_shift_mm, and that no form "
        "was taken out of one of the two."
    )
    if lost and len(lost) == len(table):
        problem = f"none of the {len(lost)} T1 scans matches its T0"
        yield FaultError(UNMATCHED, ", ".join(rows.t1[lost]), problem, remedy)
    elif lost := [patch for patch in lost if patch not in doubted]:
        every = "its T1 is" if len(lost) == 1 else "their T1 are"
        problem = f"patch {', '.join(lost)}: {every} not found on T0"
        _log.warning("%s: %s. %s", ", ".join(rows.t1[lost]), problem, remedy)


def _heights(study: Study, patch: str) -> tuple[xr.DataArray, xr.DataArray]:
    """The prepared scans of a patch before and after use."""
    return study.prepared[patch, "T0"].height, study.prepared[patch, "T1"].height


def _without_long_waves(study: Study, patch: str) -> tuple[str, str, float] | None:
    """The epoch whose long waves were removed, the other, and their length (µm), if that is so.

    Then the short waves of both scans lie on each other, as high as they may be.
    """
    scans = dict(zip(("T0", "T1"), _heights(study, patch), strict=True))
    spacing, side = spacing_of(scans["T0"]), min(sides_of(scans["T0"]))
    for cut in _CUTS:
        long, short = {}, {}
        for epoch, scan in scans.items():
            long[epoch] = low_pass(scan.values, spacing, cut * side)
            short[epoch] = scan - long[epoch]
        for one, other in itertools.permutations(scans):
            lower, apart = (_times(waves[one], waves[other]) for waves in (long, short))
            # polish lowers short waves alone, and another unit both alike
            if max(lower, lower / apart) < _MISSING:
                alike = short["T1"] / _times(short["T1"], short["T0"])
                if _registered(study, short["T0"], alike):
                    return one, other, float(f"{cut * side * 1e3:.2g}")
    return None


def _times(one: np.ndarray | xr.DataArray, other: np.ndarray | xr.DataArray) -> float:
    """Ratio of the wave heights (r.m.s.) of one scan and the other."""
    return float(one.std() / max(other.std(), np.finfo(float).tiny))


def _laid_otherwise(study: Study, patches: list[str]) -> dict[str, list[str]]:
    """Patches whose T1 matches its T0 if its file is laid otherwise, by one of the `LOOKS`."""
    laid: dict[str, list[str]] = {}
    rows, mould = study.patches.set_index("patch"), study.config["scans"]["mould"]
    for number, patch in enumerate(patches):
        before, after = _heights(study, patch)
        flip = mould_of(mould, rows.loc[patch].get("flip", ""))["flip"]
        matches = {}
        # T1 as it is has been tried
        for look in LOOKS[1:] if number < _MOST_LAID else laid:
            match = _registered(study, before, _laid(after, look, flip is not None))
            if match is not None:
                matches[look] = match.detail_correlation * match.overlap**0.5
        best = max(matches, key=matches.__getitem__, default="")
        if best and matches[best] > _SURE_MATCH:
            laid.setdefault(best, []).append(patch)
    return laid


def _laid(surface: xr.DataArray, look: str, is_flipped: bool) -> xr.DataArray:
    """The surface with one of the `LOOKS` in its file, which may have been flipped since."""
    orientation = look.removeprefix("inverted").removeprefix(" and ") or AS_GIVEN
    _, turn = ORIENTATIONS[orientation]
    heights, spacing = oriented(surface.values, orientation), spacing_of(surface)
    if is_flipped and turn % 180:  # which reverses the sense of turns
        heights = np.rot90(heights, 2)
    return make_surface(
        -heights if look.startswith("inverted") else heights,
        spacing[::-1] if turn % 180 else spacing,
    )


def _other_patches(study: Study, lost: list[str]) -> dict[str, str]:
    """By patch, the first other one whose T0 shows most of its T1.

    A T1 that lies between two patches shows a part of the other, too, and is no mistake of names.
    """
    pairs = itertools.product(lost, study.patches.patch)
    others: dict[str, str] = {}
    for patch, other in itertools.islice(pairs, _MOST_TRIED):
        if patch not in others and patch != other:
            before, after = study.prepared[other, "T0"], study.prepared[patch, "T1"]
            match = _registered(study, before.height, after.height)
            if match is not None and match.overlap >= _MOSTLY:
                others[patch] = other
    return others


def _registered(
    study: Study, before: xr.DataArray, after: xr.DataArray
) -> Registration | None:
    """Where a scan is found on another one; None if it is not found."""
    shift_mm = study.config["registration"]["maximum_shift_mm"]
    try:
        match = register(before, after, maximum_shift_mm=shift_mm)
    except InputError:  # of other spacings
        return None
    return match if match.is_reliable else None


def _shifts(study: Study, registered: pd.DataFrame) -> str:
    """How far each T1 that was found is shifted."""
    if registered.empty:
        return ""
    shifts_um = np.hypot(registered.shift_x_um, registered.shift_y_um)
    points_mm = [
        max(spacing_of(study.prepared[patch, "T0"])) for patch in registered.patch
    ]
    together = int((shifts_um < 1e3 * _CO_LOCATED * np.array(points_mm)).sum())
    count, most = len(registered), float(f"{shifts_um.max():.2g}")
    line = f"found on {count} patches, shifted by up to {most:g} µm"
    if together:
        which = "all" if together == count else f"{together} of them"
        line += f"; {which} co-located already (shifted by less than half a point)"
    return line
