"""Check of the positions and orientations of patches in the patch table.

The mesh and a scan show the same stone. At the true position of a patch, their heights differ by no
more than the errors of both. Other ways to position the patches are compared with the given one.
All or some patches may be turned, reversed or inverted, the patch table mirrored or turned, or
scans exchanged. A way that is clearly more likely is a fault, which names the settings to correct.
A patch agrees only if all these ways are clearly less likely. The mesh cannot confirm other
patches.

A small shift of one patch cannot be detected. The position of a patch on the synthetic specimen is
detected to some 45 µm, more than the position errors. A common shift of all patches is detected.
"""

import logging
from collections.abc import Container, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.coupling.comparison import (
    AGREES,
    CANNOT_TELL,
    ELSEWHERE,
    SHIFTED,
    Comparison,
    Shift,
)
from gstlib.coupling.orientations import (
    AS_GIVEN,
    LOOKS,
    Mould,
    remedy_of,
    remedy_of_table,
)
from gstlib.errors import FaultError, InputError, raise_unless_accepted
from gstlib.surfaces.footprints import check_size

__all__ = ["ALL", "FAULT", "check_placement"]

_log = logging.getLogger(__name__)

ALL = "all"  # the row of all patches together
FAULT = "placement"  # as which a config accepts it
_SHIFT = ["shift_x_um", "shift_y_um", "shift_x_error_um", "shift_y_error_um"]
# A mesh with less than this r.m.s. height, relative to the scans, is too smooth to contradict all
# of them.
_SMOOTH = 0.5
# Another position of all patches must fit more than this fraction of them better than no mesh at
# all.
_MOST = 2 / 3


def check_placement(
    surface: xr.DataArray,
    patches: pd.DataFrame,
    scans: Mapping[str, xr.Dataset],
    *,
    patch_mm: float,
    placement_um: float = 30.0,
    invert: bool = False,
    flip: str | None = None,
    accept: Container[str] = (),
) -> pd.DataFrame:
    """Compare each patch with the square under it; impossible positions are a `FAULT`.

    Parameters
    ----------
    surface : (y, x) xarray.DataArray
        Macroscale heights in the frame of the square, mm.
    patches : pandas.DataFrame
        Patch table: ``patch, x_mm, y_mm, rotation_deg``, and optionally ``t0`` and ``flip``. Scans
        of different formats or flips are also tried separately.
    scans : mapping of str to xarray.Dataset
        The prepared T0 scans by patch, with ``height`` (y, x), mm; each is looked up once.
    patch_mm : float
        Side of a patch, mm.
    placement_um : float
        Standard error of the position of a patch along each axis.
    invert, flip
        Reversal of the moulds, as in `gstlib.preprocess.scans.prepare_scan`.
    accept : container of str
        Names of faults that do not stop the study, or ``name:patch``.

    Returns
    -------
    pandas.DataFrame
        A row for each patch, and a row (`ALL`) for all together. ``correlation`` refers to the
        position in the patch table, or after the common shift, if there is one. ``orientation`` is
        empty if it is not clear, and for a single patch also if it is as given. The row of all
        patches also has their common shift (true minus given position, along the axes of the
        square), ``shift_x_um, shift_y_um``, and its standard errors. They are NaN without a peak or
        with fewer than four patches.

    Raises
    ------
    InputsError
        Contains a `FaultError`: patches fit the mesh only in another position, or in none.
    InputError
        A scan is not as large as a patch. There are no patches, or two of one name, or one without
        a position.

    Examples
    --------
    A scan cut out of the square matches its original position:

    >>> import gstlib
    >>> roughness = {"hurst_exponent": 0.8, "roll_off": 1.5}
    >>> heights = gstlib.self_affine_field(np.random.default_rng(1), 64, 0.05, **roughness)
    >>> square = gstlib.make_surface(0.01 * heights, 0.05)
    >>> place = {"patch": ["1"], "x_mm": 1.5, "y_mm": 2.0, "rotation_deg": 0.0}
    >>> scans = {"1": square[30:50, 20:40].to_dataset(name="height")}
    >>> table = gstlib.check_placement(square, pd.DataFrame(place), scans, patch_mm=1.0)
    >>> table.status.tolist()
    ['agrees', 'agrees']
    """
    _check_table(patches)
    heights = [scans[patch].height for patch in patches.patch]
    for patch, height in zip(patches.patch, heights, strict=True):
        check_size(height, patch_mm, f"patch {patch}")
    compared = Comparison(
        surface, patches, heights, patch_mm=patch_mm, placement_um=placement_um
    )
    mould = Mould(invert, flip)
    whole, is_as_given = _of_all(compared, mould)
    ways = whole, _of_instruments(compared, mould), _of_patches(compared, mould)
    claims = max(ways, key=lambda claims: sum(claim.margin for claim in claims))
    table = _table(compared, claims, is_as_given=is_as_given)
    raise_unless_accepted([claim.fault(patches.patch) for claim in claims], accept)
    if not claims:
        _warn_of_places(table, compared.shared)
    return table


