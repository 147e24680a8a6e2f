"""What the study's two shortcuts cost, over many synthetic specimens: docs/explanation/evidence.md.

    python benchmarks/two_scales.py [--plan forms errors detail] [--seeds 3001 ...]

The study presses a coarse face and small patches, and the paper a square alone. Both are held
against the stone at rest: the true face under the true force, and in it one contact of the true
square at the scans' resolution. A *case* is a set of errors (`TRIALS`), a form of the active tool
and how far, in mm along each axis, the true load point lies from the middle, where the study
takes it to be. Every case gives a row for each variant. A specimen that the rows have in the last
case of a plan is not made again. Then the tables of the seeds are printed.

- ``forms``: three forms and three distances, scans of 6.64 µm (20 s of CPU a specimen);
- ``errors``: one error changed at a time, 200 mm, likewise (30 s);
- ``detail``: the default study's own scans of 1.66 µm, 200 mm, and without the S-filter
  (1 minute, 2 GB).
"""

from itertools import groupby, product
from pathlib import Path
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pandas as pd
import trimesh
import xarray as xr
import yaml
from runner import RESULTS, add_rows, options
from specimens import changed, merged, specimen_config, study_of, take

from gst.config.reading import read_study
from gstlib.coupling.intervals import Errors, Macroscale, draw_point, pressure_intervals
from gstlib.coupling.placement import ALL
from gstlib.coupling.pressures import patch_pressures
from gstlib.io.tables import read_table
from gstlib.macroscale.active_tool import rounded_counterface
from gstlib.microscale.patches import EQUILIBRIUM, PAPER
from gstlib.specimen.generate import within_square
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.specimen.scanning import place_scans, sample, take_scan
from gstlib.specimen.stone import Stone
from gstlib.surfaces.footprints import PatchPosition, places_of, square_of
from gstlib.surfaces.grid import make_surface, spacing_of
from gstlib.surfaces.leveling import remove_plane
from gstlib.validation.masks import ratio
from gstlib.validation.single_scale import (
    patches_of_reference,
    solve_reference,
    two_scales_table,
)
from gstlib.wear.archard import wear_contact

ROWS = RESULTS / "two_scales.csv"
TRIALS = yaml.safe_load(Path(__file__).with_suffix(".yaml").read_text())
# The pebble's dish has about 1000 mm: that active tool fits it, so that the gap is flat but for
# 3 µm (r.m.s. over the face). A flat would rest on the rim, and the square would not touch.
RADII_MM = 60.0, 200.0, 1000.0
DISTANCES_MM = 0.0, 1.0, 3.0
COARSE = {"specimen": {"scan_points": 128, "scan_spacing_um": 6.64}}
CAN_BE_KNOWN = {"young_log_sd": 0.0, "poisson": 0.0}  # the specimen's constants are
EDGE = 0.02  # share of a side
TRUE = "true face"
SEEDS = list(range(3001, 3021))
RESAMPLES = 9999
LOADED_MPA = 1.0
# The face loses as much as the default specimen's square does, by Archard's law.
LOST_MM, WEAR_STEPS = 0.25e-3, 4


class Case(NamedTuple):
    trial: str
    radius_mm: float
    distance_mm: float


def cases_of(*trials):
    """The default form, with the load point known."""
    return [Case(trial, 200.0, 0.0) for trial in trials]


# Of each plan, what all cases change in the config; the cases; and those with intervals, too.
_, *ERRORS, NO_FILTER = TRIALS
FORMS = [Case("default", *form) for form in product(RADII_MM, DISTANCES_MM)]
PLANS = {
    "forms": (COARSE, FORMS, [Case("default", 200.0, 1.0)]),
    "errors": (COARSE, cases_of(*ERRORS), []),
    "detail": ({}, cases_of("default", NO_FILTER), cases_of("default")),
}
KEY = ["scan_points", "seed", *Case._fields]
OF_ROW = ["scan_points", *Case._fields, "variant"]
SCORES = ["contact_fraction", "reference_contact_fraction", "precision"]
OF_FORCE = ["misplaced", "misplaced_of_all"]
OF_LOAD = ["square_N", "edge_of_square", "edge_of_face", "volume_error"]
OF_TILT = ["tilt_error_mrad", "stated_tilt_error_mrad"]
MEANS = OF_FORCE + OF_LOAD + OF_TILT
TABLES = ([*OF_FORCE, "f1", "area_ratio"], OF_LOAD, [*OF_TILT, "held", "loaded_held"])


