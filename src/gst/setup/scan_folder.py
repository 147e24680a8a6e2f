"""Scans as a laboratory keeps them, paired by place before and after use, with the evidence.

Names decide (`gst.setup.file_names`), and heights confirm. Where the two disagree, or names have
two readings, a cell of the patch table begins with `TODO` and the likely value follows.
"""

import logging
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from gst.check.sliding import sides_of
from gst.config.reading import complete
from gst.config.todo import TODO
from gst.setup.file_names import Row, read_names
from gstlib.change.change import measured_change, wear_summary
from gstlib.change.selection import is_more
from gstlib.errors import GstError, InputError
from gstlib.io.scans import is_scan, read_scan
from gstlib.io.stage import stage_of
from gstlib.io.text import SCAN_UNITS
from gstlib.preprocess.scans import prepare_scan
from gstlib.surfaces.grid import coarser, spacing_of

# Points along a scan that is compared with others, and points that make a loss.
_COARSE, _SPOT = 128, 2
# Fields (mm) that a scan of a patch or an overview can have: they determine the unit of text.
_FIELDS = 0.05, 30.0
_OTHER_SPACING = ", not compared: another spacing"
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

    def prepared(self, times: int = 1) -> xr.Dataset:
        """Clean and level, on elements so many times as long."""
        return prepare_scan(coarser(self.coarse, times), maximum_unmeasured=1.0)


def scans_in(paths: Sequence[Path]) -> tuple[Path, list[Path], list[Path]]:
    """The folder of all scans, those in it, and other files there.

    Files that are named are scans, whatever their ending; in folders, the ending decides. Raises an
    `InputError` if there is no such file or folder, or no scan in it.
    """
    for path in paths:
        if not path.exists():
            raise InputError(path, "no such file or folder", "Correct --scans.")
    named = [path.resolve() for path in paths]
    roots = [path if path.is_dir() else path.parent for path in named]
    root = Path(os.path.commonpath(roots))
    scans = {path for path in named if path.is_file()}
    inside = (file for path in named if path.is_dir() for file in path.rglob("[!.]*"))
    files = {file for file in inside if file.is_file()}
    scans |= {file for file in files if is_scan(file)}
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
    unit = None
    try:
        surface = read_scan(path)
    except InputError as error:
        surface, unit = _in_likely_unit(path, error)
    return Scan(
        name=path.relative_to(root).as_posix(),
        unit=unit,
        size_mm=sides_of(surface),
        spacing_mm=spacing_of(surface),
        stage_mm=stage_of(surface),
        acquired=_iso(surface.attrs.get("acquired", "")),
        coarse=coarser(surface, _halvings(min(surface.shape))),
    )


def _in_likely_unit(path: Path, error: InputError) -> tuple[xr.DataArray, str]:
    """A scan that does not state its unit, in the only one that makes a field of its size."""
    fitting = []
    logging.disable()
    try:
        for unit in SCAN_UNITS:
            try:
                surface = read_scan(path, unit=unit)
            except InputError:
                continue
            if all(_FIELDS[0] <= side <= _FIELDS[1] for side in sides_of(surface)):
                fitting.append((surface, unit))
        if len(fitting) == 1:
            return fitting[0]
        return read_scan(path, unit="um", spacing_um=1.0), TODO
    except InputError:
        raise error from None
    finally:
        logging.disable(logging.NOTSET)


def _iso(text: str) -> str:
    """A date that sorts; empty if it is none."""
    try:
        return datetime.fromisoformat(text).isoformat()
    except ValueError:
        return ""


