"""A surface in, a contact dataset out: along a load path, or at one pressure.

`gstlib.bem` computes with arrays. Here are the study's surfaces, with names and units, and the
solver's errors in the study's words. Where no pressure is asked for, the contact is empty: its
pressure, displacement and stiffness are 0.
"""

import logging
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem import ContactError, ContactState, contact_modulus, load_path, solve_contact
from gstlib.errors import InputError
from gstlib.preprocess.leveling import Plane
from gstlib.surface import spacing_of

__all__ = [
    "check_grid",
    "contact_at_pressure",
    "contact_moduli",
    "contact_path",
    "faces_of",
    "interface_stiffness",
    "laid_height",
    "load_path_table",
    "pressed_height",
    "solved",
    "study_poisson",
    "turned_over",
]

# Spacings come from the instruments' files: up to this relative difference they are the same.
_SAME_SPACING = 1e-6

# ASSUME: the counterface is turned over about the patch's y axis, so that its scan's columns run
# against the patch's x; the same piece of it, neither shifted nor worn, is pressed on every patch;
# at the macroscale the active stone stays flat. The paper's active stone is flat at both scales.

_log = logging.getLogger(__name__)

# A share of the surface in contact beyond which something is wrong: rough stones touch on a few per
# cent, and where nearly all touches, how heights differ no longer matters.
_FULL = 0.95
# Unit and long name of what a contact consists of.
_VARIABLES = {
    "pressure": ("MPa", "contact pressure"),
    "gap": ("mm", "gap between the bodies"),
    "displacement": ("mm", "far-field displacement from first touch"),
    "mean_pressure": ("MPa", "mean pressure"),
    "contact_fraction": ("1", "real over nominal contact area"),
    "stiffness": ("MPa/mm", "contact stiffness"),
    "interface_stiffness": (
        "MPa/mm",
        "contact stiffness without the cut-out's own compliance",
    ),
    "residual": ("1", "largest violation of contact conditions"),
}
# Dimensions by their number.
_DIMS: tuple[tuple[str, ...], ...] = ((), ("step",), ("y", "x"), ("step", "y", "x"))
_FIELDS = "pressure", "gap"
_NUMBERS = "displacement", "mean_pressure", "contact_fraction", "residual"


def contact_path(
    faces: xr.Dataset,
    *,
    source: str | Path,
    contact_modulus_MPa: float,
    target_pressure_MPa: float,
    steps: int,
    tolerance: float,
    maximum_displacement_um: float,
    every_step: bool = False,
) -> xr.Dataset:
    """Contact of a surface along a load path up to a mean pressure.

    Parameters
    ----------
    faces : xarray.Dataset
        ``height`` (y, x) of a surface, mm, and what `pressed_height` adds to it.
    source : path
        The file that the surface comes from, for error messages.
    contact_modulus_MPa, target_pressure_MPa : float
        E* and the mean pressure to reach, MPa.
    steps, tolerance
        See `gstlib.bem.load_path`.
    maximum_displacement_um : float
        Largest far-field displacement allowed, µm.
    every_step : bool
        Keep pressure and gap of every step, dims (step, y, x), not just of the final state (y, x).

    Returns
    -------
    xarray.Dataset
        `faces` with ``pressure`` MPa and ``gap`` mm; along the path (step) ``displacement`` mm,
        ``mean_pressure`` MPa, ``contact_fraction``, ``stiffness`` MPa/mm and ``residual``. E*,
        target pressure and tolerance are its attributes.

    Raises
    ------
    InputError
        The pressure is not reached within `maximum_displacement_um`, or the solver gives up.
    """
    contact = faces.assign_attrs(
        contact_modulus_MPa=contact_modulus_MPa,
        target_pressure_MPa=target_pressure_MPa,
        tolerance=tolerance,
    )
    options = {
        "target_pressure": target_pressure_MPa,
        "steps": steps,
        "keep_states": every_step,
    }
    path = solved(load_path, contact, source, **options)
    needed_um = path.final.displacement * 1e3
    if needed_um > maximum_displacement_um:
        raise InputError(
            source,
            f"the target pressure of {target_pressure_MPa:g} MPa cannot be reached within "
            f"{maximum_displacement_um:g} µm of displacement: it takes {needed_um:.4g} µm",
            "Lower target_pressure_MPa or raise maximum_displacement_um in the config.",
        )
    if (touching := float(path.final.contact_fraction)) > _FULL:
        logging.getLogger("gstlib").warning(
            "%s: %.0f %% of the surface touches, of which a rough stone is far: check the unit of "
            "its heights, the target pressure and the elastic constants",
            source,
            100 * touching,
        )
    fields = {name: getattr(path.final, name) for name in _FIELDS}
    if every_step:
        fields = {
            name: np.stack([getattr(at, name) for at in path.states]) for name in _FIELDS
        }
    curve = {name: getattr(path, name) for name in (*_NUMBERS, "stiffness")}
    contact = contact.assign_coords(step=np.arange(1, steps + 1))
    return contact.assign(_variables(fields | curve))


