"""Does each patch lie where the patch table says?

The mesh and a scan show the same stone, so the waves that both hold must agree wherever the patch
truly lies. Those waves are few: longer than the points of the mesh can hold, and no longer than the
patch, which has lost its plane. Both surfaces are therefore written as the same few numbers over
the patch's footprint, and compared at trial shifts of it.

On the generated specimen a single patch's shift is found to some 45 µm. That tells three faults: a
shift that all patches share, a patch that lies elsewhere than stated, and a mould undone wrongly.
"""

import logging
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.coupling import half_extent
from gstlib.preprocess.leveling import remove_plane
from gstlib.surface import spacing_of

__all__ = ["AGREES", "ALL", "CANNOT_TELL", "SHIFTED", "SHORTEST_PER_EDGE", "place_patches"]

_log = logging.getLogger(__name__)

AGREES, SHIFTED, CANNOT_TELL = "agrees", "shifted", "cannot tell"
ALL = "all"  # the row of all patches together

_COLUMNS = [
    "patch", "correlation_nominal", "correlation", "shift_x_um", "shift_y_um", "shift_x_error_um",
    "shift_y_error_um", "verdict", "looks",
]  # fmt: skip

# ASSUME: a scan whose mould was undone wrongly is reversed along x, along y or along both, or has
# its heights inverted, or both. Other turns are the patch table's.
_FLIPS = {
    "as given": (1, 1),
    "reversed along x": (1, -1),
    "reversed along y": (-1, 1),
    "reversed along x and y": (-1, -1),
}
_LOOKS = [*_FLIPS, "inverted", *(f"inverted and {name}" for name in list(_FLIPS)[1:])]

# Level of every test: where all of 25 patches lie right, one study in four warns of one of them.
_SIGNIFICANCE = 0.01
# A triangular net of points of edge a holds waves down to √3 a, twice the distance of its rows.
SHORTEST_PER_EDGE = math.sqrt(3)
# Waves shorter than this share of a patch's side add work, and next to nothing about its place.
_SHORTEST_PER_SIDE = 1 / 4
# Points along a patch's side at which surfaces are compared, and trial shifts along it: 35 µm apart
# for the paper's, where a peak is 200 µm wide.
_POINTS = 24
# Two shifts and one factor of the heights are fitted; at least one number more must be left.
_FITTED = 3
# Fewer patches have no scatter to judge a shared shift by, and fit mirror images by chance.
_FEWEST_PATCHES = 4
# All patches together are warned of below this correlation. With every place right it was 0.87 on
# the generated specimen and 0.70 on a measured pebble; with one in five, 0.30; with none, 0.06.
_LOW = 0.5


