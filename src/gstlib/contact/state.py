"""The state of two faces under a load, and along the path to it; as it is stored."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem.plots import plot_curve, plot_field
from gstlib.contact.dataset import FIELDS, NUMBERS, PATH, variables
from gstlib.contact.interface import Interface
from gstlib.contact.load import Load

__all__ = ["Contact", "ContactPath", "load_path_table"]


@dataclass(frozen=True)
class Contact:
    """The state of an interface at one load.

    Attributes
    ----------
    interface : Interface
        Of a body that is free to tilt, on the plane at which it is in equilibrium.
    load : Load
    modulus : float
        Contact modulus E*, MPa.
    tolerance : float
        Largest residual asked for, as in `gstlib.bem.solve_contact`.
    pressure, gap : (y, x) xarray.DataArray
        MPa and mm; NaN where a face is missing.
    displacement : float
        Far-field displacement from first touch, mm.
    mean_pressure, contact_fraction, residual : float
        MPa, and 1.
    """

    interface: Interface
    load: Load
    modulus: float
    tolerance: float
    pressure: xr.DataArray
    gap: xr.DataArray
    displacement: float
    mean_pressure: float
    contact_fraction: float
    residual: float

    def plot(self, field: str = "pressure", axes: Any = None) -> Any:
        """As `gstlib.bem.ContactState.plot`."""
        touches = self.pressure > 0
        shown = touches if field == "pressure" else ~touches
        return plot_field(field, getattr(self, field), shown, axes)

    def to_dataset(self) -> xr.Dataset:
        """As it is stored, with units and long names."""
        height = self.interface.height
        numbers = {name: getattr(self, name) for name in NUMBERS}
        fields = {name: getattr(self, name).values for name in FIELDS}
        settings = {"contact_modulus": self.modulus, "tolerance": self.tolerance}
        parts = self.interface.parts | self.load.parts | settings | numbers | fields
        return xr.Dataset(variables(parts), coords={"y": height.y, "x": height.x})

    @classmethod
    def from_dataset(cls, stored: xr.Dataset) -> "Contact":
        """From what `to_dataset` gives, or `ContactPath.to_dataset`."""
        return cls(
            Interface.from_dataset(stored),
            Load.from_dataset(stored),
            float(stored.contact_modulus),
            float(stored.tolerance),
            stored.pressure,
            stored.gap,
            *(float(stored[name]) for name in NUMBERS),
        )


@dataclass(frozen=True)
class ContactPath:
    """A contact and the path to its load, in equal steps of displacement.

    Attributes
    ----------
    final : Contact
        At the end of the path.
    displacement, mean_pressure, contact_fraction, residual : (step,) ndarray
        As in `Contact`.
    stiffness : (step,) ndarray
        MPa/mm.
    interface_stiffness : (step,) ndarray or None
        MPa/mm, of the interface alone; known of a patch.
    pressure, gap : (step, ny, nx) ndarray or None
        MPa and mm, if every step is kept.
    """

    final: Contact
    displacement: np.ndarray
    mean_pressure: np.ndarray
    contact_fraction: np.ndarray
    residual: np.ndarray
    stiffness: np.ndarray
    interface_stiffness: np.ndarray | None = None
    pressure: np.ndarray | None = None
    gap: np.ndarray | None = None

    def plot(
        self, y: str = "contact_fraction", x: str = "mean_pressure_MPa", axes: Any = None
    ) -> Any:
        """Draw a column of `load_path_table` over another, as `gstlib.bem.LoadPath.plot`."""
        return plot_curve(load_path_table(self.to_dataset()), x, y, axes)

    def to_dataset(self) -> xr.Dataset:
        """As it is stored: the contact at the end, and what is along the path as ``path_…``."""
        known = {}
        for name in (*NUMBERS, "stiffness", "interface_stiffness", *FIELDS):
            if (values := getattr(self, name)) is not None:
                known[name] = values
        steps = np.arange(1, len(self.displacement) + 1)
        stored = self.final.to_dataset().assign_coords(step=steps)
        return stored.assign(variables(known, PATH))


def load_path_table(path: xr.Dataset) -> pd.DataFrame:
    """Load path of a contact as stored (`ContactPath.to_dataset`), one row per step."""
    return pd.DataFrame(
        {
            "step": path.step.values,
            "displacement_um": path.path_displacement.values * 1e3,
            "mean_pressure_MPa": path.path_mean_pressure.values,
            "contact_fraction": path.path_contact_fraction.values,
            "stiffness_MPa_per_um": path.path_stiffness.values * 1e-3,
        }
    )