def _check_table(patches: pd.DataFrame) -> None:
    """Refuse a patch table without patches, with a name twice, or without a position."""
    names, places = patches.patch, patches[["x_mm", "y_mm", "rotation_deg"]]
    problems = ["has no patches"] * names.empty
    problems += [f"has patch {name} twice" for name in names[names.duplicated()]]
    problems += [
        f"has no position (x_mm, y_mm, rotation_deg) of patch {name}"
        for name in names[places.isna().any(axis=1)]
    ]
    if problems:
        remedy = "Give at least one patch, and each a name and a position of its own."
        raise InputError("patch table", problems[0], remedy)


class _Claim(NamedTuple):
    """Patches that lie otherwise than in the patch table."""

    rows: list[int] | None  # all patches together, if it is None
    margin: float  # of the lead over its limit
    orientation: str
    problem: str
    remedy: str

    def fault(self, names: pd.Series) -> FaultError:
        named = [] if self.rows is None else [*names.iloc[self.rows]]
        source = f"patch{'es' * (len(named) != 1)} {', '.join(named)}".rstrip()
        return FaultError(FAULT, source, self.problem, self.remedy, named)


def _of_all(compared: Comparison, mould: Mould) -> tuple[list[_Claim], bool]:
    """Claims about all patches together, and whether all are as given."""
    (stated, *_), *ways = _ways(compared)
    as_given = min(stated.sum(), compared.as_given.sum())
    anywhere = compared.anywhere.sum()
    limit = compared.limit(1 + len(ways))
    misfits, other, name, mistake = min(ways, key=lambda way: way[0].sum())
    is_as_given = bool(min(misfits.sum(), anywhere) - as_given > limit)
    fit = compared.fits[:, 0].mean()
    margin = min(as_given, anywhere) - misfits.sum() - limit
    if margin > 0 and (misfits < compared.anywhere).mean() > _MOST:
        table = f" with {mistake}" * bool(mistake)
        orientation = f"{name * (name != AS_GIVEN)}{table}".strip()
        problem = _problem("they fit", orientation, other, fit)
        changes = remedy_of_table(mistake, compared.size_mm)
        remedy = remedy_of(name, mould, table=changes)
        return [_Claim(None, margin, orientation, problem, remedy)], False
    margin = as_given - anywhere
    squares = np.median(compared.mesh[..., compared.at])
    is_rough = squares > _SMOOTH**2 * np.median(compared.scan)
    if margin > 0 and compared.shows_waves and is_rough:
        problem = (
            "they do not match the mesh at their positions in the patch table (mean correlation "
            f"{fit:.2f}, no higher than elsewhere)"
        )
        remedy = (
            "Check x_mm and y_mm of the patch table, square.points_mm, and the units of mesh and "
            "scans."
        )
        return [_Claim(None, margin, "", problem, remedy)], False
    return [], is_as_given


def _ways(compared: Comparison) -> list[tuple[np.ndarray, float, str, str]]:
    """Smallest misfits (patches,), mean correlation, look and mistake; first, as given."""
    ways = []
    for mistake, (_, _, products, mesh) in compared.tables.items():
        misfits = compared.misfit(products, mesh)
        fits = compared.correlation(products, mesh).mean(axis=0)
        shifts = misfits.sum(axis=0).argmin(axis=1)
        for look, at in enumerate(shifts):
            ways.append((misfits[:, look, at], fits[look, at], LOOKS[look], mistake))
    return ways


def _of_instruments(compared: Comparison, mould: Mould) -> list[_Claim]:
    """Scans of one file format, hence instrument, that alone have another look."""
    patches = compared.patches
    if "t0" not in patches:
        return []
    patches = patches.assign(
        kind=patches.t0.map(lambda name: Path(name).suffix.lower())
    )
    keys = [name for name in ("kind", "flip") if name in patches]
    groups = patches.groupby(keys).indices
    tests = len(groups) * (len(LOOKS) - 1)
    claims = (
        _in_another_look(compared, [*rows], mould, tests=tests)
        for rows in groups.values()
        if 1 < len(rows) < len(patches)
    )
    return [claim for claim in claims if claim]


def _of_patches(compared: Comparison, mould: Mould) -> list[_Claim]:
    """Exchanged scans, and patches that do not lie as given.

    The latter require that as many others agree. If few agree, the error may concern all.
    """
    status = compared.status
    if (status == CANNOT_TELL).all():
        return []
    claims = [*_exchanged(compared)]
    exchanged = [row for claim in claims for row in claim.rows or []]
    wrong = set(np.flatnonzero(status == ELSEWHERE)) - {*exchanged}
    if len(wrong) > len(exchanged) + (status == AGREES).sum():
        return claims
    tests = len(status) * compared.ways
    for row in sorted(map(int, wrong)):
        claim = _in_another_look(compared, [row], mould, tests=tests)
        if claim is None:
            problem = (
                "its scan does not match the mesh at its position in the patch table (correlation "
                f"{compared.fits[row, 0]:.2f})"
            )
            remedy = "Check its x_mm and y_mm, and that its scan does not show another patch."
            margin = compared.alternatives[row] - compared.limit(tests)
            claim = _Claim([row], margin, "", problem, remedy)
        claims.append(claim)
    return claims


