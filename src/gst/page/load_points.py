"""The load for the page: its points on the map, the truth that is met, and the draws to explore.

Load points are given, inferred from the wear, and true; the truth is known only for a synthetic
specimen. From the draws, `page.js` shows the effect of a load elsewhere: it takes the draws nearest
to a point.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gst.page.results import Results
from gstlib.conditions import Law

_CERTAINTY = 0.95  # weight of the draws that the region contains
# The most numbers of a kind to explore: the page grows by less than 300 kB.
_MOST = 20_000
_DECIMALS = {"pressure": 2, "weight": 6}


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
        truth = study.table("truth").query("stage == 'use'").set_index("quantity").true
        if "load_point_x" in truth:
            points["true"] = [float(truth.load_point_x), float(truth.load_point_y)]
    if (use := adopted_use(study)) is None:
        return {"points": points, "region": None, "held": {}}
    draws = np.stack([use.x_mm, use.y_mm], axis=1)
    middle = use.weight.values @ draws
    spread = np.cov(draws.T, aweights=use.weight)

    def distances(places: Any) -> np.ndarray:
        """Squared distances from the middle, in units of the spread."""
        off = np.reshape(places, (-1, 2)) - middle
        return np.sum(off @ np.linalg.pinv(spread) * off, axis=1)

    reach = np.quantile(
        distances(draws), _CERTAINTY, weights=use.weight, method="inverted_cdf"
    )
    variances, axes = np.linalg.eigh(spread)
    x, y = axes[:, 1]  # of the longer one
    is_held = distances([*points.values()]) <= reach
    return {
        "points": {"inferred": middle.tolist(), **points},
        "region": [
            *np.sqrt(reach * variances[::-1]).tolist(),
            float(np.degrees(np.arctan2(y, x))),
        ],
        "held": dict(zip(points, is_held.tolist(), strict=True)),
    }


def truth_met(study: Results, held: Mapping[str, bool]) -> dict[str, tuple[int, int]]:
    """The number of true values of each kind inside their 95 % intervals, and the number of all.

    `held` is from `load_points`. The result is empty for a measured tool.
    """
    if "truth" not in study.tables:
        return {}
    limits = study.table("patch_intervals").assign(quantity="pressure")
    limits = limits.rename(columns={"low_MPa": "low", "high_MPa": "high"})
    if "use" in study.tables:
        use = study.table("use").rename(columns={"parameter": "quantity"})
        radius = use[use.quantity == "radius"].dropna(subset="low")
        limits = pd.concat([radius, limits])
    known = limits.merge(study.table("truth"), on=["quantity", "patch"])
    is_met = known.true.between(known.low, known.high)
    counts = is_met.groupby(known.quantity, sort=False).agg(["sum", "count"])
    met = {str(name): (count, of) for name, count, of in counts.itertuples()}
    at_point = {"load point": (int(held["true"]), 1)} if "true" in held else {}
    return at_point | met


def draws_to_explore(
    study: Results, wear_law: Mapping[str, float]
) -> dict[str, Any] | None:
    """Load points, weights, and the effect of each load on the patches; None without a use.

    Parameters
    ----------
    study : Results
        With ``use`` and, if losses were measured, ``predicted_losses``; otherwise its places have a
        ``wear_grade``.
    wear_law : mapping
        The fields of `gstlib.conditions.Law`.

    Returns
    -------
    dict or None
        ``patches``; ``measured``, their losses (µm) or grades; ``near_mm``, half the side of a
        patch; of each nth draw ``x_mm, y_mm``, its relative ``weight`` and, by patch, ``pressure``
        (MPa) and, with losses, ``loss`` (µm).
    """
    if (use := adopted_use(study)) is None:
        return None
    step = math.ceil(use.pressure.size / _MOST)
    use = use.isel(draw=slice(None, None, step)).transpose("draw", ...)
    use["weight"] = use.weight / use.weight.max()
    shown = ["x_mm", "y_mm", "weight", "pressure"]
    measured = study.outlined.set_index("patch").get("wear_grade")
    if "wear_coefficient" in use:
        equivalent = Law(**wear_law).equivalent(use.pressure.values)
        use["loss"] = use.wear_coefficient * use.pressure.copy(data=equivalent)
        shown.append("loss")
        measured = study.table("predicted_losses").set_index("patch").loss_um
    patches = use.patch.values.tolist()
    return {
        "patches": patches,
        "measured": [float(measured[patch]) for patch in patches],
        "near_mm": study.patch_mm / 2,
        **{
            name: use[name].values.round(_DECIMALS.get(name, 3)).tolist()
            for name in shown
        },
    }
