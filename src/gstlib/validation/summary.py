"""Statistics over the patches of a stone, of the predicted loss and of the effect of pressure.

Every row of the summary is a statistic with its interval, p-value, number of patches and reference
(`gstlib.validation.inference`).
"""

# ASSUME: Test for an interlayer. The test uses only points at which the loss of the bare stone is
# below detection, and the error there must be 2 % smaller. Reason: Errors of heights and loads let
# an interlayer gain a little on stones that wore without one. This test finds an interlayer on none
# of 20 such stones, and on 9 of 10 stones that wore with one (benchmarks/power.py).
# ASSUME: Choice of the best baseline. The best baseline is chosen on the patches of the comparison.
# For a claim that the baseline is better, the p-value is multiplied by the number of baselines
# (Bonferroni). Reason: This choice can only make the prediction look worse.

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.contact import Contact
from gstlib.coupling.pressures import stated, unseen
from gstlib.validation.baselines import BASELINES, ORACLE
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
    other_patches,
    own_model,
    score_patch,
    score_tables,
)
from gstlib.wear.archard import BARE, CAPPED, INTERLAYER
from gstlib.wear.fit import Prediction

__all__ = [
    "ERROR_TO_BEAT",
    "patch_statistics",
    "score_wear",
    "separated",
    "statistic_names",
    "summarise",
]

_NONE = BASELINES[0]
_PREDICTIONS = BARE, INTERLAYER, CAPPED
# Columns in which patches are expected to be the most worn. The first two are the loss as area and
# as volume, both over the measured area, because different fractions of patches overlap.
_RANKED = ["loss_fraction", "mean_wear_depth_um", "predicted_loss_um", "pressure_MPa"]
_RANKED += ["contact_fraction"]
# An interlayer is detected if its error out of contact is below this fraction of the bare stone's.
ERROR_TO_BEAT = 0.98

# Model, statistic, the numbers of its `Estimate`, and against what it is.
_Row = tuple[Any, ...]


def summarise(
    patches: pd.DataFrame,
    wear: pd.DataFrame,
    nulls: Mapping[str, np.ndarray],
    interlayer: xr.Dataset | None,
    *,
    seed: int | Sequence[int],
    resamples: int,
    expected_most_worn: Sequence[str] = (),
) -> pd.DataFrame:
    """The table ``validation_summary.csv``.

    Parameters
    ----------
    patches : pandas.DataFrame
        From `patch_statistics`.
    wear : pandas.DataFrame
        The table ``wear`` of `gstlib.validation.scoring.score_tables`.
    nulls : mapping of str to ndarray
        From `gstlib.validation.scoring.by_chance`.
    interlayer : xarray.Dataset or None
        From `gstlib.wear.interlayer.fit_interlayer`; None without an interlayer.
    seed, resamples : int
        Seed of the intervals and permutations; number of bootstrap samples of patches.
    expected_most_worn : sequence of str
        Patches that were expected, before the analysis, to be the most worn.

    Returns
    -------
    pandas.DataFrame
        ``model, statistic, x, y, value, low, high, p_value, n, against``, with 95 % intervals, over
        the patches that are in the statistics; a statistic of x and y is named ``f(x, y)`` here.
        Each prediction has ``mean(mcc)`` and ``mean(attainable_mcc)``. Against the best baseline,
        it has ``gain(mcc)``, a mean difference, and ``relative(volume_error)`` and
        ``relative_to_best(map_error)``, ratios of summed absolute errors. All models have
        ``mean(mcc)`` and, against no loss, ``relative(map_error)``. Two-sided tests exchange the
        two patch by patch. ``tested_mean(mcc)`` is the mean over the patches with a test against
        chance, compared one-sided with the predictions of other patches. ``spearman(a, b)`` is a
        rank correlation over patches. One relates the pressure under the prior load case to the
        lost area. The other relates the fact that this load case touches a patch (``touched``) to
        the lost volume, also of patches outside the study. ``expected_most_worn(5+8, column)``:
        fraction of these patches among the equally many largest (a tie counts against it), with the
        p-value of a random ranking. With an interlayer, ``interlayer_ratio`` is its coefficient
        over the bare stone's. ``relative(out_of_contact)`` is its error over 98 % of the bare
        stone's, at points where the bare stone's loss is below detection.
    """
    draws = Draws(np.random.default_rng(seed), resamples)
    in_statistics = patches[patches.in_statistics]
    rows: list[_Row] = []
    scored = wear[wear.patch.isin(in_statistics.patch)] if len(wear) else wear
    if len(scored):
        by_patch = scored.pivot(index="patch", columns="model")
        by_patch = by_patch.loc[scored.patch.unique()]
        rows += _model_rows(by_patch, draws)
        tested = [nulls[patch] for patch in in_statistics.patch if patch in nulls]
        rows.append(_chance_row(own_model([*scored.model]), tested, draws))
        if interlayer is not None:
            rows += _interlayer_rows(by_patch.out_of_contact_um, interlayer, draws)
    rows.append(_correlation(in_statistics, "pressure_MPa", "loss_fraction", draws))
    above_noise = patches[patches.above_noise]
    rows.append(_correlation(above_noise, "touched", "mean_wear_depth_um", draws))
    if expected_most_worn:
        rows += [_worst(in_statistics, expected_most_worn, name) for name in _RANKED]
    if len(scored):  # last: the draws of the others stay as they were
        errors = by_patch.map_error_um
        for model in [name for name in _PREDICTIONS if name in errors]:
            relative = _relative_to_best(errors, model, draws)
            rows.append((model, "relative_to_best(map_error)", *relative))
    columns = ["model", "statistic", *Estimate._fields, "against"]
    return separated(pd.DataFrame(rows, columns=columns))


