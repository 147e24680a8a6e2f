"""The answer of a study in a few labelled lines, computed from its tables.

Which patches wore; whether patches that the given load does not touch wear less; how the tool was
used; whether the loss of each patch, predicted from the other patches, is right, and better than
baselines with the same data; which patches carry the load. The statistics behind it are details.
No sentence claims more than its numbers allow: a difference must show in an interval and in a test.

This module computes the numbers; the sentences are in ``verdict.jinja`` beside it.
"""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from gstlib.conditions import ARCHARD, Law
from gstlib.coupling.comparison import AGREES, CANNOT_TELL
from gstlib.coupling.pressures import stated
from gstlib.macroscale.sampling_sites import CONTROL, EXPOSED, Concentration
from gstlib.use.infer import NOT_PRESSED, PRESSED, UNKNOWN
from gstlib.use.laws import BASE, UNDECIDED
from gstlib.validation.baselines import ORACLE
from gstlib.validation.scoring import own_model
from gstlib.validation.summary import statistic_names
from gstlib.wear.archard import BARE, CAPPED, INTERLAYER

__all__ = ["LEVEL", "MODELS", "TOUCHED", "Answer", "Line", "verdict", "where_to_scan"]

LEVEL = 0.05  # the usual one
# The smallest p-value that an exchange test of n patches can give is 2^(1 - n): a mark for each of
# these levels that it can reach.
_LEVELS = 1.0, LEVEL, 0.001
# The predictions, their baselines and the cap, in words.
MODELS = {
    BARE: "Archard's law",
    INTERLAYER: "Archard's law with an interlayer",
    CAPPED: "the same with a cap on the pressure",
    "none": "no loss",
    "mean_volume": "a plane that cuts off the others' mean volume",
    "pressure_volume": "a plane that cuts off a volume in proportion to pressure",
    "pressure_fraction": "a plane that wears a fraction in proportion to pressure",
    "rigid": "a rigid flat sunk equally deep into every patch",
    ORACLE: "a plane that wears the patch's own fraction",
}
TOUCHED = "spearman(touched, mean_wear_depth_um)"
# A longer list of names does not help a reader.
_MOST_NAMED = 5


_WORDS = {
    "models": MODELS,
    "level": LEVEL,
    "most_named": _MOST_NAMED,
    "TOUCHED": TOUCHED,
    "CAPPED": CAPPED,
    "INTERLAYER": INTERLAYER,
    "BASE": BASE,
    "UNDECIDED": UNDECIDED,
    "PRESSED": PRESSED,
    "NOT_PRESSED": NOT_PRESSED,
    "UNKNOWN": UNKNOWN,
}


class Line(NamedTuple):
    """A question, its answer in a few words, and the rest of the same sentence."""

    question: str
    short: str
    rest: str


class Answer(NamedTuple):
    """The answer of a study."""

    lines: list[Line]
    details: list[str]  # the statistics behind the lines


def verdict(
    tables: Mapping[str, pd.DataFrame],
    *,
    force_N: float,
    square_mm: float,
    interlayer: Mapping[str, float] | None = None,
    pressure_cap: float | None = None,
    poses: int | None = None,
    second: bool = False,
    wear_law: Mapping[str, float] | None = None,
) -> Answer:
    """The answer about the wear, the use, the prediction and the load.

    `tables` are, by name, ``patch_pressures``, ``patch_intervals``; of a study with scans after
    use, ``registration``, ``validation_patches`` and ``validation_summary``; if the load was
    inferred from the wear, ``use``; with enough losses, ``laws``; of one with a gesture, which has
    so many `poses`, ``exposure``. ``placement``, where patches were compared with the
    mesh. `force_N` is the whole load, `square_mm` the side of the square; `second` is whether the
    active tool has a mesh; `wear_law` has the fields of `gstlib.conditions.Law`.
    """
    pressures, intervals = tables["patch_pressures"], tables["patch_intervals"]
    facts: dict[str, Any] = {
        "interlayer": interlayer,
        "where": None,
        "wore": None,
        "own": None,
    }
    if "validation_summary" in tables:
        facts["scores"] = scores = _scores(tables["validation_summary"])
        by_stated = pressures[["patch"]].assign(stated_MPa=stated(pressures))
        losses = by_stated.merge(tables["registration"], how="left")
        facts["wore"], facts["contact"] = _wore(losses), _contact(losses)
        models = [model for model in (BARE, INTERLAYER) if model in scores]
        if not pressures.in_study.any():
            facts["where"] = "not in study"
        elif not models:
            facts["where"] = "not predicted"
        else:
            facts |= {"where": "predicted", "own": own_model(models)}
    return _answer(
        **facts,
        use=_use(tables.get("use"), square_mm),
        laws=_laws(tables.get("laws")),
        load=_load(pressures, intervals, force_N),
        exposed=None
        if poses is None
        else _highest(tables["exposure"], "exposure_N_per_mm"),
        sure=_certainty(tables),
        is_archard=Law(**(wear_law or {})) == ARCHARD,
        force_N=force_N,
        pressure_cap=pressure_cap,
        poses=poses,
        second=second,
        scan=None,
    )


