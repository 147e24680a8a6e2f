# Shared by all stages: the checked config, the patch table, the resources of a job.

import math
import os
import sys
from pathlib import Path

from gst import ROOT
from gst.run.batches import share_out
from gst.run.chain import AGAIN, hashes_of
from gst.config.reading import asked_of_files, complete, read_config_file, read_study
from gst.config.contradictions import check_files, counterface_mesh, files_read, improbable
from gst.run.owned import claim, move_aside, refuse_foreign, written_by
from gst.config.patches import scan_files
from gst.config.poses import batches_of, poses_of, reach_of
from gst.run.provenance import commit, program_hash, source_hash
from gst.run.scheduler import adapt, steps_of
from gst.config.tables import TABLES
from gst.page.captions import table_caption
from gstlib.conditions import rounded_form, study_poisson, study_radius
from gstlib.io.files import sha256
from gstlib.preprocess.mesh import elements_around
from gstlib.settings import Settings
from snakemake.utils import update_config

CONFIG_FILES = " + ".join(os.path.relpath(file) for file in workflow.configfiles)

# Snakemake reads YAML 1.1. The values are those that `gst check` reads, and a file that it refuses is
# refused here, too. A module's config comes from the workflow around it, as Snakemake reads it.
if not workflow.modifier.skip_configfile:
    config.clear()
    for config_file in workflow.configfiles:
        update_config(config, read_config_file(config_file))
    update_config(config, workflow.config_settings.config)  # of the command line

# Patches that share a job, from the profile; no result depends on it.
PER_JOB = config.pop("patches_per_job", None)
config.update(complete(config))
# The tables as they are before they are read: an edit during the run has to be seen.
GIVEN_TABLES = [config["patches"], config["published"], (config["gesture"] or {}).get("table")]
TABLE_DIGESTS = {
    table: sha256(table) for table in filter(None, GIVEN_TABLES) if os.path.isfile(table)
}
PATCHES = read_study(config, CONFIG_FILES)
# Faults in its own values that the config accepts, for the page.
CONFIG_FAULTS = [
    {"text": f"{fault.source}: {fault.problem}.", "steps": ["config"], "patches": fault.patches}
    for fault in improbable(config, PATCHES)
]
PATCHES = PATCHES.set_index("patch", drop=False)
# Places with a grade of wear, where there are grades in place of scans.
IS_GRADED = (PATCHES.t0 == "") & PATCHES.wear_grade.notna()
GRADED = PATCHES.loc[IS_GRADED, ["patch", "x_mm", "y_mm", "rotation_deg", "wear_grade"]]
PATCHES = PATCHES[PATCHES.t0 != ""]
# Without scans, the study proposes positions to scan, and steps that need scans are left out.
SCANNED = len(PATCHES) > 0
# as Snakemake names the files in it
RESULTS = os.path.normpath(config["results"])
SQUARE_MM = config["square"]["size_mm"]
PATCH_MM = config["scans"]["size_mm"]
GENERATED = config["specimen"] is not None
# Of the coupling: the study's own, and the paper's to compare it with.
EQUILIBRIUM = config["coupling"] == "equilibrium"
VARIANTS = ["equilibrium", "paper"] if EQUILIBRIUM else ["paper"]

ALL_PATCHES = list(PATCHES.index)
WORN_PATCHES = [patch for patch in ALL_PATCHES if PATCHES.t1[patch]]
REPEATED_PATCHES = [patch for patch in ALL_PATCHES if PATCHES["repeat"][patch]]
MESH = f"{RESULTS}/specimen/mesh.stl" if GENERATED else config["inputs"]["mesh"]
MESH_UNIT = "mm" if GENERATED else config["inputs"]["mesh_unit"]
SCAN_FOLDER = f"{RESULTS}/specimen/scans" if GENERATED else config["inputs"]["scan_folder"]
COUNTERFACE_SCAN = (config["counterface"] or {}).get("scan", [])
# The active tool, where there is a mesh of it, and the poses of a gesture.
ACTIVE_TOOL = counterface_mesh(config, f"{RESULTS}/specimen")
COUNTERFACE_MESH = ACTIVE_TOOL["mesh"] if ACTIVE_TOOL else []
POSES = poses_of(config)
if ACTIVE_TOOL:
    ACTIVE_TOOL["reach_mm"] = reach_of(config, POSES)
# Config values of each stage, by rule.
SETTINGS = Settings(**config).by_stage()
# A claim about other patches does not apply to these.
if not set(config["validation"]["expected_most_worn"]) <= set(ALL_PATCHES):
    SETTINGS["score_wear"]["expected_most_worn"] = []
LOAD = {name: SETTINGS["solve_macroscale"][name] for name in ("force_N", "load_point")}
# How the tool was used is read from its wear, where the stone is free to tilt.
INFERRED = EQUILIBRIUM and config["use"] is not None and (bool(WORN_PATCHES) or len(GRADED) > 0)
REFERENCE = EQUILIBRIUM and SCANNED and config["reference_realisations"] is not None
if not GENERATED:
    check_files(config, PATCHES, CONFIG_FILES)
SCAN_USES = scan_files(PATCHES, SCAN_FOLDER, COUNTERFACE_SCAN or None)
SCANS = sorted({str(use.path) for use in SCAN_USES})


wildcard_constraints:
    batch=r"\d+",
    epoch="T0|T1|repeat",


