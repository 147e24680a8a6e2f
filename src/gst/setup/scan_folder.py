"""Scans as a laboratory keeps them, paired by place before and after use, with the evidence.

Names decide (`gst.setup.file_names`), and heights confirm. Where the two disagree, or names have
two readings, a cell of the patch table begins with `TODO` and the likely value follows.
"""

import contextlib
import logging
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from gst.check.sliding import sides_of
from gst.config.todo import TODO
from gst.setup.file_names import Row, read_names
from gstlib.change.change import measured_change, wear_summary
from gstlib.change.selection import is_more
from gstlib.errors import GstError, InputError
from gstlib.io.scans import is_scan, read_scan
from gstlib.io.stage import stage_of
from gstlib.io.text import SCAN_UNITS
from gstlib.preprocess.scans import prepare_scan
from gstlib.settings import Settings
from gstlib.surfaces.grid import coarser, spacing_of

# Points along a scan that is compared with others, and points that make a loss.
_COARSE, _SPOT = 128, 2
# Fields (mm) that a scan of a patch or an overview can have: they determine the unit of text.
_FIELDS = 0.05, 30.0
_SCAN_ALIKE = (
    "scans before and after use differ in spacing and cannot be compared: scan both with the same "
    "objective, or resample one in your instrument's software"
)
# Spacings that differ by less (a share) are one.
_SAME_SPACING = 1e-3
# A map so many times as long as the other scans shows the places of several.
OVERVIEW = 1.8


@dataclass(frozen=True)
class Scan:
    """The content of a file."""

    name: str  # its path in the folder of all scans, with ``/``
    # Its unit if the file does not state it, or `TODO` if it cannot be inferred; None if it does.
    unit: str | None
    size_mm: tuple[float, float]  # (y, x)
    spacing_mm: tuple[float, float]  # (y, x)
    stage_mm: tuple[float, float] | None  # (x, y)
    acquired: str  # the time, if the file states it
    coarse: xr.DataArray  # its heights (y, x) on fewer points


def scans_in(paths: Sequence[Path]) -> tuple[Path, list[Path], list[Path]]:
    """The folder of all scans, those in it, and other files there.

    Files that are named are scans, whatever their ending; in folders, the ending decides. Raises an
    `InputError` if there is no such file or folder, or no scan in it.
    """
    for path in paths:
        if not path.exists():
            raise InputError(path, "no such file or folder", "Correct --scans.")
    named = [path.resolve() for path in paths]
    folders = [path if path.is_dir() else path.parent for path in named]
    root = Path(os.path.commonpath(folders))
    inside = {file for path in named for file in path.rglob("[!.]*")}
    files = {file for file in [*inside, *named] if file.is_file()}
    scans = {file for file in files if file in named or is_scan(file)}
    if not scans:
        remedy = "Name the folder of the scans as --scans."
        raise InputError(root, "contains no scan", remedy)
    return root, sorted(scans), sorted(files - scans)


def read_scans(root: Path, paths: Sequence[Path]) -> tuple[list[Scan], list[str]]:
    """The scans that can be read, and why others cannot."""
    scans, faults = [], []
    for path in paths:
        try:
            scans.append(_read(root, path))
        except GstError as error:
            faults.append(str(error))
    return scans, faults


