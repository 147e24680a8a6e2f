"""The answer of a study in a few labelled lines, computed from its tables.

Which patches wore; whether patches that the stated load does not touch wear less; how the tool was
used; whether the loss that the other patches predict of each is right, and better than baselines
that are given the same data; which patches carry the load. The statistics behind it are details.
No sentence claims more than its numbers allow: a difference must show in an interval and in a test.
"""

import math
from collections.abc import Mapping, Sequence
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

__all__ = ["LEVEL", "MODELS", "Answer", "Line", "best_law", "sign_of", "used", "verdict"]
__all__ += ["where_to_scan"]

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
# What a cap on the pressure is held against: Broz, Cook & Whitney 2006, Am. Mineral. 91:135.
STRENGTH = "quartz indents at 11 to 12 GPa, quartzite is crushed at 0.15 to 0.3 GPa"
# A longer list of names does not help a reader.
_MOST_NAMED = 5
_COMPARED = {1: "better", -1: "worse", 0: "not shown to be better or worse"}
_RULE = f"Places are better than by chance where p ≤ {LEVEL}. A difference is called better "
_RULE += f"or worse where its 95 % interval shows it, and a test with p ≤ {LEVEL}."
# Where the study takes the use that the wear tells, leave-one-out is not complete.
_ALL_TELL = (
    "The tilt of a patch and the pressures around it are under the use that all losses tell, its "
    "own among them."
)
# The laws beside Archard's, the unit of their parameter, and the config key that chooses them.
_LAWS = {
    "threshold": ("a threshold pressure", " MPa", "threshold_MPa"),
    "lower exponent": ("an exponent of pressure", "", "exponent"),
    "higher exponent": ("an exponent of pressure", "", "exponent"),
    "touched": ("the same loss wherever patches are touched", "", "exponent to 0"),
}
_USED = "How was it used?"
_WHERE = "Where within the patches?"


class Line(NamedTuple):
    """A question, its answer in a few words, and what follows them in the same sentence."""

    question: str
    short: str
    rest: str


class Answer(NamedTuple):
    """What a study found."""

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
    pressures, is_compared = tables["patch_pressures"], "validation_summary" in tables
    wore = (
        "Not known",
        ": no patch has a scan after use (T1), so no prediction is compared with wear.",
    )
    answers, details, models = {"Which patches wore?": wore}, [""], set()
    if is_compared:
        summary = tables["validation_summary"].fillna({"model": ""})
        summary = summary.set_index(["model", "statistic"]).sort_index()
        models = set(summary.index.unique("model")) & {BARE, INTERLAYER}
        under = pressures[["patch"]].assign(stated_MPa=stated(pressures))
        losses = under.merge(tables["registration"], how="left")
        answers["Which patches wore?"] = _which(losses)
        answers["Do untouched patches wear less?"] = _untouched(summary, losses)
    if "use" in tables:
        answers[_USED] = used(tables["use"], square_mm, force_N)
    is_archard = Law(**(wear_law or {})) == ARCHARD
    if "laws" in tables:
        answers["Which law predicts best?"] = best_law(tables["laws"], is_archard)
    if is_compared and not pressures["in_study"].any():
        answers[_WHERE] = (
            "No patch is in the study",
            ": the table of patches gives the reasons.",
        )
    elif models:
        own = own_model(list(models))
        law = "Archard's law" if is_archard else "the wear law in the config"
        if poses is not None:
            law += f" over a gesture of {poses} poses"
        if own == INTERLAYER and interlayer is not None:
            young, thick = interlayer["young_MPa"], interlayer["thickness_um"]
            law += f" with an interlayer of {young:g} MPa, {thick:g} µm thick,"
        answers[_WHERE] = _where(summary, own, law)
        answers["How deep, how much?"] = _how_much(summary, own)
        details = [_agreement(summary, own, law), _errors(summary, own, pressure_cap)]
        is_read = "use" in tables and bool(tables["use"].taken.iloc[0])
        details += [_ALL_TELL * is_read]
        details += [_without_interlayer(summary) if own == INTERLAYER else "", _RULE]
    elif is_compared:
        answers[_WHERE] = (
            "Nothing is compared with wear",
            ": no loss of a patch could be predicted from those of the others.",
        )
    who, load = _load(pressures, tables["patch_intervals"], force_N, second)
    if poses is not None:
        load += f" {_exposed(tables['exposure'], poses)}"
    answers["Which patches bear the load?"] = who, load
    answers["How sure?"] = "", _how_sure(tables)
    lines = [Line(question, *said) for question, said in answers.items() if any(said)]
    return Answer(lines, list(filter(None, details)))


