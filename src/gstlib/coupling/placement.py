"""Do the patches lie where the patch table says?

The mesh and a scan show the same stone, so their heights must correlate where the patch truly lies.
On the synthetic specimen this finds the place of one patch to some 45 µm, more than its patches are
misplaced: a small shift of one patch cannot be detected. Three faults can: a shift that all patches
share, moulds that were undone wrongly, and, half of the time, a patch that lies somewhere else.
"""

import logging
import math
from collections.abc import Container, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.errors import FaultError, raise_unless_accepted
from gstlib.surfaces.footprints import moved, on_patch, places_of, spline_of

__all__ = [
    "AGREES",
    "ALL",
    "AS_GIVEN",
    "CANNOT_TELL",
    "ELSEWHERE",
    "FAULT",
    "ORIENTATIONS",
    "SHIFTED",
]
__all__ += ["WAVE_PER_EDGE", "Mould", "lying_right", "oriented", "place_patches"]
__all__ += ["shows_waves"]

_log = logging.getLogger(__name__)

AGREES, SHIFTED, ELSEWHERE, CANNOT_TELL = "agrees", "shifted", "elsewhere", "cannot tell"
ALL = "all"  # the row of all patches together
FAULT = "placement"  # as which a config accepts it
# A triangular net of edge a resolves waves down to √3 a, twice the distance between its rows.
WAVE_PER_EDGE = math.sqrt(3)

_SHIFT = ["shift_x_um", "shift_y_um", "shift_x_error_um", "shift_y_error_um"]
# ASSUME: a scan that was laid wrongly is reversed, turned by quarter turns, or both, or has its
# heights inverted, too. Each look: whether it is reversed along x first, and then by how much it is
# turned, from x towards y (degrees).
ORIENTATIONS = {
    "as given": (False, 0),
    "reversed along x": (True, 0),
    "reversed along y": (True, 180),
    "turned by 180°": (False, 180),
    "turned by 90°": (False, 90),
    "turned by -90°": (False, -90),
    "reversed along x and turned by 90°": (True, 90),
    "reversed along y and turned by 90°": (True, -90),
}
AS_GIVEN, *_OTHERS = ORIENTATIONS
_LOOKS = [*ORIENTATIONS, "inverted", *(f"inverted and {name}" for name in _OTHERS)]
# Patch tables as they are mistaken: each gives (x, y) on a square of side 1 from the stated ones.
_TABLES = {
    "x_mm and y_mm exchanged": lambda x, y: (y, x),
    "x_mm measured from the other side": lambda x, y: (1 - x, y),
    "y_mm measured from the other side": lambda x, y: (x, 1 - y),
    "x_mm and y_mm measured from the other sides": lambda x, y: (1 - x, 1 - y),
    "x_mm and y_mm exchanged, and x_mm then measured from the other side": lambda x, y: (
        1 - y,
        x,
    ),
    "x_mm and y_mm exchanged, and y_mm then measured from the other side": lambda x, y: (
        y,
        1 - x,
    ),
    "x_mm and y_mm exchanged, and both then measured from the other sides": (
        lambda x, y: (1 - y, 1 - x)
    ),
}
# Level of the tests: one right study in a hundred is warned of.
_SIGNIFICANCE = 0.01
# A mesh that is less than so high, beside the scans (r.m.s.), is too smooth to contradict them.
_SMOOTH = 0.5
# Points along a patch's side at which surfaces are compared: shorter waves the mesh does not hold.
_POINTS = 24
# Largest shift tried along each axis, and step between shifts, in sides of a patch: 0.2 mm and
# 35 µm for the paper's, where a peak is 0.2 mm wide.
_REACH, _STEP = 1 / 4, 1 / 24
# Fewer patches have no scatter to score by: only how they are laid can show.
_FEWEST_PATCHES = 4
# Another orientation than as given must fit by this over the root of the number of patches to
# count: of 15, one may fit by chance. Where patches are not shifted, too, this much: of scans in
# wrong places, 0.2 % of pairs, 0.6 % of triples and 0.7 % of fours fit so by chance (default
# study); of pairs that lie right but reversed, 71 % are told, of triples 98 %, of single ones
# none.
_BY_CHANCE, _BY_CHANCE_UNMOVED = 1.2, 1.0
_CLEAR_LEAD = 0.25
# Below this mean correlation the mesh does not show where patches lie, or none lies right. With
# every place right it is 0.7 to 0.8 on synthetic specimens; with none, 0.
_LOW = 0.5
# A patch that correlates by less lies elsewhere. Of 525 patches in their right places none does, on
# synthetic specimens with meshes coarse and noisy, too; of patches in wrong places, half do.
_ELSEWHERE = 0.0


