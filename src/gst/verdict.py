"""The answer of a study in a few sentences, computed from its tables.

Which patches carry the load, whether predicted contact beats chance on them, and whether it
beats the best rival that needs no mechanics. No sentence claims more than its numbers allow.
"""

import math
from typing import Any

import pandas as pd

from gstlib.places import CONTROL, EXPOSED, Concentration

__all__ = ["LEVEL", "SCORE", "against_chance", "against_rival", "verdict", "where_to_scan"]

LEVEL = 0.05  # the usual one
SCORE = "mcc"  # a score of masks that a larger area does not raise
# A longer list of names does not help a reader.
_MOST_NAMED = 5
_RIVALS = {"highest": "the highest points", "rigid": "rigid interpenetration"}


def verdict(
    pressures: pd.DataFrame,
    intervals: pd.DataFrame,
    gains: pd.DataFrame | None = None,
    variants: pd.DataFrame | None = None,
    *,
    force_N: float,
) -> list[str]:
    """What the study found, in sentences: the load first, then the prediction against the wear.

    Parameters
    ----------
    pressures, intervals : pandas.DataFrame
        ``patch_pressures.csv`` and ``patch_intervals.csv``.
    gains, variants : pandas.DataFrame, optional
        ``validation_gains.csv`` and ``validation_variants.csv``, its first variant the study's own;
        None for a study without T1.
    force_N : float
        The whole load.
    """
    sentences = [_load(pressures, intervals, force_N)]
    if not pressures["in_study"].any():
        return [
            *sentences,
            "No patch is in the study: the table of pressures gives the reasons.",
        ]
    if gains is None or variants is None:
        compared = (
            "No patch has a scan after use (T1), so the prediction is not compared with wear."
        )
        return [*sentences, compared]
    if gains.empty:
        compared = (
            "No patch in the study has a usable scan after use (T1), so nothing is compared."
        )
        return [*sentences, compared]
    own = next(variants[variants["score"] == SCORE].itertuples(index=False))
    return [*sentences, against_chance(gains), against_rival(own)]


def _load(pressures: pd.DataFrame, intervals: pd.DataFrame, force_N: float) -> str:
    """Which patches carry the load, and how well the highest pressure is known."""
    total, count = float(pressures["force_N"].sum()), len(pressures)
    if not total > 0:
        return "Under this load, no scanned patch touches."
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
    share += f", which bear {100 * total / force_N:.0f} % of the force"
    return f"{who} {share}; {top}."


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
        return [spread, scan, "No place is free of contact, so there is no control."]
    return [spread, scan, f"No pose touches {_from_to(controls)}: scan them as controls."]


def _from_to(places: pd.DataFrame) -> str:
    first, last = places.place.iloc[0], places.place.iloc[-1]
    return first if len(places) == 1 else f"{first} to {last}"


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):g}"


def against_chance(gains: pd.DataFrame) -> str:
    """On how many patches contact beats chance at predicting loss (``validation_gains.csv``)."""
    p_values = gains.loc[gains["score"] == SCORE, "p_value"]
    tested, all_patches = int(p_values.notna().sum()), len(p_values)
    if not tested:
        return f"None of the {all_patches} patches compared with wear can be tested against chance."
    better = int((p_values <= LEVEL).sum())
    sentence = (
        f"On {better} of the {tested} patches that can be tested, contact predicts the loss better "
        f"than chance ({SCORE.upper()}, p ≤ {LEVEL})"
    )
    rest = all_patches - tested
    return sentence + (f"; {rest} cannot be tested." if rest else ".")


def against_rival(row: Any) -> str:
    """Whether contact predicts the loss better or worse than its best rival, or neither.

    `row` has the columns of ``validation_variants.csv``. A difference must show in both the
    interval and the test.
    """
    if math.isnan(row.contact):
        return f"Contact has no {SCORE.upper()} to compare with a rival's."
    rival = f"the best rival that needs no mechanics, {_RIVALS[row.best_rival]}"
    first, second = f"{row.contact:.2f}", f"{row.rival:.2f}"
    test = f", p = {row.p_value:.2g}" if math.isfinite(row.p_value) else ""
    patches = f"{row.n} patch{'es' * (row.n > 1)}"
    sign = (int(row.low > 0) - int(row.high < 0)) * int(row.p_value <= LEVEL)
    if sign > 0:
        said = f"Contact predicts the loss better than {rival}"
    elif sign < 0:
        said, first, second = f"T{rival[1:]}, predicts the loss better", second, first
    else:
        said = f"The data do not show whether contact or {rival}, predicts the loss better"
    numbers = f"mean {SCORE.upper()} {first} against {second} over {patches}{test}"
    return f"{said} ({numbers}).".replace("-", "−")