def contact_at_pressure(
    faces: xr.Dataset,
    *,
    source: str | Path,
    contact_modulus_MPa: float,
    target_pressure_MPa: float,
    tolerance: float,
) -> xr.Dataset:
    """Contact of a surface at a mean pressure alone, without the path to it.

    Parameters, errors and what is returned as of `contact_path`; ``displacement``,
    ``mean_pressure``, ``contact_fraction`` and ``residual`` are numbers, without ``stiffness``.
    """
    contact = faces.assign_attrs(
        contact_modulus_MPa=contact_modulus_MPa,
        target_pressure_MPa=target_pressure_MPa,
        tolerance=tolerance,
    )
    state = solved(solve_contact, contact, source, mean_pressure=target_pressure_MPa)
    return contact.assign(_state_variables(state))


def faces_of(surface: xr.Dataset) -> xr.Dataset:
    """What is pressed of a square: its ``height`` and, of a second stone, its ``counterface``."""
    return xr.Dataset(
        {name: surface[name] for name in ("height", "counterface") if name in surface}
    )


def interface_stiffness(contact: xr.Dataset) -> xr.DataArray:
    """Stiffness (step), MPa/mm, of the rough interface alone, along the path of a contact.

    A patch is cut out of the stone. Its displacement under a mean pressure has two parts: that of
    the interface, and that of the half-space under a load on the patch alone, which the
    surrounding stone does not share in the computation. The second is the compliance of a flat
    punch of the patch's outline, pressed in with the same solver; compliances in series add. Where
    nothing touches, the stiffness is 0.
    """
    height, modulus = contact.height, contact.attrs["contact_modulus_MPa"]
    punch = _punch_stiffness(height.shape, spacing_of(height), modulus)
    stiffness = contact.stiffness.values
    alone = np.divide(
        punch * stiffness,
        punch - stiffness,
        out=np.full_like(stiffness, np.inf),
        where=stiffness < punch,
    )
    units, long_name = _VARIABLES["interface_stiffness"]
    return contact.stiffness.copy(data=alone).assign_attrs(units=units, long_name=long_name)


@lru_cache
def _punch_stiffness(
    shape: tuple[int, int], spacing: tuple[float, float], contact_modulus_MPa: float
) -> float:
    """Mean pressure over displacement, MPa/mm, of a rigid flat punch as large as the grid."""
    depth = float(np.prod(spacing)) ** 0.5
    punch = solve_contact(np.zeros(shape), spacing, contact_modulus_MPa, displacement=depth)
    return punch.mean_pressure / depth


def load_path_table(contact: xr.Dataset) -> pd.DataFrame:
    """Load path as a table, one row per step (columns of `macroscale_path.csv`)."""
    columns = {
        "step": contact.step.values,
        "displacement_um": contact.displacement.values * 1e3,
        "mean_pressure_MPa": contact.mean_pressure.values,
        "contact_fraction": contact.contact_fraction.values,
        "stiffness_MPa_per_um": contact.stiffness.values * 1e-3,
    }
    if "interface_stiffness" in contact:
        columns["interface_stiffness_MPa_per_um"] = contact.interface_stiffness.values * 1e-3
    return pd.DataFrame(columns)


