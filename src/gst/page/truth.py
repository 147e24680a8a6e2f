"""The number of true values of a synthetic specimen inside the intervals of its study."""

from collections.abc import Mapping

from gst.page.results import Results

__all__ = ["truth_met"]


def truth_met(study: Results, held: Mapping[str, bool]) -> dict[str, tuple[int, int]]:
    """The number of true values of each kind inside their 95 % intervals, and the number of all.

    `held` is from `gst.page.load_points.load_points`. The result is empty for a measured tool.
    """
    if "truth" not in study.tables:
        return {}
    met = {"load point": (int(held["true"]), 1)} if "true" in held else {}
    truth = study.table("truth").set_index("quantity")
    if "use" in study.tables:
        use = study.table("use").set_index("parameter")
        if "radius" in use.low.dropna():
            is_met = use.low.radius <= truth.true.radius <= use.high.radius
            met["radius"] = int(is_met), 1
    limits = study.table("patch_intervals")
    pressures = truth.loc[["pressure"]].merge(limits, on="patch")
    are_met = pressures.true.between(pressures.low_MPa, pressures.high_MPa)
    met["pressure"] = int(are_met.sum()), len(pressures)
    return met
