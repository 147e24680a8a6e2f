"""The answer of a study in a few labelled lines, computed from its tables.

Which patches wore; whether patches that the stated load does not touch wear less; how the tool was
used; whether the loss that the other patches predict of each is right, and better than baselines
that are given the same data; which patches carry the load. The statistics behind it are details.
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
from gstlib.coupling.placement import AGREES, CANNOT_TELL
from gstlib.coupling.pressures import stated
from gstlib.macroscale.sampling_sites import CONTROL, EXPOSED, Concentration
from gstlib.use.infer import NOT_PRESSED, PRESSED, UNKNOWN
from gstlib.use.laws import BASE, UNDECIDED
from gstlib.validation.baselines import ORACLE
from gstlib.validation.scoring import own_model
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
    "pressure_fraction": "a plane that wears a share in proportion to pressure",
    "rigid": "a rigid flat sunk equally deep into every patch",
    ORACLE: "a plane that wears the patch's own share",
}
TOUCHED = "spearman(touched, mean_wear_depth_um)"
# A longer list of names does not help a reader.
_MOST_NAMED = 5
_FACTS = ("wore", "contact", "use", "best", "where", "depth", "scores", "layer")


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
    """What the study found: the wear, its use, its prediction, and the load.

    `tables` are, by name, ``patch_pressures``, ``patch_intervals``; of a study with scans after
    use, ``registration``, ``validation_patches`` and ``validation_summary``; of one whose wear says
    how the tool was used, ``use``; with enough losses, ``laws``; of one with a gesture, which has
    so many `poses`, ``exposure``. ``placement``, where patches were compared with the
    mesh. `force_N` is the whole load, `square_mm` the side of the square; `second` says whether the
    active tool has a mesh; `wear_law` has the fields of `gstlib.conditions.Law`.
    """
    pressures = tables["patch_pressures"]
    facts: dict[str, Any] = dict.fromkeys(_FACTS)
    if "validation_summary" in tables:
        summary = tables["validation_summary"].fillna({"model": ""})
        summary = summary.set_index(["model", "statistic"]).sort_index()
        by_stated = pressures[["patch"]].assign(stated_MPa=stated(pressures))
        losses = by_stated.merge(tables["registration"], how="left")
        facts |= {"wore": _wore(losses), "contact": _contact(summary, losses)}
        models = set(summary.index.unique("model")) & {BARE, INTERLAYER}
        if not pressures["in_study"].any():
            facts["where"] = "not in study"
        elif not models:
            facts["where"] = "not predicted"
        else:
            own = own_model(list(models))
            facts |= _prediction(summary, own, pressure_cap)
            facts["layer"] = interlayer if own == INTERLAYER else None
    if "use" in tables:
        facts["use"] = _use(tables["use"], square_mm)
    if "laws" in tables and not tables["laws"].empty:
        facts["best"] = _best_law(tables["laws"])
    return _answer(
        **facts,
        load=_load(pressures, tables["patch_intervals"], force_N),
        exposed=None if poses is None else _exposed(tables["exposure"]),
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

    `places` and `use`, where the wear says how the tool was used, are the tables of these names;
    `force_N` is the whole load, `square_mm` the side of the square.
    """
    exposed, controls = (places[places.kind == kind] for kind in (EXPOSED, CONTROL))
    scan = {"exposed": exposed, "controls": controls, "held": held}
    facts = None if use is None else _use(use, square_mm)
    return _answer(scan=scan, use=facts, force_N=force_N)


def _use(use: pd.DataFrame, square_mm: float) -> dict[str, Any]:
    """How the tool was used, as its wear says, and how sure that is."""
    rows, answer = use.set_index("parameter"), use.answer.iloc[0]
    facts = {
        "case": answer,
        "competitor": use.competitor.iloc[0],
        "taken": bool(use.taken.iloc[0]),
    }
    facts["flat"] = None
    if answer.startswith(UNKNOWN):
        return facts | {"case": "unknown", "reason": answer.removeprefix(UNKNOWN)}
    if "mean_without_curvature" in rows and facts["taken"]:
        flat = rows.mean_without_curvature
        names = {"x": "load_point_x", "y": "load_point_y", "radius": "radius"}
        facts["flat"] = {key: _finite(flat.get(name)) for key, name in names.items()}
    if answer == NOT_PRESSED:
        return facts | {"case": "not pressed"}
    x, y = rows.loc["load_point_x"], rows.loc["load_point_y"]
    # beyond an edge, its side is found, but not how far beyond, nor where along it
    reached = {"x = 0": x.low < 0, f"x = {square_mm:g}": x.high > square_mm}
    reached |= {"y = 0": y.low < 0, f"y = {square_mm:g}": y.high > square_mm}
    return facts | {
        "case": "pressed" if answer == PRESSED else "perhaps",
        "x": dict(x),
        "y": dict(y),
        "spread": dict(rows.loc["spread"]),
        "radius": dict(rows.loc["radius"]) if "radius" in rows.index else None,
        "edges": [edge for edge, is_reached in reached.items() if is_reached],
    }


