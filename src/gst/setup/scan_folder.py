"""Scans as a laboratory keeps them, paired by place before and after use, with the evidence.

Names decide (`gst.setup.file_names`), and heights confirm. Where the two disagree, or names have
two readings, a cell of the patch table begins with `TODO` and the likely value follows.
"""

import functools
import logging
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import islice
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

__all__ = [
    "OTHER_SPACING",
    "OVERVIEW",
    "Pairs",
    "Scan",
    "pair_scans",
    "read_scans",
    "scans_in",
]

# Points along a scan that is compared with others, and points that make a loss.
_COARSE, _SPOT = 128, 2
# Fields (mm) that a scan of a patch or an overview can have: they determine the unit of text.
_FIELDS = 0.05, 30.0
# Scans with which one that does not fit its own is compared: each takes a tenth of a second or two.
_MOST_OTHERS = 40
_NOT_FOUND = "; not found by heights"
OTHER_SPACING, _NO_SPACING = (
    "; not compared: another spacing",
    "; not compared: which spacing?",
)
# Spacings that differ by less (a share) are one.
_SAME_SPACING = 1e-3
# A map so many times as long as the other scans shows the places of several.
OVERVIEW = 1.8


@dataclass(frozen=True)
class Scan:
    """The content of a file."""

    path: Path
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


def scans_in(paths: Iterable[Path]) -> tuple[Path, list[Path], list[Path]]:
    """The folder of all scans, those in it, and other files there.

    Files that are named are scans, whatever their ending; in folders, the ending decides. Raises an
    `InputError` if there is no such file or folder, or no scan in it.
    """
    scans: set[Path] = set()
    others: set[Path] = set()
    roots = set()
    for path in paths:
        if not path.exists():
            raise InputError(path, "no such file or folder", "Correct --scans.")
        is_folder, path = path.is_dir(), path.resolve()
        roots.add(path if is_folder else path.parent)
        for file in path.rglob("[!.]*") if is_folder else [path]:
            if file.is_file():
                (scans if is_scan(file) or not is_folder else others).add(file)
    root = Path(os.path.commonpath(sorted(roots)))
    if not scans:
        raise InputError(
            root, "contains no scan", "Name the folder of the scans as --scans."
        )
    return root, sorted(scans), sorted(others - scans)


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
        path=path,
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
    left: list[str]  # names of scans that are in no row
    overviews: list[Scan]  # maps of several places


class _Compared(NamedTuple):
    """Whether a scan is found on another, and the shares of it that fell and rose."""

    is_found: bool
    loss: float = 0.0
    gain: float = 0.0


class _Comparisons:
    """Which scans show one place: each two are compared once."""

    def __init__(self, scans: Iterable[Scan]):
        self.scans = {scan.name: scan for scan in scans}
        self.match = functools.cache(self._compare)
        self._shift_mm: float = complete({})["registration"]["maximum_shift_mm"]

    def _compare(self, before: str, after: str) -> _Compared:
        scans = self.scans[before], self.scans[after]
        steps = [spacing_of(scan.coarse)[1] for scan in scans]
        # a larger map may have been made coarser, by powers of two
        pair = [
            scan.prepared(round(max(steps) / step))
            for scan, step in zip(scans, steps, strict=True)
        ]
        try:
            registration, change = measured_change(
                *pair, maximum_shift_mm=self._shift_mm, minimum_cluster_points=_SPOT
            )
        except InputError:  # another spacing, or other heights
            return _Compared(False)
        if not registration.is_reliable:
            return _Compared(False)
        changed = wear_summary(change)
        return _Compared(True, changed["loss_fraction"], changed["gain_fraction"])

    def can(self, before: str, after: str) -> bool:
        """Whether the heights of two scans can be compared: on one spacing alone."""
        steps = [max(self.scans[name].spacing_mm) for name in (before, after)]
        return max(steps) <= (1 + _SAME_SPACING) * min(steps)


