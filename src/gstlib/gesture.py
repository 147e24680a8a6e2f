"""A gesture: many poses of the active stone, and what their contacts leave on the square together.

Each pose is a contact of its own. Kept of all are, on each element and each patch, the mean and the
highest pressure, how often it is touched, and the exposure: pressure times sliding, summed over the
poses, which is what Archard's law takes. Poses that follow each other are alike, so that each
contact starts from the one before.
"""

# ASSUME: each pose is a contact at rest under its own mean pressure; from one to the next the
# stones slide by the distance that the pose states.
# ASSUME: a stone that pounds slides as far in each blow as in the others.

from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem import solve_contact
from gstlib.contact import faces_of, solved
from gstlib.counterface import face_in_pose, face_of
from gstlib.coupling import Place, footprint_weights, places_of
from gstlib.errors import ConfigError
from gstlib.surface import spacing_of

__all__ = [
    "exposure",
    "exposure_table",
    "make_poses",
    "pose_shifts",
    "press_poses",
    "read_poses",
]

# Columns of a gesture: the least number that each takes, and what stands for an absent one.
_COLUMNS: dict[str, tuple[float, float | None]] = {
    "x_mm": (-np.inf, None),
    "y_mm": (-np.inf, None),
    "rotation_deg": (-np.inf, 0.0),
    "pressure_MPa": (0.0, None),
    "sliding_mm": (0.0, None),
    "turning_deg": (0.0, 0.0),
    "weight": (0.0, None),
}
# Shifts of the active stone after which the ranking of the patches is looked at, and directions.
_SHIFTS_MM = 0.1, 0.5, 1.0
_DIRECTIONS = 8
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


def read_poses(path: str | Path, *, size_mm: float) -> pd.DataFrame:
    """The poses of a gesture from a table, a row each, with the columns of `make_poses`.

    The file is text, its cells are separated by tabs, commas or semicolons; a line that begins with
    # is a comment. Without ``rotation_deg`` or ``turning_deg`` they are 0. In place of
    ``pressure_MPa`` there may be ``force_N``, on the square of side `size_mm`.

    Raises
    ------
    ConfigError
        There are no poses, a column is unknown or missing, or a cell is no number in its range.
    """
    try:
        table = pd.read_csv(
            path, sep=None, engine="python", comment="#", skipinitialspace=True
        )
    except (OSError, ValueError) as error:
        raise ConfigError(
            path, f"cannot be read ({error})", "Save it as UTF-8 CSV."
        ) from error
    if "pressure_MPa" not in table and "force_N" in table:
        forces = pd.to_numeric(table["force_N"], errors="coerce")
        table = table.assign(pressure_MPa=forces / size_mm**2).drop(columns="force_N")
    unknown = [name for name in table if name not in _COLUMNS]
    missing = [name for name, (_, of) in _COLUMNS.items() if of is None and name not in table]
    if unknown or missing or table.empty:
        raise ConfigError(
            path,
            f"{len(table)} poses, missing columns {missing}, unknown columns {unknown}",
            f"Give a line of column names and a line for each pose; columns: {list(_COLUMNS)}.",
        )
    for name, (least, absent) in _COLUMNS.items():
        given = table.get(name, pd.Series(absent, index=table.index))
        numbers = pd.to_numeric(given, errors="coerce")
        for row in np.flatnonzero(~(np.isfinite(numbers) & (numbers >= least))):
            raise ConfigError(
                path,
                f"pose {row + 1}: {name} is {given[row]}",
                "Give a number" + (f" from {least:g} on." if np.isfinite(least) else "."),
            )
        table[name] = numbers
    if not ((table.weight > 0).any() and (table.pressure_MPa > 0).all()):
        problem = "no pose has a weight, or one has no pressure"
        raise ConfigError(path, problem, "Give weights and pressures above 0.")
    return table[list(_COLUMNS)]


def make_poses(gesture: Mapping[str, Any], *, pressure_MPa: float, seed: int) -> pd.DataFrame:
    """The poses that a line of the config asks for.

    Parameters
    ----------
    gesture : mapping
        ``poses``, their number, and one of ``pounding_mm``, the standard deviation along each axis
        of where a blow falls; ``stroke_mm``, the length of a stroke along x; ``rotation_deg``, the
        angle of a turn about the middle of the square. Stroke and turn have their middle where the
        active stone is posed.
    pressure_MPa : float
        Mean pressure of every pose.
    seed : int
        Of the scatter.

    Returns
    -------
    pandas.DataFrame
        ``x_mm, y_mm`` (shift of the active stone along the square's axes), ``rotation_deg`` (its
        turn about the middle of the square, from x towards y), ``pressure_MPa``, ``sliding_mm`` and
        ``turning_deg`` (how far it slides and turns in the pose) and ``weight``.
    """
    count = gesture["poses"]
    table = pd.DataFrame(0.0, index=range(count), columns=list(_COLUMNS))
    table = table.assign(pressure_MPa=pressure_MPa, weight=1.0)
    along = np.linspace(-0.5, 0.5, count)
    if (scatter := gesture.get("pounding_mm")) is not None:
        table[["x_mm", "y_mm"]] = scatter * np.random.default_rng(seed).standard_normal(
            (count, 2)
        )
        table["sliding_mm"] = 1.0
    elif (length := gesture.get("stroke_mm")) is not None:
        table["x_mm"], table["sliding_mm"] = length * along, length / count
    else:
        angle = gesture["rotation_deg"]
        table["rotation_deg"], table["turning_deg"] = angle * along, abs(angle) / count
    return table


