"""One patch laid out for scoring: what was predicted, by whom, and what was seen."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr

from gstlib.surface import spacing_of
from gstlib.validation.change import wear_summary
from gstlib.validation.nulls import correlation_length
from gstlib.validation.rivals import Prediction, predictions
from gstlib.validation.scores import (
    fractions,
    fractions_skill_of_sums,
    mask_scores,
    rank_scores,
)

__all__ = ["CONTACT", "Comparison", "compare", "score_patch", "scores_of", "warning_of"]

CONTACT = "contact"  # the prediction that is on trial
# Noise is as likely up as down: of a patch of which so many times as much rose as fell, something
# else must be the matter.
_BEYOND_NOISE = 2


@dataclass(frozen=True)
class Comparison:
    """A patch's predictions beside its measured loss.

    Attributes
    ----------
    predictions : dict
        By name: `CONTACT` and the rivals, as from `gstlib.validation.rivals.predictions`.
    loss, valid : (ny, nx) ndarray of bool
        Where height was lost, and where that is known.
    loss_shares : (ny, nx) ndarray
        Share of the window around each point that lost height.
    spacing : (dy, dx)
        mm.
    correlation_length : float
        Distance (mm) over which loss is correlated.
    noise_share : float
        What rose over what fell: the share of the loss that noise, as likely up as down, would
        explain. NaN without loss.
    """

    predictions: dict[str, Prediction]
    loss: np.ndarray
    valid: np.ndarray
    loss_shares: np.ndarray
    spacing: tuple[float, float]
    correlation_length: float
    noise_share: float


def compare(
    heights: xr.DataArray,
    contact: xr.Dataset,
    registered: xr.Dataset,
    *,
    neighbourhood_um: float,
    curvature_length_um: float,
) -> Comparison:
    """Lay a patch out for scoring.

    Parameters
    ----------
    heights : (y, x) xarray.DataArray
        What was pressed on the flat, mm: the patch before use, or its sum with the counterface.
    contact : xarray.Dataset
        ``pressure`` (y, x) in MPa; ``gap`` (y, x) in mm, for the ranking out of contact;
        ``displacement`` in mm (of the last step), for rigid interpenetration. Without one of the
        two, what needs it is left out.
    registered : xarray.Dataset
        As from `gstlib.validation.change.height_change`.
    neighbourhood_um : float
        Side of the window of the fractions skill score, rounded to an odd number of elements.
    curvature_length_um : float
        Standard deviation of the Gaussian that smooths the surface before its curvature.
    """
    pressure = contact["pressure"].values
    valid = np.isfinite(registered["change"].values)
    if not heights.shape == pressure.shape == valid.shape:
        raise ValueError(
            f"T0, pressure and change have shapes {heights.shape}, {pressure.shape}, {valid.shape}"
        )
    spacing = spacing_of(heights)
    loss, gain = (registered[name].values.astype(bool) & valid for name in ("loss", "gain"))
    window = _odd_elements(neighbourhood_um * 1e-3, max(spacing))
    displacement = contact["displacement"].values if "displacement" in contact else np.nan
    return Comparison(
        predictions=predictions(
            heights.values,
            pressure,
            contact["gap"].values if "gap" in contact else None,
            valid,
            spacing=spacing,
            displacement=float(np.ravel(displacement)[-1]),
            curvature_length=curvature_length_um * 1e-3,
            window=window,
        ),
        loss=loss,
        valid=valid,
        loss_shares=fractions(loss, window, valid),
        spacing=spacing,
        correlation_length=correlation_length(loss, valid, spacing),
        noise_share=float(gain.sum() / loss.sum()) if loss.any() else math.nan,
    )


def scores_of(comparison: Comparison) -> dict[str, dict[str, float]]:
    """Every score of every prediction: by prediction, by score.

    ``pr_lift`` is PR-AUC over the prevalence. What ranks as another does has no rank scores.
    """
    loss, valid = comparison.loss, comparison.valid
    prevalence = loss.sum() / max(valid.sum(), 1)
    found = {}
    for name, prediction in comparison.predictions.items():
        scores = mask_scores(prediction.mask, loss, valid)
        p, o = prediction.shares[valid], comparison.loss_shares[valid]
        scores["fss"] = float(fractions_skill_of_sums(p @ o, p @ p, o @ o))
        if prediction.ranking is not None:
            scores |= rank_scores(prediction.ranking, loss, valid)
            scores["pr_lift"] = scores["pr_auc"] / prevalence if prevalence else math.nan
        found[name] = scores
    return found


def score_patch(
    comparison: Comparison, scores: dict[str, dict[str, float]], registered: xr.Dataset
) -> dict[str, float]:
    """One patch's row: how much was lost, and how well each prediction agrees with it.

    Parameters
    ----------
    comparison : Comparison
    scores : dict
        As from `scores_of`.
    registered : xarray.Dataset
        The height change that both were made from.

    Returns
    -------
    dict
        ``contact_fraction`` (whole patch), ``valid_contact_fraction`` (where the loss is known),
        the items of `wear_summary` (its ``loss_fraction`` is the prevalence), ``noise_share`` and
        ``correlation_length_um`` of the loss, ``rigid_fraction`` (share of the known area that a
        rigid flat cuts off at the same displacement); then the scores of the contact, and the same
        for each rival, its name in front.
    """
    contact, valid = comparison.predictions[CONTACT].mask, comparison.valid
    row = {
        "contact_fraction": float(contact.mean()),
        "valid_contact_fraction": float(contact[valid].mean()) if valid.any() else math.nan,
        **wear_summary(registered),
        "noise_share": comparison.noise_share,
        "correlation_length_um": comparison.correlation_length * 1e3,
    }
    if "rigid" in scores:  # the one whose area is not that of the contact
        rigid = comparison.predictions["rigid"].mask
        row["rigid_fraction"] = float(rigid[valid].mean()) if valid.any() else math.nan
    for name, of_one in scores.items():
        front = "" if name == CONTACT else f"{name}_"
        row |= {f"{front}{score}": value for score, value in of_one.items()}
    return row


def warning_of(row: Mapping, most_noise: float) -> str | None:
    """What a user should look into if a patch rose by nearly as much as it fell, or by far more.

    Parameters
    ----------
    row : mapping
        ``patch``, and the items of `score_patch`.
    most_noise : float
        The `noise_share` up to which there are p-values.
    """
    rose, fell = row["gain_fraction"], row["loss_fraction"]
    if rose > _BEYOND_NOISE * fell:
        return (
            f"patch {row['patch']}: far more rose than fell ({100 * rose:.2g} % and "
            f"{100 * fell:.2g} % of the area), and use only takes away. Are t0 and t1 exchanged in "
            "the patch table, or was residue left on the stone?"
        )
    if row["noise_share"] > most_noise:
        return (
            f"patch {row['patch']}: {100 * row['noise_share']:.0f} % as much rose as fell, so that "
            "the loss may be noise, which agrees with contact by itself: not tested against "
            "chance. A larger traces.minimum_points takes out noise."
        )
    return None


def _odd_elements(length: float, spacing: float) -> int:
    """The odd number of elements nearest to a length, at least 1."""
    return 2 * max(0, round((length / spacing - 1) / 2)) + 1
