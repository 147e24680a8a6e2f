"""Wear of the synthetic stone by Archard's law, to test whether the study recovers it.

The stone is in equilibrium on a rounded active tool under a force off its middle. Its square then
wears at the scans' resolution, as one piece, at its position and under its force in the face. All
of this differs from the assumptions of the study: constants, force, form of the active tool, load
point and elements of the face.
"""

import numpy as np

from gstlib.bem.layer import Layer
from gstlib.bem.wear import ThirdBody, wear_path
from gstlib.contact import Interface, Load, contact_at_pressure
from gstlib.macroscale.active_tool import rounded_counterface
from gstlib.specimen.stone import Stone, surface_at
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
# All processors then make the same T1, except for the last bit of a few points in ten million.
_TOLERANCE = 1e-11
_INTERLAYER, _INTERLAYER_FRACTION = Layer(young=300.0, poisson=0.3, thickness=0.3), 0.5


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
    face = surface_at(along, stone.face_means(_ELEMENTS, _AROUND), spacing)
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

    whole = surface_at(stone.grid, stone.heights(), stone.spacing)
    height, pressure_MPa = placed_whole(whole, contact)
    share = pressure_MPa * (len(stone.grid) * stone.spacing) ** 2 / force_N
    return wear_path(
        height.values,
        stone.spacing,
        _CONTACT_MODULUS_MPA,
        mean_pressure=pressure_MPa,
        mean_loss=share * mean_loss,
        steps=_STEPS,
        third_body=ThirdBody(_INTERLAYER, _INTERLAYER_FRACTION, pressure_MPa)
        if with_interlayer
        else None,
        tolerance=_TOLERANCE,
    ).depth.astype(np.float32)
