"""What laboratories say in the names of their scans: which place, before or after use, a repeat.

A name has *chunks*, parted by blanks, signs, folders and capitals. Some are marks: words (before,
vorher), epochs (T0, stage 2), amounts of use (2000 strokes, 2 h), dates, repeats. Scans whose names
are alike without their marks are of one place. What has two readings becomes a question: a pair is
read right, or it is asked.
"""

import itertools
import re
import unicodedata
from collections import Counter
from collections.abc import Collection, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import PurePosixPath
from typing import NamedTuple

from gst.config.patches import natural

__all__ = ["MEANING", "ORDER", "PLACE", "Names", "Question", "Row", "read_names"]

# What a question is about: which scans show one place, which is earlier, or what names mean.
PLACE, ORDER, MEANING = "place", "order", "meaning"

# English, German, French, Italian, Spanish and Portuguese, without accents.
_BEFORE = (
    "before beforeuse pre preuse unused unworn fresh initial new original vorher vor unbenutzt neu "
    "avant prima antes"
)
_AFTER = (
    "after afteruse post postuse used worn final nachher nach benutzt gebraucht apres dopo despues "
    "depois usato usado"
)
_WORDS = {word: rank for rank, of in ((0.0, _BEFORE), (1.0, _AFTER)) for word in of.split()}
_EPOCHS = {"epoch", "stage", "state", "phase", "time", "zeit", "zustand", "etat", "fase"}
_AMOUNTS = {
    word: (kind, unit)
    for kind, unit, words in (
        ("time", 60.0, "h hr hrs hour hours stunden"),
        ("time", 1.0, "min mins minute minutes minuten"),
        ("time", 1 / 60, "sec second seconds sekunden"),
        ("strokes", 1.0, "stroke strokes"),
        ("cycles", 1.0, "cycle cycles cyc zyklen cicli ciclos"),
        ("blows", 1.0, "pass passes blow blows hit hits coups colpi golpes schlage turns"),
    )
    for word in words.split()
}
_REPEAT = re.compile(
    r"(?:rep|repeat|repeated|repetition|replicate|rescan|again|bis|dup|duplicate|wdh|wiederholung"
    r"|ripetizione|repeticion|repeticao)(\d*)"
)
# A date, and behind it perhaps a time of day.
_DATE = re.compile(
    r"(?<!\d)(?:(?P<y>20\d\d)([-_. ]?)(?P<m>\d\d)\2(?P<d>\d\d)"
    r"|(?P<a>\d{1,2})([-_. ])(?P<b>\d{1,2})\6(?P<z>20\d\d))(?!\d)"
    r"(?:[-_ T](?:[01]\d|2[0-3])([-.]?)[0-5]\d\9[0-5]\d(?!\d))?"
)


class Row(NamedTuple):
    """The scans of one place; "" where there is none."""

    patch: str
    t0: str
    t1: str = ""
    repeat: str = ""


class Question(NamedTuple):
    """What names leave open: which scans are of one `PLACE`, their `ORDER`, or what they mean."""

    kind: str
    text: str


class Names(NamedTuple):
    """What names say."""

    rows: list[Row]  # in natural order; where there are questions, the likely reading
    questions: list[Question]
    # What tells earlier scans from later ones, such as ``"before"`` and ``"after"``, in quotes if
    # it is in the names; empty if nothing does.
    epochs: tuple[str, str]
    left: list[str]  # names in no row


@dataclass
class _Name:
    """A name, taken apart."""

    name: str
    chunks: list[str] = field(default_factory=list)  # without marks, as written
    marks: dict[str, float] = field(default_factory=dict)  # rank by kind of mark
    said: dict[str, str] = field(default_factory=dict)  # the mark as written, likewise
    repeat: int | None = None  # 0 if it has no number
    dates: tuple[date | None, date | None] | None = None  # with the day first, the month first
    is_twofold: bool = False  # two marks of one kind

    @property
    def key(self) -> tuple[str, ...]:
        """What names the place, whatever the capitals and the zeros before numbers."""
        return tuple(
            re.sub(r"\d+", lambda n: str(int(n[0])), c.casefold()) for c in self.chunks
        )

    def mark(self, kind: str, rank: float, said: str) -> None:
        self.is_twofold |= self.marks.get(kind, rank) != rank
        self.marks[kind], self.said[kind] = rank, said


