"""Cases beside the study's own contacts: what would change, had it been asked otherwise?

A grinding force, and a cap on the pressure, act on each patch in the study. The table of cases
has one number a row, with the study's own beside it where the two are compared. Fields are not
stored: `solve_slip` and `solve_capped` give them from a stored contact.
"""

import logging
import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem.solver import solve_contact
from gstlib.contact import Contact, log_state, solver_errors
from gstlib.surfaces.grid import described

__all__ = ["capped_rows", "case_table", "patch_rows", "slip_rows", "solve_capped", "solve_slip"]

_log = logging.getLogger(__name__)

# ASSUME: the grinding force grows at constant normal force and along one direction, from rest, so
# that stick and slip are those before the stones slide as a whole; the paper has no friction.

# ASSUME: under a tangential load the bodies are elastically similar, so that tangential tractions
# do not press them apart; the displacement across the load is neglected (it vanishes with Poisson's
# ratio), and that along it taken as the mean over all directions of the load: exact for a circle
# and for isotropic roughness, 5 % too small along a contact five times as long as wide, 5 % too
# large across it.

# ASSUME: one hardness for every element. The default study's 2 GPa is an order of magnitude: quartz
# indents at 11 to 12 GPa (Broz, Cook & Whitney 2006, Am. Mineral. 91:135), quartzite as a whole is
# crushed at 150 to 300 MPa, and the strength of an element as small as a scan's point is in
# between. The paper has none.

# The cases, in the order of the table. The first is the study itself.
_STUDY, _GRINDING, _CAP = "study", "grinding", "cap"
_ALL = ""  # stands for a patch where a row is of all patches
# Unit and long name of what a case consists of.
_VARIABLES = {
    "pressure": ("MPa", "contact pressure"),
    "gap": ("mm", "gap between the bodies; minus the depth of yield"),
    "displacement": ("mm", "far-field displacement from first touch"),
    "capped_fraction": ("1", "share of the contact at the cap"),
    "residual": ("1", "largest violation of contact conditions"),
    "pressure_cap": ("MPa", "cap on the pressure"),
    "traction": ("MPa", "tangential traction along the load"),
    "stick": ("1", "in contact, sticking"),
    "slip": ("1", "in contact, slipping"),
    "tangential_displacement": ("mm", "relative tangential displacement of the far fields"),
}


class Row(NamedTuple):
    """A row of ``cases.csv``."""

    case: str
    patch: str
    quantity: str
    unit: str
    value: float


def solve_slip(
    contact: Contact,
    *,
    friction: float,
    tangential_ratio: float,
    poisson: float,
    source: str | Path = "patch",
) -> xr.Dataset:
    """Stick and slip of a solved contact under a tangential load; its normal part stays as it is.

    With Coulomb friction μ and a tangential force Q that grows at constant normal force P, the
    tractions are q = μ [p(P) − p(P₀)], P₀ = P − Q/μ: full friction less that of the contact under
    the reduced load. That smaller contact sticks; the rest of the contact slips.

    Parameters
    ----------
    contact : Contact
        It is pressed as it was.
    friction : float
        Coulomb's μ, > 0.
    tangential_ratio : float
        Q/μP, from 0 (nothing slips) to 1 (everything does).
    poisson : float
        Poisson's ratio of the two bodies taken as alike, see `gstlib.conditions.study_poisson`.
    source : path
        The file that the contact comes from, for error messages.

    Returns
    -------
    xarray.Dataset
        ``traction`` (y, x) MPa, along the load; ``stick``, ``slip`` (y, x) bool, which together
        are the contact; ``tangential_displacement`` mm.

    Raises
    ------
    InputError
        The solver gives up.

    References
    ----------
    M. Ciavarella, Int. J. Solids Struct. 35 (1998) 2349; J. Jäger, Arch. Appl. Mech. 68 (1998) 247.
    The tangential over the normal compliance: K. L. Johnson, *Contact Mechanics* (1985), §7.2.
    """
    pressure, remaining = contact.pressure.values, 1 - tangential_ratio
    with solver_errors(source, contact.load):
        reduced = solve_contact(
            *contact.interface.for_solver,
            contact.modulus,
            mean_pressure=remaining * contact.mean_pressure,
            initial_pressure=remaining * pressure,
            tolerance=contact.tolerance,
        )
    log_state(reduced)
    stick = reduced.contact & (pressure > 0)
    compliance_ratio = (2 - poisson) / (2 * (1 - poisson))
    descent = contact.displacement - reduced.displacement
    found = {
        "traction": friction * (pressure - reduced.pressure),
        "stick": stick,
        "slip": (pressure > 0) & ~stick,
        "tangential_displacement": friction * compliance_ratio * descent,
    }
    return _on_grid_of(contact, found)


