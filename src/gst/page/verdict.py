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

import jinja2
import pandas as pd

from gst.config.poses import poses_of
from gst.page.results import Results
from gstlib.conditions import ARCHARD, Law
from gstlib.coupling.comparison import AGREES, CANNOT_TELL
from gstlib.macroscale.sampling_sites import CONTROL, EXPOSED, concentration
from gstlib.use.evidence import FEWEST_WORN
from gstlib.use.infer import NOT_PRESSED, PRESSED, UNKNOWN
from gstlib.use.laws import BASE, UNDECIDED
from gstlib.validation.baselines import ORACLE
from gstlib.validation.scoring import own_model
from gstlib.validation.summary import ERROR_TO_BEAT, statistic_names
from gstlib.wear.archard import BARE, CAPPED, INTERLAYER

LEVEL = 0.05  # the usual one
# A mark for each of these levels that the test can reach.
_LEVELS = LEVEL, 0.001
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
    "FEWEST_WORN": FEWEST_WORN,
    "ERROR_TO_BEAT": ERROR_TO_BEAT,
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


def verdict(study: Results, config: Mapping[str, Any]) -> Answer:
    """The answer about the wear, the use, the prediction and the load, or where to scan.

    `study` has tables by name: ``patch_pressures``, ``patch_intervals``; with scans after use,
    ``registration``, ``validation_patches`` and ``validation_summary``; if the load was inferred
    from the wear, ``use``; with enough losses, ``laws``; with a gesture, ``exposure``;
    ``placement``, where patches were compared with the mesh. Without patches, it has ``places``.
    """
    facts: dict[str, Any] = {"study": study, "config": config, "use": _use(study)}
    if "places" in study.tables:
        return _answer(**facts, scan=_scan(study))
    pressures = study.table("patch_pressures")
    facts |= {"scan": None, "wore": None, "own": None, "where": None}
    if "validation_summary" in study.tables:
        facts["scores"] = scores = _scores(study.table("validation_summary"))
        facts["wore"] = _wore(study.losses)
        models = [model for model in (BARE, INTERLAYER) if model in scores]
        if not pressures.in_study.any():
            facts["where"] = "not in study"
        elif not models:
            facts["where"] = "not predicted"
        else:
            facts |= {"where": "predicted", "own": own_model(models)}
    poses = poses_of(config)
    if poses is not None:
        facts["exposed"] = _highest(study.table("exposure"), "exposure_N_per_mm")
    return _answer(
        **facts,
        laws=_laws(study),
        load=_load(pressures, study.table("patch_intervals"), study.force_N),
        sure=_certainty(study),
        is_archard=Law(**config["wear_law"]) == ARCHARD,
        poses=None if poses is None else len(poses),
    )


def _scan(study: Results) -> dict[str, Any]:
    """The places to scan, and where pressure and exposure concentrate."""
    places = study.table("places")
    sizes = {"size_mm": study.size_mm, "patch_mm": study.patch_mm}
    exposure = study.data("exposure", "exposure", "touched")
    exposed, controls = (places[places.kind == kind] for kind in (EXPOSED, CONTROL))
    held = concentration(exposure, places, **sizes)
    return {"exposed": exposed, "controls": controls, "held": held}


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


def _use(study: Results) -> dict[str, Any] | None:
    """The rows of the use, and the edges of the square that its intervals reach."""
    if "use" not in study.tables:
        return None
    use = study.table("use")
    rows = use.set_index("parameter").to_dict("index")
    edges = []
    for axis in "xy":
        row = rows[f"load_point_{axis}"]
        if row["low"] < 0:
            edges.append(f"{axis} = 0")
        if row["high"] > study.size_mm:
            edges.append(f"{axis} = {study.size_mm:g}")
    return {"first": use.iloc[0], "edges": edges} | rows


def _laws(study: Results) -> dict[str, Any] | None:
    """The best law beside the base, and the answer; None without laws."""
    if "laws" not in study.tables or (laws := study.table("laws")).empty:
        return None
    return _highest(laws[laws.law != BASE], "log_score_gain")


def _highest(table: pd.DataFrame, column: str) -> dict[str, Any]:
    return table.loc[table[column].idxmax()].to_dict()


def _wore(losses: pd.DataFrame) -> dict[str, Any]:
    """The worn patches, the most worn first, and the number of the others.

    Of those whose loss is no noise, also the depths where the given load, which no wear has shaped,
    touches and where it does not.
    """
    measured = losses.dropna(subset="mean_wear_depth_um")
    is_lost = measured.loss_fraction > 0
    is_certain = measured.above_noise.eq(True)
    is_touched = measured.stated_MPa > 0
    depths = measured.mean_wear_depth_um
    worn = measured[is_lost & is_certain]
    return {
        "worn": worn.sort_values("mean_wear_depth_um", ascending=False),
        "pressed": (is_lost & is_certain & is_touched).sum(),
        "touched": depths[is_certain & is_touched],
        "untouched": depths[is_certain & ~is_touched],
        "matched": losses.found.eq(True).any(),
        "measured": len(measured),
        "unknown": len(losses) - len(measured),
        "undetected": (~is_lost).sum(),
        "noise": (is_lost & ~is_certain).sum(),
    }


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


def _certainty(study: Results) -> dict[str, Any]:
    """Marks for the number of patches, their positions, and the registration of T1 to T0."""
    facts: dict[str, Any] = dict.fromkeys(("patches", "places", "matched"))
    if "validation_patches" in study.tables:
        count = int(study.table("validation_patches").in_statistics.sum())
        least = 2.0 ** (1 - count)  # p-value of an exchange test
        marks = 1 + sum(least <= level for level in _LEVELS)
        facts["patches"] = {"count": count, "marks": marks}
    if "placement" in study.tables:
        *each, together = study.table("placement").status
        count, agreeing = len(each), each.count(AGREES)
        is_clear = together != CANNOT_TELL and 2 * agreeing >= count
        marks = 1 + is_clear + (is_clear and set(each) <= {together})
        counts = {"count": count, "agreeing": agreeing, "marks": marks}
        facts["places"] = {"status": together, **counts}
    if "registration" in study.tables:
        is_within = ~study.table("registration").excluded.astype(bool)
        count, within = len(is_within), is_within.sum()
        marks = 1 + (2 * within >= count) + is_within.all()
        facts["matched"] = {"count": count, "within": within, "marks": marks}
    return facts


# --- Sentences ---------------------------------------------------------------------------------


def _answer(**facts: Any) -> Answer:
    """The sentences for the facts."""
    environment = jinja2.Environment(undefined=jinja2.StrictUndefined, autoescape=False)
    filters = _listed, _two, _times, _fixed, _least, _extent, _p, _sign
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


def _times(ratio: float) -> str:
    return f"{ratio:.3g}" if _two(ratio) == "1" else _two(ratio)


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