def among(patches):
    """The batches that hold some of these patches, with those alone."""
    shared = {batch: [p for p in ids if p in patches] for batch, ids in BATCHES.items()}
    return {batch: ids for batch, ids in shared.items() if ids}


# The patches of each job that takes several, by batch; all of them, and those with a T1 or a repeat.
BATCHES = share_out(ALL_PATCHES, PER_JOB)
WORN_BATCHES = among(WORN_PATCHES)
SCANNED_BATCHES = {"T0": BATCHES, "T1": WORN_BATCHES, "repeat": among(REPEATED_PATCHES)}


def of_batch(column):
    """What a column of the patch table says of each patch of a batch."""
    return lambda wildcards: [
        PATCHES[column][patch] for patch in SCANNED_BATCHES[wildcards.epoch][wildcards.batch]
    ]


def scans_of_batch(wildcards):
    ids = SCANNED_BATCHES[wildcards.epoch][wildcards.batch]
    return [f"{SCAN_FOLDER}/{PATCHES[wildcards.epoch.lower()][patch]}" for patch in ids]


def crops_of_batch(wildcards):
    """Centre [y, x] in mm of the piece to cut from each scan, or None for a whole scan."""
    ids = SCANNED_BATCHES[wildcards.epoch][wildcards.batch]
    crops = PATCHES.loc[ids, ["crop_y_mm", "crop_x_mm"]].itertuples(index=False)
    return [None if y != y else [float(y), float(x)] for y, x in crops]


def surfaces(epoch):
    """The folders with the clean scans at an epoch; and that of a batch."""
    batches = list(SCANNED_BATCHES[epoch])
    return expand(rules.prepare_scans.output.surfaces, epoch=epoch, batch=batches)


def surfaces_of_batch(epoch):
    return expand(rules.prepare_scans.output.surfaces, epoch=epoch, allow_missing=True)


def inferred_use(wildcards):
    """What the wear says of the use, of a later stage that needs no contact of this one; or nothing."""
    return rules.infer_use.output.use if INFERRED else []


def code(script):
    """Hash of the code that `script` runs on: a parameter, so that its change is a reason to rerun."""
    return source_hash(ROOT / "workflow/scripts" / script)


def columns(*names):
    """Some columns of the patch table: what a script reads of it. A note reruns nothing."""
    return PATCHES[list(names)].to_dict("list")


def megabytes(files):
    """Size of the largest of these files, as far as they exist already."""
    return max((os.path.getsize(file) for file in files if os.path.exists(file)), default=0) / 1e6


# What memory and time of a job grow with, in MB of scans as a specimen's are, 4 bytes a point: one
# scan, those of a batch, all, or the whole square as if it were one scan; and in MB of the mesh.
SCAN_MB = 4e-6 * config["specimen"]["scan_points"] ** 2 if GENERATED else megabytes(SCANS)
SIZES_MB = {
    "scan": SCAN_MB,
    "batch": SCAN_MB * max(map(len, BATCHES.values()), default=0),
    "scans": SCAN_MB * len(SCAN_USES),
    "square": SCAN_MB * (SQUARE_MM / PATCH_MM) ** 2,
    "mesh": 20 if GENERATED else megabytes([MESH]),
}


def growing(base, **by_size):
    """A resource: `base`, and so much for each MB of a size; as much again at each attempt."""
    need = math.ceil(base + sum(each * SIZES_MB[size] for size, each in by_size.items()))
    return lambda wildcards, attempt: attempt * need


# What the page shows: of each file its caption, its category and its title.
SHOWN = {}


def table(name, category):
    """A table of `gst.config.tables`, with its place on the page and in the report."""
    title, file = TABLES[name].title, f"{RESULTS}/{TABLES[name].file}"
    SHOWN[file] = f"tables/{name}.rst", category, title
    # Snakemake reads captions from files: this one is there as long as the process.
    caption = workflow.snakemake_tmp_dir / f"{name}.rst"
    if workflow.is_main_process:
        caption.write_text(table_caption(name), encoding="utf-8")
    return report(file, caption=str(caption), category=category, labels={"what": f"table: {title}"})


# The curves of the study as SVG files, which the page contains, too.
CURVES = []


def curves(name):
    """The SVG file of a figure, added to `CURVES`."""
    CURVES.append(f"{RESULTS}/figures/{name}.svg")
    return CURVES[-1]


def picture(name, category, title):
    """The PNG of a figure, with its place on the page and in the report."""
    file = f"{RESULTS}/figures/{name}.png"
    SHOWN[file] = f"{name}.rst", category, title
    # Kind and content share one label. From a second label with two values, Snakemake's report
    # would make a switch, and fail where a content does not have both kinds.
    labels = {"what": f"figure: {title}"}
    return report(file, caption=f"../report/{name}.rst", category=category, labels=labels)


def pictures_by_patch(name, category, title):
    """A folder with one PNG per patch, with its place in the report."""

    def labels(wildcards):
        # The report sorts texts, and 10 before 2; a page does not show spaces in front.
        longest = max(map(len, ALL_PATCHES))
        return {"what": f"figure: {title}", "patch": wildcards.patch.rjust(longest)}

    place = {"caption": f"../report/{name}.rst", "category": category, "labels": labels}
    folder = directory(f"{RESULTS}/figures/{name}")
    return report(folder, patterns=["{patch}.png"], **place)