def _in_another_look(
    compared: Comparison, rows: list[int], mould: Mould, *, tests: int
) -> _Claim | None:
    """Patches that all fit in one other look, if that is clear."""
    leads = compared.leads[rows].sum(axis=0)
    best = int(leads.argmax())
    anywhere = max(0.0, compared.lead_anywhere[rows].sum())
    margin = leads[best] - anywhere - compared.limit(tests)
    if margin <= 0:
        return None
    orientation, patches = LOOKS[1 + best], compared.patches.iloc[rows]
    fit, other = compared.fits[rows].mean(axis=0)[[0, 1 + best]]
    problem = _problem(
        "it fits" if len(rows) == 1 else "they fit", orientation, other, fit
    )
    remedy = remedy_of(orientation, mould, patches)
    if len(rows) == 1:  # a scan of another place may fit by chance
        remedy += " If its x_mm and y_mm may be wrong, check these first."
    return _Claim(rows, margin, orientation, problem, remedy)


def _exchanged(compared: Comparison) -> Iterator[_Claim]:
    """Patches whose scans fit at each other's positions, two or more in a ring."""
    across = compared.across
    # The limit of a longer ring grows with the number of such rings.
    for_each = compared.limit(len(across) ** 2) / 2
    row, place = scipy.optimize.linear_sum_assignment(across)
    moves = scipy.sparse.csr_array((place != row, (row, place)))
    _, rings = scipy.sparse.csgraph.connected_components(moves)
    names = compared.patches.patch.to_numpy()
    for ring in np.unique(rings[place != row]):
        rows = [*np.flatnonzero(rings == ring)]
        leads = across[rows, rows] - across[rows, place[rows]]
        anywhere = max(0.0, compared.lead_anywhere[rows].sum())
        margin = leads.sum() - anywhere - for_each * len(rows)
        if min(margin, *leads) <= 0:
            continue
        problem = (
            "their scans fit the mesh at each other's positions, but not at their own (correlation "
            f"{compared.fits[rows, 0].mean():.2f})"
        )
        at = ", ".join(
            f"{names[one]} at the position of {names[place[one]]}" for one in rows
        )
        remedy = f"Exchange their x_mm, y_mm and rotation_deg, or the names of their scans: {at}."
        yield _Claim(rows, margin, "", problem, remedy)


def _problem(they_fit: str, orientation: str, other: float, fit: float) -> str:
    return (
        f"{they_fit} the mesh {orientation} (correlation {other:.2f}), but not in the present "
        f"orientation ({fit:.2f})"
    )


def _table(
    compared: Comparison, claims: list[_Claim], *, is_as_given: bool
) -> pd.DataFrame:
    """The result of `check_placement`."""
    correlation = compared.fits[:, 0]
    shared = compared.shared
    each = len(correlation)
    together = SHIFTED if shared.is_sure else AGREES
    tells = is_as_given and compared.shows_waves
    orientation = np.array([*each * [""], AS_GIVEN * is_as_given], dtype=object)
    for claim in claims:
        orientation[claim.rows or each] = claim.orientation
    shift = zip(_SHIFT, shared.in_um, strict=True)
    return pd.DataFrame(
        {
            "patch": [*compared.patches.patch, ALL],
            "correlation": [*correlation, correlation.mean()],
            **{name: [*each * [np.nan], value] for name, value in shift},
            "status": [*compared.status, together if tells else CANNOT_TELL],
            "orientation": orientation,
        }
    )


def _warn_of_places(table: pd.DataFrame, shared: Shift) -> None:
    """Warn if the mesh does not show the positions of the patches, or if all are shifted."""
    together = table.iloc[-1]
    if together.orientation != AS_GIVEN:
        _log.warning(
            "the patches together correlate with the macroscale by %.2f, which does not confirm "
            "their positions. Either the mesh is too smooth or too coarse, or most positions are "
            "wrong. Check x_mm and y_mm, square.points_mm, and the units of mesh and scans",
            together.correlation,
        )
    elif shared.is_sure:
        x, y, error_x, error_y = shared.in_um
        _log.warning(
            "all patches together fit the macroscale best when shifted in x by %+.0f ± %.0f µm and "
            "y by %+.0f ± %.0f µm. Check square.points_mm, or add this to the patch table",
            *(x, error_x, y, error_y),
        )
