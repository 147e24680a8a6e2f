"""How well does a mask agree with another: of predicted with measured loss, of two contacts?

Every score is a function of four counts, arrays of any one shape: how many points were hit, how
many predicted, how many observed, and how many there are.

- ``precision``: share of the predicted that is observed; NaN if nothing is predicted.
- ``recall``: share of the observed that is predicted; NaN if nothing is observed.
- ``f1``: their harmonic mean; NaN if both masks are empty, 0 if only one is.
- ``mcc``: Matthews' correlation coefficient: 1 if the masks agree, 0 at chance whatever their
  areas. 0 if nothing or everything is predicted, NaN if nothing or everything is observed.
- ``attainable_mcc``: the largest that a mask of the predicted area can reach, 1 if it is the
  observed area. It says how much is lost by the amount; ``mcc / attainable_mcc`` is the rest, lost
  by the places.
"""

import numpy as np

__all__ = ["mask_counts", "mask_scores", "ratio"]


def mask_counts(
    mask: np.ndarray, observed: np.ndarray, valid: np.ndarray
) -> tuple[int, ...]:
    """The counts that `mask_scores` takes, over the valid points of two masks (ny, nx)."""
    mask = mask & valid
    observed = observed & valid
    parts = mask & observed, mask, observed, valid
    return tuple(int(np.count_nonzero(part)) for part in parts)


def mask_scores(hits, predicted, observed, measured) -> dict[str, np.ndarray]:
    """Every score by name, from counts that broadcast."""
    counts = np.broadcast_arrays(hits, predicted, observed, measured)
    hits, predicted, observed, measured = (count.astype(float) for count in counts)
    spread = predicted * (measured - predicted) * observed * (measured - observed)
    product = hits * measured - predicted * observed
    low = np.minimum(predicted, observed)
    high = np.maximum(predicted, observed)
    most = ratio(low * (measured - high), high * (measured - low))
    # a prediction that marks no place, or all of them, says nothing about places
    defined = (observed > 0) & (observed < measured)
    says_nothing = defined & (spread == 0)
    return {
        "precision": ratio(hits, predicted),
        "recall": ratio(hits, observed),
        "f1": ratio(2 * hits, predicted + observed),
        "mcc": np.where(says_nothing, 0.0, ratio(product, np.sqrt(spread))),
        "attainable_mcc": np.where(defined, np.sqrt(most), np.nan),
    }


def ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Part over whole; NaN where the whole is 0."""
    unknown = np.full(np.shape(part), np.nan)
    return np.divide(part, whole, out=unknown, where=whole > 0)
