"""Wear fitted to the losses of the patches, and the loss of each from those of the others."""

import logging
from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem import Layer
from gstlib.contact import Contact
from gstlib.errors import InputError
from gstlib.macroscale.gesture import Gesture
from gstlib.wear.archard import (
    BARE,
    MAT,
    YIELDING,
    WornSquare,
    wear_elastic_and_yielding,
    wear_patch,
    wear_square,
)

__all__ = ["wear_map", "wear_stone"]

_log = logging.getLogger(__name__)


def wear_stone(
    contact: Contact,
    pressures: pd.DataFrame,
    registration: pd.DataFrame,
    *,
    patch_mm: float,
    steps: int,
    mat: Mapping[str, float] | None = None,
    gesture: Gesture | None = None,
) -> WornSquare | None:
    """Wear the face by Archard's law, and fit its coefficient to the measured losses.

    `contact` is the face's at the target load; `pressures` and `registration` are the tables
    ``patch_pressures`` and ``registration``: the believed losses of patches in the study count;
    `mat` is that section of the config. Other parameters and the result are those of
    `gstlib.wear.archard.wear_square`; None, with a warning, where there is no fit.
    """
    layer = Layer(mat["young_MPa"], mat["poisson"], mat["thickness_um"] * 1e-3) if mat else None
    known = pressures.merge(registration, on="patch").set_index("patch")
    known = known[known.believed.astype(bool) & known.in_study.astype(bool)]
    known = known.dropna(subset="loss_per_area_um")
    if ((known.loss_per_area_um > 0) & (known.pressure_MPa > 0)).sum() < 2:
        _log.warning(
            "wear is not predicted: fewer than two patches under load lost height, so that its "
            "coefficient cannot be fitted to some and tested on others"
        )
        return None
    try:
        return wear_square(
            contact,
            pressures,
            known.loss_per_area_um.to_dict(),
            patch_mm=patch_mm,
            steps=steps,
            mat=layer,
            gesture=gesture,
        )
    except InputError as error:
        _log.warning("wear is not predicted: %s", error.problem)
        return None


def wear_map(
    contact: Contact,
    worn: WornSquare,
    fitted: xr.Dataset | None,
    patch: str,
    *,
    hardness_MPa: float | None = None,
) -> xr.Dataset:
    """Loss of a patch, as the other patches predict it.

    Parameters
    ----------
    contact : Contact
        The patch's contact before use.
    worn : WornSquare
    fitted : xarray.Dataset or None
        From `fit_mat`; None without a mat.
    patch : str
        Any patch of the square. The coefficient comes from all patches if it is none of those with
        a measured loss.
    hardness_MPa : float, optional
        As in `wear_patch`.

    Returns
    -------
    xarray.Dataset
        ``depth`` (model, y, x), mm, by ``archard``, the bare stone; where there is a mat, ``mat``;
        and with a hardness ``yielding``, the last of these where summits yield.
    """
    found: dict[str, dict[str, float]] = {BARE: {}}
    if fitted is not None:
        ratio, kappa = fitted.ratio_of_all, fitted.kappa_of_all
        if patch in fitted.patch:
            ratio, kappa = (
                fitted[name].sel(patch=patch) for name in ("mat_ratio", "mat_kappa")
            )
        found[MAT] = {"ratio": float(ratio), "kappa": float(kappa)}
    *others, last = found
    depth = {model: wear_patch(contact, worn, patch, **found[model]) for model in others}
    if hardness_MPa is None:
        depth[last] = wear_patch(contact, worn, patch, **found[last])
    else:
        depth[last], depth[YIELDING] = wear_elastic_and_yielding(
            contact, worn, patch, hardness_MPa=hardness_MPa, **found[last]
        )
    described = {"units": "mm", "long_name": "predicted height loss"}
    return xr.Dataset(
        {"depth": (("model", "y", "x"), np.stack([*depth.values()]), described)},
        coords={"model": list(depth), "y": contact.pressure.y, "x": contact.pressure.x},
    )
