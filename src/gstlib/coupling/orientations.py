"""Mistakes in the orientation of scans and in a patch table, and their remedies."""

import itertools
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
_MISTAKES = [
    "",
    "x_mm measured from the other side",
    "y_mm measured from the other side",
    "x_mm and y_mm measured from the other sides",
    "x_mm and y_mm exchanged",
    "x_mm and y_mm exchanged, then x_mm measured from the other side",
    "x_mm and y_mm exchanged, then y_mm measured from the other side",
    "x_mm and y_mm exchanged, then both measured from the other sides",
]
# Mistakes of a patch table: whether x_mm and y_mm are exchanged, and whether then y_mm and x_mm are
# measured from the opposite sides of the square.
TABLES = dict(zip(_MISTAKES, itertools.product((False, True), repeat=3), strict=True))


class Mould(NamedTuple):
    """Reversal of moulds: whether heights were inverted, and the axis of the flip."""

    invert: bool
    flip: str | None

    def of_row(self, flip: str) -> "Mould":
        """The mould of a row of the patch table, whose own `flip` is empty if it has none."""
        return self._replace(flip={"none": None, "": self.flip}.get(flip, flip))


def oriented(heights: np.ndarray, name: str) -> np.ndarray:
    """Heights (..., ny, nx) in one of the `ORIENTATIONS`."""
    reversed_x, turn = ORIENTATIONS[name]
    laid = heights[..., ::-1] if reversed_x else heights
    return np.rot90(laid, -turn // 90, axes=(-2, -1))


def as_measured(x: Any, y: Any, size_mm: float, mistake: str) -> tuple[Any, Any]:
    """The correct x and y from a patch table that has one of the mistakes in `TABLES`."""
    is_exchanged, other_y, other_x = TABLES[mistake]
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
    flip = mould.flip
    if reversed_x or not is_alone:
        # A reversal along y is a reversal along x and a rotation by 180°.
        turn += 180 * (flip == "y")
        axis = "x" if turn % 360 in (0, 90) else "y"
        flip = axis if reversed_x != bool(flip) else None
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
    is_alone = rows is not None and len(rows) == 1
    if rows is None:
        whose, key, none = "every patch", "scans.mould.flip", "null"
    else:
        mould = mould.of_row(rows["flip"].iloc[0] if "flip" in rows else "")
        whose = f"patch{'es' * (len(rows) > 1)} {', '.join(rows.patch)}"
        key, none = f"flip of {whose}", "none"
    right, turn = lying_right(orientation, mould, is_alone=is_alone)
    inverted = f"invert the heights in the files of {whose}"
    if rows is None:
        inverted = f"set scans.mould.invert to {str(right.invert).lower()}"
    turned = f"add {turn} to the rotation_deg of {whose}"
    if rows is not None and is_alone:
        total = 180 - (180 - rows.rotation_deg.iloc[0] - turn) % 360  # up to 180
        turned = f"set rotation_deg of {whose} to {total:g}"
    changes = {
        inverted: right.invert != mould.invert,
        f"set {key} to {right.flip or none}": right.flip != mould.flip,
        turned: turn,
    }
    needed = [change for change, is_needed in changes.items() if is_needed]
    text = ", and ".join([*needed, *table])
    return f"{text[0].upper()}{text[1:]}."


def remedy_of_table(mistake: str, size_mm: float) -> list[str]:
    """Changes of the columns of a patch table that correct a mistake; none if there is none."""
    is_exchanged, other_y, other_x = TABLES[mistake]
    x, y = ("y_mm", "x_mm") if is_exchanged else ("x_mm", "y_mm")
    cells = []
    for column, value, is_other in (("x_mm", x, other_x), ("y_mm", y, other_y)):
        right = f"{size_mm:g} - {value}" if is_other else value
        if right != column:
            cells.append(f"{column} to {right}")
    return [f"set {' and '.join(cells)} in every row"] * bool(cells)
