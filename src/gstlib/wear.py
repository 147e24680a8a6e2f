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
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem import wear_path
from gstlib.contact import laid_height, solved
from gstlib.coupling import patch_pressures
from gstlib.errors import InputError
from gstlib.surface import spacing_of
from gstlib.validation.intervals import percentile_interval
from gstlib.validation.summary import rank_correlation

__all__ = ["COLUMNS", "MODELS", "wear_patch", "wear_square", "wear_summary", "wear_table"]

# The prediction, and what it is to beat.
MODELS = "archard", "pressure", "uniform", "truncation"
# Of ``wear.csv`` and of ``wear_summary.csv``.
COLUMNS = (
    [
        *("patch", "model", "predicted_volume_um3", "measured_volume_um3", "predicted_depth_um"),
        *("measured_depth_um", "rms_difference_um"),
    ],
    ["statistic", "value", "low", "high", "p_value", "n", "against"],
)
# The square wears to this many times the κ that its first pressures give, or, where patches are
# then short of their losses, to more.
_REACHES = 1.5, 3.0, 6.0


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
        Measured mean loss over each patch that κ is fitted to, µm, finite; of two at least.
    patch_mm : float
        Side of a patch.
    steps : int
        Implicit steps of the path.

    Returns
    -------
    xarray.Dataset
        ``loss`` (step, patch): mean depth lost since the start, mm, at ``kappa`` (step), mm/MPa,
        both from 0 on; ``measured`` (patch) mm, NaN where κ is not fitted to a patch; ``fitted``
        (patch): κ from the measured losses of all other patches; the attribute ``kappa``, from all.

    Raises
    ------
    InputError
        The square cannot lose so much under these patches.
    """
    measured = pd.Series(losses_um, dtype=float) * 1e-3
    table = pressures.set_index("patch", drop=False)
    target = float(contact.pressure.mean())
    most = measured.sum() / table.pressure_MPa[measured.index].sum()
    for reach in _REACHES:
        kappa = np.linspace(0, reach * most, steps + 1)
        options = {"mean_pressure": target, "mean_loss": kappa[-1] * target, "steps": steps}
        path = solved(wear_path, contact, source, keep_states=True, **options)
        in_steps = [
            patch_pressures(
                contact.height.copy(data=state.pressure), table, size_mm=patch_mm
            ).pressure_MPa
            for state in path.states
        ]
        loss = xr.DataArray(
            kappa[1] * np.cumsum([np.zeros(len(table)), *in_steps], axis=0),
            dims=("step", "patch"),
            coords={"patch": list(table.patch)},
        )
        others = (measured.index.drop(patch, errors="ignore") for patch in table.patch)
        fits = [_fit(kappa, loss, measured[of]) for of in (measured.index, *others)]
        if np.isfinite(fits).all():
            break
    else:
        raise InputError(
            source,
            "the measured losses are more than this square can lose under its patches",
            "Look for a patch whose T1 is wrong, or set wear_steps to null in the config.",
        )
    return xr.Dataset(
        {
            "loss": loss.assign_attrs(units="mm", long_name="mean depth lost"),
            "kappa": (
                "step",
                kappa,
                {"units": "mm/MPa", "long_name": "wear coefficient × sliding"},
            ),
            "measured": (
                "patch",
                measured.reindex(table.index),
                {"units": "mm", "long_name": "measured mean depth lost"},
            ),
            "fitted": ("patch", fits[1:], {"units": "mm/MPa", "long_name": "κ of other patches"}),
        },
        attrs={"kappa": fits[0], "steps": steps},
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
        pressures = np.diff(lost) / (kappa / steps)
        options = {"mean_pressure": pressures, "mean_loss": lost[-1], "steps": steps}
        depth = solved(wear_path, contact, f"patch {patch}", **options).depth
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
    patches: Iterable[tuple[str, xr.Dataset, xr.Dataset, xr.Dataset]],
    square: xr.Dataset,
    pressures: pd.DataFrame,
) -> pd.DataFrame:
    """Predicted against measured loss of each patch, by model: the table ``wear.csv``.

    Parameters
    ----------
    patches : iterable of (patch, xarray.Dataset, xarray.Dataset, xarray.Dataset)
        Contact before use, height change, and wear from `wear_patch`; each is used once.
    square : xarray.Dataset
        From `wear_square`.
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
    measured = square.measured.dropna("patch").to_series()
    rows: list[tuple] = []
    for patch, contact, change, worn in patches:
        known = np.isfinite(change.change.values)
        lost, loss = -change.change.values[known], change.loss.values.astype(bool)[known]
        level = change.level_of_detection.values[known]
        height = laid_height(contact).values[known]
        others = measured.drop(patch)
        depths = {
            "archard": worn.depth.values[known],
            "pressure": np.full(lost.shape, of[patch] * others.sum() / of[others.index].sum()),
            "uniform": np.full(lost.shape, others.mean()),
            "truncation": np.maximum(height - np.quantile(height, 1 - loss.mean()), 0),
        }
        element_um3 = float(np.prod(spacing_of(change))) * 1e9
        for model in MODELS:
            depth = depths[model]
            rows.append(
                (
                    *(patch, model, depth.sum() * element_um3, lost[loss].sum() * element_um3),
                    *(_mean_um(depth[depth > level]), _mean_um(lost[loss])),
                    1e3 * float(np.sqrt(np.mean((depth - lost) ** 2))),
                )
            )
    return pd.DataFrame(rows, columns=COLUMNS[0])


