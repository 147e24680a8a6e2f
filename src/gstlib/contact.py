"""Two faces in, a contact out: at one load, or along the path to it.

`gstlib.bem` computes with arrays. Here are the study's surfaces, with names and units, and the
solver's errors in the study's words. Where no pressure is asked for, the contact is empty: its
pressure, displacement and stiffness are 0, and shares of the contact are NaN.
"""

import logging
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem import ContactError, ContactState, TippingError, load_path, solve_contact
from gstlib.errors import InputError
from gstlib.surfaces.grid import spacing_of
from gstlib.surfaces.leveling import Plane

__all__ = [
    "LEVEL",
    "Contact",
    "ContactPath",
    "Interface",
    "Load",
    "check_grid",
    "contact_at_pressure",
    "contact_path",
    "from_corner",
    "load_path_table",
    "log_state",
    "solver_errors",
    "turned_over",
]

# Spacings come from the instruments' files: up to this relative difference they are the same.
_SAME_SPACING = 1e-6

# ASSUME: the counterface is turned over about the patch's y axis, so that its scan's columns run
# against the patch's x; the same piece of it, neither shifted nor worn, is pressed on every patch.
# The paper's active tool is flat at both scales.

_log = logging.getLogger(__name__)

# Contact fraction above which the inputs are suspect: rough stones touch on a few per cent, and in
# nearly full contact the heights hardly matter.
_FULL = 0.95
# Unit and long name of what a contact consists of, as it is stored.
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
_DIMS: tuple[tuple[str, ...], ...] = ((), ("step",), ("y", "x"), ("step", "y", "x"))
_FIELDS = "pressure", "gap"
# Nothing is computed from it: half of its digits do.
_SINGLE = "gap"
_NUMBERS = "displacement", "mean_pressure", "contact_fraction", "residual"
# Of a variable along a load path, beside that of the state at its end.
_PATH = "path_"


# The plane of a surface that lies as it is.
LEVEL = Plane(0.0, 0.0, 0.0)


class Load(NamedTuple):
    """What presses two faces on each other.

    Attributes
    ----------
    mean_pressure : float
        MPa, over the nominal area.
    through : (float, float) or None
        Place (y, x), mm, on the surface, through which the force acts on a body that is free to
        tilt; without one its plane stays as it is.
    """

    mean_pressure: float
    through: tuple[float, float] | None = None

    @classmethod
    def of_force(
        cls, force_N: float, surface: xr.DataArray, through: tuple[float, float] | None = None
    ) -> "Load":
        """A force (N) on a surface."""
        area = surface.size * float(np.prod(spacing_of(surface)))
        return cls(force_N / area, through)


