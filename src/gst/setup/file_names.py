"""Names of scans as laboratories write them: the patch, before or after use, a repeat.

*Marks* are taken out of a name: words (before, vorher), epochs (T0, stage 2), amounts of use
(2000 strokes, 2 h), dates, repeats. Scans whose names are alike without their marks are of one
place. A name with two readings becomes a question.
"""

import math
import re
import unicodedata
from collections.abc import Collection, Iterable, Iterator, Sequence
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
_WORDS = dict.fromkeys(_BEFORE.split(), 0.0) | dict.fromkeys(_AFTER.split(), 1.0)
# Kinds of amounts of use, and how many of the kind's unit a word stands for.
_AMOUNTS = {
    word: (kind, unit)
    for kind, unit, words in (
        ("time", 60.0, "h hr hrs hour hours stunden"),
        ("time", 1.0, "min mins minute minutes minuten"),
        ("time", 1 / 60, "sec second seconds sekunden"),
        ("strokes", 1.0, "stroke strokes"),
        ("cycles", 1.0, "cycle cycles cyc zyklen cicli ciclos"),
        (
            "blows",
            1.0,
            "pass passes blow blows hit hits coups colpi golpes schlage turns",
        ),
    )
    for word in words.split()
}
# "H1" names a place rather than an hour.
_LEADING = "|".join(word for word in _AMOUNTS if len(word) > 2)
_MARK = re.compile(
    rf"""(?<![^\W_]) (?:
      (?P<word> {"|".join(_WORDS)})
    | (?: t | (?: epoch|stage|state|phase|time|zeit|zustand|etat|fase) [\W_]*) (?P<epoch> \d+)
    | (?P<amount> \d+) [\W_]* (?P<unit> {"|".join(_AMOUNTS)})
    | (?P<leading> {_LEADING}) [\W_]* (?P<counted> \d+)
    | (?: rep|repeat|repeated|repetition|replicate|rescan|again|bis|dup|duplicate|wdh|wiederholung
        |ripetizione|repeticion|repeticao) (?P<repeat> \d*)
    ) (?![^\W_])""",
    re.IGNORECASE | re.VERBOSE,
)
# A date, and behind it perhaps a time of day. The order is that of the dates with the year first:
# of the others, the day or the month may be the first number.
_DATE = re.compile(
    r"(?<!\d)(?:(?P<y>20\d\d)([-_. ]?)(?P<m>0[1-9]|1[0-2])\2(?P<d>0[1-9]|[12]\d|3[01])"
    r"|\d{1,2}([-_. ])\d{1,2}\5(?:20\d\d))(?!\d)"
    r"(?:[-_ T](?:[01]\d|2[0-3])([-.]?)[0-5]\d\6[0-5]\d(?!\d))?"
)


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
    # Marks of the earlier and the later scans, such as ``"before"`` and ``"after"``, in quotes if
    # the names contain them; empty if there are none.
    epochs: tuple[str, str]
    left: list[str]  # names in no row


@dataclass
class _Name:
    """A name, taken apart."""

    name: str
    place: list[str] = field(default_factory=list)  # what is left without marks
    marks: dict[str, float] = field(default_factory=dict)  # rank by kind of mark
    texts: list[str] = field(default_factory=list)  # of the marks
    repeat: int | None = None  # 0 if it has no number
    day: str = ""  # the date, as digits that sort
    rank: int = 0  # among all files, lower before higher

    @property
    def key(self) -> tuple[str, ...]:
        """The place without capitals and zeros before numbers."""
        return tuple(
            re.sub(r"\d+", lambda n: str(int(n[0])), part.casefold())
            for part in self.place
        )

    def mark(self, match: re.Match) -> str:
        """Note a mark, and return what stands in its place."""
        if match["repeat"] is not None:
            self.repeat = int(match["repeat"] or 0)
            return " "
        if match["word"]:
            kind, rank = "word", _WORDS[match["word"].casefold()]
        elif match["epoch"]:
            kind, rank = "epoch", float(match["epoch"])
        else:
            kind, unit = _AMOUNTS[(match["unit"] or match["leading"]).casefold()]
            rank = unit * float(match["amount"] or match["counted"])
        while kind in self.marks:
            kind = f"another {kind}"
        self.marks[kind] = rank
        self.texts.append(match[0])
        return " "


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
    places: dict[tuple[str, ...], list[_Name]] = {}
    for file in files:
        places.setdefault(file.key, []).append(file)
    epochs, questions = _rank(files, places.values())
    earliest = min(file.rank for file in files)
    rows, left = [], []
    patches = _patch_names([place[0] for place in places.values()])
    for patch, place in zip(patches, places.values(), strict=True):
        scans, rest = _scans_of(place, earliest)
        questions += _doubts(scans, rest, places)
        rows.append(Row(patch, *(file.name if file else "" for file in scans)))
        left += [file.name for file in rest]
    rows.sort(key=lambda row: natural(row.patch))
    return Names(rows, questions, epochs, left)


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
    epochs = sorted(
        {file.texts[0] for file in files},
        key=lambda epoch: (_WORDS.get(epoch.casefold(), 0.0), natural(epoch)),
    )
    for file in files:
        file.marks["epoch"] = float(epochs.index(file.texts[0]))
    return files