def _halvings(points: int) -> int:
    """A power of two, so that scans of different sizes stay on one spacing."""
    return 1 << max(0, (points // _COARSE).bit_length() - 1)


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


class _Pair:
    """Two scans that are named as of one place, and the change of their heights."""

    def __init__(self, before: Scan, after: Scan):
        self.dates = before.acquired, after.acquired
        self.is_found = self.fell = self.rose = False
        spacings = max(before.spacing_mm), max(after.spacing_mm)
        self.obstacle = ""  # to a comparison of their heights
        if (before.unit == TODO) != (after.unit == TODO):
            self.obstacle = ", not compared: which spacing?"
        elif max(spacings) > (1 + _SAME_SPACING) * min(spacings):
            self.obstacle = _OTHER_SPACING
        else:
            self._compare(before, after)

    def _compare(self, before: Scan, after: Scan) -> None:
        steps = [spacing_of(scan.coarse)[1] for scan in (before, after)]
        # a larger map may have been made coarser, by powers of two
        pair = [
            scan.prepared(round(max(steps) / step))
            for scan, step in zip((before, after), steps, strict=True)
        ]
        shift_mm: float = complete({})["registration"]["maximum_shift_mm"]
        try:
            registration, change = measured_change(
                *pair, maximum_shift_mm=shift_mm, minimum_cluster_points=_SPOT
            )
        except InputError:  # other heights
            return
        self.is_found = bool(registration.is_reliable)
        if self.is_found:
            shares = wear_summary(change)
            loss, gain = shares["loss_fraction"], shares["gain_fraction"]
            self.fell = bool(is_more(loss, gain))
            self.rose = bool(is_more(gain, loss))


def pair_scans(scans: Sequence[Scan], pattern: str | None = None) -> Pairs:
    """Which scans belong together, and which was made first, by names that heights confirm."""
    overviews = _overviews(scans)
    by_name = {scan.name: scan for scan in scans if scan not in overviews}
    names = read_names(by_name, pattern)
    pairs, repeats = (
        {
            row.patch: _Pair(by_name[row.t0], by_name[getattr(row, column)])
            for row in names.rows
            if row.t0 and getattr(row, column)
        }
        for column in ("t1", "repeat")
    )
    order = _Order([*pairs.values()])
    questions = [*names.questions, *order.questions()]
    rows, evidence, doubts = [], [], []
    for row in names.rows:
        pair, repeat = pairs.get(row.patch), repeats.get(row.patch)
        column, why = _confirmed(row, pair, repeat, is_alone=not order.found)
        evidence.append("by name" if column else f"by name{why}")
        if column:
            row = row._replace(**{column: _doubtful(getattr(row, column))})
            doubts.append(why)
        if questions:
            row = row._replace(t0=row.t0 or TODO, t1=_doubtful(row.t1))
        rows.append(row)
    if any(pair.obstacle == _OTHER_SPACING for pair in pairs.values()):
        doubts.append(_SCAN_ALIKE)
    invert, mould = order.moulds(is_told=any(names.epochs))
    return Pairs(
        rows=rows,
        evidence=evidence,
        earlier=order.earlier(names.epochs),
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
    row: Row, pair: _Pair | None, repeat: _Pair | None, *, is_alone: bool
) -> tuple[str, str]:
    """The doubtful column of a row with the reason, or none with the evidence of its heights.

    If no scan of the study `is_found`, other heights are no reason to doubt a single name.
    """
    if repeat and not repeat.is_found:
        text = f"{row.repeat} is named as a repeat of {row.t0}, but does not show its surface"
        return "repeat", text
    if pair and not (pair.is_found or pair.obstacle or is_alone):
        return (
            "t1",
            f"{row.t1} does not show the surface of {row.t0}, but is named like it",
        )
    if pair and not pair.is_found:
        return "", pair.obstacle or "; not found by heights"
    return "", " and heights" * bool(pair or repeat)


class _Order:
    """Which scans of pairs are the earlier, and whether moulds were scanned."""

    def __init__(self, pairs: Sequence[_Pair]):
        self.pairs = pairs
        self.found = sum(pair.is_found for pair in pairs)
        self.fell = sum(pair.fell for pair in pairs)
        self.rose = sum(pair.rose for pair in pairs)
        dates = [pair.dates for pair in pairs if all(pair.dates)]
        self.forwards = sum(before < after for before, after in dates)
        self.backwards = sum(before > after for before, after in dates)

    @property
    def is_dated(self) -> bool:
        """Whether the dates in the files agree with the order."""
        return self.forwards > 0 and self.backwards == 0

    def questions(self) -> Iterator[str]:
        if not self.found and sum(not pair.obstacle for pair in self.pairs) > 1:
            yield "no scan after use was found by its heights on the scan before use"
        if self.backwards:
            pairs = f"{self.backwards} of {len(self.pairs)} pairs"
            yield f"in {pairs}, t0 has a later date in its file than t1"

    def earlier(self, epochs: tuple[str, str]) -> str:
        """The sentence on which scans are earlier and why."""
        why = ["by name"] * any(epochs)
        why += ["by the dates in the files"] * self.is_dated
        why += [f"{self.fell} of {len(self.pairs)} lost height"] * bool(self.fell)
        return f"{epochs[0] or 't0'} is the earlier: {', '.join(why)}" if why else ""

    def moulds(self, *, is_told: bool) -> tuple[bool | str, str]:
        """Whether moulds were scanned, and why: there, heights rise where the stone lost some."""
        way, number = max(
            ("rose", self.rose), ("fell", self.fell), key=lambda one: one[1]
        )
        text = f"heights {way} with use in {number} of {len(self.pairs)} pairs"
        if self.rose == self.fell:
            return TODO, "the stone itself, or moulds of it? The files do not show it"
        if way == "fell":
            return False, f"the stone itself was scanned: {text}"
        if is_told and self.is_dated:
            return True, f"moulds were scanned: {text}, and names and dates agree"
        return TODO, f"{text}: moulds were scanned, or t0 and t1 are exchanged"
