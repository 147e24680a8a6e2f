"""The number of true values of a synthetic specimen inside the intervals of its study."""

from collections.abc import Mapping

import pandas as pd

from gst.page.results import Results

__all__ = ["truth_met"]


def truth_met(study: Results, held: Mapping[str, bool]) -> dict[str, tuple[int, int]]:
    """The number of true values of each kind inside their 95 % intervals, and the number of all.

    `held` is from `gst.page.load_points.load_points`. The result is empty for a measured tool.
    """
    if not study.has("truth.csv"):
        return {}
    true = study.table("truth.csv", "patch")
    limits = study.table("patch_intervals.csv", "patch").assign(quantity="pressure")
    limits = limits.rename(columns={"low_MPa": "low", "high_MPa": "high"})
    if study.has("use.csv"):
        use = study.table("use.csv").rename(columns={"parameter": "quantity"})
        radius = use[use.quantity == "radius"].dropna(subset="low")
        limits = pd.concat([limits, radius])
    both = true[true.quantity.isin(["radius", "pressure"])].merge(
        limits, on=["quantity", "patch"]
    )
    is_met = both.true.between(both.low, both.high)
    met = {"load point": (int(held["true"]), 1)} if "true" in held else {}
    for name, values in is_met.groupby(both.quantity, sort=False):
        met[str(name)] = int(values.sum()), len(values)
    return met
