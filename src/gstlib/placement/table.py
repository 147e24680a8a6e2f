"""From surfaces and patch table to the table of placement, and what follows from it."""

import logging
import math
from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.placement.matching import lay_patch, share_by_chance
from gstlib.placement.peaks import best_shift, find_peak
from gstlib.placement.rows import ALL, COLUMNS, SHIFTED, new_row, verdict_of
from gstlib.placement.together import shared_shift
from gstlib.placement.waves import POINTS, VARIANTS, Waves, interpolant, shortest_wave
from gstlib.surface import make_surface

__all__ = ["found_places", "place_patches", "warnings_of"]

_log = logging.getLogger(__name__)

# Two unknown shifts and one factor of the heights take three numbers; at least one must be left.
_FEWEST_WAVES = 4
# All patches together are warned of below this correlation. With every place right it was 0.87 on
# the generated specimen and 0.70 on a measured pebble; with one in five, 0.30; with none, 0.06.
_LOW = 0.5


def place_patches(
    surface: xr.DataArray,
    patches: pd.DataFrame,
    heights: Mapping[str, xr.DataArray],
    *,
    size_mm: float,
    edge_mm: float,
    maximum_shift_um: float,
    significance: float,
    generator: np.random.Generator,
) -> tuple[pd.DataFrame, xr.Dataset]:
    """Find where each patch lies on the square, and whether that is where it should.

    Parameters
    ----------
    surface : (y, x) xarray.DataArray
        Heights of the macroscale in the square's frame, mm.
    patches : pandas.DataFrame
        Patch table: ``patch, x_mm, y_mm``, optionally ``rotation_deg``.
    heights : mapping of patch to (y, x) xarray.DataArray
        The prepared scans, mm, no NaN.
    size_mm : float
        Side of a patch.
    edge_mm : float
        Mean edge of the mesh's triangles, mm.
    maximum_shift_um : float
        Largest shift looked for, along each axis.
    significance : float
        Level of every test.
    generator : numpy.random.Generator
        Draws the chance places that all patches together are compared with.

    Returns
    -------
    table : pandas.DataFrame
        A row for each patch, and one (`ALL`) for a shift that all of them share: ``waves`` (the
        independent numbers compared), ``correlation_nominal``, ``correlation`` (at the best
        shift), its ``p_value``; ``shift_x_um``, ``shift_y_um`` (true less nominal place, along
        the square's axes) and their standard errors; ``shift_p_value`` (of no shift); ``verdict``
        and, for all patches, what they look like (``looks``). NaN where there is no peak.
    maps : xarray.Dataset
        ``correlation`` (patch, shift_y, shift_x); ``patch_waves``, ``nominal_waves`` and
        ``found_waves`` (patch, y, x), mm: the patch, and the macroscale under its nominal place
        and its found one (NaN where none is), in the patch's own axes.
    """
    from scipy.stats import chi2

    waves = Waves(size_mm, shortest_wave(size_mm, edge_mm, surface))
    step_um = size_mm / POINTS * 1e3
    reach = max(1, round(maximum_shift_um / step_um))
    shifts = np.arange(-reach, reach + 1) * step_um
    names = [str(patch) for patch in patches.patch]
    maps = _empty_maps(names, shifts, size_mm)
    if len(waves) < _FEWEST_WAVES:
        _log.info("mesh and scans hold too few waves in common to tell: %d", len(waves))
        rows = [new_row(name, len(waves)) for name in [*names, ALL]]
        return pd.DataFrame(rows, columns=COLUMNS), maps

    spline, low, high = interpolant(surface)
    # ASSUME: a patch may be shifted, but its rotation is the stated one.
    matches, found = {}, {}
    for name, row in zip(names, patches.itertuples(index=False), strict=True):
        of_patch = waves.of_patch(heights[name])
        rotation = float(getattr(row, "rotation_deg", 0.0))
        under, at = waves.under(spline, low, high, np.array([row.y_mm, row.x_mm]), rotation)
        matches[name] = lay_patch(of_patch, under, at, reach, generator)
        found[name] = find_peak(matches[name].as_given())
        maps["correlation"].loc[name] = matches[name].as_given()
        maps["patch_waves"].loc[name] = np.tensordot(of_patch[0], waves.shapes, 1)
        maps["nominal_waves"].loc[name] = np.tensordot(under[:, *at], waves.shapes, 1)
        if found[name] is not None:
            best = at + found[name].index - reach
            maps["found_waves"].loc[name] = np.tensordot(under[:, *best], waves.shapes, 1)

    searches = sum(match.searches for match in matches.values())
    if 1 / (1 + searches) >= significance:
        _log.warning(
            "the square has room for %.0f searches in wrong places, too few for a level of %g: "
            "lower placement.maximum_shift_um or raise placement.significance",
            searches,
            significance,
        )
    p_values = {
        name: share_by_chance(np.nanmax(match.as_given()), matches.values())
        for name, match in matches.items()
    }
    free = len(waves) - 3
    left = [
        matches[name].energy * (1 - peak.value**2) / free
        for name, peak in found.items()
        if peak is not None
    ]
    # ASSUME: what the two surfaces disagree by is of one size on all patches: they are of one
    # stone, seen by one mesh and one instrument. The median leaves out patches that lie nowhere.
    noise = np.median(left) * free / chi2.median(free) if left else math.nan
    rows = []
    for name, match in matches.items():
        row = new_row(name, len(waves), match, found[name]) | {"p_value": p_values[name]}
        if found[name] is not None:
            row |= best_shift(match, found[name], noise, free * len(left), step_um)
        rows.append(row | {"verdict": verdict_of(row, significance)})
    rows.append(shared_shift(list(matches.values()), len(waves), step_um, significance))
    return pd.DataFrame(rows, columns=COLUMNS), maps


