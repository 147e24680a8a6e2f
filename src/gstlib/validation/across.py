"""Over the patches of a stone: do harder pressed ones wear more, and is the prediction worth it?

Patches are the units here: intervals draw patches, tests exchange them. Every row of the summary
is a statistic with its interval, its p-value, the number of patches, and what it is held against.
"""

import math
from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.stats import hypergeom, permutation_test, rankdata

from gstlib.validation.intervals import percentile_interval
from gstlib.validation.neighbours import neighbours_p_value
from gstlib.validation.nulls import p_value
from gstlib.validation.scores import SCORES

__all__ = [
    "EXTENTS",
    "PREDICTORS",
    "SUMMARY_COLUMNS",
    "expected_worst",
    "mean_gains",
    "mean_recalls",
    "mean_scores",
    "rank_correlations",
]

SUMMARY_COLUMNS = ["statistic", "value", "low", "high", "p_value", "n", "against"]
PREDICTORS = "pressure_MPa", "contact_fraction", "stiffness_MPa_per_um"
# Area and volume of the traces, both over the area seen: patches overlap to different shares.
EXTENTS = "loss_fraction", "loss_per_area_um"

# Up to this many patches all pairings are tried (8! = 40320), beyond it a random sample of them;
# all signs of a difference up to 13 (2¹³ = 8192).
_EXACT_UP_TO = 8
_RANDOM = 9999


def rank_correlations(
    table: pd.DataFrame,
    *,
    generator: np.random.Generator,
    predictors: Sequence[str] = PREDICTORS,
    extents: Sequence[str] = EXTENTS,
    places: Sequence[str] | None = None,
    resamples: int = 2000,
) -> pd.DataFrame:
    """Rank correlations over patches of each predictor with each extent of the traces.

    Parameters
    ----------
    table : pandas.DataFrame
        One row per patch; rows with a missing value are left out of that pair.
    generator : numpy.random.Generator
        Source of chance for the interval and, above 8 patches, for the p-value.
    predictors, extents : sequences of str
        Columns to pair.
    places : (str, str), optional
        Columns of the patches' x and y: Spearman's p-value then allows for neighbouring patches
        being alike (`gstlib.validation.neighbours`).
    resamples : int
        Bootstrap samples of patches.

    Returns
    -------
    pandas.DataFrame
        `SUMMARY_COLUMNS`: ``spearman(predictor, extent)`` and ``kendall(predictor, extent)``
        (τ_b), 95 % bootstrap over patches, two-sided permutation test (every pairing up to 8
        patches, 9999 random ones beyond). NaN with fewer than 3 patches or a constant column.
    """
    rows = []
    for predictor in predictors:
        for extent in extents:
            both = table[[predictor, extent, *(places or ())]].dropna()
            x, y, *where = both.to_numpy(dtype=float).T
            for name, features in (("spearman", _centred_ranks), ("kendall", _pair_signs)):
                *found, p = _association(x, y, features, generator, resamples)
                against = "other pairings"
                if where and name == "spearman":
                    p = neighbours_p_value(x, y, np.transpose(where), exchanged=p)
                    against += ", neighbours alike"
                rows.append((f"{name}({predictor}, {extent})", *found, p, len(both), against))
    return pd.DataFrame(rows, columns=SUMMARY_COLUMNS)