def place_patches(
    surface: xr.DataArray,
    patches: pd.DataFrame,
    heights: Mapping[str, xr.DataArray],
    *,
    size_mm: float,
    edge_mm: float,
    maximum_shift_um: float,
) -> pd.DataFrame:
    """Find where each patch lies on the square, and warn where it should not.

    Parameters
    ----------
    surface : (y, x) xarray.DataArray
        Heights of the macroscale in the square's frame, mm.
    patches : pandas.DataFrame
        Patch table: ``patch, x_mm, y_mm``, optionally ``rotation_deg``.
    heights : mapping of patch to (y, x) xarray.DataArray
        The prepared scans, mm, no NaN. Each is looked up once.
    size_mm : float
        Side of a patch.
    edge_mm : float
        Mean edge of the mesh's triangles, mm.
    maximum_shift_um : float
        Largest shift tried, along each axis.

    Returns
    -------
    pandas.DataFrame
        A row for each patch, and one (`ALL`) for a shift that all of them share:
        ``correlation_nominal``, ``correlation`` (at the best shift); ``shift_x_um``,
        ``shift_y_um`` (true less nominal place, along the square's axes) and their standard
        errors, NaN where there is no peak; ``verdict``; and, for all patches, which mould they
        look like (``looks``), empty where that is not clear.
    """
    from scipy.stats import chi2

    names = [*patches.patch, ALL]
    rows = {name: {"patch": name, "verdict": CANNOT_TELL, "looks": ""} for name in names}
    waves = _Waves(surface, size_mm, edge_mm)
    free = waves.count - _FITTED
    if free > 0:
        step = size_mm / _POINTS
        reach = max(1, int(maximum_shift_um * 1e-3 / step))
        shifts = np.arange(-reach, reach + 1) * step
        trials = np.stack(np.meshgrid(shifts, shifts, indexing="ij"), axis=-1)
        elsewhere = _wrong_places(waves, reach)
        found = [
            _match(waves, row, heights[row.patch], trials, elsewhere)
            for row in patches.itertuples(index=False)
        ]
        windows = np.array([window for window, *_ in found])
        # ASSUME: chance is alike for all patches, so that their searches in wrong places add up.
        chance = np.concatenate([by_chance for _, by_chance, *_ in found])
        # ASSUME: the two surfaces disagree by the same on all patches: they are of one stone, seen
        # by one mesh and one instrument. The median ignores patches that lie elsewhere.
        left = [energy * (1 - peak[0] ** 2) for _, _, energy, peak in found if peak]
        noise = np.median(left) / chi2.median(free) if left else math.nan
        certain = []
        for name, (window, _, energy, peak) in zip(patches.patch, found, strict=True):
            highest = window[0].max()
            rows[name] |= {"correlation_nominal": window[0, reach, reach], "correlation": highest}
            if peak is None:
                continue
            correlation, shift, covariance = peak
            rows[name] |= _shift_columns(shift, covariance * noise / energy, free * len(left))
            rows[name]["correlation"] = correlation
            if (1 + (chance >= highest).sum()) / (1 + len(chance)) < _SIGNIFICANCE:
                certain.append(shift)
            else:
                rows[name]["verdict"] = CANNOT_TELL
        mean = windows[:, 0].mean(axis=0)
        rows[ALL] |= {"correlation_nominal": mean[reach, reach], "correlation": mean.max()}
        rows[ALL]["looks"] = _looks(windows, free)
        if (number := len(certain)) >= _FEWEST_PATCHES:
            # Hotelling's test: the error follows from how the patches' own shifts scatter.
            covariance, factor = np.cov(np.transpose(certain)) / number, (number - 1) / (number - 2)
            rows[ALL] |= _shift_columns(np.mean(certain, axis=0), covariance, number - 2, factor)
    table = pd.DataFrame(list(rows.values()), columns=_COLUMNS)
    for row in table[table.verdict == SHIFTED].itertuples(index=False):
        _log.warning(
            "%s best with the macroscale when shifted in x by %+.0f ± %.0f µm and y by %+.0f ± "
            "%.0f µm: check its place in the patch table, or square.frame if all are shifted",
            "all patches together correlate"
            if row.patch == ALL
            else f"patch {row.patch} correlates",
            *(row.shift_x_um, row.shift_x_error_um, row.shift_y_um, row.shift_y_error_um),
        )
    total = table.iloc[-1]
    if total.looks not in ("", _LOOKS[0]):
        _log.warning("the patches fit the macroscale better %s: check scans.mould", total.looks)
    elif total.verdict != SHIFTED and total.correlation < _LOW:
        _log.warning(
            "the patches together correlate with the macroscale by no more than %.2f, as if few or "
            "none of them lay where the patch table says: check its x_mm and y_mm, square.frame, "
            "and the units of mesh and scans (a mesh that is too smooth looks the same)",
            total.correlation,
        )
    return table