class Truth(NamedTuple):
    """The stone at rest: contact of its face, of its square in detail, and what it loses there."""

    contact: xr.Dataset
    pressure: xr.DataArray
    lost: xr.DataArray


def measured(config, stone, patches):
    """The study of a stone that is measured with the config's errors; the truth about its scans."""
    parameters = SpecimenParameters(**config["specimen"])
    scans = {}
    places = []
    for row in patches.itertuples():
        nominal = PatchPosition(row.y_mm, row.x_mm, row.rotation_deg)
        options = {"square_mm": stone.square_mm, "poor_overlap": False}
        place, _ = place_scans(row.patch, nominal, parameters, **options)
        points = parameters.scan_points
        true = sample(stone.heights, stone, place, points, order=3, patch=row.patch)
        plane = remove_plane(make_surface(true, parameters.scan_spacing_mm))[1]
        scans[row.patch, "T0"], _ = take_scan(true, row.patch, "T0", parameters)
        slopes = {"true_slope_y": plane.slope_y, "true_slope_x": plane.slope_x}
        places.append({"patch": row.patch} | place._asdict() | slopes)
    own = Stone(parameters, stone.square_mm)
    mesh = trimesh.Trimesh(*own.mesh(), process=False)
    specimen = SimpleNamespace(mesh=mesh, scans=scans)
    return study_of(config, patches, specimen), pd.DataFrame(places)


def under(study, radius_mm):
    """The same study, with an active tool of another radius."""
    middle = 2 * (study.config["square"]["size_mm"] / 2,)
    over = rounded_counterface(study.face.height, radius_mm, middle)
    other = changed(study, {"counterface": {"radius_mm": radius_mm}})
    take(other, study, ["square_contact"])
    other.prepared.update(study.prepared)
    other.face = study.face.assign(counterface=over)
    other.composite = study.composite.assign(counterface=over)
    return other


def truth_of(study, stone, distance_mm):
    """The true stone at rest under the true force, which acts so far from the middle.

    It is the contact of the same study, were its face the true one, and its load point known.
    """
    config = study.config
    size_mm = stone.square_mm
    grid = config["macroscale"]["grid"]
    around = (study.face.sizes["x"] - grid) // 2
    height = study.face.height.copy(data=stone.face_means(grid, around))
    generator = np.random.default_rng([stone.parameters.seed, 6])
    y, x = draw_point(height, (size_mm / 2, size_mm / 2), distance_mm, generator)
    true = changed(study, {"load": {"at_mm": [x, y]}})
    true.composite = study.face.assign(height=height)
    contact = true.contact
    heights = within_square(stone.heights, stone).astype(float)
    pressed = solve_reference(heights, contact)
    face_mm2 = height.size * np.prod(spacing_of(height))
    wear = wear_contact(
        contact,
        "true face",
        mean_pressure=contact.load.mean_pressure,
        mean_loss=LOST_MM * size_mm**2 / face_mm2,
        steps=WEAR_STEPS,
    )
    return Truth(contact, pressed.pressure, height.copy(data=wear.depth))


def edge_fraction(pressure):
    """Share of the load within 2 % of the side from the edges."""
    cut = round(EDGE * pressure.sizes["x"])
    rim = pressure.values.copy()
    rim[cut:-cut, cut:-cut] = 0
    return float(ratio(rim.sum(), pressure.values.sum()))


def volume_error(pressures, lost):
    """Summed error of the patches' losses over their sum, each predicted from the others'.

    A patch loses in proportion to its pressure, by a coefficient from the other patches.
    """
    others = pressures.sum() - pressures
    if not ((others > 0).all() and lost.any()):
        return np.nan  # at most one patch alone is loaded, or wears
    kappa = (lost.sum() - lost) / others
    return float(abs(kappa * pressures - lost).sum() / lost.sum())


