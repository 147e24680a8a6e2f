"""Do the patches lie where the patch table says?

The mesh and a scan show the same stone, so where a patch truly lies their heights differ by no more
than the errors of both. Each other way to lay the patches is compared with the stated one: all
patches or some turned, reversed or inverted, the patch table mirrored or turned, scans exchanged. A
way that is clearly more likely is a fault, which names what to set. A patch agrees only if all
these ways are clearly less likely. Of any other patch the mesh cannot tell.

A small shift of one patch cannot be detected: on the synthetic specimen one patch is found to some
45 µm, more than its patches are misplaced. A shift that all patches share is found.
"""

import itertools
import logging
import math
from collections.abc import Container, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.errors import FaultError, raise_unless_accepted
from gstlib.surfaces.fitting import planes_over, vertex
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
__all__ += ["TABLES", "WAVE_PER_EDGE", "Mould", "as_measured", "lying_right", "oriented"]
__all__ += ["place_patches", "shows_waves"]

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
_OTHER_LOOKS = _LOOKS[1:]
# Mistakes of a patch table: whether x_mm and y_mm are exchanged, and whether x_mm and y_mm are then
# measured from the other side of the square.
TABLES = {
    "": (False, False, False),
    "x_mm measured from the other side": (False, True, False),
    "y_mm measured from the other side": (False, False, True),
    "x_mm and y_mm measured from the other sides": (False, True, True),
    "x_mm and y_mm exchanged": (True, False, False),
    "x_mm and y_mm exchanged, then x_mm measured from the other side": (True, True, False),
    "x_mm and y_mm exchanged, then y_mm measured from the other side": (True, False, True),
    "x_mm and y_mm exchanged, then both measured from the other sides": (True, True, True),
}
# One right study in a hundred may be called wrong, or shifted.
_SIGNIFICANCE = 0.01
# ASSUME: a patch shows the error of scan and mesh by three independent waves. On synthetic stones
# its estimates scatter so. The median of such estimates is 0.79 of their mean.
_WAVES, _MEDIAN_OF_WAVES = 3, 0.79
_LEAST_VARIANCE = 1e-14  # mm², so that equal surfaces can be compared
# A mesh that is less than so high, beside the scans (r.m.s.), is too smooth to contradict them all.
_SMOOTH = 0.5
# Another way to lay all patches must fit more of them than this better than no mesh at all.
_MOST = 2 / 3
# Points along a patch's side at which surfaces are compared: shorter waves the mesh does not hold.
_POINTS = 24
# Shifts tried along each axis, in sides of a patch: up to 0.2 mm in steps of 35 µm for the paper's,
# where a peak is 0.2 mm wide. A mistaken table is tried with shifts of 0.1 mm along either axis.
_ALONG = np.arange(-6, 7) / 24
_SHIFTS = np.array([*itertools.product(_ALONG, repeat=2)])
_FEW_SHIFTS = np.array([(0, 0), (-3, 0), (3, 0), (0, -3), (0, 3)]) / 24
# ASSUME: a patch lies within so many standard errors of its stated place.
_ERRORS = 2.0
# Fewer patches have no scatter by which a shift that all share could be told from chance.
_FEWEST_PATCHES = 4


