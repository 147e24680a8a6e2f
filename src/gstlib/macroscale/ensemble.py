"""One stone pressed many times, with something changed each time.

Poses of a gesture change the pose. Errors drawn for an interval and candidate load cases change a
height, load point, radius or modulus. Each gives a sequence of cases. This module presses them and
takes the pressure of every patch.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.contact import Contact, Interface, Load, contact_at_pressure
from gstlib.errors import InputError
from gstlib.surfaces.footprints import area_weights, covered_areas
from gstlib.surfaces.grid import spacing_of

__all__ = ["Case", "patch_means", "press_each"]


class Case(NamedTuple):
    """One case: two faces, their load, and their contact modulus (MPa).

    The solver starts from `start`, a similar pressure (ny, nx), MPa, and converges sooner. See
    `gstlib.bem.solve_contact` for `springs` (mm/MPa).
    """

    interface: Interface
    load: Load
    modulus: float
    start: np.ndarray | None = None
    springs: float = 0.0


def press_each(
    cases: Iterable[Case], *, tolerance: float, source: str, in_order: bool = False
) -> Iterator[Contact | None]:
    """The contact of each case, one at a time; None for a case without contact.

    A case has no contact if the stone tips over, or if the contact cannot be solved.

    Parameters
    ----------
    cases : iterable of Case
        On one grid.
    tolerance : float
        As in `gstlib.contact.Contact`.
    source : str
        Name of the cases, for messages.
    in_order : bool
        Consecutive cases are similar, so each contact starts from the previous one.
    """
    start = None
    for case in cases:
        try:
            contact = contact_at_pressure(
                case.interface,
                case.load,
                modulus=case.modulus,
                tolerance=tolerance,
                source=source,
                springs=case.springs,
                initial_pressure=start if in_order else case.start,
            )
        except InputError:
            yield None
            continue
        if in_order:
            start = contact.pressure.values
        yield contact


def patch_means(
    grid: xr.DataArray, patches: pd.DataFrame, *, size_mm: float
) -> "scipy.sparse.csr_array":
    """The matrix that takes a field on a grid to its mean over each patch.

    If the position of T1 is known, the mean is over the area that T0 and T1 both cover, as for a
    measured loss. Otherwise it is over the outline of the patch.

    Parameters
    ----------
    grid : (ny, nx) xarray.DataArray
        Any field on it.
    patches : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg``, with T1 from `gstlib.surfaces.footprints.with_t1`.
    size_mm : float
        Side of a patch.

    Returns
    -------
    scipy.sparse.csr_array, shape (patches, ny · nx)
        Its product with the raveled field contains the means. Areas beyond the grid count as 0.
    """
    element_mm2 = float(np.prod(spacing_of(grid)))
    means, elements, ends = [], [], [0]
    for area in covered_areas(patches, size_mm).values():
        weights = area_weights(grid, area).ravel()
        inside = np.flatnonzero(weights)
        means.append(element_mm2 / area.area * weights[inside])
        elements.append(inside)
        ends.append(ends[-1] + len(inside))
    parts = np.concatenate([[], *means]), np.concatenate([[], *elements]).astype(int)
    return scipy.sparse.csr_array((*parts, ends), shape=(len(means), grid.size))
