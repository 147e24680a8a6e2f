"""A gesture: many poses of the active tool, and the combined effect of their contacts.

The active tool slides and turns on the passive one. A hand also scatters: its load point varies,
and with it the equilibrium of the stone. Each pose is a separate contact in equilibrium. The
results, for each element and each patch, are the mean and highest pressure, the fraction of poses
that touch it, and the exposure. The exposure is pressure times sliding, summed over the poses, as
in Archard's law. Consecutive poses are similar, so each contact starts from the previous one.
"""

# ASSUME: Poses as separate contacts. Each pose is a contact in equilibrium under its own force, and
# the load point moves and turns with the active tool. Between poses, the stones slide by the
# distance given for the pose. Reason: Archard's law needs only the pressure and the sliding
# distance of each pose.
# ASSUME: Scatter of the load point. The load point scatters normally about the given one, equally
# along both axes. The sliding distance does not depend on the load point. Reason: The config gives
# one scatter for both axes and one sliding distance.

import logging
from collections.abc import Collection, Iterable
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.contact import Interface, Load
from gstlib.macroscale.active_tool import face_in_pose
from gstlib.macroscale.ensemble import Case, patch_means, press_each
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.grid import described

__all__ = [
    "Gesture",
    "exposure",
    "exposure_table",
    "press_poses",
    "scatter_poses",
    "stroke_poses",
]

_log = logging.getLogger(__name__)

# Columns of the poses of a gesture.
_COLUMNS = [
    "x_mm",
    "y_mm",
    "rotation_deg",
    "force_N",
    "sliding_mm",
    "turning_deg",
    "weight",
]
_VARIABLES = {
    "mean_pressure": ("MPa", "mean contact pressure of the poses"),
    "pressure_sum": ("MPa", "sum of the contact pressures of the poses"),
    "touched_sum": ("1", "sum of the weights of the poses that touch"),
    "highest_pressure": ("MPa", "highest contact pressure of the poses"),
    "touched": ("1", "share of the poses that touch"),
    "exposure": ("N/mm", "contact pressure times sliding over all poses"),
    "pressure": ("MPa", "contact pressure in a pose"),
    "weight": ("1", "weight of the pose"),
    "displacement": ("mm", "far-field displacement from first touch"),
    "contact_fraction": ("1", "real over nominal contact area"),
    "patch_pressure": ("MPa", "pressure of the patch in the pose"),
    "patch_exposure": ("N/mm", "pressure of the patch times sliding in the pose"),
}


class Gesture(NamedTuple):
    """Poses of an active tool, and its face.

    Attributes
    ----------
    counterface : (ny, nx) xarray.DataArray
        If the tool is flat or rounded, it contains its heights: moving it is moving the load point.
    mesh : (my, mx) xarray.DataArray or None
        The mesh that replaces it, from `gstlib.macroscale.active_tool.grid_counterface`.
    size_mm : float
        Side of the square, about whose middle a stone turns.
    load_point : (float, float)
        Load point (y, x), mm, in the pose at (0, 0).
    poses : pandas.DataFrame
        The table from `stroke_poses` or `scatter_poses`, or one with the same columns. The index
        numbers the poses.
    """

    counterface: xr.DataArray
    mesh: xr.DataArray | None
    size_mm: float
    load_point: tuple[float, float]
    poses: pd.DataFrame

    def case(self, height: xr.DataArray, pose: Any, modulus: float) -> Case:
        """The case that is pressed in a pose, a row of `poses`."""
        place = PatchPosition(pose.y_mm, pose.x_mm, pose.rotation_deg)
        middle = self.size_mm / 2
        tool = place._replace(y_mm=middle + place.y_mm, x_mm=middle + place.x_mm)
        at = tool.points(*(along - middle for along in self.load_point))
        load = Load.of_force(pose.force_N, height, at)
        over = self.counterface
        if self.mesh is not None:
            over = face_in_pose(self.mesh, height, place, size_mm=self.size_mm)
        return Case(Interface(height, over), load, modulus)


def stroke_poses(*, stroke_mm: float, poses: int, force_N: float) -> pd.DataFrame:
    """The poses of a stroke along x, with its middle at the pose of the active tool.

    Parameters
    ----------
    stroke_mm : float
        Its length.
    poses : int
        Their number, in even steps.
    force_N : float
        Force in every pose.

    Returns
    -------
    pandas.DataFrame
        ``x_mm, y_mm``: shift of the active tool along the square's axes. ``rotation_deg``: its
        rotation about the middle of the square, from x towards y. ``force_N``. ``sliding_mm`` and
        ``turning_deg``: its sliding and rotation in the pose. ``weight``.

    Examples
    --------
    >>> poses = stroke_poses(stroke_mm=1.0, poses=5, force_N=80.0)
    >>> poses.x_mm.tolist(), round(float(poses.sliding_mm.sum()), 9)
    ([-0.5, -0.25, 0.0, 0.25, 0.5], 1.0)
    """
    table = pd.DataFrame(0.0, index=range(poses), columns=_COLUMNS)
    return table.assign(
        x_mm=stroke_mm * (np.linspace(-0.5, 0.5, poses) if poses > 1 else 0.0),
        force_N=force_N,
        sliding_mm=stroke_mm / poses,
        weight=1.0,
    )


