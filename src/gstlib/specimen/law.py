"""Wear of the synthetic stone by Archard's law, to test whether the study recovers it.

The stone is in equilibrium on a rounded active tool under a force off its middle. Its square then
wears on fine elements, as one piece, at its position and under its force in the face. All of this
differs from the assumptions of the study: constants, force, form of the active tool, load
point and elements of the face.
"""

from functools import partial

import numpy as np
import scipy

from gstlib.bem.layer import Layer
from gstlib.bem.wear import ThirdBody, WearPath, wear_path
from gstlib.contact import Interface, Load, contact_at_pressure
from gstlib.macroscale.active_tool import rounded_counterface
from gstlib.specimen.randomness import rounded
from gstlib.specimen.stone import Stone, block_means, surface_at
from gstlib.surfaces.grid import axis_coordinates
from gstlib.validation.single_scale import placed_whole

__all__ = ["LAWS", "load_point_of", "wear_depth", "worn_by_law"]

# Placements of wear by a law.
LAWS = "archard", "interlayer"
# Mean depth of wear by a law over the mean depth of wear by rules, if the square carries the whole
# force. It is concentrated on fewer patches; with more, T1 would no longer match T0 on some of
# them.
_LAW_FRACTION = 0.5

# ASSUME: Constants of wear by a law. The constants differ from the default study, which has 10,346
# MPa, 550 N, 200 mm, the middle of the square and elements of 50 µm. The interlayer is as stiff as
# hide or wood, and does half of the wear. Reason: A gain on wear made by the law that predicts it
# is a check of the code, not evidence.
_CONTACT_MODULUS_MPA, _PRESSURE_MPA = 1e4, 20.0
_ELEMENTS, _AROUND = 64, 64  # of the face: in the square, and on each side of it
_STEPS = 4
# Depths on other processors, or by other transforms, then differ by 5e-15 mm at most. They are
# rounded to 1 nm, so that all make the same T1. Rounding guarantees this only unless a depth lies
# that close to a limit: in about one of 30,000 default specimens.
_TOLERANCE = 1e-11
_INTERLAYER, _INTERLAYER_FRACTION = Layer(young=300.0, poisson=0.3, thickness=0.3), 0.5

# ASSUME: Elements of wear by a law. The square wears as elements of at most 7 µm, with the mean
# heights of their points. Where they touch, points are cut down to the smooth surface through the
# worn elements. Elsewhere, the depth is interpolated. Reason: Elements of one point take fifteen
# times as long. On the default specimen (4 × 4 points in an element), their depths are 0.62 µm
# r.m.s., and those of elements differ by 0.008 µm r.m.s. Volumes lost from a patch differ by 0.5 %
# (median; at most 3 %). With an interlayer, depths differ by 0.034 µm of 0.41 µm, and volumes by at
# most 0.7 %. The noise of a scan is 0.1 µm. Alternative: Elements of one point.
_LARGEST_UM = 7.0


def wear_depth(stone: Stone, placement: str) -> np.ndarray:
    """Depth of the material lost between T0 and T1, mm, float32, on the grid of its detail.

    `placement` is "summits", for wear by rules, or a law: "archard" or "interlayer". Wear by a law
    has half the mean depth of wear by rules, or less if the square carries a part of the force.
    """
    depth = stone.worn_by_rules()
    if placement not in LAWS:
        return depth
    mean_loss = _LAW_FRACTION * float(depth.mean())
    return worn_by_law(stone, mean_loss, with_interlayer=placement == "interlayer")


def load_point_of(stone: Stone) -> tuple[float, float]:
    """Load point (y, x), mm, on the square."""
    y, x = (stone.square_mm / 2 + off for off in stone.parameters.worn_off_middle_mm)
    return y, x


def worn_by_law(stone: Stone, mean_loss: float, *, with_interlayer: bool) -> np.ndarray:
    """Depth lost on the grid of the stone's detail (n, n), mm.

    Its mean is `mean_loss` if the square carries the whole force, and in proportion to its share
    otherwise. An interlayer alternates with the bare stone.
    """
    size_mm = stone.square_mm
    spacing = size_mm / _ELEMENTS
    along = axis_coordinates(_ELEMENTS + 2 * _AROUND, spacing) - _AROUND * spacing
    face = surface_at(along, stone.face_means(_ELEMENTS, _AROUND))
    load_point = load_point_of(stone)
    force_N = _PRESSURE_MPA * size_mm**2
    p = stone.parameters
    contact = contact_at_pressure(
        Interface(
            face,
            rounded_counterface(face, p.worn_radius_mm, load_point, p.worn_angle_deg),
        ),
        Load.of_force(force_N, face, load_point),
        modulus=_CONTACT_MODULUS_MPA,
        tolerance=_TOLERANCE,
        source="specimen",
    )

    points = max(1, int(_LARGEST_UM / p.scan_spacing_um))
    means = block_means(stone.heights, points)
    element = points * stone.spacing
    first = stone.grid[:points].mean()
    whole = surface_at(first + element * np.arange(len(means)), means)
    height, pressure_MPa = placed_whole(whole, contact)
    share = pressure_MPa * (len(means) * element) ** 2 / force_N
    path = wear_path(
        height.values,
        element,
        _CONTACT_MODULUS_MPA,
        mean_pressure=pressure_MPa,
        mean_loss=share * mean_loss,
        steps=_STEPS,
        third_body=ThirdBody(_INTERLAYER, _INTERLAYER_FRACTION, pressure_MPa)
        if with_interlayer
        else None,
        tolerance=_TOLERANCE,
    )
    return _depth_of_points(stone.heights, means, path, points)


def _depth_of_points(
    heights: np.ndarray, means: np.ndarray, path: WearPath, points: int
) -> np.ndarray:
    """Depth lost at each of the `heights`, mm, float32.

    `means` are the mean heights of the elements of (points, points), which wore along `path`.
    """
    at_points = partial(
        scipy.ndimage.zoom, zoom=points, order=1, mode="nearest", grid_mode=True
    )
    depth = rounded(path.depth)
    touching = path.final.pressure > 0
    # The worn elements that touch are one smooth surface, which is continued to the points.
    weight = at_points(touching.astype(np.float32))
    worn = at_points(np.where(touching, means - depth, 0).astype(np.float32))
    np.divide(worn, weight, out=worn, where=weight > 0)
    lost = at_points(np.where(touching, 0, depth))
    cut = heights[: len(lost), : len(lost)] - worn
    np.maximum(lost, cut, out=lost, where=weight > 0)
    return np.pad(lost, (0, len(heights) - len(lost)), mode="edge")
