"""Does each T1 show its patch, and after use? What a study of coarser scans says, in words."""

import logging
from collections.abc import Iterator

import numpy as np
import pandas as pd

from gstlib.change.form import form_warning
from gstlib.change.registration import register
from gstlib.change.selection import exchanged_epochs, rise_warnings
from gstlib.errors import GstError, InputError
from gstlib.study import Study
from gstlib.surfaces.grid import spacing_of

__all__ = ["epochs_on_each_other"]

_log = logging.getLogger(__name__)

# T1 that other software has laid on T0 is off by half a point at most: of a scan four times as fine
# as the coarse one, with the error of its registration, a hundredth.
_CO_LOCATED = 0.15
# Registering a scan takes a tenth of a second.
_MOST_TRIED = 100


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


def _unregistered(study: Study) -> Iterator[InputError]:
    """Why a T1 cannot be registered, by its file; without these, the study has a table."""
    files = study.patches.set_index("patch").t1
    for patch in list(study.worn):
        try:
            study.changes[patch]
        except InputError as error:
            study.worn.remove(patch)
            yield InputError(files[patch], f"patch {patch}: {error.problem}", error.remedy)


def _unlike_their_patch(study: Study, table: pd.DataFrame) -> Iterator[InputError]:
    """Each T1 that shows another patch; warnings of those found nowhere, or without their form."""
    files, tried = study.patches.set_index("patch"), 0
    for row in table.itertuples():
        patch, t0, t1 = row.patch, files.t0[row.patch], files.t1[row.patch]
        before, after = study.prepared[patch, "T0"].height, study.prepared[patch, "T1"].height
        doubt = form_warning(before, after)
        if row.found:
            if doubt:
                _log.warning("%s: patch %s: %s", t1, patch, doubt)
            continue
        others = [name for name in study.patches.patch if name != patch][: _MOST_TRIED - tried]
        tried += len(others)
        if other := _found_on(study, patch, others):
            problem = (
                f"as T1 of patch {patch}, it is not found on {t0}, but on T0 of patch {other}"
            )
            yield InputError(t1, problem, "Correct t1 in the patch table.")
        else:
            remedy = (
                "check both names in the patch table, registration.maximum_shift_mm, and that no "
                "form was taken out of one of the two"
            )
            _log.warning(
                "%s: as T1 of patch %s, it is not found on %s: %s",
                t1,
                patch,
                t0,
                doubt or remedy,
            )


def _found_on(study: Study, patch: str, others: list[str]) -> str | None:
    """The first of the other patches whose T0 is on this one's T1."""
    after, settings = study.prepared[patch, "T1"].height, study.config["registration"]
    for other in others:
        if register(study.prepared[other, "T0"].height, after, **settings).found:
            return other
    return None


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
