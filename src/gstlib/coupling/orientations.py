"""Mistakes in the orientation of scans and in a patch table, and their remedies."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

__all__ = ["AS_GIVEN", "LOOKS", "ORIENTATIONS", "TABLES", "Mould", "as_measured"]
__all__ += ["lying_right", "oriented", "remedy_of", "remedy_of_table"]

# Each look: whether it is first reversed along x, and then its rotation from x towards y (degrees).
# ASSUME: Wrong orientations of a scan. A wrong scan is reversed, turned by quarter turns, or both,
# and its heights may be inverted. Reason: These are the symmetries of a square map and its mould.
ORIENTATIONS = {
    "as given": (False, 0),
    "reversed along x": (True, 0),
    "reversed along y": (True, 180),
    "turned by 180°": (False, 180),
    "turned by 90°": (False, 90),
    "turned by -90°": (False, -90),
    "reversed along x and turned by 90°": (True, 90),
    "reversed along y and turned by 90°": (True, -90),
}
AS_GIVEN, *_OTHERS = ORIENTATIONS
LOOKS = [*ORIENTATIONS, "inverted", *(f"inverted and {name}" for name in _OTHERS)]
# Mistakes of a patch table: whether x_mm and y_mm are exchanged, and whether they are then measured
# from the opposite sides of the square.
TABLES = {
    "": (False, False, False),
    "x_mm measured from the other side": (False, True, False),
    "y_mm measured from the other side": (False, False, True),
    "x_mm and y_mm measured from the other sides": (False, True, True),
    "x_mm and y_mm exchanged": (True, False, False),
    "x_mm and y_mm exchanged, then x_mm measured from the other side": (
        True,
        True,
        False,
    ),
    "x_mm and y_mm exchanged, then y_mm measured from the other side": (
        True,
        False,
        True,
    ),
    "x_mm and y_mm exchanged, then both measured from the other sides": (
        True,
        True,
        True,
    ),
}


class Mould(NamedTuple):
    """Reversal of moulds: whether heights were inverted, and the axis of the flip."""

    invert: bool
    flip: str | None


def oriented(heights: np.ndarray, name: str) -> np.ndarray:
    """Heights (ny, nx) in one of the `ORIENTATIONS`."""
    reversed_x, turn = ORIENTATIONS[name]
    return np.rot90(heights[:, ::-1] if reversed_x else heights, -turn // 90)


def as_measured(x: Any, y: Any, size_mm: float, mistake: str) -> tuple[Any, Any]:
    """The correct x and y from a patch table that has one of the mistakes in `TABLES`."""
    is_exchanged, other_x, other_y = TABLES[mistake]
    if is_exchanged:
        x, y = y, x
    return (size_mm - x if other_x else x), (size_mm - y if other_y else y)


def lying_right(
    orientation: str, mould: Mould, *, is_alone: bool = False
) -> tuple[Mould, int]:
    """Reversal of moulds that gives patches with an orientation the correct one.

    `orientation` comes from `check_placement`, where the moulds were undone by `mould`. The result
    also contains degrees to add to the rotation of each patch, from -90 to 180. A half turn is
    applied to the mould, by a flip along the other axis, or, if `is_alone`, to the patch.

    >>> lying_right("reversed along y", Mould(invert=False, flip=None))
    (Mould(invert=False, flip='y'), 0)
    """
    laid = orientation.removeprefix("inverted").removeprefix(" and ")
    reversed_x, turn = ORIENTATIONS[laid or AS_GIVEN]
    invert = mould.invert != orientation.startswith("inverted")
    if is_alone and not reversed_x:
        return Mould(invert, mould.flip), (turn + 179) % 360 - 179
    # A reversal along y is a reversal along x and a rotation by 180°.
    turn += 180 * (mould.flip == "y")
    if reversed_x == (mould.flip is not None):
        flip = None
    else:
        flip = "x" if turn % 360 in (0, 90) else "y"
        turn += 180 * (flip == "y")
    return Mould(invert, flip), (turn + 179) % 360 - 179


def remedy_of(
    orientation: str,
    mould: Mould,
    rows: pd.DataFrame | None = None,
    table: Sequence[str] = (),
) -> str:
    """Settings that correct patches with this orientation, whose moulds were undone by `mould`.

    They are keys of the config, or cells in `rows` of the patches. Changes of the `table` follow.
    """
    whose, invert, flip, none = (
        "every patch",
        "scans.mould.invert",
        "scans.mould.flip",
        "null",
    )
    if rows is not None:
        own = rows["flip"].iloc[0] if "flip" in rows else ""
        mould = mould._replace(flip={"none": None, "": mould.flip}.get(own, own))
        whose = f"patch{'es' * (len(rows) > 1)} {', '.join(rows.patch)}"
        flip, none = f"flip of {whose}", "none"
    is_alone = rows is not None and len(rows) == 1
    right, turn = lying_right(orientation, mould, is_alone=is_alone)
    parts = []
    if right.invert != mould.invert:
        key = f"set {invert} to {str(right.invert).lower()}"
        parts.append(
            key if rows is None else f"invert the heights in the files of {whose}"
        )
    if right.flip != mould.flip:
        parts.append(f"set {flip} to {right.flip or none}")
    if turn and rows is not None and is_alone:
        total = (
            180 - (180 - rows.rotation_deg.iloc[0] - turn) % 360
        )  # above -180, up to 180
        parts.append(f"set rotation_deg of {whose} to {total:g}")
    elif turn:
        parts.append(f"add {turn} to the rotation_deg of {whose}")
    text = ", and ".join([*parts, *table])
    return f"{text[0].upper()}{text[1:]}."


def remedy_of_table(mistake: str, size_mm: float) -> list[str]:
    """Changes of the columns of a patch table that correct a mistake; none if there is none."""
    is_exchanged, *others = TABLES[mistake]
    columns = ["x_mm", "y_mm"]
    sources = columns[::-1] if is_exchanged else columns
    values = [
        f"{size_mm:g} - {source}" if is_other else source
        for source, is_other in zip(sources, others, strict=True)
    ]
    pairs = zip(columns, values, strict=True)
    cells = [f"{column} to {value}" for column, value in pairs if column != value]
    return [f"set {' and '.join(cells)} in every row"] * bool(cells)