def used(use: pd.DataFrame, square_mm: float, force_N: float) -> tuple[str, str]:
    """How the tool was used, as its wear says, and how sure that is."""
    known, answer = use.set_index("parameter"), use.answer.iloc[0]
    if answer.startswith(UNKNOWN):
        reason = answer.removeprefix(UNKNOWN)
        return UNKNOWN.capitalize(), f"{reason}. The study goes on as stated."
    competitor = use.competitor.iloc[0]
    if answer == NOT_PRESSED:
        return (
            "Not shown",
            f": {competitor} predicts the wear of each patch from the wear of the others better "
            "than a load does. Nothing shows that the wear was pressed. The study goes on as "
            "stated.",
        )
    x, y = (known.loc[f"load_point_{axis}"] for axis in "xy")
    spread = known.loc["spread"]
    where = f"about x {x['mean']:.1f} mm and y {y['mean']:.1f} mm, ± {spread['mean']:.1f} mm"
    within = f"x {x.low:.1f} to {x.high:.1f}, y {y.low:.1f} to {y.high:.1f} mm"
    within += f", ± {spread.low:.1f} to {spread.high:.1f} mm"
    stated = f"x {x.stated:.3g} and y {y.stated:.3g} mm"
    if "radius" in known.index:
        row = known.loc["radius"]
        where += f", against a tool of {_two_digits(row['mean'])} mm radius at {force_N:g} N"
        within += f", radius {_two_digits(row.low)} to {_two_digits(row.high)} mm"
        stated += f" and {row.stated:.0f} mm"
    rest = f" (95 %: {within}). Stated were {stated}."
    edges = [
        f"{axis} = {edge:g}"
        for axis, row in (("x", x), ("y", y))
        for edge, is_reached in ((0, row.low < 0), (square_mm, row.high > square_mm))
        if is_reached
    ]
    if edges:  # their side is found, but not how far beyond, nor where along them
        rest = f": {where}{rest} Beyond the square, these intervals are too narrow."
        where = (
            f"near or beyond the edge{'s' * (len(edges) > 1)} {_listed(edges)} mm of the square"
        )
    where, rest = (text.replace("-", "\N{MINUS SIGN}") for text in (where, rest))
    if answer == PRESSED:
        return (
            f"Pressed {where}",
            f"{rest} A load predicts the wear of each patch from the wear of the others better "
            f"than any pattern without contact, of which {competitor} is the best.",
        )
    return (
        f"Perhaps pressed {where}",
        f"{rest} A load predicts the wear of each patch from the wear of the others, but "
        f"{competitor} may do so as well. The study goes on under this use.",
    )


def best_law(laws: pd.DataFrame, is_archard: bool) -> tuple[str, str]:
    """Which law of wear predicts the losses best, from the table ``laws``.

    `is_archard` says whether Archard's law is the law in the config.
    """
    if laws.empty:
        return "", ""
    answer, rows = laws.answer.iloc[0], laws.set_index("law")
    if answer == BASE:
        return "Archard's law", (
            ": it predicts the losses better than a threshold pressure, than another exponent of "
            "pressure, and than the same loss wherever patches are touched."
        )
    best = rows.gain.drop(BASE).idxmax()
    row = rows.loc[best]
    name, unit, key = _LAWS[best]
    if math.isfinite(row["mean"]):
        mean, low, high = map(_two_digits, (row["mean"], row.low, row.high))
        name += f" of {mean}{unit} (95 %: {low} to {high})"
    scores = f"log score {row.gain:+.1f} ± {row.gain_error:.1f}".replace("-", "−")
    if answer == UNDECIDED:
        return "The data cannot tell", (
            f": the losses do not separate Archard's law from the others. The best of these is "
            f"{name} ({scores})."
        )
    remedy = f" Set wear_law.{key} to use it." * is_archard
    return f"{name[0].upper()}{name[1:]}", (
        f": it predicts the losses better than Archard's law ({scores}).{remedy}"
    )


def _without_curvature(use: pd.DataFrame) -> str:
    """How much the answer rests on the form of a worn face."""
    known = use.set_index("parameter")
    if "mean_without_curvature" not in known or not known.taken.iloc[0]:
        return ""
    other = known.mean_without_curvature
    if pd.isna(other["load_point_x"]):
        return " With the curvature of the square taken out, nothing can be inferred."
    radius = f" and {_two_digits(other['radius'])} mm" if "radius" in other else ""
    return (
        " Use may have ground the form of the face: with the curvature of the square taken out, it "
        f"would be x {other['load_point_x']:.1f}, y {other['load_point_y']:.1f} mm{radius}."
    )


