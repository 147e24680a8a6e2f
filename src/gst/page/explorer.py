"""The draws of the inferred load for the page, which shows the effect of a load elsewhere.

`page.js` takes the draws nearest to a point. `gst.page.viewer.packed` writes its numbers.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from gst.page.load_points import adopted_use
from gst.page.results import Results
from gst.page.viewer import packed
from gstlib.conditions import Law

__all__ = ["draws_to_explore"]

# The most letters of base64 in the page, and the fewest draws that are useful.
_MOST, _FEWEST = 280_000, 100
_LEVELS = 2**16 - 1  # of a number in two bytes


def draws_to_explore(
    study: Results, wear_law: Mapping[str, float] | None
) -> dict[str, Any] | None:
    """Load points, weights, and the effect of each load on the patches; None without a use.

    Every nth draw is taken, so that the page grows by less than 300 kB.

    Parameters
    ----------
    study : Results
        With ``use`` and, if losses were measured, ``predicted_losses.csv``; otherwise its places
        have a ``wear_grade``.
    wear_law : mapping, optional
        The fields of `gstlib.conditions.Law`.

    Returns
    -------
    dict or None
        ``patches``; ``measured``, their losses (µm) or grades; ``near_mm``, half the side of a
        patch; ``x_mm, y_mm, weight`` (float32); ``pressure`` (MPa) and, with losses, ``loss`` (µm),
        draw by draw: ``values`` (uint16) as shares of ``most``.
    """
    if (use := adopted_use(study)) is None:
        return None
    patches = [str(patch) for patch in use.patch.values]
    count = min(use.sizes["draw"], _MOST * 3 // 4 // (12 + 4 * len(patches)))
    if count < _FEWEST:
        return None
    use = use.isel(draw=np.linspace(0, use.sizes["draw"] - 1, count).astype(int))
    fields = {"pressure": use.pressure.transpose("draw", "patch").values}
    measured = pd.DataFrame(study.places).set_index("patch").get("wear_grade")
    if "wear_coefficient" in use:
        equivalent = Law(**(wear_law or {})).equivalent(fields["pressure"])
        fields["loss"] = use.wear_coefficient.values[:, np.newaxis] * equivalent
        measured = study.table("predicted_losses.csv").set_index("patch").loss_um
    draws: dict[str, Any] = {
        name: packed(use[name].values, "<f4") for name in ("x_mm", "y_mm", "weight")
    }
    for name, values in fields.items():
        most = float(values.max()) or 1.0
        shares = np.round(values / most * _LEVELS).clip(0, _LEVELS)
        draws[name] = {"most": most, "values": packed(shares, "<u2")}
    seen = [float(measured[patch]) for patch in patches]
    return draws | {"patches": patches, "measured": seen, "near_mm": study.patch_mm / 2}
