"""Over the patches of a stone: is the predicted loss right, and does what presses harder wear more?

Every row of the summary is a statistic with its interval, its p-value, the number of patches, and
what it is compared with (`gstlib.validation.inference`).
"""

# ASSUME: the mat is tested only where the bare stone's loss is below detection, and its error there
# must be 2 % smaller: errors of heights and loads let a mat gain a little on stones that never saw
# one. So tested, none of 20 such stones is said to have had one, and all of 10 that had
# (benchmarks/power.py).
# ASSUME: the best rival is chosen on the patches on which it is compared. That can only make the
# prediction look worse; a claim that the rival is better has its p-value multiplied by the number
# of rivals (Bonferroni).

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.contact import Contact
from gstlib.validation.baselines import CEILING, RIVALS
from gstlib.validation.inference import (
    Draws,
    Estimate,
    exchange_p_value,
    mean_of,
    percentile_interval,
    rank_correlation,
    ratio_of_sums,
)
from gstlib.validation.nulls import p_value
from gstlib.validation.scoring import (
    by_chance,
    judge_patch,
    judged_tables,
    other_patches,
    own_model,
)
from gstlib.wear.archard import BARE, MAT, YIELDING

__all__ = ["judge_wear", "patch_statistics", "summarise"]

_NONE = RIVALS[0]
# What a patch lost, as area and as volume, both over the area measured: patches overlap to
# different shares.
_EXTENTS = "loss_fraction", "loss_per_area_um"
# A mat is detected if its error out of contact is below this share of the bare stone's.
_ERROR_TO_BEAT = 0.98

# model, statistic, estimate, against
_Row = tuple[str, str, Estimate, str]


def summarise(
    patches: pd.DataFrame,
    wear: pd.DataFrame,
    nulls: Mapping[str, np.ndarray],
    mat: xr.Dataset | None,
    *,
    seed: int | Sequence[int],
    resamples: int,
    expected_worst: Sequence[str] = (),
) -> pd.DataFrame:
    """The table ``validation_summary.csv``.

    Parameters
    ----------
    patches : pandas.DataFrame
        From `patch_statistics`.
    wear : pandas.DataFrame
        The table ``wear`` of `gstlib.validation.scoring.judged_tables`.
    nulls : mapping of str to ndarray
        From `gstlib.validation.scoring.by_chance`.
    mat : xarray.Dataset or None
        From `gstlib.wear.interlayer.fit_mat`; None without a mat.
    seed, resamples : int
        Of the intervals and permutations; bootstrap samples of patches.
    expected_worst : sequence of str
        Patches stated beforehand to be the worst worn.

    Returns
    -------
    pandas.DataFrame
        ``model, statistic, value, low, high, p_value, n, against``, with 95 % intervals, over the
        patches that are counted. Of each prediction ``mean(mcc)``, ``mean(attainable_mcc)``, and
        against the best rival ``gain(mcc)``, a mean difference, and ``relative(volume_error)``, a
        ratio of summed absolute errors; of all models ``mean(mcc)`` and, against no loss,
        ``relative(map_error)``. Two-sided tests exchange the two patch by patch.
        ``tested_mean(mcc)``: over the patches on which chance can be tested, against the
        predictions of other patches, one-sided. ``spearman(a, b)``: rank correlation over
        patches of pressure with the lost area, and of whether a patch bears any pressure
        (``touched``) with the lost volume; the latter of patches in and out of the study.
        ``expected_worst(5+8, column)``: share of these patches among the equally many largest (a
        tie counts against it), with the p-value of a random ranking. With a mat ``mat_ratio``, its
        coefficient over that of the bare stone, and ``relative(out_of_contact)``, its error over
        98 % of the bare stone's where that takes off less than is detected.
    """
    draws = Draws(np.random.default_rng(seed), resamples)
    counted = patches[patches.counted]
    rows: list[_Row] = []
    judged = wear[wear.patch.isin(counted.patch)] if len(wear) else wear
    if len(judged):
        rows += _model_rows(judged, draws)
        tested = [nulls[patch] for patch in counted.patch if patch in nulls]
        rows.append(_chance_row(own_model(list(judged.model)), tested, draws))
        if mat is not None:
            rows += _mat_rows(judged, mat, draws)
    rows.append(_correlation(counted, "pressure_MPa", "loss_fraction", draws))
    believed = patches[patches.believed]
    rows.append(_correlation(believed, "touched", "loss_per_area_um", draws))
    if expected_worst:
        columns = [*_EXTENTS, "predicted_loss_um", "pressure_MPa", "contact_fraction"]
        rows += [_worst(counted, expected_worst, column) for column in columns]
    named = [
        {"model": model, "statistic": name, **estimate._asdict(), "against": against}
        for model, name, estimate, against in rows
    ]
    return pd.DataFrame(named)