def _read(root: Path, path: Path) -> Scan:
    unit, acquired = None, ""
    try:
        surface = read_scan(path)
    except InputError as error:
        surface, unit = _in_likely_unit(path, error)
    with contextlib.suppress(ValueError):  # a date that does not sort
        acquired = datetime.fromisoformat(surface.attrs.get("acquired", "")).isoformat()
    # a power of two, so that scans of different sizes stay on one spacing
    times = 1 << max(0, (min(surface.shape) // _COARSE).bit_length() - 1)
    return Scan(
        name=path.relative_to(root).as_posix(),
        unit=unit,
        size_mm=sides_of(surface),
        spacing_mm=spacing_of(surface),
        stage_mm=stage_of(surface),
        acquired=acquired,
        coarse=coarser(surface, times),
    )


def _in_likely_unit(path: Path, error: InputError) -> tuple[xr.DataArray, str]:
    """A scan that does not state its unit, in the only one that makes a field of its size."""
    fitting = []
    logging.disable()
    try:
        for unit in SCAN_UNITS:
            with contextlib.suppress(InputError):
                surface = read_scan(path, unit=unit)
                if all(_FIELDS[0] <= side <= _FIELDS[1] for side in sides_of(surface)):
                    fitting.append((surface, unit))
        if len(fitting) == 1:
            return fitting[0]
        return read_scan(path, unit="um", spacing_um=1.0), TODO
    except InputError:
        raise error from None
    finally:
        logging.disable(logging.NOTSET)


class Pairs(NamedTuple):
    """The rows of a patch table, and how sure they are."""

    rows: list[Row]  # a cell that is doubtful begins with `TODO`
    evidence: list[str]  # for each row, why its scans show one place
    earlier: str  # which scans are the earlier, and why; empty if there is one epoch
    questions: list[str]  # missing values, in sentences
    # Whether moulds were scanned: False if heights fell with use, as on the stone itself, or a
    # text that begins with `TODO`.
    invert: bool | str
    mould: str  # the evidence for it, or that there is none
    before: dict[str, Scan]  # the scan of each patch before use, if it has one
    left: list[str]  # names of scans that are in no row
    overviews: list[Scan]  # maps of several places


class _Change(NamedTuple):
    """What two scans show that are named as of one place."""

    days: int  # 1 if the dates in the files are in order, -1 if not, 0 if they do not tell
    is_comparable: bool  # whether they have one spacing
    is_found: bool = False  # whether the later one shows the surface of the earlier one
    fell: bool = False  # whether heights fell with use
    rose: bool = False


def _change(before: Scan, after: Scan) -> _Change:
    """Compare two scans by their dates and heights."""
    days = 0
    if before.acquired and after.acquired:
        days = (after.acquired > before.acquired) - (after.acquired < before.acquired)
    fine, wide = sorted(max(scan.spacing_mm) for scan in (before, after))
    if wide > (1 + _SAME_SPACING) * fine:
        return _Change(days, is_comparable=False)
    steps = [spacing_of(scan.coarse)[1] for scan in (before, after)]
    # a larger map may have been made coarser, by powers of two
    pair = [
        prepare_scan(
            coarser(scan.coarse, round(max(steps) / step)), maximum_unmeasured=1.0
        )
        for scan, step in zip((before, after), steps, strict=True)
    ]
    try:
        change = measured_change(
            *pair,
            maximum_shift_mm=Settings().registration.maximum_shift_mm,
            minimum_cluster_points=_SPOT,
        )
    except InputError:  # other heights
        return _Change(days, is_comparable=True)
    shares = wear_summary(change)
    loss, gain = shares["loss_fraction"], shares["gain_fraction"]
    is_found = bool(change.attrs["registration_found"])
    fell, rose = (
        is_found and bool(is_more(*way)) for way in ((loss, gain), (gain, loss))
    )
    return _Change(days, True, is_found, fell, rose)


def pair_scans(scans: Sequence[Scan], pattern: str | None = None) -> Pairs:
    """Which scans belong together, and which was made first, by names that heights confirm."""
    overviews = _overviews(scans)
    by_name = {scan.name: scan for scan in scans if scan not in overviews}
    names = read_names(by_name, pattern)
    pairs = {
        row.patch: _change(by_name[row.t0], by_name[row.t1])
        for row in names.rows
        if row.t0 and row.t1
    }
    changes = pd.DataFrame(pairs.values(), columns=_Change._fields)
    questions = [*names.questions, *_questions(changes)]
    rows, evidence, doubts = [], [], []
    for row in names.rows:
        why, doubt = _confirmed(row, pairs.get(row.patch), changes)
        evidence.append(f"by name{why}")
        if doubt:
            row = row._replace(t1=_doubtful(row.t1))
            doubts.append(doubt)
        named = [by_name[name] for name in (row.t0, row.repeat) if name]
        if row.repeat and len(named) == 2 and not _change(*named).is_found:
            doubt = f"{row.repeat} is named as a repeat of {row.t0}, but does not show its surface"
            row = row._replace(repeat=_doubtful(row.repeat))
            doubts.append(doubt)
        if questions:
            row = row._replace(t0=row.t0 or TODO, t1=_doubtful(row.t1))
        rows.append(row)
    if not changes.is_comparable.all():
        doubts.append(_SCAN_ALIKE)
    invert, mould = _moulds(changes, is_told=bool(names.order))
    return Pairs(
        rows=rows,
        evidence=evidence,
        earlier=_earlier(changes, names.order),
        questions=questions + doubts,
        invert=invert,
        mould=mould,
        before={row.patch: by_name[row.t0] for row in names.rows if row.t0},
        left=names.left,
        overviews=overviews,
    )


def _doubtful(name: str) -> str:
    """A name in a cell that is to be confirmed, once."""
    return f"{TODO} {name.removeprefix(TODO).strip()}".strip()


def _overviews(scans: Sequence[Scan]) -> list[Scan]:
    """Maps that are larger than the others, as of several places."""
    sized = [scan for scan in scans if scan.unit != TODO]
    usual = np.median([max(scan.size_mm) for scan in sized or scans])
    return [scan for scan in sized if max(scan.size_mm) > OVERVIEW * usual]


def _confirmed(
    row: Row, pair: _Change | None, changes: pd.DataFrame
) -> tuple[str, str]:
    """The evidence of the heights of a row, and a doubt about its t1, if there is one.

    If no scan of the study is found, other heights are no reason to doubt a single name.
    """
    if pair is None:
        return "", ""
    if pair.is_found:
        return " and heights", ""
    if not pair.is_comparable:
        return ", not compared: another spacing", ""
    if not changes.is_found.any():
        return "; not found by heights", ""
    doubt = f"{row.t1} does not show the surface of {row.t0}, but is named like it"
    return "", doubt


def _questions(changes: pd.DataFrame) -> Iterator[str]:
    """Doubts about the order of all pairs."""
    if not changes.is_found.any() and changes.is_comparable.sum() > 1:
        yield "no scan after use was found by its heights on the scan before use"
    if backwards := sum(changes.days < 0):
        pairs = f"{backwards} of {len(changes)} pairs"
        yield f"in {pairs}, t0 has a later date in its file than t1"


def _is_dated(changes: pd.DataFrame) -> bool:
    """Whether the dates in the files agree with the order."""
    return bool((changes.days >= 0).all() and changes.days.any())


def _earlier(changes: pd.DataFrame, order: str) -> str:
    """The sentence on which scans are earlier and why."""
    why = [order] if order else []
    why += ["by the dates in the files"] * _is_dated(changes)
    if fell := sum(changes.fell):
        why.append(f"{fell} of {len(changes)} lost height")
    return f"t0 is the earlier: {', '.join(why)}" if why else ""


def _moulds(changes: pd.DataFrame, *, is_told: bool) -> tuple[bool | str, str]:
    """Whether moulds were scanned, and why: there, heights rise where the stone lost some."""
    fell, rose = sum(changes.fell), sum(changes.rose)
    if rose == fell:
        return TODO, "the stone itself, or moulds of it? The files do not show it"
    way = "rose" if rose > fell else "fell"
    text = f"heights {way} with use in {max(rose, fell)} of {len(changes)} pairs"
    if way == "fell":
        return False, f"the stone itself was scanned: {text}"
    if is_told and _is_dated(changes):
        return True, f"moulds were scanned: {text}, and names and dates agree"
    return TODO, f"{text}: moulds were scanned, or t0 and t1 are exchanged"
