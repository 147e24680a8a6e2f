"""Does wear tell how a tool was used, and does the study claim a use where there was none?

    python benchmarks/use.py [--cases law scatter …] [--seeds 9001 9002 …]
    python benchmarks/use.py --tables

Forty stones are generated, with scans of 128 × 128 points, and each is worn by Archard's law. Its
load point and its radius are drawn from the prior of the study, which is told the middle of the
square and 200 mm. The seeds, 9001 to 9040, were chosen before any of these stones was made. The
other cases take the faces and the patches of the first stones, and have other losses:

law                    losses measured on the worn stones, 40 stones
control                mean pressures of the patches under the true use, 40 stones
scatter, stroke        the same under strikes that scatter by 1 mm, or along 4 mm, 40 stones each
blobs, tilted, gradients, waves, smooth   losses without a contact, 20 stones each
12, 8, wrong           losses of the law on fewer patches, or with one wrong loss, 10 stones each
grades, smooth grades  the losses of two cases as grades, a fifth of them wrong, 10 stones each
outside                a load point beyond the square; the study is told an error of 2 mm
two radii, true form   an ellipsoidal tool; the study is told a round one, or the true form
force                  twice the force that the study is told
squared, root          losses that go with the square or the square root of the pressure
uneven                 a wear coefficient that varies over the stone by up to 40 %
prior                  strikes and errors of the losses drawn from the prior, too, 40 stones

Six cases before the last have 10 stones each. In all but the last, losses that are not measured on
a worn stone scatter by 30 %, and by 2 % of their mean. This is about the scatter of the losses of
worn stones, by the column `known_scatter`.

The rows go to benchmarks/results/use.csv (with --output: elsewhere), one for each stone and case.
Stones and cases that the file holds already are not made again. Columns:

true_*, mean_*    centre, logarithm of the radius, scatter, stroke, and spread by both together;
sd_*, below_*     standard deviation of the draws, and their share below the truth;
answer, adopted, competitor, log_score_gain, log_score_gain_error, effective_sample_size,
contacts, contact_error
                  attributes of `gstlib.use.infer.infer_use`;
least_draws       the fewest effective draws for one patch;
log_score         log probability of each loss, given the others, summed;
told, inferred, known   r.m.s. error of the losses, each predicted from the others, over their
                  r.m.s.: with the use as told, as inferred, and as it was;
known_scatter     scatter of the losses about the pressures of the true use (posterior mean);
within_95         share of the losses inside their predicted 95 %;
cpu_s             of the inference.

`--tables` prints coverage, claims and errors from the rows alone. `--grades FILE` writes the patch
table of config/artefact.yaml, with grades in place of scans, and nothing else.
"""

import time
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import scipy
from runner import RESULTS, add_rows, options
from specimens import asked, merged, specimen_config, specimen_studies, worn_patches

from gstlib.io.tables import read_table
from gstlib.macroscale.active_tool import rounded_counterface
from gstlib.macroscale.ensemble import patch_means
from gstlib.settings import Settings
from gstlib.use.evidence import Grades, Losses, posterior
from gstlib.use.infer import PRESSED, StatedUse, infer_use, use_pressures
from gstlib.use.outcome import losses_of, predicted_losses, share_within
from gstlib.use.sampling import Sampling
from gstlib.use.spread import Uses

