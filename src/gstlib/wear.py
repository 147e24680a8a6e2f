"""How much wears: Archard's law on the square and on its patches, with one coefficient for a stone.

What a patch loses in a step of sliding is κ p: wear coefficient × sliding, κ, times its pressure.
The square wears as a whole, so pressures move from patch to patch as the hardest pressed sink
(`wear_square`); inside a patch, the summits wear first (`wear_patch`). The one unknown, κ, is
fitted to the measured loss. A prediction for a patch uses the κ of all the *other* patches.

Valleys wear too where something soft is between the stones: plants, hide, wood. A *mat*, an elastic
layer that takes turns with the bare stone, stands for it. How its coefficient compares with that of
the bare stone is fitted as κ is, to the maps of loss of the other patches (`fit_mat`).

`gstlib.validation.wear_scores` says how good the predictions are.
"""

# ASSUME: κ is one number for the whole stone and all of its use; the active stone does not wear,
# and patches are pressed as before use by what surrounds them, at the pressure of each step.
# ASSUME: κ makes the predicted and the measured loss of the patches equal in sum: a few deep
# traces count more than many shallow ones. The measured loss is that beyond its level of detection.
# ASSUME: a mat carries the same force over the square as the bare stone does, and is as thick
# everywhere; what is behind it is rigid for it, and elastic by itself as without it.
# ASSUME: T1 is laid on T0 where most points are. No scan sees what a mat takes off all points
# alike, so that a prediction, too, counts from the median of its depths.

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem import Layer, ThirdBody, solve_contact, wear_path
from gstlib.contact import solved
from gstlib.coupling import Place, patch_pressures, surroundings
from gstlib.errors import InputError
from gstlib.gesture import exposure, press_poses
from gstlib.validation.wear_scores import OWN, seen_depth

__all__ = ["fit_mat", "mat_misfits", "wear_map", "wear_patch", "wear_square"]

# The square wears to this many times the κ of the bare stone that its first pressures give, or to
# more, where patches are then short of their losses.
_REACHES = 1.5, 3.0, 6.0
# Coefficients of the mat that are tried, over that of the bare stone.
_RATIOS = 0.0, 0.1, 0.3, 1.0, 3.0
_BODIES = "stone", "mat"