def _mean_um(depth: np.ndarray) -> float:
    """Mean of depths in mm, µm; NaN of none."""
    return 1e3 * float(depth.mean()) if depth.size else math.nan


def wear_summary(table: pd.DataFrame, *, seed: int, resamples: int) -> pd.DataFrame:
    """What the prediction is worth, over the patches: the table ``wear_summary.csv``.

    Parameters
    ----------
    table : pandas.DataFrame
        From `wear_table`.
    seed, resamples : int
        Of the bootstrap over patches.

    Returns
    -------
    pandas.DataFrame
        ``statistic, value, low, high, p_value, n, against``, with 95 % intervals.
        ``skill(volume)`` is one less the summed absolute error of Archard's law over that of a
        rival: 1 if it errs nowhere, 0 if both err alike, negative if the rival errs less.
        ``skill(map)`` is that of r.m.s. differences, ``skill(depth)`` that of mean depths, against
        ``truncation`` alone: the other rivals spread a loss evenly and tell no depth.
        ``spearman(model, measured volume)`` is a rank correlation of volumes.
    """
    errors = {
        "volume": (table.predicted_volume_um3 - table.measured_volume_um3).abs(),
        "depth": (table.predicted_depth_um.fillna(0) - table.measured_depth_um.fillna(0)).abs(),
        "map": table.rms_difference_um,
    }
    patches = list(dict.fromkeys(table.patch))
    generator = np.random.default_rng(seed)
    drawn = generator.integers(len(patches), size=(resamples, len(patches)))
    rows: list[tuple] = []
    for quantity, error in errors.items():
        wide = table.assign(error=error).pivot(index="patch", columns="model", values="error")
        own, *others = (wide.loc[patches, model].to_numpy() for model in MODELS)
        for rival, other in zip(MODELS[1:], others, strict=True):
            if quantity == "depth" and rival != "truncation":
                continue
            samples = 1 - own[drawn].sum(axis=1) / other[drawn].sum(axis=1)
            interval = percentile_interval(samples, len(patches))
            value = 1 - own.sum() / other.sum()
            rows.append((f"skill({quantity})", value, *interval, math.nan, len(patches), rival))
    volumes = table.pivot(index="patch", columns="model", values="predicted_volume_um3")
    measured = table.drop_duplicates("patch").set_index("patch").measured_volume_um3
    volumes = volumes.loc[patches].assign(**{"measured volume": measured})
    # The mean of the others falls as a patch's own loss grows: `uniform` has no rank of its own.
    ranked = [
        rank_correlation(
            volumes, model, "measured volume", generator=generator, resamples=resamples
        )
        for model in MODELS
        if model != "uniform"
    ]
    skills = pd.DataFrame(rows, columns=COLUMNS[1])
    return pd.concat([skills, *ranked], ignore_index=True)
