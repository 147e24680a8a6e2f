"""Names of scans as laboratories write them: the patch, before or after use, a repeat.

A name has *chunks*, parted by blanks, signs, folders and capitals. Some are marks: words (before,
vorher), epochs (T0, stage 2), amounts of use (2000 strokes, 2 h), dates, repeats. Scans whose names
are alike without their marks are of one place. A name with two readings becomes a question.
"""

import itertools
import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import NamedTuple

from gst.config.patches import natural
from gstlib.errors import InputError

__all__ = ["Names", "Row", "read_names"]

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
_EPOCHS = {
    "epoch",
    "stage",
    "state",
    "phase",
    "time",
    "zeit",
    "zustand",
    "etat",
    "fase",
}
# Each amount of use has its kind, and how many of the kind's unit it is.
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
_REPEAT = re.compile(
    r"(?:rep|repeat|repeated|repetition|replicate|rescan|again|bis|dup|duplicate|wdh|wiederholung"
    r"|ripetizione|repeticion|repeticao)(\d*)"
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
    chunks: list[str] = field(default_factory=list)  # without marks, as written
    marks: dict[str, float] = field(default_factory=dict)  # rank by kind of mark
    written: dict[str, str] = field(
        default_factory=dict
    )  # the text of each mark, likewise
    repeat: int | None = None  # 0 if it has no number
    day: str = ""  # the date, as digits that sort
    is_twofold: bool = False  # two marks of one kind
    rank: float = 0.0  # among all files, lower before higher

    @property
    def key(self) -> tuple[str, ...]:
        """The chunks that name the place, without capitals and zeros before numbers."""
        return tuple(
            re.sub(r"\d+", lambda n: str(int(n[0])), c.casefold()) for c in self.chunks
        )

    def mark(self, kind: str, rank: float, text: str) -> None:
        self.is_twofold |= self.marks.get(kind, rank) != rank
        self.marks[kind], self.written[kind] = rank, text


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
    files = (
        _by_pattern(names, pattern)
        if pattern
        else [_taken_apart(name) for name in names]
    )
    epochs, questions = _rank(files)
    earliest = min(file.rank for file in files)
    places: dict[tuple[str, ...], list[_Name]] = {}
    for file in files:
        places.setdefault(file.key, []).append(file)
    rows, left = [], []
    patches = _patch_names([place[0] for place in places.values()])
    for patch, place in zip(patches, places.values(), strict=True):
        scans, rest = _scans_of(place, earliest)
        t0, t1, _ = scans
        questions += _doubts(t0, t1, rest, places)
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
            raise InputError(
                name,
                f"does not have the form {pattern}",
                "Correct --names, or rename it.",
            )
        files.append((name, match["patch"], match["epoch"]))
    epochs = sorted(
        {epoch for *_, epoch in files},
        key=lambda epoch: (_WORDS.get(epoch.casefold(), 0.0), natural(epoch)),
    )
    return [
        _Name(name, [patch], {"epoch": float(epochs.index(epoch))}, {"epoch": epoch})
        for name, patch, epoch in files
    ]


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
    chunks = re.findall(r"[^\W_]+", parted)
    while chunks:
        if _is_mark(file, "".join(chunks[:2]).casefold(), is_joined=True):
            del chunks[:2]
        elif _is_mark(file, chunks[0].casefold()):
            del chunks[0]
        else:
            file.chunks.append(chunks.pop(0))
    return file


def _is_mark(file: _Name, chunk: str, *, is_joined: bool = False) -> bool:
    """Whether a chunk, or two of them joined, is a mark, which is then noted.

    Joined are only a number and its unit, in whatever order.
    """
    amount = re.fullmatch(r"(\d+)([a-z]+)|([a-z]+)(\d+)", chunk)
    if amount:
        number, word = sorted(
            filter(None, amount.groups())
        )  # digits come before letters
        if word in _AMOUNTS:
            kind, unit = _AMOUNTS[word]
            file.mark(kind, unit * float(number), chunk)
            return True
        if word in _EPOCHS or (word == "t" and not is_joined and chunk[0] == "t"):
            file.mark("epoch", float(number), chunk)
            return True
    if is_joined:
        return False
    if chunk in _WORDS:
        file.mark("word", _WORDS[chunk], chunk)
        return True
    repeat = _REPEAT.fullmatch(chunk)
    if repeat:
        file.repeat = int(repeat[1] or 0)
    return repeat is not None


def _rank(files: Sequence[_Name]) -> tuple[tuple[str, str], list[str]]:
    """Give each file its rank. Returns the marks of earlier and later ones, and questions."""
    questions = [
        f"{file.name} has two marks of use that disagree"
        for file in files
        if file.is_twofold
    ]
    # a repeat does not need an epoch
    scans = [file for file in files if file.repeat is None] or files
    kinds = sorted({kind for file in files for kind in file.marks})
    vary = [kind for kind in kinds if len({file.marks.get(kind) for file in scans}) > 1]
    if not vary:
        epochs, more = _rank_alike(files)
        return epochs, questions + more
    ranked = [_complete(kind, files, scans) for kind in vary]
    complete = [ranks for ranks in ranked if ranks]
    if complete:
        for file, rank in zip(files, complete[0], strict=True):
            file.rank = rank
    if len(complete) < len(vary):
        questions.append("some names contain the time of the scan, and others do not")
    elif any(not _agree(complete[0], other) for other in complete[1:]):
        shown = ", ".join(
            sorted({f.written[k] for f in files for k in vary if k in f.marks})
        )
        questions.append(
            f"the names have several marks that do not agree in order ({shown})"
        )
    told = {
        file.rank: file.written.get(vary[0], "without it") for file in reversed(files)
    }
    if len(told) > 2:
        states = ", ".join(told[rank] for rank in sorted(told))
        questions.append(
            f"there are {len(told)} states ({states}), and a study compares two"
        )
    return (f'"{told[min(told)]}"', f'"{told[max(told)]}"'), questions


def _rank_alike(files: Sequence[_Name]) -> tuple[tuple[str, str], list[str]]:
    """`_rank` of names with no marks that differ: all of one epoch, or distinguished by dates."""
    first = files[0]
    kinds = sorted(first.marks)
    for kind in kinds:
        if first.marks[kind] == 0:
            return (f'"{first.written[kind]}"', ""), []
    if kinds:
        text = f"all names contain '{first.written[kinds[0]]}', so no scan before use is named"
        return ("", ""), [f"{text}: please enter t0"]
    days: dict[tuple[str, ...], list[str]] = {}
    for file in files:
        days.setdefault(file.key, []).append(file.day)
    if any(len(own) != 2 or len({*own} - {""}) != 2 for own in days.values()):
        text = (
            "the names do not show which scan was made before use and which after use"
        )
        return ("", ""), [text]
    for file in files:
        file.rank = float(file.day == max(days[file.key]))
    return ("the earlier date", "the later one"), []


def _complete(
    kind: str, files: Sequence[_Name], scans: Sequence[_Name]
) -> list[float] | None:
    """The ranks of all files by a kind of mark; None if those without it could be either."""
    ranks = [file.marks[kind] for file in files if kind in file.marks]
    is_open = any(kind not in file.marks for file in scans)
    if is_open and len({*ranks}) > 1:
        return None
    # scans without the mark have the other epoch, and a repeat has the earliest
    earliest = min(ranks)
    other = earliest - 1 if earliest > 0 else max(ranks) + 1
    return [
        file.marks.get(kind, other if is_open or file.repeat is None else earliest)
        for file in files
    ]


def _agree(one: Sequence[float], other: Sequence[float]) -> bool:
    """Whether two ranks of the same files have the same order, and the same ties."""
    pairs = sorted({*zip(one, other, strict=True)})
    return all(a < c and b < d for (a, b), (c, d) in itertools.pairwise(pairs))


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
    t0: _Name | None,
    t1: _Name | None,
    rest: Sequence[_Name],
    keys: Iterable[tuple[str, ...]],
) -> Iterator[str]:
    """Questions of one place: whether all of its scans are there, no others, and in order."""
    if t1 and not t0:
        yield f"{t1.name} was scanned after use, and no scan before use is named like it"
    for file in rest:
        for scan in filter(None, (t0, t1)):
            # a further repeat is of no use, and no other place
            is_second = file.repeat is not None and scan is not t0
            if file.rank == scan.rank and not is_second:
                text = f"{file.name} is named like {scan.name}"
                yield f"{text}, and only one of the two is in the table"
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
            for n, (chunk, written) in enumerate(
                zip(file.key, file.chunks, strict=True)
            )
            if any(chunk != key[n] if are_as_long else chunk not in key for key in keys)
        ]
        patches.append(re.sub(r"[^A-Za-z0-9-]", "", "-".join(parts)))
    if len({patch.lower() for patch in patches} - {"", "all"}) < len(patches):
        return [str(n) for n in range(1, len(patches) + 1)]
    return patches