RESULT = RESULTS / "use.csv"
SEEDS = range(9001, 9041)
LAW = "archard"
# ASSUME: the contact of the macroscale knows nothing of what a coarser scan leaves out.
COARSE = {"scan_points": 128, "scan_spacing_um": 6.64, "unmeasured_size_um": 20.0}
# ASSUME: a stone is pressed within its square: uses beyond it cannot be told from each other.
EDGE_MM = 0.5
# Mean of made losses; their scatter over the loss, and over the mean loss.
MADE_UM, SCATTER, NOISE = 0.1, 0.3, 0.02
# How far strikes scatter along each axis, how long a stroke is, and the contacts that stand for it.
SCATTER_MM, STROKE_MM = 1.0, 4.0
STRIKES, STEPS = 32, 41
ONCE = np.zeros((1, 2))
# Strikes of a use from the prior, and degrees of freedom of the errors of losses.
PRIOR_STRIKES, FREEDOM = 100, 4
# How far beyond the square the load point of the case `outside` lies, and what the study is told.
OUTSIDE_MM, TOLD_OUTSIDE_MM = (0.25, 1.5), 2.0
# The longer radius over the shorter one of the case `two radii`.
ASPECT = 169 / 108
# The true force over the one that the study is told, in the case `force`.
FORCE = 2.0
UNEVEN, UNEVEN_MM = 0.4, 2.0
# Widths of blobs, tilts of planes and the share of the patches above them, lengths of waves.
BLOB_MM, TILT_MRAD, ABOVE_PLANE, WAVE_MM = (
    (0.4, 1.2),
    (2.0, 8.0),
    (0.3, 0.6),
    (0.8, 3.0),
)
SMOOTH_MM = (0.5, 1.0, 2.0, 3.0)
# Loss over the mean loss, above which a patch counts as worn.
WORN = 0.05
# Grades: the shares of the patches below each, and of those that are wrong by one.
BELOW_GRADES, WRONG = (0.4, 0.65, 0.85), 0.2
# The stone of config/artefact.yaml, and the use that the study is not told.
ARTEFACT_SEED = 4104
_DRAWS = 1000  # of the wear coefficient at known pressures
ERRORS = "told", "inferred", "known", "known_scatter"
_POINT = ["y_mm", "x_mm", "log_radius"]
USE = [*_POINT, "scatter_mm", "stroke_mm", "spread_mm"]
ATTRIBUTES = """answer adopted competitor log_score_gain log_score_gain_error
effective_sample_size contacts contact_error"""
HEAD = (
    "# Made by `python benchmarks/use.py --grades FILE`: losses of a synthetic stone, as an eye "
    "would grade them.\n"
)


class Stone(NamedTuple):
    """A stone that was worn by the law.

    The losses are those measured on the patches, and the point is that of the true load (y, x), mm,
    with the logarithm of the true radius. The study is told what is `stated`; `settings` are
    further arguments of `gstlib.use.infer.infer_use`.
    """

    seed: int
    face: object
    patches: pd.DataFrame
    losses: Losses
    point: np.ndarray
    stated: StatedUse
    settings: dict


class Trial(NamedTuple):
    """What the study is given in one case, and what is true of it.

    The stone has the face, the patches and what is stated in this case. The true use is by the
    names of the columns, and the true pressures (patches,) are in MPa; there may be neither.
    """

    stone: Stone
    evidence: Losses | Grades
    true: dict
    pressure: np.ndarray | None = None


def drawn_use(config, seed):
    """A use from the prior of the study, as parameters of a specimen."""
    generator = np.random.default_rng([seed, 8])
    errors = config["uncertainty"]
    half = config["square"]["size_mm"] / 2
    off = errors["load_point_mm"] * generator.standard_normal(2)
    log_radius = errors["radius_log_sd"] * generator.standard_normal()
    return {
        "worn_off_middle_mm": tuple(np.clip(off, EDGE_MM - half, half - EDGE_MM)),
        "worn_radius_mm": config["counterface"]["radius_mm"] * np.exp(log_radius),
    }


def worn_stone(config, patches, seed):
    """The stone of a seed, worn by the law."""
    use = drawn_use(config, seed)
    settings = Settings(**config).by_stage()["infer_use"]
    stated = StatedUse(**settings.pop("stated"))
    settings["sampling"] = Sampling(**settings["sampling"])
    settings.pop("wear_law")
    point = np.array([*stated.load_point, np.log(use["worn_radius_mm"])])
    point[:2] += use["worn_off_middle_mm"]
    config = merged(config, {"specimen": use})
    ((_, study),) = specimen_studies(config, patches, seed, [LAW])
    measured = losses_of(patches, asked(lambda study: study.registration, study))
    return Stone(seed, study.composite, *measured, point, stated, settings)


def made_losses(depth, generator):
    """Losses in proportion to a depth (patches,), as scans would measure them."""
    depth = depth / depth.mean() * generator.lognormal(0, SCATTER, len(depth))
    depth += NOISE * generator.standard_normal(len(depth))
    return Losses(MADE_UM * np.maximum(depth, 0), depth > 2 * NOISE)


def pressures_of(stone, strikes, force=1.0, losses=None):
    """Mean pressure of each patch over strikes, at so many times the stated force.

    It is that after the wear of `losses`, by default of `MADE_UM` on average.
    """
    stated = stone.stated._replace(force_N=force * stone.stated.force_N)
    settings = {name: stone.settings[name] for name in ("modulus", "patch_mm")}
    losses = losses or Losses(np.full(len(stone.patches), MADE_UM))

    def mean(**springs):
        pressures = use_pressures(
            strikes, stone.face, stone.patches, stated, **settings, **springs
        )
        return np.asarray(pressures.mean(axis=0))

    return mean(springs=losses.springs(mean()[None]))


