"""How much wears: Archard's law on the square and on its patches, with one coefficient for a stone.

What a patch loses in a step of sliding is κ p: wear coefficient × sliding, κ, times its pressure.
The square wears as a whole, so pressures move from patch to patch as the hardest pressed sink
(`wear_square`); inside a patch, the summits wear first (`wear_patch`). The one unknown, κ, is
fitted to the measured loss. A prediction for a patch uses the κ of all the *other* patches.

The rivals know less: the same depth on every patch, a depth in proportion to the pressure before
use, and each patch cut off flat over the area that did wear (`wear_table`).
"""

# ASSUME: κ is one number for the whole stone and all of its use; the active stone does not wear,
# and patches are pressed as before use by what surrounds them, at the pressure of each step.
# ASSUME: κ makes the predicted and the measured loss of the patches equal in sum: a few deep
# traces count more than many shallow ones. The measured loss is that beyond its level of detection.

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.stats import spearmanr

from gstlib.bem import wear_path
from gstlib.contact import laid_height, pressed_height
from gstlib.coupling import patch_pressures
from gstlib.errors import InputError
from gstlib.surface import spacing_of
from gstlib.validation.intervals import percentile_interval

__all__ = ["MODELS", "wear_patch", "wear_square", "wear_summary", "wear_table"]

# The prediction, and what it is to beat.
MODELS = "archard", "pressure", "uniform", "truncation"
# The square wears to this share beyond the κ that its first pressures give, and to twice as much
# each time that is not enough.
_REACH, _ATTEMPTS = 1.5, 4


