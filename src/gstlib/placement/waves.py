"""The waves that a mesh and a scan of the same stone both hold, over the footprint of a patch.

They are longer than the mesh's points can hold and not much longer than the patch, which has lost
its plane. Both surfaces are written as the same few numbers, one for each wave.
"""

import math
from collections.abc import Callable

import numpy as np
import xarray as xr

from gstlib.coupling import footprint_weights
from gstlib.preprocess.leveling import remove_plane
from gstlib.surface import make_surface, spacing_of

__all__ = ["FLIPS", "POINTS", "VARIANTS", "Waves", "interpolant", "shortest_wave"]

# A triangular net of points of edge a holds waves down to √3 a, twice the distance of its rows.
_SHORTEST_PER_EDGE = math.sqrt(3)
# Shorter waves than this share of a patch's side add work, and next to nothing about its place.
_SHORTEST_PER_SIDE = 1 / 4
# Lattice points along a patch's side: 18 µm for the paper's, far less than a peak is wide.
POINTS = 48
# How far around its nominal place (in sides) a patch is laid to learn what chance does.
_REACH = 5.0
# ASSUME: a scan whose mould was undone wrongly is reversed along x, along y or along both, or has
# its heights inverted, or both; other turns are the patch table's.
VARIANTS = {
    "as given": (1, 1, 1),
    "reversed along x": (1, 1, -1),
    "reversed along y": (1, -1, 1),
    "reversed along x and y": (1, -1, -1),
    "inverted": (-1, 1, 1),
    "inverted and reversed along x": (-1, 1, -1),
    "inverted and reversed along y": (-1, -1, 1),
    "inverted and reversed along x and y": (-1, -1, -1),
}
FLIPS = len(VARIANTS) // 2  # the rest are the same, inverted


def shortest_wave(size_mm: float, edge_mm: float, surface: xr.DataArray) -> float:
    """The shortest wave (mm) that is compared, for patches and triangles of these sides."""
    # ASSUME: the mesh holds the waves that the net of its points can hold, and no others; a
    # smoother mesh (of fewer pictures, say) shows as a lower correlation.
    return max(
        _SHORTEST_PER_EDGE * edge_mm, 2 * max(spacing_of(surface)), _SHORTEST_PER_SIDE * size_mm
    )


