"""Intervals of each patch's pressure, from many contacts of a slightly perturbed stone.

Each draw varies the heights of the mesh by the errors with which its vertices predict each other.
It also varies the positions of all patches, the detail between the scans and the elastic constants.
Force, load point and radius of the active tool vary, too. The stone comes to equilibrium again. The
pressures of all draws show the range that the measurements allow. Draws use elements twice as long
as the study's. The error of summing macroscale forces instead of forces at the scans' resolution is
small beside these intervals (docs/explanation/evidence.md).
"""

# ASSUME: Errors of position. Position errors are normal, alike along both axes and independent
# between patches, and no patch leaves the face. The common error of patches positioned on one map
# is not drawn separately. Reason: Each interval concerns one patch, and has the same width either
# way.
# ASSUME: Errors of load point, force and radius. The load point errs normally, alike along both
# axes, but only to places with stone below it. Force and radius err lognormally. Reason: Without
# stone below the load point, the tool would tip over in the hand.
# ASSUME: Intervals under an inferred load case. Load point, strikes and radius are drawn from the
# posterior, and a stronger force goes with a smaller radius. Reason: The radius is inferred for the
# force and the modulus of the config, because the wear depends on F R / E*.
# ASSUME: Errors of elastic constants. Young's moduli of both stones vary independently (lognormal),
# and so do their Poisson's ratios (normal). The two readings of E* are not drawn. Reason: The
# reading of E* is a definition, not a measurement.

import logging
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem.halfspace import contact_modulus
from gstlib.conditions import study_modulus
from gstlib.contact import Interface, Load
from gstlib.coupling.pressures import patch_pressures
from gstlib.macroscale.active_tool import as_round_as, face_in_pose
from gstlib.macroscale.composite import compose_grid, draw_mesh_errors, plane_under
from gstlib.macroscale.ensemble import Case, press_each
from gstlib.surfaces.footprints import PatchPosition, moved, places_of, spline_of
from gstlib.surfaces.grid import coarser
from gstlib.surfaces.leveling import remove_plane

__all__ = [
    "Errors",
    "Macroscale",
    "draw_contact_moduli",
    "draw_point",
    "pressure_intervals",
]

_log = logging.getLogger(__name__)

_DRAWS = 200
# Largest number of draws of a load point until there is stone below it.
_TRIES = 100
_PERCENTILES = (2.5, 97.5)
# Tolerance of the contacts in the draws. A smaller one does not change the printed digits.
_TOLERANCE = 1e-7
_COARSER = 2


class Errors(NamedTuple):
    """Standard errors of the inputs of a study, as in the section ``uncertainty`` of the config.

    Attributes
    ----------
    young_log_sd : float
        Standard error of the logarithm of each Young's modulus.
    poisson : float
        Standard error of each Poisson's ratio.
    placement_um : float
        Standard error of the position of a patch along each axis.
    pose_um : float
        Standard error of the position of an active tool.
    load_point_mm : float
        Standard error of the load point along each axis.
    radius_log_sd : float
        Standard error of the logarithm of the radius of the active tool.
    force_log_sd : float
        Standard error of the logarithm of the force.
    """

    young_log_sd: float
    poisson: float
    placement_um: float
    pose_um: float
    load_point_mm: float
    radius_log_sd: float
    force_log_sd: float