def place_patches(
    surface: xr.DataArray,
    patches: pd.DataFrame,
    scans: Mapping[str, xr.Dataset],
    *,
    patch_mm: float,
    invert: bool = False,
    flip: str | None = None,
    accept: Container[str] = (),
) -> pd.DataFrame:
    """Compare each patch with the square under it; places that cannot be right are a `FAULT`.

    Others that look wrong are warned of.

    Parameters
    ----------
    surface : (y, x) xarray.DataArray
        Heights of the macroscale in the square's frame, mm.
    patches : pandas.DataFrame
        Patch table: ``patch, x_mm, y_mm, rotation_deg``, and optionally ``t0`` and ``flip``:
        scans of different formats, or with different flips, are also tried apart.
    scans : mapping of str to xarray.Dataset
        The prepared T0 scans by patch, with ``height`` (y, x), mm; each is looked up once.
    patch_mm : float
        Side of a patch.
    invert, flip
        How their moulds were undone, as in `gstlib.preprocess.scans.prepare_scan`.
    accept : container of str
        Names of faults that do not stop the study.

    Returns
    -------
    pandas.DataFrame
        A row for each patch, and one (`ALL`) for all together: ``correlation`` where the patch
        table puts them, or, where all are shifted, after that shift; ``status``. For all together
        also the shift that they share (true less stated place, along the square's axes),
        ``shift_x_um, shift_y_um``, and its standard errors, NaN where there is no peak; and how
        they look laid (``orientation``), empty where that is not clear.

    Raises
    ------
    InputsError
        Of a `FaultError`: the patches fit the mesh only if they are laid otherwise, or not at all.
    """
    half = round(_REACH / _STEP)
    steps = np.arange(-half, half + 1) * _STEP * patch_mm
    looks = np.array([_laid(scans[patch].height) for patch in patches.patch])
    maps = _correlations(surface, patches, looks, patch_mm, steps)
    as_given, mould = maps[:, 0], Mould(invert, flip)
    correlation = as_given[:, half, half]
    if len(patches) < _FEWEST_PATCHES:
        orientation = _unmoved_orientation(maps)
        if orientation:
            fault = _orientation_fault(orientation, correlation.mean(), mould)
            raise_unless_accepted([fault], accept)
        return _table(patches, correlation, orientation)
    shared = _shared_shift(as_given, steps)
    if shared.is_sure:
        row, column = (np.abs(steps - along).argmin() for along in shared.shift)
        correlation = as_given[:, row, column]
    orientation = _orientation(maps)
    table = _table(patches, correlation, orientation, shared)
    if orientation not in ("", AS_GIVEN):
        faults = [_orientation_fault(orientation, correlation.mean(), mould)]
    elif apart := _laid_apart(patches, maps, mould):
        faults = apart  # what else does not fit may follow from these
    elif correlation.mean() < _LOW and _tells(surface, patches, looks[:, 0], patch_mm):
        faults = [*_table_faults(surface, patches, looks[:, 0], patch_mm, correlation)]
    else:
        faults = []
    if not faults:
        _warn_of_places(correlation.mean(), shared)
    raise_unless_accepted(faults, accept)
    elsewhere = table[table.status == ELSEWHERE]
    if len(elsewhere):
        _log.warning(
            "patch%s %s: no correlation with the macroscale (at most %.2f): check the place in the "
            "patch table, and whether the scan is that of another patch",
            "es" * (len(elsewhere) > 1),
            ", ".join(elsewhere.patch),
            elsewhere.correlation.max(),
        )
    return table


def shows_waves(surface: xr.DataArray, patch_mm: float) -> bool:
    """Whether the edges of the mesh, where they are known, show waves as long as a patch."""
    return bool(WAVE_PER_EDGE * surface.attrs.get("mesh_edge_mm", 0.0) <= patch_mm)


def _is_elsewhere(correlation: np.ndarray) -> bool:
    """Whether patches correlate no better than others would that lie anywhere."""
    error = correlation.std(ddof=1) / np.sqrt(correlation.size)
    least = scipy.special.stdtrit(correlation.size - 1, 1 - _SIGNIFICANCE) * error
    return bool(correlation.mean() < min(least, _LOW))