class _Waves:
    """The waves that mesh and scan both hold, as orthonormal functions over a footprint.

    They are products of cosines with whole half-waves along each side, less their planes.
    """

    def __init__(self, surface: xr.DataArray, size_mm: float, edge_mm: float):
        from scipy.ndimage import spline_filter

        self.size_mm, self.spacing = size_mm, np.array(spacing_of(surface))
        self.first = np.array([surface.y.values[0], surface.x.values[0]])
        self.spline = spline_filter(surface.values, mode="mirror")
        # ASSUME: the mesh holds the waves that the net of its points can hold, and no others. A
        # smoother mesh (made from fewer pictures, say) shows as a lower correlation.
        shortest = max(
            SHORTEST_PER_EDGE * edge_mm, 2 * self.spacing.max(), _SHORTEST_PER_SIDE * size_mm
        )
        highest = 2 * size_mm / shortest
        along = (np.arange(_POINTS) + 0.5) / _POINTS
        v, u = (axis.ravel() for axis in np.meshgrid(along, along, indexing="ij"))
        self.footprint = size_mm * (np.stack([v, u], axis=1) - 0.5)  # points (y, x), mm
        planes = [np.ones_like(v), v, u]
        cosines = [
            np.cos(np.pi * along_y * v) * np.cos(np.pi * along_x * u)
            for along_y, along_x in np.ndindex(2 * (int(highest) + 1,))
            # the others are all but planes
            if math.hypot(along_y, along_x) <= highest and along_y + along_x > 1
        ]
        self.functions = np.linalg.qr(np.stack(planes + cosines, axis=1))[0][:, len(planes) :]
        self.count = len(cosines)

    def heights(self, places: np.ndarray) -> np.ndarray:
        """Heights (mm) of the macroscale at points (..., 2) (y, x) of the square."""
        from scipy.ndimage import map_coordinates

        # The outer half of an outermost element is as high as its centre.
        at = np.clip((places - self.first) / self.spacing, 0, np.array(self.spline.shape) - 1)
        return map_coordinates(self.spline, np.moveaxis(at, -1, 0), prefilter=False, mode="mirror")

    def under(self, places: np.ndarray, rotation_deg: float) -> np.ndarray:
        """Numbers (..., waves), of length 1, of the macroscale at footprints around (..., 2)."""
        cosine, sine = np.cos(np.radians(rotation_deg)), np.sin(np.radians(rotation_deg))
        turned = self.footprint @ [[cosine, -sine], [sine, cosine]]
        return _unit(self.heights(places[..., None, :] + turned) @ self.functions)

    def room(self, rotation_deg: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest centre (y, x) of a footprint in the square, mm."""
        half = half_extent(self.size_mm, rotation_deg)
        corner = self.first - self.spacing / 2
        return corner + half, corner + self.spacing * self.spline.shape - half


def _unit(numbers: np.ndarray) -> np.ndarray:
    """Vectors (..., waves) of length 1 each; those of length 0 stay so."""
    length = np.linalg.norm(numbers, axis=-1, keepdims=True)
    return numbers / np.where(length > 0, length, 1.0)


def _wrong_places(waves: _Waves, reach: int) -> tuple[np.ndarray, np.ndarray]:
    """Centres (n, 2) of windows side by side all over the square; numbers (n, k, k, waves)."""
    from skimage.util import view_as_blocks

    low, high = waves.room()
    step, width = waves.size_mm / _POINTS, 2 * reach + 1
    counts = ((high - low) / step + 1e-6).astype(int) // width * width
    if not counts.all():
        return np.empty((0, 2)), np.empty((0, width, width, waves.count))
    # The points of all these footprints fall on one lattice, where heights are needed only once.
    y, x = (
        first - waves.size_mm / 2 + (0.5 + np.arange(_POINTS + count - 1)) * step
        for first, count in zip(low, counts, strict=True)
    )
    heights = waves.heights(np.stack(np.meshgrid(y, x, indexing="ij"), axis=-1))
    footprints = np.lib.stride_tricks.sliding_window_view(heights, 2 * (_POINTS,))
    numbers = np.array([row.reshape(-1, _POINTS**2) @ waves.functions for row in footprints])
    windows = view_as_blocks(_unit(numbers), (width, width, waves.count))
    centres = low + (np.argwhere(np.ones(counts // width)) * width + reach) * step
    return centres, windows.reshape(-1, width, width, waves.count)


def _match(
    waves: _Waves,
    row: Any,
    height: xr.DataArray,
    trials: np.ndarray,
    elsewhere: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray, float, tuple[float, np.ndarray, np.ndarray] | None]:
    """Compare a patch (its `row` of the patch table) at trial shifts (k, k, 2) and elsewhere.

    Gives its correlations (8, k, k) for each of `_LOOKS`, where a footprint that would leave the
    square is at its edge; the highest one in each equal window far away; its energy (mm²), the sum
    of the squares of its waves; and, unless it is at the limits, the best shift: correlation, shift
    (y, x), mm, and its covariance, which has yet to be multiplied by noise over energy.
    """
    from scipy.optimize import least_squares
    from skimage.transform import resize_local_mean

    # ASSUME: a patch may be shifted, but its rotation is the stated one.
    rotation = float(getattr(row, "rotation_deg", 0.0))
    centre, room = np.array([row.y_mm, row.x_mm]), waves.room(rotation)
    level = resize_local_mean(remove_plane(height)[0].values, 2 * (_POINTS,))
    flips = [level[::along_y, ::along_x].ravel() for along_y, along_x in _FLIPS.values()]
    numbers = np.array(flips) @ waves.functions
    flipped, energy = _unit(numbers), float(numbers[0] @ numbers[0])
    around = np.moveaxis(waves.under(np.clip(centre + trials, *room), rotation) @ flipped.T, -1, 0)
    # None of the wrong footprints may overlap much with where the patch truly lies.
    # ASSUME: chance is alike all over the square, at any rotation, and for mirror images.
    centres, windows = elsewhere
    far = np.abs(centres - centre).max(axis=1) >= 2 * trials.max() + waves.size_mm / 2
    chance = (windows[far] @ flipped.T).max(axis=(1, 2)).ravel()
    peak = None
    low, high = np.clip((trials[0, 0], trials[-1, -1]), *(end - centre for end in room))
    if (low < high).all():

        def unexplained(shift: np.ndarray) -> np.ndarray:
            # what is left of the patch when the factor of the heights is the best one
            under = waves.under(centre + shift, rotation)
            return flipped[0] - under * (under @ flipped[0])

        start = np.clip(trials.reshape(-1, 2)[around[0].argmax()], low, high)
        scale = waves.size_mm / _POINTS
        # To far more digits than are printed: how it stops differs from processor to processor.
        limits = {"ftol": 1e-14, "xtol": 1e-11, "gtol": 1e-14}
        fit = least_squares(unexplained, start, bounds=(low, high), x_scale=scale, **limits)
        correlation = float(waves.under(centre + fit.x, rotation) @ flipped[0])
        normal = fit.jac.T @ fit.jac
        if not fit.active_mask.any() and correlation > 0 and np.linalg.cond(normal) < 1e12:
            peak = correlation, fit.x, np.linalg.inv(normal)
    return np.concatenate([around, -around]), chance, energy, peak


def _shift_columns(
    shift: np.ndarray, covariance: np.ndarray, free: int, factor: float = 1.0
) -> dict[str, Any]:
    """Shift and standard errors in µm, and an F test of it with `factor` times the covariance."""
    from scipy.stats import f as f_distribution

    names = "shift_y_um", "shift_x_um", "shift_y_error_um", "shift_x_error_um"
    values = 1e3 * np.concatenate([shift, np.sqrt(np.diag(covariance))])
    ratio = shift @ np.linalg.solve(factor * covariance, shift) / 2
    verdict = SHIFTED if f_distribution.sf(ratio, 2, free) < _SIGNIFICANCE else AGREES
    return dict(zip(names, values, strict=True)) | {"verdict": verdict}


def _looks(windows: np.ndarray, free: int) -> str:
    """Which of `_LOOKS` windows (patches, 8, k, k) fit clearly best; empty if none does."""
    from scipy.stats import f as f_distribution

    tops = [np.unravel_index(one.argmax(), one.shape) for one in windows.mean(axis=0)]
    left = [
        (1 - np.clip(windows[:, index, *top], 0, 1) ** 2).mean() for index, top in enumerate(tops)
    ]
    best, second = np.argsort(left)[:2]
    free *= len(windows)
    clear = left[second] > f_distribution.isf(_SIGNIFICANCE / len(left), free, free) * left[best]
    return _LOOKS[best] if clear and len(windows) >= _FEWEST_PATCHES else ""