def wear_square(
    contact: xr.Dataset,
    pressures: pd.DataFrame,
    losses_um: Mapping[str, float],
    *,
    patch_mm: float,
    steps: int,
    mat: Layer | None = None,
    face: xr.DataArray | None = None,
    poses: pd.DataFrame | None = None,
    source: str | Path = "macroscale",
) -> xr.Dataset:
    """Wear the square, follow the patches' pressures, and fit κ.

    Parameters
    ----------
    contact : xarray.Dataset
        The square's at the target pressure, with its ``height`` (y, x), mm.
    pressures : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg`` of every patch, and ``pressure_MPa`` before use.
    losses_um : mapping
        Measured mean loss over each patch that κ is fitted to, µm, finite; of two at least.
    patch_mm : float
        Side of a patch.
    steps : int
        Implicit steps of the path.
    mat : gstlib.bem.Layer, optional
        What takes turns with the bare stone.
    face : (face_y, face_x) xarray.DataArray, optional
    poses : pandas.DataFrame, optional
        The active stone's face and a gesture, as in `gstlib.gesture.press_poses`: in each step all
        poses take off what their pressure and sliding say, in place of the single pose. Not with a
        mat.

    Returns
    -------
    xarray.Dataset
        By ``ratio`` of the mat's coefficient to the bare stone's, 0 alone without a mat: ``kappa``
        (ratio, step), both bodies' together, mm/MPa, from 0 on; ``pressed`` (ratio, body, step,
        patch): mean depth that one body alone would remove, mm. ``fitted`` (patch): κ of
        the bare stone from the measured losses of all other patches; the attribute ``kappa``: from
        all. ``measured`` (patch), mm, NaN where κ is not fitted to a patch; ``x_mm, y_mm,
        rotation_deg`` (patch); with a mat ``mat_pressure`` (y, x), MPa, under it before use.

    Raises
    ------
    InputError
        The square cannot lose so much under these patches.
    """
    measured = pd.Series(losses_um, dtype=float) * 1e-3
    table = pressures.set_index("patch", drop=False)
    settings: dict[str, Any] = {"patch_mm": patch_mm, "steps": steps, "source": source}
    most = measured.sum() / table.pressure_MPa[measured.index].sum()
    for reach in _REACHES:
        # a mat adds to what the bare stone does
        if poses is None:
            paths = [
                _pressed(
                    contact, table, (1 + ratio) * reach * most, ratio, mat=mat, **settings
                )
                for ratio in (_RATIOS if mat else _RATIOS[:1])
            ]
        else:
            surface = contact[["height"]].assign(face=face)
            paths = [
                _pressed_in_poses(contact, surface, poses, table, reach * most, **settings)
            ]
        bare = paths[0]
        loss = bare.pressed.sel(body="stone")
        others = (measured.index.drop(patch, errors="ignore") for patch in table.patch)
        fits = [_fit(bare.kappa, loss, measured[of]) for of in (measured.index, *others)]
        if np.isfinite(fits).all():
            break
    else:
        raise InputError(
            source,
            "the measured losses are more than this square can lose under its patches",
            "Look for a patch whose T1 is wrong, or set wear_steps to null in the config.",
        )
    path = xr.concat(paths, pd.Index(_RATIOS[: len(paths)], name="ratio"))
    path = path.assign(
        fitted=("patch", fits[1:]), measured=("patch", measured.reindex(table.index))
    )
    described = {
        "kappa": ("mm/MPa", "wear coefficient × sliding"),
        "pressed": ("mm", "mean depth that a body alone takes off"),
        "fitted": ("mm/MPa", "κ of other patches"),
        "measured": ("mm", "measured mean depth lost"),
        "x_mm": ("mm", "centre of the patch along x"),
        "y_mm": ("mm", "centre of the patch along y"),
        "rotation_deg": ("degree", "turn of the patch, x towards y"),
    }
    places = {name: ("patch", table[name]) for name in ("x_mm", "y_mm", "rotation_deg")}
    path = path.assign(places).assign_attrs(kappa=fits[0], steps=steps, patch_mm=patch_mm)
    for name, (units, long_name) in described.items():
        path[name].attrs.update(units=units, long_name=long_name)
    if mat is None:
        return path
    options = {"mean_pressure": float(contact.pressure.mean()), "layer": mat}
    pressed = solved(solve_contact, contact, source, **options).pressure
    field = contact.pressure.copy(data=pressed).reset_coords(drop=True)
    field.attrs["long_name"] = "pressure under the mat before use"
    return path.assign(mat_pressure=field).assign_attrs(
        young_MPa=mat.young,
        poisson=mat.poisson,
        thickness_mm=mat.thickness,
        contact_modulus_MPa=contact.attrs["contact_modulus_MPa"],
    )


def _pressed(
    contact: xr.Dataset,
    table: pd.DataFrame,
    kappa: float,
    ratio: float,
    *,
    patch_mm: float,
    steps: int,
    mat: Layer | None,
    source: str | Path,
) -> xr.Dataset:
    """``kappa`` and ``pressed`` of `wear_square` up to one κ, at one ratio."""
    target = float(contact.pressure.mean())
    share = ratio / (1 + ratio)
    third_body = ThirdBody(mat, share, target) if mat else None
    options: dict[str, Any] = {"mean_pressure": target, "mean_loss": kappa * target}
    options |= {"steps": steps, "third_body": third_body, "keep_states": True}
    path = solved(wear_path, contact, source, **options)
    pressed = np.zeros((len(_BODIES), steps + 1, len(table)))
    for body, states in enumerate(zip(*path.states, strict=True)):
        in_steps = [
            patch_pressures(
                contact.height.copy(data=state.pressure), table, size_mm=patch_mm
            ).pressure_MPa
            for state in states
        ]
        pressed[body, 1:] = kappa / steps * np.cumsum(in_steps, axis=0)
    return _path(np.linspace(0, kappa, steps + 1), pressed, table)


def _pressed_in_poses(
    contact: xr.Dataset,
    surface: xr.Dataset,
    poses: pd.DataFrame,
    table: pd.DataFrame,
    kappa: float,
    *,
    patch_mm: float,
    steps: int,
    source: str | Path,
) -> xr.Dataset:
    """As `_pressed`, by all poses of a gesture in each of as many explicit steps.

    The exposure takes the place of the pressure, in units in which its mean is the mean pressure.
    """
    target = float(contact.pressure.mean())
    settings = {name: contact.attrs[name] for name in ("contact_modulus_MPa", "tolerance")}
    pressed = np.zeros((len(_BODIES), steps + 1, len(table)))
    for step in range(steps):
        found = exposure(
            [press_poses(surface, poses, table, patch_mm=patch_mm, source=source, **settings)]
        )
        lost = kappa / steps * target / float(found.exposure.mean())
        pressed[0, step + 1] = (
            pressed[0, step] + lost * found.patch_exposure.sum("pose").values
        )
        worn = surface.height.values - lost * found.exposure.values
        surface = surface.assign(height=surface.height.copy(data=worn))
    return _path(np.linspace(0, kappa, steps + 1), pressed, table)