def where_to_scan(
    places: pd.DataFrame,
    held: Concentration,
    *,
    force_N: float,
    square_mm: float,
    use: pd.DataFrame | None = None,
) -> Answer:
    """Where pressure and exposure concentrate, and which places to scan.

    `places` and, if the load was inferred from the wear, `use` are the tables of these names;
    `force_N` is the whole load, `square_mm` the side of the square.
    """
    exposed, controls = (places[places.kind == kind] for kind in (EXPOSED, CONTROL))
    scan = {"exposed": exposed, "controls": controls, "held": held}
    return _answer(scan=scan, use=_use(use, square_mm), force_N=force_N)


def _scores(summary: pd.DataFrame) -> dict[str, dict]:
    """The rows of the summary by model and statistic."""
    # in an empty table, the column of names is one of numbers
    model = summary.model.astype(object).fillna("")
    named = summary.assign(statistic=statistic_names(summary), model=model)
    by_model = named.groupby("model")
    return {
        str(model): rows.set_index("statistic").to_dict("index")
        for model, rows in by_model
    }


def _use(use: pd.DataFrame | None, square_mm: float) -> dict[str, Any] | None:
    """The rows of the use, and the edges of the square that its intervals reach."""
    if use is None:
        return None
    rows = use.set_index("parameter").to_dict("index")
    reached = {}
    for axis in "xy":
        row = rows[f"load_point_{axis}"]
        reached[f"{axis} = 0"] = row["low"] < 0
        reached[f"{axis} = {square_mm:g}"] = row["high"] > square_mm
    edges = [edge for edge, is_reached in reached.items() if is_reached]
    return {"first": use.iloc[0], "edges": edges} | rows


def _laws(laws: pd.DataFrame | None) -> dict[str, Any] | None:
    """The best law beside the base, and the answer; None without laws."""
    if laws is None or laws.empty:
        return None
    return _highest(laws[laws.law != BASE], "log_score_gain")


def _highest(table: pd.DataFrame, column: str) -> dict[str, Any]:
    return table.loc[table[column].idxmax()].to_dict()


def _wore(losses: pd.DataFrame) -> dict[str, Any]:
    """The worn patches, the most worn first; the number that the given load touches; the others."""
    measured = losses.dropna(subset="mean_wear_depth_um")
    is_lost = measured.loss_fraction > 0
    is_certain = measured.above_noise.eq(True)
    worn = measured[is_lost & is_certain]
    return {
        "worn": worn.sort_values("mean_wear_depth_um", ascending=False),
        "touched": int((worn.stated_MPa > 0).sum()),
        "matched": losses.found.eq(True).any(),
        "measured": len(measured),
        "unknown": len(losses) - len(measured),
        "undetected": (~is_lost).sum(),
        "noise": (is_lost & ~is_certain).sum(),
    }


def _contact(losses: pd.DataFrame) -> dict[str, pd.Series]:
    """Depths of patches that the given load, which no wear has shaped, touches or not."""
    measured = losses[losses.above_noise.eq(True)].dropna(subset="mean_wear_depth_um")
    depths, is_touched = measured.mean_wear_depth_um, measured.stated_MPa > 0
    return {"touched": depths[is_touched], "untouched": depths[~is_touched]}


