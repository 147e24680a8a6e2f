"""Scans as a laboratory keeps them: which show one place before and after use, and what says so.

What names say (`gst.setup.file_names`) is held against the heights. Where the two disagree, or
where either alone has two readings, a cell of the patch table begins with `TODO` and the likely
value follows: it is asked, not guessed.
"""

import functools
import itertools
import logging
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from gst.check.epochs import found_as
from gst.config.reading import complete
from gst.config.todo import TODO
from gst.setup.file_names import ORDER, PLACE, Names, Question, Row, read_names
from gstlib.change.change import measured_change, wear_summary
from gstlib.change.selection import is_more
from gstlib.errors import GstError, InputError
from gstlib.io.scans import is_scan, read_scan
from gstlib.io.stage import stage_of
from gstlib.io.text import SCAN_UNITS
from gstlib.preprocess.scans import prepare_scan
from gstlib.surfaces.grid import coarser, spacing_of

__all__ = ["OTHER_SPACING", "OVERVIEW", "Pairs", "Scan", "pair_scans", "read_scans", "scans_in"]

# Points along a scan that is compared with others, and points that make a loss.
_COARSE, _SPOT = 128, 2
# Fields (mm) that a scan of a patch or an overview can have: they tell the unit of text.
_FIELDS = 0.05, 30.0
# Comparing two scans takes a tenth of a second or two.
_MOST_COMPARED, _MOST_OTHERS = 400, 40
_NOT_FOUND, _ALONE = "; not found by heights", "; no other scan shows this place"
OTHER_SPACING, _NO_SPACING = "; not compared: another spacing", "; not compared: which spacing?"
# Spacings that differ by less (a share) are one.
_SAME_SPACING = 1e-3
# A map so many times as long as the other scans shows the places of several.
OVERVIEW = 1.8


@dataclass(frozen=True)
class Scan:
    """What a file says."""

    path: Path
    name: str  # its path in the folder of all scans, with ``/``
    # Its unit if the file does not state it, or `TODO` if nothing tells it; None if it does.
    unit: str | None
    shape: tuple[int, ...]  # (y, x)
    spacing_mm: tuple[float, float]  # (y, x)
    stage_mm: tuple[float, float] | None  # (x, y)
    acquired: str  # when, if the file says so
    coarse: xr.DataArray  # its heights (y, x) on fewer points

    @property
    def size_mm(self) -> tuple[float, float]:
        """Height and width."""
        (ny, nx), (dy, dx) = self.shape, self.spacing_mm
        return ny * dy, nx * dx

    @functools.cached_property
    def prepared(self) -> xr.Dataset:
        """Clean and level."""
        return prepare_scan(self.coarse, maximum_unmeasured=1.0)

    def made_coarser(self, times: int) -> xr.Dataset:
        """The same on elements so many times as long."""
        if times == 1:
            return self.prepared
        return prepare_scan(coarser(self.coarse, times), maximum_unmeasured=1.0)


def scans_in(given: Iterable[Path]) -> tuple[Path, list[Path], list[Path]]:
    """The folder of all scans, those in it, and other files there.

    Files that are named are scans, whatever their ending; in folders, it tells. Raises an
    `InputError` if there is no such file or folder, or no scan in it.
    """
    scans: set[Path] = set()
    others: set[Path] = set()
    roots = set()
    for path in given:
        if not path.exists():
            raise InputError(path, "no such file or folder", "Correct --scans.")
        is_folder, path = path.is_dir(), path.resolve()
        roots.add(path if is_folder else path.parent)
        for file in path.rglob("[!.]*") if is_folder else [path]:
            if file.is_file():
                (scans if is_scan(file) or not is_folder else others).add(file)
    root = Path(os.path.commonpath(sorted(roots)))
    if not scans:
        raise InputError(root, "holds no scan", "Name the folder of the scans as --scans.")
    return root, sorted(scans), sorted(others - scans)


