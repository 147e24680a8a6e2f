# What every stage shares: the checked configuration, the patch table, names of files.

import os
import re
import sys
from functools import cache
from pathlib import Path

from gstlib.config import (
    alternative_contact_modulus,
    check_config,
    check_files,
    check_hardness,
    check_interpreter,
    measured_files,
    study_contact_modulus,
    study_poisson,
)
from gstlib.errors import InputError
from gstlib.io.files import check_writable
from gstlib.io.patches import read_patches
from gstlib.io.tables import read_table
from gstlib.provenance import commit, source_hash
from gstlib.sweep.factors import SWEPT, sweep_settings

SCHEMAS = Path(workflow.basedir) / "workflow/schemas"
SCRIPTS = Path(workflow.basedir) / "workflow/scripts"

CONFIG_FILES = " + ".join(os.path.relpath(file) for file in workflow.configfiles)

check_interpreter(sys.executable)
check_config(config, SCHEMAS / "config.schema.yaml", source=CONFIG_FILES)

RESULTS = config["results"].rstrip("/")
SQUARE_MM = config["square"]["size_mm"]
PATCH_MM = config["scans"]["size_mm"]
GENERATED = config["specimen"] is not None
CONTACT_MODULUS_MPA = study_contact_modulus(config["material"])
ALTERNATIVE_MODULUS_MPA = alternative_contact_modulus(config["material"])

PATCHES = read_patches(
    config["patches"],
    schema=SCHEMAS / "patches.schema.yaml",
    size_mm=SQUARE_MM,
    patch_size_mm=PATCH_MM,
).set_index("patch", drop=False)
WORN_PATCHES = [patch for patch in PATCHES.index if PATCHES.t1[patch]]
MESH = f"{RESULTS}/specimen/mesh.stl" if GENERATED else config["inputs"]["mesh"]
MARKER = config["square"]["frame"]["marker"]
SCAN_FOLDER = f"{RESULTS}/specimen/scans" if GENERATED else config["inputs"]["scan_folder"]
COUNTERFACE = None if config["counterface"] is None else config["counterface"]["scan"]
if not GENERATED:
    check_files(measured_files(config, PATCHES), source=f"{CONFIG_FILES}, {config['patches']}")
# A figure of a generated stone must not pass for one of a real tool.
SOURCE_NOTE = "generated specimen" if GENERATED else None


onstart:
    check_writable(RESULTS)
    # A limit on jobs a second makes Snakemake (9.27) look at all that wait anew every second, once for
    # each step that has ended: hundreds of times a second in a long run. Cores are the limit here.
    workflow.scheduler.job_rate_limiter = None


wildcard_constraints:
    patch="|".join(PATCHES.index),


def code(script):
    """Hash of the library code that `script` uses: a parameter, so that its change is a reason to rerun."""
    return source_hash(SCRIPTS / script)


def scan_files(epoch, patches):
    """The scans of the patches at `epoch` ("t0" or "t1")."""
    return [f"{SCAN_FOLDER}/{PATCHES[epoch][patch]}" for patch in patches]


def batches(patches):
    """The patches of each job that does many of them, and what tells its name from the others'."""
    size = config["patches_per_job"]
    parts = [patches[start : start + size] for start in range(0, len(patches), size)]
    if len(parts) == 1:
        return [("", parts[0])]
    return [(f"_{number}", part) for number, part in enumerate(parts, start=1)]


def named(patches):
    """The patches of a job in a few words."""
    return f"patches {patches[0]} to {patches[-1]}" if len(patches) > 1 else f"patch {patches[0]}"


@cache
def _pressures(table, state):
    pressures = read_table(table, ["patch", "pressure_MPa", "in_study"]).set_index("patch")
    if list(pressures.index) != list(PATCHES.index):
        raise InputError(
            table, "has not one row for each patch", "Delete it and run the study again."
        )
    return pressures


def read_pressures(table):
    """patch_pressures.csv by patch, read once. One cut off must not pass for a smaller study."""
    status = os.stat(table) if os.path.exists(table) else None
    return _pressures(str(table), status and (status.st_mtime_ns, status.st_size))


def studied_patches():
    """Patches in the microscale study, known once the scales are coupled."""
    pressures = read_pressures(checkpoints.couple_scales.get().output.table)
    return list(pressures.index[pressures.in_study])


def pressures_of(patches):
    """Macroscale pressure (MPa) of each of the patches, known once the scales are coupled."""
    pressures = read_pressures(checkpoints.couple_scales.get().output.table).pressure_MPa
    return pressures[patches].to_dict()


def patch_pressure(wildcards, input):
    """Params function: macroscale pressure (MPa) of the patch, known once the scales are coupled."""
    return float(read_pressures(input.pressures).pressure_MPa[wildcards.patch])


def crops_of(patches):
    """Centre [x, y] in mm of the piece to cut from each patch's scan, or None for a whole scan."""
    crops = PATCHES.loc[patches, ["crop_x_mm", "crop_y_mm"]]
    return [None if x != x else [float(x), float(y)] for x, y in crops.itertuples(index=False)]


