"""What use takes off the generated stone: height loss by rules that know nothing of contact.

Three things happen. Summits are flattened, more so where the macroscale surface is high, but with
chance. Chips break out, more of them in the same regions. And some loss comes about anywhere, in
valleys as on summits, as grit between the stones would do. Where they meet, the deepest counts.

Wear placed at random is the same wear somewhere else: what a study finds in it, it finds by chance.
"""

import numpy as np
import scipy.ndimage

from gstlib.specimen.parameters import SpecimenParameters
from gstlib.specimen.randomness import smooth_field, stream
from gstlib.specimen.stone import Stone, fit_plane

__all__ = ["wear_depth"]

# ASSUME: these three rules and their sizes; the paper shows traces, it does not measure them. They
# do not know the contact solver, so that scoring its prediction against them is no tautology.

# Points of the coarse grid per length over which the severity varies.
_POINTS_PER_LENGTH = 8
# Severity falls from 3/4 to 1/4 over about twice this share of the spread of what decides it.
_SOFTNESS = 0.25
# Without severity summits are cut at so many r.m.s. above the smoothed stone: hardly ever.
_UNWORN_SIGMA = 3.5
# Spread of the chips' radii, as the standard deviation of their logarithm, and the largest radius
# over the median one.
_CHIP_SPREAD, _CHIP_LARGEST = 0.4, 3.0


def wear_depth(stone: Stone, parameters: SpecimenParameters) -> np.ndarray:
    """Depth of the material lost between T0 and T1, on the grid of the stone's detail.

    Returns
    -------
    (n, n) ndarray of float32
        mm, never negative.
    """
    p = parameters
    grid = stone.grid()
    step = max(1, int(p.wear_chance_length_um / _POINTS_PER_LENGTH / p.scan_spacing_um))
    coarse = grid[0] + np.arange(-(-(len(grid) - 1) // step) + 1) * step * stone.spacing
    height = stone.macroscale(coarse, coarse)
    height -= fit_plane(height, coarse, coarse)[2]
    severity = _severity(height, step * stone.spacing, p)

    # a summit is what stands out of the smoothed stone; the more severe, the deeper it is cut
    smoothing = p.wear_reference_length_um * 1e-3 / (step * stone.spacing)
    waves = height - scipy.ndimage.gaussian_filter(height, smoothing, mode="nearest")
    sigma = float(np.hypot(waves.std(), stone.detail.std()))
    cut = sigma * (_UNWORN_SIGMA - (_UNWORN_SIGMA - p.wear_reach_sigma) * severity)
    places = np.arange(len(grid)) / step
    depth = stone.detail - _bilinear((cut - waves).astype(np.float32), places)
    np.maximum(depth, 0, out=depth)

    _valleys(depth, stone, p)
    _chips(depth, severity, step, stone, p)
    return _elsewhere(depth, p) if p.wear_placement == "random" else depth


def _elsewhere(depth: np.ndarray, p: SpecimenParameters) -> np.ndarray:
    """The same wear, moved over the grid's edges by a shift drawn by chance."""
    # ASSUME: every shift is as likely as any other, so that on average over shifts the wear has no
    # covariance with any surface; its amount, the shape of its traces and how they cluster stay.
    shift = stream(p.seed, "wear", "placement").integers(0, len(depth), 2)
    return np.roll(depth, shift, axis=(0, 1))


def _severity(height: np.ndarray, spacing: float, p: SpecimenParameters) -> np.ndarray:
    """How severe wear is, 0 to 1: high macroscale places are likelier to be worn, no more."""
    chance = smooth_field(
        stream(p.seed, "wear", "severity"), len(height), spacing, p.wear_chance_length_um * 1e-3
    )
    decides = height + chance * p.wear_chance_um * 1e-3
    level = np.quantile(decides, 1 - p.wear_share)
    return 1 / (1 + np.exp(-(decides - level) / (_SOFTNESS * decides.std())))


def _bilinear(coarse: np.ndarray, places: np.ndarray) -> np.ndarray:
    """A coarse grid at the fractional indices `places` of its rows and of its columns."""
    low = np.minimum(places.astype(int), len(coarse) - 2)
    weight = (places - low).astype(coarse.dtype)
    rows = coarse[low] * (1 - weight[:, None]) + coarse[low + 1] * weight[:, None]
    return rows[:, low] * (1 - weight) + rows[:, low + 1] * weight


def _valleys(depth: np.ndarray, stone: Stone, p: SpecimenParameters) -> None:
    """Deepen `depth` by the loss that comes about whatever the height."""
    if p.valley_share == 0:
        return
    field = smooth_field(
        stream(p.seed, "wear", "valleys"), len(depth), stone.spacing, p.valley_size_um * 1e-3
    )
    level = np.quantile(field[::4, ::4], 1 - p.valley_share)
    peak = max(float(field.max()) - level, np.finfo(np.float32).tiny)
    loss = np.sqrt(np.clip((field - level) / peak, 0, 1)) * (p.valley_depth_um * 1e-3)
    np.maximum(depth, loss, out=depth)


def _chips(
    depth: np.ndarray, severity: np.ndarray, step: int, stone: Stone, p: SpecimenParameters
) -> None:
    """Deepen `depth` by pits: paraboloids whose number follows the severity (every `step`-th)."""
    generator = stream(p.seed, "wear", "chips")
    extent = len(depth) * stone.spacing
    tried = generator.poisson(p.chips_per_mm2 * extent**2)
    places = generator.random((tried, 2)) * len(depth)
    spread = np.exp(_CHIP_SPREAD * generator.standard_normal(tried))
    radii = p.chip_radius_um * np.minimum(spread, _CHIP_LARGEST) / p.scan_spacing_um
    kept = generator.random(tried) < severity[tuple((places / step).astype(int).T)]
    for (row, column), radius in zip(places[kept], radii[kept], strict=True):
        reach = int(radius) + 1
        rows, columns = (
            slice(max(int(centre) - reach, 0), int(centre) + reach + 2) for centre in (row, column)
        )
        window = depth[rows, columns]
        v = (np.arange(window.shape[0]) + rows.start - row) / radius
        u = (np.arange(window.shape[1]) + columns.start - column) / radius
        bowl = 1 - v[:, None] ** 2 - u[None, :] ** 2
        deepest = p.chip_depth_share * radius * stone.spacing
        np.maximum(window, (deepest * bowl).astype(np.float32), out=window)
