"""Over the patches of a stone: do harder pressed ones wear more, and how good is the prediction?

Patches are the units here: intervals resample patches, tests permute them. Every row of the
summary is a statistic with its interval, its p-value, the number of patches, and what it is
compared with.

Permuting patches treats each as an independent trial. If two numbers vary smoothly over the stone,
adjacent patches repeat each other, and such a test finds non-existent relations more often than its
level says. Dutilleul (1993, Biometrics 49:305) tests a correlation with as many
trials as the two autocorrelations leave, after Clifford, Richardson and Hémon (1989, Biometrics
45:123).
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import scipy

from gstlib.io.results import columns_of
from gstlib.validation.intervals import percentile_interval
from gstlib.validation.nulls import p_value
from gstlib.validation.scores import RIVALS, SCORES
from gstlib.validation.scoring import PatchScores, score_table

__all__ = [
    "believed",
    "exchange_p_value",
    "mean_gains",
    "mean_scores",
    "predictors",
    "rank_correlation",
    "spatial_p_value",
    "summarise",
]

_COLUMNS = columns_of("validation_summary")
_PREDICTORS = "pressure_MPa", "contact_fraction", "stiffness_MPa_per_um", "exposure_N_per_mm"
# Area and volume of the traces, both over the area measured: patches overlap to different shares.
_EXTENTS = "loss_fraction", "loss_per_area_um"
# Up to this many patches all pairings are tried (8! = 40320), beyond it a random sample of them;
# all signs of a difference up to 13 (2¹³ = 8192).
_EXACT_UP_TO = 8
_RANDOM = 9999
# The intersection over union, which F1 says already, once stood after it. As many random numbers
# are passed over, so that the intervals of the other scores stay what they were.
_ONCE_BEFORE_ANOTHER = "f1"
# Student's t needs a degree of freedom.
_FEWEST_EFFECTIVE = 3.0


def summarise(
    by_variant: Mapping[str, Sequence[PatchScores]],
    predicted: pd.DataFrame,
    *,
    seed: int | Sequence[int],
    resamples: int,
    expected_worst: Sequence[str] = (),
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The tables ``validation_summary.csv`` and ``validation_variants.csv``.

    Parameters
    ----------
    by_variant : mapping of str to sequence of PatchScores
        The scores of the same patches in each variant of the coupling; those of the first, the
        study's own, with their nulls. Patches whose loss may be noise are left out of every row.
    predicted : pandas.DataFrame
        For each of these patches ``patch, x_mm, y_mm, pressure_MPa, stiffness_MPa_per_um`` and, of
        a gesture, ``exposure_N_per_mm``.
    seed, resamples : int
        Of the intervals and permutations; bootstrap samples of patches.
    expected_worst : sequence of str
        Patches stated beforehand to be the worst worn.

    Returns
    -------
    summary : pandas.DataFrame
        Of the study's own variant the rows of `mean_scores` and `rank_correlation`, with 95 %
        intervals; and ``expected_worst(5+8, column)``, the share of these patches among the equally
        many largest of each column (a tie counts against it), with the p-value of a random ranking.
        No rows without patches.
    variants : pandas.DataFrame
        Means over patches of each score and of its gain, as in `mean_gains`, by variant.
    """
    rows: list[tuple] = []
    parts = [pd.DataFrame(columns=_COLUMNS)]
    for number, (variant, of_all) in enumerate(by_variant.items()):
        found = believed(of_all)
        # the same random numbers for each variant; the summary of the first goes on with its own
        chance = {"generator": np.random.default_rng(seed), "resamples": resamples}
        rows += _variant_rows(variant, found, chance)
        if number == 0 and found:
            parts = _own_parts(found, predicted, expected_worst, chance)
    variants = pd.DataFrame(rows, columns=columns_of("validation_variants"))
    return pd.concat(parts, ignore_index=True), variants


