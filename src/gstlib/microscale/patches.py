"""Each patch on its plane in the stone, pressed to its pressure at the resolution of its scan."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem.solver import solve_contact
from gstlib.contact import (
    Contact,
    ContactPath,
    Interface,
    Load,
    contact_at_pressure,
    contact_path,
    load_path_table,
)
from gstlib.coupling.embedding import place_patch, prepare_faces
from gstlib.surfaces.grid import spacing_of

__all__ = [
    "EQUILIBRIUM",
    "LOAD_PATHS",
    "PAPER",
    "Microscale",
    "microscale_tables",
    "solve_patches",
    "with_interface_stiffness",
]

# The variants of the coupling, and the pressure of a patch that each takes, from `couple_scales`.
EQUILIBRIUM, PAPER = "equilibrium", "paper"
# A residual below this is rounding.
_ROUNDING = 1e-12
_PRESSURES = {EQUILIBRIUM: "pressure_MPa", PAPER: "square_pressure_MPa"}


class Microscale(NamedTuple):
    """How the patches are pressed, as in the section ``microscale`` of the config.

    Attributes
    ----------
    contact_modulus_MPa, tolerance : float
        As in `gstlib.contact.Contact`.
    s_filter_um : float or None
        Nesting index of the S-filter that the scans pass.
    steps : int or None
        Steps of the load path of the first variant, or None for the target pressure alone.
    maximum_displacement_um : float
        As in `gstlib.contact.contact_path`.
    """

    contact_modulus_MPa: float
    tolerance: float
    s_filter_um: float | None
    steps: int | None
    maximum_displacement_um: float


def solve_patches(
    scans: Mapping[str, xr.Dataset],
    pressures: pd.DataFrame,
    settings: Microscale,
    *,
    variants: Sequence[str],
    composite: xr.Dataset | None = None,
    contact: Contact | None = None,
    counterface: xr.DataArray | None = None,
) -> Iterator[tuple[str, str, Contact | ContactPath]]:
    """Press patches up to their own pressures, in each variant of the coupling (section 2.4).

    Parameters
    ----------
    scans : mapping of str to xarray.Dataset
        The prepared T0 scans by patch. Each is looked up once.
    pressures : pandas.DataFrame
        The table from `gstlib.coupling.pressures.couple_scales`.
    settings : Microscale
    variants : sequence of str
        `PLACED`, `LEVELLED` or both, the study's own first.
    composite, contact : xarray.Dataset
        As in `gstlib.coupling.embedding.place_patch`, for `PLACED`.
    counterface : (y, x) xarray.DataArray, optional
        The prepared scan of the active tool's own face.

    Yields
    ------
    patch, variant : str
    contact : ContactPath or Contact
        If `steps` is given, the first variant has the path and the stiffness of the interface.

    Examples
    --------
    >>> import gstlib, numpy as np, pandas as pd
    >>> from gstlib.microscale.patches import Microscale
    >>> heights = 1e-3 * np.random.default_rng(1).normal(size=(16, 16))
    >>> scans = {"7": gstlib.make_surface(heights, 0.05).to_dataset(name="height")}
    >>> pressures = pd.DataFrame({"patch": ["7"], "square_pressure_MPa": [6.0]})
    >>> settings = Microscale(1e4, 1e-8, None, None, 50.0)
    >>> solved = gstlib.solve_patches(scans, pressures, settings, variants=["paper"])
    >>> [(patch, round(float(contact.pressure.mean()), 6)) for patch, _, contact in solved]
    [('7', 6.0)]
    """
    targets = pressures.set_index("patch")
    for patch in scans:
        source = f"patch {patch}"
        height, pressed = prepare_faces(
            scans[patch].height,
            counterface,
            s_filter_um=settings.s_filter_um,
            source=source,
        )
        for variant in variants:
            if variant == PAPER:
                over = xr.zeros_like(height) if pressed is None else pressed
                interface = Interface(height, over)
            elif composite is None or contact is None:
                raise ValueError("patches on the stone need `composite` and `contact`")
            else:
                interface = place_patch(height, pressed, composite, contact, patch)
            loaded = interface, Load(float(targets[_PRESSURES[variant]][patch]))
            solving: dict[str, Any] = {
                "modulus": settings.contact_modulus_MPa,
                "tolerance": settings.tolerance,
                "source": source,
            }
            if settings.steps is None or variant != variants[0]:
                yield patch, variant, contact_at_pressure(*loaded, **solving)
                continue
            solving["steps"] = settings.steps
            solving["maximum_displacement_um"] = settings.maximum_displacement_um
            path = contact_path(*loaded, **solving)
            yield patch, variant, with_interface_stiffness(path)


LOAD_PATHS = (
    "target_pressure",
    "residual",
    "path_displacement",
    "path_mean_pressure",
    "path_contact_fraction",
    "path_stiffness",
    "path_interface_stiffness",
)


def with_interface_stiffness(path: ContactPath) -> ContactPath:
    """A path with the stiffness of the rough interface alone along its path.

    A patch is cut out of the stone. Its displacement under a mean pressure has two parts: the
    displacement of the interface, and of the half-space under a load on the patch alone. The second
    part results from the compliance of a flat punch with the outline of the patch. It is computed
    with the same solver, and compliances in series add. Without contact, the stiffness is 0.
    """
    height, stiffness = path.final.interface.height, path.stiffness
    punch = _punch_stiffness(height.shape, spacing_of(height), path.final.modulus)
    alone = np.divide(
        punch * stiffness,
        punch - stiffness,
        out=np.full_like(stiffness, np.inf),
        where=stiffness < punch,
    )
    return replace(path, interface_stiffness=alone)


@lru_cache
def _punch_stiffness(
    shape: tuple[int, int], spacing: tuple[float, float], contact_modulus_MPa: float
) -> float:
    """Mean pressure over displacement, MPa/mm, of a rigid flat punch as large as the grid."""
    depth = float(np.prod(spacing)) ** 0.5
    punch = solve_contact(
        np.zeros(shape), spacing, contact_modulus_MPa, displacement=depth
    )
    return punch.mean_pressure / depth


def microscale_tables(
    contacts: Mapping[str, xr.Dataset],
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The state of each patch at its pressure, and its load path.

    `contacts` are the contacts from `solve_patches` by patch, as stored (`ContactPath.to_dataset`).
    The residual is rounded up to a power of ten, at least 1e-12, because its digits differ between
    processors.
    """
    states, paths = [], []
    for patch, contact in contacts.items():
        steps = load_path_table(contact)
        alone = contact.path_interface_stiffness.values * 1e-3
        steps["interface_stiffness_MPa_per_um"] = alone
        steps.insert(0, "patch", patch)
        paths.append(steps)
        residual = max(float(contact.residual), _ROUNDING)
        last = steps.iloc[[-1]].drop(columns="step")
        last.insert(1, "target_pressure_MPa", float(contact.target_pressure))
        last.insert(2, "mean_pressure_MPa", last.pop("mean_pressure_MPa"))
        states.append(last.assign(residual=10.0 ** math.ceil(math.log10(residual))))
    if not paths:
        return pd.DataFrame(), pd.DataFrame()
    return tuple(pd.concat(tables, ignore_index=True) for tables in (states, paths))
