"""Names of scans as laboratories write them: the patch, before or after use, a repeat.

*Marks* are taken out of a name: words (before, vorher), epochs (T0, stage 2), counts (2000
strokes), dates, repeats. Scans whose names are alike without their marks are of one place. A name
with two readings becomes a question.
"""

import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import NamedTuple

from gst.config.patches import natural
from gstlib.errors import InputError

# English, German, French, Italian, Spanish and Portuguese, without accents.
_BEFORE = (
    "before beforeuse pre preuse unused unworn fresh initial new original vorher vor unbenutzt neu "
    "avant prima antes"
)
_AFTER = (
    "after afteruse post postuse used worn final nachher nach benutzt gebraucht apres dopo despues "
    "depois usato usado"
)
_RANKS = dict.fromkeys(_BEFORE.split(), 0) | dict.fromkeys(_AFTER.split(), 1)
_WORD = "|".join(_RANKS)
_COUNTED = (
    "strokes?|cycles?|cyc|zyklen|cicli|ciclos|pass|passes|blows?|hits?|coups|colpi|golpes|schlage"
    "|turns"
)
# Behind a date, there may be a time of day. The order is that of the dates with the year first: of
# the others, the day or the month may be the first number.
_MARK = re.compile(
    rf"""(?<![^\W_]) (?:
      (?P<day> 20\d\d(?P<gap>[-_.\ ]?)(?:0[1-9]|1[0-2])(?P=gap)(?:0[1-9]|[12]\d|3[01]))
        (?: [-_\ T]{{1,2}}(?:[01]\d|2[0-3])[-.]?[0-5]\d[-.]?[0-5]\d)?
    | \d{{1,2}}[-_.\ ]\d{{1,2}}[-_.\ ]20\d\d
    | (?P<word> {_WORD})
    | (?: t | (?: epoch|stage|state|phase|time|zeit|zustand|etat|fase) [\W_]*) (?P<epoch> \d+)
    | (?P<count> \d+) [\W_]* (?: {_COUNTED})
    | (?: {_COUNTED}) [\W_]* (?P<counted> \d+)
    | (?: rep|repeat|repeated|repetition|replicate|rescan|again|bis|dup|duplicate|wdh|wiederholung
        |ripetizione|repeticion|repeticao) (?P<repeat> \d*)
    ) (?![^\W_])""",
    re.IGNORECASE | re.VERBOSE,
)
# A name without a mark is later than one that is marked as the first, and earlier than any other.
_UNMARKED = (0.5,)


class Row(NamedTuple):
    """The scans of one place; "" where there is none."""

    patch: str
    t0: str
    t1: str = ""
    repeat: str = ""


class Names(NamedTuple):
    """Rows of a patch table from names of scans."""

    rows: list[Row]  # in natural order; where there are questions, the likely reading
    questions: list[str]
    order: (
        str  # what shows which scans are the earlier: "by name"; empty if nothing does
    )
    left: list[str]  # names in no row


@dataclass
class _Name:
    """A name, taken apart."""

    name: str
    place: list[str]  # what is left without marks
    ranks: list[float] = field(default_factory=list)  # of the marks of its epoch
    texts: list[str] = field(default_factory=list)  # of the same marks
    repeat: int = -1  # its number, 0 without one, -1 of a scan that is no repeat
    day: str = ""  # the date, as digits that sort
    epoch: int = 0  # 0 for the earliest

    @property
    def key(self) -> tuple[str, ...]:
        """The place without capitals and zeros before numbers."""
        return tuple(
            re.sub(r"\d+", lambda n: str(int(n[0])), part.casefold())
            for part in self.place
        )

    @property
    def state(self) -> tuple[float, ...]:
        """What its marks tell of its epoch."""
        return tuple(self.ranks) or _UNMARKED


def read_names(names: Iterable[str], pattern: str | None = None) -> Names:
    """Rows of a patch table from the names of scans, with ``/`` between folders.

    A `pattern` such as ``"{patch}_{epoch}"`` marks patch and epoch in names without an ending; the
    earlier epoch comes first in natural order. Raises an `InputError` if a name has another form.

    Examples
    --------
    >>> read_names(["loc1 after.sur", "loc1 before.sur"]).rows
    [Row(patch='1', t0='loc1 before.sur', t1='loc1 after.sur', repeat='')]
    >>> read_names(["S1a.sur", "S1b.sur"]).questions
    ['the names do not show which scan was made before use and which after use']
    >>> read_names(["S1a.sur", "S1b.sur"], "{patch}{epoch}").rows
    [Row(patch='1', t0='S1a.sur', t1='S1b.sur', repeat='')]
    """
    names = sorted(names)
    files = _by_pattern(names, pattern) if pattern else [*map(_taken_apart, names)]
    by_key: dict[tuple[str, ...], list[_Name]] = {}
    for file in files:
        by_key.setdefault(file.key, []).append(file)
    places = [*by_key.values()]
    order, questions = _order(files, places)
    rows, left = [], []
    for patch, place in zip(_patch_names(places), places, strict=True):
        scans = _scans_of(place)
        rest = [file for file in place if file not in scans]
        questions += _doubts(scans, rest)
        rows.append(Row(patch, *(file.name if file else "" for file in scans)))
        left += [file.name for file in rest]
    rows.sort(key=lambda row: natural(row.patch))
    return Names(rows, questions, order, left)


