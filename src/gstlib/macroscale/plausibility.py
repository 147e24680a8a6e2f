"""Reasons to doubt a macroscale contact, each a sentence with number and remedy.

They do not stop a study. Each has caused wrong numbers that looked right.
"""

import math
from collections.abc import Iterator

import numpy as np
import scipy

from gstlib.contact import Contact
from gstlib.surfaces.footprints import square_of
from gstlib.surfaces.grid import spacing_of

__all__ = ["plausibility_warnings"]

# Width of the strip along an edge (over the side). In a sound contact it carries almost no load. A
# square that is cut out of a stone and pressed alone carries a quarter of its load there
# (docs/explanation/evidence.md).
_EDGE, _MOST_AT_EDGE = 0.02, 0.05
# Quartz, the hardest mineral of common stones, indents at 11 to 12 GPa.
_STRONGEST_MPA = 12_000.0
# With less of the force in the square, its patches do not show how the stone was used.
_LEAST_IN_SQUARE = 0.1
# Beyond this slope, heights along the normal are 2 % shorter than across the surface.
_STEEP = 0.2
# A patch's pressure is the sum over its elements: with fewer along a side, their edges decide it.
_FEWEST_ELEMENTS = 5
# A load point so close to the outline of the contact (over the side) is about to cross it.
_NEAR = 0.02


def plausibility_warnings(
    contact: Contact, *, size_mm: float, patch_mm: float | None = None
) -> Iterator[str]:
    """Sentences about a stored contact at the macroscale. A sound contact gives no sentence.

    `size_mm` is the side of the square, and `patch_mm` the side of its patches, if any.
    """
    pressure = contact.pressure.values
    plane = contact.interface.plane
    side = spacing_of(contact.pressure)[0] * len(contact.pressure.y)
    if (total := pressure.sum()) > 0:
        share = float(pressure[_along_edge(contact)].sum() / total)
        if share > _MOST_AT_EDGE:
            yield (
                f"{100 * share:.0f} % of the force acts within {100 * _EDGE:.0f} % of the side "
                f"from the edge of the face ({side:.4g} mm). The stone continues there, or ends. "
                "Make macroscale.face_mm larger, or give counterface.radius_mm"
            )
        inside = float(square_of(contact.pressure, size_mm).sum() / total)
        if inside < _LEAST_IN_SQUARE:
            yield (
                f"only {100 * inside:.2g} % of the force acts in the square: the stone rests "
                "elsewhere. Check load.at_mm, the form of the active tool (counterface), and "
                "square.points_mm"
            )
    if (tilt := float(np.hypot(plane.slope_y, plane.slope_x))) > _STEEP:
        yield (
            f"the stone rests tilted by {1e3 * tilt:.3g} mrad against the mean plane of the "
            "square, whose normal the heights and the force follow. Pick square.points_mm again so "
            "that the square is level when the stone rests, or check load.at_mm"
        )
    if (peak := float(pressure.max(initial=0.0))) > _STRONGEST_MPA:
        yield (
            f"the highest pressure on an element is {peak:.3g} MPa, above the strength of stone "
            f"({_STRONGEST_MPA:g} MPa). Check the mesh for spikes there, the load, and units"
        )
    distance = _inside_outline(contact)
    if distance is not None and math.isnan(distance):
        yield (
            "the stones touch at a single point or along a line, so their tilt is not determined. "
            "Check the mesh for a spike, the pose, and the load"
        )
    if distance is not None and distance < _NEAR * side:
        yield (
            f"the force acts only {distance:.2g} mm inside the outline of the contact, so a small "
            "shift makes the stone roll or tip onto other parts. Check load.at_mm, and consider "
            "the intervals"
        )
    element = max(spacing_of(contact.pressure))
    if patch_mm is not None and patch_mm < _FEWEST_ELEMENTS * element:
        yield (
            f"a patch of {patch_mm:g} mm is {patch_mm / element:.1f} elements wide, but "
            f"{_FEWEST_ELEMENTS} are needed for its pressure. Raise macroscale.grid"
        )


def _along_edge(contact: Contact) -> np.ndarray:
    """Mask (ny, nx) of the elements near the edge of the grid, or of the stone."""
    reach = max(1, round(_EDGE * len(contact.pressure.y)))
    face = contact.interface
    there = np.isfinite(face.height.values + face.counterface.values)
    inner = scipy.ndimage.binary_erosion(
        np.pad(there, 1), np.ones((3, 3)), iterations=reach
    )
    return ~inner[1:-1, 1:-1]


def _inside_outline(contact: Contact) -> float | None:
    """Distance (mm) of the load point from the convex outline of the contact, positive inside.

    None for a contact on a fixed plane, and NaN for a contact whose outline has no width.
    """
    if contact.load.load_point is None:
        return None
    place = np.array(contact.load.load_point)
    rows, columns = np.nonzero(contact.pressure.values > 0)
    y, x = (contact.pressure[axis].values for axis in "yx")
    touching = np.column_stack([y[rows], x[columns]])
    try:
        hull = scipy.spatial.ConvexHull(touching)
    except (scipy.spatial.QhullError, ValueError):
        return math.nan
    normals = hull.equations[:, :2]
    offsets = hull.equations[:, 2]
    return float(-(normals @ place + offsets).max())