def place_patches(
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
    """Compare each patch with the square under it; places that cannot be right are a `FAULT`.

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
    placement_um : float
        Standard error of a patch's place along each axis.
    invert, flip
        How their moulds were undone, as in `gstlib.preprocess.scans.prepare_scan`.
    accept : container of str
        Names of faults that do not stop the study, or ``name:patch``.

    Returns
    -------
    pandas.DataFrame
        A row for each patch, and one (`ALL`) for all together: ``correlation`` where the patch
        table puts them, or, where all are shifted, after that shift; ``status``; and how they look
        laid (``orientation``), empty where that is not clear, and of a patch alone if it is as
        given. For all together also the shift that they share (true less stated place, along the
        square's axes), ``shift_x_um, shift_y_um``, and its standard errors, NaN where there is no
        peak or there are fewer than four patches.

    Raises
    ------
    InputsError
        Of a `FaultError`: patches fit the mesh only if they are laid otherwise, or not at all.
    """
    coarse = np.array([_coarse(scans[patch].height) for patch in patches.patch])
    looks = _flat(_in_each_look(coarse))
    compared = _Compared(surface, patches, looks, patch_mm=patch_mm, placement_um=placement_um)
    mould = Mould(invert, flip)
    whole, is_as_given = _of_all(compared, mould)
    ways = whole, _of_instruments(compared, mould), _of_patches(compared, mould)
    claims = max(ways, key=lambda claims: sum(claim.margin for claim in claims))
    table = _table(compared, claims, is_as_given=is_as_given)
    names = [*patches.patch]
    raise_unless_accepted([claim.fault(names) for claim in claims], accept)
    if not claims:
        _warn_of_places(table, compared.shared)
    return table


def shows_waves(surface: xr.DataArray, patch_mm: float) -> bool:
    """Whether the edges of the mesh, where they are known, show waves as long as a patch."""
    return bool(WAVE_PER_EDGE * surface.attrs.get("mesh_edge_mm", 0.0) <= patch_mm)


def as_measured(x: Any, y: Any, size_mm: float, mistake: str) -> tuple[Any, Any]:
    """The right x and y from those of a patch table that has one of the mistakes in `TABLES`."""
    is_exchanged, other_x, other_y = TABLES[mistake]
    if is_exchanged:
        x, y = y, x
    return (size_mm - x if other_x else x), (size_mm - y if other_y else y)


class Mould(NamedTuple):
    """How moulds were undone: whether heights were inverted, and along which axis turned over."""

    invert: bool
    flip: str | None


class _Claim(NamedTuple):
    """Patches lie otherwise than as given."""

    rows: list[int] | None  # all patches together, if it is None
    margin: float  # of the lead over its limit
    orientation: str
    problem: str
    remedy: str

    def fault(self, names: Sequence[str]) -> FaultError:
        named = [] if self.rows is None else [names[row] for row in self.rows]
        source = f"patch{'es' * (len(named) != 1)} {', '.join(named)}".rstrip()
        return FaultError(FAULT, source, self.problem, self.remedy, named)


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


class _Compared:
    """Scans and the mesh under them, and how likely it is that the scans lie otherwise.

    The error of scan and mesh is taken as normal. A misfit is the negative logarithm of a
    likelihood: half the squared error over its variance. A lead is how much smaller a misfit is
    than the one as given, in nats.
    """

    def __init__(
        self,
        surface: xr.DataArray,
        patches: pd.DataFrame,
        looks: np.ndarray,
        *,
        patch_mm: float,
        placement_um: float,
    ):
        self.surface, self.patches, self.patch_mm = surface, patches, patch_mm
        self.looks, self.spline = looks, spline_of(surface)
        self.is_few = len(patches) < _FEWEST_PATCHES
        self.scan = np.sum(looks[:, 0] ** 2, axis=-1)
        shifts = _SHIFTS * patch_mm
        self.products, self.mesh = self.products_at(patches, shifts)
        maps = self.correlation(self.products[:, 0], self.mesh).reshape(-1, *2 * _ALONG.shape)
        self.shared = _shared_shift(maps, patch_mm * _ALONG)
        off = np.hypot(*(shifts - (self.shared.shift if self.shared.is_sure else 0)).T)
        self.at = int(off.argmin())
        self.under = self._under(moved(patches, shifts[self.at], surface, patch_mm))
        self.fits = self.correlation(self.products[..., self.at], self.mesh[:, [self.at]])
        self.gain, self.variance = self._errors()
        # as given, each patch may be misplaced
        misfits = self.misfit(self.products[:, 0], self.mesh)
        near = off <= max(off[self.at], _ERRORS * placement_um * 1e-3)
        self.as_given = misfits[:, near].min(axis=-1)
        there = self.misfit(self.products[..., self.at], self.mesh[:, [self.at]])
        self.leads = self.as_given[:, np.newaxis] - there[:, 1:]
        flat = np.zeros(len(patches))
        self.anywhere = self.misfit(flat, flat)
        self.lead_anywhere = self.as_given - self.anywhere

    @property
    def size_mm(self) -> float:
        """Side of the square, which lies in the middle of the face."""
        return float(self.surface.x[0] + self.surface.x[-1])

    def products_at(
        self, patches: pd.DataFrame, shifts: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Products of scan and mesh (patches, looks, k), and squares of the mesh (patches, k).

        They are means over the points, mm², at shifts (k, 2) of all patches along y and x, mm.
        """
        products = np.empty((*self.looks.shape[:2], len(shifts)))
        squares = np.empty((len(products), len(shifts)))
        for number, shift in enumerate(shifts):
            under = self._under(moved(patches, shift, self.surface, self.patch_mm))
            products[..., number] = np.einsum("pln,pn->pl", self.looks, under)
            squares[:, number] = np.sum(under**2, axis=-1)
        return np.concatenate([products, -products], axis=1), squares

    def correlation(self, products: np.ndarray, mesh: np.ndarray) -> np.ndarray:
        """Correlation from (patches, ...) products and squares of the mesh; of flat ones, 0."""
        size = np.sqrt(_beside(self.scan, products) * mesh)
        return products / np.where(size > 0, size, np.inf)

    def misfit(self, products: np.ndarray, mesh: np.ndarray) -> np.ndarray:
        """Misfit from (patches, ...) products and squares of the mesh."""
        scan, variance = (_beside(each, products) for each in (self.scan, self.variance))
        return (scan / self.gain**2 - 2 * products / self.gain + mesh) / (2 * variance)

    def limit(self, tests: int) -> float:
        """The lead that the best of so many wrong ways has in one right study of a hundred.

        Under a normal error, the lead of a wrong way exceeds q²/2 no more often than a normal
        number exceeds q. Student's t stands for it, because the variance is estimated.
        """
        freedom = _WAVES * len(self.scan)
        return float(scipy.special.stdtrit(freedom, 1 - _SIGNIFICANCE / tests) ** 2 / 2)

    @cached_property
    def across(self) -> np.ndarray:
        """Misfit (patches, patches) of each scan at the place of each patch."""
        misfits = self.misfit(self.looks[:, 0] @ self.under.T, np.sum(self.under**2, axis=-1))
        np.fill_diagonal(misfits, self.as_given)
        return misfits

    @cached_property
    def alternatives(self) -> np.ndarray:
        """Highest lead (patches,) of another look, of another patch's place, or of any place."""
        others = self.as_given[:, np.newaxis] - self.across
        np.fill_diagonal(others, -np.inf)
        return np.column_stack([self.leads, others, self.lead_anywhere]).max(axis=1)

    @property
    def status(self) -> np.ndarray:
        """Status of each patch."""
        number = len(self.alternatives)
        each = number + len(_LOOKS) - 1  # the ways of one patch
        status = np.full(number, CANNOT_TELL, dtype=object)
        if shows_waves(self.surface, self.patch_mm):
            status[self.alternatives < -self.limit(each)] = AGREES
            status[self.alternatives > self.limit(number * each)] = ELSEWHERE
        return status

    def _under(self, patches: pd.DataFrame) -> np.ndarray:
        """Heights (patches, points) of the square under each patch."""
        size, places = 2 * (_POINTS,), places_of(patches).values()
        under = [on_patch(self.spline, place, size, self.patch_mm) for place in places]
        return _flat(np.array(under))

    @cached_property
    def tables(self) -> dict[str, tuple[pd.DataFrame, np.ndarray, np.ndarray, np.ndarray]]:
        """For each of `TABLES`, the right patches, shifts that all may share, and `products_at`."""
        patches, at = self.patches, [self.at] if self.is_few else slice(None)
        shifts = self.patch_mm * _SHIFTS[at]
        tables = {"": (patches, shifts, self.products[..., at], self.mesh[:, at])}
        shifts = self.patch_mm * _FEW_SHIFTS[: 1 if self.is_few else None]
        for mistake in [*TABLES][1:]:
            x, y = as_measured(patches.x_mm, patches.y_mm, self.size_mm, mistake)
            right = patches.assign(x_mm=x, y_mm=y)
            tables[mistake] = right, shifts, *self.products_at(right, shifts)
        return tables

    def _exchanged(self) -> tuple[pd.DataFrame, np.ndarray, np.ndarray, np.ndarray]:
        """As one of the `tables`, with each scan at the patch's place that suits it best."""
        squares = np.sum(self.under**2, axis=-1)
        fits = self.correlation(self.looks[:, 0] @ self.under.T, squares)
        _, place = scipy.optimize.linear_sum_assignment(-fits)
        columns = ["x_mm", "y_mm", "rotation_deg"]
        patches = self.patches.assign(**self.patches.iloc[place][columns].to_dict("list"))
        shifts = self.patch_mm * _SHIFTS[[self.at]]
        return patches, shifts, *self.products_at(patches, shifts)

    def _errors(self) -> tuple[float, np.ndarray]:
        """Gain of the scans over the mesh, and the variance of each patch's error along a wave.

        They are those in the table, or with the exchanges, and of each patch in the look, that fit
        best, which need not be the ones as given. The error of a patch is taken along the waves by
        which the looks of the mesh differ. The variance is the mean of its own and of the usual one
        among the patches.
        """
        best, under = self.fits, self.under
        for patches, shifts, products, mesh in [*self.tables.values(), self._exchanged()][1:]:
            fits = self.correlation(products, mesh[:, np.newaxis])
            at = fits.max(axis=1).sum(axis=0).argmax()
            if fits[..., at].max(axis=1).sum() > best.max(axis=1).sum():
                best = fits[..., at]
                under = self._under(moved(patches, shifts[at], self.surface, self.patch_mm))
        rows, look = np.arange(len(best)), best.argmax(axis=1)
        sign = np.where(look < len(ORIENTATIONS), 1, -1)[:, np.newaxis]
        laid = sign * self.looks[rows, look % len(ORIENTATIONS)]
        mesh = np.maximum(np.sum(under**2, axis=-1), _LEAST_VARIANCE)
        gain = float(np.median(np.sum(laid * under, axis=-1) / mesh)) or 1.0
        turned = _in_each_look(under.reshape(-1, _POINTS, _POINTS)).reshape(self.looks.shape)
        waves = np.concatenate([turned, -turned], axis=1)[:, 1:] - under[:, np.newaxis]
        squares = np.sum(waves**2, axis=-1)
        along = np.einsum("pn,pwn->pw", laid / gain - under, waves) ** 2
        own = np.mean(along / np.where(squares > 0, squares, np.inf), axis=1)
        variance = (own + np.median(own) / _MEDIAN_OF_WAVES) / 2
        return gain, np.maximum(variance, _LEAST_VARIANCE)


def _beside(each: np.ndarray, values: np.ndarray) -> np.ndarray:
    """A number for each patch, with the dimensions of (patches, ...) values."""
    return each.reshape(-1, *(1,) * (values.ndim - 1))


def _of_all(compared: _Compared, mould: Mould) -> tuple[list[_Claim], bool]:
    """All patches in another look, in a mistaken table, or anywhere; whether all are as given."""
    ways = {}
    for mistake, (_, _, products, mesh) in compared.tables.items():
        misfits = compared.misfit(products, mesh[:, np.newaxis])
        fits = compared.correlation(products, mesh[:, np.newaxis]).mean(axis=0)
        shifts = misfits.sum(axis=0).argmin(axis=1)
        for look, at in enumerate(shifts):
            ways[_LOOKS[look], mistake] = misfits[:, look, at], fits[look, at]
    as_given = min(ways[AS_GIVEN, ""][0].sum(), compared.as_given.sum())
    anywhere, limit = compared.anywhere.sum(), compared.limit(len(ways))
    best = min([*ways][1:], key=lambda way: ways[way][0].sum())
    misfits, other = ways[best]
    is_as_given = bool(min(misfits.sum(), anywhere) - as_given > limit)
    fit = compared.fits[:, 0].mean()
    margin = min(as_given, anywhere) - misfits.sum() - limit
    if margin > 0 and (misfits < compared.anywhere).mean() > _MOST:
        name, mistake = best
        table = f" with {mistake}" * bool(mistake)
        orientation = f"{name * (name != AS_GIVEN)}{table}".strip()
        problem = _problem("they fit", orientation, other, fit)
        remedy = _remedy(name, mould, table=_of_table(mistake, compared.size_mm))
        return [_Claim(None, margin, orientation, problem, remedy)], False
    margin = as_given - anywhere
    if margin > 0 and _contradicts(compared):
        problem = (
            "they do not lie where the table says: they correlate with the mesh under them by "
            f"{fit:.2f} on average, no more than patches from anywhere would"
        )
        remedy = (
            "Check x_mm and y_mm of the patch table, square.points_mm, and the units of mesh and "
            "scans."
        )
        return [_Claim(None, margin, "", problem, remedy)], False
    return [], is_as_given


def _contradicts(compared: _Compared) -> bool:
    """Whether the mesh is fine and rough enough to contradict all scans together."""
    ratio = math.sqrt(np.median(compared.mesh[:, compared.at]) / np.median(compared.scan))
    return shows_waves(compared.surface, compared.patch_mm) and ratio > _SMOOTH


def _of_instruments(compared: _Compared, mould: Mould) -> list[_Claim]:
    """Scans of one instrument, as their format tells, that alone are in another look."""
    patches = compared.patches
    if "t0" not in patches:
        return []
    kinds = patches.t0.map(lambda name: Path(name).suffix.lower())
    flips = patches["flip"] if "flip" in patches else kinds.map(lambda _: "")
    groups = patches.groupby([kinds, flips], sort=True).indices.values()
    claims = (
        _in_another_look(compared, [*rows], mould, tests=len(groups) * len(_OTHER_LOOKS))
        for rows in groups
        if 1 < len(rows) < len(patches)
    )
    return [claim for claim in claims if claim]


def _of_patches(compared: _Compared, mould: Mould) -> list[_Claim]:
    """Scans that are exchanged, and patches that do not lie as given.

    The latter only where as many others agree: where few do, the error may be that of all.
    """
    status, number = compared.status, len(compared.scan)
    if (status == CANNOT_TELL).all():
        return []
    claims = [*_exchanged(compared)]
    exchanged = [row for claim in claims for row in claim.rows or []]
    wrong = set(np.flatnonzero(status == ELSEWHERE)) - {*exchanged}
    if len(wrong) > len(exchanged) + (status == AGREES).sum():
        return claims
    for row in sorted(map(int, wrong)):
        tests = number * (number + len(_OTHER_LOOKS))
        claim = _in_another_look(compared, [row], mould, tests=tests)
        claims.append(claim or _not_there(compared, row, tests=tests))
    return claims


def _in_another_look(
    compared: _Compared, rows: list[int], mould: Mould, *, tests: int
) -> _Claim | None:
    """Patches that all fit in one other look, if that is clear."""
    leads = compared.leads[rows].sum(axis=0)
    best = int(leads.argmax())
    anywhere = max(0.0, compared.lead_anywhere[rows].sum())
    margin = leads[best] - anywhere - compared.limit(tests)
    if margin <= 0:
        return None
    orientation, patches = _OTHER_LOOKS[best], compared.patches.iloc[rows]
    fit, other = compared.fits[rows].mean(axis=0)[[0, 1 + best]]
    problem = _problem("it fits" if len(rows) == 1 else "they fit", orientation, other, fit)
    return _Claim(rows, margin, orientation, problem, _remedy(orientation, mould, patches))


def _not_there(compared: _Compared, row: int, *, tests: int) -> _Claim:
    """A patch that does not fit where it is, in no look that is clear."""
    problem = (
        "its scan does not fit the mesh where the table puts it (correlation "
        f"{compared.fits[row, 0]:.2f})"
    )
    remedy = "Check its x_mm and y_mm, and whether its scan is that of another place."
    margin = compared.alternatives[row] - compared.limit(tests)
    return _Claim([row], margin, "", problem, remedy)


def _exchanged(compared: _Compared) -> Iterator[_Claim]:
    """Patches whose scans fit at each other's places, two or more in a ring."""
    across = compared.across
    # the limit of a longer ring grows with the number of such rings
    for_each = compared.limit(len(across) ** 2) / 2
    _, place = scipy.optimize.linear_sum_assignment(across)
    left = {row for row, at in enumerate(place) if at != row}
    while left:
        ring = [left.pop()]
        while (following := int(place[ring[-1]])) != ring[0]:
            ring.append(following)
        left -= {*ring}
        leads = across[ring, ring] - across[ring, place[ring]]
        anywhere = max(0.0, compared.lead_anywhere[ring].sum())
        margin = leads.sum() - anywhere - for_each * len(ring)
        if min(margin, *leads) <= 0:
            continue
        rows, names = sorted(ring), compared.patches.patch
        problem = (
            "their scans fit the mesh at each other's places, and not at their own (correlation "
            f"{compared.fits[rows, 0].mean():.2f})"
        )
        at = ", ".join(f"{names.iloc[row]} at that of {names.iloc[place[row]]}" for row in rows)
        remedy = f"Exchange their x_mm and y_mm, or the names of their scans: {at}."
        yield _Claim(rows, margin, "", problem, remedy)


def _problem(they_fit: str, orientation: str, other: float, fit: float) -> str:
    return (
        f"{they_fit} the mesh {orientation} (correlation {other:.2f}), and not as given "
        f"({fit:.2f})"
    )


def _table(compared: _Compared, claims: list[_Claim], *, is_as_given: bool) -> pd.DataFrame:
    """The result of `place_patches`."""
    last, correlation, shared = len(compared.scan), compared.fits[:, 0], compared.shared
    table = pd.DataFrame(
        {
            "patch": [*compared.patches.patch, ALL],
            "correlation": [*correlation, correlation.mean()],
        }
    )
    table = table.reindex(columns=[*table, *_SHIFT])
    table.loc[last, _SHIFT] = np.concatenate(shared.along_x_and_y)
    tells = is_as_given and shows_waves(compared.surface, compared.patch_mm)
    together = SHIFTED if shared.is_sure else AGREES
    table["status"] = [*compared.status, together if tells else CANNOT_TELL]
    table["orientation"] = ""
    table.loc[last, "orientation"] = AS_GIVEN if is_as_given else ""
    for claim in claims:
        table.loc[claim.rows or last, "orientation"] = claim.orientation
    return table


def _warn_of_places(table: pd.DataFrame, shared: _Shift) -> None:
    """Warn where the mesh does not show how the patches lie, or all are shifted."""
    together = table.iloc[-1]
    if together.orientation != AS_GIVEN:
        _log.warning(
            "the patches together correlate with the macroscale by %.2f, which does not show that "
            "they lie as the patch table says: either the mesh is too smooth or too coarse, or few "
            "lie so; check x_mm and y_mm, square.points_mm, and the units of mesh and scans",
            together.correlation,
        )
    elif shared.is_sure:
        (x, y), (error_x, error_y) = shared.along_x_and_y
        _log.warning(
            "all patches together fit the macroscale best when shifted in x by %+.0f ± %.0f µm and "
            "y by %+.0f ± %.0f µm: check square.points_mm, or add this to the patch table",
            *(x, error_x, y, error_y),
        )


def _coarse(height: xr.DataArray) -> np.ndarray:
    """A scan on coarse points."""
    from skimage.transform import resize_local_mean

    return resize_local_mean(height.values, 2 * (_POINTS,))


def _in_each_look(heights: np.ndarray) -> np.ndarray:
    """Heights (patches, points, points) in each orientation, (patches, orientations, ...)."""
    return np.array([[oriented(one, name) for name in ORIENTATIONS] for one in heights])


def oriented(heights: np.ndarray, name: str) -> np.ndarray:
    """Heights (ny, nx) laid in one of the `ORIENTATIONS`."""
    reversed_x, turn = ORIENTATIONS[name]
    return np.rot90(heights[:, ::-1] if reversed_x else heights, -turn // 90)


def _flat(heights: np.ndarray) -> np.ndarray:
    """Heights (..., points, points) less their planes, as vectors of the length of their r.m.s."""
    y, x = np.indices(2 * (_POINTS,))
    planes, _ = np.linalg.qr(planes_over(y, x).reshape(-1, 3))
    flat = heights.reshape(*heights.shape[:-2], -1) / _POINTS
    return flat - flat @ planes @ planes.T


def _shared_shift(maps: np.ndarray, steps: np.ndarray) -> _Shift:
    """Shift at the peak of the mean of maps (patches, k, k).

    The errors are those of the jackknife over the patches, the test is Hotelling's.
    """
    number, total = len(maps), maps.sum(axis=0)
    if number < _FEWEST_PATCHES:
        unknown = np.full(2, np.nan)
        return _Shift(unknown, unknown, np.nan)
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
        shift.append(steps[at] + vertex(along[at - 1 : at + 2], steps[1] - steps[0]))
    return np.array(shift)


def _remedy(
    orientation: str, mould: Mould, rows: pd.DataFrame | None = None, table: Sequence[str] = ()
) -> str:
    """What to set so that patches with this orientation, whose moulds were undone so, lie right.

    These are keys of the config, or cells of the patches' `rows`; and what to do to the `table`.
    """
    whose, invert, flip, none = "every patch", "scans.mould.invert", "scans.mould.flip", "null"
    if rows is not None:
        own = rows["flip"].iloc[0] if "flip" in rows else ""
        mould = mould._replace(flip={"none": None, "": mould.flip}.get(own, own))
        whose = f"patch{'es' * (len(rows) > 1)} {', '.join(rows.patch)}"
        flip, none = f"flip of {whose}", "none"
    is_alone = rows is not None and len(rows) == 1
    right, turn = lying_right(orientation, mould, is_alone=is_alone)
    parts = []
    if right.invert != mould.invert:
        key = f"set {invert} to {str(right.invert).lower()}"
        parts.append(key if rows is None else f"invert the heights in the files of {whose}")
    if right.flip != mould.flip:
        parts.append(f"set {flip} to {right.flip or none}")
    if turn and rows is not None and is_alone:
        total = 180 - (180 - rows.rotation_deg.iloc[0] - turn) % 360  # above -180, up to 180
        parts.append(f"set rotation_deg of {whose} to {total:g}")
    elif turn:
        parts.append(f"add {turn} to the rotation_deg of {whose}")
    said = ", and ".join([*parts, *table])
    return f"{said[0].upper()}{said[1:]}."


def _of_table(mistake: str, size_mm: float) -> list[str]:
    """What to do to the columns of a patch table with a mistake."""
    is_exchanged, *others = TABLES[mistake]
    columns = ["x_mm", "y_mm"]
    sources = columns[::-1] if is_exchanged else columns
    values = [
        f"{size_mm:g} - {source}" if is_other else source
        for source, is_other in zip(sources, others, strict=True)
    ]
    pairs = zip(columns, values, strict=True)
    cells = [f"{column} to {value}" for column, value in pairs if column != value]
    return [f"set {' and '.join(cells)} in every row"] * bool(cells)


def lying_right(orientation: str, mould: Mould, *, is_alone: bool = False) -> tuple[Mould, int]:
    """How to undo the moulds of patches with an orientation so that they lie right.

    `orientation` is that of `place_patches`, with the moulds undone as `mould` says. There may be
    degrees to add to the rotation of each patch, too, from -90 to 180. A half turn is one of the
    mould, which is flipped along the other axis, or, if `is_alone`, one of the patch.

    >>> lying_right("reversed along y", Mould(invert=False, flip=None))
    (Mould(invert=False, flip='y'), 0)
    """
    laid = orientation.removeprefix("inverted").removeprefix(" and ")
    reversed_x, turn = ORIENTATIONS[laid or AS_GIVEN]
    invert = mould.invert != orientation.startswith("inverted")
    if is_alone and not reversed_x:
        return Mould(invert, mould.flip), (turn + 179) % 360 - 179
    # to reverse along y is to reverse along x and turn by 180°
    turn += 180 * (mould.flip == "y")
    if reversed_x == (mould.flip is not None):
        flip = None
    else:
        flip = "x" if turn % 360 in (0, 90) else "y"
        turn += 180 * (flip == "y")
    return Mould(invert, flip), (turn + 179) % 360 - 179
