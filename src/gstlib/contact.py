"""Two faces in, a contact dataset out, along a load path or at one load.

`gstlib.bem` computes with arrays. Here are the study's surfaces, with names and units, and the
solver's errors in the study's words. Where no pressure is asked for, the contact is empty: its
pressure, displacement and stiffness are 0, and shares of the contact are NaN.
"""

import logging
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem import ContactError, ContactState, TipsOver, load_path, solve_contact
from gstlib.errors import InputError
from gstlib.surfaces.grid import spacing_of
from gstlib.surfaces.leveling import Plane

__all__ = [
    "LAID",
    "Loading",
    "along_path",
    "check_grid",
    "contact_at_pressure",
    "contact_path",
    "faces_of",
    "from_corner",
    "laid_height",
    "load_path_table",
    "pressed_height",
    "solved",
    "tilted",
    "turned_over",
]

# Spacings come from the instruments' files: up to this relative difference they are the same.
_SAME_SPACING = 1e-6

# ASSUME: the counterface is turned over about the patch's y axis, so that its scan's columns run
# against the patch's x; the same piece of it, neither shifted nor worn, is pressed on every patch.
# The paper's active stone is flat at both scales.

_log = logging.getLogger(__name__)

# Contact fraction above which the inputs are suspect: rough stones touch on a few per cent, and in
# nearly full contact the heights hardly matter.
_FULL = 0.95
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
    "through_y": (
        "mm",
        "y of the point of force of a body free to tilt, NaN of one that is not",
    ),
    "through_x": (
        "mm",
        "x of the point of force of a body free to tilt, NaN of one that is not",
    ),
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
# Variables of a contact that `laid_height` takes, and those that `microscale_tables` takes.
LAID = "height", "slope_y", "slope_x", "counterface"


class Loading(NamedTuple):
    """How two faces are pressed on each other.

    Attributes
    ----------
    contact_modulus_MPa, target_pressure_MPa : float
        E* and the mean pressure to reach.
    tolerance : float
        Largest residual, as in `gstlib.bem.solve_contact`.
    through : (float, float) or None
        Place (y, x), mm, on the surface, through which the force acts on a body that is free to
        tilt; without one its plane stays as it is.
    """

    contact_modulus_MPa: float
    target_pressure_MPa: float
    tolerance: float
    through: tuple[float, float] | None = None

    @classmethod
    def by_force(
        cls,
        force_N: float,
        through: tuple[float, float] | None,
        surface: xr.DataArray,
        *,
        contact_modulus_MPa: float,
        tolerance: float,
    ) -> "Loading":
        """A force (N) on a surface, through a place (y, x), mm, of it if it is free to tilt."""
        area = surface.size * float(np.prod(spacing_of(surface)))
        return cls(contact_modulus_MPa, force_N / area, tolerance, through)

    @classmethod
    def of(cls, contact: xr.Dataset) -> "Loading":
        """How a contact was pressed."""
        through = float(contact.through_y), float(contact.through_x)
        return cls(
            float(contact.contact_modulus),
            float(contact.target_pressure),
            float(contact.tolerance),
            None if math.isnan(through[0]) else through,
        )


def faces_of(
    height: xr.DataArray,
    counterface: xr.DataArray | None = None,
    *,
    slopes: tuple[float, float] = (0.0, 0.0),
    surroundings: np.ndarray | None = None,
) -> xr.Dataset:
    """Two faces as they are pressed on each other.

    Parameters
    ----------
    height : (y, x) xarray.DataArray
        A surface, level, mm; NaN where there is none.
    counterface : (y, x) xarray.DataArray, optional
        What is pressed on it, mm, positive towards it, as from `turned_over`; NaN where there is
        none; by default a flat.
    slopes : (float, float)
        Of the plane that the surface is laid on, along y and x.
    surroundings : (ny, nx) ndarray, optional
        Displacement (mm, into the stone) by what presses around it; by default it is alone.

    Returns
    -------
    xarray.Dataset
        ``height, counterface, surroundings`` (y, x), ``slope_y, slope_x, placed``.
    """
    nothing = np.zeros(height.shape)
    values = {
        "height": height.values,
        "counterface": nothing if counterface is None else counterface.values,
        "surroundings": nothing if surroundings is None else surroundings,
        "slope_y": slopes[0],
        "slope_x": slopes[1],
        "placed": surroundings is not None,
    }
    return xr.Dataset(_variables(values), coords={"y": height.y, "x": height.x})