def pair_scans(scans: Sequence[Scan], pattern: str | None = None) -> Pairs:
    """Which scans belong together, and which was made first, by names that heights confirm."""
    overviews = _overviews(scans)
    compared = _Comparisons(scan for scan in scans if scan not in overviews)
    names = read_names(compared.scans, pattern)
    confirmed = [_confirmed(row, names.rows, compared) for row in names.rows]
    order = _Order.counted(
        [(row.t0, row.t1) for row in names.rows if row.t0 and row.t1], compared
    )
    earlier, questions = order.of_epochs(names.epochs)
    questions = [*names.questions, *questions]
    rows = [
        row._replace(t0=row.t0 or TODO, t1=_doubtful(row.t1)) if questions else row
        for row, _, _ in confirmed
    ]
    return Pairs(
        rows,
        [f"by name{evidence}" for _, evidence, _ in confirmed],
        earlier,
        [*questions, *(doubt for _, _, doubt in confirmed if doubt)],
        *order.of_moulds(is_told=any(names.epochs)),
        names.left,
        overviews,
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
    row: Row, rows: Sequence[Row], compared: _Comparisons
) -> tuple[Row, str, str]:
    """A row with its doubtful cells, the evidence of its heights, and a question."""
    _, t0, t1, again = row
    if again and not compared.match(t0, again).is_found:
        text = f"{again} is named as a repeat of {t0}, but does not show its surface"
        return row._replace(repeat=_doubtful(again)), "", text
    if not (t0 and t1):
        return row, " and heights" * bool(again), ""
    if (
        len({compared.scans[name].unit == TODO for name in (t0, t1)}) > 1
    ):  # both may be alike
        return row, _NO_SPACING, ""
    if not compared.can(t0, t1):
        return row, OTHER_SPACING, ""
    if compared.match(t0, t1).is_found:
        return row, " and heights", ""
    others = (other.t0 for other in rows if other.t0 not in ("", t0))
    other = next(
        (o for o in islice(others, _MOST_OTHERS) if compared.match(o, t1).is_found), ""
    )
    if not other:
        return row, _NOT_FOUND, ""
    text = f"{t1} shows the surface of {other}, but is named like {t0}"
    return row._replace(t1=_doubtful(t1)), "", text


class _Order(NamedTuple):
    """Numbers of pairs that support or contradict the order of t0 and t1."""

    pairs: int
    compared: int  # pairs whose heights can be compared
    matched: int  # pairs of scans that are found on each other by their heights
    fell: int  # pairs whose heights clearly fell from t0 to t1
    rose: int
    dated: int  # pairs whose files have two dates
    backwards: int  # of these, with the later one at t0

    @classmethod
    def counted(
        cls, pairs: Sequence[tuple[str, str]], compared: _Comparisons
    ) -> "_Order":
        matches = [each for pair in pairs if (each := compared.match(*pair)).is_found]
        when = [[compared.scans[name].acquired for name in pair] for pair in pairs]
        dated = [pair for pair in when if all(pair) and pair[0] != pair[1]]
        return cls(
            pairs=len(pairs),
            compared=sum(compared.can(*pair) for pair in pairs),
            matched=len(matches),
            fell=sum(bool(is_more(each.loss, each.gain)) for each in matches),
            rose=sum(bool(is_more(each.gain, each.loss)) for each in matches),
            dated=len(dated),
            backwards=sum(before > after for before, after in dated),
        )

    @property
    def agrees_with_dates(self) -> bool:
        return self.dated > 0 and self.backwards == 0

    def of_epochs(self, epochs: tuple[str, str]) -> tuple[str, list[str]]:
        """The sentence on which scans are earlier and why, and questions."""
        why = ["by name"] * any(epochs)
        why += ["by the dates in the files"] * self.agrees_with_dates
        why += [f"{self.fell} of {self.pairs} lost height"] * bool(self.fell)
        questions = []
        if not self.matched and self.compared > 1:
            questions.append(
                "no scan after use was found by its heights on the scan before use"
            )
        if self.backwards:
            pairs = f"{self.backwards} of {self.pairs} pairs"
            questions.append(f"in {pairs}, t0 has a later date in its file than t1")
        return f"{epochs[0] or 't0'} is the earlier: {', '.join(why)}" * bool(
            why
        ), questions

    def of_moulds(self, *, is_told: bool) -> tuple[bool | str, str]:
        """Whether moulds were scanned, and why: there, heights rise where the stone lost some."""
        if self.rose > self.fell:
            text = f"heights rose with use in {self.rose} of {self.pairs} pairs"
            if is_told and self.agrees_with_dates:
                return True, f"moulds were scanned: {text}, and names and dates agree"
            return TODO, f"{text}: moulds were scanned, or t0 and t1 are exchanged"
        if self.fell > self.rose:
            pairs = f"{self.fell} of {self.pairs} pairs"
            return (
                False,
                f"the stone itself was scanned: heights fell with use in {pairs}",
            )
        return TODO, "the stone itself, or moulds of it? The files do not show it"
