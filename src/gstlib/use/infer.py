"""How a tool was used, read from its wear: where it was pressed, and against how round a tool.

Of many uses that are possible beforehand, each is a contact of its own, in equilibrium. A use whose
pressures go with the wear of the patches counts more (`gstlib.use.sampling`). The prediction for a
patch weighs the draws by the wear of the *other* patches alone.

Something always fits best. So the answer is compared with chance, the wear of the patches exchanged
among them; and with heights alone, wear in proportion to how far a patch stands out above a plane:
high places bear load, so that wear that follows heights looks like a use.
"""

# ASSUME: force and modulus are known: a loss knows the force through the wear coefficient alone.
# The radius is that for both as stated, for a round contact depends on F R / E*. It is known but
# for a lognormal error, the load point but for a normal one, alike along both axes.
# ASSUME: of two radii, the ratio and the direction are known.
# ASSUME: the pressures of a use are those before wear; what wear moves between patches is small
# beside what is not known.

import logging
from collections import deque
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.contact import Interface, Load
from gstlib.macroscale.active_tool import as_round_as
from gstlib.macroscale.ensemble import Case, patch_means, press_each
from gstlib.surfaces.grid import coarser, described
from gstlib.use.evidence import FEWEST_PATCHES, FEWEST_WORN, Evidence, log_evidence, weigh
from gstlib.use.sampling import Sampling, effective_draws, sample

__all__ = [
    "BETTER",
    "CHANCE",
    "CONSISTENT",
    "UNKNOWN",
    "StatedUse",
    "infer_use",
    "use_pressures",
]

_log = logging.getLogger(__name__)

# The three answers to: does a use explain the wear?
BETTER = "better than heights alone"
CONSISTENT = "consistent with a use"
CHANCE = "not better than chance"
# How the answer begins where there is none; the reason follows.
UNKNOWN = "cannot be inferred"

# Contacts are pressed on elements twice as long as the study's.
_COARSER = 2
# Contacts that are kept in memory, to start others from.
_KEPT = 100
# Far below the printed digits: each round rests on the last bits of those before it.
_TOLERANCE = 1e-9
# Effective draws below which nothing is inferred.
_FEWEST = 40
# Of many patches, so many are exchanged: they are enough, and the time does not grow.
_PERMUTATIONS, _MOST_PERMUTED = 199, 200
_LEVEL, _CLEARLY = 0.05, 1.645  # one-sided
# Heights that a plane may have: shares of the elements below it.
_BELOW_PLANE = np.linspace(0.3, 0.995, 60)

# Units and meaning of what is stored.
_DESCRIBED = {
    "y_mm": ("mm", "load point along y"),
    "x_mm": ("mm", "load point along x"),
    "radius_mm": ("mm", "radius of the active tool, NaN where it is not asked for"),
    "weight": ("1", "worth of the draw after the wear was seen"),
    "pressure": ("MPa", "pressure of the patch"),
    "weight_without": ("1", "worth of the draw by the wear of the other patches"),
    "log_score": ("1", "log probability of the patch's wear, given the others'"),
    "heights_log_score": ("1", "the same by heights alone"),
    "wear_coefficient": ("um/MPa", "wear coefficient with the sliding"),
    "scatter": ("1", "scatter of the wear"),
    "floor": ("um", "scatter of a loss that does not grow with it"),
}