def truth(point, scatter_mm=0.0, stroke_mm=0.0):
    """The true use, by the names of the columns."""
    use = Uses(point[None], np.array([scatter_mm]), np.array([[0.0, stroke_mm]]))
    values = *point, scatter_mm, stroke_mm, use.spread_mm.item()
    return dict(zip(USE, values, strict=True))


def law(stone, generator):
    """The stone as it was worn."""
    pressure = pressures_of(stone, stone.point[None], losses=stone.losses)
    return Trial(stone, stone.losses, truth(stone.point), pressure)


def struck(stone, generator, moves=ONCE, *, power=1.0, factor=1.0, force=1.0, **spread):
    """Strikes about the load point, moved by so much along y and x (strikes, 2), mm.

    They have so many times the stated force, and losses go with a power of the pressure.
    """
    strikes = np.tile(stone.point, (len(moves), 1))
    strikes[:, :2] += moves
    pressure = pressures_of(stone, strikes, force)
    true = truth(stone.point, **spread)
    true["log_radius"] += np.log(force)  # the radius is that for the force as stated
    losses = made_losses(factor * pressure**power, generator)
    return Trial(stone, losses, true, pressure)


def scatter(stone, generator):
    """Strikes that scatter about the load point."""
    off = scipy.special.ndtri(scipy.stats.qmc.Sobol(2, rng=generator).random(STRIKES))
    off = np.concatenate([off, -off])  # so that the centre is the load point
    moves = SCATTER_MM * off / off.std(axis=0)
    return struck(stone, generator, moves, scatter_mm=SCATTER_MM)


def stroke(stone, generator):
    """Strokes through the load point, in any direction."""
    angle = generator.uniform(0, np.pi)
    along = STROKE_MM * ((np.arange(STEPS) + 0.5) / STEPS - 0.5)
    moves = along[:, None] * (np.sin(angle), np.cos(angle))
    return struck(stone, generator, moves, stroke_mm=STROKE_MM)


def uneven(stone, generator):
    """A wear coefficient that varies over the stone."""
    field = by_patch(stone, random_field(stone, generator, UNEVEN_MM))
    return struck(stone, generator, factor=1 + UNEVEN * field / abs(field).max())


def from_prior(stone, generator):
    """Strikes, and errors of the losses, as the study takes them for possible."""
    prior = stone.stated
    sizes = np.maximum(generator.standard_normal(2), 0.0)
    scatter_mm, stroke_mm = sizes * (prior.scatter_mm, prior.stroke_mm)
    angle = generator.uniform(0, 2 * np.pi)
    stroke = stroke_mm * np.array([np.sin(angle), np.cos(angle)])
    count = PRIOR_STRIKES if sizes.any() else 1
    uses = Uses(
        np.tile(stone.point, (count, 1)),
        np.full(count, scatter_mm),
        np.tile(stroke, (count, 1)),
    )
    pressure = pressures_of(stone, uses.strikes(generator))
    expected = Losses(MADE_UM * pressure / pressure.mean())
    errors = expected.parameters(pressure[None], generator.standard_normal((1, 3)))
    width = np.hypot(errors["scatter"] * expected.depth_um, errors["floor"])
    error = generator.standard_t(FREEDOM, len(width))
    depth_um = expected.depth_um + width * error
    losses = Losses(depth_um, depth_um > 2 * errors["floor"])
    return Trial(stone, losses, truth(stone.point, scatter_mm, stroke_mm), pressure)


def outside(stone, generator):
    """A load point beyond an edge of the square."""
    half = float(stone.face.size_mm) / 2
    beyond = generator.choice([-1, 1]) * (half + generator.uniform(*OUTSIDE_MM))
    off = generator.permutation([beyond, generator.uniform(-half, half)])
    point = np.array([*(off + half), stone.point[2]])
    stated = stone.stated._replace(load_point_mm=TOLD_OUTSIDE_MM)
    return struck(stone._replace(point=point, stated=stated), generator)


