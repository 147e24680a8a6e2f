"""The pebble: its smooth shape, and a closed mesh of it with edges of similar length.

The shape is an egg in plan, rounded below. Its upper side, the use-face, is nearly flat and
slightly dished. With rho the distance from the centre, 1 at the rim, the upper side is ``rise (1 -
rho^6)^q - concavity (1 - rho^2)^2`` and the lower ``-depth (1 - rho^2)^q``. The exponent q sets the
rim, between a cylinder (0) and a lens (1).

Mesh vertices lie on a spiral of the golden angle, spread so that each has the same area of stone.
The convex hull of their images on a sphere joins them. The map to the sphere preserves angles for
the body of revolution closest to the pebble, so the triangles stay well shaped.
"""

import numpy as np
import scipy

__all__ = [
    "OUTER_SIZE_MM",
    "even_triangulation",
    "rim_distance_squared",
    "surface_points",
    "use_face",
]

# Published outer size of M12 along x, y and z; the use-face looks along +z.
OUTER_SIZE_MM = (100.38, 80.57, 29.5)
# ASSUME: Shape of the pebble. The outer size and a slightly concave use-face are as in the paper,
# and the rest of the shape is chosen freely. Reason: It is far from the analysed square.

# Depth of the dish at the centre of the use-face.
_CONCAVITY_MM = 0.5
# Egg shape: the pebble is wider by this fraction at the +x end than in the middle, before scaling.
_TAPER = 0.25
# Height of the use-face over the rim, without the dish; exponent q of the rim.
_RISE_MM, _RIM_EXPONENT = 0.2 * OUTER_SIZE_MM[2], 0.75
# Area of a vertex over the square of the mean edge length, measured on this kind of mesh.
_AREA_PER_EDGE_SQUARED = 0.8008
# Cells along the meridian and around it, over which area is summed.
_TABLE_SIZE = (1024, 512)

_HALF_X, _HALF_Y = OUTER_SIZE_MM[0] / 2, OUTER_SIZE_MM[1] / 2
# Largest of sqrt(1 - u^2) (1 + taper u), at the root of its derivative: scales the egg's width.
_WIDEST = (np.sqrt(1 + 8 * _TAPER**2) - 1) / (4 * _TAPER)
_WIDTH_SCALE = float(np.sqrt(1 - _WIDEST**2) * (1 + _TAPER * _WIDEST))