def _tells(
    surface: xr.DataArray, patches: pd.DataFrame, scans: np.ndarray, patch_mm: float
) -> bool:
    """Whether the mesh is rough enough to contradict scans (patches, points, points)."""
    under = _under(spline_of(surface), patches, patch_mm)
    mesh, scan = (np.linalg.norm(_flat(heights), axis=-1) for heights in (under, scans))
    return shows_waves(surface, patch_mm) and bool(np.median(mesh) > _SMOOTH * np.median(scan))


def _table_faults(
    surface: xr.DataArray,
    patches: pd.DataFrame,
    scans: np.ndarray,
    patch_mm: float,
    correlation: np.ndarray,
) -> Iterator[FaultError]:
    """Of a table that fits the mesh if it is mirrored or turned, or whose patches are elsewhere."""
    size_mm = float(surface.x[0] + surface.x[-1])  # the square lies in the middle of the face
    looks, spline = _level(scans), spline_of(surface)
    x, y = (patches[column] / size_mm for column in ("x_mm", "y_mm"))
    fits = {}
    for name, given in _TABLES.items():
        other = dict(zip(("x_mm", "y_mm"), (size_mm * of for of in given(x, y)), strict=True))
        under = _level(_under(spline, patches.assign(**other), patch_mm))
        fits[name] = float(np.mean(np.sum(looks * under, axis=-1)))
    best, mean = max(fits, key=lambda name: fits[name]), correlation.mean()
    problem = (
        "they do not lie where the table says: they correlate with the mesh under them by "
        f"{mean:.2f} on average"
    )
    # some patches of a grid lie on the axis about which their table was mirrored
    by_chance = max(_LOW, _BY_CHANCE_UNMOVED / np.sqrt(len(patches)), mean + _CLEAR_LEAD)
    if fits[best] > by_chance:
        remedy = f"They fit ({fits[best]:.2f}) with {best}: correct the patch table so."
        yield FaultError(FAULT, "patches", problem, remedy)
    elif _is_elsewhere(correlation):
        problem += ", no more than patches from anywhere would"
        remedy = (
            "Check x_mm and y_mm of the patch table, square.points_mm, and the units of mesh and "
            "scans."
        )
        yield FaultError(FAULT, "patches", problem, remedy)


class Mould(NamedTuple):
    """How moulds were undone: whether heights were inverted, and along which axis turned over."""

    invert: bool
    flip: str | None


class _Shift(NamedTuple):
    """The shift (y, x) that all patches share, its standard errors, mm, and its p-value."""

    shift: np.ndarray
    errors: np.ndarray
    p_value: float

    @property
    def is_sure(self) -> bool:
        return self.p_value < _SIGNIFICANCE

    @property
    def along_x_and_y(self) -> tuple[np.ndarray, np.ndarray]:
        """Shift and errors along x and y, µm."""
        return 1e3 * self.shift[::-1], 1e3 * self.errors[::-1]


def _table(
    patches: pd.DataFrame,
    correlation: np.ndarray,
    orientation: str,
    shared: _Shift | None = None,
) -> pd.DataFrame:
    """The result of `place_patches`; of too few patches nothing is shared."""
    last, mean = len(patches), correlation.mean()
    names, correlations = [*patches.patch, ALL], [*correlation, mean]
    table = pd.DataFrame({"patch": names, "correlation": correlations})
    table = table.reindex(columns=[*table, *_SHIFT]).assign(status=CANNOT_TELL, orientation="")
    table.loc[last, "orientation"] = orientation
    if shared is None:
        return table
    table.loc[last, _SHIFT] = np.concatenate(shared.along_x_and_y)
    if mean >= _LOW:
        each = np.where(correlation < _ELSEWHERE, ELSEWHERE, AGREES)
        together = SHIFTED if shared.is_sure else AGREES
        table["status"] = [*each, together if np.isfinite(shared.p_value) else CANNOT_TELL]
    return table


def _warn_of_places(correlation: float, shared: _Shift) -> None:
    """Warn where few patches, or none, may lie where the table says, or all are shifted."""
    if correlation < _LOW:
        _log.warning(
            "the patches together correlate with the macroscale by no more than %.2f: either the "
            "mesh is too smooth to show them, or few lie where the patch table says; check its "
            "x_mm and y_mm, square.points_mm, and the units of mesh and scans",
            correlation,
        )
    elif shared.is_sure:
        (x, y), (error_x, error_y) = shared.along_x_and_y
        _log.warning(
            "all patches together fit the macroscale best when shifted in x by %+.0f ± %.0f µm and "
            "y by %+.0f ± %.0f µm: check square.points_mm, or add this to the patch table",
            *(x, error_x, y, error_y),
        )


