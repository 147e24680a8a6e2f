"""A row of the table of placement, and the verdict in it."""

import math
from collections.abc import Mapping

import numpy as np

from gstlib.placement.matching import Match
from gstlib.placement.peaks import Peak

__all__ = ["AGREES", "ALL", "CANNOT_TELL", "COLUMNS", "SHIFTED", "new_row", "verdict_of"]

AGREES, SHIFTED, CANNOT_TELL = "agrees", "shifted", "cannot tell"
# The row of all patches together.
ALL = "all"

COLUMNS = [
    "patch",
    "waves",
    "correlation_nominal",
    "correlation",
    "p_value",
    "shift_x_um",
    "shift_y_um",
    "shift_x_error_um",
    "shift_y_error_um",
    "shift_p_value",
    "verdict",
    "looks",
]


def new_row(name: str, waves: int, match: Match | None = None, peak: Peak | None = None) -> dict:
    """A row of the table as far as correlations go."""
    row = dict.fromkeys(COLUMNS, math.nan) | {"patch": name, "waves": waves, "looks": ""}
    row |= {"verdict": CANNOT_TELL}
    if match is not None:
        reach = match.correlation.shape[1] // 2
        row |= {
            "correlation_nominal": float(match.correlation[0, reach, reach]),
            "correlation": float(np.nanmax(match.as_given())) if peak is None else peak.value,
        }
    return row


def verdict_of(row: Mapping, significance: float) -> str:
    if not (row["p_value"] < significance and np.isfinite(row["shift_p_value"])):
        return CANNOT_TELL
    return SHIFTED if row["shift_p_value"] < significance else AGREES