def _best_law(laws: pd.DataFrame) -> dict[str, Any]:
    """Which law of wear predicts the losses best."""
    rows, answer = laws.set_index("law"), laws.answer.iloc[0]
    best = rows.gain.drop(BASE).idxmax()
    case = {BASE: "base", UNDECIDED: "undecided"}.get(answer, "other")
    return {"case": case, "law": best} | _row(rows.loc[best])


def _wore(losses: pd.DataFrame) -> dict[str, Any]:
    """Which patches lost height, how much of their area and how deep; and what of the others."""
    known = losses.dropna(subset="mean_wear_depth_um")
    lost, certain = known.loss_fraction > 0, known.above_noise.eq(True)
    worn = known[lost & certain].sort_values("mean_wear_depth_um", ascending=False)
    return {
        "matched": bool(losses.found.eq(True).any()),
        "patches": list(worn.patch),
        "known": len(known),
        "unknown": len(losses) - len(known),
        "undetected": int((~lost).sum()),
        "noise": int((lost & ~certain).sum()),
        "area_percent": [100 * worn.loss_fraction.min(), 100 * worn.loss_fraction.max()],
        "depth_um": list(worn.mean_depth_where_worn_um.agg(["min", "max"])),
    }


def _contact(summary: pd.DataFrame, losses: pd.DataFrame) -> dict[str, Any]:
    """Do patches wear less that the load as stated, which no wear has shaped, does not touch?"""
    known = losses[losses.above_noise.eq(True)].dropna(subset="mean_wear_depth_um")
    is_touched = known.stated_MPa > 0
    depths = known.mean_wear_depth_um
    facts = {"touched": int(is_touched.sum()), "untouched": int((~is_touched).sum())}
    if not all(facts.values()):
        return facts
    row = summary.loc[("", TOUCHED)]
    means = {
        "touched_um": depths[is_touched].mean(),
        "untouched_um": depths[~is_touched].mean(),
    }
    return facts | means | {"sign": _sign_of(row), "p_value": row.p_value}


def _prediction(summary: pd.DataFrame, own: str, pressure_cap: float | None) -> dict[str, Any]:
    """How right the loss is that the other patches predict of each, by the study's own model."""

    def row(statistic: str, model: str = own) -> dict[str, Any]:
        return _row(summary.loc[(model, statistic)])

    gain, mean = row("gain(mcc)"), row("mean(mcc)")
    gain["sign"] = _sign_of(summary.loc[(own, "gain(mcc)")])
    errors, volume = row("relative(map_error)"), row("relative(volume_error)")
    depth = row("relative_to_best(map_error)")
    for ratio in (depth, volume):
        shows = (ratio["high"] or math.inf) < 1, (ratio["low"] or -math.inf) > 1
        ratio["better"] = (int(shows[0]) - int(shows[1])) * _passes(ratio["p_value"])
    is_known = volume["value"] is not None
    scores: dict[str, Any] = {
        "mean": mean,
        "attainable": summary.value[own, "mean(attainable_mcc)"],
        "map": errors if is_known and errors["value"] is not None else None,
        "volume": volume,
        "capped": None,
        "out_of_contact": None,
    }
    if mean["n"]:
        scores["baseline"] = summary.value[gain["against"], "mean(mcc)"]
    if own == INTERLAYER:
        out = row("relative(out_of_contact)")
        scores["out_of_contact"] = out if out["value"] is not None else None
    if (CAPPED, "mean(mcc)") in summary.index and pressure_cap is not None:
        names = {"mcc": "mean(mcc)", "map": "relative(map_error)"}
        names["volume"] = "relative(volume_error)"
        scores["capped"] = {key: summary.value[CAPPED, name] for key, name in names.items()}
    both = {"map": depth, "volume": volume}
    return {
        "where": {"gain": gain, "tested": row("tested_mean(mcc)")},
        "depth": both if is_known and depth["value"] is not None else None,
        "scores": scores,
    }


def _load(pressures: pd.DataFrame, intervals: pd.DataFrame, force_N: float) -> dict[str, Any]:
    """Which patches carry the load, and how well the highest pressure is known."""
    total, count = float(pressures["force_N"].sum()), len(pressures)
    facts = {"count": count, "patches": [], "highest_MPa": {"value": 0.0, "low": None}}
    if not total > 0:
        may = intervals.loc[intervals["high_MPa"].fillna(0).idxmax()]
        return facts | {"highest": may.patch, "may_MPa": max(0, _finite(may.high_MPa) or 0)}
    highest = pressures.patch[pressures["pressure_MPa"].idxmax()]
    interval = intervals.set_index("patch").loc[highest]
    ends = {"low": _finite(interval.low_MPa), "high": interval.high_MPa}
    ordered = pressures.sort_values("force_N", ascending=False, kind="stable")
    shares = ordered["force_N"].cumsum() / total
    fewest = int((shares <= 0.5).sum()) + 1  # that bear more than half
    return {
        "count": count,
        "highest": highest,
        "highest_MPa": {"value": interval.pressure_MPa, **ends},
        "patches": list(ordered.patch[:fewest]),
        "share_percent": 100 * shares.iloc[:fewest].iloc[-1],
        "of_force_percent": 100 * total / force_N,
    }


