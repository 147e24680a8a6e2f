"""Likelihood that scans lie on the mesh otherwise than in the patch table."""

import itertools
import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.coupling.orientations import (
    LOOKS,
    ORIENTATIONS,
    TABLES,
    as_measured,
    oriented,
)
from gstlib.surfaces.fitting import planes_over, vertex
from gstlib.surfaces.footprints import moved, on_patch, places_of, spline_of

__all__ = ["AGREES", "CANNOT_TELL", "ELSEWHERE", "SHIFTED", "WAVE_PER_EDGE"]
__all__ += ["Comparison", "Shift", "shows_waves"]

AGREES, SHIFTED = "agrees", "shifted"
ELSEWHERE, CANNOT_TELL = "elsewhere", "cannot tell"
# A triangular mesh of edge a resolves waves down to √3 a, twice the distance between its rows.
WAVE_PER_EDGE = math.sqrt(3)

# One correct study in a hundred may be called wrong, or shifted.
_SIGNIFICANCE = 0.01
# ASSUME: Error of scan and mesh under a patch. A patch shows this error by three independent waves,
# so that the median of its estimates is 0.79 of their mean. Reason: The estimates scatter in this
# way on synthetic stones.
_WAVES, _MEDIAN_OF_WAVES = 3, 0.79
_LEAST_VARIANCE = 1e-14  # mm², so that equal surfaces can be compared
# Points along the side of a patch for the comparison. The mesh does not contain shorter waves.
_POINTS = 24
_SHAPE = _POINTS, _POINTS
# Shifts along each axis, in sides of a patch. For the paper's patches, these are up to 0.2 mm in
# steps of 35 µm; a peak is 0.2 mm wide. Mistaken tables are tried with shifts of 0.1 mm along
# either axis.
_ALONG = np.arange(-6, 7) / 24
_SHIFTS = np.array([*itertools.product(_ALONG, repeat=2)])
_FEW_SHIFTS = np.array([(0, 0), (-3, 0), (3, 0), (0, -3), (0, 3)]) / 24
# ASSUME: Range of patch positions. A patch lies within two standard errors of its position in the
# patch table. Reason: A larger error is a mistake, and mistakes are tested separately.
_ERRORS = 2.0
# Fewer patches have no scatter that distinguishes a common shift from chance.
_FEWEST_PATCHES = 4

# The patches of a table, shifts to try, and the products and squares at these shifts.
_Table = tuple[pd.DataFrame, np.ndarray, np.ndarray, np.ndarray]


def shows_waves(surface: xr.DataArray, patch_mm: float) -> bool:
    """Whether the edges of the mesh, if they are known, resolve waves as long as a patch."""
    return bool(WAVE_PER_EDGE * surface.attrs.get("mesh_edge_mm", 0.0) <= patch_mm)


class Shift(NamedTuple):
    """The common shift (y, x) of all patches, its standard errors, mm, and its p-value."""

    shift: np.ndarray
    errors: np.ndarray
    p_value: float

    @property
    def is_sure(self) -> bool:
        return self.p_value < _SIGNIFICANCE

    @property
    def in_um(self) -> np.ndarray:
        """Shift along x and y, and its standard errors, µm."""
        return 1e3 * np.concatenate([self.shift[::-1], self.errors[::-1]])