def _own_parts(
    found: Sequence[PatchScores],
    predicted: pd.DataFrame,
    expected_worst: Sequence[str],
    chance: dict[str, Any],
) -> list[pd.DataFrame]:
    """The parts of ``validation_summary.csv``."""
    every = score_table(found).merge(predicted, on="patch")
    parts = [mean_scores(found, **chance)]
    for predictor in (name for name in _PREDICTORS if name in every):
        for extent in _EXTENTS:
            parts.append(
                rank_correlation(every, predictor, extent, places=("x_mm", "y_mm"), **chance)
            )
    if expected_worst:
        columns = [*_EXTENTS, "pressure_MPa", "contact_fraction"]
        rows = [_worst(every, expected_worst, column) for column in columns]
        parts.append(pd.DataFrame(rows, columns=_COLUMNS))
    return parts


def _variant_rows(
    variant: str, found: Sequence[PatchScores], chance: dict[str, Any]
) -> list[tuple]:
    """The rows of one variant in ``validation_variants.csv``."""
    table, rows = score_table(found), []
    gains = mean_gains(table, **chance)
    for score, gain in zip(SCORES, gains.itertuples(index=False), strict=True):
        # of the patches that both have a score on
        names = [score, f"{gain.against}_{score}"] if gain.against else [score, score]
        contact, rival = table[names].dropna().mean() if gain.n else (math.nan, math.nan)
        row = contact, rival, gain.against, gain.value, gain.low, gain.high, gain.p_value
        rows.append((variant, score, *row, gain.n))
    return rows


def predictors(
    microscale: pd.DataFrame, pressures: pd.DataFrame, exposure: pd.DataFrame | None
) -> pd.DataFrame:
    """What is predicted of each patch, as `summarise` takes it.

    The tables are ``microscale_summary``, ``patch_pressures`` and, of a gesture, ``exposure``.
    """
    states = microscale[["patch", "mean_pressure_MPa", "stiffness_MPa_per_um"]]
    predicted = states.rename(columns={"mean_pressure_MPa": "pressure_MPa"})
    predicted = predicted.merge(pressures[["patch", "x_mm", "y_mm"]], on="patch")
    if exposure is None:
        return predicted
    return predicted.merge(exposure[["patch", "exposure_N_per_mm"]], on="patch")


def believed(found: Sequence[PatchScores]) -> list[PatchScores]:
    """The patches whose loss exceeds noise: only these enter statistics over patches."""
    return [one for one in found if one.scores["believed"]]


def mean_gains(
    scores: pd.DataFrame, *, generator: np.random.Generator, resamples: int
) -> pd.DataFrame:
    """Mean over patches of each score minus that of the rival with the best mean.

    One rival serves all patches, as if chosen beforehand. It is selected on the same patches, so
    the gain can only look smaller than it is. Precision, recall, F1 and the fractions skill
    depend on how much is marked, also by chance: against ``rigid``, whose area is not that of the
    contact, their gain compares areas as well as places. MCC and the rank scores do not.

    `scores` is of `gstlib.validation.scoring.score_table`. Rows ``gain(score)``, with a bootstrap
    interval over patches and a two-sided test that exchanges model and rival patch by patch;
    ``against`` names the rival.
    """
    rows: list[tuple] = []
    for score in SCORES:
        columns = [f"{name}_{score}" for name in RIVALS if f"{name}_{score}" in scores]
        known = scores[[score, *columns]].dropna()
        if known.empty:
            rows.append((f"gain({score})", *[math.nan] * 4, 0, ""))
            continue
        best = known[columns].mean().idxmax()
        gain = (known[score] - known[best]).to_numpy(dtype=float)
        row = _mean(gain, generator, resamples)
        p = exchange_p_value(gain, generator)
        if score == _ONCE_BEFORE_ANOTHER:
            _mean(gain, generator, resamples)
            exchange_p_value(gain, generator)
        against = best.removesuffix(f"_{score}")
        rows.append((f"gain({score})", *row, p, len(gain), against))
    return pd.DataFrame(rows, columns=_COLUMNS)