def _path(kappa: np.ndarray, pressed: np.ndarray, table: pd.DataFrame) -> xr.Dataset:
    return xr.Dataset(
        {"kappa": ("step", kappa), "pressed": (("body", "step", "patch"), pressed)},
        coords={"body": list(_BODIES), "patch": list(table.patch)},
    )


def _fit(kappa: xr.DataArray, loss: xr.DataArray, measured: pd.Series) -> float:
    """The κ at which the patches of `measured` have lost as much in sum; NaN beyond the path."""
    total = loss.sel(patch=list(measured.index)).sum("patch").values
    return float(np.interp(measured.sum(), total, kappa, right=math.nan))


def wear_patch(
    contact: xr.Dataset,
    square: xr.Dataset,
    patch: str,
    *,
    ratio: float = 0.0,
    kappa: float | None = None,
) -> np.ndarray:
    """Wear a patch at the pressures that the wearing square gives it.

    Parameters
    ----------
    contact : xarray.Dataset
        The patch's, before use, from `gstlib.study.solve_patch`.
    square : xarray.Dataset
        From `wear_square`.
    ratio : float
        One of those of `square`.
    kappa : float, optional
        mm/MPa; by default that of the bare stone from the other patches.

    Returns
    -------
    ndarray, shape (ny, nx)
        The depth lost, mm.
    """
    kappa = float(square.fitted.sel(patch=patch)) if kappa is None else kappa
    lost, options = _driven(contact, square, patch, ratio, kappa)
    if not lost > 0:
        return np.zeros(contact.height.shape)
    return solved(wear_path, contact, f"patch {patch}", **options).depth


def _driven(
    contact: xr.Dataset, square: xr.Dataset, patch: str, ratio: float, kappa: float
) -> tuple[float, dict]:
    """Mean loss (mm) of a patch at a κ, and the settings of `wear_path` that lead to it."""
    at, steps = square.sel(patch=patch, ratio=ratio), square.attrs["steps"]
    share, fine = ratio / (1 + ratio), kappa * np.arange(steps + 1) / steps
    pressed = [np.interp(fine, at.kappa, at.pressed.sel(body=body)) for body in _BODIES]
    stone, soft = (np.diff(of) / fine[1] for of in pressed)
    lost = (1 - share) * pressed[0][-1] + share * pressed[1][-1]
    options: dict[str, Any] = {"mean_pressure": stone, "mean_loss": lost, "steps": steps}
    if ratio:
        options["third_body"] = ThirdBody(*_mat_under(contact, at, share, soft))
    return lost, options


def _mat_under(
    contact: xr.Dataset, at: xr.Dataset, share: float, pressures: np.ndarray
) -> tuple:
    """The third body on a patch, lowered by other surroundings than those of the bare stone."""
    mat = Layer(*(at.attrs[name] for name in ("young_MPa", "poisson", "thickness_mm")))
    if "surroundings" not in contact:
        return mat, share, pressures
    lowered = surroundings(
        at.mat_pressure,
        Place(*(float(at[name]) for name in ("y_mm", "x_mm", "rotation_deg"))),
        contact.height.shape,
        size_mm=at.attrs["patch_mm"],
        contact_modulus_MPa=at.attrs["contact_modulus_MPa"],
        layer=mat,
    )
    return mat, share, pressures, lowered - contact.surroundings.values


