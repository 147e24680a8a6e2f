"""Contact of a surface, from and to the study's own data: `gstlib.bem` for this study.

`gstlib.bem` knows arrays; here its load path becomes a dataset with names and units, and a table.
"""

import logging
import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem import (
    ContactError,
    ContactState,
    DomainTooSmallWarning,
    LoadPath,
    UnreachableTargetError,
    load_path,
    solve_contact,
)
from gstlib.bem.topography import equivalent_heights
from gstlib.errors import InputError
from gstlib.surface import spacing_of

__all__ = [
    "contact_dataset",
    "explained",
    "final_state",
    "load_path_table",
    "pressed_height",
    "solve_at_pressure",
    "solve_path",
]

_log = logging.getLogger(__name__)


def solve_path(
    height: xr.DataArray,
    *,
    source: str | Path,
    contact_modulus_MPa: float,
    target_pressure_MPa: float,
    steps: int,
    tolerance: float,
    maximum_displacement_um: float,
    keep_states: bool,
    workers: int = 1,
) -> LoadPath:
    """Load path of a surface up to a mean pressure, logged step by step.

    Parameters
    ----------
    height : (ny, nx) xarray.DataArray
        Surface heights, mm.
    source : path
        The file that the surface comes from, for the error message.
    contact_modulus_MPa, target_pressure_MPa : float
        E* and the mean pressure to reach, MPa.
    steps, tolerance, keep_states, workers
        See `gstlib.bem.load_path`.
    maximum_displacement_um : float
        Largest far-field displacement allowed, µm.

    Raises
    ------
    InputError
        The pressure is not reached within `maximum_displacement_um`, or the solver gives up.
    """

    def report(step: int, of: int, state: ContactState) -> None:
        _log.info("step %d of %d: %s", step + 1, of, _described(state))

    # the last step is the target, and is solved first: see `gstlib.bem.load_path`
    _log.info("%d x %d elements, %d steps, the last one first", *height.shape, steps)
    with explained(source, target_pressure_MPa):
        return load_path(
            height.values,
            spacing_of(height),
            contact_modulus_MPa,
            target_pressure=target_pressure_MPa,
            steps=steps,
            tolerance=tolerance,
            workers=workers,
            maximum_displacement=maximum_displacement_um * 1e-3,
            keep_states=keep_states,
            progress=report,
        )


def _described(state: ContactState) -> str:
    """A state for the log."""
    return (
        f"displacement {state.displacement * 1e3:.4f} µm, mean pressure {state.mean_pressure:.5g} "
        f"MPa, contact {state.contact_fraction * 100:.4g} %, residual {state.residual:.1e}, "
        f"{state.iterations} iterations"
    )


def solve_at_pressure(
    height: xr.DataArray,
    *,
    source: str | Path,
    contact_modulus_MPa: float,
    target_pressure_MPa: float,
    tolerance: float,
    pressure_limit_MPa: float = math.inf,
    workers: int = 1,
) -> tuple[ContactState, xr.DataArray]:
    """Contact of a surface at a mean pressure alone, and its pressure on the surface's grid.

    Parameters as of `solve_path`, and the ceiling on the pressure; pressures are in MPa.
    """
    with explained(source, target_pressure_MPa):
        state = solve_contact(
            height.values,
            spacing_of(height),
            contact_modulus_MPa,
            mean_pressure=target_pressure_MPa,
            pressure_limit=pressure_limit_MPa,
            tolerance=tolerance,
            workers=workers,
        )
    _log.info(_described(state))
    return state, xr.DataArray(state.pressure, coords=height.coords, dims=height.dims)


def pressed_height(contact: xr.Dataset) -> xr.DataArray:
    """Heights (mm) of the surface that touches a flat as the stored contact's surface was touched.

    Its own heights or, where there is a counterface, the sum of both.
    """
    if "counterface" not in contact:
        return contact.height
    return contact.height.copy(
        data=equivalent_heights(contact.height.values, contact.counterface.values)
    )