def press_poses(
    surface: xr.Dataset,
    poses: pd.DataFrame,
    patches: pd.DataFrame,
    *,
    patch_mm: float,
    contact_modulus_MPa: float,
    tolerance: float,
    shown: Collection[int] = (),
    source: str | Path = "gesture",
) -> xr.Dataset:
    """Press the square in one pose after the other.

    Parameters
    ----------
    surface : xarray.Dataset
        The square's ``height`` (y, x) and the active stone's ``face`` (face_y, face_x), mm, from
        `gstlib.study.grid_macroscale`.
    poses : pandas.DataFrame
        From `make_poses` or `read_poses`; the index numbers them.
    patches : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg``.
    patch_mm : float
        Side of a patch.
    contact_modulus_MPa, tolerance, source
        As in `gstlib.contact.contact_at_pressure`.
    shown : collection of int
        Poses whose pressure is kept, by their numbers.

    Returns
    -------
    xarray.Dataset
        Over the poses, by element (y, x): ``pressure_sum`` and ``highest_pressure``, MPa,
        ``touched_sum`` and ``exposure``, N/mm, sums with the poses' weights. By ``pose``:
        ``weight``, ``displacement`` mm, ``contact_fraction``, and by patch ``patch_pressure`` MPa
        and ``patch_exposure`` N/mm. ``pressure`` (shown, y, x), MPa, in the poses to be shown.
    """
    height = surface.height
    outlines = [footprint_weights(height, at, patch_mm) for at in places_of(patches).values()]
    share = np.stack(outlines) * (np.prod(spacing_of(height)) / patch_mm**2)
    y, x = (height[axis].values - float(height[axis].mean()) for axis in "yx")
    far, face = np.hypot(y[:, None], x), face_of(surface)
    names = "pressure_sum", "highest_pressure", "touched_sum", "exposure"
    found = {name: np.zeros(height.shape) for name in names}
    rows: list[tuple] = []
    kept: dict[int, np.ndarray] = {}
    start = None
    for pose in poses.itertuples():
        over = face_in_pose(face, height, Place(pose.y_mm, pose.x_mm, pose.rotation_deg))
        faces = faces_of(surface.assign(counterface=over))
        faces.attrs = {"contact_modulus_MPa": contact_modulus_MPa, "tolerance": tolerance}
        load = {"mean_pressure": pose.pressure_MPa, "initial_pressure": start}
        state = solved(solve_contact, faces, source, **load)
        start = state.pressure
        if pose.Index in shown:
            kept[pose.Index] = start
        work = state.pressure * np.hypot(pose.sliding_mm, np.radians(pose.turning_deg) * far)
        found["pressure_sum"] += pose.weight * state.pressure
        found["touched_sum"] += pose.weight * state.contact
        found["exposure"] += pose.weight * work
        if pose.weight > 0:
            found["highest_pressure"] = np.maximum(found["highest_pressure"], state.pressure)
        on_patches = (np.einsum("pyx,yx->p", share, of) for of in (state.pressure, work))
        rows.append((pose.weight, state.displacement, state.contact_fraction, *on_patches))
    weight, displacement, fraction, pressure, work = (
        np.array(of) for of in zip(*rows, strict=True)
    )
    of_pose, of_patch = ("pose",), ("pose", "patch")
    batch = xr.Dataset(
        {name: (("y", "x"), values) for name, values in found.items()}
        | {
            "weight": (of_pose, weight),
            "displacement": (of_pose, displacement),
            "contact_fraction": (of_pose, fraction),
            "patch_pressure": (of_patch, pressure),
            "patch_exposure": (of_patch, weight[:, None] * work),
            "pressure": (
                ("shown", "y", "x"),
                np.array(list(kept.values())).reshape(-1, *far.shape),
            ),
        },
        coords={
            "y": height.y,
            "x": height.x,
            "pose": poses.index,
            "shown": list(kept),
            "patch": list(patches.patch),
        },
    )
    return _named(batch)


