"""Frictionless rough contact with an elastic half-space, by boundary elements::

    state = solve_contact(heights, spacing, contact_modulus(E1, nu1, E2, nu2), mean_pressure=22.0)
    state.pressure, state.gap, state.displacement, state.contact_fraction, state.residual

`solve_contact` presses a map of heights against a flat, in a fixed direction or, `through` a point,
until the body is at rest; `load_path` does so step by step, and
`wear_path` wears the surface by Archard's law, also with a compliant `Layer` between the bodies.
Units: mm, N, MPa. This package knows nothing of stones, files or workflows.
"""

from .errors import (
    ContactError,
    ContactInputError,
    ContactWarning,
    ConvergenceError,
    TippingError,
)
from .halfspace import HalfSpace, contact_modulus
from .layer import Layer
from .loading import LoadPath, load_path
from .roughness import Roughness, measure_roughness, measure_spectrum
from .solver import solve_contact
from .state import ContactState
from .wear import ThirdBody, WearPath, wear_path

__all__ = [
    "ContactError",
    "ContactInputError",
    "ContactState",
    "ContactWarning",
    "ConvergenceError",
    "HalfSpace",
    "Layer",
    "LoadPath",
    "Roughness",
    "ThirdBody",
    "TippingError",
    "WearPath",
    "contact_modulus",
    "load_path",
    "measure_roughness",
    "measure_spectrum",
    "solve_contact",
    "wear_path",
]