def final_state(contact: xr.Dataset, *, source: str | Path, workers: int = 1) -> ContactState:
    """The final state of a stored contact: its pressure is kept, all else is computed from it.

    Parameters
    ----------
    contact : xarray.Dataset
        From `contact_dataset`, without ``every_step``, with the settings it was solved with as
        attributes.
    source : path
        The file that it comes from, for the error message.
    """
    height, target = pressed_height(contact), contact.attrs["target_pressure_MPa"]
    with explained(source, target):
        return solve_contact(
            height.values,
            spacing_of(height),
            contact.attrs["contact_modulus_MPa"],
            mean_pressure=target,
            initial_pressure=contact.pressure.values,
            tolerance=contact.attrs["tolerance"],
            workers=workers,
        )


@contextmanager
def explained(source: str | Path, target_pressure_MPa: float) -> Iterator[None]:
    """Say the solver's errors in the study's words, and leave out the warning that is the rule."""
    try:
        with warnings.catch_warnings():
            # The square and the patches are cut out of a larger stone, so contact at their edges is
            # the rule here; docs/method.md says what that means.
            warnings.simplefilter("ignore", DomainTooSmallWarning)
            yield
    except UnreachableTargetError as error:
        raise InputError(
            source,
            f"the target pressure of {target_pressure_MPa:g} MPa cannot be reached ({error})",
            "Lower target_pressure_MPa or raise maximum_displacement_um in the config.",
        ) from error
    except ContactError as error:
        raise InputError(
            source, f"its contact could not be solved: {error}", "Look at the surface's figure."
        ) from error


def contact_dataset(height: xr.DataArray, path: LoadPath, *, every_step: bool) -> xr.Dataset:
    """The load path with its fields, named and with units.

    Parameters
    ----------
    height : (ny, nx) xarray.DataArray
        The surface that was pressed, mm.
    path : LoadPath
        From `solve_path`; with its states when `every_step`.
    every_step : bool
        Keep pressure and gap of every step, dims (step, y, x), not just of the final state (y, x).
    """

    def along_path(values, units, long_name):
        return ("step", np.asarray(values), {"units": units, "long_name": long_name})

    if every_step:
        dims = ("step", "y", "x")
        pressure = np.stack([state.pressure for state in path.states])
        gap = np.stack([state.gap for state in path.states])
    else:
        dims = ("y", "x")
        pressure, gap = path.final.pressure, path.final.gap
    return xr.Dataset(
        {
            "height": height,
            "pressure": (dims, pressure, {"units": "MPa", "long_name": "contact pressure"}),
            "gap": (dims, gap, {"units": "mm", "long_name": "gap between the bodies"}),
            "displacement": along_path(
                path.displacement, "mm", "far-field displacement from first touch"
            ),
            "mean_pressure": along_path(path.mean_pressure, "MPa", "mean pressure"),
            "contact_fraction": along_path(
                path.contact_fraction, "1", "real over nominal contact area"
            ),
            "stiffness": along_path(path.stiffness, "MPa/mm", "contact stiffness"),
            "residual": along_path(path.residual, "1", "largest violation of contact conditions"),
            "iterations": along_path(path.iterations, "1", "solver iterations"),
        },
        coords={"step": ("step", np.arange(1, len(path.displacement) + 1))},
    )


def load_path_table(contact: xr.Dataset) -> pd.DataFrame:
    """Load path as a table, one row per step (columns of `macroscale_path.csv`)."""
    return pd.DataFrame(
        {
            "step": contact.step.values,
            "displacement_um": contact.displacement.values * 1e3,
            "mean_pressure_MPa": contact.mean_pressure.values,
            "contact_fraction": contact.contact_fraction.values,
            "stiffness_MPa_per_um": contact.stiffness.values * 1e-3,
        }
    )
