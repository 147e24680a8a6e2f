"""The patch table: where on the square each scan was taken, and which files hold it.

`workflow/schemas/patches.schema.yaml` describes a row, `gst.config.user_tables` the text. A name
with ``*`` is that of the one file that fits it, where ``{patch}`` stands for the patch. In a table
without ``t0`` and ``t1``, a patch's scans are those named after it and the epoch: ``E1_T0.plux``
and, if they are there, ``E1_T1.plux`` and ``E1_repeat.plux``. A table with grades of wear in place
of scans has no files.

The table of proposed places (``places.csv``) is a patch table, too: ``place`` stands for ``patch``,
and its other columns are for readers.
"""

import re
import unicodedata
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple

import pandas as pd

from gst.config.user_tables import Problem, read_rows, rows_of
from gstlib.preprocess.scans import crop_of
from gstlib.surfaces.footprints import PatchPosition, half_extent, outline, places_of

COUNTERFACE = "counterface"  # in place of a patch's name
# Epochs of a patch's scans, by their columns of the table. The repeat is a second scan without use.
REPEAT = "repeat"
EPOCHS = {"t0": "T0", "t1": "T1", "repeat": REPEAT}
# A footprint may touch the square's edge; up to this much (mm) beyond it is rounding.
_ROUNDING = 1e-9
# Patches that have less in common (share of a patch) lie side by side: places are rounded.
_LEAST_OVERLAP = 0.01


def read_patches(
    path: str | Path,
    *,
    size_mm: float,
    patch_size_mm: float,
    scan_folder: str | Path | None = None,
) -> pd.DataFrame:
    """Read and check the patch table of a square of side `size_mm`.

    It has every column of the schema, and a row for each patch, in natural order of ids ("2" before
    "10"). Names of scans become those in `scan_folder`, which is None for a synthetic specimen. A
    `ConfigError` lists all that is wrong, with line numbers.
    """
    table = read_rows(path, "patches")
    rows = table.rows
    problems = find_scans(rows, table.columns, scan_folder)
    outside = _out_of_square(rows, size_mm, patch_size_mm)
    table.refuse([*problems, *_repeated(rows), *outside])
    return rows.sort_values(
        "patch", key=lambda ids: ids.map(natural), kind="stable", ignore_index=True
    )


def no_patches() -> pd.DataFrame:
    """The patch table of a study before anything is scanned: no rows."""
    return rows_of("patches", {})


def cell_of(name: str) -> str:
    """A scan's name that the table does not take for a formula or an option."""
    return f"./{name}" if name[:1] in tuple("~=+@-") else name


def find_scans(
    rows: pd.DataFrame, columns: Collection[str], folder: str | Path | None
) -> Iterator[Problem]:
    """Put the names of files in place of the names that they fit; where none fits, or several."""
    is_named = not {"t0", "t1"}.isdisjoint(columns)
    graded = rows.index[rows.wear_grade.notna()]
    if "wear_grade" in columns and not is_named:
        return
    if len(graded):
        problem = "wear_grade stands beside scans, in whose place grades are: take the column "
        yield graded[0], f"{problem}out, or t0 and t1"
        return
    # a synthetic specimen has the repeats that are named
    usual = {"t0": "{patch}_T0.plu", "t1": "{patch}_T1.plu"}
    if folder is not None:
        usual = {column: f"{{patch}}_{epoch}.*" for column, epoch in EPOCHS.items()}
    for line, row in rows.iterrows():
        for column in EPOCHS:
            name = row[column] or ("" if is_named else usual.get(column, ""))
            if not name:
                continue
            name = name.replace("{patch}", row.patch)
            files = [name] if folder is None else _fitting(name, Path(folder))
            if len(files) == 1:
                rows.loc[line, column] = files[0]
            elif "*" in name and (files or row[column] or column == "t0"):
                fits = f"{' and '.join(files)} fit" if files else "no file fits"
                yield (
                    line,
                    f"{fits} {name} in {folder}: let one fit, or name it as {column}",
                )
        if is_named and not row.t0:
            yield line, "t0 is empty"


