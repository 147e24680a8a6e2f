"""The answer of a study in a few sentences, computed from its tables.

Whether the loss that the other patches predict of each is right, and better than baselines that are
given the same data; whether patches that nothing touches wear less; which patches carry the load.
No sentence claims more than its numbers allow: a difference must show in an interval and in a test.
"""

import math
from collections.abc import Mapping
from typing import Any

import pandas as pd

from gstlib.macroscale.sampling_sites import CONTROL, EXPOSED, Concentration
from gstlib.use.infer import BETTER, CHANCE
from gstlib.validation.baselines import ORACLE
from gstlib.validation.scoring import own_model
from gstlib.wear.archard import BARE, CAPPED, INTERLAYER

__all__ = ["LEVEL", "MODELS", "sign_of", "used", "verdict", "where_to_scan"]

LEVEL = 0.05  # the usual one
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


def verdict(
    tables: Mapping[str, pd.DataFrame],
    *,
    force_N: float,
    interlayer: Mapping[str, float] | None = None,
    pressure_cap: float | None = None,
    poses: int | None = None,
    second: bool = False,
) -> list[str]:
    """What the study found, in sentences: the predicted loss first, then the load.

    Parameters
    ----------
    tables : mapping of str to pandas.DataFrame
        By name: ``patch_pressures``, ``patch_intervals``; of a study with scans after use,
        ``registration``, ``validation_patches`` and ``validation_summary``; of one whose wear says
        how the tool was used, ``use``; of one with a gesture, ``exposure``.
    force_N : float
        The whole load.
    interlayer, pressure_cap
        The sections ``interlayer`` and ``pressure_cap_MPa`` of the config.
    poses : int, optional
        Of the gesture, if there is one.
    second : bool
        Whether the active tool has a mesh.
    """
    pressures = tables["patch_pressures"]
    load = [used(tables["use"])] if "use" in tables else []
    load += [_load(pressures, tables["patch_intervals"], force_N, second)]
    if poses is not None:
        load.append(_exposed(tables["exposure"], poses))
    if not pressures["in_study"].any():
        return [*load, "No patch is in the study: the table of patches gives the reasons."]
    if "validation_summary" not in tables:
        return [
            *load,
            "No patch has a scan after use (T1), so no prediction is compared with wear.",
        ]
    summary = tables["validation_summary"].fillna({"model": ""})
    summary = summary.set_index(["model", "statistic"]).sort_index()
    models = set(summary.index.unique("model")) & {BARE, INTERLAYER}
    if not models:
        return [
            *load,
            "Nothing is compared with wear: no loss of a patch could be predicted from those of "
            "the others.",
        ]
    own = own_model(list(models))
    law = "Archard's law"
    if poses is not None:
        law += f" over a gesture of {poses} poses"
    if own == INTERLAYER and interlayer is not None:
        young, thick = interlayer["young_MPa"], interlayer["thickness_um"]
        law += f" with an interlayer of {young:g} MPa, {thick:g} µm thick,"
    scored = [_where(summary, own, law), _how_much(summary, own, pressure_cap)]
    if own == INTERLAYER:
        scored.append(_without_interlayer(summary))
    untouched = _untouched(summary, pressures, tables["registration"])
    chance = _against_chance(summary, own, tables["validation_patches"])
    return [sentence for sentence in (*scored, untouched, chance, *load) if sentence]


def used(use: pd.DataFrame) -> str:
    """How the tool was used, as its wear says, and how sure that is."""
    known, answer = use.set_index("parameter"), use.answer.iloc[0]
    if not use.effective_draws.iloc[0] > 0:
        return "How the tool was used cannot be read from its wear: too few patches wore."
    said = [
        f"{axis} {known['mean'][name]:.1f} mm ({known.low[name]:.1f} to {known.high[name]:.1f})"
        for axis, name in (("x", "load_point_x"), ("y", "load_point_y"))
    ]
    told = [f"{known.stated[name]:.3g}" for name in ("load_point_x", "load_point_y")]
    found = f"pressed at {' and '.join(said)}"
    stated = f"x {told[0]} and y {told[1]} mm"
    if "radius" in known.index:
        row = known.loc["radius"]
        found += (
            f" against a tool of {row['mean']:.0f} mm radius ({row.low:.0f} to {row.high:.0f})"
        )
        stated += f" and {row.stated:.0f} mm"
    if answer == CHANCE:
        return (
            "How the tool was used cannot be read from its wear: no use explains the wear better "
            f"than the same wear exchanged among the patches (p = {known['mean']['p_value']:.2g}). "
            "The study goes on as stated."
        )
    if answer == BETTER:
        start = f"The wear says that the tool was {found}; stated were {stated}."
        return f"{start} A use explains the wear better than heights alone do."
    taken = "takes it" if use.taken.iloc[0] else "goes on as stated"
    return (
        f"The wear is consistent with a tool that was {found}; stated were {stated}. Heights alone "
        f"may explain the wear as well, so that it need not have been so; the study {taken}."
    )


