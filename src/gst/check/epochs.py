"""Does each T1 show its patch, and after use? What a study of coarser scans says, in words."""

import itertools
import logging
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from gst.config.patches import at_epoch
from gstlib.change.form import form_warning
from gstlib.change.registration import Registration, is_one_way, register
from gstlib.change.selection import exchanged_epochs, other_heights, rise_warnings
from gstlib.coupling.placement import AS_GIVEN, ORIENTATIONS, oriented
from gstlib.errors import FaultError, GstError, InputError
from gstlib.preprocess.scans import mould_of
from gstlib.study import Study
from gstlib.surfaces.filtering import low_pass
from gstlib.surfaces.grid import make_surface, spacing_of

__all__ = ["UNMATCHED", "epochs_on_each_other"]

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
# ASSUME: a T1 that shows at least this share of the T0 of another patch belongs to that patch.
_MOSTLY = 0.6
# Long waves that may have been removed from a scan: those longer than these shares of its side.
_CUTS = 1 / 4, 1 / 13
# ASSUME: if two scans match in their short waves alone, and one has less than this share of the
# other's long waves, a filter removed them. Wear leaves more of them (see `gstlib.change.form`).
_MISSING = 0.3


def epochs_on_each_other(study: Study) -> tuple[list[GstError], str]:
    """What is wrong with scans after use, and in words how far the others are shifted.

    What else is odd is logged as a warning. A T1 that cannot be registered leaves the study.
    """
    problems: list[GstError] = [*_unregistered(study)]
    table = study.registration
    unlike = [*_unlike_their_patch(study, table)]
    problems += unlike
    named = {patch for fault in unlike for patch in fault.patches}
    problems += [*other_heights(table[~table.patch.isin(named)]), *exchanged_epochs(table)]
    # that much may be noise is no news of scans so coarse
    for odd in rise_warnings(table, max_noise_fraction=np.inf):
        _log.warning("%s", odd)
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


class _Laid(NamedTuple):
    """How a T1 lies as it should not."""

    is_inverted: bool
    orientation: str  # one of `ORIENTATIONS`

    def __str__(self) -> str:
        inverted = ["with the sign of its heights changed"] * self.is_inverted
        return ", ".join(inverted + [self.orientation] * (self.orientation != AS_GIVEN))

    def lay(self, surface: xr.DataArray, *, is_flipped: bool = False) -> xr.DataArray:
        """The surface, laid so; or laid so in its file, if it was flipped since."""
        name = self.orientation
        if is_flipped:  # which reverses the sense of turns
            is_reversed, turn = ORIENTATIONS[name]
            other = is_reversed, turn if turn == 180 else -turn
            name = next(each for each, way in ORIENTATIONS.items() if way == other)
        heights, (dy, dx) = oriented(surface.values, name), spacing_of(surface)
        return make_surface(
            -heights if self.is_inverted else heights,
            (dx, dy) if ORIENTATIONS[name][1] % 180 else (dy, dx),
        )


# T1 as it is has been tried.
_LAID = [_Laid(*way) for way in itertools.product((False, True), ORIENTATIONS)][1:]


def _unlike_their_patch(study: Study, table: pd.DataFrame) -> Iterator[FaultError]:
    """Faults of the T1 that match otherwise, or nowhere if none matches; warnings of the others."""
    files, doubts = study.patches.set_index("patch"), set()
    lost = table.patch[~table.found.astype(bool)].tolist()
    for row in table.itertuples():
        scans = [study.prepared[row.patch, epoch].height for epoch in ("T0", "T1")]
        if doubt := form_warning(*scans):
            doubts.add(row.patch)
            _log.warning("%s: patch %s: %s", files.t1[row.patch], row.patch, doubt)
        elif fault := _filtered(study, row.patch, scans):
            lost = [patch for patch in lost if patch != row.patch]
            yield fault
        elif not row.found and is_one_way(row.detail_correlation, row.slope_correlation):
            doubts.add(row.patch)
            _log.warning(
                "%s: patch %s: its striae match those of T0, but no detail shows where along them. "
                "Scan a larger area, or one with a pit or a scar",
                files.t1[row.patch],
                row.patch,
            )
    laid = _laid_otherwise(study, [patch for patch in lost if patch not in doubts])
    for how, patches in laid.items():
        yield _laid_fault(study, patches, str(how))
    lost = [patch for patch in lost if patch not in itertools.chain(*laid.values())]
    tried = 0
    for patch in [*lost]:
        others = [name for name in study.patches.patch if name != patch][: _MOST_TRIED - tried]
        tried += len(others)
        if other := _found_on(study, patch, others):
            lost.remove(patch)
            problem = (
                f"as T1 of patch {patch}, it is not found on {files.t0[patch]}, but on T0 of "
                f"patch {other}"
            )
            remedy = "Correct t1 in the patch table."
            yield FaultError(UNMATCHED, files.t1[patch], problem, remedy, [patch])
    yield from _matching_nothing(files.t1, lost, doubts, whole=len(lost) == len(table))


