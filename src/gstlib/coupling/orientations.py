"""Ways in which scans and a patch table may be laid wrongly, and how each is set right."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

__all__ = ["AS_GIVEN", "LOOKS", "ORIENTATIONS", "TABLES", "Mould", "as_measured"]
__all__ += ["lying_right", "oriented", "remedy_of", "remedy_of_table"]

# ASSUME: a scan that was laid wrongly is reversed, turned by quarter turns, or both, or has its
# heights inverted, too. Each look: whether it is reversed along x first, and then by how much it is
# turned, from x towards y (degrees).
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
# Mistakes of a patch table: whether x_mm and y_mm are exchanged, and whether x_mm and y_mm are then
# measured from the other side of the square.
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
    """How moulds were undone: whether heights were inverted, and along which axis turned over."""

    invert: bool
    flip: str | None


def oriented(heights: np.ndarray, name: str) -> np.ndarray:
    """Heights (ny, nx) laid in one of the `ORIENTATIONS`."""
    reversed_x, turn = ORIENTATIONS[name]
    return np.rot90(heights[:, ::-1] if reversed_x else heights, -turn // 90)


def as_measured(x: Any, y: Any, size_mm: float, mistake: str) -> tuple[Any, Any]:
    """The right x and y from those of a patch table that has one of the mistakes in `TABLES`."""
    is_exchanged, other_x, other_y = TABLES[mistake]
    if is_exchanged:
        x, y = y, x
    return (size_mm - x if other_x else x), (size_mm - y if other_y else y)


def lying_right(
    orientation: str, mould: Mould, *, is_alone: bool = False
) -> tuple[Mould, int]:
    """How to undo the moulds of patches with an orientation so that they lie right.

    `orientation` is that of `check_placement`, with the moulds undone as `mould` says. There may be
    degrees to add to the rotation of each patch, too, from -90 to 180. A half turn is one of the
    mould, which is flipped along the other axis, or, if `is_alone`, one of the patch.

    >>> lying_right("reversed along y", Mould(invert=False, flip=None))
    (Mould(invert=False, flip='y'), 0)
    """
    laid = orientation.removeprefix("inverted").removeprefix(" and ")
    reversed_x, turn = ORIENTATIONS[laid or AS_GIVEN]
    invert = mould.invert != orientation.startswith("inverted")
    if is_alone and not reversed_x:
        return Mould(invert, mould.flip), (turn + 179) % 360 - 179
    # to reverse along y is to reverse along x and turn by 180°
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
    """Settings with which patches with this orientation, whose moulds were undone so, lie right.

    These are keys of the config, or cells of the patches' `rows`; changes of the `table` follow.
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
    """Changes of the columns of a patch table with a mistake; none without one."""
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
