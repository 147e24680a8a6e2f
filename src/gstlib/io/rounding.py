"""The step to which the coordinates of a mesh were rounded when its file was written."""

import numpy as np

__all__ = ["coordinate_step"]

# The step is searched among coordinates above these shares of the largest one. Numbers with a fixed
# count of digits, binary or decimal, have finer steps near zero.
_SHARES = 0.5, 0.9
# Fewer distinct coordinates do not determine their step.
_FEWEST = 20
# The smallest distance between n coordinates that are spread at random over a range is about range
# / n². A distance that is larger by this factor is a step. Chance leaves one in 20,000.
_TIMES_CHANCE = 10.0
# Edges of a mesh cover many of its steps. A grid of heights, in which each edge leads to the next
# grid point, is not rounded to its spacing. A thinned grid has longer edges, but its heights are
# not on a grid, too.
_EDGES, _EDGES_OF_ALL = 4.0, 1.5


def coordinate_step(vertices: np.ndarray, faces: np.ndarray) -> float:
    """The step of a mesh's coordinates, in their own unit: the largest of the three axes.

    Parameters
    ----------
    vertices : (n, 3) ndarray
        As they are in the file, before any transformation.
    faces : (m, 3) ndarray of int

    Returns
    -------
    float
        It is the distance between neighbouring numbers: of 32 bits, if all coordinates are such
        numbers, else of 64 bits. If all distinct coordinates are farther apart, as with few
        decimals, it is the smallest of their distances.

    Examples
    --------
    >>> corners = np.random.default_rng(1).random((1000, 3))
    >>> faces = np.arange(999).reshape(-1, 3)
    >>> f"{coordinate_step(corners.astype(np.float32).astype(float), faces):.0e}"
    '6e-08'
    >>> f"{coordinate_step(corners.round(3), faces):.3f}"
    '0.001'
    """
    triangles = vertices[faces]
    edges = np.abs(triangles - np.roll(triangles, 1, axis=1))
    distances, over_steps, numbers = np.zeros((3, 3))
    for axis in range(3):
        values, along = triangles[..., axis], edges[..., axis]
        numbers[axis] = _next_number(values)
        distances[axis] = _regular_distance(values)
        if distances[axis] and along.any():
            typical = np.median(along[along > 0])
            over_steps[axis] = typical / distances[axis]
    least = _EDGES_OF_ALL if distances.all() else _EDGES
    distances[over_steps < least] = 0
    return float(np.maximum(numbers, distances).max())


def _next_number(values: np.ndarray) -> float:
    """How far the next number is from the largest one, of 32 bits if all are such numbers."""
    with np.errstate(over="ignore"):
        is_single = np.array_equal(values.astype(np.float32), values)
    largest = np.abs(values).max()
    if is_single:
        largest = np.float32(largest)
    return float(np.spacing(largest))


def _regular_distance(values: np.ndarray) -> float:
    """The smallest distance of coordinates along an axis, 0 if it may be chance."""
    sizes = np.abs(values)
    regular = 0.0
    for share in _SHARES:
        distinct = np.unique(values[sizes >= share * sizes.max()])
        count = len(distinct)
        if count < _FEWEST:
            continue
        smallest = float(np.diff(distinct).min())
        if smallest * count**2 > _TIMES_CHANCE * np.ptp(distinct):
            regular = max(regular, smallest)
    return regular