def _load(
    pressures: pd.DataFrame, intervals: pd.DataFrame, force_N: float
) -> dict[str, Any]:
    """The patches that carry the load, and the highest pressure with its interval."""
    total = float(pressures.force_N.sum())
    if not total > 0:
        may = _highest(intervals.fillna({"high_MPa": 0}), "high_MPa")
        return {"patches": [], "highest": may}
    highest = pressures.patch[pressures.pressure_MPa.idxmax()]
    ordered = pressures.sort_values("force_N", ascending=False, kind="stable")
    shares = ordered.force_N.cumsum() / total
    fewest = (shares <= 0.5).sum() + 1  # that carry more than half
    return {
        "count": len(pressures),
        "highest": intervals[intervals.patch == highest].iloc[0],
        "patches": list(ordered.patch[:fewest]),
        "share_percent": 100 * shares.iloc[fewest - 1],
        "of_force_percent": 100 * total / force_N,
    }


def _certainty(tables: Mapping[str, pd.DataFrame]) -> dict[str, Any]:
    """Marks for the number of patches, their positions, and the registration of T1 to T0."""
    facts: dict[str, Any] = dict.fromkeys(("patches", "places", "matched"))
    if "validation_patches" in tables:
        count = int(tables["validation_patches"].in_statistics.sum())
        least = 2.0 ** (1 - count)
        reached = sum(least <= level for level in _LEVELS)
        facts["patches"] = {"count": count, "marks": max(1, reached)}
    if "placement" in tables:
        *each, together = tables["placement"].status
        count, agreeing = len(each), each.count(AGREES)
        is_clear = together != CANNOT_TELL and 2 * agreeing >= count
        is_one = is_clear and set(each) <= {together}
        marks = 1 + is_clear + is_one
        counts = {"count": count, "agreeing": agreeing, "marks": marks}
        facts["places"] = {"status": together, **counts}
    if "registration" in tables:
        is_within = ~tables["registration"].excluded.astype(bool)
        count, within = len(is_within), is_within.sum()
        marks = 1 + (2 * within >= count) + is_within.all()
        facts["matched"] = {"count": count, "within": within, "marks": marks}
    return facts


# --- Sentences ---------------------------------------------------------------------------------


def _answer(**facts: Any) -> Answer:
    """The sentences for the facts."""
    import jinja2

    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, autoescape=False)
    filters = _listed, _two, _fixed, _least, _extent, _p, _sign
    environment.filters |= {each.__name__[1:]: each for each in filters}
    environment.tests["known"] = pd.notna
    template = Path(__file__).with_suffix(".jinja").read_text(encoding="utf-8")
    text = environment.from_string(template).render(_WORDS | facts)
    questions, _, details = text.partition("## In detail")
    lines = []
    for part in questions.split("## ")[1:]:
        question, _, answer = part.partition("\n")
        if answer := _sentence(answer).removeprefix("· "):
            *_, short, rest = ["", *answer.split("**", 2)]
            lines.append(Line(question, short.strip(), rest))
    paragraphs = map(_sentence, details.split("¶"))
    return Answer(lines, list(filter(None, paragraphs)))


def _sentence(text: str) -> str:
    """Text without line breaks, and without spaces before a mark that takes none."""
    return re.sub(r" (?=[,;:.)])|(?<=\() ", "", " ".join(text.split()))


def _listed(names: Sequence[str]) -> str:
    *others, last = names
    return f"{', '.join(others)} and {last}" if others else last


def _two(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


def _fixed(value: float, form: str) -> str:
    return format(value, form).replace("-", "−")


def _least(value: float, least: float, unit: str) -> str:
    return f"{_two(value)} {unit}" if value >= least else f"less than {least:g} {unit}"


def _extent(values: pd.Series, least: float, unit: str) -> str:
    ends = values.min(), values.max()
    return " to ".join(dict.fromkeys(_least(end, least, unit) for end in ends))


def _p(value: float) -> str:
    if not math.isfinite(value):
        return "not tested"
    if not 0.001 <= value <= 0.99:
        return "p < 0.001" if value < 0.5 else "p > 0.99"
    return f"p = {value:.2g}"


def _sign(row: Mapping[str, float], no_difference: float = 0.0) -> int:
    """Whether a value is shown to be above (1) or below (-1) no difference; otherwise 0.

    The difference must show in both the interval and the test.
    """
    shows = int(row["low"] > no_difference) - int(row["high"] < no_difference)
    return shows * int(row["p_value"] <= LEVEL)
