"""Inference of the load case from the wear: load point, its scatter, radius of the active tool.

A load case consists of the mean load point, its scatter and the radius of the active tool. Contacts
of single strikes are solved in equilibrium (`gstlib.use.sampling`). The pressures of a load case
are means over its strikes (`gstlib.use.spread`). A load case is weighted by the agreement of its
pressures with the wear of the patches. The prediction for a patch weights the draws by the wear of
the *other* patches alone.

Some load case always fits best. So there are competitors without contact, which also predict each
loss from the others (`gstlib.use.competitors`). A load case is claimed only if it predicts better
than each of them.
"""

# ASSUME: Force and contact modulus. Force and modulus keep the values of the config, and the radius
# is inferred for these values. Reason: A loss constrains the force only through the wear
# coefficient, and a round contact depends on F R / E*.
# ASSUME: Priors of load point and radius. The error of the radius is lognormal, and the error of
# the load point is normal, with one standard deviation for both axes. Reason: A radius is positive,
# and the two axes are equivalent.
# ASSUME: Two radii of the active tool. The ratio and the direction of two radii are taken as known.
# Reason: A few losses hardly constrain further parameters.
# ASSUME: Wear within one load case. A loss is proportional to the pressure after it, as in one
# implicit step of Archard's law, which lowers each element by κ p. The κ of a load case
# reproduces the sum of the losses, in the first round under the prior means. Reason: Wear unloads
# the patches that wear most.

import logging
from collections import deque
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.contact import Interface, Load
from gstlib.errors import InputError
from gstlib.macroscale.active_tool import as_round_as
from gstlib.macroscale.ensemble import Case, patch_means, press_each
from gstlib.surfaces.grid import coarser, described
from gstlib.use.competitors import competitor_scores
from gstlib.use.evidence import FEWEST_PATCHES, FEWEST_WORN, Evidence, Losses
from gstlib.use.laws import law_scores
from gstlib.use.sampling import Draws, Sampling, StatedUse, sample
from gstlib.use.spread import Uses
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

# Possible answers to the question whether a load case explains the wear.
PRESSED = "pressed"
PERHAPS = "perhaps pressed"
NOT_PRESSED = "not shown to be pressed"
# Start of the answer if nothing can be inferred. The reason follows.
UNKNOWN = "cannot be inferred"

# Contacts are solved on elements twice as long as in the study.
_COARSER = 2
# Number of contacts kept in memory as starting points of others.
_KEPT = 100
# Far below the printed digits, because each round depends on the last bits of earlier rounds.
_TOLERANCE = 1e-9
# Number of strikes that must press a patch.
_FEWEST = 40
# Smallest effective sample size of a patch whose prediction is not called uncertain.
FEWEST_DRAWS = 40
# Largest relative error of the pressures between contacts for an inference.
_MOST_CONTACT_ERROR = 0.3
# Number of standard errors by which a load case must predict better than each competitor. It was
# chosen on stones outside the benchmarks, so that false claims are rare if nothing was pressed.
_CLEARLY = 1.0