def exchange_p_value(gain: np.ndarray, generator: np.random.Generator) -> float:
    """Two-sided test of a mean gain, shape (patches,): model and rival exchanged patch by patch.

    NaN for a single patch, or if no patch gains or loses.
    """
    if gain.size < 2 or not gain.any():
        return math.nan
    found = scipy.stats.permutation_test(
        (gain, np.zeros_like(gain)),
        lambda a, b, axis: (a - b).mean(axis=axis),
        permutation_type="samples",
        n_resamples=_RANDOM,
        vectorized=True,
        rng=generator,
    )
    return float(found.pvalue)


def mean_scores(
    found: Sequence[PatchScores], *, generator: np.random.Generator, resamples: int
) -> pd.DataFrame:
    """Mean over patches of each score, against the means of shifted predictions, one-sided.

    Rows ``mean(score)``, with a bootstrap interval over patches. Each patch has its own shifts, so
    the i-th shifts of all patches together are one draw. The p-value is that of the patches on
    which chance can be tested; ``against`` gives their number.
    """
    rows: list[tuple] = []
    for score in SCORES:
        values = np.array([one.scores[score] for one in found], dtype=float)
        values = values[np.isfinite(values)]
        tested = []
        for one in found:
            for gain in one.gains:
                if gain["score"] == score and not math.isnan(gain["p_value"]):
                    tested.append(one.null[score])
        p = math.nan
        if tested:
            # a patch with few elements has fewer shifts than the others, and limits the draws
            length = min(len(null) for null in tested)
            means = np.mean([null[:length] for null in tested], axis=0)
            p = p_value(float(means[0]), means[1:])
        row = *_mean(values, generator, resamples), p, values.size
        if score == _ONCE_BEFORE_ANOTHER:
            _mean(values, generator, resamples)
        rows.append((f"mean({score})", *row, f"shifts, on {len(tested)} patches"))
    return pd.DataFrame(rows, columns=_COLUMNS)


def rank_correlation(
    table: pd.DataFrame,
    predictor: str,
    extent: str,
    *,
    generator: np.random.Generator,
    resamples: int,
    places: Sequence[str] = (),
) -> pd.DataFrame:
    """Spearman's correlation over patches between a predictor and an extent of the traces.

    `table` has a row for each patch; those with a missing value are left out. The result is one
    row, ``spearman(predictor, extent)``: 95 % bootstrap over patches, two-sided permutation test
    (every pairing up to 8 patches, 9999 random ones beyond). NaN with fewer than 3 patches or a
    constant column. With `places`, the columns of the patches' x and y, the p-value accounts for
    spatial autocorrelation (`spatial_p_value`).
    """
    known = table[[predictor, extent, *places]].dropna()
    x, y, *where = known.to_numpy(dtype=float).T
    value = low = high = p = math.nan
    if x.size >= 3 and np.ptp(x) > 0 and np.ptp(y) > 0:
        value = float(_spearman(x, y))
        p = scipy.stats.permutation_test(
            (x,),
            lambda shuffled, axis: _spearman(shuffled, y),
            permutation_type="pairings",
            n_resamples=math.factorial(_EXACT_UP_TO) if x.size <= _EXACT_UP_TO else _RANDOM,
            vectorized=True,
            rng=generator,
        ).pvalue
        drawn = generator.integers(0, x.size, (resamples, x.size))
        # a draw that repeats a single patch has no correlation
        low, high = percentile_interval(_spearman(x[drawn], y[drawn]), x.size)
    against = "other pairings"
    if where:
        p = spatial_p_value(x, y, np.transpose(where), permuted=p)
        against += ", neighbours alike"
    name = f"spearman({predictor}, {extent})"
    row = name, value, low, high, float(p), len(known), against
    return pd.DataFrame([row], columns=_COLUMNS)