def patch_statistics(
    patches: pd.DataFrame, registration: pd.DataFrame, pressures: pd.DataFrame
) -> pd.DataFrame:
    """What is predicted and measured of each patch, as `summarise` takes it.

    The tables are ``validation_patches``, ``registration`` and ``patch_pressures``. A row for each
    patch with a known change, also where no loss is predicted.
    """
    of_registration = ["patch", "loss_fraction", "loss_per_area_um", "believed"]
    measured = registration.loc[registration.known_share > 0, of_registration]
    where = pressures[["patch", "x_mm", "y_mm", "pressure_MPa", "in_study"]]
    predicted = patches.reindex(columns=["patch", "contact_fraction", "predicted_loss_um"])
    table = where.merge(measured, on="patch").merge(predicted, on="patch", how="left")
    table["touched"] = (table.pressure_MPa > 0).astype(float)
    table["believed"] = table.believed.astype(bool)
    table["counted"] = table.believed & table.in_study.astype(bool)
    return table


def _model_rows(judged: pd.DataFrame, draws: Draws) -> Iterator[_Row]:
    """How right the predictions are, beside their rivals."""
    order = list(dict.fromkeys(judged.patch))
    volume_error = (judged.predicted_volume_um3 - judged.measured_volume_um3).abs()
    mcc, attainable, map_error, volume = (
        judged.assign(volume_error=volume_error)
        .pivot(index="patch", columns="model", values=name)
        .loc[order]
        for name in ("mcc", "attainable_mcc", "map_error_um", "volume_error")
    )
    # no place is right or wrong where nothing was lost: so it is for all models alike
    mcc, attainable = mcc.dropna(), attainable.dropna()
    rivals = [name for name in RIVALS if name != _NONE]
    for model in (BARE, MAT, YIELDING, *RIVALS, CEILING):
        if model not in mcc:
            continue
        yield model, "mean(mcc)", mean_of(mcc[model].to_numpy(), draws), ""
        if model in (BARE, MAT, YIELDING):
            reached = mean_of(attainable[model].to_numpy(), draws)
            yield model, "mean(attainable_mcc)", reached, "any mask of its area"
            best = str(mcc[rivals].mean().idxmax()) if len(mcc) else ""
            gain = (mcc[model] - mcc[best]).to_numpy() if best else np.zeros(0)
            p = _against_best(gain, draws)
            yield model, "gain(mcc)", mean_of(gain, draws, p), best
        if model != _NONE:
            errors = map_error[model].to_numpy(), map_error[_NONE].to_numpy()
            p = exchange_p_value(errors[1] - errors[0], draws.generator)
            yield model, "relative(map_error)", ratio_of_sums(*errors, draws, p), _NONE
        if model in (BARE, MAT, YIELDING):
            best = str(volume[list(RIVALS)].sum().idxmin())
            errors = volume[model].to_numpy(), volume[best].to_numpy()
            p = _against_best(errors[1] - errors[0], draws)
            yield model, "relative(volume_error)", ratio_of_sums(*errors, draws, p), best


def _against_best(gain: np.ndarray, draws: Draws) -> float:
    """Two-sided test of a mean gain over the best of the rivals."""
    p = exchange_p_value(gain, draws.generator)
    return p if not gain.size or gain.mean() > 0 else min(1.0, len(RIVALS) * p)


def _chance_row(own: str, nulls: Sequence[np.ndarray], draws: Draws) -> _Row:
    """The mean MCC against that by chance, over the patches on which chance can be tested.

    A draw takes one prediction at random for each patch.
    """
    values = np.array([null[0] for null in nulls])
    p = math.nan
    if nulls:
        drawn = [draws.generator.choice(null[1:], draws.resamples) for null in nulls]
        p = p_value(float(values.mean()), np.mean(drawn, axis=0))
    return own, "tested_mean(mcc)", mean_of(values, draws, p), "other patches' predictions"


