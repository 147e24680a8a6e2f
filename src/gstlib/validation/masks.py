"""Agreement of two masks: predicted and measured loss, or two contacts.

Every score is a function of four counts, arrays of any one shape. They are the numbers of hits, of
predicted, of observed and of all points.

- ``precision``: fraction of the predicted points that are observed; NaN if nothing is predicted.
- ``recall``: fraction of the observed points that are predicted; NaN if nothing is observed.
- ``f1``: harmonic mean of both; NaN if both masks are empty, 0 if only one is.
- ``mcc``: Matthews' correlation coefficient: 1 if the masks agree, 0 at chance for any areas. It is
  0 if nothing or everything is predicted, NaN if nothing or everything is observed.
- ``attainable_mcc``: the largest MCC of a mask of the predicted area, 1 if it is the observed area.
  Its distance from 1 is due to a wrong area; the distance of ``mcc / attainable_mcc`` from 1 is due
  to wrong positions.
"""

import numpy as np

__all__ = ["mask_counts", "mask_scores", "ratio"]


def mask_counts(mask: np.ndarray, observed: np.ndarray) -> tuple[int, ...]:
    """The counts for `mask_scores`, over all points of two masks of one shape."""
    parts = mask & observed, mask, observed
    return (*(int(np.count_nonzero(part)) for part in parts), mask.size)


def mask_scores(hits, predicted, observed, measured) -> dict[str, np.ndarray]:
    """All scores by name, from counts that broadcast."""
    counts = np.broadcast_arrays(hits, predicted, observed, measured)
    hits, predicted, observed, measured = np.array(counts, dtype=float)
    spread = predicted * (measured - predicted) * observed * (measured - observed)
    product = hits * measured - predicted * observed
    low = np.minimum(predicted, observed)
    high = np.maximum(predicted, observed)
    most = ratio(low * (measured - high), high * (measured - low))
    # A prediction of no points, or of all, contains no information about positions.
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
    """Part divided by whole; NaN if the whole is 0."""
    unknown = np.full(np.shape(part), np.nan)
    return np.divide(part, whole, out=unknown, where=whole > 0)