# Units and meanings of the stored variables.
_DESCRIBED = {
    "y_mm": ("mm", "load point along y"),
    "x_mm": ("mm", "load point along x"),
    "radius_mm": ("mm", "radius of the active tool, NaN if it is not inferred"),
    "scatter_mm": ("mm", "standard deviation of the strikes along each axis"),
    "stroke_mm": ("mm", "length of a stroke"),
    "spread_mm": (
        "mm",
        "r.m.s. distance of the strikes from their centre along an axis",
    ),
    "stroke_angle_deg": ("degree", "direction of the stroke from x towards y"),
    "weight": ("1", "posterior weight of the draw"),
    "pressure": ("MPa", "pressure of the patch, mean over the strikes"),
    "pressure_at_centre": (
        "MPa",
        "pressure of the patch under a strike through the centre",
    ),
    "weight_without": ("1", "weight of the draw by the wear of the other patches"),
    "log_score": ("1", "log probability of the patch's wear, given the others'"),
    "competitor_log_score": ("1", "the same by a competitor without contact"),
    "law_log_score": (
        "1",
        "log probability of the patch's wear, given the others', by a law",
    ),
    "law_parameter": ("1", "parameter of a law: its mean, and the limits of 95 %"),
    "effective_sample_size_without": (
        "1",
        "effective sample size by the wear of the other patches",
    ),
    "wear_coefficient": ("um/MPa", "wear coefficient × sliding"),
    "scatter": ("1", "scatter of the wear"),
    "floor": ("um", "scatter that does not grow with the loss"),
}


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
    """Infer the load point and the radius of the active tool from the wear of patches.

    Parameters
    ----------
    face : xarray.Dataset
        ``height``, ``counterface`` and ``size_mm``, from
        `gstlib.macroscale.composite.compose_surface` or `gstlib.macroscale.face.grid_macroscale`.
    patches : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg`` of the patches with known wear.
    evidence : Evidence
        Wear of the patches, in the order of the table.
    stated : StatedUse
    modulus : float
        Contact modulus E*, MPa.
    patch_mm : float
        Side of a patch, mm.
    sampling : Sampling

    Returns
    -------
    xarray.Dataset
        By ``draw``: ``y_mm``, ``x_mm``, ``radius_mm`` (NaN if it is not inferred), ``scatter_mm``,
        ``stroke_mm``, ``spread_mm``, ``stroke_angle_deg``, the parameters of the evidence and
        ``weight``, the posterior weight of the draw. By ``draw`` and ``patch``: ``pressure`` and
        ``pressure_at_centre``, MPa, and ``weight_without``, the posterior weight without the wear
        of the patch. By ``patch``: ``log_score`` of each patch given the others and
        ``effective_sample_size_without``. By ``competitor`` and ``patch``:
        ``competitor_log_score``. For losses, the dataset also contains the variables of
        `gstlib.use.laws.law_scores`. Attributes: ``effective_sample_size``. ``contacts``, the
        number of solved contacts. ``contact_error``, the error with which the last were predicted.
        ``log_score_gain`` over the best ``competitor``, and its standard error
        ``log_score_gain_error``. ``answer``, one of `PRESSED`, `PERHAPS` and `NOT_PRESSED`.
        ``adopted``, whether the study adopts it. If nothing can be inferred, there are only
        attributes, and ``answer`` is `UNKNOWN` with the reason.

    Raises
    ------
    InputError
        The evidence is not of as many patches as there are.

    Examples
    --------
    The two patches with the lowest x and y are the most worn of eight by eye:

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
    count = len(patches)
    known = evidence.depth_um if isinstance(evidence, Losses) else evidence.grade
    if len(known) != count:
        problem = f"is of {len(known)} patches, but the table has {count}"
        raise InputError("evidence", problem, "Give one value for each row of patches.")
    if count < FEWEST_PATCHES:
        reason = f"the wear of only {count} patch{'es' * (count != 1)} is known"
        return _unknown(reason, f"Scan at least {FEWEST_PATCHES} patches")
    if not evidence.tells:
        reason = f"fewer than {FEWEST_WORN} of {count} patches lost more than the noise"
        return _unknown(reason, "Scan more positions that wore")
    generator = np.random.default_rng([sampling.seed, 6])
    pressures = partial(
        use_pressures,
        face=face,
        patches=patches,
        stated=stated,
        modulus=modulus,
        patch_mm=patch_mm,
    )
    springs = evidence.springs(pressures(stated.mean[np.newaxis]))
    draws = sample(stated, pressures, evidence, sampling, generator, springs)
    contacts, touching = (
        (draws.contacts, draws.touching) if draws else (sampling.draws, 0)
    )
    if draws is None or touching < min(_FEWEST, contacts):
        reason = f"only {touching} of {contacts} strikes near the prior touch a patch"
        remedy = (
            "Correct load.at_mm and counterface, or raise uncertainty.load_point_mm"
        )
        return _unknown(reason, remedy)
    use = _stored(draws, stated, evidence, patches)
    height, seed = coarser(face.height, _COARSER), sampling.seed
    use["competitor_log_score"] = competitor_scores(
        height, patches, evidence, patch_mm=patch_mm, seed=seed
    )
    answer = _answer(use)
    # If a competitor predicts better, more contacts do not help.
    if answer["adopted"] and not draws.contact_error <= _MOST_CONTACT_ERROR:
        reason = (
            f"the last of {contacts} contacts were predicted from the others with an error of "
            f"{100 * draws.contact_error:.0f} % of their mean pressure"
        )
        remedy = f"Raise use.rounds (now {sampling.rounds}) or use.draws (now {sampling.draws})"
        return _unknown(reason, remedy)
    if isinstance(evidence, Losses):
        laws = law_scores(
            partial(stated.pressures, draws.process),
            stated.variables,
            evidence,
            generator,
        )
        use = use.merge(laws)
    _warn_of_few_draws(use, sampling)
    return described(use, _DESCRIBED).assign_attrs(
        stated_radius_mm=stated.radius_mm or np.nan, **answer
    )


def _stored(
    draws: Draws, stated: StatedUse, evidence: Evidence, patches: pd.DataFrame
) -> xr.Dataset:
    """The draws as a dataset."""
    particles, process = draws.particles, draws.process
    standard, size = particles.standard, stated.variables
    uses = stated.uses(standard[:, :size])
    pressure = process.mean_pressures(uses)
    y_mm, x_mm, *log_radius = uses.points.T
    stroke_y, stroke_x = uses.stroke_mm.T
    without = particles.weights_without
    by_draw = {
        "y_mm": y_mm,
        "x_mm": x_mm,
        "radius_mm": np.exp(log_radius[0]) if log_radius else np.nan * y_mm,
        "scatter_mm": uses.scatter_mm,
        "stroke_mm": np.hypot(stroke_y, stroke_x),
        "spread_mm": uses.spread_mm,
        "stroke_angle_deg": np.degrees(np.arctan2(stroke_y, stroke_x)) % 180,
        **evidence.parameters(pressure, standard[:, size:]),
        "weight": particles.weights,
    }
    by_both = {
        "pressure": pressure,
        "pressure_at_centre": process.mean_pressures(Uses(uses.points)),
        "weight_without": without,
    }
    by_patch = {
        "log_score": particles.log_score,
        "effective_sample_size_without": effective_sample_size(without),
    }
    return xr.Dataset(
        {name: ("draw", values) for name, values in by_draw.items()}
        | {name: (("draw", "patch"), values) for name, values in by_both.items()}
        | {name: ("patch", values) for name, values in by_patch.items()},
        {"patch": list(patches.patch)},
        {
            "contacts": draws.contacts,
            "contact_error": draws.contact_error,
            "effective_sample_size": float(effective_sample_size(particles.weights)),
        },
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
    """Pressure (uses, patches), MPa, under load cases; 0 for a case that tips the stone over.

    `points` (uses, 2 or 3) are load point (y, x), mm, and logarithm of the radius. Elements yield
    by `springs`, mm/MPa. All other parameters are as in `infer_use`.
    """
    height, over_stated = (
        coarser(face[name], _COARSER) for name in ("height", "counterface")
    )
    means = patch_means(height, patches, size_mm=patch_mm)
    pressures = np.zeros((len(points), len(patches)))
    scale = np.where(stated.error > 0, stated.error, 1.0)
    solved: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=_KEPT)
    yields = np.broadcast_to(springs, len(points)).tolist()
    for number, (y, x, *log_radius) in enumerate(points):
        over = over_stated
        if log_radius and stated.radius_mm is not None:
            over = as_round_as(over_stated, stated.radius_mm, np.exp(log_radius[0]))
        # Start from the most similar load case.
        scaled = points[number] / scale
        apart = [np.square(scaled - other).sum() for other, _ in solved]
        start = solved[int(np.argmin(apart))][1] if solved else None
        load = Load.of_force(stated.force_N, height, (y, x))
        case = Case(Interface(height, over), load, modulus, start, yields[number])
        (contact,) = press_each([case], tolerance=_TOLERANCE, source="use")
        if contact is not None:
            solved.append((scaled, contact.pressure.values))
            pressures[number] = means @ contact.pressure.values.ravel()
    return pressures


def _warn_of_few_draws(use: xr.Dataset, sampling: Sampling) -> None:
    """Warn of the patches whose prediction has a small effective sample size."""
    is_few = use.effective_sample_size_without.values < FEWEST_DRAWS
    if is_few.any():
        _log.warning(
            "the prediction for the patches %s rests on fewer than %d effective draws, so it is "
            "uncertain. Raise use.particles (now %d)",
            ", ".join(map(str, use.patch.values[is_few])),
            FEWEST_DRAWS,
            sampling.particles,
        )


def _unknown(reason: str, remedy: str) -> xr.Dataset:
    """The result of `infer_use` if nothing can be inferred; reason and remedy are logged."""
    _log.warning(
        "how the tool was used %s, because %s. %s, or set use to null. The study continues with "
        "the prior load case.",
        UNKNOWN,
        reason,
        remedy,
    )
    answer = f"{UNKNOWN}, because {reason}"
    return xr.Dataset(
        attrs={"answer": answer, "adopted": 0, "effective_sample_size": 0.0}
    )


def _answer(use: xr.Dataset) -> dict[str, Any]:
    """Whether a load case explains the wear, and whether the study adopts it."""
    gains = use.log_score.values - use.competitor_log_score.values
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
        # If a competitor predicts the other patches better, a load case has not been shown.
        "adopted": int(total[best] > 0),
    }
