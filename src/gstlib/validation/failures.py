"""Where does the prediction fail? Loss split by height and by gap.

A flat touches summits. What use took out of valleys (a third body, a rough active stone, a chip)
the model cannot predict; split by height band it is seen as what it is, and not as a low score.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

__all__ = ["gap_bands", "height_bands", "split_loss"]


def height_bands(heights: np.ndarray, valid: np.ndarray, quantiles: Sequence[float]) -> dict:
    """Masks of the valid points between quantiles of their heights, the lowest band first.

    Parameters
    ----------
    heights : (ny, nx) ndarray
        Before use, mm.
    valid : (ny, nx) ndarray of bool
    quantiles : sequence of float
        Inner limits, rising, between 0 and 1.

    Returns
    -------
    dict
        By label, such as ``0-50 %`` (of the points, from below).
    """
    edges = np.quantile(heights[valid], quantiles) if valid.any() else quantiles
    band = np.searchsorted(edges, heights, side="right")
    return {
        f"{low:.4g}-{high:.4g} %": valid & (band == number)
        for number, (low, high) in enumerate(pairwise([0, *np.multiply(quantiles, 100), 100]))
    }


def gap_bands(
    contact: np.ndarray, gap: np.ndarray, valid: np.ndarray, limits_um: Sequence[float]
) -> dict:
    """Masks of the valid points by their distance from the flat: in contact, then ever further.

    Parameters
    ----------
    contact : (ny, nx) ndarray of bool
    gap : (ny, nx) ndarray
        mm.
    valid : (ny, nx) ndarray of bool
    limits_um : sequence of float
        Inner limits, rising, µm.
    """
    band = np.searchsorted(np.multiply(limits_um, 1e-3), gap)
    limits = [0, *limits_um]
    labels = [
        *(f"{low:.4g}-{high:.4g} um" for low, high in pairwise(limits)),
        f"over {limits[-1]:.4g} um",
    ]
    return {"contact": valid & contact} | {
        label: valid & ~contact & (band == number) for number, label in enumerate(labels)
    }


def split_loss(
    predicted: np.ndarray, loss: np.ndarray, valid: np.ndarray, bands: dict[str, np.ndarray]
) -> list[dict[str, object]]:
    """For each band: how much of the patch and of the loss lies in it, and how much was predicted.

    Returns
    -------
    list of dict
        ``band``; ``area_share`` and ``loss_share`` (of the valid points, and of those with loss,
        that are in it); ``loss_fraction`` (of its points, with loss); ``hit_share`` and ``recall``
        (of all loss, and of its own, that is in it and predicted); NaN where there is nothing to
        take a share of.
    """
    seen = loss & valid

    def share(part: np.ndarray, whole: np.ndarray) -> float:
        return float(part.sum() / whole.sum()) if whole.any() else float("nan")

    return [
        {
            "band": label,
            "area_share": share(band, valid),
            "loss_share": share(seen & band, seen),
            "loss_fraction": share(seen & band, band),
            "hit_share": share(seen & band & predicted, seen),
            "recall": share(seen & band & predicted, seen & band),
        }
        for label, band in bands.items()
    ]
