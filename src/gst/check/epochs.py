"""Does each T1 show its patch, and after use? What a study of coarser scans says, in words."""

import itertools
import logging
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from gst.check.sliding import sides_of
from gst.config.patches import at_epoch
from gstlib.change.form import form_warning
from gstlib.change.registration import Registration, is_one_way, register
from gstlib.change.selection import exchanged_epochs, other_heights, rise_warnings
from gstlib.coupling.orientations import AS_GIVEN, ORIENTATIONS, oriented
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
# Among so many trials, an unrelated scan is found by chance: `_match` seldom exceeds 0.3.
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


class _Way(NamedTuple):
    """How a T1 lies as it should not."""

    is_inverted: bool
    orientation: str  # one of `ORIENTATIONS`

    def __str__(self) -> str:
        inverted = ["with the sign of its heights changed"] * self.is_inverted
        return ", ".join(inverted + [self.orientation] * (self.orientation != AS_GIVEN))

    def lay(self, surface: xr.DataArray, *, is_flipped: bool = False) -> xr.DataArray:
        """The surface, laid so; or laid so in its file, if it was flipped since."""
        is_reversed, turn = ORIENTATIONS[self.orientation]
        name = self.orientation
        if is_flipped and turn != 180:  # which reverses the sense of turns
            name = next(
                each
                for each in ORIENTATIONS
                if ORIENTATIONS[each] == (is_reversed, -turn)
            )
        heights, spacing = oriented(surface.values, name), spacing_of(surface)
        return make_surface(
            -heights if self.is_inverted else heights,
            spacing[::-1] if turn % 180 else spacing,
        )


# T1 as it is has been tried.
_WAYS = [_Way(*way) for way in itertools.product((False, True), ORIENTATIONS)][1:]


def _heights(study: Study, patch: str) -> tuple[xr.DataArray, xr.DataArray]:
    """The prepared scans of a patch before and after use."""
    return study.prepared[patch, "T0"].height, study.prepared[patch, "T1"].height


def _unlike_their_patch(study: Study, table: pd.DataFrame) -> Iterator[FaultError]:
    """Faults of the T1 that match otherwise, or nowhere if none matches; warnings of the others."""
    rows = study.patches.set_index("patch")
    shift_mm = study.config["registration"]["maximum_shift_mm"]
    doubts: dict[str, str] = {}
    lost = table.patch[~table.found.astype(bool)].tolist()
    for row in table.itertuples():
        patch, scans = row.patch, _heights(study, row.patch)
        if doubt := form_warning(*scans):
            doubts[patch] = doubt
        elif removed := _without_long_waves(*scans, shift_mm):
            lost = [other for other in lost if other != patch]
            yield _filtered(rows, patch, *removed)
        elif not row.found and is_one_way(
            row.detail_correlation, row.slope_correlation
        ):
            doubts[patch] = (
                "its striae match T0, but detail does not fix the position along them. Scan a "
                "larger area, or one with a pit or a scar"
            )
        if patch in doubts:
            _log.warning("%s: patch %s: %s", rows.t1[patch], patch, doubts[patch])
    without_doubt = [patch for patch in lost if patch not in doubts]
    for way, patches in _laid_otherwise(study, without_doubt, shift_mm).items():
        lost = [patch for patch in lost if patch not in patches]
        yield _laid_fault(rows.t1, patches, str(way), len(study.worn))
    others = _other_patches(study, lost, shift_mm)
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
    elif lost := [patch for patch in lost if patch not in doubts]:
        every = "its T1 is" if len(lost) == 1 else "their T1 are"
        problem = f"patch {', '.join(lost)}: {every} not found on T0"
        _log.warning("%s: %s. %s", ", ".join(rows.t1[lost]), problem, remedy)


def _filtered(
    rows: pd.DataFrame, patch: str, epoch: str, length_mm: float
) -> FaultError:
    """The fault of a patch, one of whose scans has lost its long waves to a filter."""
    other, length_um = "T0" if epoch == "T1" else "T1", float(f"{length_mm * 1e3:.2g}")
    return FaultError(
        UNMATCHED,
        f"{rows.loc[patch, epoch.lower()]} ({at_epoch(patch, epoch)})",
        f"it fits {other} only in waves shorter than {length_um:g} µm, as after a filter that "
        "removes the longer ones",
        "Export both scans with no more than a plane removed.",
        [patch],
    )