def _exposed(exposure: pd.DataFrame) -> dict[str, Any] | None:
    """Which patch a gesture wears most, by pressure and sliding alone."""
    first = exposure.loc[exposure["exposure_N_per_mm"].idxmax()]
    return dict(first) if first.exposure_N_per_mm > 0 else None


def _certainty(tables: Mapping[str, pd.DataFrame]) -> dict[str, Any]:
    """Marks for how many patches there are, where they lie, and how well T1 lies on T0."""
    facts: dict[str, Any] = dict.fromkeys(("patches", "places", "matched"))
    if "validation_patches" in tables:
        count = int(tables["validation_patches"].in_statistics.sum())
        reached = sum(2.0 ** (1 - count) <= level for level in _LEVELS)
        facts["patches"] = {"count": count, "marks": max(1, reached)}
    if "placement" in tables:
        *each, together = tables["placement"].status
        agreeing = each.count(AGREES)
        is_clear = together != CANNOT_TELL and 2 * agreeing >= len(each)
        marks = 1 + is_clear + (is_clear and set(each) <= {together})
        facts["places"] = {"count": len(each), "agreeing": agreeing, "marks": marks}
        facts["places"]["status"] = together
    if "registration" in tables:
        within = ~tables["registration"].excluded.astype(bool)
        marks = 1 + (2 * within.sum() >= len(within)) + within.all()
        facts["matched"] = {"count": len(within), "within": within.sum(), "marks": marks}
    return facts


def _sign_of(row: Any) -> int:
    """Whether an estimate is above 0 (1) or below it (-1); 0 where neither shows.

    The difference must show in both the interval and the test.
    """
    return (int(row.low > 0) - int(row.high < 0)) * _passes(row.p_value)


def _passes(p_value: float | None) -> bool:
    return p_value is not None and p_value <= LEVEL


def _row(row: pd.Series) -> dict[str, Any]:
    """A row of a table, with None in place of a number that is missing."""
    return {str(name): _finite(value) for name, value in row.items()}


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


# --- Sentences ---------------------------------------------------------------------------------


def _answer(**facts: Any) -> Answer:
    """The sentences for the facts."""
    import jinja2

    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, autoescape=False)
    environment.filters |= {"two": _two, "fixed": _fixed, "g": _short, "p": _p}
    environment.filters |= {"least": _least, "extent": _extent, "listed": _listed}
    environment.filters["capfirst"] = lambda text: text[:1].upper() + text[1:]
    template = Path(__file__).with_suffix(".jinja").read_text(encoding="utf-8")
    words = {"models": MODELS, "level": LEVEL, "most_named": _MOST_NAMED}
    text = environment.from_string(template).render(words | facts)
    questions, _, details = text.partition("## In detail")
    lines = []
    for part in questions.split("## ")[1:]:
        question, _, answer = part.partition("\n")
        if answer := _sentence(answer).removeprefix("· "):
            _, short, rest = answer.split("**", 2) if "**" in answer else ("", "", answer)
            lines.append(Line(question, short.strip(), rest))
    return Answer(lines, list(filter(None, map(_sentence, details.split("¶")))))


def _sentence(text: str) -> str:
    """Text without line breaks, and without spaces before a mark that takes none."""
    return re.sub(r" (?=[,;:.)])|(?<=\() ", "", " ".join(text.split()))


def _listed(names: Sequence[str]) -> str:
    *others, last = names
    return f"{', '.join(others)} and {last}" if others else last


def _two(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


def _fixed(value: float, decimals: int, sign: str = "-") -> str:
    return f"{value:{sign}.{decimals}f}".replace("-", "−")


def _short(value: float, digits: int = 6) -> str:
    return f"{value:.{digits}g}".replace("-", "−")


def _least(value: float, least: float, unit: str) -> str:
    return f"{_two(value)} {unit}" if value >= least else f"less than {least:g} {unit}"


def _extent(ends: Sequence[float], least: float, unit: str) -> str:
    return " to ".join(dict.fromkeys(_least(end, least, unit) for end in ends))


def _p(value: float | None) -> str:
    if value is None or not math.isfinite(value):
        return "not tested"
    if not 0.001 <= value <= 0.99:
        return "p < 0.001" if value < 0.5 else "p > 0.99"
    return f"p = {value:.2g}"
