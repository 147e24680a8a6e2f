"""Wear of the synthetic stone by Archard's law, to test whether the study finds it again.

The stone comes to rest on a rounded active tool under a force that is off its middle. Its square
then wears at the scans' resolution, as one piece, in the place and under the force that it has
there. Nothing of this is what the study assumes: constants, force, form of the active tool, point
of force and elements of the face are others.
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

# Placements of wear that a law makes.
LAWS = "archard", "interlayer"
# Mean depth of wear by a law over that of wear by rules, if the square bears all the force. It lies
# on fewer patches; with as much, T1 no longer looks like T0 on some of them.
_LAW_FRACTION = 0.5

# ASSUME: wear made by a law has these constants; the default study has 10,346 MPa, 550 N, 200 mm,
# the middle of the square and elements of 50 µm. The interlayer is as stiff as hide or wood, and
# does half of the wear. A gain on wear made by the law that predicts it is a check of the code,
# not evidence.
_CONTACT_MODULUS_MPA, _PRESSURE_MPA = 1e4, 20.0
_ELEMENTS, _AROUND = 64, 64  # of the face: in the square, and on each side of it
_STEPS = 4
# So close that processors make the same T1, but for the last bit of a few points in ten million.
_TOLERANCE = 1e-11
_INTERLAYER, _INTERLAYER_FRACTION = Layer(young=300.0, poisson=0.3, thickness=0.3), 0.5


def wear_depth(stone: Stone, placement: str) -> np.ndarray:
    """Depth of the material lost between T0 and T1, mm, float32, on the grid of its detail.

    `placement` is "summits", for wear by rules, or a law: "archard" or "interlayer". Wear by a law
    has half the mean depth of wear by rules, or less where the square bears a part of the force.
    """
    depth = stone.worn_by_rules()
    if placement not in LAWS:
        return depth
    mean_loss = _LAW_FRACTION * float(depth.mean())
    return worn_by_law(stone, mean_loss, with_interlayer=placement == "interlayer")


def load_point_of(stone: Stone) -> tuple[float, float]:
    """Where (y, x), mm, on the square the stone was pressed."""
    y, x = (stone.square_mm / 2 + off for off in stone.parameters.worn_off_middle_mm)
    return y, x


def worn_by_law(stone: Stone, mean_loss: float, *, with_interlayer: bool) -> np.ndarray:
    """Depth lost on the grid of the stone's detail (n, n), mm.

    Its mean is `mean_loss` where the square bears the whole force, and in proportion to its share
    of it elsewhere. With an interlayer, it takes turns with the bare stone.
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
