"""Frictionless rough contact with an elastic half-space, by boundary elements::

    state = solve_contact(heights, spacing, contact_modulus(E1, nu1, E2, nu2), mean_pressure=22.0)
    state.pressure, state.gap, state.displacement, state.contact_fraction, state.residual

`solve_contact` presses a map of heights against a flat, in a fixed direction. With `load_point`, a
force acts through a point, and the body reaches equilibrium. `load_path` does so step by step, and
`wear_path` wears the surface by Archard's law, also with a compliant `Layer` between the bodies.
Units: mm, N, MPa. This package does not depend on stones, files or workflows.
"""

import lazy_loader

# reading a scan takes the spacing from here, and should not load the solver
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