def sign_of(row: Any) -> int:
    """Whether an estimate is above 0 (1) or below it (-1); 0 where neither shows.

    `row` has ``low, high, p_value``. The difference must show in both the interval and the test.
    """
    return (int(row.low > 0) - int(row.high < 0)) * int(row.p_value <= LEVEL)


def _load(
    pressures: pd.DataFrame, intervals: pd.DataFrame, force_N: float, second: bool
) -> tuple[str, str]:
    """Which patches carry the load, and how well the highest pressure is known."""
    total, count = float(pressures["force_N"].sum()), len(pressures)
    against = " against the active tool" * second
    if not total > 0:
        none, under = "No scanned patch touches", f" under {force_N:g} N{against}"
        may = intervals.loc[intervals["high_MPa"].fillna(0).idxmax()]
        if not may.high_MPa > 0:
            return none, f"{under}."
        return none, (
            f"{under}; within the 95 % intervals, patch {may.patch} may bear the most, up to "
            f"{_two_digits(may.high_MPa)} MPa."
        )
    highest = pressures.loc[pressures["pressure_MPa"].idxmax()]
    known = intervals.set_index("patch").loc[highest["patch"]]
    pressure = _two_digits(known.pressure_MPa)
    most, top = f"atch {highest['patch']}", f" bears the highest pressure, {pressure} MPa"
    if pd.notna(known.low_MPa):
        top += f" (95 % interval {_two_digits(known.low_MPa)} to {_two_digits(known.high_MPa)})"
    if count == 1:
        return f"P{most}", f"{top}."
    ordered = pressures.sort_values("force_N", ascending=False, kind="stable")
    shares = ordered["force_N"].cumsum() / total
    first = list(ordered["patch"])[: int((shares <= 0.5).sum()) + 1]
    who, carry = f"Patch {first[0]}", "carries"
    if len(first) > 1:
        who, carry = f"Patches {_listed(first)}", "carry"
    if len(first) > _MOST_NAMED:
        who = f"The load is spread: {len(first)} patches"
    share = f"{100 * shares.iloc[len(first) - 1]:.0f} % of the load on the {count} patches"
    share += f", which bear {_at_least(100 * total / force_N, 1, '%')} of the force{against}"
    return who, f" {carry} {share}; p{most}{top}."