def _by_pattern(names: Sequence[str], pattern: str) -> list[_Name]:
    """Names in which a pattern marks patch and epoch."""
    form = re.escape(pattern)
    for part in ("patch", "epoch"):
        form = form.replace(rf"\{{{part}\}}", f"(?P<{part}>.+)", 1)
    files = []
    for name in names:
        match = re.fullmatch(form, str(PurePosixPath(name).with_suffix("")))
        if match is None or len(match.groupdict()) < 2:
            problem = f"does not have the form {pattern}"
            raise InputError(name, problem, "Correct --names, or rename it.")
        files.append(_Name(name, [match["patch"]], texts=[match["epoch"]]))
    epochs = {file.texts[0] for file in files}
    ordered = sorted(
        epochs, key=lambda text: (_RANKS.get(text.casefold(), 0), natural(text))
    )
    for file in files:
        file.ranks = [ordered.index(file.texts[0])]
    return files


def _taken_apart(name: str) -> _Name:
    """A name with its marks apart from the chunks that name the place."""
    path = PurePosixPath(unicodedata.normalize("NFKD", name)).with_suffix("")
    plain = "".join(c for c in str(path) if not unicodedata.combining(c))
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", plain)
    file = _Name(name, re.findall(r"[^\W_]+", _MARK.sub(" ", parted)))
    for match in _MARK.finditer(parted):
        kind = match.lastgroup
        if kind == "repeat":
            file.repeat = int(match[kind] or 0)
        elif kind == "day":
            file.day = re.sub(r"\D", "", match[kind])
        elif kind:
            rank = _RANKS.get(match[kind].casefold(), match[kind])
            file.ranks.append(float(rank))
            file.texts.append(match[0])
    return file


def _order(
    files: Sequence[_Name], places: Iterable[Sequence[_Name]]
) -> tuple[str, list[str]]:
    """Give each file its epoch. Returns what shows their order, and questions."""
    # a repeat does not need a mark of its epoch
    scans = [file for file in files if file.repeat < 0] or files
    texts = {scan.state: ", ".join(scan.texts) or "without it" for scan in scans}
    states = sorted(texts)
    listed = " and ".join(f'"{texts[state]}"' for state in states)
    if states == [_UNMARKED]:
        return _order_by_days(places)
    if len(states) == 1 and any(states[0]):
        problem = f"all names contain {listed}, so no scan before use is named"
        return "", [f"{problem}: please enter t0"]
    for file in files:
        file.epoch = states.index(file.state) if file.state in texts else 0
    questions = []
    if len(states) > 2:
        problem = f"there are {len(states)} states ({listed}), and a study compares two"
        questions.append(problem)
    elif any(one > other for one, other in zip(states[0], states[-1], strict=False)):
        questions.append(f"the marks do not agree in order ({listed})")
    return "by name", questions


def _order_by_days(places: Iterable[Sequence[_Name]]) -> tuple[str, list[str]]:
    """`_order` of names without marks, which dates may distinguish."""
    for place in places:
        days = sorted(file.day for file in place)
        if len(days) != 2 or not "" < days[0] < days[1]:
            text = "the names do not show which scan was made before use and which after use"
            return "", [text]
        for file in place:
            file.epoch = days.index(file.day)
    return "by the dates in the names", []


def _scans_of(place: Iterable[_Name]) -> list[_Name | None]:
    """The scans of a place before and after use, and the repeat of the first."""
    ordered = sorted(place, key=lambda file: file.repeat)
    latest = max(file.epoch for file in ordered)
    before = [file for file in ordered if file.epoch == 0]
    after = [file for file in ordered if file.epoch == latest > 0]
    again = [file for file in before[1:] if file.repeat >= 0]
    return [next(iter(files), None) for files in (before, after, again)]


def _doubts(scans: Sequence[_Name | None], rest: Iterable[_Name]) -> Iterator[str]:
    """Questions of one place: whether all of its scans are there, no others, and in order."""
    t0, t1, _ = scans
    if t1 and not t0:
        yield f"{t1.name} was scanned after use, and no scan before use is named like it"
    for file in rest:
        if file.repeat < 0:  # a further repeat is of no use, and no other place
            yield f"{file.name} is named like other scans, and is not in the table"
    if t0 and t1 and t0.day > t1.day > "":
        yield f"{t0.name} is named as before use, but has a later date than {t1.name}"


def _patch_names(places: Iterable[Sequence[_Name]]) -> list[str]:
    """A name for each place: the chunks that not all share, or else a number."""
    files = [place[0] for place in places]
    are_as_long = len({len(file.place) for file in files}) == 1
    chunks = [
        [(n * are_as_long, chunk) for n, chunk in enumerate(file.key)] for file in files
    ]
    shared = set.intersection(*map(set, chunks))
    patches = []
    for file, keys in zip(files, chunks, strict=True):
        pairs = zip(file.place, keys, strict=True)
        own = "-".join(written for written, key in pairs if key not in shared)
        patches.append(re.sub(r"[^A-Za-z0-9-]", "", own))
    if len({patch.lower() for patch in patches} - {"", "all"}) < len(patches):
        return [str(n) for n in range(1, len(patches) + 1)]
    return patches