class Waves:
    """The waves that both scales hold, as functions over a patch's footprint.

    They are products of cosines with whole half-waves along each side, less their planes, made
    orthonormal: the sum over a wave's number times its shape gives back the level, smooth surface.
    """

    def __init__(self, size: float, shortest: float):
        self.size = size
        highest = 2 * size / shortest
        orders = np.arange(int(highest) + 1)
        along_y, along_x = (k.ravel() for k in np.meshgrid(orders, orders, indexing="ij"))
        # without those that are all but a plane
        kept = (np.hypot(along_y, along_x) <= highest) & (along_y + along_x > 1)
        self.along_y, self.along_x = along_y[kept], along_x[kept]
        self.shapes, self.kernels, self._root = self._on_lattice(0.0)

    def __len__(self) -> int:
        return len(self.along_y)

    def of_patch(self, height: xr.DataArray) -> np.ndarray:
        """Numbers (8, waves), mm, of each of `VARIANTS` of a patch."""
        level = remove_plane(height)[0].values
        along_y, along_x = (
            np.cos(np.pi * orders[:, None] * (np.arange(count) + 0.5) / count)
            for orders, count in zip((self.along_y, self.along_x), level.shape, strict=True)
        )
        raw = np.einsum("ky,yx,kx->k", along_y, level, along_x, optimize=True) / level.size
        return np.array(
            [
                np.linalg.solve(
                    self._root, height * flip_y**self.along_y * flip_x**self.along_x * raw
                )
                for height, flip_y, flip_x in VARIANTS.values()
            ]
        )

    def under(
        self,
        spline: Callable,
        low: np.ndarray,
        high: np.ndarray,
        place: np.ndarray,
        rotation_deg: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of the macroscale under the footprint laid at every point of a lattice.

        Parameters
        ----------
        spline : callable
            Height (mm) of the macroscale on rows y and columns x.
        low, high : (2,) ndarray
            Corners (y, x) of the square, mm.
        place : (2,) ndarray
            Nominal centre (y, x), mm; it is a point of the lattice.
        rotation_deg : float

        Returns
        -------
        (waves, ny, nx) ndarray, (2,) ndarray of int
            The numbers, mm; the lattice's index of the nominal place.
        """
        kernels = self.kernels if rotation_deg == 0 else self._on_lattice(rotation_deg)[1]
        step = self.size / POINTS
        turn = math.radians(rotation_deg)
        half = self.size / 2 * (abs(math.cos(turn)) + abs(math.sin(turn)))
        reach = round(_REACH * POINTS)
        # a footprint at the very edge is in the square, whatever the rounding
        before, after = (
            np.clip(np.floor(room / step + 1e-6), 0, reach).astype(int)
            for room in (place - half - low, high - half - place)
        )
        points = [
            centre + (np.arange(-b, a + width) - (width - 1) / 2) * step
            for centre, b, a, width in zip(place, before, after, kernels.shape[1:], strict=True)
        ]
        # Correlation as convolution: the sum over a footprint at each of its places.
        from scipy.signal import oaconvolve

        numbers = oaconvolve(spline(*points)[None], kernels[:, ::-1, ::-1], "valid", axes=(1, 2))
        return numbers, before

    def _on_lattice(self, rotation_deg: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Shapes, kernels that give their numbers, and the root that makes them orthonormal."""
        turn = math.radians(rotation_deg)
        cosine, sine = math.cos(turn), math.sin(turn)
        width = 2 * math.ceil(POINTS * (abs(cosine) + abs(sine)) / 2 - 1e-9)
        centred = (np.arange(width) - (width - 1) / 2) / POINTS
        y, x = (axis.ravel() for axis in np.meshgrid(centred, centred, indexing="ij"))
        # along the patch's own axes, from its corner, in sides
        v, u = np.clip([cosine * y - sine * x + 0.5, cosine * x + sine * y + 0.5], 0, 1)
        grid = make_surface(np.zeros((width, width)), 1 / POINTS)
        middle = width / POINTS / 2
        area = footprint_weights(grid, middle, middle, 1.0, rotation_deg).ravel()
        area /= area.sum()

        shapes = np.cos(np.pi * self.along_y[:, None] * v) * np.cos(
            np.pi * self.along_x[:, None] * u
        )
        planes = np.stack([np.ones_like(v), v - 0.5, u - 0.5])
        shapes -= ((shapes * area) @ planes.T) @ np.linalg.solve((planes * area) @ planes.T, planes)
        root = np.linalg.cholesky((shapes * area) @ shapes.T)
        shapes = np.linalg.solve(root, shapes)
        as_map = (len(self), width, width)
        return shapes.reshape(as_map), (shapes * area).reshape(as_map), root


def interpolant(surface: xr.DataArray) -> tuple[Callable, np.ndarray, np.ndarray]:
    """Height at rows y and columns x, and the square's corners (y, x)."""
    from scipy.interpolate import RectBivariateSpline

    y, x = surface.y.values, surface.x.values
    degree = min(3, len(y) - 1, len(x) - 1)
    spline = RectBivariateSpline(y, x, surface.values, kx=degree, ky=degree)
    half = np.array(spacing_of(surface)) / 2

    def height(rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
        # the outer half of the outermost elements is as high as their centres
        return spline(np.clip(rows, y[0], y[-1]), np.clip(columns, x[0], x[-1]))

    return height, np.array([y[0], x[0]]) - half, np.array([y[-1], x[-1]]) + half
