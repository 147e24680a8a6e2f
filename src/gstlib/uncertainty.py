"""How sure is the pressure of a patch, given where it may lie and what the stones may be made of?

Places and elastic constants are drawn, and the pressure of each patch is taken anew for each draw.
No draw needs a contact of its own: at a given mean pressure the contact depends on one number, the
contact modulus, so that a few solutions over its range are enough to interpolate between.
"""

# ASSUME: errors of place are normal, alike along both axes and independent from patch to patch; a
# patch that would leave the square stays at its edge.
# ASSUME: Young's moduli of both stones vary independently (lognormal), and so do their Poisson's
# ratios (normal); which of the two readings of E* is right is not drawn.

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from scipy.ndimage import map_coordinates
from scipy.signal import correlate

from gstlib.bem import contact_modulus
from gstlib.contact import solve_at_pressure
from gstlib.coupling import footprint_weights
from gstlib.surface import make_surface, spacing_of

__all__ = [
    "draw_contact_moduli",
    "pressure_intervals",
    "pressures_at_shifts",
    "pressures_of_moduli",
]

# Pressures are interpolated between so many contact moduli and the study's own: on the default
# study within 0.12 MPa of a solution at the modulus itself ...
_MODULI = 8
# ... and between shifts by these parts of an element.
_PARTS = 2
# No stone is harder to compress than this ratio says, nor auxetic.
_POISSON_LIMITS = (0.0, 0.5)
_PERCENTILES = (2.5, 97.5)


