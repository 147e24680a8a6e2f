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
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem import contact_modulus
from gstlib.composite import compose_grid, draw_mesh_errors, plane_under
from gstlib.contact import Loading, contact_at_pressure, contact_moduli, faces_of
from gstlib.counterface import face_in_pose
from gstlib.coupling import patch_pressures
from gstlib.geometry import Place, moved, places_of, spline_of
from gstlib.preprocess.leveling import remove_plane

__all__ = ["Errors", "Macroscale", "draw_contact_moduli", "pressure_intervals"]

_DRAWS = 100
_PERCENTILES = (2.5, 97.5)
# Of the contact in a draw; the printed digits of an interval depend on it no more.
_TOLERANCE = 1e-7


class Errors(NamedTuple):
    """Standard errors of what a study is given, as in the section ``uncertainty`` of the config.

    Attributes
    ----------
    young_share : float
        Of the logarithm of each Young's modulus.
    poisson : float
        Of each Poisson's ratio.
    placement_um : float
        Of a patch's place along each axis.
    pose_um : float
        Of the place of a second stone.
    """

    young_share: float
    poisson: float
    placement_um: float
    pose_um: float


class Macroscale(NamedTuple):
    """What the macroscale is pressed with.

    Attributes
    ----------
    square : xarray.Dataset
        The mesh's surface, from `gstlib.study.grid_macroscale`.
    composite : xarray.Dataset or None
        From `gstlib.composite.compose_surface`; None where the mesh alone is pressed.
    face : (y, x) xarray.DataArray or None
        A second stone's, from `gstlib.counterface.grid_counterface`; None for a flat.
    """

    square: xr.Dataset
    composite: xr.Dataset | None
    face: xr.DataArray | None


def draw_contact_moduli(
    material: Mapping[str, float],
    errors: Errors,
    *,
    generator: np.random.Generator,
    draws: int = _DRAWS,
) -> np.ndarray:
    """Contact moduli (draws,) that the stones may have, over that of their nominal constants.

    `material` has ``young_1_MPa, poisson_1, young_2_MPa, poisson_2``.
    """
    nominal, drawn = [], []
    for stone in (1, 2):
        young, ratio = material[f"young_{stone}_MPa"], material[f"poisson_{stone}"]
        nominal += [young, ratio]
        drawn.append(young * np.exp(errors.young_share * generator.standard_normal(draws)))
        ratios = ratio + errors.poisson * generator.standard_normal(draws)
        # no stone is auxetic, nor above the ratio of the incompressible
        drawn.append(np.clip(ratios, min(0.0, ratio), max(0.5, ratio)))
    moduli = [contact_modulus(*constants) for constants in zip(*drawn, strict=True)]
    return np.array(moduli) / contact_modulus(*nominal)


def pressure_intervals(
    macroscale: Macroscale,
    pressures: pd.DataFrame,
    material: Mapping[str, float],
    errors: Errors,
    *,
    target_pressure_MPa: float,
    patch_mm: float,
    seed: int,
) -> pd.DataFrame:
    """95 % intervals of each patch's pressure, and how well the mesh knows its plane.

    Parameters
    ----------
    macroscale : Macroscale
    pressures : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg, pressure_MPa``.
    material : mapping
        The elastic constants of both stones, and the contact modulus, as in
        `gstlib.contact.contact_moduli`.
    errors : Errors
    target_pressure_MPa : float
        Mean pressure on the square.
    patch_mm : float
        Side of a patch.
    seed : int

    Returns
    -------
    pandas.DataFrame
        ``patch, pressure_MPa, low_MPa, high_MPa``; with a composite also ``tilt_mrad``,
        ``tilt_error_mrad`` and ``plane``, "mesh" or, where it is not known, "levelled".
    """
    square, composite, face = macroscale
    modulus, _ = contact_moduli(material)
    generator = np.random.default_rng(seed)
    moduli_MPa = modulus * draw_contact_moduli(material, errors, generator=generator)
    mesh_errors = draw_mesh_errors(square, len(moduli_MPa), np.random.default_rng([seed, 2]))
    drawn = []
    for draw, (modulus, mesh_error) in enumerate(zip(moduli_MPa, mesh_errors, strict=True)):
        generator = np.random.default_rng([seed, 1, draw])
        # drawn along x first
        x, y = errors.placement_um * 1e-3 * generator.standard_normal((2, len(pressures)))
        height = square.height + mesh_error
        places = moved(pressures, (y, x), square.height, patch_mm)
        if composite is not None:
            spline, at = spline_of(height), places_of(places).values()
            planes = [plane_under(spline, place, patch_mm) for place in at]
            laid = zip(at, planes, composite.scan.values, strict=True)
            # the generator goes on: another detail in each draw
            height = compose_grid(height, laid, patch_mm, composite.density, generator)
        over = square.counterface
        if face is not None:
            pose = np.random.default_rng([seed, 4, draw])
            y, x = errors.pose_um * 1e-3 * pose.standard_normal(2)
            over = face_in_pose(face, square.height, Place(y, x))
        contact = contact_at_pressure(
            faces_of(remove_plane(height)[0], over),
            Loading(float(modulus), target_pressure_MPa, _TOLERANCE),
            source="macroscale",
        )
        by_patch = patch_pressures(contact.pressure, places, size_mm=patch_mm)
        drawn.append(by_patch.pressure_MPa)
    low, high = np.percentile(drawn, _PERCENTILES, axis=0)
    table = pressures[["patch", "pressure_MPa"]].assign(low_MPa=low, high_MPa=high)
    if composite is None:
        return table
    return table.assign(
        tilt_mrad=composite.tilt_mrad.values,
        tilt_error_mrad=composite.tilt_error_mrad.values,
        plane=np.where(composite.known.values, "mesh", "levelled"),
    )