def exposure(batches: Iterable[xr.Dataset]) -> xr.Dataset:
    """What all poses leave together, from batches of `press_poses` in order.

    The result has ``mean_pressure``, ``highest_pressure`` (MPa), ``touched`` (share) and
    ``exposure`` (N/mm) by element (y, x), ``pressure`` of the poses shown, and by ``pose`` what
    `press_poses` gives.
    """
    parts = list(batches)
    of_poses = xr.concat([part.drop_dims(["y", "x", "shown"]) for part in parts], "pose")
    total = float(of_poses.weight.sum())
    fields = {
        "mean_pressure": sum(part.pressure_sum for part in parts) / total,
        "highest_pressure": np.maximum.reduce([part.highest_pressure for part in parts]),
        "touched": sum(part.touched_sum for part in parts) / total,
        "exposure": sum(part.exposure for part in parts),
    }
    found = of_poses.assign(
        {name: (("y", "x"), np.asarray(of)) for name, of in fields.items()}
    )
    found = found.assign_coords(y=parts[0].y, x=parts[0].x)
    found["pressure"] = xr.concat([part.pressure for part in parts], "shown")
    return _named(found)


def _named(found: xr.Dataset) -> xr.Dataset:
    """With units and meaning of every variable."""
    for name in found.data_vars:
        units, long_name = _VARIABLES[str(name)]
        found[name].attrs = {"units": units, "long_name": long_name}
    return found


def exposure_table(found: xr.Dataset, pressures: pd.DataFrame) -> pd.DataFrame:
    """The table ``exposure.csv``: each patch over the gesture, beside its single pose.

    `found` is from `exposure`; `pressures` has ``patch, pressure_MPa``. The result has ``patch,
    pressure_MPa`` (in the single pose), ``mean_pressure_MPa, lowest_pressure_MPa,
    highest_pressure_MPa, touched`` (share of the poses), ``exposure_N_per_mm``.
    """
    weight, pressed = found.weight.values, found.patch_pressure.values
    table = pd.DataFrame(
        {
            "patch": found.patch.values,
            "mean_pressure_MPa": weight @ pressed / weight.sum(),
            "lowest_pressure_MPa": pressed[weight > 0].min(axis=0),
            "highest_pressure_MPa": pressed[weight > 0].max(axis=0),
            "touched": weight @ (pressed > 0) / weight.sum(),
            "exposure_N_per_mm": found.patch_exposure.values.sum(axis=0),
        }
    )
    return pressures[["patch", "pressure_MPa"]].merge(table, on="patch")


def pose_shifts(
    surface: xr.Dataset,
    pressures: pd.DataFrame,
    *,
    target_pressure_MPa: float,
    **settings: Any,
) -> pd.DataFrame:
    """Does the ranking of the patches survive a shift of the active stone?

    Parameters
    ----------
    surface
        As in `press_poses`.
    pressures : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg`` and ``pressure_MPa``, that of the pose itself.
    target_pressure_MPa : float
        Mean pressure of every pose.
    **settings
        Of `press_poses`.

    Returns
    -------
    pandas.DataFrame
        ``shift_mm``; over eight directions the mean and the least Spearman correlation of the
        patches' pressures with those of the pose, ``spearman, spearman_least``;
        ``same_hardest``, the share of the directions in which the same patch is pressed hardest;
        ``change``, the mean over patches of the pressure's absolute change over its mean.
    """
    angles = 2 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    before, rows = pressures.pressure_MPa.to_numpy(), []
    for shift in _SHIFTS_MM:
        gesture = {"poses": _DIRECTIONS, "stroke_mm": 0.0}
        poses = make_poses(gesture, pressure_MPa=target_pressure_MPa, seed=0)
        poses = poses.assign(x_mm=shift * np.cos(angles), y_mm=shift * np.sin(angles))
        after = press_poses(surface, poses, pressures, **settings).patch_pressure.values
        ranks = [_ranked_alike(before, of) for of in after]
        rows.append(
            {
                "shift_mm": shift,
                "spearman": float(np.mean(ranks)),
                "spearman_least": float(np.min(ranks)),
                "same_hardest": float((after.argmax(axis=1) == before.argmax()).mean()),
                "change": float(np.abs(after - before).mean() / (before.mean() or np.nan)),
            }
        )
    return pd.DataFrame(rows)


def _ranked_alike(one: np.ndarray, other: np.ndarray) -> float:
    """Spearman's correlation; NaN where all of one are equal."""
    from scipy.stats import spearmanr  # takes longer to import than all else here

    return float(spearmanr(one, other).statistic) if np.ptp(one) and np.ptp(other) else np.nan
