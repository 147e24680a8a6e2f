"""The pebble: its smooth shape, and a closed mesh of it with even edges.

The shape is an egg in plan, rounded below, and above a use-face that is nearly flat and slightly
dished. With rho the distance from the centre, 1 at the rim, the upper side is
``rise (1 - rho^6)^q - concavity (1 - rho^2)^2`` and the lower ``-depth (1 - rho^2)^q``, with a
q that gives a rim like a pebble's, neither a cylinder's (0) nor a lens's (1).

Mesh vertices lie on a spiral of the golden angle, spread so that each has the same area of stone;
they are joined by the convex hull of their images on a sphere under a map that keeps angles (for
the body of revolution next to the pebble), so the triangles stay well shaped.
"""

from dataclasses import dataclass

import numpy as np
import scipy.ndimage
from scipy.spatial import ConvexHull

__all__ = ["Pebble", "even_triangulation"]

# ASSUME: the paper gives the outer size and a slightly concave use-face; the rest of the shape is
# free, and far from the analysed square.

# Egg shape: the pebble is wider by this share at the +x end than in the middle, before scaling.
_TAPER = 0.25
# Height of the crest of the use-face over the rim, as a share of the pebble's height.
_RISE_SHARE = 0.2
# Exponent q of the rim.
_RIM_EXPONENT = 0.75
# Area of a vertex over the square of the mean edge length, measured on this kind of mesh.
_AREA_PER_EDGE_SQUARED = 0.8008
_TABLE_SIZE = (1024, 512)


