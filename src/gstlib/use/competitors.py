"""Competitors of a load case, which predict wear without contact.

High patches carry load, and local wear resembles wear by a load. So four patterns without contact
are scored like a load case. They are wear in proportion to height above a level or a tilted plane,
a spot anywhere, and uniform wear. Each predicts the wear of a patch from the other patches.
"""

# ASSUME: Priors of the competitors. A spot lies anywhere on the square around the patches, with a
# width of 0.08 to 0.6 of its side. A plane lies between 0.5 standard deviations of the heights
# below their mean and 2.5 above it. Its tilt would about span the heights. Reason: Planes and spots
# beyond these limits wear nearly all patches alike, or hardly any.

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.macroscale.ensemble import patch_means
from gstlib.use.evidence import Evidence, posterior
from gstlib.use.tempering import OfDraws

__all__ = ["COMPETITORS", "competitor_scores"]

COMPETITORS = {
    "everywhere": "the same wear everywhere",
    "heights": "height above a plane",
    "tilted": "height above a tilted plane",
    "spot": "a spot of wear",
}
_DRAWS = 500
_LEVELS = -0.5, 2.5
_WIDTHS = 0.08, 0.6


def competitor_scores(
    height: xr.DataArray,
    patches: pd.DataFrame,
    evidence: Evidence,
    *,
    patch_mm: float,
    seed: int,
) -> xr.DataArray:
    """Log probability (competitor, patch) of the wear of each patch given the others.

    Parameters
    ----------
    height : (y, x) xarray.DataArray
        Heights of the face, mm.
    patches : pandas.DataFrame
        The columns ``patch, x_mm, y_mm, rotation_deg``.
    evidence : Evidence
        Wear of the patches, in the order of the table.
    patch_mm : float
        Side of a patch, mm.
    seed : int
    """
    above = _above_planes(height, patches, patch_mm)
    competitors: dict[str, tuple[OfDraws, int]] = {
        "everywhere": (lambda standard: np.ones((len(standard), len(patches))), 0),
        "heights": (above, 1),
        "tilted": (above, 3),
        "spot": (_spots(patches, patch_mm), 3),
    }
    scores = np.full((len(competitors), len(patches)), -np.inf)
    for number, (depths, variables) in enumerate(competitors.values()):
        generator = np.random.default_rng([seed, 13, number])
        particles = posterior(depths, variables, evidence, _DRAWS, generator)
        if particles is not None:
            scores[number] = particles.log_score
    return xr.DataArray(
        scores, {"competitor": list(competitors)}, ["competitor", "patch"]
    )


def _spots(patches: pd.DataFrame, patch_mm: float) -> OfDraws:
    """Depths of spots with a Gaussian profile."""
    places = patches[["y_mm", "x_mm"]].to_numpy(dtype=float)
    low = places.min(axis=0) - patch_mm / 2
    side = float(np.ptp(places, axis=0).max()) + patch_mm
    least, most = np.log(_WIDTHS)

    def depths(standard: np.ndarray) -> np.ndarray:
        uniform = scipy.special.ndtr(standard)
        centre = low + side * uniform[:, :2]
        log_width = least + (most - least) * uniform[:, 2:]
        width = side * np.exp(log_width)
        apart = np.square(centre[:, None] - places).sum(axis=2)
        return np.exp(-0.5 * apart / width**2)

    return depths


def _above_planes(
    height: xr.DataArray, patches: pd.DataFrame, patch_mm: float
) -> OfDraws:
    """Volumes per area above planes, level (one variable) or tilted (three variables)."""
    means = patch_means(height, patches, size_mm=patch_mm)
    inside = np.unique(means.indices)
    inside = inside[np.isfinite(height.values.flat[inside])]
    fields = *np.meshgrid(height.y, height.x, indexing="ij"), height.values
    on_stone = (field.flat[inside] for field in fields)
    y, x, values = (each - each.mean() for each in on_stone)
    weights = means[:, inside]
    steep = 2 * values.std() / max(np.ptp(y), np.ptp(x))
    least, most = _LEVELS

    def depths(standard: np.ndarray) -> np.ndarray:
        slopes = steep * standard[:, 1:] if standard.shape[1] > 1 else np.zeros((1, 2))
        turned = values - slopes @ np.stack([y, x])
        level = least + (most - least) * scipy.special.ndtr(standard[:, :1])
        plane = turned.std(axis=1, keepdims=True) * level
        above = np.maximum(turned - plane, 0)
        return (weights @ above.T).T

    return depths