def rows_of(study, places, contacts, truth):
    """How far each variant is from the truth: a row for each."""
    size_mm = study.config["square"]["size_mm"]
    reference = reference_of(study, places, truth)
    true = reference.pressure.values
    patch_mm = {"size_mm": study.config["scans"]["size_mm"]}
    lost = patch_pressures(truth.lost, places, **patch_mm).pressure_MPa  # mm, in fact
    at_rest = patch_pressures(truth.contact.pressure, places, **patch_mm)
    table = study.pressures
    rows = {}
    for variant, pressures, field in (
        (EQUILIBRIUM, table.pressure_MPa, study.contact.pressure),
        (PAPER, table.square_pressure_MPa, study.square_contact.pressure),
        (TRUE, at_rest.pressure_MPa, truth.contact.pressure),
    ):
        square = square_of(field, size_mm)
        rows[variant] = misplaced(pressures.to_numpy(), true, study.config) | {
            "square_N": float(square.sum() * np.prod(spacing_of(field))),
            "peak_MPa": float(square.max()),
            "edge_of_square": edge_fraction(square),
            "edge_of_face": edge_fraction(field) if variant != PAPER else np.nan,
            "volume_error": volume_error(pressures.to_numpy(), lost.to_numpy()),
        }
    scores = two_scales_table(contacts, reference.expand_dims("draw"))
    pooled = scores[scores.patch == ALL].set_index("variant")[SCORES]
    for variant, row in pooled.iterrows():
        rows.setdefault(variant, {}).update(row)
    rows[EQUILIBRIUM] |= tilt_errors(study.composite, places)
    rows[EQUILIBRIUM] |= {"patches": len(true), "loaded": (true > LOADED_MPA).sum()}
    return rows


def reference_of(study, places, truth):
    """The true contact of every scan."""
    scan = study.prepared[places.patch[0], "T0"].height
    return patches_of_reference(truth.pressure, places_of(places), scan)


def misplaced(pressures, true, config):
    """Share of the force on the wrong patch: of that on patches, and of all."""
    shares = ratio(pressures, pressures.sum()) - ratio(true, true.sum())
    patch_mm2 = config["scans"]["size_mm"] ** 2
    errors_N = (pressures - true) * patch_mm2
    all_N = abs(errors_N).sum() + abs(errors_N.sum())
    return {
        "misplaced": abs(shares).sum() / 2,
        "misplaced_of_all": all_N / 2 / config["load"]["force_N"],
        "true_N": true.sum() * patch_mm2,
    }


def tilt_errors(composite, places):
    """Errors of the planes that are known, r.m.s. along each axis, and the stated ones."""
    scans = composite.known.values
    stated = composite.tilt_error_mrad.values[scans]
    errors = np.array(
        [
            composite[f"slope_{axis}"].values - places[f"true_slope_{axis}"]
            for axis in "yx"
        ]
    )
    return {
        "tilt_error_mrad": 1e3 * float(np.sqrt(np.mean(errors[:, scans] ** 2))),
        "stated_tilt_error_mrad": float(np.sqrt(np.mean(stated**2))),
    }


def held_by_intervals(study, places, truth, error_mm):
    """How many true pressures lie in their intervals, of all patches and of those under load.

    The study knows the load point up to `error_mm` along each axis.
    """
    config = study.config
    errors = Errors(**config["uncertainty"] | CAN_BE_KNOWN)
    limits = pressure_intervals(
        Macroscale(study.face, study.composite, None),
        study.pressures,
        config["material"],
        errors._replace(load_point_mm=error_mm),
        force_N=config["load"]["force_N"],
        load_point=2 * (config["square"]["size_mm"] / 2,),
        patch_mm=config["scans"]["size_mm"],
        seed=config["seed"],
    )
    true = reference_of(study, places, truth).pressure.values
    held = (limits.low_MPa <= true) & (true <= limits.high_MPa)
    return {"held": held.sum(), "loaded_held": held[true > LOADED_MPA].sum()}