def _taken_apart(name: str) -> _Name:
    """A name with its marks apart from the chunks that name the place."""
    file = _Name(name)
    path = PurePosixPath(unicodedata.normalize("NFKD", name))
    plain = "".join(
        c for c in str(path.with_suffix("")) if not unicodedata.combining(c)
    )
    if date := _DATE.search(plain):
        file.day = "".join(date.group("y", "m", "d")) if date["y"] else ""
        plain = f"{plain[: date.start()]} {plain[date.end() :]}"
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", plain)
    file.place = re.findall(r"[^\W_]+", _MARK.sub(file.mark, parted))
    return file


def _rank(
    files: Sequence[_Name], places: Collection[Sequence[_Name]]
) -> tuple[tuple[str, str], list[str]]:
    """Give each file its rank. Returns the marks of earlier and later ones, and questions."""
    # a repeat does not need an epoch
    scans = [file for file in files if file.repeat is None] or files
    kinds = sorted({kind for scan in scans for kind in scan.marks})
    ranks = {kind: {scan.marks.get(kind) for scan in scans} for kind in kinds}
    varying = [kind for kind in kinds if len(ranks[kind]) > 1]
    if not varying:
        return _rank_by_days(scans[0], places)
    # scans without the mark have the other epoch
    absent = {}
    for kind in varying:
        present = [scan.marks[kind] for scan in scans if kind in scan.marks]
        absent[kind] = -1.0 if min(present) > 0 else math.inf

    def state_of(file: _Name) -> tuple[float, ...]:
        return tuple(file.marks.get(kind, absent[kind]) for kind in varying)

    texts = {state_of(scan): ", ".join(scan.texts) or "without it" for scan in scans}
    states = sorted(texts)
    for file in files:
        state = state_of(file)
        # a repeat without the mark has the earliest
        file.rank = states.index(state) if state in texts else 0
    shown = [f'"{texts[state]}"' for state in states]
    questions = []
    if len(states) > 2:
        listed = ", ".join(shown)
        questions.append(
            f"there are {len(states)} states ({listed}), and a study compares two"
        )
    elif any(one > other for one, other in zip(*states, strict=True)):
        questions.append(f"the marks do not agree in order ({' and '.join(shown)})")
    return (shown[0], shown[-1]), questions


def _rank_by_days(
    first: _Name, places: Collection[Sequence[_Name]]
) -> tuple[tuple[str, str], list[str]]:
    """`_rank` of names with no marks that differ: all of one epoch, or distinguished by dates."""
    if first.marks:
        text = ", ".join(first.texts)
        if not any(first.marks.values()):
            return (f'"{text}"', ""), []
        problem = f"all names contain '{text}', so no scan before use is named"
        return ("", ""), [f"{problem}: please enter t0"]
    for place in places:
        days = sorted(file.day for file in place)
        if len(days) != 2 or not "" < days[0] < days[1]:
            text = "the names do not show which scan was made before use and which after use"
            return ("", ""), [text]
        for file in place:
            file.rank = days.index(file.day)
    return ("the earlier date", "the later one"), []


def _scans_of(
    place: Sequence[_Name], earliest: float
) -> tuple[list[_Name | None], list[_Name]]:
    """The scans of a place before and after use and its repeat, and its other files."""
    latest = max(file.rank for file in place)
    ordered = sorted(place, key=lambda file: -1 if file.repeat is None else file.repeat)
    at_t0 = [file for file in ordered if file.rank == earliest]
    later = [file for file in ordered if file.rank == latest > earliest]
    again = [file for file in at_t0[1:] if file.repeat is not None]
    scans = [files[0] if files else None for files in (at_t0, later, again)]
    rest = [file for file in ordered if file not in scans]
    return scans, sorted(rest, key=lambda file: file.rank)


def _doubts(
    scans: Sequence[_Name | None],
    rest: Sequence[_Name],
    keys: Iterable[tuple[str, ...]],
) -> Iterator[str]:
    """Questions of one place: whether all of its scans are there, no others, and in order."""
    t0, t1, _ = scans
    if t1 and not t0:
        yield f"{t1.name} was scanned after use, and no scan before use is named like it"
    for file in rest:
        if file.repeat is None:  # a further repeat is of no use, and no other place
            yield f"{file.name} is named like other scans, and is not in the table"
    if t0 and not t1 and any({*key} < {*t0.key} for key in keys):
        yield f"{t0.name} may be a patch of its own, or a repeat of another scan"
    if t0 and t1 and t0.day > t1.day > "":
        yield f"{t0.name} is named as before use, but has a later date than {t1.name}"


def _patch_names(files: Sequence[_Name]) -> list[str]:
    """A name for the place of each file: the chunks that not all share, or else a number."""
    keys = [file.key for file in files]
    are_as_long = len({len(key) for key in keys}) == 1
    patches = []
    for file in files:
        parts = [
            written
            for n, (chunk, written) in enumerate(zip(file.key, file.place, strict=True))
            if any(chunk != key[n] if are_as_long else chunk not in key for key in keys)
        ]
        patches.append(re.sub(r"[^A-Za-z0-9-]", "", "-".join(parts)))
    if len({patch.lower() for patch in patches} - {"", "all"}) < len(patches):
        return [str(n) for n in range(1, len(patches) + 1)]
    return patches
