"""Wear coefficient of an interlayer that alternates with the bare stone, from the maps of loss."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from gstlib.contact import Contact
from gstlib.surfaces.grid import described
from gstlib.wear.archard import WornSquare, driven, seen_depth, wear_contact

__all__ = ["fit_interlayer"]

_RATIO = "1", "ratio of the coefficients of interlayer and bare stone"
_FITTED = {
    "misfit": ("mm2", "sum of squared differences of loss"),
    "interlayer_ratio": _RATIO,
    "interlayer_kappa": ("mm/MPa", "κ of other patches, with the interlayer"),
    "ratio_of_all": _RATIO,
    "kappa_of_all": ("mm/MPa", "κ of all patches, with the interlayer"),
}


def _misfits(
    contact: Contact, change: xr.Dataset, worn: WornSquare, patch: str
) -> np.ndarray:
    """Compare the wear of a patch with its measured loss, along each path of the square.

    Returns
    -------
    ndarray, shape (3, reaches, ratios, steps + 1)
        The mean of the predicted depth above its median, mm; the sum over the points of (predicted
        − measured loss)², mm²; and the sum of products of the errors of a step and the next, mm².
    """
    is_measured = np.isfinite(change.change.values)
    lost = -change.change.values[is_measured]
    path = worn.path.sel(patch=patch)
    visible, misfit, product = misfits = np.zeros((3, *path.kappa.shape))
    for reach, ratio in np.ndindex(path.kappa.shape[:2]):
        at = path.isel(reach=reach, ratio=ratio)
        total, options = driven(contact, worn, at, float(at.kappa[-1]))
        depths: Any = np.zeros((options["steps"], *contact.pressure.shape))
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
    return misfits


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
    path = worn.path
    names = worn.fitted_to
    by_patch = [
        _misfits(contacts[patch], changes[patch], worn, patch) for patch in names
    ]
    misfits = np.stack(by_patch, axis=1)
    measured = path.measured.sel(patch=names).values

    def fit(patches: np.ndarray, reach: xr.DataArray) -> tuple:
        """Ratio, κ and the misfits (ratio, patch) of a fit to these patches."""
        (end,) = np.flatnonzero(path.reach == reach)
        kappas, errors = [], []
        for number, kappa in enumerate(path.kappa.values[end]):
            visible, misfit, product = misfits[:, :, end, number]
            steps = np.arange(kappa.size)
            place = np.interp(
                measured[patches].sum(), visible[patches].sum(axis=0), steps
            )
            low = min(int(place), kappa.size - 2)
            part = place - low
            kappas.append(np.interp(place, steps, kappa))
            errors.append(
                (1 - part) ** 2 * misfit[:, low]
                + 2 * part * (1 - part) * product[:, low]
                + part**2 * misfit[:, low + 1]
            )
        table = np.array(errors)
        best = int(table[:, patches].sum(axis=1).argmin())
        return float(path.ratio[best]), float(kappas[best]), table

    every = np.arange(len(names))
    ratio_of_all, kappa_of_all, all_misfits = fit(every, path.reach_of_all)
    reaches = path.reach_of.sel(patch=names)
    fits = [fit(np.delete(every, own), reach) for own, reach in enumerate(reaches)]
    ratios, kappas, _ = zip(*fits, strict=True)
    fitted = xr.Dataset(
        {
            "misfit": (("ratio", "patch"), all_misfits),
            "interlayer_ratio": ("patch", [*ratios]),
            "interlayer_kappa": ("patch", [*kappas]),
            "ratio_of_all": ratio_of_all,
            "kappa_of_all": kappa_of_all,
        },
        coords={"ratio": path.ratio, "patch": names},
    )
    return described(fitted, _FITTED)