# Each scan with the patch and the epoch that it is of, and the piece to cut from it.
SCAN_USES = [
    [f"{SCAN_FOLDER}/{name}", [patch, epoch.upper(), crop]]
    for patch, crop in zip(PATCHES.index, crops_of(PATCHES.index))
    for epoch in ("t0", "t1")
    if (name := PATCHES[epoch][patch])
]
if COUNTERFACE is not None:
    SCAN_USES.append([COUNTERFACE, ["counterface", "", None]])


def for_studied_patches(pattern, only=None):
    """Input function: `pattern` for every patch in the microscale study (and in `only`, if given)."""
    return lambda wildcards: [
        pattern.format(results=RESULTS, patch=patch)
        for patch in studied_patches()
        if only is None or patch in only
    ]


def drawn(patches):
    """Those of the patches that are drawn one by one: in even steps if there are too many."""
    count = min(len(patches), config["most_drawn_patches"])
    return [patches[place * len(patches) // count] for place in range(count)]


def drawn_patches(only=None):
    """The drawn ones of the studied patches (in `only`, if given), from hard to little pressed."""
    pressures = pressures_of(studied_patches())
    by_pressure = sorted(pressures, key=lambda patch: -pressures[patch])
    wanted = set(pressures if only is None else only)
    chosen = set(drawn([patch for patch in by_pressure if patch in wanted]))
    return [patch for patch in pressures if patch in chosen]  # in the table's order


def for_drawn_patches(pattern, only=None):
    """Input function: `pattern` for every patch that is drawn."""
    return lambda wildcards: [
        pattern.format(results=RESULTS, patch=patch) for patch in drawn_patches(only)
    ]


def note_on(drawn, all_):
    """What stands under a figure: where its data is from, and how many of all patches it shows."""
    some = f"{len(drawn)} of {len(all_)} patches" if len(drawn) < len(all_) else None
    return "; ".join(filter(None, [SOURCE_NOTE, some])) or None


def hardest_pressed():
    """The patch in the microscale study with the highest pressure."""
    pressures = pressures_of(studied_patches())
    return max(pressures, key=pressures.get)


def registered_of_hardest_pressed(wildcards):
    patch = hardest_pressed()
    return f"{RESULTS}/registered/{patch}.h5" if patch in WORN_PATCHES else []


# Kind and content are one label: of a second one with two values, each for half of a category,
# Snakemake's report makes a switch, and fails where not every content is of both kinds.
def picture(name, category, what):
    """The PNG of a figure, with its place in the report; caption and figure share their name."""
    return report(
        f"{RESULTS}/figures/{name}.png",
        caption=f"../report/{name}.rst",
        category=category,
        labels={"what": f"figure: {what}"},
    )


def pictures(name, category, what):
    """A folder with a PNG (in the report) and an SVG for each patch."""

    def labels(wildcards):
        # The report sorts texts, and 10 before 2; a page does not show spaces in front.
        longest = max(map(len, PATCHES.index))
        return {"what": f"figure: {what}", "patch": wildcards.patch.rjust(longest)}

    return report(
        directory(f"{RESULTS}/figures/{name}"),
        patterns=["{patch}.png"],
        caption=f"../report/{name}.rst",
        category=category,
        labels=labels,
    )


def vector(name):
    """The SVG of a figure."""
    return f"{RESULTS}/figures/{name}.svg"


# Known before the first job: these stand in every plan.
FIXED_TARGETS = [
    f"{RESULTS}/{name}"
    for name, wanted in {
        "provenance.json": True,
        "tables/inputs.csv": True,
        "tables/preprocessing.csv": True,
        "tables/outliers.csv": True,
        "tables/gridding.csv": True,
        "tables/macroscale_path.csv": True,
        "tables/sensitivity.csv": ALTERNATIVE_MODULUS_MPA is not None,
        "tables/placement.csv": True,
        "tables/registration.csv": bool(WORN_PATCHES),
        "tables/patch_pressures.csv": True,
        "tables/patch_intervals.csv": True,
        "tables/texture.csv": True,
        "figures/texture.png": bool(WORN_PATCHES),
        "tables/published.csv": config["published"] is not None,
        "tables/truth.csv": GENERATED,
        "figures/inputs.png": True,
        "figures/macroscale_curves.png": True,
        "figures/preparation": True,
        "figures/placement.png": True,
        "figures/published.png": config["published"] is not None,
        "figures/truth.png": GENERATED,
    }.items()
    if wanted
]


def studied_targets(wildcards):
    """Input function: what there is of the patches in the microscale study, which may be none."""
    studied = studied_patches()
    # here, before hours are spent on the patches
    check_hardness(config["hardness"], pressures_of(studied), source=CONFIG_FILES)
    scored = [patch for patch in studied if patch in WORN_PATCHES]
    names = []
    if studied:
        names += ["tables/microscale_summary.csv", "tables/microscale_paths.csv"]
        names += ["figures/overview.png", "figures/microscale_maps.png"]
        names += [
            name
            for section, case in [("grinding", "slip"), ("hardness", "hardness")]
            if config[section] is not None
            for name in (f"tables/{case}.csv", f"figures/{case}.png")
        ]
    if scored:
        names += ["tables/validation_patches.csv", "tables/validation_summary.csv"]
        names += ["figures/validation.png", "figures/patch"]
    return [f"{RESULTS}/{name}" for name in names]