def mean_scores(
    gains: pd.DataFrame,
    nulls: Sequence[dict[str, np.ndarray]],
    *,
    generator: np.random.Generator,
    resamples: int,
) -> pd.DataFrame:
    """Mean over patches of each score, against the means of shifted predictions.

    Parameters
    ----------
    gains : pandas.DataFrame
        ``score, value, p_value`` for every patch and score.
    nulls : sequence of dict
        For each patch, in the same order, as from `gstlib.validation.gains.null_scores`: its
        shifts are its own, so that the i-th of all patches together are one draw.
    generator : numpy.random.Generator
        Source of chance for the interval.
    resamples : int
        Bootstrap samples of patches.

    Returns
    -------
    pandas.DataFrame
        `SUMMARY_COLUMNS`: ``mean(score)``, one-sided p-value. Patches where the score is not
        defined, or chance not tested, are left out.
    """
    rows = []
    for score in SCORES:
        of_score = gains[gains["score"] == score]
        values = of_score["value"].to_numpy(dtype=float)
        known = of_score["p_value"].notna().to_numpy()
        low, high, p = math.nan, math.nan, math.nan
        if known.any():
            low, high = _interval_of_mean(values[known], generator, resamples)
            drawn = [null[score] for null, use in zip(nulls, known, strict=True) if use]
            # a patch of few elements has fewer shifts than the others: no more draws than it has
            length = min(len(one) for one in drawn)
            means = np.mean([one[:length] for one in drawn], axis=0)
            p = p_value(float(means[0]), means[1:])
        value = float(values[known].mean()) if known.any() else math.nan
        rows.append((f"mean({score})", value, low, high, p, int(known.sum()), "shifts"))
    return pd.DataFrame(rows, columns=SUMMARY_COLUMNS)


def mean_gains(
    scores: pd.DataFrame,
    rivals: Sequence[str],
    *,
    generator: np.random.Generator,
    resamples: int,
) -> pd.DataFrame:
    """Mean over patches of each score less that of the rival with the best mean.

    One rival stands for all patches, as one would have to choose it beforehand. It is chosen on
    these patches, which makes the gain look smaller, never larger. Precision, recall, F1, IoU and
    the fractions skill depend on how much is marked, also by chance: against ``rigid``, whose area
    is not that of the contact, their gain compares areas as well as places. MCC and the rank scores
    do not.

    Parameters
    ----------
    scores : pandas.DataFrame
        One row per patch, with the columns of `gstlib.validation.comparison.score_patch`.
    rivals : sequence of str
        Their names.
    generator : numpy.random.Generator
        Source of chance for the interval and, above 13 patches, for the p-value.
    resamples : int
        Bootstrap samples of patches.

    Returns
    -------
    pandas.DataFrame
        `SUMMARY_COLUMNS`: ``gain(score)``, 95 % bootstrap over patches, two-sided test that
        exchanges model and rival patch by patch; ``against`` names the rival.
    """
    rows = []
    for score in SCORES:
        columns = [f"{name}_{score}" for name in rivals if f"{name}_{score}" in scores]
        known = scores[[score, *columns]].dropna()
        if known.empty or not columns:
            rows.append((f"gain({score})", *[math.nan] * 4, 0, ""))
            continue
        best = known[columns].mean().idxmax()
        gain = (known[score] - known[best]).to_numpy(dtype=float)
        low, high = _interval_of_mean(gain, generator, resamples)
        p = _sign_test(gain, generator)
        against = best.removesuffix(f"_{score}")
        rows.append((f"gain({score})", float(gain.mean()), low, high, p, len(gain), against))
    return pd.DataFrame(rows, columns=SUMMARY_COLUMNS)


def mean_recalls(
    failures: pd.DataFrame, *, generator: np.random.Generator, resamples: int
) -> pd.DataFrame:
    """Mean over patches of the recall in each height band, and of the loss that lies at each gap.

    Parameters
    ----------
    failures : pandas.DataFrame
        ``patch, split, band, loss_share, recall``.
    generator : numpy.random.Generator
        Source of chance for the interval.
    resamples : int
        Bootstrap samples of patches.

    Returns
    -------
    pandas.DataFrame
        `SUMMARY_COLUMNS`: ``recall(height band)``, ``loss_share(height band)`` and
        ``loss_share(gap band)``, without p-value.
    """
    rows = []
    for (split, band), group in failures.groupby(["split", "band"], sort=False):
        # by gap, recall is 1 in contact and 0 out of it
        for quantity in ("loss_share", "recall") if split == "height" else ("loss_share",):
            known = group[quantity].dropna().to_numpy(dtype=float)
            low, high = _interval_of_mean(known, generator, resamples)
            value = float(known.mean()) if known.size else math.nan
            name = f"{quantity}({split} {band})"
            rows.append((name, value, low, high, math.nan, known.size, ""))
    return pd.DataFrame(rows, columns=SUMMARY_COLUMNS)


