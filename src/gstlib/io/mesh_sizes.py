"""Units, size and resolution of a mesh: is it a stone, and are its coordinates fine enough?"""

import logging
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gstlib.errors import FaultError, refuse
from gstlib.io.files import UnreadableError

if TYPE_CHECKING:
    import trimesh

__all__ = [
    "STATED_UNITS",
    "UNITS",
    "check_step_and_extent",
    "coordinate_step",
    "steps_of",
    "units_of_size",
]

_log = logging.getLogger(__name__)

# The units in files, in upper or lower case. 3MF allows the first six.
STATED_UNITS = {
    "micron": "um",
    "millimeter": "mm",
    "centimeter": "cm",
    "inch": "in",
    "foot": "ft",
}
STATED_UNITS |= {"meter": "m", "metre": "m", "millimetre": "mm", "centimetre": "cm"}
STATED_UNITS |= {"micrometer": "um", "inche": "in", "feet": "ft"}
STATED_UNITS |= {unit: unit for unit in ("mm", "cm", "um", "m")}
# Length of each unit in mm.
UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "in": 25.4, "ft": 304.8}
# Nobody exports stones in feet, but a 3MF may use this unit.
_LIKELY_UNITS = "mm", "cm", "m", "um", "in"
# Largest extent (mm) of a stone that a hand could grind with. Outside this range the unit is wrong.
_SMALLEST_STONE, _LARGEST_STONE = 1.0, 1000.0
# ASSUME: Unit of a mesh. If only one unit gives the stone a size of 20 to 300 mm, this is its unit.
# Reason: A ground stone tool fits in a hand.
_HAND_SIZED = 20.0, 300.0
# Steps of the coordinates (mm) above which heights are doubtful, and worthless. Wear is a few
# micrometres deep, and the relief that carries a contact some tens of micrometres.
_DOUBTFUL_STEP, _LARGEST_STEP = 1e-3, 20e-3
# If a coordinate is so many times as large as the mesh, its distance has used up the digits.
_FAR = 10.0
# Below this number (mm), the step does not matter.
_NO_STEP = 1e-8
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


def check_step_and_extent(
    path: Path, corners: np.ndarray, step_mm: float, unit: str
) -> None:
    """Refuse coordinates with too few digits, or with an extent (in `unit`) of no stone."""
    extent = float(np.ptp(corners, axis=(0, 1)).max())
    farthest = float(np.abs(corners).max())
    length_mm = UNITS[unit]
    cause = "they have too few digits"
    if farthest > _FAR * extent:
        cause = f"the mesh lies {_length(farthest * length_mm)} from its origin"
    problem = f"its coordinates have steps of {_length(step_mm)} because {cause}"
    remedy = "Export it again with the origin on the tool, in double precision or with more digits."
    # if a mesh is read in a wrong unit, the steps grow with the size
    if step_mm > max(
        _LARGEST_STEP, _LARGEST_STEP / _LARGEST_STONE * extent * length_mm
    ):
        refuse(
            FaultError(
                "mesh_step", path, f"{problem}, but at most 20 µm can be used", remedy
            )
        )
    _check_extent(extent, unit)
    if step_mm > _DOUBTFUL_STEP:
        _log.warning(
            "%s: %s, and heights have errors as large. %s", path, problem, remedy
        )


def steps_of(mesh: "trimesh.Trimesh") -> str:
    """The steps of the coordinates of a mesh from `read_mesh`, in words."""
    return f"steps of {_length(mesh.metadata['step_mm'])}"


def _length(mm: float) -> str:
    """A length in the unit in which it is a short number."""
    for unit, length in (("km", 1e6), ("m", 1e3), ("mm", 1.0), ("µm", 1e-3)):
        if mm >= length:
            return f"{mm / length:.3g} {unit}"
    return f"{1e6 * mm:.2g} nm" if mm >= _NO_STEP else "less than 0.01 nm"


def _check_extent(extent: float, unit: str) -> None:
    """Refuse a mesh with a largest extent (in `unit`) that no stone has."""
    if _SMALLEST_STONE <= extent * UNITS[unit] <= _LARGEST_STONE:
        return
    remedy = (
        f"Scale the mesh to one of the units {list(_LIKELY_UNITS)} and set mesh_unit."
    )
    fitting = {name: extent * UNITS[name] for name in units_of_size(extent)}
    if fitting:
        sizes = " or ".join(
            f"mesh_unit: {name} ({mm:.3g} mm)" for name, mm in fitting.items()
        )
        remedy = f"It seems to be in another unit. Set {sizes}."
    raise UnreadableError(
        f"its largest extent is {extent:.4g} {unit}, which is no stone's size", remedy
    )


def units_of_size(extent: float) -> list[str]:
    """The units in which a largest extent fits a hand-held stone.

    If no unit does, the units in which it fits any ground stone tool.

    >>> [units_of_size(extent) for extent in (55.4, 0.0554, 8.0, 400.0)]
    [['mm'], ['m'], ['cm', 'in'], ['mm']]
    """
    for low, high in (_HAND_SIZED, (10.0, _LARGEST_STONE)):
        fitting = [
            name for name in _LIKELY_UNITS if low <= extent * UNITS[name] <= high
        ]
        if fitting:
            return fitting
    return []
