"""The p-values of the study's tests on one specimen, patch by patch and over its patches."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import pandas as pd

from gstlib.power.trial import Trial
from gstlib.validation.across import mean_gains, mean_scores, rank_correlations
from gstlib.validation.comparison import compare, score_patch, scores_of
from gstlib.validation.gains import null_scores, weigh_patch
from gstlib.validation.neighbours import neighbours_p_value
from gstlib.validation.rivals import RIVALS

__all__ = ["SCORES", "p_values"]

SCORES = ("f1", "roc_auc")  # the one of areas, the other of rankings
_PREDICTOR, _EXTENT = "pressure_MPa", "loss_fraction"
_PAIR = f"spearman({_PREDICTOR}, {_EXTENT})"

# ASSUME: what can be had with fewer patches is that of so many drawn by chance from a specimen's.
_PATCH_COUNTS = (4, 6, 8, 10, 12)
# Intervals are not looked at here.
_RESAMPLES = 99


def p_values(
    trials: Iterable[Trial],
    *,
    seed: Sequence[int],
    shifts: int,
    neighbourhood_um: float,
    curvature_length_um: float,
    most_noise: float,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """P-values of every test of the study on one specimen, for each placement of its wear.

    Parameters
    ----------
    trials : iterable of Trial
        The patches of one specimen, from `try_specimen`.
    seed : sequence of int
        Of the shifts and permutations.
    shifts, neighbourhood_um, curvature_length_um, most_noise
        As in `gstlib.validation`.

    Returns
    -------
    tests : pandas.DataFrame
        ``test, drawn, wear, patches, p_value``. Tests of one patch are called after their score,
        ``f1``; those over the patches as in ``validation_summary.csv``: over all of them, or over
        so many ``drawn`` by chance (else NaN). Beside the exchange of patches stands the test that
        allows for neighbours being alike (`gstlib.validation.neighbours`). The p-value of a gain
        is one-sided: it is small where contact is better than the best rival.
    patches : pandas.DataFrame
        ``wear, patch, x_mm, y_mm, pressure_MPa`` and the scores of each patch.
    """
    scored, weighed, nulls = [], [], []
    for trial in trials:
        at = compare(
            trial.contact["height"],
            trial.contact,
            trial.registered,
            neighbourhood_um=neighbourhood_um,
            curvature_length_um=curvature_length_um,
        )
        generator = np.random.default_rng([*seed, *trial.patch.encode()])
        scores = scores_of(at)
        null = null_scores(at, shifts=shifts, generator=generator)
        names = {"wear": trial.wear, "patch": trial.patch}
        place = {"x_mm": trial.x_mm, "y_mm": trial.y_mm, "pressure_MPa": trial.pressure}
        row = score_patch(at, scores, trial.registered)
        scored.append(names | place | row)
        rows = weigh_patch(
            scores, at, null, most_noise=most_noise, resamples=_RESAMPLES, generator=generator
        )
        weighed += [names | row for row in rows]
        nulls.append(null)
    columns = ["test", "drawn", "wear", "patches", "p_value"]
    if not scored:  # the study takes no patch of this specimen: there is nothing to test
        return pd.DataFrame(columns=columns), pd.DataFrame()
    patches, weighed = pd.DataFrame(scored), pd.DataFrame(weighed)
    rows = []
    for wear, table in patches.groupby("wear", sort=False):
        generator = np.random.default_rng(seed)
        of_wear = weighed[weighed.wear == wear]
        rows += [
            {"test": row.score, "drawn": np.nan, "wear": wear, "patches": 1, "p_value": row.p_value}
            for row in of_wear.itertuples()
            if row.score in SCORES
        ]
        found = _over_patches(table, of_wear, [nulls[i] for i in table.index], generator)
        rows += [{"wear": wear, **row} for row in found]
    return pd.DataFrame(rows)[columns], patches


def _over_patches(
    table: pd.DataFrame, weighed: pd.DataFrame, nulls: list[dict], generator: np.random.Generator
) -> Iterator[dict]:
    """The tests over the patches of one specimen with one placement of its wear."""
    chance = {"generator": generator, "resamples": _RESAMPLES}
    gains = mean_gains(table, RIVALS, **chance)
    # a difference is claimed either way by the study; here only that contact is better
    gains["p_value"] = np.where(gains.value > 0, gains.p_value / 2, 1 - gains.p_value / 2)
    wanted = [f"{kind}({score})" for kind in ("mean", "gain") for score in SCORES]
    found = pd.concat([mean_scores(weighed, nulls, **chance), gains])
    yield from _rows(found[found.statistic.isin(wanted)], np.nan)
    order = generator.permutation(len(table))
    for drawn in (np.nan, *_PATCH_COUNTS):
        if not drawn > len(table):
            chosen = table if np.isnan(drawn) else table.iloc[np.sort(order[:drawn])]
            found = rank_correlations(chosen, predictors=[_PREDICTOR], extents=[_EXTENT], **chance)
            found = found[found.statistic == _PAIR].copy()
            yield from _rows(found, drawn)
            found["p_value"] = neighbours_p_value(
                chosen[_PREDICTOR],
                chosen[_EXTENT],
                chosen[["x_mm", "y_mm"]],
                exchanged=found.p_value.item(),
            )
            yield from _rows(found.assign(statistic=f"{_PAIR}, neighbours allowed for"), drawn)


def _rows(summary: pd.DataFrame, drawn: float) -> Iterator[dict]:
    for row in summary.itertuples():
        yield {"test": row.statistic, "drawn": drawn, "patches": row.n, "p_value": row.p_value}