def two_radii(stone, generator, *, is_told):
    """A tool of two radii; the study is told a round one, or the true form."""
    radius = stone.stated.radius_mm
    angle = generator.uniform(0, 180)
    middle = 2 * (float(stone.face.size_mm) / 2,)
    radii = radius * ASPECT**0.5, radius / ASPECT**0.5
    over = rounded_counterface(stone.face.height, radii, middle, angle)
    trial = struck(stone._replace(face=stone.face.assign(counterface=over)), generator)
    return trial if is_told else trial._replace(stone=stone)


def by_patch(stone, field):
    """Mean of a field on the face (y, x) over each patch."""
    means = patch_means(
        stone.face.height, stone.patches, size_mm=stone.settings["patch_mm"]
    )
    return np.asarray(means @ field.ravel())


def places(stone):
    """y and x of each point of the face, mm."""
    return np.meshgrid(stone.face.y, stone.face.x, indexing="ij")


def random_field(stone, generator, length_mm):
    """A Gaussian field on the face, of variance 1 and of a correlation length."""
    spacing = float(stone.face.y[1] - stone.face.y[0])
    noise = generator.standard_normal(stone.face.height.shape)
    field = scipy.ndimage.gaussian_filter(
        noise, length_mm / spacing / 2**0.5, mode="wrap"
    )
    return np.asarray(field / field.std())


def blobs(stone, generator):
    """A Gaussian spot anywhere on the square."""
    size, (y, x) = float(stone.face.size_mm), places(stone)
    middle = generator.uniform(EDGE_MM, size - EDGE_MM, 2)
    width = generator.uniform(*BLOB_MM)
    return np.exp(-0.5 * ((y - middle[0]) ** 2 + (x - middle[1]) ** 2) / width**2)


def tilted(stone, generator):
    """What lies above a tilted plane."""
    angle = generator.uniform(0, 2 * np.pi)
    tilt = 1e-3 * generator.uniform(*TILT_MRAD)
    y, x = places(stone)
    height = np.nan_to_num(stone.face.height.values)
    height = height - tilt * (y * np.sin(angle) + x * np.cos(angle))
    share = generator.uniform(*ABOVE_PLANE)
    inside = by_patch(stone, np.ones_like(y))
    middle = by_patch(stone, height) / inside
    levels = np.linspace(middle.min(), middle.max(), 50)
    depths = [np.maximum(height - level, 0) for level in levels]
    losses = np.array([by_patch(stone, depth) for depth in depths])
    is_worn = losses > WORN * losses.mean(axis=1, keepdims=True)
    return depths[int(abs(is_worn.mean(axis=1) - share).argmin())]


def gradients(stone, generator):
    """A ramp in any direction, from a line through the inner half of the square."""
    size = float(stone.face.size_mm)
    angle = generator.uniform(0, 2 * np.pi)
    (y, x), middle = places(stone), generator.uniform(size / 4, 3 * size / 4, 2)
    along = (y - middle[0]) * np.sin(angle) + (x - middle[1]) * np.cos(angle)
    return np.maximum(along, 0)


def waves(stone, generator):
    """A plane wave in any direction, where it is above 0."""
    angle, phase = generator.uniform(0, 2 * np.pi, 2)
    (y, x), length = places(stone), generator.uniform(*WAVE_MM)
    along = y * np.sin(angle) + x * np.cos(angle)
    return np.maximum(np.sin(2 * np.pi * along / length + phase), 0)


def smooth(stone, generator):
    """A random field of one of four lengths in turn: by turns clipped at 0, or exponentiated."""
    turn, length = divmod(stone.seed, len(SMOOTH_MM))
    field = random_field(stone, generator, SMOOTH_MM[length])
    return np.exp(field) if turn % 2 else np.maximum(field, 0)


def without_contact(stone, generator, *, field):
    """Losses that go with a field that knows no contact."""
    return Trial(
        stone, made_losses(by_patch(stone, field(stone, generator)), generator), {}
    )


def fewer(stone, generator, *, count):
    """So many patches, by chance."""
    trial = law(stone, generator)
    chosen = np.sort(generator.permutation(len(stone.patches))[:count])
    patches = stone.patches.iloc[chosen].reset_index(drop=True)
    losses = stone.losses.depth_um[chosen], stone.losses.above_noise[chosen]
    return Trial(
        stone._replace(patches=patches),
        Losses(*losses),
        trial.true,
        trial.pressure[chosen],
    )