def sign_of(row: Any) -> int:
    """Whether an estimate is above 0 (1) or below it (-1); 0 where neither shows.

    `row` has ``low, high, p_value``. The difference must show in both the interval and the test.
    """
    return (int(row.low > 0) - int(row.high < 0)) * int(row.p_value <= LEVEL)


def _load(
    pressures: pd.DataFrame, intervals: pd.DataFrame, force_N: float, second: bool
) -> str:
    """Which patches carry the load, and how well the highest pressure is known."""
    total, count = float(pressures["force_N"].sum()), len(pressures)
    against = " against the active tool" * second
    if not total > 0:
        none = f"Under {force_N:g} N{against}, no scanned patch touches"
        may = intervals.loc[intervals["high_MPa"].fillna(0).idxmax()]
        if not may.high_MPa > 0:
            return f"{none}."
        return (
            f"{none}; within the 95 % intervals, patch {may.patch} may bear the most, up to "
            f"{_two_digits(may.high_MPa)} MPa."
        )
    highest = pressures.loc[pressures["pressure_MPa"].idxmax()]
    known = intervals.set_index("patch").loc[highest["patch"]]
    pressure = _two_digits(known.pressure_MPa)
    top = f"patch {highest['patch']} bears the highest pressure, {pressure} MPa"
    if pd.notna(known.low_MPa):
        top += f" (95 % interval {_two_digits(known.low_MPa)} to {_two_digits(known.high_MPa)})"
    if count == 1:
        return f"P{top[1:]}."
    ordered = pressures.sort_values("force_N", ascending=False, kind="stable")
    shares = ordered["force_N"].cumsum() / total
    *others, last = list(ordered["patch"])[: int((shares <= 0.5).sum()) + 1]
    who = f"Patches {', '.join(others)} and {last} carry" if others else f"Patch {last} carries"
    if len(others) >= _MOST_NAMED:
        who = f"The load is spread: {len(others) + 1} patches carry"
    share = f"{100 * shares.iloc[len(others)]:.0f} % of the load on the {count} patches"
    share += f", which bear {100 * total / force_N:.0f} % of the force{against}"
    return f"{who} {share}; {top}."


def _exposed(exposure: pd.DataFrame, poses: int) -> str:
    """Which patch a gesture wears most, by pressure and sliding alone."""
    first = exposure.loc[exposure["exposure_N_per_mm"].idxmax()]
    if not first.exposure_N_per_mm > 0:
        return f"None of the {poses} poses of the gesture touches a patch."
    return (
        f"Over the {poses} poses of the gesture, patch {first.patch} is exposed most; "
        f"{100 * first.touched:.0f} % of them touch it."
    )


def where_to_scan(places: pd.DataFrame, held: Concentration, *, force_N: float) -> list[str]:
    """Where pressure and exposure concentrate, and which places to scan, in sentences.

    Parameters
    ----------
    places : pandas.DataFrame
        ``places.csv``.
    held : Concentration
        Its own.
    force_N : float
        The whole load.
    """
    exposed, controls = (places[places.kind == kind] for kind in (EXPOSED, CONTROL))
    spread = (
        f"Under {force_N:g} N, wherever the hand pushes, {100 * held.in_square:.0f} % of the "
        f"exposure lies in the square, half of it on {_two_digits(100 * held.half_area)} % of its "
        "area."
    )
    if exposed.empty:
        return ["No pose touches the square, so there is nothing to scan in it."]
    first = exposed.iloc[0]
    scan = (
        f"Scan {_from_to(exposed)}: of the square's exposure, {100 * held.in_places:.0f} % lies "
        f"there, on {100 * held.places_area:.0f} % of its area; most in {first.place}, "
        f"{first.x_mm:g} mm along x and {first.y_mm:g} mm along y from the reference corner."
    )
    if controls.empty:
        return [scan, "No place is free of contact, so there is no control.", spread]
    return [scan, f"No pose touches {_from_to(controls)}: scan them as controls.", spread]