def read_scans(root: Path, paths: Sequence[Path]) -> tuple[list[Scan], list[str]]:
    """What scans say, and why others cannot be read."""
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
    ny, nx = surface.shape
    return Scan(
        path=path,
        name=path.relative_to(root).as_posix(),
        unit=unit,
        shape=(ny, nx),
        spacing_mm=spacing_of(surface),
        stage_mm=stage_of(surface),
        acquired=_iso(surface.attrs.get("acquired", "")),
        coarse=coarser(surface, _halvings(min(ny, nx))),
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
            sides = (n * d for n, d in zip(surface.shape, spacing_of(surface), strict=True))
            if all(_FIELDS[0] <= side <= _FIELDS[1] for side in sides):
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
    evidence: list[str]  # for each row, what says that its scans show one place
    earlier: str  # which scans are the earlier, and why; empty if there is one epoch
    questions: list[str]  # what is not told, in sentences
    # Whether moulds were scanned: False if heights fell with use, as on the stone itself, or a
    # text that begins with `TODO`.
    invert: bool | str
    mould: str  # what tells it, or that nothing does
    left: list[str]  # names of scans that are in no row
    overviews: list[Scan]  # maps of several places


class _Compared(NamedTuple):
    """Whether a scan is found on another, and the shares of it that fell and rose."""

    found: bool
    loss: float = 0.0
    gain: float = 0.0


class _Comparisons:
    """Which scans show one place: each two are compared once."""

    def __init__(self, scans: Iterable[Scan]):
        self.scans = {scan.name: scan for scan in scans}
        self._known: dict[tuple[str, str], _Compared] = {}
        self._shift_mm: float = complete({})["registration"]["maximum_shift_mm"]

    def __call__(self, before: str, after: str) -> _Compared:
        if (before, after) not in self._known:
            one, other = self.scans[before], self.scans[after]
            steps = [spacing_of(scan.coarse)[1] for scan in (one, other)]
            # a larger map may have been made coarser, by powers of two
            pair = [
                scan.made_coarser(round(max(steps) / step))
                for scan, step in zip((one, other), steps, strict=True)
            ]
            self._known[before, after] = self._compare(*pair)
        return self._known[before, after]

    def can(self, before: str, after: str) -> bool:
        """Whether the heights of two scans can be compared: on one spacing alone."""
        steps = [max(self.scans[name].spacing_mm) for name in (before, after)]
        return max(steps) <= (1 + _SAME_SPACING) * min(steps)

    def turned(self, before: str, after: str) -> str:
        """The orientation in which a scan is found on another; empty if there is none."""
        one, other = (self.scans[name].prepared.height for name in (before, after))
        return found_as(one, other, maximum_shift_mm=self._shift_mm)

    def _compare(self, before: xr.Dataset, after: xr.Dataset) -> _Compared:
        shift_mm = self._shift_mm
        try:
            registration, change = measured_change(
                before, after, maximum_shift_mm=shift_mm, minimum_points=_SPOT
            )
        except InputError:  # another spacing, or other heights
            return _Compared(False)
        if not registration.found:
            return _Compared(False)
        changed = wear_summary(change)
        return _Compared(True, changed["loss_fraction"], changed["gain_fraction"])


def pair_scans(scans: Sequence[Scan]) -> Pairs:
    """Which scans belong together, and which was made first, by names and heights."""
    overviews = _overviews(scans)
    compare = _Comparisons(scan for scan in scans if scan not in overviews)
    told = _Told(read_names(compare.scans), False, False, {})
    if {question.kind for question in told.names.questions} & {PLACE, ORDER}:
        told = _by_heights(told, compare)
    names = told.names
    held = [_held_against_heights(row, names.rows, compare) for row in names.rows]
    pairs = [(row.t0, row.t1) for row in names.rows if row.t0 and row.t1]
    order = _Evidence.of(pairs, compare)
    earlier, doubts = _which_is_earlier(names.epochs, order)
    questions = [question.text for question in names.questions] + doubts
    rows = [
        row._replace(t0=row.t0 or TODO, t1=_doubtful(row.t1))
        if questions or row.t0 in told.open
        else row
        for row, _, _ in held
    ]
    questions += [text for _, _, own in held for text in own] + [*told.open.values()]
    evidence = [
        f"by heights{_ALONE if not row.t1 else ''}" if told.by_heights else f"by name{said}"
        for row, said, _ in held
    ]
    mould = _stone_or_mould(names.epochs, order, by_loss=told.by_loss)
    return Pairs(rows, evidence, earlier, questions, *mould, names.left, overviews)


def _doubtful(name: str) -> str:
    """A name in a cell that is to be confirmed, once."""
    return f"{TODO} {name.removeprefix(TODO).strip()}".strip()


def _overviews(scans: Sequence[Scan]) -> list[Scan]:
    """Maps that are larger than the others, as of several places."""
    known = [scan for scan in scans if scan.unit != TODO]  # of the others, the size is not
    usual = np.median([max(scan.size_mm) for scan in known or scans])
    return [scan for scan in known if max(scan.size_mm) > OVERVIEW * usual]


class _Told(NamedTuple):
    """Rows, what tells them, and questions by the scan at t0."""

    names: Names
    by_heights: bool
    by_loss: bool  # whether lost height alone says which is earlier
    open: dict[str, str]


def _by_heights(told: _Told, compare: _Comparisons) -> _Told:
    """What heights tell where names do not, unless there are too many to compare."""
    everything = sorted(compare.scans)
    couples = list(itertools.combinations(everything, 2))
    if len(couples) > _MOST_COMPARED:
        text = f"{len(everything)} scans are too many to compare the heights of each two"
        asked = [*told.names.questions, Question(PLACE, text)]
        return told._replace(names=told.names._replace(questions=asked))
    places = {name: number for number, name in enumerate(everything)}
    for one, other in couples:
        if places[one] != places[other] and compare(one, other).found:
            former, now = places[other], places[one]
            places = {name: now if of == former else of for name, of in places.items()}
    if all(question.kind != ORDER for question in told.names.questions):
        return _Told(read_names(everything, places), True, False, {})
    one, *rest = everything
    if not all(compare.can(one, other) for other in rest):  # not found on each other
        return told
    later: set[str] = set()
    by_loss, questions = False, dict[str, str]()
    for place in sorted({*places.values()}):
        there = [name for name in everything if places[name] == place]
        if len(there) == 1:
            continue
        last, is_by_loss = _last_of(there, compare)
        by_loss |= is_by_loss
        later.add(last or there[-1])
        if last is None:
            shown = " and ".join(there)
            text = f"nothing tells which of {shown} was made before use, and which after it"
            questions[there[0]] = text
    return _Told(read_names(everything, places, later), True, by_loss, questions)


def _last_of(there: Sequence[str], compare: _Comparisons) -> tuple[str | None, bool]:
    """Which of two scans of a place is the later, and whether only lost height tells it."""
    if len(there) > 2:
        return None, False
    one, other = there
    days = [compare.scans[name].acquired for name in there]
    if all(days) and days[0] != days[1]:
        return (other if days[1] > days[0] else one), False
    changed = compare(one, other)
    if is_more(changed.loss, changed.gain):
        return other, True
    return (one, True) if is_more(changed.gain, changed.loss) else (None, False)


def _held_against_heights(
    row: Row, rows: Sequence[Row], compare: _Comparisons
) -> tuple[Row, str, list[str]]:
    """A row with its doubtful cells, what heights say of its scans, and questions."""
    t0, t1, again = row.t0, row.t1, row.repeat
    if again and not compare(t0, again).found:
        text = f"{again} is named as a repeat of {t0}, and does not show its place"
        return row._replace(repeat=_doubtful(again)), "", [text]
    if not (t0 and t1):
        return row, " and heights" * bool(again), []
    if len({compare.scans[name].unit == TODO for name in (t0, t1)}) > 1:  # both may be alike
        return row, _NO_SPACING, []
    if not compare.can(t0, t1):
        return row, OTHER_SPACING, []
    if compare(t0, t1).found:
        return row, " and heights", []
    others = [other.t0 for other in rows if other.t0 not in ("", t0)][:_MOST_OTHERS]
    text = next(
        (
            f"{t1} shows the place of {other}, and is named like {t0}"
            for other in others
            if compare(other, t1).found
        ),
        "",
    )
    if not text and (turned := compare.turned(t0, t1)):
        text = (
            f"{t1} fits {t0} if it is {turned}: the two files begin at different corners, or it "
            "was scanned otherwise; turn it in the program that wrote it"
        )
    if text:
        return row._replace(t1=_doubtful(t1)), "", [text]
    return row, _NOT_FOUND, []


class _Evidence(NamedTuple):
    """In how many pairs something speaks for or against the order of t0 and t1."""

    pairs: int
    compared: int  # whose heights can be
    found: int  # on each other by their heights
    fell: int  # whose heights clearly fell from t0 to t1
    rose: int
    dated: int  # whose files have two dates
    backwards: int  # of these, with the later one at t0

    @classmethod
    def of(cls, pairs: Sequence[tuple[str, str]], compare: _Comparisons) -> "_Evidence":
        found = [each for pair in pairs if (each := compare(*pair)).found]
        when = [[compare.scans[name].acquired for name in pair] for pair in pairs]
        dated = [pair for pair in when if all(pair) and pair[0] != pair[1]]
        return cls(
            pairs=len(pairs),
            compared=sum(compare.can(*pair) for pair in pairs),
            found=len(found),
            fell=sum(bool(is_more(each.loss, each.gain)) for each in found),
            rose=sum(bool(is_more(each.gain, each.loss)) for each in found),
            dated=len(dated),
            backwards=sum(before > after for before, after in dated),
        )

    @property
    def has_order_of_dates(self) -> bool:
        return self.dated > 0 and self.backwards == 0


def _which_is_earlier(epochs: tuple[str, str], evidence: _Evidence) -> tuple[str, list[str]]:
    """Which scans are the earlier and why, and questions."""
    pairs, compared, found, fell, *_ = evidence
    by = ["by name"] * any(epochs)
    by += ["by the dates in the files"] * evidence.has_order_of_dates
    by += [f"{fell} of {pairs} lost height"] * bool(fell)
    questions = []
    if not found and compared > 1:
        questions.append("no scan after use is found by its heights on the one before use")
    if evidence.backwards:
        text = (
            f"in {evidence.backwards} of {pairs} pairs, t0 has a later date in its file than t1"
        )
        questions.append(text)
    return f"{epochs[0] or 't0'} is the earlier: {', '.join(by)}" if by else "", questions


def _stone_or_mould(
    epochs: tuple[str, str], evidence: _Evidence, *, by_loss: bool
) -> tuple[bool | str, str]:
    """Whether moulds were scanned, and why: there, heights rise where the stone lost some."""
    pairs, _, _, fell, rose, *_ = evidence
    if rose > fell:
        said = f"heights rose with use in {rose} of {pairs} pairs"
        if any(epochs) and evidence.has_order_of_dates:
            return True, f"moulds were scanned: {said}, and names and dates agree"
        return TODO, f"{said}: moulds were scanned, or t0 and t1 are exchanged"
    if fell > rose and by_loss:
        return f"{TODO} false", (
            "t0 and t1 are told apart by lost height, as on the stone itself; of moulds, it is the "
            "other way round"
        )
    if fell > rose:
        return (
            False,
            f"the stone itself was scanned: heights fell with use in {fell} of {pairs} pairs",
        )
    return TODO, "the stone itself, or moulds of it? Nothing tells"
