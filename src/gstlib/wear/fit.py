"""Wear fitted to the losses of the patches, and the loss of each from those of the others."""

import logging
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem import Layer
from gstlib.contact import Contact
from gstlib.errors import InputError
from gstlib.macroscale.gesture import Gesture
from gstlib.wear.archard import (
    BARE,
    CAPPED,
    INTERLAYER,
    WornSquare,
    wear_elastic_and_capped,
    wear_patch,
    wear_square,
)

__all__ = ["Prediction", "wear_map", "wear_stone"]

_log = logging.getLogger(__name__)


class Prediction(NamedTuple):
    """What the wear of a stone predicts of its patches.

    Attributes
    ----------
    depths : mapping of str to xarray.Dataset
        From `wear_map`, by patch; there are none where no wear is predicted.
    fitted_to : sequence of str
        Patches whose measured losses it is fitted to.
    interlayer : xarray.Dataset or None
        From `gstlib.wear.interlayer.fit_interlayer`; None without an interlayer.
    """

    depths: Mapping[str, xr.Dataset]
    fitted_to: Sequence[str] = ()
    interlayer: xr.Dataset | None = None


def wear_stone(
    contact: Contact,
    pressures: pd.DataFrame,
    registration: pd.DataFrame,
    *,
    patch_mm: float,
    steps: int,
    interlayer: Mapping[str, float] | None = None,
    gesture: Gesture | None = None,
) -> WornSquare | None:
    """Wear the face by Archard's law, and fit its coefficient to the measured losses.

    `contact` is the face's at the target load; `pressures` and `registration` are the tables
    ``patch_pressures`` and ``registration``: the loss above the noise of patches in the study
    count; `interlayer` is that section of the config. Other parameters and the result are those
    of `gstlib.wear.archard.wear_square`; None, with a warning, where there is no fit.
    """
    layer = (
        Layer(interlayer["young_MPa"], interlayer["poisson"], interlayer["thickness_um"] * 1e-3)
        if interlayer
        else None
    )
    known = pressures.merge(registration, on="patch").set_index("patch")
    known = known[known.above_noise.astype(bool) & known.in_study.astype(bool)]
    known = known.dropna(subset="mean_wear_depth_um")
    if ((known.mean_wear_depth_um > 0) & (known.pressure_MPa > 0)).sum() < 2:
        _log.warning(
            "wear is not predicted: fewer than two patches under load lost height, so that its "
            "coefficient cannot be fitted to some and tested on others"
        )
        return None
    try:
        return wear_square(
            contact,
            pressures,
            known.mean_wear_depth_um.to_dict(),
            patch_mm=patch_mm,
            steps=steps,
            interlayer=layer,
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
    pressure_cap: float | None = None,
) -> xr.Dataset:
    """Loss of a patch, as the other patches predict it.

    Parameters
    ----------
    contact : Contact
        The patch's contact before use.
    worn : WornSquare
    fitted : xarray.Dataset or None
        From `fit_interlayer`; None without an interlayer.
    patch : str
        Any patch of the square. The coefficient comes from all patches if it is none of those with
        a measured loss.
    pressure_cap : float, optional
        As in `wear_patch`.

    Returns
    -------
    xarray.Dataset
        ``depth`` (model, y, x), mm, by ``archard``, the bare stone; where there is an interlayer,
        ``interlayer``; and with a hardness ``archard_capped``, the last of these where summits
        yield.
    """
    found: dict[str, dict[str, float]] = {BARE: {}}
    if fitted is not None:
        ratio, kappa = fitted.ratio_of_all, fitted.kappa_of_all
        if patch in fitted.patch:
            ratio, kappa = (
                fitted[name].sel(patch=patch)
                for name in ("interlayer_ratio", "interlayer_kappa")
            )
        found[INTERLAYER] = {"ratio": float(ratio), "kappa": float(kappa)}
    *others, last = found
    depth = {model: wear_patch(contact, worn, patch, **found[model]) for model in others}
    if pressure_cap is None:
        depth[last] = wear_patch(contact, worn, patch, **found[last])
    else:
        depth[last], depth[CAPPED] = wear_elastic_and_capped(
            contact, worn, patch, pressure_cap=pressure_cap, **found[last]
        )
    described = {"units": "mm", "long_name": "predicted height loss"}
    return xr.Dataset(
        {"depth": (("model", "y", "x"), np.stack([*depth.values()]), described)},
        coords={"model": list(depth), "y": contact.pressure.y, "x": contact.pressure.x},
    )