def contact_path(
    faces: xr.Dataset,
    loading: Loading,
    *,
    source: str | Path,
    steps: int,
    maximum_displacement_um: float,
    every_step: bool = False,
) -> xr.Dataset:
    """Contact of two faces along a load path up to a mean pressure.

    Parameters
    ----------
    faces : xarray.Dataset
        From `faces_of`.
    loading : Loading
    source : path
        The file that the surface comes from, for error messages.
    steps : int
        See `gstlib.bem.load_path`.
    maximum_displacement_um : float
        Largest far-field displacement allowed, µm.
    every_step : bool
        Keep pressure and gap of every step, too.

    Returns
    -------
    xarray.Dataset
        The contact at the target pressure, as from `contact_at_pressure`; and along the path (step)
        ``path_displacement`` mm, ``path_mean_pressure`` MPa, ``path_contact_fraction``,
        ``path_stiffness`` MPa/mm and ``path_residual``; with `every_step` also ``path_pressure``
        MPa and ``path_gap`` mm (step, y, x).

    Raises
    ------
    InputError
        The pressure is not reached within `maximum_displacement_um`, or the solver gives up.
    """
    options = {
        "target_pressure": loading.target_pressure_MPa,
        "steps": steps,
        "keep_states": every_step,
    }
    if loading.through is not None:
        # ASSUME: on the way to the target load a body has the tilt that it has in the end.
        rest = contact_at_pressure(faces, loading, source=source)
        faces = faces.assign({name: rest[name] for name in ("slope_y", "slope_x")})
    path = solved(load_path, faces, loading, source, **options)
    needed_um = path.final.displacement * 1e3
    if needed_um > maximum_displacement_um:
        raise InputError(
            source,
            f"the target pressure of {loading.target_pressure_MPa:g} MPa cannot be reached within "
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
    along = {name: getattr(path, name) for name in (*_NUMBERS, "stiffness")}
    if every_step:
        for name in _FIELDS:
            along[name] = np.stack([_finite(getattr(state, name)) for state in path.states])
    contact = _contact(faces, loading, path.final)
    contact = contact.assign_coords(step=np.arange(1, steps + 1))
    return contact.assign(along_path(along))


def contact_at_pressure(
    faces: xr.Dataset, loading: Loading, *, source: str | Path
) -> xr.Dataset:
    """Contact of two faces at a mean pressure alone, without the path to it.

    Parameters and errors are those of `contact_path`.

    Returns
    -------
    xarray.Dataset
        `faces`, of a body that is free to tilt on the plane at which it rests; ``pressure`` MPa and
        ``gap`` mm (y, x), NaN where a face is missing, the gap in single precision;
        ``displacement`` mm, ``mean_pressure`` MPa, ``contact_fraction`` and ``residual``; and the
        loading: ``contact_modulus`` and
        ``target_pressure``, MPa, ``tolerance``, ``through_y`` and ``through_x``, mm.
    """
    options: dict[str, Any] = {"mean_pressure": loading.target_pressure_MPa}
    if loading.through is not None:
        options["through"] = from_corner(loading.through, faces.height)
    state = solved(solve_contact, faces, loading, source, **options)
    if loading.through is not None:
        faces = tilted(faces, state.tilt)
    return _contact(faces, loading, state)


def tilted(faces: xr.Dataset, tilt: tuple[float, float]) -> xr.Dataset:
    """Faces of which the surface is tilted further, by slopes along y and x."""
    slopes = {
        name: float(faces[name]) + by
        for name, by in zip(("slope_y", "slope_x"), tilt, strict=True)
    }
    return faces.assign(_variables(slopes))


def from_corner(place: tuple[float, float], surface: xr.DataArray) -> tuple[float, float]:
    """A place (y, x), mm, on a surface, counted from the corner of its grid."""
    y, x = (
        of - (float(surface[axis][0]) - step / 2)
        for of, axis, step in zip(place, "yx", spacing_of(surface), strict=True)
    )
    return y, x


def _contact(faces: xr.Dataset, loading: Loading, state: ContactState) -> xr.Dataset:
    """Faces with how they were pressed, and with what came of it."""
    values = {name: getattr(state, name) for name in _NUMBERS}
    values |= {name: _finite(getattr(state, name)) for name in _FIELDS}
    modulus, pressure, tolerance, through = loading
    values |= {"contact_modulus": modulus, "target_pressure": pressure, "tolerance": tolerance}
    values["through_y"], values["through_x"] = through or (math.nan, math.nan)
    return faces.assign(_variables(values))


def _finite(field: np.ndarray) -> np.ndarray:
    """A field (ny, nx) of a contact, NaN in place of infinite where a face is missing."""
    return np.where(np.isinf(field), np.nan, field)


def laid_height(faces: xr.Dataset) -> xr.DataArray:
    """Heights (mm) of a surface as it lies on the stone, with those of the face pressed on it.

    Notes
    -----
    Only the gap between two faces enters a contact of half-spaces, so that heights add (Bemporad &
    Paggi, Int. J. Solids Struct. 69-70 (2015) 465).
    """
    height = faces.height
    plane = Plane(0.0, float(faces.slope_y), float(faces.slope_x))
    values = height.values + plane.heights(height) + faces.counterface.values
    return height.copy(data=values)


def pressed_height(faces: xr.Dataset) -> xr.DataArray:
    """Heights (mm) of the surface that touches a flat as the faces of a contact touch each other.

    `laid_height` less the displacement by the surroundings.
    """
    height = laid_height(faces)
    return height.copy(data=height.values - faces.surroundings.values)


def turned_over(
    counterface: xr.DataArray,
    patch: xr.DataArray,
    *,
    source: str | Path,
    patch_source: str | Path,
) -> xr.DataArray:
    """Heights of the active stone's own face where it is pressed on a patch.

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


def solved(solve: Callable, faces: xr.Dataset, loading: Loading, source: str | Path, **options):
    """What a solver of `gstlib.bem` finds for two faces; an `InputError` where it gives up."""
    height = pressed_height(faces)
    options["tolerance"] = loading.tolerance
    # where a face is missing, nothing ever touches
    heights = np.where(np.isnan(height.values), -np.inf, height.values)
    try:
        found = solve(heights, spacing_of(height), loading.contact_modulus_MPa, **options)
    except TipsOver as error:
        y, x = loading.through or (math.nan, math.nan)
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
    state = getattr(found, "final", found)
    _log.info(
        "%g MPa: displacement %.4f µm, contact %.4g %%, residual %.1e, %d iterations",
        state.mean_pressure,
        state.displacement * 1e3,
        state.contact_fraction * 100,
        state.residual,
        state.iterations,
    )
    return found


def along_path(values: Mapping) -> dict[str, tuple]:
    """Variables of a contact along its load path (step), with units and long names."""
    return _variables(values, _PATH)


def _variables(values: Mapping, prefix: str = "") -> dict[str, tuple]:
    """Variables with units and long names; their dimensions follow from how many they have."""
    variables = {}
    for name, value in values.items():
        units, long_name = _VARIABLES[name]
        attrs = {"units": units, "long_name": long_name}
        value = np.float32(value) if name == _SINGLE else value
        variables[prefix + name] = _DIMS[np.ndim(value)], value, attrs
    return variables


def load_path_table(contact: xr.Dataset) -> pd.DataFrame:
    """Load path of a contact of `contact_path`, one row per step."""
    return pd.DataFrame(
        {
            "step": contact.step.values,
            "displacement_um": contact.path_displacement.values * 1e3,
            "mean_pressure_MPa": contact.path_mean_pressure.values,
            "contact_fraction": contact.path_contact_fraction.values,
            "stiffness_MPa_per_um": contact.path_stiffness.values * 1e-3,
        }
    )