@dataclass(frozen=True)
class Interface:
    """Two faces as they are pressed on each other.

    Attributes
    ----------
    height : (y, x) xarray.DataArray
        A surface, level, mm; NaN where there is none.
    counterface : (y, x) xarray.DataArray
        What is pressed on it, mm, positive towards it, as from `turned_over`; NaN where there is
        none, 0 of a flat.
    plane : Plane
        On which the surface is laid; only its slopes count.
    surroundings : (ny, nx) ndarray or None
        Displacement (mm, into the stone) by what presses around it; None of one that is alone.
    """

    height: xr.DataArray
    counterface: xr.DataArray
    plane: Plane = LEVEL
    surroundings: np.ndarray | None = None

    @classmethod
    def on_flat(cls, height: xr.DataArray) -> "Interface":
        """A surface under a flat."""
        return cls(height, xr.zeros_like(height))

    @classmethod
    def from_dataset(cls, stored: xr.Dataset) -> "Interface":
        """From what `Contact.to_dataset` gives."""
        plane = Plane(0.0, float(stored.slope_y), float(stored.slope_x))
        around = stored.surroundings.values if bool(stored.placed) else None
        return cls(stored.height, stored.counterface, plane, around)

    @property
    def laid(self) -> xr.DataArray:
        """Heights (mm) of the surface as it lies on the stone, with those of the face on it.

        Notes
        -----
        Only the gap between two faces enters a contact of half-spaces, so that heights add
        (Bemporad & Paggi, Int. J. Solids Struct. 69-70 (2015) 465).
        """
        plane = replace(self.plane, offset=0.0).heights(self.height)
        return self.height.copy(data=self.height.values + plane + self.counterface.values)

    @property
    def pressed(self) -> xr.DataArray:
        """Heights (mm) of the surface that touches a flat as the two faces touch each other.

        Those of `laid` less the displacement by the surroundings.
        """
        laid = self.laid
        if self.surroundings is None:
            return laid
        return laid.copy(data=laid.values - self.surroundings)

    @property
    def for_solver(self) -> tuple[np.ndarray, tuple[float, float]]:
        """Heights and spacing, as `gstlib.bem` takes them: where a face is missing, −∞."""
        heights = self.pressed
        missing = np.isnan(heights.values)
        return np.where(missing, -np.inf, heights.values), spacing_of(heights)

    def tilted(self, tilt: tuple[float, float]) -> "Interface":
        """The same, with the surface tilted further, by slopes along y and x."""
        slope_y, slope_x = self.plane.slope_y + tilt[0], self.plane.slope_x + tilt[1]
        return replace(self, plane=replace(self.plane, slope_y=slope_y, slope_x=slope_x))


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

    def to_dataset(self) -> xr.Dataset:
        """As it is stored, with units and long names."""
        face = self.interface
        nothing = np.zeros(face.height.shape)
        through = self.load.through or (math.nan, math.nan)
        values = {
            "height": face.height.values,
            "counterface": face.counterface.values,
            "surroundings": nothing if face.surroundings is None else face.surroundings,
            "slope_y": face.plane.slope_y,
            "slope_x": face.plane.slope_x,
            "placed": face.surroundings is not None,
            **{name: getattr(self, name) for name in _NUMBERS},
            **{name: getattr(self, name).values for name in _FIELDS},
            "contact_modulus": self.modulus,
            "target_pressure": self.load.mean_pressure,
            "tolerance": self.tolerance,
            "through_y": through[0],
            "through_x": through[1],
        }
        return xr.Dataset(_variables(values), coords={"y": face.height.y, "x": face.height.x})

    @classmethod
    def from_dataset(cls, stored: xr.Dataset) -> "Contact":
        """From what `to_dataset` gives, or `ContactPath.to_dataset`."""
        through = float(stored.through_y), float(stored.through_x)
        is_free = not math.isnan(through[0])
        return cls(
            Interface.from_dataset(stored),
            Load(float(stored.target_pressure), through if is_free else None),
            float(stored.contact_modulus),
            float(stored.tolerance),
            stored.pressure,
            stored.gap,
            *(float(stored[name]) for name in _NUMBERS),
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

    def to_dataset(self) -> xr.Dataset:
        """As it is stored: the contact at the end, and what is along the path as ``path_…``."""
        names = *_NUMBERS, "stiffness", "interface_stiffness", *_FIELDS
        along = {name: getattr(self, name) for name in names}
        known = {name: values for name, values in along.items() if values is not None}
        steps = np.arange(1, len(self.displacement) + 1)
        stored = self.final.to_dataset().assign_coords(step=steps)
        return stored.assign(_variables(known, _PATH))


def contact_path(
    interface: Interface,
    load: Load,
    *,
    modulus: float,
    tolerance: float,
    steps: int,
    maximum_displacement_um: float,
    every_step: bool = False,
    source: str | Path = "surface",
) -> ContactPath:
    """Contact of two faces along a load path up to a load.

    Parameters
    ----------
    interface : Interface
    load : Load
    modulus, tolerance : float
        As in `Contact`.
    steps : int
        See `gstlib.bem.load_path`.
    maximum_displacement_um : float
        Largest far-field displacement allowed, µm.
    every_step : bool
        Keep pressure and gap of every step, too.
    source : path
        The file that the surface comes from, for error messages.

    Raises
    ------
    InputError
        The load is not reached within `maximum_displacement_um`, or the solver gives up.
    """
    if load.through is not None:
        # ASSUME: on the way to the target load a body has the tilt that it has in the end.
        solved = {"modulus": modulus, "tolerance": tolerance}
        interface = contact_at_pressure(interface, load, source=source, **solved).interface
    with solver_errors(source, load):
        path = load_path(
            *interface.for_solver,
            modulus,
            target_pressure=load.mean_pressure,
            steps=steps,
            keep_states=every_step,
            tolerance=tolerance,
        )
    log_state(path.final)
    needed_um = path.final.displacement * 1e3
    if needed_um > maximum_displacement_um:
        raise InputError(
            source,
            f"the target pressure of {load.mean_pressure:g} MPa cannot be reached within "
            f"{maximum_displacement_um:g} µm of displacement: it takes {needed_um:.4g} µm",
            "Lower the load or raise maximum_displacement_um in the config.",
        )
    if (touching := float(path.final.contact_fraction)) > _FULL:
        logging.getLogger("gstlib").warning(
            "%s: %.0f %% of the surface touches, and rough stones touch on a few per cent: check "
            "the unit of its heights, the target pressure and the elastic constants",
            source,
            100 * touching,
        )
    along: dict[str, Any] = {name: getattr(path, name) for name in (*_NUMBERS, "stiffness")}
    if every_step:
        for name in _FIELDS:
            along[name] = np.stack([_finite(getattr(state, name)) for state in path.states])
    return ContactPath(_contact(interface, load, modulus, tolerance, path.final), **along)


def contact_at_pressure(
    interface: Interface,
    load: Load,
    *,
    modulus: float,
    tolerance: float,
    source: str | Path = "surface",
) -> Contact:
    """Contact of two faces at a load alone, without the path to it.

    Parameters and errors are those of `contact_path`.
    """
    through = None if load.through is None else from_corner(load.through, interface.height)
    with solver_errors(source, load):
        state = solve_contact(
            *interface.for_solver,
            modulus,
            mean_pressure=load.mean_pressure,
            through=through,
            tolerance=tolerance,
        )
    log_state(state)
    if through is not None:
        interface = interface.tilted(state.tilt)
    return _contact(interface, load, modulus, tolerance, state)


def from_corner(place: tuple[float, float], surface: xr.DataArray) -> tuple[float, float]:
    """A place (y, x), mm, on a surface, counted from the corner of its grid."""
    y, x = (
        of - (float(surface[axis][0]) - step / 2)
        for of, axis, step in zip(place, "yx", spacing_of(surface), strict=True)
    )
    return y, x


def _contact(
    interface: Interface, load: Load, modulus: float, tolerance: float, state: ContactState
) -> Contact:
    """What came of an interface under a load."""
    pressure, gap = (
        xr.DataArray(_finite(getattr(state, name)), interface.height.coords, ("y", "x"))
        for name in _FIELDS
    )
    numbers = (float(getattr(state, name)) for name in _NUMBERS)
    return Contact(interface, load, modulus, tolerance, pressure, gap, *numbers)


def _finite(field: np.ndarray) -> np.ndarray:
    """A field (ny, nx) of a contact, NaN in place of infinite where a face is missing."""
    return np.where(np.isinf(field), np.nan, field)


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


def turned_over(
    counterface: xr.DataArray,
    patch: xr.DataArray,
    *,
    source: str | Path,
    patch_source: str | Path,
) -> xr.DataArray:
    """Heights of the active tool's own face where it is pressed on a patch.

    `counterface` (ny, nx) has its heights, mm, positive out of it, seen from above its own face.
    The result is positive towards the patch, on the patch's grid: mirrored along x. `source` and
    `patch_source` are their files, for the error message.

    Raises
    ------
    InputError
        Number or spacing of the points are not the patch's.
    """
    grid, patch_grid = ((face.shape, spacing_of(face)) for face in (counterface, patch))
    check_grid(grid, patch_grid, source=source, patch_source=patch_source)
    return patch.copy(data=counterface.values[:, ::-1]).assign_attrs(
        units="mm", long_name="height of the counterface, turned over onto the patch"
    )


def check_grid(
    counterface: tuple, patch: tuple, *, source: str | Path, patch_source: str | Path
) -> None:
    """Refuse a counterface whose points do not match those of a patch, as `turned_over` does.

    Each is given as ((ny, nx), (dy, dx)): shape and spacing, mm.
    """
    (shape, spacing), (patch_shape, patch_spacing) = counterface, patch
    if shape != patch_shape or not np.allclose(
        spacing, patch_spacing, rtol=_SAME_SPACING, atol=0
    ):
        own, other = (
            f"{n[1]} × {n[0]} points every {s[1]:g} × {s[0]:g} mm"
            for n, s in (counterface, patch)
        )
        raise InputError(
            source,
            f"the counterface has {own}, but {patch_source} has {other}",
            "Scan the counterface as the patches were scanned, or set counterface to null.",
        )


@contextmanager
def solver_errors(source: str | Path, load: Load) -> Iterator[None]:
    """Give an `InputError` in the study's words where a solver of `gstlib.bem` gives up."""
    try:
        yield
    except TippingError as error:
        y, x = load.through or (math.nan, math.nan)
        raise InputError(
            source,
            f"the stone tips over: its force acts through x {x:g}, y {y:g} mm of the square's "
            "axes, where nothing that touches can hold it",
            "Move load.at_mm to a place between summits of the face, or check macroscale.face_mm.",
        ) from error
    except ContactError as error:
        raise InputError(
            source, f"its contact could not be solved: {error}", "Look at the surface's figure."
        ) from error


def log_state(state: Any) -> None:
    """Log what a solver found: a state, or the end of a path."""
    _log.info(
        "%g MPa: displacement %.4f µm, contact %.4g %%, residual %.1e, %d iterations",
        state.mean_pressure,
        state.displacement * 1e3,
        state.contact_fraction * 100,
        state.residual,
        state.iterations,
    )


def _variables(values: Mapping, prefix: str = "") -> dict[str, tuple]:
    """Variables with units and long names; their dimensions follow from how many they have."""
    variables = {}
    for name, value in values.items():
        units, long_name = _VARIABLES[name]
        attrs = {"units": units, "long_name": long_name}
        value = np.float32(value) if name == _SINGLE else value
        variables[prefix + name] = _DIMS[np.ndim(value)], value, attrs
    return variables
