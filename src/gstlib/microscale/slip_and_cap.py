"""Cases beside the study's contacts: a grinding force, and a cap on the pressure.

Both act on each patch in the study. The table of cases has one number in each row, beside the
number of the study if the two are compared. Fields are not stored. `solve_slip` and `solve_capped`
compute them from a stored contact.
"""

import logging
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem.errors import checked_fraction, checked_number, checked_poisson
from gstlib.contact import VARIABLES, Contact, solve_again
from gstlib.surfaces.grid import described

__all__ = ["capped_numbers", "case_table", "slip_numbers", "solve_capped", "solve_slip"]

_log = logging.getLogger(__name__)

# ASSUME: Grinding force from rest. The grinding force grows from rest in one direction, at constant
# normal force. Stick and slip are therefore computed for the moment before the stones slide as a
# whole. Reason: The paper does not include friction.

# ASSUME: Elastic similarity under tangential load. The bodies are elastically similar, so
# tangential tractions do not press them apart. The displacement across the load, which vanishes
# with Poisson's ratio, is neglected. The displacement along the load is its mean over all
# directions of the load. Reason: This mean is exact for a circle and for isotropic roughness. Along
# a contact five times as long as wide it is 5 % too small, across it 5 % too large.

# ASSUME: Uniform hardness. Every element has the same hardness. The 2 GPa of the default study are
# an order of magnitude. Reason: The paper gives no hardness. Quartz indents at 11 to 12 GPa (Broz,
# Cook & Whitney 2006, Am. Mineral. 91:135), and quartzite as a whole is crushed at 150 to 300 MPa.
# The strength of an element as small as a scan's point lies in between.

_UNITS = {
    "friction": "1",
    "tangential ratio": "1",
    "mean traction": "MPa",
    "slip share": "1",
    "tangential displacement": "um",
    "pressure cap": "MPa",
    "displacement": "um",
    "contact fraction": "1",
    "peak pressure": "MPa",
    "share at the cap": "1",
    "deepest yield": "um",
}
# Unit and long name of each quantity of a case.
_VARIABLES = VARIABLES | {
    "gap": ("mm", "gap between the bodies, or minus the depth of yield"),
    "capped_fraction": ("1", "share of the contact at the cap"),
    "pressure_cap": ("MPa", "cap on the pressure"),
    "traction": ("MPa", "tangential traction along the load"),
    "stick": ("1", "in contact, sticking"),
    "slip": ("1", "in contact, slipping"),
    "tangential_displacement": (
        "mm",
        "relative tangential displacement of the far fields",
    ),
}


def solve_slip(
    contact: Contact,
    *,
    friction: float,
    tangential_ratio: float,
    poisson: float,
    source: str | Path = "patch",
) -> xr.Dataset:
    """Stick and slip of a solved contact under a tangential load. Its normal part does not change.

    A tangential force Q grows at constant normal force P, with Coulomb friction μ. The tractions
    are q = μ [p(P) − p(P₀)], P₀ = P − Q/μ: full friction minus the friction of the contact under
    the reduced load. This smaller contact sticks, and the rest slips.

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
        ``traction`` (y, x) MPa, along the load. ``stick``, ``slip`` (y, x) bool, which together are
        the contact. ``tangential_displacement`` mm.

    Raises
    ------
    InputError
        The solver gives up.
    ContactInputError
        A number is outside its range.

    References
    ----------
    M. Ciavarella, Int. J. Solids Struct. 35 (1998) 2349; J. Jäger, Arch. Appl. Mech. 68 (1998) 247.
    The tangential over the normal compliance: K. L. Johnson, *Contact Mechanics* (1985), §7.2.

    Examples
    --------
    >>> import gstlib, numpy as np
    >>> y, x = np.mgrid[-1:1:40j, -1:1:40j]
    >>> sphere = gstlib.Interface.on_flat(gstlib.make_surface(-(x**2 + y**2) / 2, 2 / 39))
    >>> press = {"modulus": 1e3, "tolerance": 1e-8}
    >>> contact = gstlib.contact.contact_at_pressure(sphere, gstlib.Load(5.0), **press)
    >>> slip = gstlib.solve_slip(contact, friction=0.4, tangential_ratio=0.5, poisson=0.3)
    >>> round(float(slip.traction.mean()), 6), int(slip.stick.sum()), int(slip.slip.sum())
    (1.0, 52, 28)
    """
    friction = checked_number("friction", friction, "dimensionless", positive=True)
    poisson = checked_poisson("poisson", poisson)
    remaining = 1 - checked_fraction("tangential_ratio", tangential_ratio)
    pressure = contact.pressure
    reduced = solve_again(
        contact,
        source,
        mean_pressure=remaining * contact.mean_pressure,
        initial_pressure=remaining * pressure.values,
    )
    stick = reduced.contact & (pressure > 0)
    compliance_ratio = (2 - poisson) / (2 * (1 - poisson))
    descent = contact.displacement - reduced.displacement
    fields = {
        "traction": friction * (pressure - reduced.pressure),
        "stick": stick,
        "slip": (pressure > 0) & ~stick,
        "tangential_displacement": friction * compliance_ratio * descent,
    }
    return described(xr.Dataset(fields), _VARIABLES)


