"""Null model of the positions of wear: predictions of other patches, and half turns.

Wear and contact occur in clusters, so points are not independent trials. A test that treats points
as such finds significance everywhere. Both occur more often at the edges and corners of a patch
than in its middle, because scans are levelled. So a null model of shifted predictions claims too
much. This null model keeps textures and their positions, and breaks only the alignment. The
prediction for *another* patch contains no information about the positions on this one. The same is
true of any prediction that is turned by half a turn. Quarter turns and mirror images would cross
the striae of a ground surface, agree less, and make the test claim too often. If the prediction is
no better, all of these are equally likely to agree best. This is a permutation test (Good 2005,
Permutation, Parametric and Bootstrap Tests of Hypotheses, 3rd ed.).

With n patches there are 2 n predictions for each. Patches with different points are not compared.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gstlib.validation.masks import mask_scores

__all__ = ["Places", "p_value", "swapped_mcc"]

# More patches than this take memory, and do not make p more certain.
_MOST_PATCHES = 125
# Scores of the same counts may differ by rounding, and count as ties.
_TIE = 1e-9


@dataclass(frozen=True)
class Places:
    """Masks of one patch, stored as bits because a study may have thousands of patches.

    Attributes
    ----------
    bits : (3, ny, n) ndarray of uint8
        Whether loss is predicted, whether height was lost, and whether this is known.
    shape : (int, int)
        Points (ny, nx) of the patch.
    """

    bits: np.ndarray
    shape: tuple[int, int]

    @classmethod
    def packed(
        cls, predicted: np.ndarray, lost: np.ndarray, measured: np.ndarray
    ) -> "Places":
        """From three masks (ny, nx); the first is known everywhere."""
        masks = [predicted, lost, measured]
        return cls(np.packbits(masks, axis=-1), measured.shape)

    def masks(self) -> np.ndarray:
        """The three masks, (3, ny, nx)."""
        return np.unpackbits(self.bits, axis=-1, count=self.shape[1])


def swapped_mcc(patch: str, places: Mapping[str, Places]) -> np.ndarray:
    """MCC of a patch's loss with its own prediction, and with all other predictions: (draws,).

    `places` contains the patch and all others with a predicted loss. The first value belongs to the
    patch's own prediction. The others belong to all predictions, including its own, as they are and
    turned by half a turn.
    """
    own = places[patch]
    others = [
        name
        for name, each in places.items()
        if name != patch and each.shape == own.shape
    ]
    others = others[:: math.ceil(len(others) / _MOST_PATCHES) or 1]
    # Turning the loss is equivalent to turning the predictions, and takes one product for all of
    # them. A half turn reverses the order of the points, and keeps the direction of striae.
    _, lost, measured = own.masks().reshape(3, -1)
    turned = [lost, lost[::-1], measured, measured[::-1]]
    predicted = [places[name].masks()[0].ravel() for name in (patch, *others)]
    # Exact, because these are sums of ones below 2^24.
    products = np.array(predicted, np.float32) @ np.array(turned, np.float32).T
    hits, marked = np.split(products, 2, axis=1)
    scores = mask_scores(hits, marked, lost.sum(), measured.sum())
    return scores["mcc"].ravel()


def p_value(value: float, null: np.ndarray) -> float:
    """Fraction of the null scores that reach the value, which itself counts as one of them.

    NaN without a value or null scores; draws without a defined score are left out.
    """
    null = null[np.isfinite(null)]
    if math.isnan(value) or not null.size:
        return math.nan
    reached = (null >= value - _TIE).sum()
    return float((1 + reached) / (1 + null.size))
