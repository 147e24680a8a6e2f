"""The load points for the map: given, inferred from the wear, and true; the truth that is met.

The truth is known only for a synthetic specimen.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from gst.page.results import Results

_CERTAINTY = 0.95  # weight of the draws that the region contains


def adopted_use(study: Results) -> xr.Dataset | None:
    """The draws of the use, if the study has inferred one and adopts it."""
    if not study.has("use"):
        return None
    use = study.data("use")
    return use if use.attrs["adopted"] else None


def load_points(study: Results, given: Sequence[float] | None) -> dict[str, Any]:
    """The load points (x, y), mm, by their kinds, and the region of the inferred one.

    Parameters
    ----------
    study : Results
        With ``use`` and ``truth.csv`` if there are.
    given : (float, float) or None
        ``y, x`` from the config; None if the stone does not tilt under the load.

    Returns
    -------
    dict
        ``points``: the known ones among ``inferred``, ``given`` and ``true``; ``region``: half axes
        (mm) and rotation (degrees) of the ellipse that contains 95 % of the draws by weight, or
        None; ``held``: for each point whether it lies in the region.
    """
    points = {}
    if given is not None:
        points["given"] = [given[1], given[0]]
    if "truth" in study.tables:
        truth = study.table("truth")
        true = truth[truth.stage == "use"].set_index("quantity").true
        if "load_point_x" in true:
            points["true"] = [float(true.load_point_x), float(true.load_point_y)]
    if (use := adopted_use(study)) is None:
        return {"points": points, "region": None, "held": {}}
    draws, weight = np.stack([use.x_mm, use.y_mm]), use.weight.values
    middle = draws @ weight
    spread = np.cov(draws, aweights=weight)
    off = np.array([*draws.T, *points.values()]) - middle
    away = np.sum(off @ np.linalg.pinv(spread) * off, axis=1)
    of_draws, of_points = np.split(away, [len(weight)])
    reach = np.quantile(of_draws, _CERTAINTY, weights=weight, method="inverted_cdf")
    (short, long), axes = np.linalg.eigh(spread)
    turn = np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))
    half = np.sqrt(reach * np.array([long, short]))
    return {
        "points": {"inferred": middle.tolist(), **points},
        "region": [*half.tolist(), float(turn)],
        "held": dict(zip(points, (of_points <= reach).tolist(), strict=True)),
    }


def truth_met(study: Results, held: Mapping[str, bool]) -> dict[str, tuple[int, int]]:
    """The number of true values of each kind inside their 95 % intervals, and the number of all.

    `held` is from `load_points`. The result is empty for a measured tool.
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
    pressures = truth[truth.index == "pressure"].merge(limits, on="patch")
    if pressures.empty:  # without a reference contact, no true pressure is known
        return met
    are_met = pressures.true.between(pressures.low_MPa, pressures.high_MPa)
    met["pressure"] = int(are_met.sum()), len(pressures)
    return met
