"""What a study takes from an inference: what is pressed, pressures, predicted losses, the table.

`gstlib.use.infer` asks how the tool was used; this asks it of a study, and goes on with the answer.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.macroscale.active_tool import as_round_as
from gstlib.macroscale.face import without_curvature
from gstlib.use.evidence import Grades, Losses
from gstlib.use.infer import StatedUse, infer_use
from gstlib.use.sampling import Sampling

__all__ = ["as_used", "leave_one_out", "losses_of", "predicted_losses", "share_within"]
__all__ += ["use_of_study", "use_table"]

# Decimals of a predicted loss (µm) and pressure (MPa); what is less comes from uses of no weight.
_DECIMALS = 6
_TAILS = 0.025, 0.975
_PREDICTIVE = 4000


def use_of_study(
    face: xr.Dataset,
    patches: pd.DataFrame,
    registration: pd.DataFrame | None,
    *,
    stated: Mapping[str, Any],
    sampling: Mapping[str, Any],
    modulus: float,
    patch_mm: float,
) -> tuple[xr.Dataset, pd.DataFrame, pd.DataFrame | None]:
    """How the tool of a study was used, from the losses of its patches, or from their grades.

    Parameters
    ----------
    face, modulus, patch_mm
        As in `gstlib.use.infer.infer_use`.
    patches : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg``, and without a registration ``wear_grade``.
    registration : pandas.DataFrame or None
        The table ``registration``.
    stated, sampling : mapping
        The fields of `gstlib.use.infer.StatedUse` and `gstlib.use.sampling.Sampling`.

    Returns
    -------
    use : xarray.Dataset
        From `gstlib.use.infer.infer_use`.
    table : pandas.DataFrame
        From `use_table`. Read from grades, it has ``mean_without_curvature``, too: the mesh is that
        of the worn tool.
    losses : pandas.DataFrame or None
        From `predicted_losses`; None where there are grades in place of losses.
    """
    told, drawn = StatedUse(**stated), Sampling(**sampling)
    settings: dict[str, Any] = {"modulus": modulus, "patch_mm": patch_mm, "sampling": drawn}
    if registration is not None:
        known, losses = losses_of(patches, registration)
        use = infer_use(face, known, losses, told, **settings)
        predicted = predicted_losses(use, losses, drawn.seed)
        return use, use_table(use, told, predicted), predicted
    grades = Grades(patches.wear_grade.to_numpy(dtype=int))
    use, flat = (
        infer_use(pressed, patches, grades, told, **settings)
        for pressed in (face, without_curvature(face))
    )
    table = use_table(use, told)
    return use, table.assign(mean_without_curvature=use_table(flat, told)["mean"]), None


def losses_of(patches: pd.DataFrame, registration: pd.DataFrame) -> tuple[pd.DataFrame, Losses]:
    """The patches whose loss is known, and their losses.

    `patches` is the patch table and `registration` the table ``registration``. Patches
    whose T1 is excluded are left out; those that lost nothing count.
    """
    known = registration[~registration.excluded.astype(bool)].set_index("patch")
    known = known.dropna(subset="mean_wear_depth_um")
    chosen = patches[patches.patch.isin(known.index)].reset_index(drop=True)
    known = known.loc[chosen.patch]
    return chosen, Losses(
        known.mean_wear_depth_um.to_numpy(dtype=float), known.above_noise.to_numpy(dtype=bool)
    )


def as_used(
    face: xr.Dataset, use: xr.Dataset | None, through: tuple[float, float] | None
) -> tuple[xr.Dataset, tuple[float, float] | None]:
    """What is pressed, and through which point: as the wear says, or else as stated.

    `face` has ``height``, ``counterface`` and ``size_mm``; `use` is from
    `gstlib.use.infer.infer_use`. The load point is the mean of what the wear says, and the radius
    the geometric mean.
    """
    if use is None or not use.attrs["taken"]:
        return face, through
    weight = use.weight.values
    point = float(weight @ use.y_mm.values), float(weight @ use.x_mm.values)
    log_radius = float(weight @ np.log(use.radius_mm.values))
    if np.isnan(log_radius):
        return face, point
    over = as_round_as(face.counterface, use.attrs["stated_radius_mm"], np.exp(log_radius))
    return face.assign(counterface=over), point


def leave_one_out(pressures: pd.DataFrame, use: xr.Dataset | None) -> pd.DataFrame:
    """The table of pressures with ``leave_one_out_MPa``, as the wear of the other patches says.

    NaN where the wear of the patch is not known. Without a use that is taken, the table stays as it
    is.
    """
    if use is None or not use.attrs["taken"]:
        return pressures
    expected = (use.weight_without * use.pressure).sum("draw")
    by_patch = pd.Series(expected.values, expected.patch.values).round(_DECIMALS)
    return pressures.assign(leave_one_out_MPa=pressures.patch.map(by_patch))


def predicted_losses(use: xr.Dataset, losses: Losses, seed: int) -> pd.DataFrame:
    """Loss of each patch, as predicted by the use that the wear of the other patches tells.

    `use` is from `gstlib.use.infer.infer_use` with these `losses`. The result has ``patch``,
    ``loss_um`` as measured, ``predicted_um``, and the limits of 95 %, ``low_um`` and ``high_um``,
    scatter included; it has no rows where nothing was inferred.
    """
    generator = np.random.default_rng([seed, 7])
    rows = []
    known = use.patch.values if use.sizes else []
    for patch, measured in zip(known, losses.depth_um, strict=False):
        at = use.sel(patch=patch)
        expected = (at.wear_coefficient_without * at.pressure).values
        weight = at.weight_without.values
        drawn = generator.choice(len(weight), _PREDICTIVE, p=weight / weight.sum())
        width = np.hypot(at.scatter_without * expected, at.floor_without).values[drawn]
        loss = expected[drawn] + width * generator.standard_t(4.0, _PREDICTIVE)
        rows.append((patch, measured, float(weight @ expected), *np.quantile(loss, _TAILS)))
    columns = ["patch", "loss_um", "predicted_um", "low_um", "high_um"]
    return pd.DataFrame(rows, columns=columns).round(_DECIMALS)


def share_within(predicted: pd.DataFrame) -> float:
    """Share of the losses that lie within the limits of `predicted_losses`."""
    return float(predicted.loss_um.between(predicted.low_um, predicted.high_um).mean())


def use_table(
    use: xr.Dataset, stated: StatedUse, predicted: pd.DataFrame | None = None
) -> pd.DataFrame:
    """The table ``use.csv``: what was stated of the use, and what the wear says.

    Returns
    -------
    pandas.DataFrame
        A row for each ``parameter`` with its ``unit``: ``stated`` and ``stated_error`` (of the
        radius: of its logarithm), NaN where nothing was; ``mean`` (of the radius: geometric),
        ``low`` and ``high`` of 95 %. Further rows say how good the answer is: ``p_value`` against
        chance; ``gain`` of the log score over heights alone; and, with `predicted` from
        `predicted_losses`, the share of the losses ``within_95`` % of what the others predict,
        the posterior predictive check. In all rows the same:
        ``effective_draws``, ``answer``, and ``taken``, whether the study takes it.
    """
    y, x = stated.through
    rows: list[tuple] = [
        ("load_point_x", "mm", "x_mm", x, stated.load_point_mm),
        ("load_point_y", "mm", "y_mm", y, stated.load_point_mm),
    ]
    if stated.radius_mm is not None:
        rows.append(("radius", "mm", "radius_mm", stated.radius_mm, stated.radius_fraction))
    if "wear_coefficient" in use:
        rows.append(("wear_coefficient", "um/MPa", "wear_coefficient", np.nan, np.nan))
        rows.append(("scatter", "1", "scatter", np.nan, np.nan))
    found = [
        (parameter, unit, value, error, *_summary(use, name))
        for parameter, unit, name, value, error in rows
    ]
    if use.sizes:
        gain, error = use.attrs["gain"], 1.96 * use.attrs["gain_error"]
        found.append(("p_value", "1", np.nan, np.nan, use.attrs["p_value"], np.nan, np.nan))
        found.append(("gain", "1", np.nan, np.nan, gain, gain - error, gain + error))
    if predicted is not None and len(predicted):
        within = share_within(predicted)
        found.append(("within_95", "1", np.nan, np.nan, within, np.nan, np.nan))
    columns = ["parameter", "unit", "stated", "stated_error", "mean", "low", "high"]
    answered = {name: use.attrs[name] for name in ("effective_draws", "answer")}
    return pd.DataFrame(found, columns=columns).assign(
        **answered, taken=bool(use.attrs["taken"])
    )


def _summary(use: xr.Dataset, name: str) -> tuple[float, float, float]:
    """Mean and limits of what the wear says."""
    if name not in use:
        return np.nan, np.nan, np.nan
    values, weight = use[name].values, use.weight.values
    mean = float(weight @ values)
    if name == "radius_mm":
        mean = float(np.exp(weight @ np.log(values)))
    low, high = np.quantile(values, _TAILS, weights=weight, method="inverted_cdf")
    return mean, float(low), float(high)