def _correlations(
    surface: xr.DataArray,
    patches: pd.DataFrame,
    looks: np.ndarray,
    patch_mm: float,
    steps: np.ndarray,
) -> np.ndarray:
    """Correlation (patches, orientations, k, k) of scans and square, at shifts (mm) along y, x.

    `looks` (patches, orientations, points, points) are the scans, from `_laid`.
    """
    looks, spline = _level(looks), spline_of(surface)
    found = np.empty((*looks.shape[:2], len(steps), len(steps)))
    for row, column in np.ndindex(found.shape[2:]):
        shifted = moved(patches, (steps[row], steps[column]), surface, patch_mm)
        under = _level(_under(spline, shifted, patch_mm))
        found[:, :, row, column] = np.einsum("pln,pn->pl", looks, under)
    return np.concatenate([found, -found], axis=1)


def _under(
    spline: "scipy.interpolate.RectBivariateSpline", patches: pd.DataFrame, patch_mm: float
) -> np.ndarray:
    """Heights (patches, points, points) of the square under each patch."""
    places = places_of(patches).values()
    return np.array([on_patch(spline, place, 2 * (_POINTS,), patch_mm) for place in places])


def _laid(height: xr.DataArray) -> list[np.ndarray]:
    """A scan on coarse points, laid in each of the ways."""
    from skimage.transform import resize_local_mean

    coarse = resize_local_mean(height.values, 2 * (_POINTS,))
    return [oriented(coarse, name) for name in ORIENTATIONS]