def scatter_poses(
    *, load_point_scatter_mm: float, poses: int, force_N: float, seed: int
) -> pd.DataFrame:
    """The poses of a load point that scatters, a load point each, as from `stroke_poses`.

    `load_point_scatter_mm` is the standard deviation of the point along each axis. Every pose
    slides by 1 mm, so that exposures are for so many mm of sliding as there are poses.
    """
    y, x = load_point_scatter_mm * np.random.default_rng([seed, 5]).standard_normal(
        (2, poses)
    )
    table = pd.DataFrame(0.0, index=range(poses), columns=_COLUMNS)
    # neighbours follow each other, and start from each other's contact
    order = np.argsort(np.arctan2(y, x))
    return table.assign(
        x_mm=x[order], y_mm=y[order], force_N=force_N, sliding_mm=1.0, weight=1.0
    )


def press_poses(
    height: xr.DataArray,
    gesture: Gesture,
    patches: pd.DataFrame,
    *,
    contact_modulus_MPa: float,
    tolerance: float,
    patch_mm: float,
    shown: Collection[int] = (),
) -> xr.Dataset:
    """Press the face in one pose after the other.

    Parameters
    ----------
    height : (y, x) xarray.DataArray
        The face's, mm.
    gesture : Gesture
    patches : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg``.
    contact_modulus_MPa, tolerance : float
        As in `gstlib.contact.Contact`.
    patch_mm : float
        Side of a patch.
    shown : collection of int
        Poses whose pressure is kept, by their numbers.

    Returns
    -------
    xarray.Dataset
        Over the poses, by element (y, x): ``pressure_sum`` and ``highest_pressure``, MPa,
        ``touched_sum`` and ``exposure``, N/mm, sums with the poses' weights. By ``pose``:
        ``weight``, ``displacement`` mm, ``contact_fraction``, and by patch ``patch_pressure`` MPa
        and ``patch_exposure`` N/mm. ``pressure`` (shown, y, x), MPa, in the poses to be shown.

    Examples
    --------
    A round tool, pressed on a flat at two points that are 2 mm apart, each in a patch:

    >>> import gstlib
    >>> from gstlib.macroscale.gesture import Gesture, stroke_poses
    >>> flat = gstlib.make_surface(np.zeros((32, 32)), 0.125)
    >>> tool = gstlib.rounded_counterface(flat, 50.0, middle=(2.0, 2.0))
    >>> poses = stroke_poses(stroke_mm=2.0, poses=2, force_N=20.0)
    >>> gesture = Gesture(tool, None, 4.0, (2.0, 2.0), poses)
    >>> patches = pd.DataFrame({"patch": ["a", "b"], "x_mm": [1.0, 3.0], "y_mm": 2.0})
    >>> solving = {"contact_modulus_MPa": 1e4, "tolerance": 1e-6, "patch_mm": 1.0}
    >>> posed = gstlib.press_poses(flat, gesture, patches.assign(rotation_deg=0.0), **solving)
    >>> posed.patch_pressure.round(1).values.tolist()
    [[20.0, 0.0], [0.0, 20.0]]
    """
    poses = gesture.poses
    means = patch_means(height, patches, size_mm=patch_mm)
    y, x = (height[axis].values - gesture.size_mm / 2 for axis in "yx")
    cases = (
        gesture.case(height, pose, contact_modulus_MPa) for pose in poses.itertuples()
    )
    contacts = press_each(cases, tolerance=tolerance, source="gesture", in_order=True)
    sums, highest = np.zeros((3, *height.shape)), np.zeros(height.shape)
    by_pose, kept = [], {}
    for pose, contact in zip(poses.itertuples(), contacts, strict=True):
        pressure, displacement = np.zeros(height.shape), np.nan
        if contact is not None:
            pressure, displacement = contact.pressure.values, contact.displacement
        else:
            _log.warning(
                "pose %s: the stone does not rest in it, so this pose causes no wear",
                pose.Index,
            )
        from_middle = np.hypot(y[:, None] - pose.y_mm, x - pose.x_mm)
        turned_mm = np.radians(pose.turning_deg) * from_middle
        work = pressure * np.hypot(pose.sliding_mm, turned_mm)
        touched = pressure > 0
        sums += pose.weight * np.stack([pressure, touched, work])
        if pose.weight > 0:
            highest = np.maximum(highest, pressure)
        if pose.Index in shown:
            kept[pose.Index] = pressure
        on_patches = means @ pressure.ravel(), pose.weight * (means @ work.ravel())
        by_pose.append((displacement, touched.mean(), *on_patches))
    displaced, fraction, pressures, exposures = map(list, zip(*by_pose, strict=True))
    element, by_patch = ("y", "x"), ("pose", "patch")
    fields = np.array([*kept.values()]).reshape(-1, *height.shape)
    variables = {
        "pressure_sum": (element, sums[0]),
        "highest_pressure": (element, highest),
        "touched_sum": (element, sums[1]),
        "exposure": (element, sums[2]),
        "weight": ("pose", poses.weight),
        "displacement": ("pose", displaced),
        "contact_fraction": ("pose", fraction),
        "patch_pressure": (by_patch, pressures),
        "patch_exposure": (by_patch, exposures),
        "pressure": (("shown", *element), fields),
    }
    where = {"y": height.y, "x": height.x, "shown": [*kept]}
    posed = xr.Dataset(
        variables, where | {"pose": poses.index, "patch": [*patches.patch]}
    )
    return described(posed, _VARIABLES)


