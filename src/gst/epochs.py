"""Does each T1 show its patch, and after use? Coarser scans are registered, as the study does."""

import functools
import logging
import math
from collections.abc import Mapping

import pandas as pd
import xarray as xr

from gstlib.change.change import measured_change, wear_summary
from gstlib.change.form import form_warning
from gstlib.errors import InputError
from gstlib.surfaces.grid import spacing_of

__all__ = ["epochs_on_each_other"]

_log = logging.getLogger(__name__)

# Wear takes height. Of synthetic specimens, whose T0 and T1 are right, no patch gained on a larger
# share of its points than it lost on; exchanged, four of five gain by these on more.
_GAIN_OVER_LOSS = 1.2
_GAIN_LESS_LOSS = 0.015
_SPOT = 2  # points, of a coarse scan
# T1 that other software has laid on T0 is off by half a point at most: of a scan four times as fine
# as the coarse one, with the error of its registration, a hundredth.
_CO_LOCATED = 0.15
# Registering a scan takes a tenth of a second.
_MOST_TRIED = 100


def epochs_on_each_other(
    coarse: Mapping[tuple[str, str], xr.Dataset],
    patches: pd.DataFrame,
    *,
    maximum_shift_mm: float,
) -> tuple[list[InputError], str]:
    """Scans after use that show another patch, and in words how far the others are shifted.

    Of other doubts, warnings are logged.

    Parameters
    ----------
    coarse : mapping of (str, str) to xarray.Dataset
        Prepared scans by patch and epoch, all with one spacing.
    patches : pandas.DataFrame
        The patch table.
    maximum_shift_mm : float
        As in `gstlib.change.registration.register`.
    """
    registered = functools.partial(
        measured_change, maximum_shift_mm=maximum_shift_mm, minimum_points=_SPOT
    )
    before = {patch: of for (patch, epoch), of in coarse.items() if epoch == "T0"}
    problems: list[InputError] = []
    shifts_mm: list[float] = []
    together, tried, gained = 0, 0, []
    for row in patches.itertuples():
        patch, after = row.patch, coarse.get((row.patch, "T1"))
        if after is None or patch not in before:
            continue
        try:
            registration, change = registered(before[patch], after)
        except InputError as error:
            problems.append(InputError(row.t1, f"patch {patch}: {error.problem}", error.remedy))
            continue
        doubt = form_warning(before[patch].height, after.height)
        if registration.found:
            if doubt:
                _log.warning("%s: patch %s: %s", row.t1, patch, doubt)
            shifts_mm.append(math.hypot(registration.shift_x_mm, registration.shift_y_mm))
            together += shifts_mm[-1] < _CO_LOCATED * max(spacing_of(before[patch].height))
            shares = wear_summary(change)
            loss, gain = shares["loss_fraction"], shares["gain_fraction"]
            if gain > max(_GAIN_OVER_LOSS * loss, loss + _GAIN_LESS_LOSS):
                gained.append(patch)
            continue
        others = [name for name in before if name != patch][: _MOST_TRIED - tried]
        tried += len(others)
        for other in others:
            if registered(before[other], after)[0].found:
                problem = (
                    f"as T1 of patch {patch}, it is not found on {row.t0}, but on T0 of patch "
                    f"{other}"
                )
                problems.append(InputError(row.t1, problem, "Correct t1 in the patch table."))
                break
        else:
            _log.warning(
                "%s: as T1 of patch %s, it is not found on %s: %s",
                row.t1,
                patch,
                row.t0,
                doubt
                or "check both names in the patch table, registration.maximum_shift_mm, and that "
                "no form was taken out of one of the two",
            )
    if gained:
        _log.warning(
            "from T0 to T1, more of patch%s %s rose than fell, and wear takes height: are t0 and "
            "t1 exchanged in the patch table?",
            "es" * (len(gained) > 1),
            ", ".join(gained),
        )
    if not shifts_mm:
        return problems, ""
    most = float(f"{1e3 * max(shifts_mm):.2g}")
    said = f"found on {len(shifts_mm)} patches, shifted by up to {most:g} µm"
    if together:
        which = "all" if together == len(shifts_mm) else f"{together} of them"
        said += f"; {which} co-located already (shifted by less than half a point)"
    return problems, said