def _matching_nothing(
    files: pd.Series, lost: list[str], doubts: set[str], *, whole: bool
) -> Iterator[FaultError]:
    """A fault if T1 of the `whole` table match nothing, else a warning of those without a doubt."""
    remedy = (
        "Check the names in the patch table and registration.maximum_shift_mm, and that no form "
        "was taken out of one of the two."
    )
    if lost and whole:
        problem = f"none of the {len(lost)} T1 scans matches its T0"
        yield FaultError(UNMATCHED, ", ".join(files[lost]), problem, remedy)
    elif lost := [patch for patch in lost if patch not in doubts]:
        every = "its T1 is" if len(lost) == 1 else "their T1 are"
        problem = f"patch {', '.join(lost)}: {every} not found on T0"
        _log.warning("%s: %s. %s", ", ".join(files[lost]), problem, remedy)


def _filtered(study: Study, patch: str, scans: Sequence[xr.DataArray]) -> FaultError | None:
    """The fault of a patch, one of whose scans has lost its long waves to a filter."""
    before, after = scans
    shift_mm = study.config["registration"]["maximum_shift_mm"]
    removed = _without_long_waves(before, after, shift_mm)
    if removed is None:
        return None
    epoch, length_mm = removed
    other = "T0" if epoch == "T1" else "T1"
    file = study.patches.set_index("patch").loc[patch, epoch.lower()]
    return FaultError(
        UNMATCHED,
        f"{file} ({at_epoch(patch, epoch)})",
        f"it fits {other} only in waves shorter than {float(f'{length_mm * 1e3:.2g}'):g} µm, as "
        "after a filter that removes the longer ones",
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
    side = min(n * step for n, step in zip(before.shape, spacing, strict=True))
    for cut in _CUTS:
        long = [low_pass(scan.values, spacing, cut * side) for scan in scans]
        short = [scan.copy(data=scan.values - w) for scan, w in zip(scans, long, strict=True)]
        for epoch, (one, other) in {"T0": (0, 1), "T1": (1, 0)}.items():
            lower, apart = (_times(waves[one], waves[other]) for waves in (long, short))
            # polish lowers short waves alone, and another unit both alike
            if max(lower, lower / apart) < _MISSING:
                alike = short[1] / _times(short[1], short[0])
                if _match(short[0], alike, maximum_shift_mm):
                    return epoch, cut * side
    return None


def _times(one: np.ndarray | xr.DataArray, other: np.ndarray | xr.DataArray) -> float:
    """How many times as high (r.m.s.) the waves of one scan are as those of the other."""
    return float(one.std() / max(other.std(), np.finfo(float).tiny))


def _laid_otherwise(study: Study, lost: list[str]) -> dict[_Laid, list[str]]:
    """Patches whose T1 matches its T0 if its file is laid otherwise, by how it then lies."""
    laid: dict[_Laid, list[str]] = {}
    shift_mm = study.config["registration"]["maximum_shift_mm"]
    rows, mould = study.patches.set_index("patch"), study.config["scans"]["mould"]
    for number, patch in enumerate(lost):
        before, after = (study.prepared[patch, epoch].height for epoch in ("T0", "T1"))
        is_flipped = mould_of(mould, rows.loc[patch].get("flip", ""))["flip"] is not None
        matches = {
            how: _match(before, how.lay(after, is_flipped=is_flipped), shift_mm)
            for how in (_LAID if number < _MOST_LAID else [*laid])
        }
        best = max(matches, key=matches.__getitem__, default=None)
        if best is not None and matches[best] > _SURE_MATCH:
            laid.setdefault(best, []).append(patch)
    return laid


def _laid_fault(study: Study, patches: list[str], how: str) -> FaultError:
    """That these T1 match if they are laid otherwise."""
    files = study.patches.set_index("patch").t1
    if len(patches) == len(study.worn) > 1:
        who = f"all {len(patches)} T1 match their T0"
    else:
        who = f"T1 of patch {', '.join(patches)} match{'es' * (len(patches) == 1)} T0"
    problem = f"{who} only {how}"
    remedy = (
        "scans.mould and flip hold for both epochs: export T1 so that it lies as T0 does, or scan "
        "both epochs on the stone, or both on moulds."
    )
    return FaultError(UNMATCHED, ", ".join(files[patches]), problem, remedy, patches)


def _found_on(study: Study, patch: str, others: list[str]) -> str | None:
    """The first of the other patches whose T0 shows most of this one's T1.

    A T1 that lies between two patches shows a part of the other, too, and is no mistake of names.
    """
    after = study.prepared[patch, "T1"].height
    shift_mm = study.config["registration"]["maximum_shift_mm"]
    for other in others:
        match = _registered(study.prepared[other, "T0"].height, after, shift_mm)
        if match is not None and match.overlap >= _MOSTLY:
            return other
    return None


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
    return match if match.found else None


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
