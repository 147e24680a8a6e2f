"""Intervals of each patch's pressure: the square pressed many times, each time slightly perturbed.

In each draw the mesh errs by what its vertices mispredict of each other, every patch lies a little
elsewhere, the detail between the scans is drawn anew, and so are the elastic constants. The
pressures of all draws together are what the measurements allow. The error of summing macroscale
forces in place of forces at the scans' resolution is small beside them (docs/two_scales.md).
"""

# ASSUME: errors of place are normal, alike along both axes and independent from patch to patch; a
# patch that would leave the square stays at its edge.
# ASSUME: Young's moduli of both stones vary independently (lognormal), and so do their Poisson's
# ratios (normal); which of the two readings of E* is right is not drawn.

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem import contact_modulus
from gstlib.composite import compose_grid, draw_mesh_errors, plane_under
from gstlib.contact import contact_at_pressure, faces_of
from gstlib.counterface import face_in_pose, face_of
from gstlib.coupling import Place, moved, patch_pressures, places_of, spline_of
from gstlib.preprocess.leveling import remove_plane

__all__ = ["draw_contact_moduli", "pressure_intervals"]

_DRAWS = 100
_PERCENTILES = (2.5, 97.5)
# Of the contact in a draw; the printed digits of an interval depend on it no more.
_TOLERANCE = 1e-7


def draw_contact_moduli(
    material: Mapping[str, float],
    *,
    young_share: float,
    poisson: float,
    generator: np.random.Generator,
    draws: int = _DRAWS,
) -> np.ndarray:
    """Contact moduli (draws,) that the stones may have, over that of their nominal constants.

    `material` has ``young_1_MPa, poisson_1, young_2_MPa, poisson_2``; `young_share` is the standard
    deviation of the logarithm of each Young's modulus, `poisson` that of each Poisson's ratio.
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


def pressure_intervals(
    surface: xr.Dataset,
    composite: xr.Dataset | None,
    pressures: pd.DataFrame,
    shares: np.ndarray,
    *,
    patch_mm: float,
    placement_um: float,
    pose_um: float,
    contact_modulus_MPa: float,
    target_pressure_MPa: float,
    seed: int,
    source: str | Path = "macroscale",
) -> pd.DataFrame:
    """95 % intervals of each patch's pressure.

    Parameters
    ----------
    surface : xarray.Dataset
        The mesh's surface, from `gstlib.study.grid_macroscale`.
    composite : xarray.Dataset, optional
        From `gstlib.composite.compose_surface`; without it the mesh alone is pressed.
    pressures : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg, pressure_MPa``.
    shares : (draws,) ndarray
        Contact moduli over the study's own.
    patch_mm : float
        Side of a patch.
    placement_um : float
        Standard deviation of a patch's place along each axis.
    pose_um : float
        That of the place of a second stone, where there is one.
    contact_modulus_MPa, target_pressure_MPa, source
        As in `gstlib.contact.contact_at_pressure`.
    seed : int

    Returns
    -------
    pandas.DataFrame
        ``patch, pressure_MPa, low_MPa, high_MPa``; with a composite also ``tilt_mrad``,
        ``tilt_error_mrad`` and ``plane``, "mesh" or, where it is not known, "levelled".
    """
    errors = draw_mesh_errors(surface, len(shares), np.random.default_rng([seed, 2]))
    drawn = []
    for draw, (share, error) in enumerate(zip(shares, errors, strict=True)):
        generator = np.random.default_rng([seed, 1, draw])
        shifts = placement_um * 1e-3 * generator.standard_normal((2, len(pressures)))
        height, places = surface.height + error, moved(pressures, shifts, surface, patch_mm)
        if composite is not None:
            spline, at = spline_of(height), places_of(places).values()
            planes = [plane_under(spline, place, patch_mm) for place in at]
            laid = zip(at, planes, composite.scan.values, strict=True)
            # the generator goes on: another detail in each draw
            height = compose_grid(height, laid, patch_mm, composite.density, generator)
        square = surface.assign(height=remove_plane(height)[0])
        if "face" in surface:
            y, x = pose_um * 1e-3 * np.random.default_rng([seed, 4, draw]).standard_normal(2)
            over = face_in_pose(face_of(surface), surface.height, Place(y, x, 0.0))
            square = square.assign(counterface=over)
        contact = contact_at_pressure(
            faces_of(square),
            source=source,
            contact_modulus_MPa=float(share) * contact_modulus_MPa,
            target_pressure_MPa=target_pressure_MPa,
            tolerance=_TOLERANCE,
        )
        drawn.append(patch_pressures(contact.pressure, places, size_mm=patch_mm).pressure_MPa)
    low, high = np.percentile(drawn, _PERCENTILES, axis=0)
    table = pressures[["patch", "pressure_MPa"]].assign(low_MPa=low, high_MPa=high)
    if composite is None:
        return table
    return table.assign(
        tilt_mrad=composite.tilt_mrad.values,
        tilt_error_mrad=composite.tilt_error_mrad.values,
        plane=np.where(composite.known.values, "mesh", "levelled"),
    )