def oriented(heights: np.ndarray, name: str) -> np.ndarray:
    """Heights (ny, nx) laid in one of the `ORIENTATIONS`."""
    reversed_x, turn = ORIENTATIONS[name]
    return np.rot90(heights[:, ::-1] if reversed_x else heights, -turn // 90)


def _flat(heights: np.ndarray) -> np.ndarray:
    """Heights (..., points, points) less their planes, as vectors."""
    y, x = np.indices(2 * (_POINTS,))
    powers = np.stack([np.ones_like(x), y, x], axis=-1)
    planes, _ = np.linalg.qr(powers.reshape(-1, 3))
    flat = heights.reshape(*heights.shape[:-2], -1)
    return flat - flat @ planes @ planes.T


def _level(heights: np.ndarray) -> np.ndarray:
    """Heights (..., points, points) less their planes, as vectors of length 1; flat ones are 0."""
    flat = _flat(heights)
    length = np.linalg.norm(flat, axis=-1, keepdims=True)
    return flat / np.where(length > 0, length, 1.0)


def _shared_shift(maps: np.ndarray, steps: np.ndarray) -> _Shift:
    """Shift at the peak of the mean of maps (patches, k, k).

    The errors are those of the jackknife over the patches, the test is Hotelling's.
    """
    number, total = len(maps), maps.sum(axis=0)
    shift = _peak(total, steps)
    without = [_peak(total - one, steps) for one in maps]
    covariance = (number - 1) * np.cov(without, rowvar=False, bias=True)
    errors = np.sqrt(np.diag(covariance))
    if not errors.all() or np.isnan(errors).any():
        return _Shift(shift, errors, np.nan)
    ratio = shift @ np.linalg.solve(covariance, shift) / 2 * (number - 2) / (number - 1)
    return _Shift(shift, errors, float(scipy.special.fdtrc(2, number - 2, ratio)))


def _peak(values: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Place (y, x) of the highest of values (k, k), by parabolas; NaN if it is at the edge."""
    row, column = np.unravel_index(values.argmax(), values.shape)
    if min(row, column) == 0 or max(row, column) == len(steps) - 1:
        return np.full(2, np.nan)
    shift = []
    for at, along in ((row, values[:, column]), (column, values[row])):
        before, top, after = along[at - 1 : at + 2]
        bend = before - 2 * top + after
        step = steps[1] - steps[0]
        shift.append(steps[at] + step * (before - after) / (2 * bend or 1))
    return np.array(shift)


def _orientation(maps: np.ndarray) -> str:
    """Which of `_LOOKS` maps (patches, orientations, k, k) fit clearly best; empty if none does."""
    tops = [np.unravel_index(one.argmax(), one.shape) for one in maps.mean(axis=0)]
    values = np.array([maps[:, look, *top] for look, top in enumerate(tops)])
    fits = values.mean(axis=1)
    second, best = np.argsort(fits)[-2:]
    lead = values[best] - values[second]
    error = lead.std(ddof=1) / np.sqrt(lead.size)
    clear = lead.mean() > scipy.special.stdtrit(lead.size - 1, 1 - _SIGNIFICANCE) * error
    by_chance = max(_LOW, _BY_CHANCE / np.sqrt(len(maps)))
    if clear and (best == 0 or fits[best] > by_chance):
        return _LOOKS[best]
    return _unmoved_orientation(maps)


def _unmoved_orientation(maps: np.ndarray) -> str:
    """Which of `_LOOKS` but the first fits better where the patches are; empty if none does."""
    middle = maps.shape[-1] // 2
    unmoved = maps[:, :, middle, middle].mean(axis=0)
    best = int(unmoved.argmax())
    by_chance = max(_LOW, _BY_CHANCE_UNMOVED / np.sqrt(len(maps)))
    is_better = unmoved[best] > max(by_chance, unmoved[0] + _CLEAR_LEAD)
    return _LOOKS[best] if is_better else ""


def _orientation_fault(orientation: str, correlation: float, mould: Mould) -> FaultError:
    problem = (
        f"they fit the mesh {orientation}, and not as given (correlation {correlation:.2f})"
    )
    return FaultError(FAULT, "patches", problem, _remedy(orientation, mould))


def _laid_apart(patches: pd.DataFrame, maps: np.ndarray, mould: Mould) -> list[FaultError]:
    """Scans of one instrument, as their format tells, that alone are laid wrongly."""
    if "t0" not in patches:
        return []
    kinds = patches.t0.map(lambda name: Path(name).suffix.lower())
    flips = patches["flip"] if "flip" in patches else kinds.map(lambda _: "")
    faults = []
    for (kind, own), rows in patches.groupby([kinds, flips], sort=True).indices.items():
        if not _FEWEST_PATCHES <= len(rows) < len(patches):
            continue
        orientation = _orientation(maps[rows])
        if orientation in ("", AS_GIVEN):
            continue
        flip = {"none": None, "": mould.flip}.get(own, own)
        remedy = _remedy(orientation, mould._replace(flip=flip), in_rows=True)
        names = f"patches {', '.join(patches.patch.iloc[rows])} ({kind})"
        problem = f"they fit the mesh {orientation}, and not as given"
        faults.append(FaultError(FAULT, names, problem, remedy))
    return faults


def _remedy(orientation: str, mould: Mould, *, in_rows: bool = False) -> str:
    """The keys to set so that patches with this orientation, whose mould was undone so, lie right.

    They are those of the config, or those in the patches' rows of the patch table.
    """
    right, turn = lying_right(orientation, mould)
    parts, key, none = [], "scans.mould.flip", "null"
    if in_rows:
        key, none = "flip in their rows of the patch table", "none"
    if right.invert != mould.invert:
        inverted = f"scans.mould.invert to {str(right.invert).lower()}"
        parts.append("the heights in their files to negative ones" if in_rows else inverted)
    if right.flip != mould.flip:
        parts.append(f"{key} to {right.flip or none}")
    said = f"set {' and '.join(parts)}" if parts else ""
    if turn:
        whose = "each" if in_rows else "every patch"
        said += f"{', and ' if said else ''}add {turn} to the rotation_deg of {whose}"
    return f"{said[0].upper()}{said[1:]}."


def lying_right(orientation: str, mould: Mould) -> tuple[Mould, int]:
    """How to undo the moulds of patches with an orientation so that they lie right.

    `orientation` is that of `place_patches`, with the moulds undone as `mould` says. There may be
    degrees to add to the rotation of each patch, too, from -90 to 180.

    >>> lying_right("reversed along y", Mould(invert=False, flip=None))
    (Mould(invert=False, flip='y'), 0)
    """
    laid = orientation.removeprefix("inverted").removeprefix(" and ")
    reversed_x, turn = ORIENTATIONS[laid or AS_GIVEN]
    # to reverse along y is to reverse along x and turn by 180°
    turn += 180 * (mould.flip == "y")
    if reversed_x == (mould.flip is not None):
        flip = None
    else:
        flip = "x" if turn % 360 in (0, 90) else "y"
        turn += 180 * (flip == "y")
    invert = mould.invert != orientation.startswith("inverted")
    return Mould(invert, flip), (turn + 179) % 360 - 179