def _exposed(exposure: pd.DataFrame, poses: int) -> str:
    """Which patch a gesture wears most, by pressure and sliding alone."""
    first = exposure.loc[exposure["exposure_N_per_mm"].idxmax()]
    if not first.exposure_N_per_mm > 0:
        return f"None of the {poses} poses of the gesture touches a patch."
    return (
        f"Over the {poses} poses of the gesture, patch {first.patch} is exposed most; "
        f"{100 * first.touched:.0f} % of them touch it."
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
    lines = []
    if use is not None:
        short, rest = used(use, square_mm, force_N)
        lines = [Line(_USED, short, rest + _without_curvature(use))]
    exposed, controls = (places[places.kind == kind] for kind in (EXPOSED, CONTROL))
    spread = Line(
        "Where is it exposed?",
        f"{_at_least(100 * held.in_square, 1, '%')} of the exposure lies in the square",
        f", half of that on {_two_digits(100 * held.half_area)} % of its area, under {force_N:g} N "
        "wherever the hand pushes.",
    )
    if exposed.empty:
        nothing = "No pose touches the square", ", so there is nothing to scan in it."
        return Answer([*lines, Line("Where to scan?", *nothing)], [])
    first = exposed.iloc[0]
    scan = (
        f"Scan {_from_to(exposed)}",
        f": of the square's exposure, {100 * held.in_places:.0f} % lies "
        f"there, on {100 * held.places_area:.0f} % of its area; most in {first.place}, "
        f"{first.x_mm:g} mm along x and {first.y_mm:g} mm along y from the reference corner.",
    )
    control = "There is no control", ": no place is free of contact."
    if not controls.empty:
        control = f"Scan {_from_to(controls)} as controls", ": no pose touches them."
    lines += [Line("Where to scan?", *scan), Line("What to compare with?", *control), spread]
    return Answer(lines, [])


def _from_to(places: pd.DataFrame) -> str:
    first, last = places.place.iloc[0], places.place.iloc[-1]
    return first if len(places) == 1 else f"{first} to {last}"


def _listed(names: Sequence[str]) -> str:
    *others, last = names
    return f"{', '.join(others)} and {last}" if others else last


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


def _at_least(value: float, least: float, unit: str) -> str:
    return f"{_two_digits(value)} {unit}" if value >= least else f"less than {least:g} {unit}"


def _range(values: pd.Series, least: float, unit: str) -> str:
    ends = [_at_least(value, least, unit) for value in (values.min(), values.max())]
    return " to ".join(dict.fromkeys(ends))


def _which(losses: pd.DataFrame) -> tuple[str, str]:
    """Which patches lost height, how much of their area and how deep; and what of the others."""
    if not losses.found.eq(True).any():
        return "Not known", ": no scan after use (T1) matches its T0, so no loss is known."
    known = losses.dropna(subset="mean_wear_depth_um")
    lost, certain = known.loss_fraction > 0, known.above_noise.astype(bool)
    worn = known[lost & certain].sort_values("mean_wear_depth_um", ascending=False)
    short, said, names = f"{len(worn) or 'None'} of {len(known)}", "", list(worn.patch)
    if names:
        who = f", patch {names[0]} the most"
        if len(names) <= _MOST_NAMED:
            who = f" (patch{'es' * (len(names) > 1)} {_listed(names)})"
        area = _range(100 * worn.loss_fraction, 0.1, "%")
        depth = _range(worn.mean_depth_where_worn_um, 0.01, "µm")
        said = f"{who}: on {area} of the area, {depth} deep there on average"
    others = {
        "; {} lost less than the scans can show": len(known) - lost.sum(),
        "; {} lost what may be noise": (lost & ~certain).sum(),
        "; of {} more no loss is known": len(losses) - len(known),
    }
    said += "".join(how.format(count) for how, count in others.items() if count)
    return short, f"{said}."


def _where(summary: pd.DataFrame, own: str, law: str) -> tuple[str, str]:
    """Was the place of the loss predicted better than by chance, and than by the best baseline?"""
    gain = summary.loc[(own, "gain(mcc)")]
    if not gain.n:
        return (
            "Not compared",
            f": {law} predicts a loss, but no patch in the study lost enough to be compared with.",
        )
    tested = summary.loc[(own, "tested_mean(mcc)")]
    chance, more = "Not tested against chance", ""
    if math.isfinite(tested.p_value):
        chance = "Better than by chance" if tested.p_value <= LEVEL else "Not shown"
        more = f" ({_p(tested.p_value)} over {tested.n} patches)"
    return chance, (
        f"{more}, predicted from the wear of the others; {_COMPARED[sign_of(gain)]} than the best "
        f"baseline, {MODELS[gain.against]}."
    )


def _how_much(summary: pd.DataFrame, own: str) -> tuple[str, str]:
    """How wrong are depths and volumes, against the best baseline of each?"""
    names = "relative_to_best(map_error)", "relative(volume_error)"
    depth, volume = (summary.loc[(own, name)] for name in names)
    if not (math.isfinite(depth.value) and math.isfinite(volume.value)):
        return "", ""
    same = volume.against == depth.against
    theirs = "it" if same else f"the best, {MODELS[volume.against]}"
    return (
        f"Depths err {_two_digits(depth.value)} times as much as the best baseline",
        f", {MODELS[depth.against]}: {_ratio_in_words(depth)}; volumes "
        f"{_two_digits(volume.value)} times as much as {theirs}: {_ratio_in_words(volume)}.",
    )


def _ratio_in_words(row: Any) -> str:
    """Whether a ratio of errors shows a difference; below 1, it is better."""
    shows = int(row.high < 1) - int(row.low > 1)
    return f"{_COMPARED[shows * int(row.p_value <= LEVEL)]} ({_p(row.p_value)})"


def _how_sure(tables: Mapping[str, pd.DataFrame]) -> str:
    """Marks for how many patches there are, where they lie, and how well T1 lies on T0."""
    said = []
    if "validation_patches" in tables:
        count = int(tables["validation_patches"].in_statistics.sum())
        reached = sum(2.0 ** (1 - count) <= level for level in _LEVELS)
        said.append(f"number of patches {_marks(reached)} ({count})")
    if "placement" in tables:
        each = tables["placement"].iloc[:-1].status
        together = tables["placement"].status.iloc[-1]
        agreeing = int((each == AGREES).sum())
        is_clear = together != CANNOT_TELL and 2 * agreeing >= len(each)
        marks = 3 if (each == together).all() and is_clear else 2 if is_clear else 1
        where = f"{agreeing} of {len(each)} agree with the mesh"
        said.append(f"their places {_marks(marks)} ({where if agreeing else together})")
    if "registration" in tables:
        within = ~tables["registration"].excluded.astype(bool)
        marks = 3 if within.all() else 2 if 2 * within.sum() >= len(within) else 1
        said.append(f"T1 on T0 {_marks(marks)} ({within.sum()} of {len(within)} match)")
    return " · ".join(said)


def _marks(reached: int) -> str:
    """Of three marks, so many full, and one at least."""
    full = max(1, reached)
    return "●" * full + "○" * (3 - full)


def _agreement(summary: pd.DataFrame, own: str, law: str) -> str:
    """The agreement of predicted and measured places, and of the best baseline's."""
    mean, gain = (summary.loc[(own, f"{name}(mcc)")] for name in ("mean", "gain"))
    if not mean.n:
        return ""
    baseline = summary.value[gain.against, "mean(mcc)"]
    interval = ""
    if math.isfinite(mean.low):
        interval = f"; 95 % interval {mean.low:.2f} to {mean.high:.2f}"
    patches = "1 patch" if mean.n == 1 else f"{mean.n} patches"
    sentence = (
        f"From the wear of the other patches, {law} predicts where each patch lost height with a "
        f"mean MCC of {mean.value:.2f} (0 is chance, 1 perfect{interval}) "
        f"over {patches}. The best baseline that is given the same data, {MODELS[gain.against]}, "
        f"reaches {baseline:.2f} ({_p(gain.p_value)})."
    )
    return sentence.replace("-", "−")


def _errors(summary: pd.DataFrame, own: str, pressure_cap: float | None) -> str:
    """What masks of its areas could reach, errors of map and volume, and all if stone yields."""
    depth, volume = (summary.loc[(own, f"relative({of}_error)")] for of in ("map", "volume"))
    if not (math.isfinite(depth.value) and math.isfinite(volume.value)):
        return ""
    reached = summary.value[own, "mean(attainable_mcc)"]
    sentence = (
        f"Masks of the predicted areas could reach {reached:.2f}. "
        f"Its maps err {_two_digits(depth.value)} times as much as no loss would "
        f"({_p(depth.p_value)}), its volumes {_two_digits(volume.value)} times as much as the best "
        f"baseline's ({_p(volume.p_value)})."
    )
    if (CAPPED, "mean(mcc)") in summary.index and pressure_cap is not None:
        names = "mean(mcc)", "relative(map_error)", "relative(volume_error)"
        mcc, *errors = (summary.value[CAPPED, name] for name in names)
        sentence += (
            f" If no element bears more than {pressure_cap:g} MPa ({STRENGTH}), the mean MCC is "
            f"{mcc:.2f}, and these errors are {' and '.join(map(_two_digits, errors))} times."
        )
    return sentence.replace("-", "−")


def _without_interlayer(summary: pd.DataFrame) -> str:
    """Whether the interlayer predicts what was lost out of contact better than the bare stone."""
    out = summary.loc[(INTERLAYER, "relative(out_of_contact)")]
    if not math.isfinite(out.value):
        return ""
    return (
        f"Out of contact, where only an interlayer wears, its maps err {_two_digits(out.value)} "
        f"times as much as those of the bare stone ({_p(out.p_value)})."
    )


def _untouched(summary: pd.DataFrame, losses: pd.DataFrame) -> tuple[str, str]:
    """Do patches wear less that the load as stated, which no wear has shaped, does not touch?"""
    known = losses.dropna(subset="mean_wear_depth_um")
    known = known[known.above_noise.astype(bool)]
    is_touched = known.stated_MPa > 0
    untouched, touched = (
        known.mean_wear_depth_um[is_touched == side] for side in (False, True)
    )
    if untouched.empty or touched.empty:
        return "Not tested", ": this takes both touched and untouched patches of known loss."
    row = summary.loc[("", TOUCHED)]
    said = {1: "Yes", -1: "No, they wore more", 0: "Not shown"}
    who = "patch" if len(untouched) == 1 else f"{len(untouched)} patches"
    other = "other" if len(touched) == 1 else f"{len(touched)} others"
    means = [_at_least(of.mean(), 0.01, "µm") for of in (untouched, touched)]
    return said[sign_of(row)], (
        f": the {who} that the stated load does not touch lost {means[0]} on average, the {other} "
        f"{means[1]} ({_p(row.p_value)})."
    )


def _p(value: float) -> str:
    if not math.isfinite(value):
        return "not tested"
    if not 0.001 <= value <= 0.99:
        return "p < 0.001" if value < 0.5 else "p > 0.99"
    return f"p = {value:.2g}"
