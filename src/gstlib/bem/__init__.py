"""Frictionless rough contact with an elastic half-space, by boundary elements.

Units: mm, N, MPa. This package knows nothing of stones, files or workflows.
"""

from .elasticity import contact_modulus
from .errors import (
    ContactError,
    ConvergenceError,
    DomainTooSmallWarning,
    InvalidContactInput,
    UnreachableTargetError,
)
from .halfspace import HalfSpace
from .loading import LoadPath, load_path
from .solver import solve_contact
from .state import ContactState

__all__ = [
    "ContactError",
    "ContactState",
    "ConvergenceError",
    "DomainTooSmallWarning",
    "HalfSpace",
    "InvalidContactInput",
    "LoadPath",
    "UnreachableTargetError",
    "contact_modulus",
    "load_path",
    "solve_contact",
]