def expected_worst(
    table: pd.DataFrame, expected: Sequence[str], columns: Sequence[str]
) -> pd.DataFrame:
    """Are the patches that were said to be the worst the worst?

    Parameters
    ----------
    table : pandas.DataFrame
        One row per patch, with its id as ``patch``.
    expected : sequence of str
        The patches said to be the worst, k of them.
    columns : sequence of str
        By what: for each, the share of `expected` among the k largest; a tie counts against it.

    Returns
    -------
    pandas.DataFrame
        `SUMMARY_COLUMNS`: ``expected_worst(5+8, column)``; the p-value is exact, that a random
        ranking has as many of them among its k largest. No value if one of them is not in the
        table or its value is missing; no rows if none is expected.
    """
    rows = []
    for column in columns if expected else ():
        known = table.set_index("patch")[column].dropna()
        name = f"expected_worst({'+'.join(expected)}, {column})"
        value = p = math.nan
        if known.index.isin(expected).sum() == len(expected):
            ranks = rankdata(-known.to_numpy(dtype=float), method="max")
            within = int((ranks[known.index.isin(expected)] <= len(expected)).sum())
            value = within / len(expected)
            p = float(hypergeom.sf(within - 1, len(known), len(expected), len(expected)))
        rows.append((name, value, math.nan, math.nan, p, len(known), "random ranking"))
    return pd.DataFrame(rows, columns=SUMMARY_COLUMNS)


def _association(
    x: np.ndarray, y: np.ndarray, features, generator: np.random.Generator, resamples: int
) -> tuple[float, float, float, float]:
    """A rank correlation, its bootstrap interval and its permutation p-value.

    `features` turns values (..., n) into vectors (..., m) whose cosine is the correlation.
    """
    if x.size < 3 or np.ptp(x) == 0 or np.ptp(y) == 0:
        return (math.nan,) * 4
    of_y = features(y)
    test = permutation_test(
        (x,),
        lambda shuffled, axis: _cosine(features(shuffled), of_y),
        permutation_type="pairings",
        n_resamples=math.factorial(_EXACT_UP_TO) if x.size <= _EXACT_UP_TO else _RANDOM,
        vectorized=True,
        rng=generator,
    )
    drawn = generator.integers(0, x.size, (resamples, x.size))
    # a draw of one patch over and over has no correlation
    low, high = percentile_interval(_cosine(features(x[drawn]), features(y[drawn])), x.size)
    return float(_cosine(features(x), of_y)), low, high, float(test.pvalue)


def _centred_ranks(values: np.ndarray) -> np.ndarray:
    return rankdata(values, axis=-1) - (values.shape[-1] + 1) / 2


def _pair_signs(values: np.ndarray) -> np.ndarray:
    first, second = np.triu_indices(values.shape[-1], 1)
    return np.sign(values[..., first] - values[..., second])


def _cosine(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cosine along the last axis; NaN where one of them is 0."""
    scale = np.sqrt((a * a).sum(axis=-1) * (b * b).sum(axis=-1))
    product = (a * b).sum(axis=-1)
    return np.divide(product, scale, out=np.full(np.shape(product), np.nan), where=scale > 0)


def _interval_of_mean(
    values: np.ndarray, generator: np.random.Generator, resamples: int
) -> tuple[float, float]:
    if values.size < 2:
        return math.nan, math.nan
    drawn = generator.integers(0, values.size, (resamples, values.size))
    return percentile_interval(values[drawn].mean(axis=1), values.size)


def _sign_test(differences: np.ndarray, generator: np.random.Generator) -> float:
    """P-value, two-sided, of a mean of paired differences: each might have had the other sign."""
    if differences.size < 2 or not differences.any():
        return math.nan
    test = permutation_test(
        (differences, np.zeros_like(differences)),
        lambda a, b, axis: (a - b).mean(axis=axis),
        permutation_type="samples",
        n_resamples=_RANDOM,
        vectorized=True,
        rng=generator,
    )
    return float(test.pvalue)
