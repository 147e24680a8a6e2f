"""The load points for the map: given, inferred from the wear, and true.

The true load point is known only for a synthetic specimen.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from gst.page.results import Results

__all__ = ["adopted_use", "load_points"]

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
    if study.has("truth.csv"):
        truth = study.table("truth.csv", "stage").set_index(["stage", "quantity"]).true
        if ("use", "load_point_x") in truth:
            names = ("load_point_x", "load_point_y")
            points["true"] = [float(truth["use", name]) for name in names]
    if (use := adopted_use(study)) is None:
        return {"points": points, "region": None, "held": {}}
    draws, weight = np.stack([use.x_mm, use.y_mm]), use.weight.values
    middle = draws @ weight
    spread = np.cov(draws, aweights=weight)

    def away(point: np.ndarray) -> np.ndarray:
        off = point - middle
        return np.einsum("...i,ij,...j", off, np.linalg.pinv(spread), off)

    reach = np.quantile(
        away(draws.T), _CERTAINTY, weights=weight, method="inverted_cdf"
    )
    (short, long), axes = np.linalg.eigh(spread)
    held = {name: bool(away(np.array(at)) <= reach) for name, at in points.items()}
    turn = np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))
    half = np.sqrt(reach * np.array([long, short]))
    region = [*half.tolist(), float(turn)]
    points = {"inferred": middle.tolist(), **points}
    return {"points": points, "region": region, "held": held}
