"""What the study's two shortcuts cost, over many synthetic specimens: docs/explanation/evidence.md.

    python benchmarks/two_scales.py [--plan forms errors detail] [--seeds 3001 ...]

The study presses a coarse face and small patches, and the paper a square alone. Both are held
against the stone at rest: the true face under the true force, and in it one contact of the true
square at the scans' resolution. A *case* is a set of errors (`TRIALS`), a form of the active tool
and how far, in mm along each axis, the true load point lies from the middle, where the study
takes it to be. Every case gives a row for each variant, written as soon as it is found; a case that
the rows hold already is not computed again. Then the tables of the seeds are printed.

- ``forms``: three forms and three distances, scans of 6.64 µm (20 s of CPU a specimen);
- ``errors``: one error changed at a time, 200 mm, likewise (30 s);
- ``detail``: the default study's own scans of 1.66 µm, 200 mm, with trials of the S-filter
  (1 minute, 2 GB).
"""

from itertools import groupby, product
from typing import NamedTuple

import numpy as np
import pandas as pd
import trimesh
import xarray as xr
from runner import RESULTS, ROOT, options, save
from specimens import changed, merged, specimen_config, take

from gst.config.patches import read_patches
from gstlib.coupling.intervals import Errors, Macroscale, draw_point, pressure_intervals
from gstlib.coupling.placement import ALL
from gstlib.coupling.pressures import patch_pressures
from gstlib.macroscale.active_tool import rounded_counterface
from gstlib.microscale.patches import EQUILIBRIUM, PAPER
from gstlib.specimen.generate import within_square
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.specimen.scanning import place_scans, sample, take_scan
from gstlib.specimen.stone import Stone
from gstlib.study import Study
from gstlib.surfaces.footprints import (
    PatchPosition,
    footprint_weights,
    places_of,
    square_of,
)
from gstlib.surfaces.grid import make_surface, spacing_of
from gstlib.surfaces.leveling import remove_plane
from gstlib.validation.single_scale import (
    patches_of_reference,
    solve_reference,
    two_scales_table,
)
from gstlib.wear.archard import wear_contact