def solve_capped(
    contact: Contact, *, pressure_cap: float, source: str | Path = "patch"
) -> xr.Dataset:
    """A solved contact solved again with a cap on its pressure, at the same mean pressure.

    In an elastic solution, pressures at the summits far exceed the strength of any stone. The
    contact with p ≤ H shows how much of the prediction depends on them.

    `pressure_cap` is the largest pressure of an element. The rest is as in `solve_slip`.

    Returns
    -------
    xarray.Dataset
        ``pressure`` (y, x) MPa. ``gap`` (y, x) mm; at the cap, it is minus the depth of the yield.
        ``displacement`` mm, ``capped_fraction`` (of the contact), ``residual`` and ``pressure_cap``
        MPa.

    Examples
    --------
    >>> import gstlib, numpy as np
    >>> y, x = np.mgrid[-1:1:40j, -1:1:40j]
    >>> sphere = gstlib.Interface.on_flat(gstlib.make_surface(-(x**2 + y**2) / 2, 2 / 39))
    >>> press = {"modulus": 1e3, "tolerance": 1e-8}
    >>> contact = gstlib.contact.contact_at_pressure(sphere, gstlib.Load(5.0), **press)
    >>> limited = gstlib.solve_capped(contact, pressure_cap=100.0)
    >>> float(limited.pressure.max()), round(float(limited.pressure.mean()), 6)
    (100.0, 5.0)
    """
    mean_pressure = contact.load.mean_pressure
    state = solve_again(
        contact, source, mean_pressure=mean_pressure, pressure_cap=pressure_cap
    )
    fields = {
        "displacement": state.displacement,
        "capped_fraction": state.capped_fraction,
        "residual": state.residual,
        "pressure_cap": state.pressure_cap,
        "pressure": contact.pressure.copy(data=state.pressure),
        "gap": contact.pressure.copy(data=state.gap),
    }
    return described(xr.Dataset(fields), _VARIABLES)


def case_table(
    contacts: Mapping[str, Contact],
    *,
    grinding: Mapping[str, float] | None,
    pressure_cap: float | None,
) -> pd.DataFrame:
    """The table ``cases.csv``: the patches case by case, the study's own first.

    Parameters
    ----------
    contacts : mapping of str to Contact
        The contacts of the patches in the study. Each is looked up once.
    grinding : mapping, optional
        The arguments ``friction``, ``tangential_ratio`` and ``poisson`` of `solve_slip`. If it is
        None, the case is left out.
    pressure_cap : float, optional
        The cap of `solve_capped`, likewise. A patch with a larger mean pressure is left out, with a
        warning.

    Returns
    -------
    pandas.DataFrame
        ``case, patch, quantity, unit, value``. ``patch`` is empty if a row describes all patches.
    """
    # In the order of the table, by patch; the first is the study itself.
    cases: dict[str, dict] = {"study": {}, "grinding": {}, "cap": {}}
    if grinding is not None:
        friction, ratio = grinding["friction"], grinding["tangential_ratio"]
        cases["grinding"][""] = {"friction": friction, "tangential ratio": ratio}
    if pressure_cap is not None:
        cases["cap"][""] = {"pressure cap": pressure_cap}
    for patch, contact in contacts.items():
        source = f"patch {patch}"
        if grinding is not None:
            slip = solve_slip(contact, source=source, **grinding)
            cases["grinding"][patch] = slip_numbers(slip)
        if pressure_cap is None:
            continue
        mean = contact.load.mean_pressure
        if mean >= pressure_cap * contact.interface.covered:
            _log.warning(
                "patch %s: its mean pressure is %.4g MPa, so it cannot be solved with "
                "pressure_cap_MPa of %g MPa. Raise the cap, or set it to null",
                patch,
                mean,
                pressure_cap,
            )
            continue
        limited = solve_capped(contact, source=source, pressure_cap=pressure_cap)
        numbers = capped_numbers(contact, limited)
        cases["study"][patch], cases["cap"][patch] = numbers
    rows = [
        (case, patch, quantity, _UNITS[quantity], float(value))
        for case, patches in cases.items()
        for patch, numbers in patches.items()
        for quantity, value in numbers.items()
    ]
    return pd.DataFrame(rows, columns=["case", "patch", "quantity", "unit", "value"])


def slip_numbers(slip: xr.Dataset) -> dict[str, float]:
    """One patch under a grinding force, from `solve_slip`, by quantity.

    The rest of the contact sticks. If the patch has no contact, the share that slips is NaN.
    """
    slipping = int(slip.slip.sum())
    touching = slipping + int(slip.stick.sum())
    return {
        "mean traction": float(slip.traction.values.mean()),
        "slip share": slipping / touching if touching else math.nan,
        "tangential displacement": float(slip.tangential_displacement) * 1e3,
    }


def capped_numbers(
    contact: Contact, limited: xr.Dataset
) -> tuple[dict[str, float], dict[str, float]]:
    """One patch without and with a cap on its pressure, from its contact and `solve_capped`.

    If the patch has no contact, the share at the cap is 0.
    """
    at_cap = limited.pressure.values >= float(limited.pressure_cap)
    elastic, plastic = (
        {
            "displacement": float(state.displacement) * 1e3,
            "contact fraction": float((state.pressure > 0).mean()),
        }
        for state in (contact, limited)
    )
    elastic["peak pressure"] = float(contact.pressure.max())
    plastic["share at the cap"] = float(limited.capped_fraction)
    deepest = np.max(-limited.gap.values[at_cap], initial=0.0)
    plastic["deepest yield"] = float(deepest) * 1e3
    return elastic, plastic
