"""Competing laws of wear: which of them best predicts the loss of a patch from the other losses.

Archard's law is scored beside four others on the same likely pressures. They are a threshold
pressure, a lower and a higher exponent of pressure, and the same loss of all touched patches. None
of them contains Archard's law as a special case. So a better score means a better prediction.
"""

# ASSUME: Prior of a threshold pressure. A threshold is lognormal, with a factor of 2 about half the
# mean pressure of the patches that likely loads touch. Reason: A threshold stands for cracks that
# grow only in contacts with enough elastic energy (Xu & Persson, arXiv 2412.13129).
# ASSUME: Prior of an exponent. The logarithm of the exponent to base 2 is beyond 0.5 on one side of
# 0, by a half-normal distance with a scale of 0.6. So the exponent is not near 1. Reason: Exponents
# of experiments form one group about 1 and another elsewhere (Delaney et al. 2025, Appl. Mech. Rev.
# 77:022101).
# ASSUME: Laws under scattered strikes. A law acts on the mean pressure of the strikes. Reason: Only
# the mean pressure of the strikes has a closed form. Alternative: The law acts on each strike.

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeAlias

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.conditions import ARCHARD, Law
from gstlib.use.evidence import FEWEST_PATCHES, Losses, likelihood
from gstlib.use.tempering import OfDraws, mean_and_limits, tempered

__all__ = ["BASE", "UNDECIDED", "law_scores", "law_table"]

# The reference law, and the answer if the scores do not separate the laws.
BASE, UNDECIDED = "archard", "undecided"
# The median of each score over several samples counts, because one sample may miss loads that are
# likely once a patch is left out.
_DRAWS, _SAMPLES = 1000, 3
_EXPONENT_ERROR, _EXPONENT_APART = 0.6, 0.5
# Relative to the mean pressure of the touched patches.
_THRESHOLD, _THRESHOLD_ERROR = 0.5, 0.7
# Pressures between solved contacts are interpolated. Below this fraction of the mean, they are
# zero.
_TOUCHED = 0.01
# One-sided level of a claim. The quantile is Student's, because few patches give the standard
# error. For the best of four other laws, the level is divided by four.
_LEVEL = 0.05
_STATISTICS = "posterior_mean", "low", "high"
_DECIMALS = 6


def _threshold(standard: np.ndarray, mean: float) -> Law:
    return Law(threshold_MPa=_THRESHOLD * mean * np.exp(_THRESHOLD_ERROR * standard))


def _exponent(standard: np.ndarray, mean: float, *, sign: float) -> Law:
    apart = _EXPONENT_APART + _EXPONENT_ERROR * abs(standard)
    return Law(exponent=2.0 ** (sign * apart))


# Maps standard normal variables (draws, 0 or 1) and a mean pressure (MPa) to a law.
_LawOf: TypeAlias = Callable[[np.ndarray, float], Law]
# By name, the parameter of a law, and the law.
_LAWS: dict[str, tuple[str, _LawOf]] = {
    BASE: ("", lambda standard, mean: ARCHARD),
    "threshold": ("threshold_MPa", _threshold),
    "lower exponent": ("exponent", partial(_exponent, sign=-1.0)),
    "higher exponent": ("exponent", partial(_exponent, sign=1.0)),
    "touched": ("", lambda standard, mean: Law(_TOUCHED * mean, 0.0)),
}


