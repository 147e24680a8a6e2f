"""Press two faces on each other: up to a load, or step by step along the path to it."""

import logging
import math
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gstlib.bem.doubts import FULL
from gstlib.bem.errors import ContactError, ContactWarning, TippingError
from gstlib.bem.loading import load_path
from gstlib.bem.solver import solve_contact
from gstlib.contact.interface import Interface, Load
from gstlib.contact.state import Contact, ContactPath
from gstlib.errors import InputError

__all__ = ["contact_at_pressure", "contact_path", "solve_again"]

_log = logging.getLogger(__name__)


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
    solving: dict[str, Any] = {"modulus": modulus, "tolerance": tolerance}
    if load.load_point is not None:
        # ASSUME: Final tilt on the load path. On the way to the target load, a body has the tilt
        # that it has at the target. Reason: All steps of the path then press the same surface.
        final = contact_at_pressure(interface, load, source=source, **solving)
        interface = final.interface
    path = _run(
        load_path,
        interface,
        load,
        source,
        target_pressure=load.mean_pressure,
        steps=steps,
        keep_states=every_step,
        **solving,
    )
    if (needed_um := path.final.displacement * 1e3) > maximum_displacement_um:
        raise InputError(
            source,
            f"the target pressure of {load.mean_pressure:g} MPa cannot be reached within "
            f"{maximum_displacement_um:g} µm of displacement: it takes {needed_um:.4g} µm",
            "Lower the load or raise maximum_displacement_um in the config.",
        )
    if path.final.contact_fraction > FULL:
        logging.getLogger("gstlib").warning(
            "%s: %.0f %% of the surface touches, but rough stones touch on a few per cent. Check "
            "the unit of its heights, the target pressure and the elastic constants",
            source,
            100 * path.final.contact_fraction,
        )
    final = Contact.of_state(path.final, interface, load=load, **solving)
    return ContactPath(**vars(path) | {"final": final})


def contact_at_pressure(
    interface: Interface,
    load: Load,
    *,
    modulus: float,
    tolerance: float,
    source: str | Path = "surface",
    springs: float = 0.0,
    initial_pressure: np.ndarray | None = None,
) -> Contact:
    """Contact of two faces at a load alone, without the path to it.

    See `contact_path` for the other parameters and the errors, and `gstlib.bem.solve_contact` for
    `springs`. The solver starts from `initial_pressure` (ny, nx), MPa, the pressure of a similar
    contact.
    """
    solving: dict[str, Any] = {"modulus": modulus, "tolerance": tolerance}
    state = _run(
        solve_contact,
        interface,
        load,
        source,
        mean_pressure=load.mean_pressure,
        load_point=load.from_corner(interface.height),
        springs=springs,
        initial_pressure=initial_pressure,
        **solving,
    )
    if load.load_point is not None:
        interface = interface.tilted(state.tilt)
    return Contact.of_state(state, interface, load=load, **solving)


def solve_again(
    contact: Contact,
    source: str | Path,
    solver: Callable[..., Any] = solve_contact,
    **options: Any,
) -> Any:
    """Result of a solver of `gstlib.bem` for the interface of a contact, to its tolerance.

    The body stays on its plane. `options` are passed to the solver. See `contact_path` for errors.
    """
    options |= {"modulus": contact.modulus, "tolerance": contact.tolerance}
    return _run(solver, contact.interface, contact.load, source, **options)


def _run(
    solver: Callable[..., Any],
    interface: Interface,
    load: Load,
    source: str | Path,
    *,
    modulus: float,
    **options: Any,
) -> Any:
    """Result of a solver, which is logged; an `InputError` for the user if the solver fails.

    Warnings of the solver are meant for users without a study. In a study, the heights of a patch
    contain its surroundings, a face may end, and `plausibility_warnings` reports oddities.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ContactWarning)
            solved = solver(*interface.for_solver, modulus, **options)
    except TippingError as error:
        y, x = load.load_point or (math.nan, math.nan)
        raise InputError(
            source,
            f"the stone tips over: its force acts through x {x:g}, y {y:g} mm of the square's "
            "axes, a point at which the contact cannot balance it",
            "Move load.at_mm to a point between summits of the face, or check macroscale.face_mm.",
        ) from error
    except ContactError as error:
        raise InputError(
            source,
            f"its contact could not be solved: {error}",
            "Look at the surface's figure.",
        ) from error
    state = getattr(solved, "final", solved)
    _log.info(
        "%g MPa: displacement %.4f µm, contact %.4g %%, residual %.1e, %d iterations",
        state.mean_pressure,
        state.displacement * 1e3,
        state.contact_fraction * 100,
        state.residual,
        state.iterations,
    )
    return solved
