"""Stick and slip under a tangential load, from two frictionless solutions.

With Coulomb friction μ and a tangential force Q that grows at constant normal force P, the
tractions are q = μ [p(P) − p(P₀)], P₀ = P − Q/μ: full friction less that of the contact under the
reduced load. That smaller contact sticks; the rest of the contact slips.

Sources: M. Ciavarella, Int. J. Solids Struct. 35 (1998) 2349; J. Jäger, Arch. Appl. Mech. 68 (1998)
247.
"""

import math
from dataclasses import dataclass

import numpy as np

from .checks import checked_tolerance
from .errors import InvalidContactInput
from .solver import MAX_ITERATIONS, ContactProblem
from .state import ContactState

__all__ = ["SlipState", "solve_slip"]

# ASSUME: in `solve_slip` the bodies are elastically similar, so that tangential tractions do not
# press them apart; the displacement across the tangential load is neglected (it vanishes with
# Poisson's ratio), and that along it taken as the mean over all directions of the load: exact for a
# circle and for isotropic roughness, 5 % too small along a contact five times as long as wide, 5 %
# too large across it.

# Under less load the pressure is nowhere more; by this share of the largest it is no rounding.
_RISE = 1e-2


@dataclass(frozen=True, eq=False)
class SlipState:
    """Tractions, stick and slip of a contact under normal and tangential load.

    Attributes
    ----------
    traction : ndarray, shape (ny, nx)
        Tangential traction along the load (MPa), 0 ≤ traction ≤ friction × pressure.
    stick, slip : ndarray of bool, shape (ny, nx)
        Elements in contact that stick, and that slip.
    mean_traction : float
        Tangential force over nominal area (MPa): friction × tangential_ratio × mean pressure.
    tangential_displacement : float
        Relative tangential displacement of the far fields (mm).
    normal, reduced : ContactState
        The two normal solutions, at P and at P₀.
    """

    traction: np.ndarray
    stick: np.ndarray
    slip: np.ndarray
    mean_traction: float
    tangential_displacement: float
    normal: ContactState
    reduced: ContactState


def solve_slip(
    heights,
    spacing,
    contact_modulus,
    *,
    normal,
    friction,
    tangential_ratio,
    poisson,
    tolerance=1e-6,
    workers=1,
) -> SlipState:
    """Load a solved contact tangentially.

    Parameters
    ----------
    heights, spacing, contact_modulus, tolerance, workers
        Of the contact, as in :func:`gstlib.bem.solve_contact`.
    normal : ContactState
        The normal contact, at P > 0.
    friction : float
        Coulomb's μ, > 0.
    tangential_ratio : float
        Q/μP, from 0 (nothing slips) to 1 (everything does).
    poisson : float
        Poisson's ratio of the two similar bodies, for the tangential displacement.

    Returns
    -------
    SlipState

    Raises
    ------
    InvalidContactInput
        Friction not positive, a ratio outside [0, 1], a normal contact without load, with a
        pressure limit, or of another surface.
    """
    if not friction > 0:
        raise InvalidContactInput(f"friction must be positive, got {friction}")
    if not 0 <= tangential_ratio <= 1:
        raise InvalidContactInput(
            f"tangential_ratio Q/μP must lie in [0, 1], got {tangential_ratio}"
        )
    if not -1 < poisson <= 0.5:
        raise InvalidContactInput(f"poisson must lie in (-1, 0.5], got {poisson}")
    if not normal.mean_pressure > 0:
        raise InvalidContactInput("the normal contact carries no load")
    if normal.pressure_limit < math.inf:
        raise InvalidContactInput(
            "the normal contact has a pressure limit: stick and slip need none"
        )
    problem = ContactProblem(heights, spacing, contact_modulus, workers)
    if normal.pressure.shape != problem.half_space.shape:
        raise InvalidContactInput(
            f"the normal contact has shape {normal.pressure.shape}, the heights "
            f"{problem.half_space.shape}"
        )
    if tangential_ratio == 0:
        reduced = normal
    else:
        remaining = 1 - tangential_ratio
        # The contact itself has been warned of, if it reaches the border; this one is smaller.
        reduced = problem.solve(
            mean_pressure=remaining * normal.mean_pressure,
            initial_pressure=remaining * normal.pressure,
            tolerance=checked_tolerance(tolerance),
            max_iterations=MAX_ITERATIONS,
        )
    if (reduced.pressure - normal.pressure).max() > _RISE * normal.pressure.max():
        raise InvalidContactInput(
            "under less load the pressure rises: the normal contact is one of other heights, "
            "spacing or contact modulus"
        )
    traction = friction * (normal.pressure - reduced.pressure)
    stick = reduced.contact & normal.contact
    # Tangential over normal compliance of similar half-spaces (Johnson, Contact Mechanics, §7.2).
    compliance_ratio = (2 - poisson) / (2 * (1 - poisson))
    return SlipState(
        traction=traction,
        stick=stick,
        slip=normal.contact & ~stick,
        mean_traction=float(traction.mean()),
        tangential_displacement=friction
        * compliance_ratio
        * (normal.displacement - reduced.displacement),
        normal=normal,
        reduced=reduced,
    )