def laid_height(contact: xr.Dataset) -> xr.DataArray:
    """Heights (mm) of a surface as it lies on the stone, with those of the face pressed on it.

    Parameters
    ----------
    contact : xarray.Dataset
        ``height``; the attributes ``slope_y`` and ``slope_x`` of its plane, where it has one;
        ``counterface``, where there is one, as of `turned_over`.

    Notes
    -----
    Only the gap between two faces enters a contact of half-spaces, so that heights add (Bemporad &
    Paggi, Int. J. Solids Struct. 69-70 (2015) 465).
    """
    height = contact.height
    plane = Plane(0.0, contact.attrs.get("slope_y", 0.0), contact.attrs.get("slope_x", 0.0))
    values = height.values + plane.heights(height)
    if "counterface" in contact:
        values = values + contact.counterface.values
    return height.copy(data=values)


def pressed_height(contact: xr.Dataset) -> xr.DataArray:
    """Heights (mm) of the surface that touches a flat as the faces of a contact touch each other.

    `laid_height` less the displacement by ``surroundings``, where these are known.
    """
    height = laid_height(contact)
    if "surroundings" not in contact:
        return height
    return height.copy(data=height.values - contact.surroundings.values)


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


def solved(solve: Callable, contact: xr.Dataset, source: str | Path, **options):
    """What a solver of `gstlib.bem` finds for the faces of a contact, with its settings."""
    height, modulus = pressed_height(contact), contact.attrs["contact_modulus_MPa"]
    options["tolerance"] = contact.attrs["tolerance"]
    try:
        found = solve(height.values, spacing_of(height), modulus, **options)
    except ContactError as error:
        raise InputError(
            source,
            f"its contact could not be solved: {error}",
            "Look at the surface's figure.",
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


def _state_variables(state: ContactState) -> dict[str, tuple]:
    return _variables({name: getattr(state, name) for name in (*_FIELDS, *_NUMBERS)})


def _variables(values: Mapping) -> dict[str, tuple]:
    """Variables with their units; what they have for dimensions follows from their number."""
    variables = {}
    for name, value in values.items():
        units, long_name = _VARIABLES[name]
        variables[name] = (
            _DIMS[np.ndim(value)],
            value,
            {"units": units, "long_name": long_name},
        )
    return variables


def contact_moduli(material: Mapping) -> tuple[float, float | None]:
    """The contact modulus (MPa) of the study, and another that its elastic constants give.

    The second is None where the config leaves the first to the elastic constants.
    """
    names = ("young_1_MPa", "poisson_1", "young_2_MPa", "poisson_2")
    standard = contact_modulus(*(material[name] for name in names))
    given = material["contact_modulus_MPa"]
    return (standard, None) if given is None else (float(given), standard)


def study_poisson(material: Mapping) -> float:
    """Poisson's ratio of two like stones as compliant tangentially as the study's two are.

    The mean of both ratios weighted by the stones' shear compliance 1/G = 2 (1 + ν)/E: with it,
    (2 − ν)/(2 (1 − ν)) is the sum of (2 − ν)/(4G) over the sum of (1 − ν)/(2G), tangential over
    normal compliance (Johnson, Contact Mechanics, §7.2).
    """
    # ASSUME: where the two stones differ, their tangential compliances add; Dundurs' β, by which
    # tangential tractions press unlike bodies apart, is neglected.
    poisson = [material["poisson_1"], material["poisson_2"]]
    young = [material["young_1_MPa"], material["young_2_MPa"]]
    weights = [(1 + ratio) / modulus for ratio, modulus in zip(poisson, young, strict=True)]
    return float(np.average(poisson, weights=weights))