def separated(summary: pd.DataFrame) -> pd.DataFrame:
    """The table with ``statistic``, ``x`` and ``y`` instead of statistics such as ``f(x, y)``.

    Examples
    --------
    >>> row = pd.DataFrame({"statistic": ["spearman(pressure_MPa, loss_fraction)"], "value": [0.9]})
    >>> separated(row)[["statistic", "x", "y"]].iloc[0].tolist()
    ['spearman', 'pressure_MPa', 'loss_fraction']
    """
    pattern = r"^(?P<statistic>[^(]+)(?:\((?P<x>[^,]+)(?:, (?P<y>.+))?\))?$"
    parts = summary.statistic.str.extract(pattern).fillna("")
    columns = [*summary]
    after = columns.index("statistic") + 1
    columns[after:after] = ["x", "y"]
    return summary.assign(**parts)[columns]


def statistic_names(summary: pd.DataFrame) -> pd.Series:
    """The statistic of each row with its arguments, such as ``mean(mcc)``, from `separated`.

    Examples
    --------
    >>> statistic_names(pd.DataFrame({"statistic": ["mean"], "x": ["mcc"], "y": [np.nan]})).tolist()
    ['mean(mcc)']
    """
    parts = summary[["statistic", "x", "y"]].astype(object).fillna("")
    arguments = (parts.x + ", " + parts.y).str.removesuffix(", ")
    names = parts.statistic + "(" + arguments + ")"
    return names.str.removesuffix("()").rename("statistic")


def patch_statistics(
    patches: pd.DataFrame, registration: pd.DataFrame, pressures: pd.DataFrame
) -> pd.DataFrame:
    """Predicted and measured values of each patch, for `summarise`.

    The tables are ``validation_patches``, ``registration`` and ``patch_pressures``. There is a row
    for each patch with a known change, even without a predicted loss. Pressures belong to the prior
    load case, because the wear influences the pressures of an inferred one.
    """
    of_use = stated(pressures)
    table = pressures[["patch", "x_mm", "y_mm", "in_study"]].assign(
        pressure_MPa=of_use,
        touched=(of_use > 0).astype(float),
        unseen_MPa=unseen(pressures),
    )
    measured = registration[registration.known_fraction > 0].set_index("patch")
    measured = measured[["loss_fraction", "mean_wear_depth_um", "above_noise"]]
    predicted = patches.reindex(
        columns=["patch", "contact_fraction", "predicted_loss_um"]
    ).set_index("patch")
    table = table.set_index("patch").join(measured, how="inner").join(predicted)
    table["above_noise"] = table.above_noise.astype(bool)
    table["in_statistics"] = table.above_noise & table.in_study.astype(bool)
    return table.reset_index()


