"""How a tool was used, read from its wear: where it was pressed, and against how round a tool.

A use is a centre of the load points, how they scatter about it, and the radius of the active tool.
Contacts of single strikes are solved in equilibrium (`gstlib.use.sampling`), and the pressures of a
use are means over its strikes (`gstlib.use.spread`). A use whose pressures go with the wear of the
patches counts more. The prediction for a patch weighs the draws by the wear of the *other* patches
alone.

Something always fits best. So a use has competitors that know no contact, which predict each loss
from the others likewise (`gstlib.use.competitors`). It is claimed only where it predicts better
than each of them.
"""

# ASSUME: a loss knows the force through the wear coefficient alone, and a round contact depends on
# F R / E*. So the radius is inferred for the force and the modulus as stated. Beforehand it is
# known but for a lognormal error, and the centre but for a normal one, alike along both axes.
# ASSUME: of two radii, the ratio and the direction are known.
# ASSUME: a loss goes with the pressure after it, as in one implicit step of Archard's law: each
# element gives way by κ p. The κ of a use gives the losses in sum under this use, in the first
# round under the use as stated.

import logging
from collections import deque
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.contact import Interface, Load
from gstlib.macroscale.active_tool import as_round_as
from gstlib.macroscale.ensemble import Case, patch_means, press_each
from gstlib.surfaces.grid import coarser, described
from gstlib.use.competitors import competitor_scores
from gstlib.use.evidence import FEWEST_PATCHES, FEWEST_WORN, Evidence, Losses
from gstlib.use.laws import law_scores
from gstlib.use.sampling import Draws, Prior, Sampling, sample
from gstlib.use.tempering import effective_sample_size

__all__ = [
    "FEWEST_DRAWS",
    "NOT_PRESSED",
    "PERHAPS",
    "PRESSED",
    "UNKNOWN",
    "StatedUse",
    "infer_use",
    "use_pressures",
]

_log = logging.getLogger(__name__)

# The three answers to: does a use explain the wear?
PRESSED = "pressed"
PERHAPS = "perhaps pressed"
NOT_PRESSED = "not shown to be pressed"
# How the answer begins where there is none; the reason follows.
UNKNOWN = "cannot be inferred"

# Contacts are pressed on elements twice as long as the study's.
_COARSER = 2
# Contacts that are kept in memory, to start others from.
_KEPT = 100
# Far below the printed digits: each round rests on the last bits of those before it.
_TOLERANCE = 1e-9
# Strikes that have to press a patch.
_FEWEST = 40
# Effective draws for a patch below which its prediction is called uncertain.
FEWEST_DRAWS = 40
# Error of the pressures between contacts, over the mean, above which nothing is inferred.
_MOST_CONTACT_ERROR = 0.3
# By how many standard errors a use has to predict better than each competitor to be claimed. Chosen
# on stones that are in no benchmark, so that rarely a use is claimed where nothing was pressed.
_CLEARLY = 1.0

# Units and meaning of what is stored.
_DESCRIBED = {
    "y_mm": ("mm", "load point along y"),
    "x_mm": ("mm", "load point along x"),
    "radius_mm": ("mm", "radius of the active tool, NaN where it is not asked for"),
    "scatter_mm": ("mm", "standard deviation of the strikes along each axis"),
    "stroke_mm": ("mm", "length of a stroke"),
    "spread_mm": (
        "mm",
        "r.m.s. distance of the strikes from their centre along an axis",
    ),
    "stroke_angle_deg": ("degree", "direction of the stroke from x towards y"),
    "weight": ("1", "worth of the draw after the wear was seen"),
    "pressure": ("MPa", "pressure of the patch, mean over the strikes"),
    "pressure_at_centre": (
        "MPa",
        "pressure of the patch under a strike through the centre",
    ),
    "weight_without": ("1", "worth of the draw by the wear of the other patches"),
    "log_score": ("1", "log probability of the patch's wear, given the others'"),
    "competitor_log_score": ("1", "the same by a competitor that knows no contact"),
    "law_log_score": (
        "1",
        "log probability of the patch's wear, given the others', by a law",
    ),
    "law_parameter": ("1", "parameter of a law: its mean, and the limits of 95 %"),
    "effective_sample_size_without": (
        "1",
        "effective draws by the wear of the other patches",
    ),
    "wear_coefficient": ("um/MPa", "wear coefficient with the sliding"),
    "scatter": ("1", "scatter of the wear"),
    "floor": ("um", "scatter of a loss that does not grow with it"),
}