def spatial_p_value(
    x: np.ndarray, y: np.ndarray, places: np.ndarray, *, permuted: float
) -> float:
    """P-value of Spearman's correlation over patches that allows for spatial autocorrelation.

    `permuted` is the p-value of the permutation test, exact for unrelated patches. Dutilleul's test
    rests on Student's t, which is overconfident with few ranks, so it may only weaken the evidence:
    the larger p-value counts. It is two-sided, and NaN with fewer than 4 patches or constant
    values. `places` (n, 2) are the patches' coordinates, in any unit.
    """
    x, y = scipy.stats.rankdata(x), scipy.stats.rankdata(y)
    if x.size < 4 or np.ptp(x) == 0 or np.ptp(y) == 0:
        return math.nan
    freedom = max(_effective_patches(x, y, places), _FEWEST_EFFECTIVE) - 2
    correlation = float(np.clip(np.corrcoef(x, y)[0, 1], -1, 1))
    spread = math.sqrt((1 - correlation**2) / freedom)
    spatial = (
        float(2 * scipy.stats.t.sf(abs(correlation) / spread, freedom)) if spread > 0 else 0.0
    )
    return max(permuted, spatial)


def _effective_patches(x: np.ndarray, y: np.ndarray, places: np.ndarray) -> float:
    """Number of independent patches whose correlation would vary as much as that of these.

    At most the actual number: neighbours that differ more than others are no additional evidence.
    """
    distance = scipy.spatial.distance.squareform(
        scipy.spatial.distance.pdist(np.asarray(places, dtype=float))
    )
    count = len(distance)
    centring = np.eye(count) - 1 / count
    of_x, of_y = (centring @ _covariance(values, distance) @ centring for values in (x, y))
    variance = np.trace(of_x @ of_y) / (np.trace(of_x) * np.trace(of_y))
    return float(min(count, 1 + 1 / variance)) if variance > 0 else float(count)


def _covariance(values: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Covariance of every pair of patches by their distance; 0 for pairs far from each other."""
    # ASSUME: covariances are estimated in classes as wide as neighbours are apart, up to half of
    # the largest distance, as is usual for variograms; beyond it patches count as unrelated.
    apart = np.where(np.eye(len(distance), dtype=bool), np.inf, distance)
    step = float(np.median(apart.min(axis=1)))
    # rounded: on a lattice, distances fall on the edges of classes, and the unit must not matter
    steps = np.round(distance / step, 9)
    number = np.maximum(np.rint(steps), 1)
    number[(number + 0.5 > steps.max() / 2) | np.isinf(apart)] = 0
    centred = values - values.mean()
    products = np.multiply.outer(centred, centred)
    covariance = np.diag(np.diag(products).mean() * np.ones(len(values)))
    for one in np.unique(number[number > 0]):
        covariance[number == one] = products[number == one].mean()
    return covariance


def _spearman(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Spearman's correlation along the last axis; NaN where one of them is constant."""
    a, b = (
        scipy.stats.rankdata(values, axis=-1) - (values.shape[-1] + 1) / 2 for values in (x, y)
    )
    scale = np.sqrt((a * a).sum(axis=-1) * (b * b).sum(axis=-1))
    product = (a * b).sum(axis=-1)
    return np.divide(product, scale, out=np.full(np.shape(product), np.nan), where=scale > 0)


def _mean(
    values: np.ndarray, generator: np.random.Generator, resamples: int
) -> tuple[float, float, float]:
    """Mean of the values and its interval; NaN without any, or without an interval."""
    value = float(values.mean()) if values.size else math.nan
    if values.size < 2:
        return value, math.nan, math.nan
    drawn = generator.integers(0, values.size, (resamples, values.size))
    return value, *percentile_interval(values[drawn].mean(axis=1), values.size)


def _worst(table: pd.DataFrame, expected: Sequence[str], column: str) -> tuple:
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
    return name, share, math.nan, math.nan, p, len(known), "random ranking"
