"""The state of an interface under a load, and the path to it, as they are stored."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem.fields import FIELDS
from gstlib.bem.loading import LoadPath, curve_table
from gstlib.bem.state import ContactState
from gstlib.contact.interface import Interface, Load

__all__ = ["VARIABLES", "Contact", "ContactPath", "load_path_table"]

# Fields that are stored under the same names at one load and along the path to it.
_FIELDS = "pressure", "gap"
_NUMBERS = "displacement", "mean_pressure", "contact_fraction", "residual"
# Prefix of a variable along a load path. The variable of the final state has no prefix.
_PATH = "path_"

# Unit and long name of each variable.
VARIABLES = FIELDS | {
    "height": ("mm", "height of the surface, level"),
    "counterface": ("mm", "height of the counterface, 0 for a flat"),
    "slope_y": ("1", "slope of the plane of the surface along y"),
    "slope_x": ("1", "slope of the plane of the surface along x"),
    "surroundings": (
        "mm",
        "displacement by the macroscale pressures outside the patch",
    ),
    "placed": ("1", "whether the pressures around the patch are included"),
    "contact_modulus": ("MPa", "contact modulus"),
    "target_pressure": ("MPa", "target mean pressure"),
    "tolerance": ("1", "largest permitted residual"),
    "load_point_y": ("mm", "y of the load point, NaN if the body is not free to tilt"),
    "load_point_x": ("mm", "x of the load point, NaN if the body is not free to tilt"),
    "displacement": ("mm", "far-field displacement from first touch"),
    "mean_pressure": ("MPa", "mean pressure"),
    "contact_fraction": ("1", "real over nominal contact area"),
    "residual": ("1", "largest violation of contact conditions"),
    "stiffness": ("MPa/mm", "contact stiffness"),
    "interface_stiffness": (
        "MPa/mm",
        "contact stiffness without the cut-out's own compliance",
    ),
}
# By the number of dimensions.
_DIMS: tuple[tuple[str, ...], ...] = ((), ("step",), ("y", "x"), ("step", "y", "x"))


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Contact(ContactState):
    """The state of an interface at one load, with its fields on the grid of the interface.

    If a contact was read from a file, fields that are not stored have default values.

    Attributes
    ----------
    interface : Interface
        A body that is free to tilt is on the plane at which it is in equilibrium.
    load : Load
    modulus : float
        Contact modulus E*, MPa.
    tolerance : float
        Largest residual asked for, as in `gstlib.bem.solve_contact`.
    pressure, gap : (y, x) xarray.DataArray
        MPa and mm. The gap is NaN where a face is missing.

    Examples
    --------
    >>> import numpy as np
    >>> import gstlib
    >>> rough = 2e-3 * np.random.default_rng(0).standard_normal((20, 20))
    >>> face = gstlib.Interface.on_flat(gstlib.make_surface(rough, 0.05))
    >>> options = {"modulus": 1e4, "tolerance": 1e-6}
    >>> gstlib.contact.contact_at_pressure(face, gstlib.Load(20.0), **options).contact_fraction
    0.11
    """

    interface: Interface
    load: Load
    modulus: float
    tolerance: float

    @classmethod
    def of_state(
        cls, state: ContactState, interface: Interface, **settings: Any
    ) -> "Contact":
        """The contact in a state of the solver; `settings` are the other attributes."""
        grid = interface.height.coords, ("y", "x")
        fields = {
            name: xr.DataArray(_finite(getattr(state, name)), *grid) for name in _FIELDS
        }
        return cls(**vars(state) | fields, interface=interface, **settings)

    def to_dataset(self) -> xr.Dataset:
        """As it is stored, with units and long names."""
        face, surroundings = self.interface, self.interface.surroundings
        load_point_y, load_point_x = self.load.load_point or (math.nan, math.nan)
        is_placed = surroundings is not None
        values = {
            "height": face.height.values,
            "counterface": face.counterface.values,
            "surroundings": surroundings if is_placed else np.zeros(face.height.shape),
            "slope_y": face.plane.slope_y,
            "slope_x": face.plane.slope_x,
            "placed": is_placed,
            "target_pressure": self.load.mean_pressure,
            "load_point_y": load_point_y,
            "load_point_x": load_point_x,
            "contact_modulus": self.modulus,
            "tolerance": self.tolerance,
            **{name: float(getattr(self, name)) for name in _NUMBERS},
            **{name: getattr(self, name).values for name in _FIELDS},
        }
        return xr.Dataset(
            _variables(values), coords={"y": face.height.y, "x": face.height.x}
        )

    @classmethod
    def from_dataset(cls, stored: xr.Dataset) -> "Contact":
        """The contact in a dataset from `to_dataset`, or from `ContactPath.to_dataset`."""
        load_point = float(stored.load_point_y), float(stored.load_point_x)
        is_free = not math.isnan(load_point[0])
        values: dict[str, Any] = {name: stored[name] for name in _FIELDS}
        values |= {name: float(stored[name]) for name in _NUMBERS}
        return cls(
            **values,
            interface=Interface.from_dataset(stored),
            load=Load(float(stored.target_pressure), load_point if is_free else None),
            modulus=float(stored.contact_modulus),
            tolerance=float(stored.tolerance),
        )


@dataclass(frozen=True, eq=False, repr=False)
class ContactPath(LoadPath):
    """A contact and the path to its load, in equal steps of displacement.

    Attributes
    ----------
    final : Contact
        At the end of the path.
    interface_stiffness : (step,) ndarray or None
        MPa/mm, of the interface alone, for a patch.
    """

    final: Contact
    interface_stiffness: np.ndarray | None = None

    def to_dataset(self) -> xr.Dataset:
        """The stored dataset: the contact at the end, and the path as ``path_…``."""
        along = {name: getattr(self, name) for name in (*_NUMBERS, "stiffness")}
        if self.interface_stiffness is not None:
            along["interface_stiffness"] = self.interface_stiffness
        for name in _FIELDS if self.states else ():
            fields = [_finite(getattr(state, name)) for state in self.states]
            along[name] = np.stack(fields)
        steps = np.arange(1, len(self.displacement) + 1)
        stored = self.final.to_dataset().assign_coords(step=steps)
        return stored.assign(_variables(along, _PATH))


def load_path_table(path: xr.Dataset) -> pd.DataFrame:
    """Load path of a contact as stored (`ContactPath.to_dataset`), one row per step."""
    table = curve_table(path, _PATH)
    table.insert(0, "step", path.step.values)
    return table


def _finite(field: np.ndarray) -> np.ndarray:
    """A field (ny, nx) of a contact, NaN instead of infinite where a face is missing."""
    return np.where(np.isinf(field), np.nan, field)


def _variables(values: Mapping[str, Any], prefix: str = "") -> dict[str, tuple]:
    """Variables with units and long names. The number of dimensions determines their names."""
    described = {}
    for name, value in values.items():
        units, long_name = VARIABLES[name]
        # Nothing is computed from the gap: half of its digits do.
        value = np.float32(value) if name == "gap" else value
        attrs = {"units": units, "long_name": long_name}
        described[prefix + name] = _DIMS[np.ndim(value)], value, attrs
    return described
