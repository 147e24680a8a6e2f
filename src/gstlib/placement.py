"""Does each patch lie where the patch table says?

The mesh and a scan show the same stone, so the waves that both hold must agree wherever the patch
truly lies. Those waves are few: longer than the mesh's points hold, √3 edges of its triangles, and
not much longer than the patch, which has lost its plane. Both surfaces are therefore written as
the same set of waves over the patch's footprint, level; their correlation is mapped over trial
shifts of the footprint on the square. Its peak is the likeliest place. How likely a peak as high
is by chance is read off the same map far from the nominal place; how well the peak is placed
follows from its curvature and from what both surfaces disagree by, over all patches.
"""

import logging
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.surface import make_surface
from gstlib.waves import FLIPS, POINTS, VARIANTS, Waves, interpolant, shortest_wave

__all__ = [
    "AGREES",
    "ALL",
    "CANNOT_TELL",
    "SHIFTED",
    "found_places",
    "place_patches",
    "warnings_of",
]

AGREES, SHIFTED, CANNOT_TELL = "agrees", "shifted", "cannot tell"
# The row of all patches together.
ALL = "all"

_log = logging.getLogger(__name__)

# Two unknown shifts and one factor of the heights take three numbers; at least one must be left.
_FEWEST_WAVES = 4
# Peaks are some 10 points wide: for the maxima of all patches together every third point will do.
_STRIDE = 3
_DRAWS = 1999
# Fewer patches have no scatter to judge a shift that they share by.
_FEWEST_PATCHES = 4

_COLUMNS = [
    "patch",
    "waves",
    "correlation_nominal",
    "correlation",
    "p_value",
    "shift_x_um",
    "shift_y_um",
    "shift_x_error_um",
    "shift_y_error_um",
    "shift_p_value",
    "verdict",
    "looks",
]


@dataclass(frozen=True)
class _Match:
    """A patch laid over its nominal place, around it, and far from it.

    Attributes
    ----------
    correlation : (8, k, k) ndarray
        With each of `VARIANTS` of the patch, over the trial shifts (y, x); where the footprint
        would leave the square, as at the nearest shift where it does not.
    inside : (k, k) ndarray of bool
        Where the footprint stays in the square.
    energy : float
        Mean square of the patch's waves, mm².
    highest : (n,) ndarray
        Highest correlation of each equal search far from the nominal place, in ascending order.
    searches : float
        How many independent ones they amount to.
    chance : (_DRAWS, j, j) ndarray or None
        Correlations of such searches, at every `_STRIDE`-th shift; None where there is no room.
    """

    correlation: np.ndarray
    inside: np.ndarray
    energy: float
    highest: np.ndarray
    searches: float
    chance: np.ndarray | None

    def as_given(self) -> np.ndarray:
        """Correlation of the patch as given; NaN where its footprint would leave the square."""
        return np.where(self.inside, self.correlation[0], np.nan)


@dataclass(frozen=True)
class _Peak:
    """Top of a map of correlations: the shift (y, x) in steps, and the curvature (2, 2) there."""

    value: float
    index: tuple[int, int]
    shift: np.ndarray
    curvature: np.ndarray


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
        rows = [_row(name, len(waves)) for name in [*names, ALL]]
        return pd.DataFrame(rows, columns=_COLUMNS), maps

    spline, low, high = interpolant(surface)
    # ASSUME: a patch may be shifted, but its rotation is the stated one.
    matches, found = {}, {}
    for name, row in zip(names, patches.itertuples(index=False), strict=True):
        of_patch = waves.of_patch(heights[name])
        rotation = float(getattr(row, "rotation_deg", 0.0))
        under, at = waves.under(spline, low, high, np.array([row.y_mm, row.x_mm]), rotation)
        matches[name] = _match(of_patch, under, at, reach, generator)
        found[name] = _peak(matches[name].as_given())
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
        name: _share_by_chance(np.nanmax(match.as_given()), matches.values())
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
        row = _row(name, len(waves), match, found[name]) | {"p_value": p_values[name]}
        if found[name] is not None:
            row |= _shift(match, found[name], noise, free * len(left), step_um)
        rows.append(row | {"verdict": _verdict(row, significance)})
    rows.append(_together(list(matches.values()), len(waves), step_um, significance))
    return pd.DataFrame(rows, columns=_COLUMNS), maps


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