def one_wrong(stone, generator):
    """One patch of the more worn half has the loss of one of the other half."""
    depth_um = stone.losses.depth_um.copy()
    order = depth_um.argsort(kind="stable")
    less, more = (generator.choice(half) for half in np.array_split(order, 2))
    depth_um[more] = depth_um[less]
    return law(stone, generator)._replace(evidence=Losses(depth_um))


def grades_of(losses, generator):
    """The losses as an eye would grade them, some of them wrong by one."""
    limits = np.quantile(losses.depth_um, BELOW_GRADES)
    grade = np.searchsorted(limits, losses.depth_um)
    wrong = generator.random(len(grade)) < WRONG
    grade[wrong] += generator.choice([-1, 1], wrong.sum())
    return Grades(np.clip(grade, 0, len(BELOW_GRADES)))


def graded(stone, generator, *, case):
    """Another case, of which grades are known in place of losses."""
    trial = CASES[case][1](stone, generator)
    return trial._replace(evidence=grades_of(trial.evidence, generator))


# Losses that know no contact: the fields that they go with.
FIELDS = {field.__name__: field for field in (blobs, tilted, gradients, waves, smooth)}
# How many stones are tried in these cases, and what is made of each.
_CASES_OF = (
    (40, {"law": law, "control": struck, "scatter": scatter, "stroke": stroke}),
    (20, {name: partial(without_contact, field=FIELDS[name]) for name in FIELDS}),
    (
        10,
        {
            "12": partial(fewer, count=12),
            "8": partial(fewer, count=8),
            "wrong": one_wrong,
            "grades": partial(graded, case="law"),
            "smooth grades": partial(graded, case="smooth"),
            "outside": outside,
            "two radii": partial(two_radii, is_told=False),
            "true form": partial(two_radii, is_told=True),
            "force": partial(struck, force=FORCE),
            "squared": partial(struck, power=2.0),
            "root": partial(struck, power=0.5),
            "uneven": uneven,
        },
    ),
    (40, {"prior": from_prior}),
)
CASES = {
    name: (stones, make) for stones, cases in _CASES_OF for name, make in cases.items()
}
# Cases whose losses know no contact.
UNPRESSED = (*FIELDS, "smooth grades")


def relative_error(predicted, losses):
    """R.m.s. error of predicted losses over that of none."""
    norm = np.linalg.norm
    return float(norm(predicted - losses.depth_um) / norm(losses.depth_um))


def error_at(pressure, losses):
    """`relative_error` at these pressures (patches,), and the scatter of the losses about them.

    Each loss is predicted from the others.
    """
    if not pressure.any():
        return 1.0, np.nan
    draws = np.tile(pressure, (_DRAWS, 1))
    found = posterior(
        lambda standard: draws, 0, losses, _DRAWS, np.random.default_rng(1)
    )
    parameters = losses.parameters(draws, found.standard)
    coefficient = found.weights_without.T @ parameters["wear_coefficient"]
    scatter = found.weights @ parameters["scatter"]
    return relative_error(coefficient * pressure, losses), float(scatter)


def row_of(trial, case):
    """What the wear of one stone tells in one case."""
    stone, evidence = trial.stone, trial.evidence
    row = {"seed": stone.seed, "case": case, "patches": len(stone.patches)}
    start = time.process_time()
    use = infer_use(stone.face, stone.patches, evidence, stone.stated, **stone.settings)
    row["cpu_s"] = time.process_time() - start
    row |= {name: use.attrs[name] for name in ATTRIBUTES.split() if name in use.attrs}
    row |= {f"true_{name}": value for name, value in trial.true.items()}
    if not use.sizes:
        return row
    row |= inferred(use, trial.true)
    if isinstance(evidence, Losses):
        predicted = predicted_losses(use, evidence, stone.settings["sampling"].seed)
        as_told = pressures_of(stone, stone.stated.mean[None], losses=evidence)
        row["told"], _ = error_at(as_told, evidence)
        row["inferred"] = relative_error(predicted.predicted_um.to_numpy(), evidence)
        if trial.pressure is not None:
            known = error_at(trial.pressure, evidence)
            row["known"], row["known_scatter"] = known
        row["within_95"] = share_within(predicted)
    return row


def inferred(use, true):
    """The inferred use, beside the truth."""
    draws = use.assign(log_radius=np.log(use.radius_mm))
    weight = use.weight.values
    row = {"log_score": float(use.log_score.sum())}
    row["least_draws"] = float(use.effective_sample_size_without.min())
    for name in USE:
        values = draws[name].values
        mean = row[f"mean_{name}"] = weight @ values
        row[f"sd_{name}"] = np.sqrt(weight @ (values - mean) ** 2)
        if name in true:
            row[f"below_{name}"] = weight @ (values < true[name])
    return row


