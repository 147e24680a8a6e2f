"""Frictionless rough contact with an elastic half-space, by boundary elements.

Units: mm, N, MPa. This package knows nothing of stones, files or workflows.
"""

from .errors import ContactError, ConvergenceError, InvalidContactInput
from .halfspace import HalfSpace, contact_modulus
from .loading import LoadPath, load_path
from .solver import ContactState, solve_contact

__all__ = [
    "ContactError",
    "ContactState",
    "ConvergenceError",
    "HalfSpace",
    "InvalidContactInput",
    "LoadPath",
    "contact_modulus",
    "load_path",
    "solve_contact",
]
