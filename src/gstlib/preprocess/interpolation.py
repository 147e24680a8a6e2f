"""Heights of a cloud of vertices on a grid: three interpolations, and which one is the best.

The paper interpolates linearly over the Delaunay triangulation (as MATLAB's scatteredInterpolant
does). Smoother interpolations are also tried, and left-out vertices show which one predicts the
stone best.
"""

from typing import NamedTuple

import numpy as np
import scipy

from gstlib.errors import InputError

__all__ = ["Comparison", "compare", "interpolate"]

# The first two over the Delaunay triangulation; the smoothest last.
_INTERPOLATIONS = "linear", "clough-tocher", "cubic"
# Nearest vertices that the cubic radial basis uses for a point.
_NEIGHBOURS = 50
# It takes 0.1 ms for a point. It is smooth between vertices, so this many points an edge suffice.
_POINTS_PER_EDGE = 3
# The vertices in the square are left out in so many random groups, one group at a time. If there
# are more vertices than this, every second or third is left out: a few thousand take a second.
_GROUPS, _SEED, _MOST_LEFT_OUT = 8, 1, 5000
# ASSUME: Simplest of equally good interpolations. If the r.m.s. errors on left-out vertices are
# within 1 % of the smallest, the simplest of these interpolations is used. Reason: A smaller
# difference does not justify a smoother method.
_TIE = 0.01


def interpolate(
    interpolation: str, cloud: np.ndarray, along: np.ndarray, edge: float
) -> np.ndarray:
    """Heights (n, n), mm, at points `along` (n,) both axes; `edge` is the mean edge of the mesh."""
    wide = edge / _POINTS_PER_EDGE
    first, last = along[0], along[-1]
    if interpolation != "cubic" or wide <= along[1] - first:
        return _predicted(interpolation, cloud, _places(along))
    count = int(np.ceil((last - first) / wide)) + 1
    nodes = np.linspace(first, last, max(count, 4))
    coarse = _predicted(interpolation, cloud, _places(nodes))
    return scipy.interpolate.RectBivariateSpline(nodes, nodes, coarse)(along, along)


class Comparison(NamedTuple):
    """How well interpolations predict vertices that were left out.

    The methods `tried`, the r.m.s. error `rms` (k,) of each, mm, and the method `chosen`. The
    `vertices` (n, 3) left out, and its `errors` (n,) on them, mm.
    """

    tried: tuple[str, ...]
    rms: np.ndarray
    chosen: str
    vertices: np.ndarray
    errors: np.ndarray


def compare(
    interpolation: str, cloud: np.ndarray, bounds: tuple[float, float]
) -> Comparison:
    """The interpolation asked for, or all of them, on the vertices of a cloud within bounds."""
    if interpolation not in (*_INTERPOLATIONS, "best"):
        remedy = f"Give {', '.join(_INTERPOLATIONS)} or best."
        raise InputError("interpolation", f"is {interpolation!r}", remedy)
    tried = _INTERPOLATIONS if interpolation == "best" else (interpolation,)
    low, high = bounds
    inside = ((cloud[:, :2] >= low) & (cloud[:, :2] <= high)).all(axis=1)
    vertex = np.flatnonzero(inside)
    vertex = vertex[:: 1 + len(vertex) // _MOST_LEFT_OUT]
    group = np.random.default_rng(_SEED).permutation(len(vertex)) % _GROUPS
    errors = np.empty((len(tried), len(vertex)))
    for number in range(_GROUPS):
        out = group == number
        left, others = cloud[vertex[out]], np.delete(cloud, vertex[out], axis=0)
        for row, kind in zip(errors, tried, strict=True):
            row[out] = left[:, 2] - _predicted(kind, others, left[:, :2])
    predicted = ~np.isnan(errors).any(axis=0)
    vertex, errors = vertex[predicted], errors[:, predicted]
    rms = np.sqrt((errors**2).mean(axis=1))
    is_good = rms <= (1 + _TIE) * rms.min()
    best = int(np.argmax(is_good))
    return Comparison(tried, rms, tried[best], cloud[vertex], errors[best])


def _predicted(interpolation: str, cloud: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Heights (mm) at `places` (..., 2) from a cloud (n, 3); infinite if a cubic is impossible.

    Outside the cloud, all but the cubic are NaN.
    """
    points, heights = cloud[:, :2], cloud[:, 2]
    if interpolation == "linear":
        return scipy.interpolate.LinearNDInterpolator(points, heights)(places)
    if interpolation == "clough-tocher":
        return scipy.interpolate.CloughTocher2DInterpolator(points, heights)(places)
    spline = scipy.interpolate.RBFInterpolator(
        points,
        heights,
        neighbors=min(_NEIGHBOURS, len(cloud)),
        kernel="cubic",
        degree=2,
    )
    try:
        return spline(places.reshape(-1, 2)).reshape(places.shape[:-1])
    except np.linalg.LinAlgError:  # neighbours in line
        return np.full(places.shape[:-1], np.inf)


def _places(along: np.ndarray) -> np.ndarray:
    """Points (n, n, 2), x and y, of a grid."""
    y, x = np.meshgrid(along, along, indexing="ij")
    return np.stack([x, y], axis=-1)
