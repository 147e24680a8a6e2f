"""Wear fitted to the losses of the patches, and predictions of each loss from the others."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, Self

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem.layer import Layer
from gstlib.conditions import Law
from gstlib.contact import Contact
from gstlib.coupling.pressures import unseen
from gstlib.errors import InputError
from gstlib.surfaces.footprints import with_t1
from gstlib.wear.archard import (
    BARE,
    CAPPED,
    INTERLAYER,
    WornSquare,
    wear_patch,
    wear_square,
)
from gstlib.wear.interlayer import fit_interlayer

__all__ = ["Prediction", "fit_wear", "predict_wear", "wear_map"]

_log = logging.getLogger(__name__)


class Prediction(NamedTuple):
    """Predicted wear of the patches of a stone.

    Attributes
    ----------
    depths : mapping of str to xarray.Dataset
        From `predict_wear`, by patch; empty if no wear is predicted.
    fitted_to : sequence of str
        Patches whose measured losses it was fitted to.
    interlayer : xarray.Dataset or None
        From `gstlib.wear.interlayer.fit_interlayer`; None without an interlayer.
    """

    depths: Mapping[str, xr.Dataset]
    fitted_to: Sequence[str] = ()
    interlayer: xr.Dataset | None = None

    @classmethod
    def from_worn(
        cls, depths: Mapping[str, xr.Dataset], worn: WornSquare | None
    ) -> Self:
        """The depths, with their source from `fit_wear`."""
        if worn is None:
            return cls({})
        return cls(depths, worn.fitted_to, worn.interlayer)


def fit_wear(
    contact: Contact,
    pressures: pd.DataFrame,
    registration: pd.DataFrame,
    contacts: Mapping[str, Contact] | None = None,
    changes: Mapping[str, xr.Dataset] | None = None,
    *,
    interlayer: Mapping[str, float] | None = None,
    wear_law: Mapping[str, float] | None = None,
    **options: Any,
) -> WornSquare | None:
    """Wear the face by a law of wear, and fit its coefficient to the measured losses.

    Parameters
    ----------
    contact : Contact
        Contact of the face at the target load.
    pressures, registration : pandas.DataFrame
        The tables ``patch_pressures`` and ``registration``. Losses above the noise of patches in
        the study count.
    contacts, changes : mapping, optional
        Contact before use and height change of the patches with a T1; required with an interlayer.
    interlayer : mapping, optional
        This section of the config. Its coefficient is fitted, too.
    wear_law : mapping, optional
        The fields of `gstlib.conditions.Law`; by default, Archard's law.
    **options
        ``patch_mm, steps`` and ``gesture`` of `gstlib.wear.archard.wear_square`.

    Returns
    -------
    WornSquare or None
        None, with a warning, if the fit fails.

    Examples
    --------
    Two halves of a square of 1 mm. The coefficient (nm/MPa) of each is fitted to the other:

    >>> import numpy as np, pandas as pd
    >>> import gstlib
    >>> rough = 2e-3 * np.random.default_rng(0).standard_normal((20, 20))
    >>> face = gstlib.Interface.on_flat(gstlib.make_surface(rough, 0.05))
    >>> options = {"modulus": 1e4, "tolerance": 1e-6}
    >>> contact = gstlib.contact.contact_at_pressure(face, gstlib.Load(20.0), **options)
    >>> table = pd.DataFrame({"patch": ["a", "b"], "x_mm": [0.25, 0.75], "y_mm": 0.5})
    >>> pressures = table.assign(rotation_deg=0.0, pressure_MPa=20.0, in_study=True)
    >>> losses = table[["patch"]].assign(above_noise=True, mean_wear_depth_um=[0.2, 0.1])
    >>> worn = gstlib.fit_wear(contact, pressures, losses, patch_mm=0.5, steps=2)
    >>> (1e6 * worn.path.fitted).values.round(1)
    array([ 4.3, 13.6])
    """
    patches = pressures.assign(unseen_MPa=unseen(pressures))
    patches = patches.merge(registration, on="patch").set_index("patch")
    patches = patches[patches.above_noise.astype(bool) & patches.in_study.astype(bool)]
    losses = patches.mean_wear_depth_um.dropna()
    law = Law(**(wear_law or {}))
    wears = (losses > 0) & (law.rate(patches.unseen_MPa[losses.index]) > 0)
    if wears.sum() < 2:
        above = f" of more than {law.threshold_MPa:g} MPa" * (law.threshold_MPa > 0)
        _log.warning(
            "wear is not predicted: fewer than two patches in the study lost height under load%s, "
            "so its coefficient cannot be fitted and tested",
            above,
        )
        return None
    layer = None
    if interlayer:
        thickness_mm = interlayer["thickness_um"] * 1e-3
        layer = Layer(interlayer["young_MPa"], interlayer["poisson"], thickness_mm)
    try:
        worn = wear_square(
            contact,
            with_t1(pressures, registration),
            losses.to_dict(),
            interlayer=layer,
            law=law,
            **options,
        )
    except InputError as error:
        _log.warning("wear is not predicted: %s", error.problem)
        return None
    if worn.interlayer is None or contacts is None or changes is None:
        return worn._replace(interlayer=None)
    fitted = fit_interlayer(worn, contacts, changes)
    return worn._replace(interlayer=fitted.assign(worn.interlayer.data_vars))


def predict_wear(
    contacts: Mapping[str, Contact],
    worn: WornSquare | None,
    *,
    pressure_cap: float | None = None,
) -> Iterator[tuple[str, xr.Dataset]]:
    """The `wear_map` of each patch, in turn; none if no wear is predicted.

    `contacts` are contacts of the patches before use, each looked up once. `worn` is from
    `fit_wear`.

    Examples
    --------
    The loss of a patch of 1 mm (nm), fitted to the loss of another one:

    >>> import numpy as np, pandas as pd
    >>> import gstlib
    >>> rough = 2e-3 * np.random.default_rng(0).standard_normal((20, 20))
    >>> face = gstlib.Interface.on_flat(gstlib.make_surface(rough, 0.05))
    >>> options = {"modulus": 1e4, "tolerance": 1e-6}
    >>> contact = gstlib.contact.contact_at_pressure(face, gstlib.Load(20.0), **options)
    >>> table = pd.DataFrame({"patch": ["a", "b"], "x_mm": [0.25, 0.75], "y_mm": 0.5})
    >>> pressures = table.assign(rotation_deg=0.0, pressure_MPa=20.0, in_study=True)
    >>> losses = table[["patch"]].assign(above_noise=True, mean_wear_depth_um=[0.2, 0.1])
    >>> worn = gstlib.fit_wear(contact, pressures, losses, patch_mm=0.5, steps=2)
    >>> maps = dict(gstlib.predict_wear({"a": contact}, worn))
    >>> round(1e6 * float(maps["a"].depth.mean()))
    58
    """
    if worn is not None:
        for patch, contact in contacts.items():
            yield patch, wear_map(contact, worn, patch, pressure_cap=pressure_cap)


def wear_map(
    contact: Contact, worn: WornSquare, patch: str, *, pressure_cap: float | None = None
) -> xr.Dataset:
    """Loss of a patch, as predicted from the other patches.

    Parameters
    ----------
    contact : Contact
        The patch's contact before use.
    worn : WornSquare
        From `fit_wear`.
    patch : str
        Any patch of the square. The coefficient comes from all patches if this patch has no
        measured loss.
    pressure_cap : float, optional
        As in `wear_patch`.

    Returns
    -------
    xarray.Dataset
        ``depth`` (model, y, x), mm, by ``archard``, the bare stone; with an interlayer, also by
        ``interlayer``; and with a cap, by ``archard_capped``, the last of these under the cap.
    """
    depth, coefficients = {}, {}
    if (fitted := worn.interlayer) is not None:
        names = "ratio_of_all", "kappa_of_all"
        if patch in fitted.patch:
            fitted = fitted.sel(patch=patch)
            names = "interlayer_ratio", "interlayer_kappa"
        ratio, kappa = (float(fitted[name]) for name in names)
        (depth[BARE],) = wear_patch(contact, worn, patch)
        coefficients = {"ratio": ratio, "kappa": kappa}
    maps = wear_patch(contact, worn, patch, pressure_cap=pressure_cap, **coefficients)
    model = INTERLAYER if coefficients else BARE
    depth |= zip((model, CAPPED), maps, strict=False)
    described = {"units": "mm", "long_name": "predicted height loss"}
    return xr.Dataset(
        {"depth": (("model", "y", "x"), np.stack([*depth.values()]), described)},
        coords={"model": list(depth), "y": contact.pressure.y, "x": contact.pressure.x},
    )