class StatedUse(NamedTuple):
    """What the user states of a use, with standard errors.

    Attributes
    ----------
    force_N : float
    load_point : (float, float)
        The load point (y, x) on the square, mm.
    load_point_mm : float
        Its standard error along each axis.
    radius_mm : float or None
        Of the active tool whose face is pressed (of two, the geometric mean); None where it is
        known, or flat.
    radius_log_sd : float
        Standard error of the logarithm of the radius.
    scatter_mm, stroke_mm : float
        Scales of how far strikes scatter along each axis, and of how long strokes are.
    """

    force_N: float
    load_point: tuple[float, float]
    load_point_mm: float
    radius_mm: float | None = None
    radius_log_sd: float = 0.0
    scatter_mm: float = 0.0
    stroke_mm: float = 0.0

    @property
    def prior(self) -> Prior:
        """Uses that are possible beforehand."""
        mean, error = [*self.load_point], 2 * [self.load_point_mm]
        if self.radius_mm is not None:
            mean, error = [*mean, np.log(self.radius_mm)], [*error, self.radius_log_sd]
        return Prior(np.array(mean), np.array(error), self.scatter_mm, self.stroke_mm)


def infer_use(
    face: xr.Dataset,
    patches: pd.DataFrame,
    evidence: Evidence,
    stated: StatedUse,
    *,
    modulus: float,
    patch_mm: float,
    sampling: Sampling,
) -> xr.Dataset:
    """Where a tool was pressed, and against how round a tool.

    Parameters
    ----------
    face : xarray.Dataset
        ``height``, ``counterface`` and ``size_mm``, from
        `gstlib.macroscale.composite.compose_surface` or `gstlib.macroscale.face.grid_macroscale`.
    patches : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg`` of the patches whose wear is known.
    evidence : Evidence
        Their wear, in that order.
    stated : StatedUse
    modulus : float
        Contact modulus E*, MPa.
    patch_mm : float
        Side of a patch.
    sampling : Sampling

    Returns
    -------
    xarray.Dataset
        By ``draw``: ``y_mm``, ``x_mm``, ``radius_mm`` (NaN where it is not asked for),
        ``scatter_mm``, ``stroke_mm``, ``spread_mm``, ``stroke_angle_deg``, `Evidence.parameters`,
        and ``weight``, the worth of the draw after the wear was seen. By ``draw`` and ``patch``:
        ``pressure`` and ``pressure_at_centre``, MPa, and ``weight_without``, the worth after the
        wear of the other patches was seen. By ``patch``: ``log_score`` of each patch given the
        others and ``effective_sample_size_without``; by ``competitor`` and ``patch``,
        ``competitor_log_score``. Of losses, the dataset from `gstlib.use.laws.law_scores` is part
        of it. Attributes: ``effective_sample_size``; ``contacts`` that were solved, and the error
        ``contact_error`` with which the last were predicted; ``log_score_gain`` over the best
        ``competitor``, with its standard error ``log_score_gain_error``; ``answer``, one of
        `PRESSED`, `PERHAPS` and `NOT_PRESSED`; and ``adopted``, whether the study adopts it. If
        nothing can be inferred, there are the attributes alone, and ``answer`` is `UNKNOWN` with
        the reason.

    Examples
    --------
    Of eight patches, the two with the lowest x and y are the most worn by eye:

    >>> import gstlib
    >>> from gstlib.use.evidence import Grades
    >>> y, x = (each.ravel() for each in np.mgrid[0.5:4:1, 0.5:4:2])
    >>> patches = pd.DataFrame({"patch": range(8), "x_mm": x, "y_mm": y, "rotation_deg": 0.0})
    >>> rough = np.random.default_rng(1).normal(0, 1e-5, (16, 16))
    >>> height = gstlib.make_surface(rough, 0.25)
    >>> over = gstlib.rounded_counterface(height, 50.0, (2.0, 2.0))
    >>> face = xr.Dataset({"height": height, "counterface": over, "size_mm": 4.0})
    >>> use = gstlib.infer_use(
    ...     face, patches, Grades(2 * ((x < 2) & (y < 2))), StatedUse(100.0, (2.0, 2.0), 0.5),
    ...     modulus=1e4, patch_mm=0.5, sampling=Sampling(draws=10, rounds=2, particles=50, seed=1),
    ... )
    >>> float(use.weight @ use.x_mm) < 1.8
    True
    """
    if len(patches) < FEWEST_PATCHES or not evidence.tells:
        return _too_few(len(patches))
    generator = np.random.default_rng([sampling.seed, 6])
    height = coarser(face.height, _COARSER)

    settings: dict[str, float] = {"modulus": modulus, "patch_mm": patch_mm}
    before = use_pressures(
        stated.prior.mean[np.newaxis], face, patches, stated, **settings
    )

    def pressures(points: np.ndarray, springs: np.ndarray) -> np.ndarray:
        return use_pressures(points, face, patches, stated, springs=springs, **settings)

    draws = sample(
        stated.prior,
        pressures,
        evidence,
        sampling,
        generator,
        springs=evidence.springs(before),
    )
    contacts, touching = (
        (draws.contacts, draws.touching) if draws else (sampling.draws, 0)
    )
    if draws is None or touching < min(_FEWEST, contacts):
        reason = (
            f"only {touching} of {contacts} strikes about what is stated touch a patch"
        )
        remedy = (
            "Correct load.at_mm and counterface, or raise uncertainty.load_point_mm"
        )
        return _unknown(reason, remedy)
    use = _stored(draws, patches)
    competitors = competitor_scores(
        height, patches, evidence, patch_mm=patch_mm, seed=sampling.seed
    )
    use["competitor"] = list(competitors)
    use["competitor_log_score"] = (
        ("competitor", "patch"),
        np.array([*competitors.values()]),
    )
    answer = _answer(use)
    # where a competitor predicts better, more contacts would not help
    if answer["adopted"] and not draws.contact_error <= _MOST_CONTACT_ERROR:
        reason = (
            f"the last of {contacts} contacts were predicted from the others with an error of "
            f"{100 * draws.contact_error:.0f} % of their mean pressure"
        )
        remedy = f"Raise use.rounds (now {sampling.rounds}) or use.draws (now {sampling.draws})"
        return _unknown(reason, remedy)
    if isinstance(evidence, Losses):
        laws = law_scores(draws.pressures_of, draws.variables, evidence, generator)
        use = use.merge(laws)
    _warn_of_few_draws(use, sampling)
    stated_radius = np.nan if stated.radius_mm is None else stated.radius_mm
    return described(use, _DESCRIBED).assign_attrs(
        effective_sample_size=float(effective_sample_size(draws.particles.weights)),
        stated_radius_mm=stated_radius,
        **answer,
    )