def law_scores(
    pressures: OfDraws, variables: int, losses: Losses, generator: np.random.Generator
) -> xr.Dataset:
    """Score how well each law predicts the loss of each patch from the other losses.

    Parameters
    ----------
    pressures : callable
        From standard normal variables (draws, variables) to pressures (draws, patches), MPa.
    variables : int
        Number of variables; 0 for a known load.
    losses : Losses
        The law in it is not used.
    generator : numpy.random.Generator

    Returns
    -------
    xarray.Dataset
        ``law_log_score`` (law, patch): log probability of each loss, given all others.
        ``law_parameter`` (law, statistic): its posterior mean and 95 % limits, NaN without a
        parameter.
    """
    prior = pressures(generator.standard_normal((_DRAWS, variables)))
    touched = prior[prior > 0]
    mean = float(touched.mean()) if touched.size else 0.0

    def scored(parameter: str, law: _LawOf) -> tuple[np.ndarray, list[float]]:
        """Score of each loss, and statistics of the parameter."""
        end = variables + bool(parameter)

        def law_of(standard: np.ndarray) -> Law:
            return law(standard[:, variables:end], mean)

        def log_likelihood(standard: np.ndarray) -> np.ndarray:
            evidence = replace(losses, law=law_of(standard))
            pressure = pressures(standard[:, :variables])
            return likelihood(evidence, pressure, standard[:, end:])

        size = end + losses.variables
        drawn = [
            tempered(log_likelihood, size, _DRAWS, generator) for _ in range(_SAMPLES)
        ]
        samples = [sample for sample in drawn if sample is not None]
        unknown = [np.nan] * len(_STATISTICS)
        if not samples:
            return np.full(len(losses.depth_um), -np.inf), unknown
        score = np.median([sample.log_score for sample in samples], axis=0)
        if not parameter:
            return score, unknown
        standard = np.concatenate([sample.standard for sample in samples])
        values = np.ravel(getattr(law_of(standard), parameter))
        weights = np.concatenate([sample.weights for sample in samples])
        return score, mean_and_limits(values, weights / len(samples))

    scores, parameters = zip(*(scored(*each) for each in _LAWS.values()), strict=True)
    return xr.Dataset(
        {
            "law_log_score": (("law", "patch"), np.array(scores)),
            "law_parameter": (("law", "statistic"), np.array(parameters)),
        },
        {"law": list(_LAWS), "statistic": list(_STATISTICS)},
    )


def law_table(
    use: xr.Dataset | None, pressure: np.ndarray, losses: Losses, *, seed: int
) -> pd.DataFrame:
    """The table ``laws.csv``: scores of the laws.

    Parameters
    ----------
    use : xarray.Dataset or None
        From `gstlib.use.infer.infer_use`.
    pressure : (patches,) ndarray
        Pressure under the load in the config, MPa. It is scored alone if no load case is adopted.
    losses : Losses
        Losses of the same patches.
    seed : int

    Returns
    -------
    pandas.DataFrame
        A row for each law. ``log_score_gain`` is its log score minus the log score of Archard's
        law. ``answer`` is the law that predicts best, or `UNDECIDED`. There are no rows
        if too few patches wore, or if no load touches them.
    """
    if use is not None and use.attrs["adopted"] and "law_log_score" in use:
        scores = use
    elif len(pressure) < FEWEST_PATCHES or not losses.tells or not (pressure > 0).any():
        return pd.DataFrame()
    else:
        scores = law_scores(
            lambda standard: np.tile(pressure, (len(standard), 1)),
            0,
            losses,
            np.random.default_rng([seed, 14]),
        )
    score = scores.law_log_score.values
    gains = score - score[0]
    count = gains.shape[1]
    table = pd.DataFrame(
        {
            "law": scores.law.values,
            "parameter": [_LAWS[name][0] for name in scores.law.values],
            **dict(zip(_STATISTICS, scores.law_parameter.values.T, strict=True)),
            "log_score": score.sum(axis=1),
            "log_score_gain": gains.sum(axis=1),
            "log_score_gain_error": np.sqrt(count) * gains.std(axis=1, ddof=1),
        }
    )
    return table.assign(answer=_answer(table, count)).round(_DECIMALS)


def _answer(table: pd.DataFrame, patches: int) -> str:
    """The law that predicts best, if the gains over Archard's law show one."""
    others = table[table.law != BASE]
    best = others.loc[others.log_score_gain.idxmax()]
    apart = scipy.stats.t(patches - 1)
    if (
        best.log_score_gain
        > apart.isf(_LEVEL / len(others)) * best.log_score_gain_error
    ):
        return str(best.law)
    clearly = others.log_score_gain < -apart.isf(_LEVEL) * others.log_score_gain_error
    return BASE if clearly.all() else UNDECIDED