def _match(
    of_patch: np.ndarray,
    under: np.ndarray,
    at: np.ndarray,
    reach: int,
    generator: np.random.Generator,
) -> _Match:
    """Lay a patch (8, waves) on the macroscale (waves, ny, nx), whose point `at` is nominal."""
    from scipy.ndimage import maximum_filter

    upright = of_patch[:FLIPS]
    energy = float(upright[0] @ upright[0])
    size = np.sqrt(energy * (under**2).sum(axis=0))
    everywhere = np.tensordot(upright, under, 1)
    everywhere = np.divide(everywhere, size, out=np.zeros_like(everywhere), where=size > 0)

    width = 2 * reach + 1
    asked = [np.arange(a - reach, a + reach + 1) for a in at]
    known = [np.clip(a, 0, n - 1) for a, n in zip(asked, everywhere.shape[1:], strict=True)]
    window = everywhere[:, known[0][:, None], known[1]]
    inside = np.equal(asked[0], known[0])[:, None] & np.equal(asked[1], known[1])

    # The same search about other places: none of its footprints may overlap much with where the
    # patch truly lies. Flips make more of them.
    # ASSUME: chance is the same all over the square, and for a patch and its mirror images.
    rows, columns = (np.arange(reach, n - reach) for n in everywhere.shape[1:])
    away = 2 * reach + POINTS // 2
    far = np.maximum(abs(rows - at[0])[:, None], abs(columns - at[1])) >= away
    highest, searches, chance = np.zeros(0), 0.0, None
    if far.any():
        highest = maximum_filter(everywhere, (1, width, width))[:, rows[0] :, columns[0] :]
        highest = np.sort(highest[:, : len(rows), : len(columns)][:, far], axis=None)
        # searches this far apart have little in common
        searches = FLIPS * far.sum() / (width + POINTS // 8) ** 2
        chance = _draws(everywhere, rows, columns, far, reach, generator)
    both = np.concatenate([window, -window])
    return _Match(both, inside, energy, highest, float(searches), chance)


def _share_by_chance(correlation: float, matches: Iterable[_Match]) -> float:
    """Share of searches in the wrong places, of all patches, that find such a correlation."""
    # ASSUME: chance is alike for all patches, so that their searches in wrong places add up.
    matches = [match for match in matches if match.searches]
    as_high = sum(
        match.searches * (1 - np.searchsorted(match.highest, correlation) / len(match.highest))
        for match in matches
    )
    return float((1 + as_high) / (1 + sum(match.searches for match in matches)))


def _draws(
    everywhere: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
    far: np.ndarray,
    reach: int,
    generator: np.random.Generator,
) -> np.ndarray:
    """Windows (_DRAWS, j, j) about far places drawn by chance, of any flip."""
    places = np.argwhere(far)[generator.integers(0, far.sum(), _DRAWS)]
    flips = generator.integers(0, FLIPS, _DRAWS)[:, None, None]
    along = np.arange(-reach, reach + 1, _STRIDE)
    row = rows[places[:, 0]][:, None, None] + along[:, None]
    column = columns[places[:, 1]][:, None, None] + along
    return everywhere[flips, row, column]


def _peak(correlation: np.ndarray) -> _Peak | None:
    """The top of a map (y, x), between its points; None on the map's edge, or where none agrees."""
    row, column = np.unravel_index(np.nanargmax(correlation), correlation.shape)
    around = correlation[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
    if around.shape != (3, 3) or not np.isfinite(around).all() or not around[1, 1] > 0:
        return None
    slope = np.array([_slope(correlation[:, column], row), _slope(correlation[row], column)])
    mixed = (around[2, 2] - around[2, 0] - around[0, 2] + around[0, 0]) / 4
    curvature = np.array(
        [
            [around[2, 1] - 2 * around[1, 1] + around[0, 1], mixed],
            [mixed, around[1, 2] - 2 * around[1, 1] + around[1, 0]],
        ]
    )
    if not (np.linalg.eigvalsh(curvature) < 0).all():
        return None
    beside = np.clip(-np.linalg.solve(curvature, slope), -1, 1)
    value = around[1, 1] + slope @ beside / 2
    middle = (np.array(correlation.shape) - 1) / 2
    return _Peak(
        float(min(value, 1.0)), (row, column), np.array([row, column]) + beside - middle, curvature
    )


def _slope(values: np.ndarray, at: int) -> float:
    """Slope there, to the fourth order where four neighbours are known: peaks are lopsided."""
    near = (values[at + 1] - values[at - 1]) / 2
    if not 2 <= at < len(values) - 2:
        return near
    far = (values[at + 2] - values[at - 2]) / 4
    return (4 * near - far) / 3 if np.isfinite(far) else near


def _row(name: str, waves: int, match: _Match | None = None, peak: _Peak | None = None) -> dict:
    """A row of the table as far as correlations go."""
    row = dict.fromkeys(_COLUMNS, math.nan) | {"patch": name, "waves": waves, "looks": ""}
    row |= {"verdict": CANNOT_TELL}
    if match is not None:
        reach = match.correlation.shape[1] // 2
        row |= {
            "correlation_nominal": float(match.correlation[0, reach, reach]),
            "correlation": float(np.nanmax(match.as_given())) if peak is None else peak.value,
        }
    return row


def _shift(match: _Match, peak: _Peak, noise: float, free: int, step_um: float) -> dict:
    """Best shift, its standard error and the test of no shift.

    With heights of any factor, the squares that a shift leaves are those of the patch less the
    share ρ² that the macroscale accounts for; their curvature gives the covariance.
    """
    from scipy.stats import f as f_distribution

    covariance = -noise * np.linalg.inv(match.energy * peak.value * peak.curvature)
    reach = match.correlation.shape[1] // 2
    nominal = max(float(match.correlation[0, reach, reach]), 0.0)
    gained = match.energy * (peak.value**2 - nominal**2)
    ratio = gained / 2 / noise if noise > 0 else math.inf
    return _shift_columns(
        peak.shift * step_um, covariance * step_um**2, f_distribution.sf(ratio, 2, free)
    )


def _shift_columns(shift: np.ndarray, covariance: np.ndarray, p_value: float) -> dict:
    error = np.sqrt(np.diag(covariance))
    return {
        "shift_x_um": float(shift[1]),
        "shift_y_um": float(shift[0]),
        "shift_x_error_um": float(error[1]),
        "shift_y_error_um": float(error[0]),
        "shift_p_value": float(p_value),
    }


def _verdict(row: Mapping, significance: float) -> str:
    if not (row["p_value"] < significance and np.isfinite(row["shift_p_value"])):
        return CANNOT_TELL
    return SHIFTED if row["shift_p_value"] < significance else AGREES


def _together(matches: list[_Match], waves: int, step_um: float, significance: float) -> dict:
    """The row of a shift that all patches share, and whether they fit better turned about."""
    from scipy.stats import f as f_distribution

    row = _row(ALL, waves)
    used = [match for match in matches if match.chance is not None]
    if not used:
        return row
    windows = np.array([match.correlation for match in used])
    mean = windows.mean(axis=0)
    highest = np.mean([match.chance for match in used], axis=0).max(axis=(1, 2))
    p_values = [
        (1 + (highest >= one[::_STRIDE, ::_STRIDE].max()).sum()) / (1 + _DRAWS) for one in mean
    ]
    reach = mean.shape[1] // 2
    row |= {
        "correlation_nominal": float(mean[0, reach, reach]),
        "correlation": float(mean[0].max()),
        "p_value": p_values[0],
    }
    peak = _peak(mean[0])
    if peak is not None:
        row["correlation"] = peak.value
        number = len(used)
        if number >= _FEWEST_PATCHES:
            # The patches' own shifts scatter: the error follows from how their slopes do.
            slopes = np.array([[g[peak.index] for g in np.gradient(one)] for one in windows[:, 0]])
            bread = np.linalg.inv(peak.curvature)
            covariance = bread @ np.cov(slopes.T) @ bread / number
            ratio = peak.shift @ np.linalg.solve(covariance, peak.shift)
            ratio *= (number - 2) / (2 * (number - 1))
            row |= _shift_columns(
                peak.shift * step_um,
                covariance * step_um**2,
                f_distribution.sf(ratio, 2, number - 2),
            )
    row["verdict"] = _verdict(row, significance)
    row["looks"] = _looks(windows, mean, p_values, waves, significance)
    return row


def _looks(
    windows: np.ndarray,
    mean: np.ndarray,
    p_values: list[float],
    waves: int,
    significance: float,
) -> str:
    """Which variant the patches fit; empty where that is not clear."""
    from scipy.stats import f as f_distribution

    left = []
    for variant, one in enumerate(mean):
        row, column = np.unravel_index(one.argmax(), one.shape)
        left.append(1 - np.clip(windows[:, variant, row, column], 0, 1) ** 2)
    names = list(VARIANTS)
    best = int(mean.max(axis=(1, 2)).argmax())
    if best == 0:
        return names[0] if p_values[0] < significance else ""
    # It must not be one of many by chance, and must leave clearly less than the given one.
    by_chance = p_values[best] >= significance / (len(names) - 1)
    free = len(left[best]) * (waves - 3)
    better = left[0].mean() / left[best].mean() > f_distribution.isf(significance, free, free)
    return names[best] if better and not by_chance else ""