class StatedUse(NamedTuple):
    """What the user states of a use, with standard errors.

    Attributes
    ----------
    force_N : float
    through : (float, float)
        The load point (y, x) on the square, mm.
    load_point_mm : float
        Its standard error along each axis.
    radius_mm : float or None
        Of the active tool whose face is pressed (of two, the geometric mean); None where it is
        known, or flat.
    radius_fraction : float
        Standard error of the logarithm of the radius.
    """

    force_N: float
    through: tuple[float, float]
    load_point_mm: float
    radius_mm: float | None = None
    radius_fraction: float = 0.0

    @property
    def prior(self) -> Any:
        """Distribution of y, x and, if it is asked for, the logarithm of the radius."""
        mean, error = [*self.through], 2 * [self.load_point_mm]
        if self.radius_mm is not None:
            mean, error = [*mean, np.log(self.radius_mm)], [*error, self.radius_fraction]
        return scipy.stats.multivariate_normal(mean, np.square(error))


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
        By ``draw``: ``y_mm``, ``x_mm``, ``radius_mm`` (NaN where it is not asked for), ``weight``
        (what the draw is worth after the wear was seen), and what `Evidence.nodes` knows, of one
        node. By ``draw`` and ``patch``: ``pressure``, MPa, and ``weight_without`` and means of the
        nodes, ``…_without``, after the wear of the other patches was seen. By ``patch``:
        ``log_score`` and ``heights_log_score``, of each patch given the others. Attributes:
        ``effective_draws``; ``p_value`` against chance; ``gain`` of the log score over heights
        alone, with its standard error ``gain_error``; ``answer``, one of `BETTER`, `CONSISTENT` and
        `CHANCE`; and ``taken``, whether the study takes it. Where nothing can be inferred, there
        are the attributes alone, and ``answer`` is `UNKNOWN` with the reason.
    """
    if len(patches) < FEWEST_PATCHES or not evidence.tells:
        remedy = (
            f"Of {len(patches)} patches whose wear is known, fewer than {FEWEST_WORN} lost more "
            f"than the noise, or there are fewer than {FEWEST_PATCHES} patches: scan more places "
            "that wore"
        )
        few = f"the wear of only {len(patches)} patches is known"
        return _unknown(
            few if len(patches) < FEWEST_PATCHES else "too few patches wore", remedy
        )
    generator = np.random.default_rng([sampling.seed, 6])
    height = coarser(face.height, _COARSER)
    means = patch_means(height, patches, size_mm=patch_mm)

    def pressures(points: np.ndarray) -> np.ndarray:
        settings = {"modulus": modulus, "patch_mm": patch_mm}
        return use_pressures(points, face, patches, stated, **settings)

    draws = sample(stated.prior, pressures, evidence, sampling, generator)
    tried, touching = len(draws.points), draws.touching
    if touching < min(_FEWEST, tried):
        reason = f"only {touching} of {tried} uses about what is stated touch a patch"
        remedy = "Correct load.at_mm and counterface, or raise uncertainty.load_point_mm"
        return _unknown(reason, remedy)
    weight, score = draws.seen.weights(draws.log_prior), draws.seen.log_score(draws.log_prior)
    if (effective := effective_draws(weight)) < _FEWEST:
        reason = f"only {effective:.0f} of {tried} tried uses count"
        remedy = f"Raise use.draws (now {sampling.draws}) or use.rounds (now {sampling.rounds})"
        return _unknown(reason, remedy, effective)
    heights = _heights_score(height, means, evidence)
    gain = score - heights
    stated_pressures = draws.pressure[: sampling.draws]
    explained = {
        "p_value": _chance(evidence, stated_pressures, patches, generator),
        "gain": float(gain.sum()),
        "gain_error": float(np.sqrt(len(gain)) * gain.std(ddof=1)),
    }
    variables: dict[str, tuple] = {
        **{name: ("draw", of) for name, of in _named(draws.points).items()},
        **{name: ("draw", of) for name, of in draws.seen.drawn.items()},
        **{
            f"{name}_without": (("draw", "patch"), of)
            for name, of in draws.seen.without.items()
        },
        "weight": ("draw", weight),
        "pressure": (("draw", "patch"), draws.pressure),
        "weight_without": (("draw", "patch"), draws.seen.weights_without(draws.log_prior)),
        "log_score": ("patch", score),
        "heights_log_score": ("patch", heights),
    }
    found = xr.Dataset(variables, {"patch": list(patches.patch)}, explained)
    by_others = {
        f"{name}_without": (units, f"{text}, by the wear of the other patches")
        for name, (units, text) in _DESCRIBED.items()
    }
    found = described(found, by_others | _DESCRIBED)
    stated_radius = np.nan if stated.radius_mm is None else stated.radius_mm
    return found.assign_attrs(
        effective_draws=effective, stated_radius_mm=stated_radius, **_answer(**explained)
    )


def use_pressures(
    points: np.ndarray,
    face: xr.Dataset,
    patches: pd.DataFrame,
    stated: StatedUse,
    *,
    modulus: float,
    patch_mm: float,
) -> np.ndarray:
    """Pressure (uses, patches), MPa, under some uses; 0 of one that tips the stone over.

    `points` (uses, 2 or 3) are load point (y, x), mm, and logarithm of the radius; the rest is as
    in `infer_use`.
    """
    height, known = (coarser(face[name], _COARSER) for name in ("height", "counterface"))
    means = patch_means(height, patches, size_mm=patch_mm)
    found = np.zeros((len(points), len(patches)))
    scaled = points / stated.prior.cov.diagonal() ** 0.5
    solved: deque[tuple[int, np.ndarray]] = deque(maxlen=_KEPT)
    for number, (y, x, *log_radius) in enumerate(points):
        over = known
        if log_radius and stated.radius_mm is not None:
            over = as_round_as(known, stated.radius_mm, np.exp(log_radius[0]))
        # from the use most like this one
        apart = [np.square(scaled[number] - scaled[other]).sum() for other, _ in solved]
        start = solved[int(np.argmin(apart))][1] if solved else None
        load = Load.of_force(stated.force_N, height, (y, x))
        case = Case(Interface(height, over), load, modulus, start)
        (contact,) = press_each([case], tolerance=_TOLERANCE, source="use")
        if contact is None:
            continue
        solved.append((number, contact.pressure.values))
        found[number] = means @ contact.pressure.values.ravel()
    return found


def _named(points: np.ndarray) -> dict[str, np.ndarray]:
    radius = np.exp(points[:, 2]) if points.shape[1] > 2 else np.full(len(points), np.nan)
    return {"y_mm": points[:, 0], "x_mm": points[:, 1], "radius_mm": radius}


def _unknown(reason: str, remedy: str, effective: float = 0.0) -> xr.Dataset:
    """What `infer_use` returns where nothing can be inferred; reason and remedy are logged."""
    _log.warning(
        "how the tool was used %s, because %s. %s, or set use to null. The study goes on as "
        "stated.",
        UNKNOWN,
        reason,
        remedy,
    )
    answer = f"{UNKNOWN}, because {reason}"
    return xr.Dataset(attrs={"answer": answer, "taken": 0, "effective_draws": effective})


def _answer(p_value: float, gain: float, gain_error: float) -> dict[str, Any]:
    """Whether a use explains the wear, and whether the study takes it."""
    if p_value > _LEVEL:
        return {"answer": CHANCE, "taken": 0}
    answer = BETTER if gain > _CLEARLY * gain_error else CONSISTENT
    # where heights alone tell more of the other patches, a use has not shown itself
    return {"answer": answer, "taken": int(gain > 0)}


def _chance(
    evidence: Evidence,
    pressure: np.ndarray,
    patches: pd.DataFrame,
    generator: np.random.Generator,
) -> float:
    """P-value of the wear where it is, among the same wear elsewhere.

    `pressure` (draws, patches) is that of stated uses: what was drawn later knows the wear.
    """
    if len(patches) > _MOST_PERMUTED:
        some = np.sort(generator.choice(len(patches), _MOST_PERMUTED, replace=False))
        evidence, pressure = evidence.permuted(some), pressure[:, some]
        patches = patches.iloc[some]
    pressure = pressure[pressure.sum(axis=1) > 0]

    def explained(of: Evidence) -> float:
        return float(scipy.special.logsumexp(log_evidence(of, pressure)))

    orders = _orders(patches, generator)
    by_chance = [explained(evidence.permuted(next(orders))) for _ in range(_PERMUTATIONS)]
    as_good = np.sum(np.array(by_chance) >= explained(evidence))
    return float((1 + as_good) / (1 + _PERMUTATIONS))


def _orders(patches: pd.DataFrame, generator: np.random.Generator) -> Iterator[np.ndarray]:
    """Orders of the patches in which neighbours stay neighbours: all turned, mirrored, shifted."""
    places = patches[["y_mm", "x_mm"]].to_numpy(dtype=float)
    places = places - places.mean(axis=0)
    size = np.ptp(places, axis=0).max()
    while True:
        angle = generator.uniform(0, 2 * np.pi)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        mirror = [generator.choice([-1, 1]), 1]
        moved = (places * mirror) @ turn + generator.uniform(-0.5, 0.5, 2) * size
        apart = np.abs(moved[:, None] - places) % size
        apart = np.minimum(apart, size - apart)  # beyond an edge, the other begins
        yield scipy.optimize.linear_sum_assignment((apart**2).sum(axis=2))[1]


def _heights_score(
    height: xr.DataArray, means: "scipy.sparse.csr_array", evidence: Evidence
) -> np.ndarray:
    """Log score (patches,) of wear in proportion to the volume above a plane of any height."""
    values = np.where(np.isnan(height.values), -np.inf, height.values).ravel()
    inside = np.asarray(means.sum(axis=0)).ravel() > 0
    planes = np.quantile(values[inside & np.isfinite(values)], _BELOW_PLANE)
    above = np.array([means @ np.maximum(values - plane, 0) for plane in planes])
    return weigh(evidence, above).log_score(np.zeros(len(planes)))