class Macroscale(NamedTuple):
    """Surfaces of the macroscale contact, and the load case.

    Attributes
    ----------
    face : xarray.Dataset
        The surface of the mesh, from `gstlib.macroscale.face.grid_macroscale`.
    composite : xarray.Dataset or None
        From `gstlib.macroscale.composite.compose_surface`; None if the mesh is pressed alone.
    counterface : (y, x) xarray.DataArray or None
        Active tool from `gstlib.macroscale.active_tool.grid_counterface`; None without one.
    radius_mm : float or None
        Radius of a round active tool (geometric mean of two radii).
    use : xarray.Dataset or None
        Posterior of load point and radius, from `gstlib.use.infer.infer_use`. Without it, they come
        from the config.
    """

    face: xr.Dataset
    composite: xr.Dataset | None
    counterface: xr.DataArray | None
    radius_mm: float | None = None
    use: xr.Dataset | None = None

    def with_scans(
        self,
        height: xr.DataArray,
        patches: pd.DataFrame,
        generator: np.random.Generator,
    ) -> xr.DataArray:
        """A surface with the scans, if there are any, and other detail between them."""
        composite = self.composite
        if composite is None:
            return height
        patch_mm = float(composite.patch_mm)
        spline, places = spline_of(height), places_of(patches).values()
        planes = [plane_under(spline, place, patch_mm) for place in places]
        laid = zip(places, planes, composite.scan.values, strict=True)
        return compose_grid(height, laid, patch_mm, composite.density, generator)

    def tool(
        self,
        height: xr.DataArray,
        radius_mm: float | None,
        pose_um: float,
        generator: np.random.Generator,
    ) -> xr.DataArray:
        """The active tool over `height`, with an error of its position if it is a mesh."""
        if self.counterface is not None:
            pose = PatchPosition(*(pose_um * 1e-3 * generator.standard_normal(2)))
            size_mm = float(self.face.size_mm)
            return face_in_pose(self.counterface, height, pose, size_mm=size_mm)
        over = coarser(self.face.counterface, _COARSER)
        if radius_mm is None or self.radius_mm is None:
            return over
        return as_round_as(over, self.radius_mm, radius_mm)

    def likely_uses(
        self, draws: int, generator: np.random.Generator
    ) -> list[xr.Dataset | None]:
        """Draws from the posterior of the load case; None if nothing was inferred."""
        use = self.use
        if use is None or not use.attrs["adopted"]:
            return [None] * draws
        chosen = generator.choice(use.sizes["draw"], draws, p=use.weight.values)
        return [use.isel(draw=one) for one in chosen]


def draw_contact_moduli(
    material: Mapping[str, float],
    errors: Errors,
    *,
    generator: np.random.Generator,
    draws: int = _DRAWS,
) -> np.ndarray:
    """Possible contact moduli (draws,) of the stones, over the modulus of their nominal constants.

    `material` has ``young_1_MPa, poisson_1, young_2_MPa, poisson_2``.
    """
    drawn = []
    for stone in (1, 2):
        young, ratio = material[f"young_{stone}_MPa"], material[f"poisson_{stone}"]
        # The first is the nominal stone.
        normal = np.zeros((2, 1 + draws))
        normal[:, 1:] = generator.standard_normal((2, draws))
        ratios = ratio + errors.poisson * normal[1]
        drawn.append(young * np.exp(errors.young_log_sd * normal[0]))
        # Real stones are neither auxetic nor above the ratio of an incompressible body.
        drawn.append(np.clip(ratios, min(0.0, ratio), max(0.5, ratio)))
    nominal, *moduli = map(contact_modulus, *drawn)
    return np.array(moduli) / nominal


def draw_point(
    surface: xr.DataArray,
    load_point: tuple[float, float],
    error_mm: float,
    generator: np.random.Generator,
) -> tuple[float, float]:
    """Draw a load point (y, x), mm, on a surface, about a given point.

    `error_mm` is the standard deviation along each axis. The first draw with stone below it counts.
    """
    points = load_point + error_mm * generator.standard_normal((_TRIES, 2))
    y, x = xr.DataArray(points.T, dims=("axis", "try"))
    under = surface.interp(y=y, x=x, method="nearest")
    y_mm, x_mm = points[np.isfinite(under.values).argmax()].tolist()
    return y_mm, x_mm