def exposure(batches: Iterable[xr.Dataset]) -> xr.Dataset:
    """The exposure of all poses together, from batches of `press_poses` in order.

    For each element (y, x), the result contains ``mean_pressure``, ``highest_pressure`` (MPa),
    ``touched`` (share) and ``exposure`` (N/mm). It also contains ``pressure`` of the poses shown,
    and the results of `press_poses` by ``pose``.
    """
    parts = list(batches)
    of_poses = xr.concat(
        [part.drop_dims(["y", "x", "shown"]) for part in parts], "pose"
    )
    total = float(of_poses.weight.sum())
    highest = xr.concat([part.highest_pressure for part in parts], "batch")
    exposed = of_poses.assign(
        mean_pressure=sum(part.pressure_sum for part in parts) / total,
        highest_pressure=highest.max("batch"),
        touched=sum(part.touched_sum for part in parts) / total,
        exposure=sum(part.exposure for part in parts),
        pressure=xr.concat([part.pressure for part in parts], "shown"),
    )
    return described(exposed, _VARIABLES)


def exposure_table(exposed: xr.Dataset, pressures: pd.DataFrame) -> pd.DataFrame:
    """The table ``exposure.csv``: each patch over the gesture, beside its single pose.

    `exposed` is from `exposure`, and `pressures` has ``patch, pressure_MPa``. The result has
    ``patch, pressure_MPa`` (in the single pose), ``mean_pressure_MPa, lowest_pressure_MPa,
    highest_pressure_MPa, touched`` (share of the poses), ``exposure_N_per_mm``.

    Examples
    --------
    The last of three poses has no weight, so that it is neither the lowest nor the highest:

    >>> by_pose = xr.Dataset(
    ...     {
    ...         "weight": ("pose", [1.0, 3.0, 0.0]),
    ...         "patch_pressure": (("pose", "patch"), [[4.0, 0.0], [7.0, 3.0], [1.0, 9.0]]),
    ...         "patch_exposure": (("pose", "patch"), [[2.0, 0.0], [3.0, 1.0], [0.0, 0.0]]),
    ...     },
    ...     {"patch": ["b", "a"]},
    ... )
    >>> single = pd.DataFrame({"patch": ["a", "b"], "pressure_MPa": [8.0, 5.0]})
    >>> for row in exposure_table(by_pose, single).to_numpy():
    ...     print(*row)
    a 8.0 2.25 0.0 3.0 0.75 1.0
    b 5.0 6.25 4.0 7.0 1.0 5.0
    """
    weight = exposed.weight.values
    pressed = exposed.patch_pressure.values
    table = pd.DataFrame(
        {
            "patch": exposed.patch.values,
            "mean_pressure_MPa": weight @ pressed / weight.sum(),
            "lowest_pressure_MPa": pressed[weight > 0].min(axis=0),
            "highest_pressure_MPa": pressed[weight > 0].max(axis=0),
            "touched": weight @ (pressed > 0) / weight.sum(),
            "exposure_N_per_mm": exposed.patch_exposure.values.sum(axis=0),
        }
    )
    return pressures[["patch", "pressure_MPa"]].merge(table, on="patch")