@dataclass(frozen=True)
class Pebble:
    """The smooth shape of the stone, use-face up, the use-face's centre at the origin.

    Attributes
    ----------
    outer_size_mm : (3,) tuple of float
        Outer size along x, y and z.
    concavity_mm : float
        How deep the use-face is dished at its centre, against the same face without the dish.
    """

    outer_size_mm: tuple[float, float, float]
    concavity_mm: float

    @property
    def _half_axes(self) -> tuple[float, float]:
        return self.outer_size_mm[0] / 2, self.outer_size_mm[1] / 2

    @property
    def _width_scale(self) -> float:
        """Largest of sqrt(1 - u^2) (1 + taper u): scales the egg to the asked width."""
        u = (np.sqrt(1 + 8 * _TAPER**2) - 1) / (4 * _TAPER)
        return float(np.sqrt(1 - u**2) * (1 + _TAPER * u))

    @property
    def _rise(self) -> float:
        return _RISE_SHARE * self.outer_size_mm[2]

    def _above(self, rho_squared: np.ndarray) -> np.ndarray:
        """Height (mm) of the upper side over the rim's plane."""
        rho_squared = np.clip(rho_squared, 0, 1)
        dome = self._rise * (1 - rho_squared**3) ** _RIM_EXPONENT
        return dome - self.concavity_mm * (1 - rho_squared) ** 2

    @property
    def _depth(self) -> float:
        """Depth (mm) of the lower side below the rim's plane."""
        crest = self._above(np.linspace(0, 1, 10001)).max()
        return self.outer_size_mm[2] - float(crest)

    def rim_distance_squared(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """rho² of the place (x, y) in mm: 0 at the centre of the use-face, 1 at the rim."""
        half_x, half_y = self._half_axes
        u = x / half_x
        return u**2 + (y * self._width_scale / (half_y * (1 + _TAPER * u))) ** 2

    def use_face(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Height (mm) of the smooth use-face at (x, y) in mm, zero at its centre."""
        return self._above(self.rim_distance_squared(x, y)) - self._above(np.zeros(()))

    def points(self, colatitude: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
        """Points (mm) of the shape: rho is the sine of `colatitude` (0 top, pi bottom).

        Returns
        -------
        (..., 3) ndarray
        """
        half_x, half_y = self._half_axes
        colatitude, azimuth = np.broadcast_arrays(colatitude, azimuth)
        rho = np.sin(colatitude)
        u = rho * np.cos(azimuth)
        v = rho * np.sin(azimuth) * (1 + _TAPER * u) / self._width_scale
        upper = self._above(rho**2)
        lower = -self._depth * np.clip(1 - rho**2, 0, 1) ** _RIM_EXPONENT
        z = np.where(colatitude <= np.pi / 2, upper, lower) - self._above(np.zeros(()))
        return np.stack([half_x * u, half_y * v, z], axis=-1)


def even_triangulation(pebble: Pebble, edge_mm: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles of one size all over the pebble.

    Parameters
    ----------
    pebble : Pebble
    edge_mm : float
        Mean edge length, mm.

    Returns
    -------
    vertices : (n, 3) ndarray
        mm.
    faces : (m, 3) ndarray of int
        Vertex numbers, anticlockwise as seen from outside.
    upper : (n,) ndarray of bool
        Whether a vertex is on the use-face's side of the rim.
    """
    colatitude_nodes = np.linspace(0, np.pi, _TABLE_SIZE[0] + 1)
    azimuth_nodes = np.linspace(0, 2 * np.pi, _TABLE_SIZE[1] + 1)
    nodes = pebble.points(colatitude_nodes[:, None], azimuth_nodes[None, :])
    area = _quad_areas(nodes)
    count = round(area.sum() / (_AREA_PER_EDGE_SQUARED * edge_mm**2))
    colatitude, azimuth = _even_spiral(area, count)
    vertices = pebble.points(colatitude, azimuth)
    sphere = _on_sphere(pebble, colatitude, azimuth, nodes)
    faces = _outward(sphere, ConvexHull(sphere).simplices)
    return vertices, faces, colatitude <= np.pi / 2


def _quad_areas(nodes: np.ndarray) -> np.ndarray:
    """Areas of the cells between (r + 1, c + 1, 3) nodes: half the product of their diagonals."""
    one = nodes[1:, 1:] - nodes[:-1, :-1]
    other = nodes[1:, :-1] - nodes[:-1, 1:]
    return np.linalg.norm(np.cross(one, other), axis=-1) / 2


def _even_spiral(area: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Colatitude and azimuth of `count` points with equal shares of `area`.

    The spiral of the golden angle keeps its points well apart whatever the stretch along the
    meridian (Vogel 1979, Math. Biosci. 44:179), so that equal areas also mean even edges.
    """
    rows, columns = area.shape
    by_row = np.concatenate([[0.0], np.cumsum(area.sum(axis=1))])
    row = np.interp((np.arange(count) + 0.5) / count, by_row / by_row[-1], np.arange(rows + 1.0))
    # share of the row's area up to each column, inverted once per row on a regular grid of shares
    shares = np.linspace(0, 1, 2 * columns + 1)
    inverse = np.empty((rows, len(shares)))
    for i, cells in enumerate(area):
        along = np.concatenate([[0.0], np.cumsum(cells)])
        inverse[i] = np.interp(shares, along / along[-1], np.arange(columns + 1.0))
    golden = (np.sqrt(5) - 1) / 2
    share = np.mod(np.arange(count) * golden, 1.0)
    column = scipy.ndimage.map_coordinates(
        inverse, [row - 0.5, share * (len(shares) - 1)], order=1, mode="nearest"
    )
    return row * (np.pi / rows), column * (2 * np.pi / columns)


def _on_sphere(
    pebble: Pebble, colatitude: np.ndarray, azimuth: np.ndarray, nodes: np.ndarray
) -> np.ndarray:
    """Images on the unit sphere, angles kept for the body of revolution next to the pebble.

    With l the arc along the meridian and r = R sin(t) the distance from the axis, the map keeps
    angles where d(ln tan(theta/2)) = dl / r, so theta/2 has the tangent
    tan(t/2) exp(integral of (dl/dt / R - 1) / sin(t)).
    """
    half_x, half_y = pebble._half_axes
    radius = np.sqrt(half_x * half_y)
    t = np.linspace(0, np.pi, len(nodes))
    arc = np.hypot(np.diff(radius * np.sin(t)), np.diff(nodes[:, 0, 2]))
    middle = (t[1:] + t[:-1]) / 2
    slope = (arc / np.diff(t) / radius - 1) / np.sin(middle)
    integral = np.concatenate([[0.0], np.cumsum(slope * np.diff(t))])
    integral -= np.interp(np.pi / 2, t, integral)
    tangent = np.tan(colatitude / 2) * np.exp(np.interp(colatitude, t, integral))
    cosine = (1 - tangent**2) / (1 + tangent**2)
    sine = 2 * tangent / (1 + tangent**2)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)


def _outward(sphere: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """`faces` with every triangle turned to look out of the sphere."""
    a, b, c = (sphere[faces[:, corner]] for corner in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) < 0
    faces = faces.copy()
    faces[inward] = faces[inward][:, ::-1]
    return faces