def solve_capped(
    contact: Contact, *, pressure_cap: float, source: str | Path = "patch"
) -> xr.Dataset:
    """A solved contact solved again with a cap on its pressure, at the same mean pressure.

    An elastic solution puts pressures on the summits of a stone that far exceed what any stone
    bears. The contact with p ≤ H says how much of the prediction rests on them.

    `pressure_cap` is the largest pressure that an element bears; the rest is as in `solve_slip`.

    Returns
    -------
    xarray.Dataset
        ``pressure`` (y, x) MPa; ``gap`` (y, x) mm, where the pressure is at the cap minus the
        depth of the yield; ``displacement`` mm, ``capped_fraction`` (of the contact), ``residual``
        and ``pressure_cap`` MPa.
    """
    with solver_errors(source, contact.load):
        state = solve_contact(
            *contact.interface.for_solver,
            contact.modulus,
            mean_pressure=contact.load.mean_pressure,
            pressure_cap=pressure_cap,
            tolerance=contact.tolerance,
        )
    log_state(state)
    names = "pressure", "gap", "displacement", "capped_fraction", "residual"
    found = {name: getattr(state, name) for name in names}
    return _on_grid_of(contact, found | {"pressure_cap": pressure_cap})


def patch_rows(
    contacts: Mapping[str, Contact],
    *,
    grinding: Mapping[str, float] | None,
    pressure_cap: float | None,
) -> Iterator[Row]:
    """The cases of the patches in the study, patch by patch.

    Parameters
    ----------
    contacts : mapping of str to Contact
        By patch; each is looked up once.
    grinding : mapping, optional
        The arguments ``friction``, ``tangential_ratio`` and ``poisson`` of `solve_slip`; without
        it the case is left out.
    pressure_cap : float, optional
        That of `solve_capped`, likewise. A patch that bears more on average is left out, with a
        warning.
    """
    if grinding is not None:
        yield Row(_GRINDING, _ALL, "friction", "1", float(grinding["friction"]))
        yield Row(_GRINDING, _ALL, "tangential ratio", "1", float(grinding["tangential_ratio"]))
    if pressure_cap is not None:
        yield Row(_CAP, _ALL, "pressure cap", "MPa", float(pressure_cap))
    for patch, contact in contacts.items():
        source = f"patch {patch}"
        if grinding is not None:
            yield from slip_rows(patch, solve_slip(contact, source=source, **grinding))
        if pressure_cap is None:
            continue
        if (mean := float(contact.pressure.mean())) >= pressure_cap:
            _log.warning(
                "patch %s: it bears %.4g MPa on average, so pressure_cap_MPa of %g MPa cannot be "
                "solved for it; raise the cap, or set it to null",
                patch,
                mean,
                pressure_cap,
            )
            continue
        limited = solve_capped(contact, source=source, pressure_cap=pressure_cap)
        yield from capped_rows(patch, contact, limited)


def slip_rows(patch: str, slip: xr.Dataset) -> Iterator[Row]:
    """One patch under a grinding force, from `solve_slip`.

    The rest of the contact sticks. Without contact the share that slips is NaN.
    """
    sticking, slipping = int(slip.stick.sum()), int(slip.slip.sum())
    share = slipping / (sticking + slipping) if sticking + slipping else math.nan
    displacement = float(slip.tangential_displacement)
    yield Row(_GRINDING, patch, "mean traction", "MPa", float(slip.traction.values.mean()))
    yield Row(_GRINDING, patch, "slip share", "1", share)
    yield Row(_GRINDING, patch, "tangential displacement", "um", displacement * 1e3)


def capped_rows(patch: str, contact: Contact, limited: xr.Dataset) -> Iterator[Row]:
    """One patch without and with a cap on its pressure, from its contact and `solve_capped`.

    Without contact, the share at the cap is 0.
    """
    elastic, plastic = contact.pressure.values > 0, limited.pressure.values > 0
    at_cap = limited.pressure.values >= float(limited.pressure_cap)
    deepest = float(np.max(-limited.gap.values[at_cap], initial=0.0))
    yield Row(_STUDY, patch, "displacement", "um", float(contact.displacement) * 1e3)
    yield Row(_STUDY, patch, "contact fraction", "1", float(elastic.mean()))
    yield Row(_STUDY, patch, "peak pressure", "MPa", float(contact.pressure.max()))
    yield Row(_CAP, patch, "displacement", "um", float(limited.displacement) * 1e3)
    yield Row(_CAP, patch, "contact fraction", "1", float(plastic.mean()))
    yield Row(_CAP, patch, "share at the cap", "1", float(limited.capped_fraction))
    yield Row(_CAP, patch, "deepest yield", "um", deepest * 1e3)


def case_table(rows: Iterable[Row]) -> pd.DataFrame:
    """The table ``cases.csv``: the rows case by case, the study's own first."""
    cases = [_STUDY, _GRINDING, _CAP]
    # stable: within a case the rows keep their order
    ordered = sorted(rows, key=lambda row: cases.index(row.case))
    return pd.DataFrame(ordered, columns=Row._fields)


def _on_grid_of(contact: Contact, found: Mapping) -> xr.Dataset:
    """Fields (y, x) and numbers of a case, with their units."""
    variables = {
        name: (("y", "x") if np.ndim(value) else (), value) for name, value in found.items()
    }
    on_grid = xr.Dataset(variables, {"y": contact.pressure.y, "x": contact.pressure.x})
    return described(on_grid, _VARIABLES)