def wear_square(
    contact: xr.Dataset,
    pressures: pd.DataFrame,
    losses_um: Mapping[str, float],
    *,
    patch_mm: float,
    steps: int,
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
        Measured mean loss over each patch that κ is fitted to, µm.
    patch_mm : float
        Side of a patch.
    steps : int
        Implicit steps of the path.

    Returns
    -------
    xarray.Dataset
        ``loss`` (step, patch): mean depth lost since the start, mm, at ``kappa`` (step), mm/MPa,
        both from 0 on; ``fitted`` (patch): κ from the losses of all other patches; the attribute
        ``kappa``, from all.

    Raises
    ------
    InputError
        Fewer than two patches with a loss, or losses that no wear of this square explains.
    """
    measured = pd.Series(losses_um, dtype=float) * 1e-3
    table = pressures.set_index("patch", drop=False)
    if len(measured) < 2 or not (measured > 0).sum() > 1:
        raise InputError(
            source,
            f"{(measured > 0).sum()} patches lost height: wear cannot be fitted to some and tested "
            "on others",
            "Set wear to null, or scan more patches after use.",
        )
    known = table.pressure_MPa[measured.index]
    reach, settings = _REACH, contact.attrs
    for _ in range(_ATTEMPTS):
        most = reach * measured.sum() / known.sum() if known.sum() else math.nan
        target = float(contact.pressure.mean())
        path = wear_path(
            contact.height.values,
            spacing_of(contact.height),
            settings["contact_modulus_MPa"],
            mean_pressure=target,
            mean_loss=most * target,
            steps=steps,
            tolerance=settings["tolerance"],
            keep_states=True,
        )
        lost = [np.zeros(len(table))]
        for state in path.states:
            field = contact.height.copy(data=state.pressure)
            at = patch_pressures(field, table, size_mm=patch_mm).pressure_MPa
            lost.append(lost[-1] + most / steps * at.values)
        loss = xr.DataArray(lost, dims=("step", "patch"), coords={"patch": list(table.patch)})
        kappa = np.linspace(0, most, steps + 1)
        others = {patch: measured.index.drop(patch, errors="ignore") for patch in table.patch}
        fits = [_fit(kappa, loss, measured[of]) for of in (measured.index, *others.values())]
        if all(np.isfinite(fits)):
            break
        reach *= 2
    else:
        raise InputError(
            source,
            "the measured losses are more than this square can lose under its patches",
            "Look for a patch whose T1 is wrong, or set wear to null.",
        )
    return xr.Dataset(
        {
            "loss": loss.assign_attrs(units="mm", long_name="mean depth lost"),
            "kappa": (
                "step",
                kappa,
                {"units": "mm/MPa", "long_name": "wear coefficient × sliding"},
            ),
            "fitted": ("patch", fits[1:], {"units": "mm/MPa", "long_name": "κ of other patches"}),
        },
        attrs={"kappa": fits[0], "steps": steps, "tolerance": settings["tolerance"]},
    )


def _fit(kappa: np.ndarray, loss: xr.DataArray, measured: pd.Series) -> float:
    """The κ at which the patches of `measured` have lost as much in sum; NaN beyond the path."""
    total = loss.sel(patch=list(measured.index)).sum("patch").values
    return float(np.interp(measured.sum(), total, kappa, right=math.nan))


def wear_patch(contact: xr.Dataset, square: xr.Dataset, patch: str) -> xr.Dataset:
    """Wear a patch at the pressures that the wearing square gives it.

    Parameters
    ----------
    contact : xarray.Dataset
        The patch's, before use, from `gstlib.study.solve_patch`.
    square : xarray.Dataset
        From `wear_square`.

    Returns
    -------
    xarray.Dataset
        ``depth`` (y, x), the predicted loss, and ``t1``, the predicted heights after use, mm.
    """
    steps, kappa = square.attrs["steps"], float(square.fitted.sel(patch=patch))
    lost = np.interp(
        kappa * np.arange(steps + 1) / steps, square.kappa.values, square.loss.sel(patch=patch)
    )
    depth = np.zeros(contact.height.shape)
    if lost[-1] > 0:
        depth = wear_path(
            pressed_height(contact).values,
            spacing_of(contact.height),
            contact.attrs["contact_modulus_MPa"],
            mean_pressure=np.diff(lost) / (kappa / steps),
            mean_loss=lost[-1],
            steps=steps,
        ).depth
    names = {"depth": "predicted height loss", "t1": "predicted height after use"}
    values = {"depth": depth, "t1": contact.height.values - depth}
    return xr.Dataset(
        {
            name: (("y", "x"), values[name], {"units": "mm", "long_name": long_name})
            for name, long_name in names.items()
        },
        coords={axis: contact[axis] for axis in ("y", "x")},
        attrs={"kappa": kappa},
    )


def wear_table(
    patches: Iterable[tuple[str, xr.Dataset, xr.Dataset, xr.Dataset]], pressures: pd.DataFrame
) -> pd.DataFrame:
    """Predicted against measured loss of each patch, by model: the table ``wear.csv``.

    Parameters
    ----------
    patches : iterable of (patch, xarray.Dataset, xarray.Dataset, xarray.Dataset)
        Contact before use, height change, and wear from `wear_patch`.
    pressures : pandas.DataFrame
        ``patch, pressure_MPa`` before use.

    Returns
    -------
    pandas.DataFrame
        ``patch, model``; predicted and measured ``volume_um3`` over the points whose change is
        known, and ``depth_um``, the mean depth over the points that lost more than their level of
        detection (NaN where none did); ``rms_difference_um`` of predicted depth and measured loss,
        point by point. No model but ``truncation``, which takes the patch's own worn area, has
        seen the patch's own wear.
    """
    of = pressures.set_index("patch").pressure_MPa
    measured, maps, elements = {}, {}, {}
    for patch, contact, change, worn in patches:
        lost = -change.change.values
        known = np.isfinite(lost)
        loss = change.loss.values.astype(bool)[known]
        height = laid_height(contact).values[known]
        cut = np.quantile(height, 1 - loss.mean())
        elements[patch] = (
            float(np.prod(spacing_of(change))),
            change.level_of_detection.values[known],
        )
        measured[patch] = lost[known], loss
        maps[patch] = {
            "archard": worn.depth.values[known],
            "truncation": np.maximum(height - cut, 0),
        }
    means = pd.Series({patch: (lost * loss).mean() for patch, (lost, loss) in measured.items()})
    rows = []
    for patch, (lost, loss) in measured.items():
        others = means.index.drop(patch)
        per_pressure = means[others].sum() / of[others].sum()
        maps[patch] |= {
            "pressure": np.full(lost.shape, per_pressure * of[patch]),
            "uniform": np.full(lost.shape, means[others].mean()),
        }
        element, level = elements[patch]
        for model in MODELS:
            depth = maps[patch][model]
            rows.append(
                {"patch": patch, "model": model}
                | {
                    f"{kind}_volume_um3": float(values.sum()) * element * 1e9
                    for kind, values in (("predicted", depth), ("measured", lost * loss))
                }
                | {
                    f"{kind}_depth_um": float(values.mean()) * 1e3 if values.size else math.nan
                    for kind, values in (
                        ("predicted", depth[depth > level]),
                        ("measured", lost[loss]),
                    )
                }
                | {"rms_difference_um": float(np.sqrt(np.mean((depth - lost) ** 2))) * 1e3}
            )
    return pd.DataFrame(rows)


def wear_summary(table: pd.DataFrame, *, seed: int, resamples: int) -> pd.DataFrame:
    """What the prediction is worth: the table ``wear_summary.csv``.

    Parameters
    ----------
    table : pandas.DataFrame
        From `wear_table`.
    seed, resamples : int
        Of the bootstrap over patches.

    Returns
    -------
    pandas.DataFrame
        ``statistic, value, low, high, n, against``, intervals of 95 %. ``skill(volume)`` is one
        less the summed absolute error of ``archard`` over that of a rival: 1 if it errs nowhere, 0
        if both err alike, negative if the rival errs less; ``skill(depth)`` and ``skill(map)``
        likewise, of depths and of r.m.s. differences. ``spearman(volume)`` of each model.
    """
    generator = np.random.default_rng(seed)
    errors = {
        "volume": (table.predicted_volume_um3 - table.measured_volume_um3).abs(),
        "depth": (table.predicted_depth_um.fillna(0) - table.measured_depth_um.fillna(0)).abs(),
        "map": table.rms_difference_um,
    }
    order = list(dict.fromkeys(table.patch))
    drawn = generator.integers(len(order), size=(resamples, len(order)))
    rows: list[tuple[Any, ...]] = []
    for quantity, error in errors.items():
        wide = table.assign(error=error).pivot(index="patch", columns="model", values="error")
        wide = wide.loc[order]
        for rival in MODELS[1:]:
            own, other = wide["archard"].values, wide[rival].values
            samples = 1 - own[drawn].sum(axis=1) / other[drawn].sum(axis=1)
            interval = percentile_interval(samples, len(order))
            rows.append(
                (f"skill({quantity})", 1 - own.sum() / other.sum(), *interval, len(order), rival)
            )
    for model in MODELS:
        of = table[table.model == model]
        value, interval = _spearman(of, drawn)
        rows.append((f"spearman(volume, {model})", value, *interval, len(order), ""))
    return pd.DataFrame(rows, columns=["statistic", "value", "low", "high", "n", "against"])


def _spearman(
    of: pd.DataFrame, drawn: Sequence[Sequence[int]]
) -> tuple[float, tuple[float, float]]:
    """Rank correlation of predicted and measured volume, and its bootstrap interval."""
    predicted, measured = of.predicted_volume_um3.values, of.measured_volume_um3.values
    if np.ptp(predicted) == 0 or np.ptp(measured) == 0:
        return math.nan, (math.nan, math.nan)
    value = float(spearmanr(predicted, measured).statistic)
    with np.errstate(all="ignore"):
        samples = np.array([spearmanr(predicted[i], measured[i]).statistic for i in drawn])
    return value, percentile_interval(samples, len(of))