def specimen(plan, seed):
    """The rows of one specimen in all cases of a plan."""
    changes, cases, bounded = PLANS[plan]
    config = merged(specimen_config(), changes | {"use": None})
    config = merged(config, {"specimen": {"seed": seed}})
    config["microscale"]["tolerance"] = 1e-6  # no point of contact changes
    patches = read_study(config, "config").assign(t1="")  # scanned before use alone
    parameters = SpecimenParameters(**config["specimen"])
    stone = Stone(parameters, config["square"]["size_mm"])
    truths = {}
    tables = []
    for (trial, radius_mm), group in groupby(cases, lambda case: case[:2]):
        study, places = measured(merged(config, TRIALS[trial]), stone, patches)
        study = under(study, radius_mm)
        contacts = {
            variant: {patch: study.contact_in(variant, patch) for patch in places.patch}
            for variant in (EQUILIBRIUM, PAPER)
        }
        for case in group:
            form = radius_mm, case.distance_mm
            if form not in truths:
                truths[form] = truth_of(study, stone, case.distance_mm)
            truth = truths[form]
            rows = rows_of(study, places, contacts, truth)
            if case in bounded:
                rows[EQUILIBRIUM] |= held_by_intervals(
                    study, places, truth, case.distance_mm
                )
            table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("variant")
            table = table.reset_index()
            table[KEY] = parameters.scan_points, seed, *case
            tables.append(table)
    made = pd.concat(tables, ignore_index=True)
    return made[[*KEY, *made.columns.drop(KEY)]]


def interval(part, whole):
    """Ratio of two sums over specimens, with a 95 % bootstrap interval."""
    pairs = np.stack([part, whole], axis=1).astype(float)
    pairs = pairs[np.isfinite(pairs).all(axis=1)]
    if not len(pairs):
        return ""
    generator = np.random.default_rng(1)
    drawn = generator.integers(0, len(pairs), (RESAMPLES, len(pairs)))
    parts, wholes = pairs[drawn].sum(axis=1).T
    value = np.divide(*pairs.sum(axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = np.nanpercentile(parts / wholes, [2.5, 97.5])
    return f"{value:.3f} [{low:.3f}, {high:.3f}]"


def summary(rows):
    """By case and variant: means over specimens, scores pooled, with 95 % bootstrap intervals."""
    summaries = []
    for key, group in rows.groupby(OF_ROW, sort=False):
        touching, true = group.contact_fraction, group.reference_contact_fraction
        hits = touching * group.precision.fillna(0)
        ratios = {name: (group[name], np.ones(len(group))) for name in MEANS} | {
            "f1": (2 * hits, touching + true),
            "area_ratio": (touching, true),
            "held": (group.held, group.patches),
            "loaded_held": (group.loaded_held, group.loaded),
        }
        row = dict(zip(OF_ROW, key, strict=True)) | {"specimens": len(group)}
        row |= {name: interval(*sums) for name, sums in ratios.items()}
        summaries.append(row)
    return pd.DataFrame(summaries)


def is_made(rows, plan, seed):
    """Whether rows have the last case of a plan of one specimen."""
    changes, cases, _ = PLANS[plan]
    points = merged(specimen_config(), changes)["specimen"]["scan_points"]
    return (rows[KEY] == [points, seed, *cases[-1]]).all(axis=1).any()


def main():
    plans = {"nargs": "*", "choices": PLANS, "default": []}
    chosen = options(__doc__, ROWS, plan=plans, seeds=SEEDS)
    rows = pd.DataFrame(columns=KEY)
    if chosen.output.exists():
        rows = read_table(chosen.output)
    tasks = [
        (plan, seed)
        for plan, seed in product(chosen.plan, chosen.seeds)
        if not is_made(rows, plan, seed)
    ]
    add_rows(chosen.output, specimen, tasks, chosen.processes, digits=5)
    rows = read_table(chosen.output)
    table = summary(rows[rows.seed.isin(chosen.seeds)])
    for columns in TABLES:
        print(table[[*OF_ROW, "specimens", *columns]].to_string(index=False))


if __name__ == "__main__":
    main()
