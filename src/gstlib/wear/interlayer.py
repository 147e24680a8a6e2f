"""What takes turns with the bare stone: its wear coefficient, from the maps of loss."""

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
_RATIO = "1", "coefficient of the interlayer over that of the bare stone"
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
    """How a patch's wear compares with its measured loss, along each path of the square.

    Returns
    -------
    xarray.Dataset
        ``visible`` (reach, ratio, step): mean of the predicted depth above its median, mm;
        ``misfit`` (reach, ratio, step): sum over the points of (predicted − measured loss)², mm²;
        ``product`` (reach, ratio, step): that of the errors of a step and the next.
    """
    known = np.isfinite(change.change.values)
    lost = -change.change.values[known]
    path, steps = worn.path.sel(patch=patch), worn.path.sizes["step"] - 1
    shape = path.kappa.shape[:2]
    misfits = np.zeros((3, *shape, steps + 1))
    for row in np.ndindex(shape):
        at = path.isel(reach=row[0], ratio=row[1])
        total, options = driven(contact, worn, at, float(at.kappa[-1]))
        depths: np.ndarray | tuple = np.zeros((steps, *contact.pressure.shape))
        if total > 0:
            options["keep_depths"] = True
            depths = wear_contact(contact, f"patch {patch}", **options).depths
        before = -lost
        misfits[1, *row, 0] = before @ before
        for step, depth in enumerate(depths, start=1):
            seen = seen_depth(depth[known])
            error = seen - lost
            misfits[:, *row, step] = seen.clip(0).mean(), error @ error, 0
            misfits[2, *row, step - 1] = before @ error
            before = error
    dims = path.kappa.dims
    fields = {name: (dims, values) for name, values in zip(_MISFITS, misfits, strict=True)}
    return described(xr.Dataset(fields, {"reach": path.reach, "ratio": path.ratio}), _MISFITS)


def fit_interlayer(
    worn: WornSquare, contacts: Mapping[str, Contact], changes: Mapping[str, xr.Dataset]
) -> xr.Dataset:
    """Find the interlayer's coefficient, over the bare stone's, that fits the maps of loss best.

    At each ratio κ makes the predicted losses, as far as scans see them, equal in sum to the
    measured ones.

    Parameters
    ----------
    worn : WornSquare
        With an interlayer.
    contacts, changes : mapping
        Contact before use and height change of each patch that lost height, by patch; each is
        looked up once.

    Returns
    -------
    xarray.Dataset
        ``misfit`` (ratio, patch), mm²: of each patch where all are fitted; ``interlayer_ratio`` and
        ``interlayer_kappa`` (patch): fitted to all other patches; ``ratio_of_all`` and
        ``kappa_of_all``: to all.
    """
    by_patch = {
        patch: interlayer_misfits(contacts[patch], changes[patch], worn, patch)
        for patch in worn.fitted_to
    }
    misfits = xr.concat(by_patch.values(), pd.Index(by_patch, name="patch"))
    measured = worn.path.measured.sel(patch=list(by_patch)).values

    def misfit(of: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
        """κ (ratio,), and the misfits (ratio, patch), where the patches `of` are fitted."""
        kappas, errors = [], []
        for ratio in worn.path.ratio.values:
            where = {"ratio": ratio, "reach": reach}
            at, kappa = misfits.sel(where), worn.path.kappa.sel(where).values
            visible = at.visible[of].sum("patch")
            place = np.interp(measured[of].sum(), visible, np.arange(kappa.size))
            low = min(int(place), kappa.size - 2)
            part = place - low
            kappas.append(np.interp(place, np.arange(kappa.size), kappa))
            errors.append(
                (1 - part) ** 2 * at.misfit[:, low]
                + 2 * part * (1 - part) * at.product[:, low]
                + part**2 * at.misfit[:, low + 1]
            )
        return np.array(kappas), np.array(errors)

    every = np.arange(len(by_patch))
    kappas_of_all, all_misfits = misfit(every, float(worn.path.reach_of_all))
    ratios, kappas = [], []
    for own, patch in enumerate(by_patch):
        others = np.delete(every, own)
        kappa, errors = misfit(others, float(worn.path.reach_of.sel(patch=patch)))
        best = int(errors[:, others].sum(axis=1).argmin())
        ratios.append(float(worn.path.ratio[best]))
        kappas.append(kappa[best])
    best = int(all_misfits.sum(axis=1).argmin())
    fitted = xr.Dataset(
        {
            "misfit": (("ratio", "patch"), all_misfits),
            "interlayer_ratio": ("patch", ratios),
            "interlayer_kappa": ("patch", kappas),
            "ratio_of_all": float(worn.path.ratio[best]),
            "kappa_of_all": float(kappas_of_all[best]),
        },
        coords={"ratio": worn.path.ratio, "patch": list(by_patch)},
    )
    return described(fitted, _FITTED)
