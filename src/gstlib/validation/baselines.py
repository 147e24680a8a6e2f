"""Baselines: predictions of the loss of a patch without the contact solution, from the same data.

A prediction for a patch uses its heights before use, its position in the stone, and the losses of
the *other* patches. Each baseline uses the same data, and not the loss of the patch itself:

- ``none``: no loss.
- ``mean_volume``: a plane that removes the mean volume of the other patches.
- ``pressure_volume``: a plane that removes a volume in proportion to the pressure of the patch.
- ``pressure_fraction``: a plane that wears a fraction of the patch in proportion to its pressure.
- ``rigid``: removal by a rigid flat at a displacement from first touch. It is the same on all
  patches, and reproduces the loss of the others. The nearest published model is a rigid collision
  along a stroke (Rausch et al. 2024, protocols.io 261ge346dl47).

``oracle_area`` is not a baseline, because it uses the measured answer: a plane that wears the
fraction of the patch that did wear.
"""

from typing import NamedTuple

import numpy as np
import pandas as pd

__all__ = ["BASELINES", "ORACLE", "Others", "baseline_depths"]

BASELINES = "none", "mean_volume", "pressure_volume", "pressure_fraction", "rigid"
ORACLE = "oracle_area"

# Number of displacements at which volumes of a rigid flat are tabulated, closer near first touch.
_DISPLACEMENTS = 300


class Others(NamedTuple):
    """The patches whose losses predictions are fitted to.

    Attributes
    ----------
    table : pandas.DataFrame
        By patch: ``pressure_MPa`` before use, ``loss_mm``, the lost volume over the known area, and
        ``loss_fraction`` of that area.
    displacements : (n,) ndarray
        Displacements of a rigid flat from first touch, mm, increasing from 0.
    cut : pandas.DataFrame
        By patch (columns): the volume that it removes at each displacement, mm over the known area.
    """

    table: pd.DataFrame
    displacements: np.ndarray
    cut: pd.DataFrame

    @classmethod
    def tabulated(cls, table: pd.DataFrame, depths: dict[str, np.ndarray]) -> "Others":
        """`table` as above; `depths` below the summit of each patch's known points, mm."""
        deepest = max((float(below.max()) for below in depths.values()), default=0.0)
        displacements = deepest * np.linspace(0, 1, _DISPLACEMENTS) ** 2
        cut = {}
        for patch, below in depths.items():
            ordered = np.sort(below, axis=None)
            summed = np.r_[0.0, np.cumsum(ordered)]
            reached = np.searchsorted(ordered, displacements)
            cut[patch] = (reached * displacements - summed[reached]) / ordered.size
        return cls(table, displacements, pd.DataFrame(cut, index=displacements))

    def without(self, patch: str) -> "Others":
        """All patches except one."""
        table = self.table.drop(patch, errors="ignore")
        cut = self.cut.drop(columns=patch, errors="ignore")
        return self._replace(table=table, cut=cut)


def baseline_depths(
    height: np.ndarray,
    level: np.ndarray,
    *,
    summit: float,
    pressure_MPa: float,
    worn_fraction: float,
    others: Others,
) -> dict[str, np.ndarray]:
    """The depth (n,), mm, of each baseline and of the upper bound at a patch's known points.

    Parameters
    ----------
    height, level : (n,) ndarray
        Heights before use as the patch lies on the stone, and level of detection, mm.
    summit : float
        The highest point of the patch, mm.
    pressure_MPa : float
        Pressure of the patch before use.
    worn_fraction : float
        Fraction of the points that lost height, used only by the upper bound.
    others : Others
        The other patches.
    """
    table = others.table
    per_pressure = table[["loss_mm", "loss_fraction"]].sum() / table.pressure_MPa.sum()
    volume, share = map(float, per_pressure * pressure_MPa)
    cut_mm = others.cut.sum(axis=1)
    sunk = np.interp(table.loss_mm.sum(), cut_mm, others.displacements)
    return {
        "none": np.zeros(height.shape),
        "mean_volume": _cut_volume(height, float(table.loss_mm.mean())),
        "pressure_volume": _cut_volume(height, volume),
        "pressure_fraction": _cut_fraction(height, level, share),
        "rigid": np.maximum(height - (summit - sunk), 0.0),
        ORACLE: _cut_fraction(height, level, worn_fraction),
    }


def _cut_volume(height: np.ndarray, volume: float) -> np.ndarray:
    """Depth removed by a plane, with a mean over the points of `volume` (mm)."""
    ordered = np.sort(height)[::-1]
    count = np.arange(1, height.size + 1)
    # The plane passes through each of the points in turn.
    removed = (np.cumsum(ordered) - count * ordered) / height.size
    reached = np.searchsorted(removed, volume, side="right")
    plane = (ordered[:reached].sum() - height.size * volume) / reached
    return np.maximum(height - plane, 0.0)


def _cut_fraction(height: np.ndarray, level: np.ndarray, share: float) -> np.ndarray:
    """Depth removed by a plane that exceeds the level on a fraction of the points."""
    if not share > 0:
        return np.zeros(height.shape)
    plane = np.quantile(height - level, max(1 - share, 0.0))
    return np.maximum(height - plane, 0.0)