class Comparison:
    """Scans and the mesh under them, and the likelihood that the scans lie otherwise.

    The error of scan and mesh is taken as normal. A misfit is the negative logarithm of a
    likelihood: half the squared error over its variance. A lead is the misfit as given minus the
    misfit of another way, in nats.
    """

    def __init__(
        self,
        surface: xr.DataArray,
        patches: pd.DataFrame,
        heights: Sequence[xr.DataArray],
        *,
        patch_mm: float,
        placement_um: float,
    ):
        from skimage.transform import resize_local_mean

        self.surface = surface
        self.patches = patches
        self.patch_mm = patch_mm
        self.spline = spline_of(surface)
        coarse = [resize_local_mean(each.values, _SHAPE) for each in heights]
        self.looks = _looks(np.array(coarse))
        self.shows_waves = shows_waves(surface, patch_mm)
        self.ways = len(patches) + len(LOOKS) - 1  # of one patch
        self.scan = np.sum(self.looks[:, :1] ** 2, axis=-1, keepdims=True)
        shifts = _SHIFTS * patch_mm
        self.products, self.mesh = self._products_at(patches, shifts)
        maps = self.correlation(self.products[:, :1], self.mesh)
        maps = maps.reshape(-1, _ALONG.size, _ALONG.size)
        self.shared = _shared_shift(maps, patch_mm * _ALONG)
        middle = self.shared.shift if self.shared.is_sure else np.zeros(2)
        off = np.hypot(*(shifts - middle).T)
        self.at = int(off.argmin())
        self.under = self._under(patches, shifts[self.at])
        there = self.products[..., [self.at]], self.mesh[..., [self.at]]
        self.fits = self.correlation(*there)[..., 0]
        self.gain, self.variance = self._errors()
        # As given, each patch may be misplaced.
        near = off <= max(off[self.at], _ERRORS * placement_um * 1e-3)
        misfits = self.misfit(self.products[:, :1], self.mesh)
        self.as_given = misfits[..., near].min(axis=(1, 2))
        self.leads = self.as_given[:, np.newaxis] - self.misfit(*there)[:, 1:, 0]
        self.anywhere = self.misfit(0.0, 0.0).ravel()
        self.lead_anywhere = self.as_given - self.anywhere

    @property
    def size_mm(self) -> float:
        """Side of the square, which lies in the middle of the face."""
        return float(self.surface.x[0] + self.surface.x[-1])

    def _products_at(
        self, patches: pd.DataFrame, shifts: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Products of scan and mesh (patches, looks, k), and squares of the mesh (patches, 1, k).

        Both are means over the points, mm², at shifts (k, 2) of all patches along y and x, mm.
        """
        products, squares = [], []
        for shift in shifts:
            under = self._under(patches, shift)
            products.append(np.einsum("pln,pn->pl", self.looks, under))
            squares.append(np.sum(under**2, axis=-1, keepdims=True))
        return np.stack(products, axis=-1), np.stack(squares, axis=-1)

    def correlation(self, products: np.ndarray, mesh: np.ndarray) -> np.ndarray:
        """Correlation from products and squares of the mesh; 0 for flat surfaces."""
        size = np.sqrt(self.scan * mesh)
        return products / np.where(size > 0, size, np.inf)

    def misfit(self, products: Any, mesh: Any) -> np.ndarray:
        """Misfit from products and squares of the mesh."""
        squared_error = self.scan / self.gain**2 - 2 * products / self.gain + mesh
        return squared_error / (2 * self.variance)

    def limit(self, tests: int) -> float:
        """The lead that the best of several wrong ways has in one correct study of a hundred.

        Under a normal error, the lead of a wrong way exceeds q²/2 no more often than a normal
        number exceeds q. Student's t replaces it, because the variance is estimated.
        """
        freedom = _WAVES * len(self.scan)
        quantile = scipy.special.stdtrit(freedom, 1 - _SIGNIFICANCE / tests)
        return float(quantile**2 / 2)

    @cached_property
    def across(self) -> np.ndarray:
        """Misfit (patches, patches) of each scan at the position of each patch."""
        misfits = self.misfit(*self._products_across())[:, 0]
        np.fill_diagonal(misfits, self.as_given)
        return misfits

    @cached_property
    def alternatives(self) -> np.ndarray:
        """Highest lead (patches,) of another look, another patch's position, or any position."""
        others = self.as_given[:, np.newaxis] - self.across
        np.fill_diagonal(others, -np.inf)
        return np.column_stack([self.leads, others, self.lead_anywhere]).max(axis=1)

    @property
    def status(self) -> np.ndarray:
        """Status of each patch."""
        status = np.full(len(self.scan), CANNOT_TELL, dtype=object)
        if self.shows_waves:
            status[self.alternatives < -self.limit(self.ways)] = AGREES
            every = self.limit(len(self.scan) * self.ways)
            status[self.alternatives > every] = ELSEWHERE
        return status

    def _under(self, patches: pd.DataFrame, shift: np.ndarray) -> np.ndarray:
        """Heights (patches, points) of the square under each patch, after a shift (y, x), mm."""
        places = places_of(moved(patches, shift, self.surface, self.patch_mm)).values()
        under = [
            on_patch(self.spline, place, _SHAPE, self.patch_mm) for place in places
        ]
        return _flat(np.array(under))

    def _products_across(self) -> tuple[np.ndarray, np.ndarray]:
        """Products (patches, 1, patches) of each scan and the mesh under each, and its squares."""
        return self.looks[:, :1] @ self.under.T, np.sum(self.under**2, axis=-1)

    @cached_property
    def tables(self) -> dict[str, _Table]:
        """The table with the corrected patches for each of `TABLES`."""
        patches = self.patches
        at, shifts = np.arange(len(_SHIFTS)), _FEW_SHIFTS
        if len(patches) < _FEWEST_PATCHES:
            at, shifts = at[[self.at]], shifts[:1]
        products = self.products[..., at], self.mesh[..., at]
        tables = {"": (patches, self.patch_mm * _SHIFTS[at], *products)}
        for mistake in [*TABLES][1:]:
            x, y = as_measured(patches.x_mm, patches.y_mm, self.size_mm, mistake)
            right = patches.assign(x_mm=x, y_mm=y)
            tables[mistake] = self._table(right, self.patch_mm * shifts)
        return tables

    def _table(self, patches: pd.DataFrame, shifts: np.ndarray) -> _Table:
        return patches, shifts, *self._products_at(patches, shifts)

    def _exchanged(self) -> _Table:
        """The table with each scan at the patch that fits it best."""
        fits = self.correlation(*self._products_across())[:, 0]
        _, place = scipy.optimize.linear_sum_assignment(-fits)
        patches = self.patches.iloc[place]  # whose names do not matter
        return self._table(patches, self.patch_mm * _SHIFTS[[self.at]])

    def _errors(self) -> tuple[float, np.ndarray]:
        """Gain of the scans over the mesh, and the variance of each patch's error along a wave.

        They belong to the table, or the exchanges, and to the look of each patch that fit best,
        which may differ from the given ones. The error of a patch is taken along the waves by which
        the looks of the mesh differ. The variance is the mean of its own and of the usual variance
        of the patches.
        """
        best, under = self.fits, self.under
        _, *others = self.tables.values()
        for patches, shifts, *products in (*others, self._exchanged()):
            fits = self.correlation(*products)
            totals = fits.max(axis=1).sum(axis=0)
            at = totals.argmax()
            if totals[at] > best.max(axis=1).sum():
                best, under = fits[..., at], self._under(patches, shifts[at])
        laid = self.looks[np.arange(len(best)), best.argmax(axis=1)]
        mesh = np.maximum(np.sum(under**2, axis=-1), _LEAST_VARIANCE)
        gain = float(np.median(np.sum(laid * under, axis=-1) / mesh)) or 1.0
        looks = _looks(_POINTS * under.reshape(-1, *_SHAPE))
        waves = looks[:, 1:] - under[:, np.newaxis]
        squares = np.sum(waves**2, axis=-1)
        error = laid / gain - under
        along = np.einsum("pn,pwn->pw", error, waves) ** 2
        own = np.mean(along / np.where(squares > 0, squares, np.inf), axis=1)
        variance = (own + np.median(own) / _MEDIAN_OF_WAVES) / 2
        return gain, np.maximum(variance, _LEAST_VARIANCE)[:, np.newaxis, np.newaxis]


def _looks(heights: np.ndarray) -> np.ndarray:
    """Heights (patches, points, points) in each of the `LOOKS`, flat (patches, looks, points)."""
    turned = [oriented(heights, name) for name in ORIENTATIONS]
    flat = _flat(np.stack(turned, axis=1))
    return np.concatenate([flat, -flat], axis=1)


def _flat(heights: np.ndarray) -> np.ndarray:
    """Heights (..., points, points) without planes, as vectors whose length is their r.m.s."""
    planes, _ = np.linalg.qr(planes_over(*np.indices(_SHAPE)).reshape(3, -1).T)
    flat = heights.reshape(*heights.shape[:-2], -1) / _POINTS
    return flat - flat @ planes @ planes.T


def _shared_shift(maps: np.ndarray, steps: np.ndarray) -> Shift:
    """Shift at the peak of the mean of maps (patches, k, k).

    The errors are jackknife errors over the patches, and the test is Hotelling's.
    """
    number, total = len(maps), maps.sum(axis=0)
    unknown = np.full(2, np.nan)
    if number < _FEWEST_PATCHES:
        return Shift(unknown, unknown, np.nan)
    shift = _peak(total, steps)
    without = [_peak(total - one, steps) for one in maps]
    covariance = (number - 1) * np.cov(without, rowvar=False, bias=True)
    errors = np.sqrt(np.diag(covariance))
    p_value = np.nan
    if (errors > 0).all():
        hotelling = shift @ np.linalg.solve(covariance, shift)
        ratio = hotelling / 2 * (number - 2) / (number - 1)
        p_value = float(scipy.special.fdtrc(2, number - 2, ratio))
    return Shift(shift, errors, p_value)


def _peak(values: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Position (y, x) of the highest value (k, k), by parabolas; NaN if it is at the edge."""
    row, column = np.unravel_index(values.argmax(), values.shape)
    if min(row, column) == 0 or max(row, column) == len(steps) - 1:
        return np.full(2, np.nan)
    step = steps[1] - steps[0]
    y = steps[row] + vertex(values[row - 1 : row + 2, column], step)
    x = steps[column] + vertex(values[row, column - 1 : column + 2], step)
    return np.array([y, x])
