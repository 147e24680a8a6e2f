"""The answer of a study in a few labelled lines, computed from its tables.

Which patches wore; whether patches that the given load does not touch wear less; how the tool was
used; whether the loss of each patch, predicted from the other patches, is right, and better than
baselines with the same data; which patches carry the load. The statistics behind it are details.
No sentence claims more than its numbers allow: a difference must show in an interval and in a test.

This module computes the numbers; the sentences are in ``verdict.jinja`` beside it.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import pandas as pd

from gst.config.poses import poses_of
from gst.page.results import Results
from gst.page.templates import LEVEL, one_line, paragraphs, render
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

_WORDS = {
    "models": MODELS,
    "level": LEVEL,
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
    scan = _scan(study) if "places" in study.tables else {}
    facts = {} if scan else _wear(study) | _load(study) | _certainty(study)
    poses = poses_of(config)
    text = render(
        "verdict.jinja",
        study=study,
        config=config,
        use=_rows(study, "use", "parameter"),
        scan=scan,
        poses=poses is not None and len(poses),
        is_archard=Law(**config["wear_law"]) == ARCHARD,
        **_WORDS,
        **facts,
    )
    questions, _, details = text.partition("## In detail")
    lines = []
    for part in questions.split("## ")[1:]:
        question, _, answer = part.partition("\n")
        if answer := one_line(answer).removeprefix("· "):
            *_, short, rest = ["", *answer.split("**", 2)]
            lines.append(Line(question, short.strip(), rest))
    return Answer(lines, paragraphs(details))


def _rows(study: Results, table: str, key: str) -> dict[str, dict[str, Any]]:
    """The rows of a table by a column without repeats; none without the table."""
    if table not in study.tables:
        return {}
    return study.table(table).set_index(key).to_dict("index")


def _scan(study: Results) -> dict[str, Any]:
    """The places to scan, and where pressure and exposure concentrate."""
    places = study.table("places")
    exposure = study.data("exposure", "exposure", "touched")
    sizes = {"size_mm": study.size_mm, "patch_mm": study.patch_mm}
    return {
        "exposed": places[places.kind == EXPOSED],
        "controls": places[places.kind == CONTROL],
        "held": concentration(exposure, places, **sizes),
    }


def _wear(study: Results) -> dict[str, Any]:
    """Losses, scores of the predictions of them, and what follows from both.

    ``losses`` are those of all patches. Of those that are no noise, ``touched`` and ``untouched``
    are those that the given load touches or not, ``worn`` those that lost something, the most worn
    first. ``scores`` are the rows of the summary by model and statistic, ``own`` is the study's own
    prediction, or "", and ``law`` the best law beside the base.
    """
    if "validation_summary" not in study.tables:
        return {"losses": None, "own": "", "law": None}
    losses, summary = study.losses, study.table("validation_summary")
    certain = losses[losses.above_noise.eq(True)].dropna(subset="mean_wear_depth_um")
    # no wear has shaped the given load
    is_touched, worn = certain.stated_MPa > 0, certain[certain.loss_fraction > 0]
    # in an empty table, the column of names is one of numbers
    model = summary.model.astype(object).fillna("")
    summary = summary.assign(statistic=statistic_names(summary)).groupby(model)
    scores = {
        name: rows.set_index("statistic").to_dict("index") for name, rows in summary
    }
    models = [name for name in (BARE, INTERLAYER) if name in scores]
    is_any_studied = study.table("patch_pressures").in_study.any()
    law = None
    if "laws" in study.tables and not (laws := study.table("laws")).empty:
        law = _highest(laws[laws.law != BASE], "log_score_gain")
    return {
        "losses": losses,
        "touched": certain[is_touched],
        "untouched": certain[~is_touched],
        "worn": worn.sort_values("mean_wear_depth_um", ascending=False),
        "scores": scores,
        "own": own_model(models) if models and is_any_studied else "",
        "law": law,
    }


def _highest(table: pd.DataFrame, column: str) -> dict[str, Any]:
    return table.loc[table[column].idxmax()].to_dict()


def _load(study: Results) -> dict[str, Any]:
    """The patches that carry the load, and the highest pressure with its interval.

    Of a gesture, also the patch with the highest exposure.
    """
    pressures = study.table("patch_pressures").set_index("patch")
    limits = study.table("patch_intervals").set_index("patch")
    total_N = float(pressures.force_N.sum())
    decisive = pressures.pressure_MPa if total_N > 0 else limits.high_MPa.fillna(0)
    most = decisive.idxmax()
    ordered = pressures.force_N.sort_values(ascending=False, kind="stable")
    shares = ordered.cumsum() / total_N
    fewest = (shares <= 0.5).sum() + 1  # that carry more than half
    exposed = None
    if "exposure" in study.tables:
        exposed = _highest(study.table("exposure"), "exposure_N_per_mm")
    return {
        "count": len(pressures),
        "total_N": total_N,
        "most": most,
        "highest": limits.loc[most],
        "carriers": list(ordered.index[:fewest]),
        "share": shares.iloc[fewest - 1],
        "exposed": exposed,
    }


def _certainty(study: Results) -> dict[str, Any]:
    """Marks for the number of patches, their positions, and the registration of T1 to T0."""
    sure: dict[str, dict[str, Any]] = {}
    if "validation_patches" in study.tables:
        count = int(study.table("validation_patches").in_statistics.sum())
        least = 2.0 ** (1 - count)  # p-value of an exchange test
        marks = 1 + sum(least <= level for level in _LEVELS)
        sure["patches"] = {"marks": marks, "count": count}
    if "placement" in study.tables:
        *each, status = study.table("placement").status
        agreeing = each.count(AGREES)
        is_clear = status != CANNOT_TELL and 2 * agreeing >= len(each)
        marks = 1 + is_clear + (is_clear and set(each) <= {status})
        sure["places"] = {"marks": marks, "count": len(each), "agreeing": agreeing}
        sure["places"]["status"] = status
    if "registration" in study.tables:
        is_within = ~study.table("registration").excluded.astype(bool)
        marks = 1 + (is_within.mean() >= 0.5) + is_within.all()
        counts = {"count": len(is_within), "within": is_within.sum()}
        sure["matched"] = {"marks": marks} | counts
    return {"sure": sure}
