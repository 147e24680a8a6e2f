"""Effect of an inference on a study: face, pressures, predicted losses, table.

`gstlib.use.infer` infers a load case. This module applies it to a study and adopts the result.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.conditions import ARCHARD, Law
from gstlib.macroscale.active_tool import as_round_as
from gstlib.macroscale.face import without_curvature
from gstlib.surfaces.footprints import with_t1
from gstlib.use.competitors import COMPETITORS
from gstlib.use.evidence import Grades, Losses
from gstlib.use.infer import StatedUse, infer_use, use_pressures
from gstlib.use.sampling import Sampling
from gstlib.use.spread import Uses
from gstlib.use.tempering import LIMITS, mean_and_limits

__all__ = [
    "as_used",
    "losses_of",
    "predicted_losses",
    "pressures_of_use",
    "share_within",
]
__all__ += ["strikes_of", "use_of_study", "use_table"]

# Decimals of a predicted loss (µm) and pressure (MPa); smaller values come from draws without
# weight.
_DECIMALS = 6
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
    wear_law: Mapping[str, float],
) -> tuple[xr.Dataset, pd.DataFrame, pd.DataFrame | None]:
    """Infer the load case of a study from the losses or the grades of its patches.

    Parameters
    ----------
    face, modulus, patch_mm
        As in `gstlib.use.infer.infer_use`.
    patches : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg``, and without a registration ``wear_grade``.
    registration : pandas.DataFrame or None
        The table ``registration``.
    stated, sampling : mapping
        The fields of `gstlib.use.sampling.StatedUse` and `gstlib.use.sampling.Sampling`.
    wear_law : mapping
        The fields of `gstlib.conditions.Law`.

    Returns
    -------
    use : xarray.Dataset
        From `gstlib.use.infer.infer_use`. With losses, also ``stated_pressure`` (scanned), MPa, of
        every patch under the prior load case.
    table : pandas.DataFrame
        From `use_table`. If it rests on grades, it also has ``posterior_mean_without_curvature``,
        because the mesh is the mesh of the worn tool.
    losses : pandas.DataFrame or None
        From `predicted_losses`; None if there are grades instead of losses.
    """
    told, seed = StatedUse(**stated), sampling["seed"]
    settings = {"modulus": modulus, "patch_mm": patch_mm}
    asked: dict[str, Any] = {"stated": told, "sampling": Sampling(**sampling)}
    asked |= settings
    if registration is None:
        grades = Grades(patches.wear_grade.to_numpy(dtype=int))
        use = infer_use(face, patches, grades, **asked)
        flat = infer_use(without_curvature(face), patches, grades, **asked)
        means = use_table(flat, told).posterior_mean
        table = use_table(use, told).assign(posterior_mean_without_curvature=means)
        return use, table, None
    measured, losses = losses_of(patches, registration, Law(**wear_law))
    use = infer_use(face, measured, losses, **asked)
    if use.sizes:
        areas = with_t1(patches, registration)
        mean = told.mean[np.newaxis]
        (stated_MPa,) = use_pressures(mean, face, areas, told, **settings)
        use = use.assign_coords(scanned=list(patches.patch))
        meaning = "pressure of the patch under the prior load case"
        attrs = {"units": "MPa", "long_name": meaning}
        use["stated_pressure"] = "scanned", stated_MPa, attrs
    predicted = predicted_losses(use, losses, seed)
    return use, use_table(use, told, predicted), predicted


def losses_of(
    patches: pd.DataFrame, registration: pd.DataFrame, law: Law = ARCHARD
) -> tuple[pd.DataFrame, Losses]:
    """The patches with a known loss, and their losses.

    `patches` is the patch table and `registration` the table ``registration``. Patches with an
    excluded T1 are left out, and patches without loss count. The patches have the positions of
    their T1, because a loss refers to the area that both scans cover.
    """
    measured = registration[~registration.excluded.astype(bool)].set_index("patch")
    measured = measured.dropna(subset="mean_wear_depth_um")
    chosen = patches[patches.patch.isin(measured.index)].reset_index(drop=True)
    measured = measured.loc[chosen.patch]
    losses = Losses(
        measured.mean_wear_depth_um.to_numpy(dtype=float),
        measured.above_noise.to_numpy(dtype=bool),
        law,
    )
    return with_t1(chosen, registration), losses


def as_used(
    face: xr.Dataset, use: xr.Dataset | None, load_point: tuple[float, float] | None
) -> tuple[xr.Dataset, tuple[float, float] | None]:
    """The face and its load point: as inferred, or else as in the config.

    `face` has ``height``, ``counterface`` and ``size_mm``; `use` is from
    `gstlib.use.infer.infer_use`. The load point is the posterior mean of the centres, and the
    radius the geometric mean.
    """
    if use is None or not use.attrs["adopted"]:
        return face, load_point
    y, x, log_radius = (
        float(use.weight.values @ values)
        for values in (use.y_mm.values, use.x_mm.values, np.log(use.radius_mm.values))
    )
    point = y, x
    if np.isnan(log_radius):
        return face, point
    over = as_round_as(
        face.counterface, use.attrs["stated_radius_mm"], np.exp(log_radius)
    )
    return face.assign(counterface=over), point


def strikes_of(use: xr.Dataset, generator: np.random.Generator) -> np.ndarray:
    """Positions (x, y), mm, of one strike of each draw."""
    angle = np.radians(use.stroke_angle_deg.values)
    stroke_mm = use.stroke_mm.values * [np.sin(angle), np.cos(angle)]
    points = np.stack([use.y_mm, use.x_mm], axis=1)
    uses = Uses(points, use.scatter_mm.values, stroke_mm.T)
    return uses.strikes(generator)[:, ::-1]


def pressures_of_use(
    pressures: pd.DataFrame, use: xr.Dataset | None, *, patch_mm: float
) -> pd.DataFrame:
    """The table of pressures under a load case of many strikes.

    `patch_mm` is the side of a patch. ``force_N`` and ``pressure_MPa`` become means over the
    strikes. ``leave_one_out_MPa`` is inferred from the wear of the other patches, and
    ``stated_MPa`` is the pressure under the prior load case. Neither depends on the wear of the
    patch itself. Patches with unknown wear keep their values, and have no ``leave_one_out_MPa``. If
    no load case is adopted, the table does not change.

    Contacts of the inference yield as the stone wears, and `pressures` are before wear. So only
    differences of inferred pressures are added to them.
    """
    if use is None or not use.attrs["adopted"]:
        return pressures

    def of_patches(values: xr.DataArray) -> pd.Series:
        return pressures.patch.map(values.to_series().round(_DECIMALS))

    at_centre = (use.weight * use.pressure_at_centre).sum("draw")
    spread = (use.weight * use.pressure).sum("draw") - at_centre
    of_others = (use.weight_without * use.pressure).sum("draw") - at_centre
    mean = (pressures.pressure_MPa + of_patches(spread).fillna(0.0)).clip(lower=0.0)
    leave_one_out = (pressures.pressure_MPa + of_patches(of_others)).clip(lower=0.0)
    return pressures.assign(
        pressure_MPa=mean,
        force_N=mean * patch_mm**2,
        leave_one_out_MPa=leave_one_out,
        stated_MPa=of_patches(use.stated_pressure),
    )


def predicted_losses(use: xr.Dataset, losses: Losses, seed: int) -> pd.DataFrame:
    """Loss of each patch, as predicted by the load case inferred from the other patches.

    `use` is from `gstlib.use.infer.infer_use` with these `losses`. The result has ``patch``, the
    measured ``loss_um``, ``predicted_um``, its 95 % limits with scatter, ``low_um`` and
    ``high_um``, and the ``effective_sample_size`` of the prediction. It has no rows if nothing was
    inferred.
    """
    if not use.sizes:
        return pd.DataFrame()
    generator = np.random.default_rng([seed, 7])
    parameters = (use[name].values for name in ("wear_coefficient", "scatter", "floor"))
    of_draws = losses.expected(use.pressure.values, *parameters)
    rows = []
    for expected, width, weight in zip(
        *(each.T for each in of_draws), use.weight_without.values.T, strict=True
    ):
        drawn = generator.choice(len(weight), _PREDICTIVE, p=weight)
        deviation = generator.standard_t(4.0, _PREDICTIVE)
        loss = expected[drawn] + width[drawn] * deviation
        rows.append((weight @ expected, *np.quantile(loss, LIMITS)))
    table = pd.DataFrame(rows, columns=["predicted_um", "low_um", "high_um"])
    table.insert(0, "patch", use.patch.values)
    table.insert(1, "loss_um", losses.depth_um)
    count = use.effective_sample_size_without.values
    return table.assign(effective_sample_size=count.round()).round(_DECIMALS)


def share_within(predicted: pd.DataFrame) -> float:
    """Fraction of the losses that lie within the limits of `predicted_losses`."""
    return float(predicted.loss_um.between(predicted.low_um, predicted.high_um).mean())


def use_table(
    use: xr.Dataset, stated: StatedUse, predicted: pd.DataFrame | None = None
) -> pd.DataFrame:
    """The table ``use.csv``: prior and posterior of the load case.

    Returns
    -------
    pandas.DataFrame
        A row for each ``parameter`` with its ``unit``. ``prior`` and ``prior_error`` (of the
        logarithm of a radius) are NaN without a prior. ``posterior_mean`` (geometric for a radius)
        has the 95 % limits ``low`` and ``high``. Further rows contain ``log_score_gain`` over the
        best ``competitor``, and ``contact_error``, the error of pressures between the solved
        contacts. With `predicted` from `predicted_losses`, the row ``within_95`` contains the
        fraction of losses within the limits of the predictions from the others (posterior
        predictive check). The columns ``effective_sample_size``, ``answer``, ``competitor``, and
        ``adopted``, whether the study adopts the answer, are the same in all rows.
    """
    y, x = stated.load_point
    nothing = np.nan, np.nan
    priors = [
        ("load_point_x", "mm", x, stated.load_point_mm, "x_mm"),
        ("load_point_y", "mm", y, stated.load_point_mm, "y_mm"),
        ("scatter_of_strikes", "mm", np.nan, stated.scatter_mm, "scatter_mm"),
        ("stroke", "mm", np.nan, stated.stroke_mm, "stroke_mm"),
        ("spread", "mm", *nothing, "spread_mm"),
    ]
    if stated.radius_mm is not None:
        of_radius = stated.radius_mm, stated.radius_log_sd
        priors.append(("radius", "mm", *of_radius, "radius_mm"))
    if "wear_coefficient" in use:
        priors.append(("wear_coefficient", "um/MPa", *nothing, "wear_coefficient"))
        priors.append(("scatter_of_losses", "1", *nothing, "scatter"))
    rows = [(*prior, *_summary(use, name)) for *prior, name in priors]
    if use.sizes:
        gain, error, contact_error = (
            use.attrs[name]
            for name in ("log_score_gain", "log_score_gain_error", "contact_error")
        )
        limits = gain - 1.96 * error, gain + 1.96 * error
        rows.append(("log_score_gain", "1", *nothing, gain, *limits))
        rows.append(("contact_error", "1", *nothing, contact_error, *nothing))
    if predicted is not None and len(predicted):
        rows.append(("within_95", "1", *nothing, share_within(predicted), *nothing))
    columns = "parameter unit prior prior_error posterior_mean low high"
    return pd.DataFrame(rows, columns=columns.split()).assign(
        effective_sample_size=use.attrs["effective_sample_size"],
        answer=use.attrs["answer"],
        competitor=COMPETITORS.get(use.attrs.get("competitor", ""), ""),
        adopted=bool(use.attrs["adopted"]),
    )


def _summary(use: xr.Dataset, name: str) -> list[float]:
    """Posterior mean and limits."""
    if name not in use:
        return [np.nan] * 3
    values, weight = use[name].values, use.weight.values
    mean, *limits = mean_and_limits(values, weight)
    if name == "radius_mm":
        mean = float(np.exp(weight @ np.log(values)))
    return [mean, *limits]
