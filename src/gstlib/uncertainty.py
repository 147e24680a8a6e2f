"""Intervals of each patch's pressure, from the errors of its place and of the elastic constants.

Places and constants are drawn, and the pressure of each patch is computed again for each draw. No
draw needs a contact solution of its own: at a given mean pressure the contact depends on one
number, the contact modulus, so a few solutions over its range are interpolated.
"""

# ASSUME: errors of place are normal, alike along both axes and independent from patch to patch; a
# patch that would leave the square stays at its edge.
# ASSUME: Young's moduli of both stones vary independently (lognormal), and so do their Poisson's
# ratios (normal); which of the two readings of E* is right is not drawn.

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.ndimage import map_coordinates

from gstlib.bem import contact_modulus
from gstlib.contact import contact_at_pressure
from gstlib.coupling import footprint_weights, half_extent
from gstlib.surface import spacing_of

__all__ = ["draw_contact_moduli", "pressure_intervals", "pressures_of_moduli"]

# The ends of a 95 % interval then rest on the 50 most extreme draws at each side.
_DRAWS = 2000
# Pressures are interpolated between so many contact moduli and the study's own: on the default
# study within 0.12 MPa of a solution at the modulus itself ...
_MODULI = 8
# ... and between places that are this share of an element apart.
_PART = 0.5
_PERCENTILES = (2.5, 97.5)


def draw_contact_moduli(
    material: Mapping[str, float],
    *,
    young_share: float,
    poisson: float,
    generator: np.random.Generator,
    draws: int = _DRAWS,
) -> np.ndarray:
    """Contact moduli that the stones may have, relative to that of their nominal constants.

    Parameters
    ----------
    material : mapping
        ``young_1_MPa, poisson_1, young_2_MPa, poisson_2``.
    young_share : float
        Standard deviation of the logarithm of each Young's modulus.
    poisson : float
        Standard deviation of each Poisson's ratio.
    generator : numpy.random.Generator
    draws : int

    Returns
    -------
    (draws,) ndarray
        Dimensionless.
    """
    nominal, drawn = [], []
    for stone in (1, 2):
        young, ratio = material[f"young_{stone}_MPa"], material[f"poisson_{stone}"]
        nominal += [young, ratio]
        drawn.append(young * np.exp(young_share * generator.standard_normal(draws)))
        ratios = ratio + poisson * generator.standard_normal(draws)
        # no stone is auxetic, nor above the ratio of the incompressible
        drawn.append(np.clip(ratios, min(0.0, ratio), max(0.5, ratio)))
    moduli = [contact_modulus(*constants) for constants in zip(*drawn, strict=True)]
    return np.array(moduli) / contact_modulus(*nominal)


def pressures_of_moduli(
    height: xr.DataArray,
    pressure: xr.DataArray,
    shares: np.ndarray,
    *,
    contact_modulus_MPa: float,
    **settings: Any,
) -> xr.DataArray:
    """Contact pressure of the square for a few contact moduli that span those drawn.

    Parameters
    ----------
    height, pressure : (ny, nx) xarray.DataArray
        Heights (mm), and the pressure (MPa) at the target with the study's own modulus.
    shares : (draws,) ndarray
        Contact moduli over the study's own.
    contact_modulus_MPa, **settings
        As in `gstlib.contact.contact_at_pressure`: ``source, target_pressure_MPa, tolerance``.

    Returns
    -------
    (share, y, x) xarray.DataArray
        Pressure (MPa), with the modulus over the study's own as the rising coordinate ``share``.
        Where the moduli do not vary, the given pressure alone, at 1.
    """
    solved = {1.0: pressure.values}
    low, high = float(shares.min()), float(shares.max())
    if high > low:
        for share in np.geomspace(low, high, _MODULI):
            solved[float(share)] = contact_at_pressure(
                height, contact_modulus_MPa=share * contact_modulus_MPa, **settings
            ).pressure.values
    at = sorted(solved)
    return xr.DataArray(
        [solved[share] for share in at],
        dims=("share", "y", "x"),
        coords={"share": at, "y": height.y, "x": height.x},
    )


def pressure_intervals(
    patches: pd.DataFrame,
    pressures: xr.DataArray,
    shares: np.ndarray,
    *,
    size_mm: float,
    placement_um: float,
    generator_of: Callable[[str], np.random.Generator],
) -> pd.DataFrame:
    """95 % intervals of each patch's pressure: from its place, from the stones, and from both.

    Parameters
    ----------
    patches : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg, pressure_MPa``.
    pressures : (share, y, x) xarray.DataArray
        From `pressures_of_moduli`.
    shares : (draws,) ndarray
        Contact moduli over the study's own; all patches have the same stones.
    size_mm : float
        Side of a patch.
    placement_um : float
        Standard deviation of a patch's place along each axis.
    generator_of : callable
        Gives the random generator of a patch's place, by the patch's name.

    Returns
    -------
    pandas.DataFrame
        ``patch, pressure_MPa, low_MPa, high_MPa, placement_low_MPa, placement_high_MPa,
        material_low_MPa, material_high_MPa``.
    """
    spacing = np.array(spacing_of(pressures))
    step, nodes = _PART * spacing, pressures.share.values
    # weight (nodes, draws) of each solution: linear in the logarithm of the modulus
    unit = np.eye(len(nodes))
    drawn = np.array([np.interp(np.log(shares), np.log(nodes), one) for one in unit])
    rows = []
    for patch in patches.itertuples(index=False):
        stated, half = np.array([patch.y_mm, patch.x_mm]), half_extent(size_mm, patch.rotation_deg)
        shifts = placement_um * 1e-3 * generator_of(patch.patch).standard_normal((len(shares), 2))
        places = np.clip(stated + shifts, half, spacing * pressures.shape[1:] - half)
        # in steps from the stated place, which comes last
        at = np.vstack([(places - stated) / step, np.zeros(2)])
        first = np.floor(at.min(axis=0)).astype(int)
        lattice = np.empty((len(nodes), *(np.ceil(at.max(axis=0)).astype(int) - first + 1)))
        for i, j in np.ndindex(lattice.shape[1:]):
            y, x = stated + step * (first + np.array([i, j]))
            weights = footprint_weights(pressures, x, y, size_mm, patch.rotation_deg)
            lattice[:, i, j] = (pressures.values * weights).sum(axis=(1, 2))
        lattice *= spacing.prod() / size_mm**2
        by_place = np.array([map_coordinates(field, (at - first).T, order=1) for field in lattice])
        moved, as_stated = by_place[:, :-1], by_place[:, -1:]
        row = {"patch": patch.patch, "pressure_MPa": patch.pressure_MPa}
        for name, draws in (
            ("", (drawn * moved).sum(axis=0)),
            ("placement_", moved[nodes == 1.0].sum(axis=0)),
            ("material_", (drawn * as_stated).sum(axis=0)),
        ):
            low, high = np.percentile(draws, _PERCENTILES)
            row |= {f"{name}low_MPa": low, f"{name}high_MPa": high}
        rows.append(row)
    return pd.DataFrame(rows)