def _stored(draws: Draws, patches: pd.DataFrame) -> xr.Dataset:
    """The draws as a dataset."""
    weight, without = draws.particles.weights, draws.particles.weights_without
    uses = draws.uses
    y_mm, x_mm, *log_radius = uses.points.T
    stroke_y, stroke_x = uses.stroke_mm.T
    by_draw = {
        "y_mm": y_mm,
        "x_mm": x_mm,
        "radius_mm": np.exp(log_radius[0])
        if log_radius
        else np.full(len(weight), np.nan),
        "scatter_mm": uses.scatter_mm,
        "stroke_mm": np.hypot(stroke_y, stroke_x),
        "spread_mm": uses.spread_mm,
        "stroke_angle_deg": np.degrees(np.arctan2(stroke_y, stroke_x)) % 180,
        **draws.parameters,
        "weight": weight,
    }
    by_both = {
        "pressure": draws.pressure,
        "pressure_at_centre": draws.pressure_at_centre,
        "weight_without": without,
    }
    by_patch = {
        "log_score": draws.particles.log_score,
        "effective_sample_size_without": effective_sample_size(without),
    }
    return xr.Dataset(
        {name: ("draw", values) for name, values in by_draw.items()}
        | {name: (("draw", "patch"), values) for name, values in by_both.items()}
        | {name: ("patch", values) for name, values in by_patch.items()},
        {"patch": list(patches.patch)},
        {"contacts": draws.contacts, "contact_error": draws.contact_error},
    )


