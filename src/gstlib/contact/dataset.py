"""How a contact is stored: the name, unit and long name of each of its variables."""

from collections.abc import Mapping
from typing import Any

import numpy as np

__all__ = ["FIELDS", "NUMBERS", "PATH", "variables"]

# Fields (y, x) and numbers of the state at one load, named alike by the solver and in the files.
FIELDS = "pressure", "gap"
NUMBERS = "displacement", "mean_pressure", "contact_fraction", "residual"
# Prefix of a variable along a load path, beside that of the state at its end.
PATH = "path_"

# Unit and long name of what a contact consists of.
_VARIABLES = {
    "height": ("mm", "height of the surface, level"),
    "counterface": ("mm", "height of the face pressed on it, 0 of a flat"),
    "slope_y": ("1", "slope along y of the plane that the surface lies on"),
    "slope_x": ("1", "slope along x of the plane that the surface lies on"),
    "surroundings": ("mm", "displacement by the macroscale pressures outside the patch"),
    "placed": ("1", "whether it is pressed among its surroundings, or alone"),
    "contact_modulus": ("MPa", "contact modulus"),
    "target_pressure": ("MPa", "mean pressure asked for"),
    "tolerance": ("1", "largest residual asked for"),
    "through_y": ("mm", "y of the load point of a body free to tilt, NaN of one that is not"),
    "through_x": ("mm", "x of the load point of a body free to tilt, NaN of one that is not"),
    "pressure": ("MPa", "contact pressure"),
    "gap": ("mm", "gap between the bodies"),
    "displacement": ("mm", "far-field displacement from first touch"),
    "mean_pressure": ("MPa", "mean pressure"),
    "contact_fraction": ("1", "real over nominal contact area"),
    "residual": ("1", "largest violation of contact conditions"),
    "stiffness": ("MPa/mm", "contact stiffness"),
    "interface_stiffness": ("MPa/mm", "contact stiffness without the cut-out's own compliance"),
}
# By the number of dimensions.
_DIMS: tuple[tuple[str, ...], ...] = ((), ("step",), ("y", "x"), ("step", "y", "x"))
# Nothing is computed from it: half of its digits do.
_SINGLE = "gap"


def variables(values: Mapping[str, Any], prefix: str = "") -> dict[str, tuple]:
    """Variables with units and long names; their dimensions follow from how many they have."""
    described = {}
    for name, value in values.items():
        units, long_name = _VARIABLES[name]
        attrs = {"units": units, "long_name": long_name}
        value = np.float32(value) if name == _SINGLE else value
        described[prefix + name] = _DIMS[np.ndim(value)], value, attrs
    return described