def _mat_rows(judged: pd.DataFrame, mat: xr.Dataset, draws: Draws) -> Iterator[_Row]:
    """Whether there was a mat between the stones, and how much of the wear it did."""
    order = list(dict.fromkeys(judged.patch))
    error = judged.pivot(index="patch", columns="model", values="out_of_contact_um")
    error = error.loc[order].fillna(0.0)
    errors = error[MAT].to_numpy(), _ERROR_TO_BEAT * error[BARE].to_numpy()
    p = exchange_p_value(errors[1] - errors[0], draws.generator)
    yield MAT, "relative(out_of_contact)", ratio_of_sums(*errors, draws, p), BARE
    misfit = mat.misfit.transpose("patch", "ratio").values
    drawn = draws.generator.integers(0, len(misfit), (draws.resamples, len(misfit)))
    samples = mat.ratio.values[misfit[drawn].sum(axis=1).argmin(axis=1)]
    interval = percentile_interval(samples, len(misfit))
    estimate = Estimate(float(mat.ratio_of_all), *interval, math.nan, len(misfit))
    yield MAT, "mat_ratio", estimate, ""


def _correlation(table: pd.DataFrame, predictor: str, extent: str, draws: Draws) -> _Row:
    estimate = rank_correlation(table, predictor, extent, draws)
    against = "other pairings, neighbours alike"
    return "", f"spearman({predictor}, {extent})", estimate, against


def _worst(table: pd.DataFrame, expected: Sequence[str], column: str) -> _Row:
    """Share of the expected patches among the equally many largest; NaN if one has no value."""
    known = table.set_index("patch")[column].dropna()
    share = p = math.nan
    if known.index.isin(expected).sum() == len(expected):
        ranks = scipy.stats.rankdata(-known.to_numpy(dtype=float), method="max")
        within = int((ranks[known.index.isin(expected)] <= len(expected)).sum())
        share = within / len(expected)
        p = float(
            scipy.stats.hypergeom.sf(within - 1, len(known), len(expected), len(expected))
        )
    name = f"expected_worst({'+'.join(expected)}, {column})"
    return "", name, Estimate(share, math.nan, math.nan, p, len(known)), "random ranking"


def judge_wear(
    contacts: Mapping[str, Contact],
    changes: Mapping[str, xr.Dataset],
    predicted: Mapping[str, xr.Dataset],
    pressures: pd.DataFrame,
    registration: pd.DataFrame,
    *,
    fitted_to: Sequence[str],
    mat: xr.Dataset | None = None,
    expected_worst: Sequence[str] = (),
    seed: int | Sequence[int],
    resamples: int,
) -> dict[str, pd.DataFrame]:
    """Judge the loss that is predicted of each patch by the measured one, beside fair rivals.

    Parameters
    ----------
    contacts, changes, predicted : mapping
        By patch: contact before use, height change, and the result of `gstlib.wear.fit.wear_map`,
        of which there are none where no wear is predicted.
    pressures, registration : pandas.DataFrame
        The tables ``patch_pressures`` and ``registration``.
    fitted_to : sequence of str
        Patches whose losses the prediction is fitted to.
    mat : xarray.Dataset, optional
        From `gstlib.wear.interlayer.fit_mat`.
    expected_worst : sequence of str
        Patches that were said beforehand to be the worst worn.
    seed, resamples : int
        Of the intervals and permutations; bootstrap samples of patches.

    Returns
    -------
    dict of pandas.DataFrame
        ``patches`` and ``wear``, with a row for each patch with a known change and for each of its
        models; ``profile``; and ``summary``, over the patches in the study whose loss is believed.
    """
    known = registration[registration.known_share > 0].set_index("patch")
    at = pressures.set_index("patch").join(known.believed, how="inner")
    found = []
    if predicted:
        others = other_patches(pressures, registration, fitted_to, contacts, changes)
        for patch in at.index:
            found.append(
                judge_patch(
                    patch,
                    contacts[patch],
                    changes[patch],
                    predicted[patch],
                    others,
                    pressure_MPa=float(at.pressure_MPa[patch]),
                    believed=bool(at.believed[patch]),
                )
            )
    nulls = by_chance(found)
    counted = (at.in_study.astype(bool) & at.believed.astype(bool)).to_dict()
    tables = judged_tables(found, nulls, counted)
    statistics = patch_statistics(tables["patches"], registration, pressures)
    tables["summary"] = summarise(
        statistics,
        tables["wear"],
        nulls,
        mat,
        seed=seed,
        resamples=resamples,
        expected_worst=expected_worst,
    )
    return tables