def draw_contact_moduli(
    material: Mapping[str, float],
    *,
    young_share: float,
    poisson: float,
    draws: int,
    generator: np.random.Generator,
) -> np.ndarray:
    """Contact moduli that the stones may have, over the one that their constants give.

    Parameters
    ----------
    material : mapping
        ``young_1_MPa, poisson_1, young_2_MPa, poisson_2``.
    young_share : float
        Standard deviation of the logarithm of each Young's modulus: nearly that of the modulus
        over its value.
    poisson : float
        Standard deviation of each Poisson's ratio.
    draws : int
    generator : numpy.random.Generator

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
        low, high = _POISSON_LIMITS
        drawn.append(np.clip(ratios, min(low, ratio), max(high, ratio)))
    moduli = [contact_modulus(*constants) for constants in zip(*drawn, strict=True)]
    return np.array(moduli) / contact_modulus(*nominal)


def pressures_of_moduli(
    height: xr.DataArray,
    pressure: xr.DataArray,
    shares: np.ndarray,
    *,
    source: str | Path,
    contact_modulus_MPa: float,
    target_pressure_MPa: float,
    tolerance: float,
) -> xr.DataArray:
    """Contact pressure of the square for a few contact moduli that span the given ones.

    Parameters
    ----------
    height, pressure : (ny, nx) xarray.DataArray
        Heights (mm), and the pressure (MPa) at the target with the study's own modulus.
    shares : (draws,) ndarray
        Contact moduli over the study's own.
    source, contact_modulus_MPa, target_pressure_MPa, tolerance
        As in `gstlib.contact.solve_at_pressure`.

    Returns
    -------
    (share, y, x) xarray.DataArray
        Pressure (MPa), with the modulus over the study's own as the rising coordinate ``share``;
        just the given pressure, at 1, where the moduli do not vary.
    """
    solved = {1.0: pressure.values}
    low, high = float(shares.min()), float(shares.max())
    if high > low:
        for share in np.geomspace(low, high, _MODULI):
            solved[float(share)] = solve_at_pressure(
                height,
                source=source,
                contact_modulus_MPa=share * contact_modulus_MPa,
                target_pressure_MPa=target_pressure_MPa,
                tolerance=tolerance,
            )[1].values
    at = sorted(solved)
    return xr.DataArray(
        [solved[share] for share in at],
        dims=("share", "y", "x"),
        coords={"share": at, "y": height.y, "x": height.x},
    )


def pressures_at_shifts(
    pressure: xr.DataArray,
    shifts: np.ndarray,
    *,
    x_mm: float,
    y_mm: float,
    rotation_deg: float,
    size_mm: float,
) -> np.ndarray:
    """Nominal pressure of a patch that lies elsewhere than stated.

    Parameters
    ----------
    pressure : (n, ny, nx) xarray.DataArray
        Contact pressures of the square, MPa, dims (..., y, x).
    shifts : (draws, 2) ndarray
        How far the patch lies off along y and x, mm. It stays on the square.
    x_mm, y_mm, rotation_deg, size_mm : float
        The patch where it is stated to be.

    Returns
    -------
    (n, draws) ndarray
        MPa. Exact where the shift is a whole number of half elements, interpolated between.
    """
    spacing = np.array(spacing_of(pressure))
    sides = spacing * (pressure.sizes["y"], pressure.sizes["x"])
    corner = np.array([pressure.y.values[0], pressure.x.values[0]]) - spacing / 2
    angle = np.radians(rotation_deg)
    half = size_mm / 2 * (abs(np.cos(angle)) + abs(np.sin(angle)))
    centre = np.array([y_mm, x_mm]) - corner
    back, forth = np.minimum(half - centre, 0.0), np.maximum(sides - half - centre, 0.0)
    moved = np.clip(shifts, back, forth) / spacing  # in elements
    reach = int(np.ceil(np.abs(moved).max())) + 1
    # An outline moved by whole elements has the same weights: they are taken at parts of an
    # element only, and the pressures under them are shifted element by element. That part of an
    # element may lead beyond the square, and back again with the shift.
    around = np.pad(pressure.values, ((0, 0), (reach, reach + 1), (reach, reach + 1)))
    frame = make_surface(np.zeros(np.add(pressure.shape[1:], 1)), spacing, origin=corner)
    lattice = np.empty((len(around), *(_PARTS * (2 * reach + 1),) * 2))
    for i, j in np.ndindex(_PARTS, _PARTS):
        dy, dx = spacing * (i, j) / _PARTS
        weights = footprint_weights(frame, x_mm + dx, y_mm + dy, size_mm, rotation_deg)
        (y0, y1), (x0, x1) = ((at.min(), at.max() + 1) for at in weights.nonzero())
        lattice[:, i::_PARTS, j::_PARTS] = correlate(
            around[:, y0 : y1 + 2 * reach, x0 : x1 + 2 * reach],
            weights[None, y0:y1, x0:x1],
            mode="valid",
            method="direct",  # FFTs round zeros to something that prints
        )
    places = _PARTS * (moved + reach).T
    forces = [map_coordinates(by_place, places, order=1) * spacing.prod() for by_place in lattice]
    return np.array(forces) / size_mm**2


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
        The source of chance for a patch's place, by its name.

    Returns
    -------
    pandas.DataFrame
        ``patch, pressure_MPa, low_MPa, high_MPa, placement_low_MPa, placement_high_MPa,
        material_low_MPa, material_high_MPa``.
    """
    drawn = _interpolation(pressures.share.values, shares)
    nominal = _interpolation(pressures.share.values, np.ones(len(shares)))
    rows = []
    for patch in patches.itertuples(index=False):
        shifts = placement_um * 1e-3 * generator_of(patch.patch).standard_normal((len(shares), 2))
        by_place = pressures_at_shifts(
            pressures,
            np.vstack([shifts, np.zeros(2)]),
            x_mm=patch.x_mm,
            y_mm=patch.y_mm,
            rotation_deg=patch.rotation_deg,
            size_mm=size_mm,
        )
        moved, as_stated = by_place[:, :-1], by_place[:, -1:]
        row = {"patch": patch.patch, "pressure_MPa": patch.pressure_MPa}
        for name, draws in (
            ("", (drawn * moved).sum(axis=0)),
            ("placement_", (nominal * moved).sum(axis=0)),
            ("material_", (drawn * as_stated).sum(axis=0)),
        ):
            low, high = np.percentile(draws, _PERCENTILES)
            row |= {f"{name}low_MPa": low, f"{name}high_MPa": high}
        rows.append(row)
    return pd.DataFrame(rows)


def _interpolation(nodes: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Weight (nodes, points) of each node's value at the points: linear in the logarithm."""
    return np.array([np.interp(np.log(at), np.log(nodes), unit) for unit in np.eye(len(nodes))])