def pressure_intervals(
    macroscale: Macroscale,
    pressures: pd.DataFrame,
    material: Mapping[str, float],
    errors: Errors,
    *,
    force_N: float,
    load_point: tuple[float, float] | None,
    patch_mm: float,
    seed: int,
) -> pd.DataFrame:
    """95 % intervals of each patch's pressure, and the error of its plane on the mesh.

    Parameters
    ----------
    macroscale : Macroscale
    pressures : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg, pressure_MPa``.
    material : mapping
        The elastic constants of both stones, and the contact modulus, as in
        `gstlib.conditions.study_modulus`.
    errors : Errors
    force_N : float
        Force on the face.
    load_point : (float, float) or None
        Load point (y, x), mm, of a stone that is free to tilt. None for the square alone on its
        mean plane.
    patch_mm : float
        Side of a patch, mm.
    seed : int

    Returns
    -------
    pandas.DataFrame
        ``patch, pressure_MPa, low_MPa, high_MPa``. With a composite, also ``tilt_mrad``,
        ``tilt_error_mrad`` and ``plane``, "mesh" or, if the plane is not known, "levelled".

    Examples
    --------
    A flat stone carries 50 MPa everywhere, as certainly as the force is known. The draws take two
    seconds:

    >>> import gstlib
    >>> flat = gstlib.make_surface(np.zeros((4, 4)), 0.5)
    >>> vertices = {"vertex_y": [0, 0, 2], "vertex_x": [0, 2, 0], "left_out_error": [0, 0, 0]}
    >>> face = xr.Dataset({name: ("vertex", values) for name, values in vertices.items()})
    >>> face = face.assign(height=flat, counterface=flat, size_mm=2.0)
    >>> place = {"patch": ["1"], "x_mm": 1.0, "y_mm": 1.0, "rotation_deg": 0.0}
    >>> patches = pd.DataFrame(place).assign(pressure_MPa=50.0)
    >>> stones = {"young_1_MPa": 2e4, "poisson_1": 0.2, "young_2_MPa": 2e4, "poisson_2": 0.2}
    >>> gstlib.pressure_intervals(  # doctest: +SKIP
    ...     Macroscale(face, None, None), patches, stones | {"contact_modulus_MPa": 1e4},
    ...     Errors(0, 0, 0, 0, 0, 0, force_log_sd=0.1),
    ...     force_N=200.0, load_point=None, patch_mm=0.5, seed=1,
    ... ).high_MPa.round()[0]
    60.0
    """
    modulus = study_modulus(material)
    generator = np.random.default_rng(seed)
    moduli = modulus * draw_contact_moduli(material, errors, generator=generator)
    count = len(moduli)
    normal = np.random.default_rng([seed, 3]).standard_normal(count)
    forces_N = force_N * np.exp(errors.force_log_sd * normal)
    mesh = coarser(macroscale.face.height, _COARSER)
    of_vertices = np.random.default_rng([seed, 2])
    mesh_errors = draw_mesh_errors(macroscale.face, mesh, count, of_vertices)
    uses = macroscale.likely_uses(count, np.random.default_rng([seed, 5]))
    generators = [np.random.default_rng([seed, 1, draw]) for draw in range(count)]
    places = []
    for generator in generators:
        shifts = generator.standard_normal((2, len(pressures)))
        x, y = errors.placement_um * 1e-3 * shifts  # drawn along x first
        places.append(moved(pressures, (y, x), mesh, patch_mm))

    def case(draw: int) -> Case:
        # The generator continues, so each draw has another detail.
        drawn = mesh + mesh_errors[draw], places[draw], generators[draw]
        height = macroscale.with_scans(*drawn)
        pose = np.random.default_rng([seed, 4, draw])
        point, radius_mm = None, macroscale.radius_mm
        if load_point is None:
            height = remove_plane(height)[0]
        elif (use := uses[draw]) is None:
            # Drawn first, so that the point is the same with and without an active tool.
            point = draw_point(mesh, load_point, errors.load_point_mm, pose)
            if radius_mm is not None:
                radius_mm *= np.exp(errors.radius_log_sd * pose.standard_normal())
        else:
            point = float(use.y_mm), float(use.x_mm)
            # The wear depends on F R / E* only, and may not give a radius.
            if not np.isnan(use.radius_mm):
                stiffer = moduli[draw] / modulus * force_N / forces_N[draw]
                radius_mm = float(use.radius_mm * stiffer)
        over = macroscale.tool(mesh, radius_mm, errors.pose_um, pose)
        load = Load.of_force(float(forces_N[draw]), height, point)
        return Case(Interface(height, over), load, float(moduli[draw]))

    cases = map(case, range(count))
    contacts = press_each(cases, tolerance=_TOLERANCE, source="macroscale")
    drawn = [
        _over_strikes(patch_pressures(contact.pressure, at, size_mm=patch_mm), use)
        for contact, at, use in zip(contacts, places, uses, strict=True)
        if contact is not None
    ]
    if len(drawn) < count:
        _log.warning(
            "in %d of %d draws the stone does not rest, so the pressure intervals omit these "
            "draws. Check load.at_mm and the standard errors in uncertainty",
            count - len(drawn),
            count,
        )
    none = np.full((1, len(pressures)), np.nan)
    low, high = np.percentile(drawn or none, _PERCENTILES, axis=0)
    table = pressures[["patch", "pressure_MPa"]].assign(low_MPa=low, high_MPa=high)
    composite = macroscale.composite
    if composite is not None:
        for name in ("tilt_mrad", "tilt_error_mrad"):
            table[name] = composite[name].values
        table["plane"] = np.where(composite.known, "mesh", "levelled")
    return table


def _over_strikes(pressures: pd.DataFrame, use: xr.Dataset | None) -> np.ndarray:
    """Mean pressures (patches,), MPa, over the strikes, from pressures under their centre."""
    if use is None:
        return pressures.pressure_MPa.to_numpy()
    added = (use.pressure - use.pressure_at_centre).to_series()
    over = pressures.pressure_MPa + pressures.patch.map(added).fillna(0.0)
    return over.to_numpy().clip(0.0)