def _fitting(name: str, folder: Path) -> list[str]:
    """The files that fit a name, perhaps with ``*``, whatever their capitals.

    Nor does it matter how accents are composed: é is one character, or e and an accent.
    """
    place = folder / name
    if place.is_file():
        return [name]
    if place.is_dir() or not place.parent.is_dir():
        return []
    parts = map(re.escape, _composed(place.name).split("*"))
    pattern = re.compile(".*".join(parts), re.IGNORECASE)
    return sorted(
        str(Path(name).with_name(file.name))
        for file in place.parent.iterdir()
        if pattern.fullmatch(_composed(file.name))
    )


def _composed(name: str) -> str:
    return unicodedata.normalize("NFC", name)


def _repeated(rows: pd.DataFrame) -> Iterator[Problem]:
    """Ids that an earlier line has."""
    ids = rows.patch[rows.patch != ""].str.lower()  # some file systems ignore case
    for line in ids.index[ids.duplicated()]:
        first = (ids == ids[line]).idxmax()
        yield line, f"same id as in line {first}"


def _out_of_square(
    rows: pd.DataFrame, size: float, patch_size: float
) -> Iterator[Problem]:
    """Patches whose footprint is not within the square."""
    for row in rows.itertuples():
        half = half_extent(patch_size, row.rotation_deg)
        beyond = [
            f"{mm:.4g} mm at the {axis} = {side:g} side"
            for axis, centre in (("x", row.x_mm), ("y", row.y_mm))
            for side, mm in ((0, half - centre), (size, centre + half - size))
            if mm > _ROUNDING
        ]
        if beyond:
            footprint = f"its footprint of {patch_size:g} mm sticks out of the {size:g} mm square"
            yield row.Index, f"{footprint} by {' and '.join(beyond)}"


def overlaps(patches: pd.DataFrame, size_mm: float) -> Iterator[tuple[str, str, float]]:
    """Two patches, and the share (0 to 1) of each that they have in common, if more than 1 %."""
    from shapely import Polygon, STRtree

    places = places_of(patches)
    names = [*places]
    outlines = [Polygon(outline(place, size_mm)) for place in places.values()]
    pairs = STRtree(outlines).query(outlines, predicate="intersects").T if names else ()
    for one, other in sorted(map(tuple, pairs)):
        if one >= other:
            continue
        share = outlines[one].intersection(outlines[other]).area / size_mm**2
        if share > _LEAST_OVERLAP:
            yield names[one], names[other], share


class ScanFile(NamedTuple):
    """A scan that the study uses."""

    path: Path
    patch: str  # or `COUNTERFACE`
    epoch: str  # T0, T1, repeat, or empty
    # Centre (y, x), mm, of the piece to cut, from the scan's centre; None for the whole scan.
    crop: tuple[float, float] | None = None
    place: PatchPosition | None = None  # on the square
    flip: str = ""  # as in the table


def scan_files(
    patches: pd.DataFrame, folder: str | Path, counterface: str | Path | None
) -> list[ScanFile]:
    """Every scan in `folder` that the table of `read_patches` names, and the counterface's."""
    scans = []
    for row in patches[patches.t0 != ""].itertuples():
        place = PatchPosition(row.y_mm, row.x_mm, row.rotation_deg)
        for column, epoch in EPOCHS.items():
            if name := getattr(row, column):
                at = Path(folder) / name, row.patch, epoch
                scans.append(ScanFile(*at, crop_of(row), place, row.flip))
    if counterface:
        scans.append(ScanFile(Path(counterface), COUNTERFACE, ""))
    return scans


def at_epoch(patch: str, epoch: str) -> str:
    """A patch's scan in words."""
    return (
        f"repeat of patch {patch}" if epoch == REPEAT else f"patch {patch} at {epoch}"
    )


def natural(name: str) -> str:
    """Key that sorts names with "2" before "10": numbers within them are padded to equal length."""
    return re.sub(r"\d+", lambda digits: digits[0].zfill(20), name)
