"""The draws of the inferred load for the page, which shows the effect of a load elsewhere.

`page.js` takes the draws nearest to a point.
"""

import math
from collections.abc import Mapping
from typing import Any

from gst.page.load_points import adopted_use
from gst.page.results import Results
from gstlib.conditions import Law

# The most numbers of a kind: the page grows by less than 300 kB.
_MOST = 20_000
_DECIMALS = {"pressure": 2, "weight": 6}


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
