"""From the scores of many specimens to rates of claims, with intervals.

A claim is a p-value at or below a level. Where nothing is there, claims must come as often as the
level says; where something is there, the rate is the power.
"""

from collections.abc import Iterable

import numpy as np
import pandas as pd
from scipy.stats import beta

__all__ = ["LEVELS", "rejection_rates"]

LEVELS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.5)
_CONFIDENCE = 0.95


def rejection_rates(p_values: pd.DataFrame, levels: Iterable[float] = LEVELS) -> pd.DataFrame:
    """How often each test claims a relation, at each level.

    Parameters
    ----------
    p_values : pandas.DataFrame
        Of `gstlib.power.p_values`, with the specimen's ``seed``: a specimen may have several rows
        for a test, one for each patch. Rows without a p-value, where the test could not be made,
        are left out.
    levels : iterable of float
        Nominal levels: a p-value at or below the level is a claim.

    Returns
    -------
    pandas.DataFrame
        ``test, drawn, wear, level, claims, of, specimens, rate, low, high``: 95 % Clopper-Pearson
        interval. Patches of one specimen are no independent trials: for these the number of trials
        is the effective one, by the spread between specimens (Korn and Graubard 1998, Surv.
        Methodol. 24:193).
    """
    rows = []
    known = p_values.dropna(subset="p_value")
    kinds = ["test", "drawn", "wear"]
    for (test, drawn, wear), group in known.groupby(kinds, sort=False, dropna=False):
        of = group.groupby("seed").size().to_numpy(float)
        for level in levels:
            claimed = (group.p_value <= level).groupby(group.seed).sum().to_numpy(float)
            rate = claimed.sum() / of.sum()
            low, high = _interval(rate, _effective_trials(claimed, of))
            rows.append(
                {
                    "test": test,
                    "drawn": drawn,
                    "wear": wear,
                    "level": level,
                    "claims": int(claimed.sum()),
                    "of": int(of.sum()),
                    "specimens": len(of),
                    "rate": rate,
                    "low": low,
                    "high": high,
                }
            )
    return pd.DataFrame(rows)


def _effective_trials(claimed: np.ndarray, of: np.ndarray) -> float:
    """Independent trials with the same variance of the rate as these, clustered by specimen.

    Parameters
    ----------
    claimed, of : (specimens,) ndarray
        Claims and trials of each specimen.
    """
    count, trials = len(of), of.sum()
    rate = claimed.sum() / trials
    between = count / max(count - 1, 1) * ((claimed - rate * of) ** 2).sum() / trials**2
    if between == 0:  # no claim, or nothing but claims: the data say nothing about clustering
        return float(trials)
    independent = rate * (1 - rate) / max(trials - 1, 1)
    return float(min(trials, trials * independent / between))


def _interval(rate: float, trials: float) -> tuple[float, float]:
    """Clopper-Pearson interval of a rate; the number of trials need not be whole."""
    tail = (1 - _CONFIDENCE) / 2
    claims = rate * trials
    low = beta.ppf(tail, claims, trials - claims + 1) if claims > 0 else 0.0
    high = beta.ppf(1 - tail, claims + 1, trials - claims) if claims < trials else 1.0
    return float(low), float(high)