def read_names(
    names: Iterable[str],
    places: Mapping[str, Hashable] | None = None,
    later: Collection[str] | None = None,
) -> Names:
    """Rows of a patch table from the names of scans, with ``/`` between folders.

    Where heights tell more than names, `places` has the place that each scan shows, and `later` the
    scans that were made after use.

    Examples
    --------
    >>> read_names(["loc1 after.sur", "loc1 before.sur"]).rows
    [Row(patch='1', t0='loc1 before.sur', t1='loc1 after.sur', repeat='')]
    >>> read_names(["S1a.sur", "S1b.sur"]).questions[0].text
    'none of the names says which scan was made before use and which after it'
    """
    files = [_taken_apart(name) for name in sorted(names)]
    if later is None:
        ranks, said, questions = _epochs(files)
    else:
        ranks, said, questions = {f.name: float(f.name in later) for f in files}, ("", ""), []
    by_place: dict[Hashable, list[_Name]] = {}
    for file in files:
        by_place.setdefault(file.key if places is None else places[file.name], []).append(file)
    rows, left = [], []
    for there, patch in zip(
        by_place.values(), _patch_names(list(by_place.values())), strict=True
    ):
        scans, rest = _scans(there, ranks, are_one_place=places is not None)
        questions += _open_places(scans, rest, ranks, files if places is None else [])
        questions += _against_dates(scans, files)
        rows.append(Row(patch, *scans))
        left += [file.name for file in rest]
    rows.sort(key=lambda row: natural(row.patch))
    return Names(rows, questions, said, left)


def _taken_apart(name: str) -> _Name:
    """A name with its marks apart from what names the place."""
    file = _Name(name)
    path = PurePosixPath(unicodedata.normalize("NFKD", name))
    plain = "".join(c for c in str(path.with_suffix("")) if not unicodedata.combining(c))
    if found := _DATE.search(plain):
        file.dates = _readings(found)
        plain = f"{plain[: found.start()]} {plain[found.end() :]}"
    parted = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", plain)
    chunks = re.findall(r"[^\W_]+", parted)
    at = 0
    while at < len(chunks):
        here, following = chunks[at].casefold(), "".join(chunks[at + 1 : at + 2]).casefold()
        taken = 2 if _mark(file, here + following, is_joined=True) else _mark(file, here)
        if not taken:
            file.chunks.append(chunks[at])
        at += taken or 1
    return file


def _mark(file: _Name, chunk: str, *, is_joined: bool = False) -> int:
    """Note the mark that a chunk, or two of them joined, is; how many chunks it takes, 0 if none.

    Joined are only a number and its unit, in whatever order.
    """
    amount = re.fullmatch(r"(\d+)([a-z]+)", chunk) or re.fullmatch(r"([a-z]+)(\d+)", chunk)
    if amount:
        number, word = sorted(amount.groups())  # digits come before letters
        if word in _AMOUNTS:
            kind, unit = _AMOUNTS[word]
            file.mark(kind, unit * float(number), chunk)
            return 1
        if word in _EPOCHS or (word == "t" and not is_joined and chunk[0] == "t"):
            file.mark("epoch", float(number), chunk)
            return 1
    if is_joined:
        return 0
    if chunk in _WORDS:
        file.mark("word", _WORDS[chunk], chunk)
    elif repeat := _REPEAT.fullmatch(chunk):
        file.repeat = int(repeat[1] or 0)
    else:
        return 0
    return 1


def _readings(found: re.Match) -> tuple[date | None, date | None]:
    """A date with the day before the month, and the other way round; None if there is none."""
    if found["y"]:
        both = 2 * ((found["y"], found["m"], found["d"]),)
    else:
        both = (found["z"], found["b"], found["a"]), (found["z"], found["a"], found["b"])
    days: list[date | None] = []
    for numbers in both:
        try:
            days.append(date(*map(int, numbers)))
        except ValueError:
            days.append(None)
    return days[0], days[1]