def _model_rows(by_patch: pd.DataFrame, draws: Draws) -> Iterator[_Row]:
    """Scores of the predictions, beside their baselines, by patch and model."""
    # Without a loss, no position is right or wrong, for all models alike.
    mcc, attainable = by_patch.mcc.dropna(), by_patch.attainable_mcc.dropna()
    map_error = by_patch.map_error_um
    volume = (by_patch.predicted_volume_um3 - by_patch.measured_volume_um3).abs()
    best = str(mcc[[*BASELINES[1:]]].mean().idxmax()) if len(mcc) else ""
    for model in (*_PREDICTIONS, *BASELINES, ORACLE):
        if model not in mcc:
            continue
        yield model, "mean(mcc)", *mean_of(mcc[model], draws), ""
        if model in _PREDICTIONS:
            reached = mean_of(attainable[model], draws)
            yield model, "mean(attainable_mcc)", *reached, "any mask of its area"
            gain = mcc[model] - mcc[best or model]
            p = _against_best(gain, draws)
            yield model, "gain(mcc)", *mean_of(gain, draws, p), best
        if model != _NONE:
            relative = _relative(map_error[model], map_error[_NONE], draws)
            yield model, "relative(map_error)", *relative, _NONE
        if model in _PREDICTIONS:
            of_volume = _relative_to_best(volume, model, draws)
            yield model, "relative(volume_error)", *of_volume


def _relative(error: pd.Series, other: pd.Series, draws: Draws) -> Estimate:
    """Summed errors (patches,) over the summed errors of another model, and its test."""
    p = exchange_p_value(other - error, draws.generator)
    return ratio_of_sums(error, other, draws, p)


def _relative_to_best(errors: pd.DataFrame, model: str, draws: Draws) -> _Row:
    """Summed errors (patches, models) of a model over the best baseline's, and its name."""
    best = str(errors[[*BASELINES]].sum().idxmin())
    p = _against_best(errors[best] - errors[model], draws)
    return *ratio_of_sums(errors[model], errors[best], draws, p), best


def _against_best(gain: pd.Series, draws: Draws) -> float:
    """Two-sided test of a mean gain over the best of the baselines."""
    p = exchange_p_value(gain, draws.generator)
    if gain.empty or gain.mean() > 0:
        return p
    return float(np.minimum(1.0, len(BASELINES) * p))  # NaN where nothing is tested


def _chance_row(own: str, nulls: Sequence[np.ndarray], draws: Draws) -> _Row:
    """The mean MCC against the mean MCC by chance, over the patches with a test against chance.

    A draw takes one random prediction for each patch. A single patch is not tested by itself.
    """
    values = np.array([null[0] for null in nulls])
    p = math.nan
    if len(nulls) > 1:
        drawn = [draws.generator.choice(null[1:], draws.resamples) for null in nulls]
        p = p_value(float(values.mean()), np.mean(drawn, axis=0))
    mean = mean_of(values, draws, p)
    return own, "tested_mean(mcc)", *mean, "other patches' predictions"


def _interlayer_rows(
    errors: pd.DataFrame, interlayer: xr.Dataset, draws: Draws
) -> Iterator[_Row]:
    """Whether there was an interlayer between the stones, and its part of the wear.

    `errors` (patches, models) are out of contact; NaN where the contact is everywhere.
    """
    error = errors.fillna(0.0)
    relative = _relative(error[INTERLAYER], ERROR_TO_BEAT * error[BARE], draws)
    yield INTERLAYER, "relative(out_of_contact)", *relative, BARE
    misfit = interlayer.misfit.transpose("patch", "ratio").values
    drawn = draws.generator.integers(0, len(misfit), (draws.resamples, len(misfit)))
    samples = interlayer.ratio.values[misfit[drawn].sum(axis=1).argmin(axis=1)]
    interval = percentile_interval(samples, len(misfit))
    value = float(interlayer.ratio_of_all)
    estimate = value, *interval, math.nan, len(misfit)
    yield INTERLAYER, "interlayer_ratio", *estimate, ""