def use_pressures(
    points: np.ndarray,
    face: xr.Dataset,
    patches: pd.DataFrame,
    stated: StatedUse,
    *,
    modulus: float,
    patch_mm: float,
    springs: float | np.ndarray = 0.0,
) -> np.ndarray:
    """Pressure (uses, patches), MPa, under some uses; 0 of one that tips the stone over.

    `points` (uses, 2 or 3) are load point (y, x), mm, and logarithm of the radius; elements
    give way by `springs`, mm/MPa; the rest is as in `infer_use`.
    """
    height, over_stated = (
        coarser(face[name], _COARSER) for name in ("height", "counterface")
    )
    means = patch_means(height, patches, size_mm=patch_mm)
    pressures = np.zeros((len(points), len(patches)))
    scaled = points / np.where(stated.prior.error > 0, stated.prior.error, 1.0)
    solved: deque[tuple[int, np.ndarray]] = deque(maxlen=_KEPT)
    each = np.broadcast_to(springs, len(points))
    for number, (y, x, *log_radius) in enumerate(points):
        over = over_stated
        if log_radius and stated.radius_mm is not None:
            over = as_round_as(over_stated, stated.radius_mm, np.exp(log_radius[0]))
        # from the use most like this one
        apart = [np.square(scaled[number] - scaled[other]).sum() for other, _ in solved]
        start = solved[int(np.argmin(apart))][1] if solved else None
        load = Load.of_force(stated.force_N, height, (y, x))
        case = Case(Interface(height, over), load, modulus, start, float(each[number]))
        (contact,) = press_each([case], tolerance=_TOLERANCE, source="use")
        if contact is None:
            continue
        solved.append((number, contact.pressure.values))
        pressures[number] = means @ contact.pressure.values.ravel()
    return pressures


def _too_few(count: int) -> xr.Dataset:
    """The result of `infer_use` if too few patches are known, or if too few of them wore."""
    remedy = (
        f"Of {count} patches whose wear is known, fewer than {FEWEST_WORN} lost more than the "
        f"noise, or there are fewer than {FEWEST_PATCHES} patches: scan more places that wore"
    )
    few = f"the wear of only {count} patches is known"
    return _unknown(few if count < FEWEST_PATCHES else "too few patches wore", remedy)


def _warn_of_few_draws(use: xr.Dataset, sampling: Sampling) -> None:
    """Name the patches whose prediction rests on few effective draws."""
    is_few = use.effective_sample_size_without.values < FEWEST_DRAWS
    if is_few.any():
        _log.warning(
            "the prediction for the patches %s rests on fewer than %d effective draws, so that it "
            "is uncertain: raise use.particles (now %d)",
            ", ".join(map(str, use.patch.values[is_few])),
            FEWEST_DRAWS,
            sampling.particles,
        )


def _unknown(reason: str, remedy: str) -> xr.Dataset:
    """What `infer_use` returns where nothing can be inferred; reason and remedy are logged."""
    _log.warning(
        "how the tool was used %s, because %s. %s, or set use to null. The study goes on as "
        "stated.",
        UNKNOWN,
        reason,
        remedy,
    )
    answer = f"{UNKNOWN}, because {reason}"
    return xr.Dataset(
        attrs={"answer": answer, "adopted": 0, "effective_sample_size": 0.0}
    )


def _answer(use: xr.Dataset) -> dict[str, Any]:
    """Whether a use explains the wear, and whether the study adopts it."""
    gains = (
        (use.log_score - use.competitor_log_score)
        .transpose("competitor", "patch")
        .values
    )
    total = gains.sum(axis=1)
    error = np.sqrt(gains.shape[1]) * gains.std(axis=1, ddof=1)
    best = int(np.argmin(total))
    answer = NOT_PRESSED if total[best] <= 0 else PERHAPS
    if (total > _CLEARLY * error).all():
        answer = PRESSED
    return {
        "competitor": str(use.competitor.values[best]),
        "log_score_gain": float(total[best]),
        "log_score_gain_error": float(error[best]),
        "answer": answer,
        # where a competitor tells more of the other patches, a use has not shown itself
        "adopted": int(total[best] > 0),
    }