def _epochs(files: Sequence[_Name]) -> tuple[dict[str, float], tuple[str, str], list[Question]]:
    """The rank of each file, lower before higher; what tells them apart; questions."""
    twofold = [file.name for file in files if file.is_twofold]
    questions = [
        Question(MEANING, f"{name} has two marks of use that disagree") for name in twofold
    ]
    kinds = sorted({kind for file in files for kind in file.marks})
    # of a repeat, the epoch need not be said
    scans = [file for file in files if file.repeat is None] or list(files)
    vary = [kind for kind in kinds if len({file.marks.get(kind) for file in scans}) > 1]
    if not vary:
        return _of_one_kind(files, kinds, questions)
    ranked = [_complete(kind, files, scans) for kind in vary]
    first = ranked[0]
    if any(ranks is None for ranks in ranked):
        text = "some names say when the scan was made, and others do not"
        questions.append(Question(MEANING, text))
    elif any(not _agree(first, other) for other in ranked[1:]):
        marks = {said for file in files for kind, said in file.said.items() if kind in vary}
        shown = ", ".join(sorted(marks))
        text = f"the names have several marks that do not agree in order ({shown})"
        questions.append(Question(MEANING, text))
    ranks = next((each for each in ranked if each is not None), dict.fromkeys(_of(files), 0.0))
    told = {ranks[f.name]: f.said.get(vary[0], "without it") for f in reversed(files)}
    if len(told) > 2:
        states = ", ".join(told[rank] for rank in sorted(told))
        text = f"there are {len(told)} states ({states}), and a study compares two"
        questions.append(Question(MEANING, text))
    return ranks, (f'"{told[min(told)]}"', f'"{told[max(told)]}"'), questions


def _of_one_kind(
    files: Sequence[_Name], kinds: Sequence[str], questions: list[Question]
) -> tuple[dict[str, float], tuple[str, str], list[Question]]:
    """`_epochs` of names with no marks that differ: all of one epoch, or told apart by dates."""
    same = dict.fromkeys(_of(files), 0.0)
    for kind in kinds:
        if files[0].marks.get(kind) == 0:
            return same, (f'"{files[0].said[kind]}"', ""), questions
    if kinds:
        said = files[0].said[kinds[0]]
        text = f"all names say '{said}', and none is of before use: t0 is yours to give"
        return same, ("", ""), [*questions, Question(MEANING, text)]
    later = _later_dates(files)
    if isinstance(later, str):
        return same, ("", ""), [*questions, Question(ORDER, later)]
    return (
        {name: float(name in later) for name in same},
        ("the earlier date", "the later one"),
        questions,
    )


def _later_dates(files: Sequence[_Name]) -> set[str] | str:
    """The later of the two scans of each place by the dates in their names, or a question."""
    pairs: dict[tuple[str, ...], list[str]] = {}
    for file in files:
        pairs.setdefault(file.key, []).append(file.name)
    readings = []
    for n in (0, 1):
        days = {f.name: day.toordinal() for f in files if f.dates and (day := f.dates[n])}
        if len(days) == len(files):
            tell_apart = all(
                len({days[name] for name in of}) == len(of) == 2 for of in pairs.values()
            )
            readings.append(
                {max(of, key=days.__getitem__) for of in pairs.values()}
                if tell_apart
                else set()
            )
    if not readings or not all(readings):
        return "none of the names says which scan was made before use and which after it"
    if readings[0] != readings[-1]:
        return "the dates in the names can be read in two ways"
    return readings[0]


def _of(files: Iterable[_Name]) -> list[str]:
    return [file.name for file in files]


def _complete(
    kind: str, files: Sequence[_Name], scans: Sequence[_Name]
) -> dict[str, float] | None:
    """The ranks of all files by a kind of mark; None if those without it could be either."""
    ranks = {file.name: file.marks.get(kind) for file in files}
    known = [rank for rank in ranks.values() if rank is not None]
    unsaid = any(ranks[file.name] is None for file in scans)
    if unsaid and len(set(known)) > 1:
        return None
    # the others are what those with the mark are not, and a repeat is of the earliest
    other = min(known) - 1 if min(known) > 0 else max(known) + 1
    for file in files:
        if ranks[file.name] is None:
            ranks[file.name] = min(known) if file.repeat is not None and not unsaid else other
    return {name: rank for name, rank in ranks.items() if rank is not None}


