"""Wear coefficient of an interlayer that alternates with the bare stone, from the maps of loss."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.contact import Contact
from gstlib.surfaces.grid import described
from gstlib.wear.archard import WornSquare, driven, seen_depth, wear_contact

__all__ = ["fit_interlayer", "interlayer_misfits"]

_MISFITS = {
    "visible": ("mm", "mean predicted depth above its median"),
    "misfit": ("mm2", "sum of squared differences of loss"),
    "product": ("mm2", "sum of products of these differences in two steps"),
}
_RATIO = "1", "ratio of the coefficients of interlayer and bare stone"
_FITTED = {
    "misfit": _MISFITS["misfit"],
    "interlayer_ratio": _RATIO,
    "interlayer_kappa": ("mm/MPa", "κ of other patches, with the interlayer"),
    "ratio_of_all": _RATIO,
    "kappa_of_all": ("mm/MPa", "κ of all patches, with the interlayer"),
}


def interlayer_misfits(
    contact: Contact, change: xr.Dataset, worn: WornSquare, patch: str
) -> xr.Dataset:
    """Compare the wear of a patch with its measured loss, along each path of the square.

    Returns
    -------
    xarray.Dataset
        ``visible`` (reach, ratio, step): mean of the predicted depth above its median, mm;
        ``misfit`` (reach, ratio, step): sum over the points of (predicted − measured loss)², mm²;
        ``product`` (reach, ratio, step): sum of products of the errors of a step and the next, mm².
    """
    is_measured = np.isfinite(change.change.values)
    lost = -change.change.values[is_measured]
    path = worn.path.sel(patch=patch)
    steps = path.sizes["step"] - 1
    visible, misfit, product = misfits = np.zeros((3, *path.kappa.shape))
    for reach, ratio in np.ndindex(path.kappa.shape[:2]):
        at = path.isel(reach=reach, ratio=ratio)
        total, options = driven(contact, worn, at, float(at.kappa[-1]))
        depths: np.ndarray | tuple = np.zeros((steps, *contact.pressure.shape))
        if total > 0:
            options["keep_depths"] = True
            depths = wear_contact(contact, f"patch {patch}", **options).depths
        before = -lost
        misfit[reach, ratio, 0] = before @ before
        for step, depth in enumerate(depths, start=1):
            seen = seen_depth(depth[is_measured])
            error = seen - lost
            visible[reach, ratio, step] = seen.clip(0).mean()
            misfit[reach, ratio, step] = error @ error
            product[reach, ratio, step - 1] = before @ error
            before = error
    dims = path.kappa.dims
    fields = {
        name: (dims, values) for name, values in zip(_MISFITS, misfits, strict=True)
    }
    return described(
        xr.Dataset(fields, {"reach": path.reach, "ratio": path.ratio}), _MISFITS
    )


def fit_interlayer(
    worn: WornSquare, contacts: Mapping[str, Contact], changes: Mapping[str, xr.Dataset]
) -> xr.Dataset:
    """Fit the interlayer's coefficient, relative to the bare stone's, to the maps of loss.

    At each ratio, κ makes the sum of the predicted visible losses equal to the sum of the measured
    losses.

    Parameters
    ----------
    worn : WornSquare
        Wear of the square with an interlayer.
    contacts, changes : mapping
        Contact before use and height change of each patch that lost height, by patch; each is
        looked up once.

    Returns
    -------
    xarray.Dataset
        ``misfit`` (ratio, patch), mm²: misfit of each patch if all are fitted; ``interlayer_ratio``
        and ``interlayer_kappa`` (patch): fitted to all other patches; ``ratio_of_all`` and
        ``kappa_of_all``: fitted to all patches.
    """
    names = worn.fitted_to
    by_patch = [
        interlayer_misfits(contacts[patch], changes[patch], worn, patch)
        for patch in names
    ]
    misfits = xr.concat(by_patch, pd.Index(names, name="patch"))
    measured = worn.path.measured.sel(patch=names).values

    def fit(patches: np.ndarray, reach: float) -> tuple[float, float, np.ndarray]:
        """Ratio, κ and the misfits (ratio, patch) of a fit to these patches."""
        kappas, errors = [], []
        for ratio in worn.path.ratio.values:
            where = {"ratio": ratio, "reach": reach}
            at = misfits.sel(where)
            kappa = worn.path.kappa.sel(where).values
            steps = np.arange(kappa.size)
            visible = at.visible[patches].sum("patch")
            place = np.interp(measured[patches].sum(), visible, steps)
            low = min(int(place), kappa.size - 2)
            part = place - low
            kappas.append(np.interp(place, steps, kappa))
            errors.append(
                (1 - part) ** 2 * at.misfit[:, low]
                + 2 * part * (1 - part) * at.product[:, low]
                + part**2 * at.misfit[:, low + 1]
            )
        table = np.array(errors)
        best = int(table[:, patches].sum(axis=1).argmin())
        return float(worn.path.ratio[best]), float(kappas[best]), table

    every = np.arange(len(names))
    ratio_of_all, kappa_of_all, all_misfits = fit(every, float(worn.path.reach_of_all))
    ratios, kappas = [], []
    for own, patch in enumerate(names):
        reach = float(worn.path.reach_of.sel(patch=patch))
        ratio, kappa, _ = fit(np.delete(every, own), reach)
        ratios.append(ratio)
        kappas.append(kappa)
    fitted = xr.Dataset(
        {
            "misfit": (("ratio", "patch"), all_misfits),
            "interlayer_ratio": ("patch", ratios),
            "interlayer_kappa": ("patch", kappas),
            "ratio_of_all": ratio_of_all,
            "kappa_of_all": kappa_of_all,
        },
        coords={"ratio": worn.path.ratio, "patch": names},
    )
    return described(fitted, _FITTED)