def _without_long_waves(
    before: xr.DataArray, after: xr.DataArray, maximum_shift_mm: float
) -> tuple[str, float] | None:
    """The epoch whose long waves were removed, and how long these are (mm), if that is so.

    Then the short waves of both scans lie on each other, as high as they may be.
    """
    scans, spacing = (before, after), spacing_of(before)
    side = min(sides_of(before))
    for cut in _CUTS:
        long = [low_pass(scan.values, spacing, cut * side) for scan in scans]
        short = [
            scan.copy(data=scan.values - waves)
            for scan, waves in zip(scans, long, strict=True)
        ]
        for epoch, (one, other) in {"T0": (0, 1), "T1": (1, 0)}.items():
            lower, apart = (_times(waves[one], waves[other]) for waves in (long, short))
            # polish lowers short waves alone, and another unit both alike
            if max(lower, lower / apart) < _MISSING:
                alike = short[1] / _times(short[1], short[0])
                if _match(short[0], alike, maximum_shift_mm):
                    return epoch, cut * side
    return None


def _times(one: np.ndarray | xr.DataArray, other: np.ndarray | xr.DataArray) -> float:
    """Ratio of the wave heights (r.m.s.) of one scan and the other."""
    return float(one.std() / max(other.std(), np.finfo(float).tiny))


def _laid_otherwise(
    study: Study, patches: list[str], maximum_shift_mm: float
) -> dict[_Way, list[str]]:
    """Patches whose T1 matches its T0 if its file is laid otherwise, by how it then lies."""
    laid: dict[_Way, list[str]] = {}
    rows, mould = study.patches.set_index("patch"), study.config["scans"]["mould"]
    for number, patch in enumerate(patches):
        before, after = _heights(study, patch)
        is_flipped = (
            mould_of(mould, rows.loc[patch].get("flip", ""))["flip"] is not None
        )
        matches = {
            way: _match(before, way.lay(after, is_flipped=is_flipped), maximum_shift_mm)
            for way in (_WAYS if number < _MOST_LAID else laid)
        }
        best = max(matches, key=matches.__getitem__, default=None)
        if best is not None and matches[best] > _SURE_MATCH:
            laid.setdefault(best, []).append(patch)
    return laid


def _laid_fault(
    files: pd.Series, patches: list[str], way: str, count: int
) -> FaultError:
    """The fault of T1 that match if they are laid otherwise; `count` is the number of all T1."""
    who = f"T1 of patch {', '.join(patches)} match{'es' * (len(patches) == 1)} T0"
    if len(patches) == count > 1:
        who = f"all {count} T1 match their T0"
    remedy = (
        "scans.mould and flip apply to both epochs. Export T1 in the orientation of T0, or scan "
        "both epochs on the stone, or both on moulds."
    )
    return FaultError(
        UNMATCHED, ", ".join(files[patches]), f"{who} only {way}", remedy, patches
    )


def _other_patches(
    study: Study, lost: list[str], maximum_shift_mm: float
) -> dict[str, str]:
    """By patch, the first other one whose T0 shows most of its T1.

    A T1 that lies between two patches shows a part of the other, too, and is no mistake of names.
    """
    pairs = (
        (patch, other)
        for patch in lost
        for other in study.patches.patch
        if other != patch
    )
    others: dict[str, str] = {}
    for patch, other in itertools.islice(pairs, _MOST_TRIED):
        if patch not in others:
            before, after = study.prepared[other, "T0"], study.prepared[patch, "T1"]
            match = _registered(before.height, after.height, maximum_shift_mm)
            if match is not None and match.overlap >= _MOSTLY:
                others[patch] = other
    return others


def _match(before: xr.DataArray, after: xr.DataArray, maximum_shift_mm: float) -> float:
    """How well a scan matches another one on which it is found; 0 if it is not found.

    It is the correlation of the detail, times the root of the overlap.
    """
    match = _registered(before, after, maximum_shift_mm)
    return 0.0 if match is None else match.detail_correlation * match.overlap**0.5


def _registered(
    before: xr.DataArray, after: xr.DataArray, maximum_shift_mm: float
) -> Registration | None:
    """Where a scan is found on another one; None if it is not found."""
    try:
        match = register(before, after, maximum_shift_mm=maximum_shift_mm)
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