def _agree(one: Mapping[str, float] | None, other: Mapping[str, float] | None) -> bool:
    """Whether two ranks of the same files have the same order, and the same ties."""
    if one is None or other is None:
        return False
    pairs = sorted({(one[name], other[name]) for name in one})
    return all(a < c and b < d for (a, b), (c, d) in itertools.pairwise(pairs))


def _scans(
    there: Sequence[_Name], ranks: Mapping[str, float], *, are_one_place: bool
) -> tuple[tuple[str, str, str], list[_Name]]:
    """The scans (t0, t1, repeat) of a place, and the files that are none of them."""
    earliest = min(ranks.values())
    ordered = sorted(there, key=lambda f: (ranks[f.name], f.repeat is not None, f.repeat or 0))
    at_t0 = [file for file in ordered if ranks[file.name] == earliest]
    later = [file for file in reversed(ordered) if ranks[file.name] > earliest]
    later = [file for file in later if ranks[file.name] == ranks[later[0].name]][::-1]
    again = [file for file in at_t0[1:] if are_one_place or file.repeat is not None]
    chosen = [at_t0[:1], later[:1], again[:1]]
    used = [file for each in chosen for file in each]
    t0, t1, repeat = (each[0].name if each else "" for each in chosen)
    return (t0, t1, repeat), [file for file in ordered if file not in used]


def _open_places(
    scans: tuple[str, str, str],
    rest: Sequence[_Name],
    ranks: Mapping[str, float],
    files: Sequence[_Name],
) -> Iterator[Question]:
    """Whether all scans of a place are there, and no others; `files` are all, if names told it."""
    t0, t1, _ = scans
    if not t0:
        yield Question(
            PLACE, f"{t1} is of after use, and no scan of before use is named like it"
        )
    for file in rest:
        for scan in filter(None, (t0, t1)):
            # a further repeat is of no use, and no other place
            is_second = file.repeat is not None and scan != t0
            if ranks[file.name] == ranks[scan] and not is_second:
                text = f"{file.name} is named like {scan}, and one of the two is in the table"
                yield Question(PLACE, text)
    own = next((file.key for file in files if file.name == t0), ())
    others = {file.key for file in files if len(file.key) < len(own)}
    if not t1 and any(not Counter(other) - Counter(own) for other in others):
        yield Question(PLACE, f"{t0} may be a place of its own, or a repeat of another scan")


def _against_dates(scans: tuple[str, str, str], files: Sequence[_Name]) -> Iterator[Question]:
    """A pair whose dates, however they are read, say the opposite of its marks."""
    dates = {file.name: file.dates for file in files}
    before, after = dates.get(scans[0]), dates.get(scans[1])
    if before and after:
        both = [(a, b) for a, b in zip(before, after, strict=True) if a and b]
        if both and all(a > b for a, b in both):
            text = f"{scans[0]} is named as before use, and has a later date than {scans[1]}"
            yield Question(MEANING, text)


def _patch_names(places: Sequence[Sequence[_Name]]) -> list[str]:
    """A name for each place: what its scans share and those of other places do not, or a number."""
    keys = [[chunk for chunk in of[0].key if all(chunk in f.key for f in of)] for of in places]
    are_as_long = len({len(key) for key in keys}) == 1
    named = []
    for key, (first, *_) in zip(keys, places, strict=True):
        written = dict(zip(first.key, first.chunks, strict=True))
        parts = [
            written[chunk]
            for n, chunk in enumerate(key)
            if (
                any(other[n] != chunk for other in keys)
                if are_as_long
                else any(chunk not in other for other in keys)
            )
        ]
        named.append(re.sub(r"[^A-Za-z0-9-]", "", "-".join(parts)))
    if len({name.lower() for name in named} - {"", "all"}) < len(named):
        return [str(n) for n in range(1, len(named) + 1)]
    return named