def _correlation(
    table: pd.DataFrame, predictor: str, extent: str, draws: Draws
) -> _Row:
    estimate = rank_correlation(table, predictor, extent, draws)
    against = "other pairings, neighbours alike"
    return "", f"spearman({predictor}, {extent})", *estimate, against


def _worst(table: pd.DataFrame, expected: Sequence[str], column: str) -> _Row:
    """Fraction of expected patches among the equally many largest; NaN if a value is missing."""
    values = table.set_index("patch")[column].dropna()
    ranks = values.astype(float).rank(ascending=False, method="max")
    of_expected = ranks[ranks.index.isin(expected)]
    share = p = math.nan
    count = len(expected)
    if len(of_expected) == count:
        within = int((of_expected <= count).sum())
        share = within / count
        p = float(scipy.stats.hypergeom.sf(within - 1, len(values), count, count))
    name = f"expected_most_worn({'+'.join(expected)}, {column})"
    return "", name, share, math.nan, math.nan, p, len(values), "random ranking"


def score_wear(
    contacts: Mapping[str, Contact],
    changes: Mapping[str, xr.Dataset],
    prediction: Prediction,
    pressures: pd.DataFrame,
    registration: pd.DataFrame,
    *,
    expected_most_worn: Sequence[str] = (),
    seed: int | Sequence[int],
    resamples: int,
) -> dict[str, pd.DataFrame]:
    """Score the predicted loss of each patch against the measured loss, beside fair baselines.

    Parameters
    ----------
    contacts, changes : mapping
        Contact before use and height change, by patch.
    prediction : Prediction
    pressures, registration : pandas.DataFrame
        The tables ``patch_pressures`` and ``registration``.
    expected_most_worn : sequence of str
        Patches that were expected, before the analysis, to be the most worn.
    seed, resamples : int
        Seed of the intervals and permutations; number of bootstrap samples of patches.

    Returns
    -------
    dict of pandas.DataFrame
        ``patches`` and ``wear``, with a row for each patch with a known change and for each of its
        models; ``profile``; and ``summary``, over the patches in the study whose loss is above the
        noise.

    Examples
    --------
    Without a predicted loss, the pressure is compared with the lost area:

    >>> import gstlib
    >>> pressures = pd.DataFrame({"patch": [*"abcdef"], "x_mm": range(6), "y_mm": 0.0})
    >>> pressures = pressures.assign(in_study=True, pressure_MPa=[1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    >>> losses = pressures[["patch"]].assign(known_fraction=1.0, above_noise=True)
    >>> losses["loss_fraction"] = losses["mean_wear_depth_um"] = [0.1, 0.2, 0.3, 0.5, 0.4, 0.6]
    >>> nothing = Prediction({})
    >>> tables = gstlib.score_wear({}, {}, nothing, pressures, losses, seed=1, resamples=99)
    >>> tables["summary"].set_index("x").value.round(2).to_dict()
    {'pressure_MPa': 0.94, 'touched': nan}
    """
    measured = patch_statistics(pd.DataFrame(), registration, pressures)
    scores = []
    if prediction.depths:
        fitted_to = prediction.fitted_to
        others = other_patches(pressures, registration, fitted_to, contacts, changes)
        scores = [
            score_patch(
                row.patch,
                contacts[row.patch],
                changes[row.patch],
                prediction.depths[row.patch],
                others,
                pressure_MPa=row.unseen_MPa,
                above_noise=row.above_noise,
                in_statistics=row.in_statistics,
            )
            for row in measured.itertuples()
        ]
    tables = score_tables(scores)
    tables["summary"] = summarise(
        patch_statistics(tables["patches"], registration, pressures),
        tables["wear"],
        by_chance(scores),
        prediction.interlayer,
        seed=seed,
        resamples=resamples,
        expected_most_worn=expected_most_worn,
    )
    return tables
