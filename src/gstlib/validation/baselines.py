"""What the loss of a patch would be without the contact solution: baselines with equal knowledge.

A prediction of a patch's loss knows its heights before use, where it lies in the stone, and what
the *other* patches lost. So does each baseline; none has seen what the patch itself lost:

- ``none``: no loss.
- ``mean_volume``: a plane that cuts off the others' mean volume.
- ``pressure_volume``: a plane that cuts off a volume in proportion to the patch's pressure.
- ``pressure_fraction``: a plane that wears a share of the patch in proportion to its pressure.
- ``rigid``: what a rigid flat cuts off at a displacement from first touch that is the same on all
  patches and gives the others their loss. The nearest model in print is that of Rausch et al.
  (2024, protocols.io 261ge346dl47), a rigid collision along a stroke.

``oracle_area`` is no baseline, for it knows the answer: a plane that wears the share of the patch
that did wear.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import pandas as pd

__all__ = ["BASELINES", "ORACLE", "Others", "baseline_depths", "volumes_cut"]

BASELINES = "none", "mean_volume", "pressure_volume", "pressure_fraction", "rigid"
ORACLE = "oracle_area"

# Displacements of a rigid flat at which volumes are tabulated, closer together near first touch.
_DISPLACEMENTS = 300


class Others(NamedTuple):
    """The patches whose losses predictions are fitted to.

    Attributes
    ----------
    table : pandas.DataFrame
        By patch: ``pressure_MPa`` before use, ``loss_mm``, the volume lost over the known area,
        and ``loss_fraction`` of that area.
    displacements : (n,) ndarray
        Of a rigid flat from first touch, mm, increasing from 0.
    cut : pandas.DataFrame
        By patch (columns): the volume (mm, over the known area) that it cuts off at each of them.
    """

    table: pd.DataFrame
    displacements: np.ndarray
    cut: pd.DataFrame

    @classmethod
    def tabulated(cls, table: pd.DataFrame, depths: dict[str, np.ndarray]) -> "Others":
        """`table` as above; `depths` below the summit of each patch's known points, mm."""
        deepest = max((float(below.max()) for below in depths.values()), default=0.0)
        displacements = deepest * np.linspace(0, 1, _DISPLACEMENTS) ** 2
        cut = {
            patch: volumes_cut(below, displacements) for patch, below in depths.items()
        }
        return cls(table, displacements, pd.DataFrame(cut, index=displacements))

    def without(self, patch: str) -> "Others":
        """All others of a patch."""
        table = self.table.drop(patch, errors="ignore")
        return self._replace(
            table=table, cut=self.cut.drop(columns=patch, errors="ignore")
        )


def volumes_cut(below: np.ndarray, displacements: Iterable[float]) -> np.ndarray:
    """Mean depth that rigid flats take off points at depths `below` a summit; any one length."""
    ordered = np.sort(below, axis=None)
    summed = np.r_[0.0, np.cumsum(ordered)]
    displacements = np.asarray(displacements, dtype=float)
    reached = np.searchsorted(ordered, displacements)
    return (reached * displacements - summed[reached]) / ordered.size


def baseline_depths(
    height: np.ndarray,
    level: np.ndarray,
    *,
    summit: float,
    pressure_MPa: float,
    worn_fraction: float,
    others: Others,
) -> dict[str, np.ndarray]:
    """The depth (n,), mm, that each baseline and the upper bound take off a patch's known points.

    Parameters
    ----------
    height, level : (n,) ndarray
        Of the points: height before use as the patch lies on the stone, and level of detection, mm.
    summit : float
        The highest point of the patch, mm.
    pressure_MPa : float
        Of the patch before use.
    worn_fraction : float
        Share of the points that lost height; only the upper bound takes it.
    others : Others
        Without the patch itself.
    """
    table = others.table
    per_pressure = table[["loss_mm", "loss_fraction"]].sum() / table.pressure_MPa.sum()
    volume, share = map(float, per_pressure * pressure_MPa)
    cut_mm = others.cut.sum(axis=1)
    sunk = np.interp(table.loss_mm.sum(), cut_mm, others.displacements)
    mean_loss = float(table.loss_mm.mean())
    return {
        "none": np.zeros(height.shape),
        "mean_volume": _cut_volume(height, mean_loss),
        "pressure_volume": _cut_volume(height, volume),
        "pressure_fraction": _cut_fraction(height, level, share),
        "rigid": np.maximum(height - (summit - sunk), 0.0),
        ORACLE: _cut_fraction(height, level, worn_fraction),
    }


def _cut_volume(height: np.ndarray, volume: float) -> np.ndarray:
    """Depth that a plane takes off so that its mean over the points is `volume` (mm)."""
    ordered = np.sort(height)[::-1]
    count = np.arange(1, height.size + 1)
    # down to each of the points
    removed = (np.cumsum(ordered) - count * ordered) / height.size
    reached = np.searchsorted(removed, volume, side="right")
    plane = (ordered[:reached].sum() - height.size * volume) / reached
    return np.maximum(height - plane, 0.0)


def _cut_fraction(height: np.ndarray, level: np.ndarray, share: float) -> np.ndarray:
    """Depth that a plane takes off which exceeds the level on a share of the points."""
    if not share > 0:
        return np.zeros(height.shape)
    plane = np.quantile(height - level, max(1 - share, 0.0))
    return np.maximum(height - plane, 0.0)