def mat_misfits(
    contact: xr.Dataset, change: xr.Dataset, square: xr.Dataset, patch: str
) -> xr.Dataset:
    """How a patch's wear compares with its measured loss, by ratio, along the path of the square.

    Returns
    -------
    xarray.Dataset
        ``visible`` (ratio, step): mean of the predicted depth above its median, mm; ``misfit``
        (ratio, step): sum over the points of (predicted − measured loss)², mm²; ``product`` (ratio,
        step): that of the errors of a step and the next.
    """
    known = np.isfinite(change.change.values)
    lost = -change.change.values[known]
    steps = square.attrs["steps"]
    found = np.zeros((3, len(square.ratio), steps + 1))
    for row, ratio in enumerate(square.ratio.values):
        kappa = float(square.kappa.sel(ratio=ratio)[-1])
        total, options = _driven(contact, square, patch, ratio, kappa)
        depths = np.zeros((steps, *contact.height.shape))
        if total > 0:
            options["keep_depths"] = True
            depths = solved(wear_path, contact, f"patch {patch}", **options).depths
        before = -lost
        found[1, row, 0] = before @ before
        for step, depth in enumerate(depths, start=1):
            seen = seen_depth(depth[known])
            error = seen - lost
            found[:, row, step] = seen.clip(0).mean(), error @ error, 0
            found[2, row, step - 1] = before @ error
            before = error
    named = {
        "visible": ("mm", "mean predicted depth above its median"),
        "misfit": ("mm2", "sum of squared differences of loss"),
        "product": ("mm2", "sum of products of these differences in two steps"),
    }
    return xr.Dataset(
        {
            name: (("ratio", "step"), values, {"units": units, "long_name": long_name})
            for (name, (units, long_name)), values in zip(named.items(), found, strict=True)
        },
        coords={"ratio": square.ratio},
    )


def fit_mat(square: xr.Dataset, by_patch: Mapping[str, xr.Dataset]) -> xr.Dataset:
    """Find the mat's coefficient, over the bare stone's, that fits the maps of loss best.

    At each ratio κ makes the predicted losses, as far as scans see them, equal in sum to the
    measured ones.

    `by_patch` are `mat_misfits`. The result is `square` with ``misfit`` (ratio, scored), mm²: of
    each patch where all are fitted; ``mat_ratio`` and ``mat_kappa`` (scored): fitted to all other
    patches; and the attribute ``mat_ratio``: to all.
    """
    found = xr.concat(by_patch.values(), pd.Index(by_patch, name="scored"))
    measured = square.measured.sel(patch=list(by_patch)).values

    def misfit(of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """κ (ratio,), and the misfits (ratio, scored), where the patches `of` are fitted."""
        kappas, errors = [], []
        for ratio in square.ratio.values:
            at, kappa = found.sel(ratio=ratio), square.kappa.sel(ratio=ratio).values
            place = np.interp(
                measured[of].sum(), at.visible[of].sum("scored"), np.arange(kappa.size)
            )
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
    _, all_misfits = misfit(every)
    ratios, kappas = [], []
    for own in every:
        others = np.delete(every, own)
        kappa, errors = misfit(others)
        best = int(errors[:, others].sum(axis=1).argmin())
        ratios.append(float(square.ratio[best]))
        kappas.append(kappa[best])
    best = int(all_misfits.sum(axis=1).argmin())
    misfit_of = {"units": "mm2", "long_name": "sum of squared differences of loss"}
    ratio_of = {
        "units": "1",
        "long_name": "coefficient of the mat over that of the bare stone",
    }
    kappa_of = {"units": "mm/MPa", "long_name": "κ of other patches, with the mat"}
    return square.assign(
        misfit=(("ratio", "scored"), all_misfits, misfit_of),
        mat_ratio=("scored", ratios, ratio_of),
        mat_kappa=("scored", kappas, kappa_of),
        scored=list(by_patch),
    ).assign_attrs(mat_ratio=float(square.ratio[best]))


def wear_map(contact: xr.Dataset, square: xr.Dataset, patch: str) -> xr.Dataset:
    """Loss and heights after use of a patch, as the other patches predict them.

    Parameters
    ----------
    contact : xarray.Dataset
        The patch's contact before use.
    square : xarray.Dataset
        From `wear_square`; with a mat, from `fit_mat`.

    Returns
    -------
    xarray.Dataset
        ``depth`` and ``t1`` (model, y, x), mm, by ``archard``, the bare stone, and, where there is
        a mat, ``mat``.
    """
    depths = [wear_patch(contact, square, patch)]
    if "mat_ratio" in square:
        fitted = square.sel(scored=patch)
        ratio, kappa = float(fitted.mat_ratio), float(fitted.mat_kappa)
        depths.append(wear_patch(contact, square, patch, ratio=ratio, kappa=kappa))
    depth = np.stack(depths)
    names = {"depth": "predicted height loss", "t1": "predicted height after use"}
    values = {"depth": depth, "t1": contact.height.values - depth}
    return xr.Dataset(
        {
            name: (("model", "y", "x"), values[name], {"units": "mm", "long_name": long_name})
            for name, long_name in names.items()
        },
        coords={"model": list(OWN[: len(depth)]), "y": contact.y, "x": contact.x},
    )