ROWS = RESULTS / "two_scales.csv"
# What each trial changes in the config; the first has all errors as they are.
TRIALS = {
    "default": {},
    "mesh noise 0 µm": {"specimen": {"mesh_noise_um": 0.0}},
    "mesh noise 2 µm": {"specimen": {"mesh_noise_um": 2.0}},
    "mesh noise 10 µm": {"specimen": {"mesh_noise_um": 10.0}},
    "placement 0 µm": {"specimen": {"placement_error_um": 0.0}},
    "placement 100 µm": {"specimen": {"placement_error_um": 100.0}},
    "linear gridding": {"macroscale": {"interpolation": "linear"}},
    "S-filter none": {"microscale": {"s_filter_um": None}},
    "S-filter 10 µm": {"microscale": {"s_filter_um": 10.0}},
}
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
_, *ERRORS, NO_FILTER, WIDE_FILTER = TRIALS
FORMS = [Case("default", *form) for form in product(RADII_MM, DISTANCES_MM)]
PLANS = {
    "forms": (COARSE, FORMS, [Case("default", 200.0, 1.0)]),
    "errors": (COARSE, cases_of(*ERRORS), []),
    "detail": ({}, cases_of("default", NO_FILTER, WIDE_FILTER), cases_of("default")),
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


def scanned(stone, surface, patches, parameters):
    """Scans before use; their true places and slopes."""
    scans = {}
    places = []
    for row in patches.itertuples():
        nominal = PatchPosition(row.y_mm, row.x_mm, row.rotation_deg)
        place, _ = place_scans(
            row.patch,
            nominal,
            parameters,
            square_mm=stone.square_mm,
            poor_overlap=False,
        )
        true = sample(
            surface, stone, place, parameters.scan_points, order=3, patch=row.patch
        )
        plane = remove_plane(make_surface(true, parameters.scan_spacing_mm))[1]
        scans[row.patch], _ = take_scan(true, row.patch, "T0", parameters)
        slopes = {"true_slope_y": plane.slope_y, "true_slope_x": plane.slope_x}
        places.append({"patch": row.patch} | place._asdict() | slopes)
    return scans, pd.DataFrame(places)


def study_of(config, surface, patches):
    """The study of a stone that is measured with the config's errors; the truth about its scans."""
    parameters = SpecimenParameters(**config["specimen"])
    stone = Stone(parameters, config["square"]["size_mm"])
    scans, places = scanned(stone, surface, patches, parameters)
    vertices, faces = stone.mesh()
    study = Study(
        config,
        patches,
        read_mesh=lambda: trimesh.Trimesh(vertices, faces, process=False),
        read_scan=lambda patch, epoch: scans[patch],
    )
    return study, places


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


def truth_of(study, stone, surface, distance_mm):
    """The true stone at rest under the true force, which acts so far from the middle.

    It is the contact of the same study, were its face the true one, and its load point known.
    """
    config = study.config
    size_mm = stone.square_mm
    grid = config["macroscale"]["grid"]
    around = (study.face.sizes["x"] - grid) // 2
    height = study.face.height.copy(data=stone.face_means(grid, around))
    generator = np.random.default_rng([config["specimen"]["seed"], 6])
    y, x = draw_point(height, (size_mm / 2, size_mm / 2), distance_mm, generator)
    true = changed(study, {"load": {"at_mm": [x, y]}})
    true.composite = study.face.assign(height=height)
    contact = true.contact
    heights = within_square(surface, stone).astype(float)
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


def ratio(part, whole):
    """NaN where there is no whole: in the square there may be no contact."""
    return part / whole if whole > 0 else np.nan * part


def edge_fraction(pressure):
    """Share of the load within 2 % of the side from the edges."""
    cut = round(EDGE * pressure.sizes["x"])
    rim = pressure.values.copy()
    rim[cut:-cut, cut:-cut] = 0
    return ratio(rim.sum(), pressure.values.sum())


def volume_error(pressures, lost):
    """Summed error of the patches' losses over their sum, each predicted from the others'.

    A patch loses in proportion to its pressure, by a coefficient from the other patches.
    """
    others = pressures.sum() - pressures
    if not ((others > 0).all() and lost.any()):
        return np.nan  # at most one patch alone is loaded, or wears
    kappa = (lost.sum() - lost) / others
    return float(abs(kappa * pressures - lost).sum() / lost.sum())


class Predicted(NamedTuple):
    """What a study says of a stone under one active tool, and what is true of its scans."""

    study: Study
    places: pd.DataFrame
    contacts: dict

    @classmethod
    def by(cls, study, places):
        contacts = {
            variant: {patch: study.contact_in(variant, patch) for patch in places.patch}
            for variant in (EQUILIBRIUM, PAPER)
        }
        return cls(study, places, contacts)

    @property
    def size_mm(self):
        return self.study.config["square"]["size_mm"]

    @property
    def patch_mm(self):
        return self.study.config["scans"]["size_mm"]

    @property
    def force(self):
        return self.study.config["load"]["force_N"]

    def reference(self, truth):
        """The true contact of every scan."""
        scan = self.study.prepared[self.places.patch[0], "T0"].height
        return patches_of_reference(truth.pressure, places_of(self.places), scan)


def rows_of(predicted, truth):
    """How far each variant is from the truth."""
    study, places, contacts = predicted
    reference = predicted.reference(truth)
    true = reference.pressure.values
    lost = losses(truth, predicted)
    rows = {}
    for variant, (pressures, field) in pressures_by_variant(predicted, truth).items():
        square = square_of(field, predicted.size_mm)
        rows[variant] = misplaced(pressures.to_numpy(), true, predicted) | {
            "square_N": float(square.sum() * np.prod(spacing_of(field))),
            "peak_MPa": float(square.max()),
            "edge_of_square": edge_fraction(square),
            "edge_of_face": edge_fraction(field) if variant != PAPER else np.nan,
            "volume_error": volume_error(pressures.to_numpy(), lost),
        }
    table = two_scales_table(contacts, reference.expand_dims("draw"))
    pooled = table[table.patch == ALL].set_index("variant")
    for variant, scores in pooled[SCORES].iterrows():
        rows.setdefault(variant, {}).update(scores)
    rows[EQUILIBRIUM] |= tilt_errors(study.composite, places)
    rows[EQUILIBRIUM] |= {"patches": len(true), "loaded": (true > LOADED_MPA).sum()}
    return rows


def losses(truth, predicted):
    """True mean loss of each patch, mm."""
    places = places_of(predicted.places).values()
    weights = [
        footprint_weights(truth.lost, place, predicted.patch_mm) for place in places
    ]
    return np.array([np.average(truth.lost.values, weights=each) for each in weights])


def pressures_by_variant(predicted, truth):
    """The pressures of the patches, and the field that they are taken from."""
    study = predicted.study
    field = truth.contact.pressure
    pressures = study.pressures
    true = patch_pressures(field, predicted.places, size_mm=predicted.patch_mm)
    return {
        EQUILIBRIUM: (pressures.pressure_MPa, study.contact.pressure),
        PAPER: (pressures.square_pressure_MPa, study.square_contact.pressure),
        TRUE: (true.pressure_MPa, field),
    }


def misplaced(pressures, true, predicted):
    """Share of the force on the wrong patch: of that on patches, and of all."""
    shares = ratio(pressures, pressures.sum()) - ratio(true, true.sum())
    patch_mm2 = predicted.patch_mm**2
    errors_N = (pressures - true) * patch_mm2
    elsewhere_N = -errors_N.sum()
    all_N = abs(errors_N).sum() + abs(elsewhere_N)
    return {
        "misplaced": abs(shares).sum() / 2,
        "misplaced_of_all": all_N / 2 / predicted.force,
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


def held_by_intervals(predicted, truth, error_mm):
    """How many true pressures lie in their intervals, of all patches and of those under load.

    The study knows the load point up to `error_mm` along each axis.
    """
    study = predicted.study
    size_mm = predicted.size_mm
    errors = study.config["uncertainty"] | CAN_BE_KNOWN
    limits = pressure_intervals(
        Macroscale(study.face, study.composite, None),
        study.pressures,
        study.config["material"],
        Errors(**errors)._replace(load_point_mm=error_mm),
        force_N=predicted.force,
        load_point=(size_mm / 2, size_mm / 2),
        patch_mm=predicted.patch_mm,
        seed=study.config["seed"],
    )
    true = predicted.reference(truth).pressure.values
    held = (limits.low_MPa <= true) & (true <= limits.high_MPa)
    return {"held": held.sum(), "loaded_held": held[true > LOADED_MPA].sum()}


def specimen(config, seed, cases, bounded):
    """The rows of each case of one specimen."""
    size_mm = config["square"]["size_mm"]
    patches = read_patches(
        ROOT / config["patches"],
        size_mm=size_mm,
        patch_size_mm=config["scans"]["size_mm"],
    ).assign(t1="")  # they are scanned before use alone
    config = merged(config, {"specimen": {"seed": seed}})
    parameters = SpecimenParameters(**config["specimen"])
    stone = Stone(parameters, size_mm)
    surface = stone.heights().astype(np.float32)
    truths = {}
    for trial, of_trial in groupby(cases, lambda case: case.trial):
        study, places = study_of(merged(config, TRIALS[trial]), surface, patches)
        for radius_mm, of_form in groupby(of_trial, lambda case: case.radius_mm):
            predicted = Predicted.by(under(study, radius_mm), places)
            for case in of_form:
                form = radius_mm, case.distance_mm
                if form not in truths:
                    truths[form] = truth_of(
                        predicted.study, stone, surface, case.distance_mm
                    )
                rows = rows_of(predicted, truths[form])
                if case in bounded:
                    rows[EQUILIBRIUM] |= held_by_intervals(
                        predicted, truths[form], case.distance_mm
                    )
                table = pd.DataFrame.from_dict(rows, orient="index").rename_axis(
                    "variant"
                )
                values = dict(
                    zip(KEY, [parameters.scan_points, seed, *case], strict=True)
                )
                table = table.reset_index().assign(**values)
                yield table[[*KEY, *table.columns.drop(KEY)]]


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
        touching = group.contact_fraction
        true = group.reference_contact_fraction
        hits = touching * group.precision.fillna(0)
        row = dict(zip(OF_ROW, key, strict=True)) | {"specimens": len(group)}
        row |= {name: interval(group[name], np.ones(len(group))) for name in MEANS}
        row["f1"] = interval(2 * hits, touching + true)
        row["area_ratio"] = interval(touching, true)
        row["held"] = interval(group.held, group.patches)
        row["loaded_held"] = interval(group.loaded_held, group.loaded)
        summaries.append(row)
    return pd.DataFrame(summaries)


def missing_cases(rows, seed, scan_points, cases):
    """Cases of a specimen that the rows do not hold."""
    there = rows[(rows.seed == seed) & (rows.scan_points == scan_points)][
        [*Case._fields]
    ]
    return [case for case in cases if not (there == case).all(axis=1).any()]


def main():
    plans = {"nargs": "*", "choices": PLANS, "default": []}
    chosen = options(__doc__, ROWS, plan=plans, seeds=SEEDS)
    rows = pd.DataFrame(columns=[*KEY, "held", "loaded_held"])
    if adds := chosen.output.exists():
        rows = pd.read_csv(chosen.output)
    for plan in chosen.plan:
        changes, cases, bounded = PLANS[plan]
        config = merged(specimen_config(), changes | {"use": None})
        config["microscale"]["tolerance"] = 1e-6  # no point of contact changes
        for seed in chosen.seeds:
            cases_left = missing_cases(
                rows, seed, config["specimen"]["scan_points"], cases
            )
            for made in specimen(config, seed, cases_left, bounded):
                rows = pd.concat([rows, made], ignore_index=True)
                save(chosen.output, rows, digits=5, adds=adds)
            print(f"{plan}, seed {seed}: done", flush=True)
    table = summary(rows[rows.seed.isin(chosen.seeds)])
    for columns in TABLES:
        print(table[[*OF_ROW, "specimens", *columns]].to_string(index=False))


if __name__ == "__main__":
    main()