def stone_rows(config, patches, seed, cases):
    """The rows of one stone in some cases."""
    stone = worn_stone(config, patches, seed)
    rows = []
    for case in cases:
        generator = np.random.default_rng([seed, 9, [*CASES].index(case)])
        rows.append(row_of(CASES[case][1](stone, generator), case))
    return rows


def summary(rows):
    """What the rows of a benchmark show, by case.

    ``stones``, of which ``answered``; ``pressed``, stones whose use is claimed; median errors of
    ``y_mm``, ``x_mm`` and ``log_radius``; for the three together ``held_50`` and ``held_95``,
    percent of the truths inside the middle 50 and 95 % of the draws; ``spread_mm_95``, stones whose
    spread is inside; median errors of the losses, ``told``, ``inferred`` and ``known``, and
    ``inferred_ratio``, the median of the second over the third, and ``mean_ratio``, that of their
    means.
    """
    summaries = {}
    for case, trials in rows.groupby("case", sort=False):
        answered = trials[trials.log_score.notna()]
        row = {"stones": len(trials), "answered": len(answered)}
        row["pressed"] = (trials.answer == PRESSED).sum()
        if case not in UNPRESSED:
            row |= coverage(answered)
            row["inferred_ratio"] = (answered.inferred / answered.known).median()
            row["mean_ratio"] = answered.inferred.mean() / answered.known.mean()
        summaries[case] = row | answered[[*ERRORS]].median().to_dict()
    return pd.DataFrame(summaries).T


def coverage(rows):
    """How far the truths lie from the means of the draws, and how many inside their regions."""
    row = {
        name: abs(rows[f"mean_{name}"] - rows[f"true_{name}"]).median()
        for name in _POINT
    }
    off = abs(rows[[f"below_{name}" for name in _POINT]] - 0.5)
    for share in (50, 95):
        row[f"held_{share}"] = 100 * (off <= share / 200).to_numpy().mean()
    is_inside = abs(rows.below_spread_mm - 0.5) <= 0.475
    return row | {"spread_mm_95": is_inside.sum()}


def write_grades(file):
    """The patch table of a tool of which there are grades alone."""
    config = specimen_config()
    patches = worn_patches(config)
    ((_, study),) = specimen_studies(config, patches, ARTEFACT_SEED, [LAW])
    measured, losses = losses_of(patches, study.registration)
    grade = grades_of(losses, np.random.default_rng([ARTEFACT_SEED, 9])).grade
    table = measured[["patch", "x_mm", "y_mm"]].assign(wear_grade=grade)
    file.write_text(HEAD + table.to_csv(sep="\t", index=False, float_format="%.10g"))


def ordered(rows):
    """Rows by case, then by stone."""
    rows = rows.astype({"case": str})  # some have a number for a name
    place = rows.case.map([*CASES].index)
    return rows.iloc[np.lexsort([rows.seed, place])]


def made(file):
    """The rows that a file holds."""
    return ordered(read_table(file))


def stones_to_make(names, seeds, file):
    """Seeds, of these, and the cases of each that have no rows."""
    rows = made(file)[["seed", "case"]] if file.exists() else pd.DataFrame()
    there = set(rows.itertuples(index=False, name=None))
    for seed in seeds:
        wanted = (name for name in names if seed < SEEDS[0] + CASES[name][0])
        if missing := [name for name in wanted if (seed, name) not in there]:
            yield seed, missing


def main():
    chosen = options(
        __doc__,
        RESULT,
        cases={"nargs": "+", "default": list(CASES), "choices": list(CASES)},
        seeds=list(SEEDS),
        grades={"type": Path, "help": "write the table of the artefact alone"},
    )
    if chosen.grades:
        write_grades(chosen.grades)
        return
    if not chosen.tables:
        config = merged(specimen_config(), {"specimen": COARSE})
        make = partial(stone_rows, config, worn_patches(config))
        tasks = [*stones_to_make(chosen.cases, chosen.seeds, chosen.output)]
        add_rows(chosen.output, make, tasks, chosen.processes, order=ordered)
    print(summary(made(chosen.output)).round(2).T.to_string())


if __name__ == "__main__":
    main()