def _from_to(places: pd.DataFrame) -> str:
    first, last = places.place.iloc[0], places.place.iloc[-1]
    return first if len(places) == 1 else f"{first} to {last}"


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


def _where(summary: pd.DataFrame, own: str, law: str) -> str:
    """Was the place of the loss predicted, and better than by the best baseline?"""
    mean, gain = (summary.loc[(own, f"{name}(mcc)")] for name in ("mean", "gain"))
    if not mean.n:
        return (
            f"{law} predicts a loss, but no patch in the study lost enough to be compared with."
        )
    baseline = summary.value[gain.against, "mean(mcc)"]
    interval = ""
    if math.isfinite(mean.low):
        interval = f"; 95 % interval {mean.low:.2f} to {mean.high:.2f}"
    compared = {1: "better than", -1: "worse than", 0: "not shown to be better or worse than"}[
        sign_of(gain)
    ]
    patches = "1 patch" if mean.n == 1 else f"{mean.n} patches"
    sentence = (
        f"From the wear of the other patches, {law} predicts where each patch lost height with a "
        f"mean MCC of {mean.value:.2f} (0 is chance, 1 perfect{interval}) "
        f"over {patches}: {compared} the best baseline that is given the same data, "
        f"{MODELS[gain.against]} ({baseline:.2f}, {_p(gain)})."
    )
    return sentence.replace("-", "−")


def _how_much(summary: pd.DataFrame, own: str, pressure_cap: float | None) -> str:
    """What masks of its areas could reach, errors of map and volume, and all if stone yields."""
    depth, volume = (summary.loc[(own, f"relative({of}_error)")] for of in ("map", "volume"))
    if not (math.isfinite(depth.value) and math.isfinite(volume.value)):
        return ""
    reached = summary.value[own, "mean(attainable_mcc)"]
    sentence = (
        f"Masks of the predicted areas could reach {reached:.2f}. "
        f"Its maps err {_two_digits(depth.value)} times as much as no loss would ({_p(depth)}), "
        f"its volumes {_two_digits(volume.value)} times as much as the best baseline's "
        f"({_p(volume)})."
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
        f"times as much as those of the bare stone ({_p(out)})."
    )


def _untouched(
    summary: pd.DataFrame, pressures: pd.DataFrame, registration: pd.DataFrame
) -> str:
    """Do patches that nothing touches wear less than those that are touched?"""
    known = pressures[["patch", "pressure_MPa"]].merge(registration, on="patch")
    known = known[known.above_noise.astype(bool)].dropna(subset="mean_wear_depth_um")
    is_touched = known.pressure_MPa > 0
    untouched, touched = (
        known.mean_wear_depth_um[is_touched == side] for side in (False, True)
    )
    if untouched.empty or touched.empty:
        return ""
    row = summary.loc[("", TOUCHED)]
    said = {
        1: "untouched patches wear less",
        -1: "untouched patches wear more",
        0: "this does not show that untouched patches wear less",
    }[sign_of(row)]
    who = "patch" if len(untouched) == 1 else f"{len(untouched)} patches"
    means = [_two_digits(losses.mean()) for losses in (untouched, touched)]
    return (
        f"The {who} that nothing touches lost {means[0]} µm on average, the "
        f"{len(touched)} touched {means[1]} µm: {said} ({_p(row)})."
    )


def _against_chance(summary: pd.DataFrame, own: str, patches: pd.DataFrame) -> str:
    """On how many of the counted patches the places of the loss are better than chance."""
    p_values = patches.p_value[patches.in_statistics.astype(bool)]
    tested, untested = int(p_values.notna().sum()), int(p_values.isna().sum())
    if not tested:
        return "No patch can be tested against chance."
    better = int((p_values <= LEVEL).sum())
    together = ""
    if tested > 1:
        together = f"; together {_p(summary.loc[(own, 'tested_mean(mcc)')])}"
    sentence = (
        f"On {better} of the {tested} patches that can be tested, the places are predicted better "
        f"than by chance (p ≤ {LEVEL}{together})"
    )
    return sentence + (f"; {untested} cannot be tested." if untested else ".")


def _p(row: Any) -> str:
    return f"p = {row.p_value:.2g}" if math.isfinite(row.p_value) else "not tested"