def found_places(patches: pd.DataFrame, placement: pd.DataFrame) -> pd.DataFrame:
    """The patch table with every patch that is `SHIFTED` moved to where it was found.

    Parameters
    ----------
    patches : pandas.DataFrame
        ``patch, x_mm, y_mm`` and more.
    placement : pandas.DataFrame
        Table of `place_patches`.

    Returns
    -------
    pandas.DataFrame
        `patches` with ``place``, "nominal" or "found".
    """
    shifts = placement.set_index("patch").loc[list(patches.patch)]
    moved = (shifts.verdict == SHIFTED).to_numpy()
    return patches.assign(
        **{
            f"{axis}_mm": patches[f"{axis}_mm"].to_numpy()
            + np.where(moved, shifts[f"shift_{axis}_um"], 0.0) * 1e-3
            for axis in "xy"
        },
        place=np.where(moved, "found", "nominal"),
    )


def warnings_of(placement: pd.DataFrame) -> list[str]:
    """What of a table of `place_patches` a user should look into, in sentences."""
    said = []
    for row in placement.itertuples(index=False):
        if row.verdict == SHIFTED:
            shift = (
                f"x by {row.shift_x_um:+.0f} ± {row.shift_x_error_um:.0f} µm and y by "
                f"{row.shift_y_um:+.0f} ± {row.shift_y_error_um:.0f} µm"
            )
            if row.patch == ALL:
                said.append(f"all patches together lie off in {shift}: check square.frame")
            else:
                said.append(
                    f"patch {row.patch} correlates best with the macroscale when shifted in "
                    f"{shift}: check its place"
                )
        if isinstance(row.looks, str) and row.looks not in ("", next(iter(VARIANTS))):
            said.append(
                f"the patches look mirrored: they fit the macroscale better {row.looks}: "
                "check scans.mould"
            )
        elif row.patch == ALL and row.verdict != SHIFTED and row.correlation < _LOW:
            said.append(
                "the patches together correlate with the macroscale by no more than "
                f"{row.correlation:.2f}, as if few or none of them lay where the patch table says: "
                "check its x_mm and y_mm, square.frame, and the units of mesh and scans (a mesh "
                "that is too smooth looks the same)"
            )
    return said


def _empty_maps(names: list[str], shifts_um: np.ndarray, size_mm: float) -> xr.Dataset:
    frame = make_surface(np.zeros((POINTS, POINTS)), size_mm / POINTS)
    shift = {"units": "um", "spacing": float(shifts_um[1] - shifts_um[0])}
    coordinates = xr.Dataset(
        coords={
            "patch": ("patch", np.array(names, dtype=object)),
            "shift_y": ("shift_y", shifts_um, shift | {"long_name": "shift of the patch along y"}),
            "shift_x": ("shift_x", shifts_um, shift | {"long_name": "shift of the patch along x"}),
            "y": frame.y,
            "x": frame.x,
        }
    )
    meanings = {
        "correlation": (("shift_y", "shift_x"), "1", "correlation of patch and macroscale"),
        "patch_waves": (("y", "x"), "mm", "waves of the patch that the mesh holds too"),
        "nominal_waves": (("y", "x"), "mm", "the macroscale's under the nominal place"),
        "found_waves": (("y", "x"), "mm", "the macroscale's under the best place"),
    }
    variables = {
        name: (
            ("patch", *dims),
            np.full((len(names), *(coordinates.sizes[dim] for dim in dims)), np.nan),
            {"units": units, "long_name": long_name},
        )
        for name, (dims, units, long_name) in meanings.items()
    }
    return coordinates.assign(variables)