def rim_distance_squared(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """rho² of the position (x, y) in mm: 0 at the centre of the use-face, 1 at the rim."""
    u = x / _HALF_X
    half_width = _HALF_Y * (1 + _TAPER * u)
    return u**2 + (y * _WIDTH_SCALE / half_width) ** 2


def use_face(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Height (mm) of the smooth use-face at (x, y) in mm, zero at its centre."""
    return _above(rim_distance_squared(x, y)) - _above(np.zeros(()))


def _above(rho_squared: np.ndarray) -> np.ndarray:
    """Height (mm) of the upper side over the rim's plane."""
    rho_squared = np.clip(rho_squared, 0, 1)
    dome = _RISE_MM * (1 - rho_squared**3) ** _RIM_EXPONENT
    return dome - _CONCAVITY_MM * (1 - rho_squared) ** 2


def surface_points(colatitude: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Points (..., 3) of the shape, mm; rho is the sine of `colatitude` (0 top, pi bottom)."""
    colatitude, azimuth = np.broadcast_arrays(colatitude, azimuth)
    rho = np.sin(colatitude)
    u = rho * np.cos(azimuth)
    half_width = 1 + _TAPER * u
    v = rho * np.sin(azimuth) * half_width / _WIDTH_SCALE
    crest = float(_above(np.linspace(0, 1, 10001)).max())
    upper = _above(rho**2)
    bowl = np.clip(1 - rho**2, 0, 1) ** _RIM_EXPONENT
    lower = -(OUTER_SIZE_MM[2] - crest) * bowl
    z = np.where(colatitude <= np.pi / 2, upper, lower)
    z -= _above(np.zeros(()))
    return np.stack([_HALF_X * u, _HALF_Y * v, z], axis=-1)


def even_triangulation(edge_mm: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangles of equal size over the whole pebble.

    Returns vertices (n, 3), mm, with a mean edge length of `edge_mm`; faces (m, 3), anticlockwise
    seen from outside; and whether each vertex is on the use-face's side of the rim.
    """
    colatitude_nodes = np.linspace(0, np.pi, _TABLE_SIZE[0] + 1)
    azimuth_nodes = np.linspace(0, 2 * np.pi, _TABLE_SIZE[1] + 1)
    nodes = surface_points(colatitude_nodes[:, None], azimuth_nodes[None, :])
    # the area of a cell is half the vector product of its diagonals
    diagonal = nodes[1:, 1:] - nodes[:-1, :-1]
    other = nodes[1:, :-1] - nodes[:-1, 1:]
    area = np.linalg.norm(np.cross(diagonal, other), axis=-1) / 2
    count = round(area.sum() / (_AREA_PER_EDGE_SQUARED * edge_mm**2))
    colatitude, azimuth = _even_spiral(area, count)
    sphere = _on_sphere(colatitude, azimuth, nodes)
    faces = scipy.spatial.ConvexHull(sphere).simplices
    a, b, c = (sphere[faces[:, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)
    inward = np.einsum("ij,ij->i", normal, a + b + c) < 0
    faces[inward] = faces[inward][:, ::-1]
    return surface_points(colatitude, azimuth), faces, colatitude <= np.pi / 2


def _even_spiral(area: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Colatitude and azimuth of `count` points with equal shares of `area`.

    The spiral of the golden angle keeps its points well apart for any stretch along the meridian
    (Vogel 1979, Math. Biosci. 44:179), so equal areas also mean equal edges.
    """
    rows, columns = area.shape
    row = _at_shares(area.sum(axis=1), (np.arange(count) + 0.5) / count)
    # inverted once per row on a regular grid of shares
    shares = np.linspace(0, 1, 2 * columns + 1)
    inverse = np.stack([_at_shares(cells, shares) for cells in area])
    golden = (np.sqrt(5) - 1) / 2
    share = np.mod(np.arange(count) * golden, 1.0)
    at = [row - 0.5, share * (len(shares) - 1)]
    column = scipy.ndimage.map_coordinates(inverse, at, order=1, mode="nearest")
    return row * (np.pi / rows), column * (2 * np.pi / columns)


def _at_shares(area: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """The positions, in cells, up to which the area of cells has these shares of the whole."""
    up_to = np.concatenate([[0.0], np.cumsum(area)])
    return np.interp(shares, up_to / up_to[-1], np.arange(len(up_to)))


def _on_sphere(
    colatitude: np.ndarray, azimuth: np.ndarray, nodes: np.ndarray
) -> np.ndarray:
    """Images on the unit sphere, with angles preserved.

    Let l be the arc along the meridian and r = R sin(t) the distance from the axis. The map
    preserves angles if d(ln tan(theta/2)) = dl / r. So theta/2 has the tangent tan(t/2)
    exp(integral of (dl/dt / R - 1) / sin(t)).
    """
    radius = np.sqrt(_HALF_X * _HALF_Y)
    t = np.linspace(0, np.pi, len(nodes))
    outwards = np.diff(radius * np.sin(t))
    arc = np.hypot(outwards, np.diff(nodes[:, 0, 2]))
    middle = (t[1:] + t[:-1]) / 2
    stretch = arc / np.diff(t) / radius
    slope = (stretch - 1) / np.sin(middle)
    integral = np.concatenate([[0.0], np.cumsum(slope * np.diff(t))])
    integral -= np.interp(np.pi / 2, t, integral)
    exponent = np.interp(colatitude, t, integral)
    tangent = np.tan(colatitude / 2) * np.exp(exponent)
    cosine = (1 - tangent**2) / (1 + tangent**2)
    sine = 2 * tangent / (1 + tangent**2)
    x = sine * np.cos(azimuth)
    y = sine * np.sin(azimuth)
    return np.stack([x, y, cosine], axis=-1)
