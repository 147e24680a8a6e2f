# What every stage shares: the checked configuration, the patch table, names of files.

import math
import os
import sys
from pathlib import Path

from gst import ROOT
from gst.chain import AGAIN, plan_again, steps_of
from gst.config import check_files, complete, counterface_mesh, read_study
from gst.poses import batches_of, poses_of, reach_of
from gst.patches import scan_files
from gst.provenance import commit, program_hash, source_hash
from gst.tables import TABLES
from gstlib.conditions import load_force, load_point, study_modulus, study_poisson
from gstlib.preprocess.mesh import elements_around

# Two jobs of each kind for 25 patches, one on each of two cores; and at most as many of a kind as the
# profile for Slurm sends at a time. A start costs 1 s of CPU, a patch of 64 x 64 points 0.01 to 0.1 s.
FEW, JOBS = 13, 20
CAPTIONS = ROOT / "workflow/report"
CONFIG_FILES = " + ".join(os.path.relpath(file) for file in workflow.configfiles)


# Patches that share a job, from the profile; no result depends on it. Without it, enough that even
# thousands of patches make a hundred jobs.
PER_JOB = config.pop("patches_per_job", None)
config.update(complete(config))
PATCHES = read_study(config, CONFIG_FILES)
PATCHES = PATCHES.set_index("patch", drop=False)
# Without a patch table, the study says where to scan, and what follows from scans is left out.
SCANNED = config["patches"] is not None
RESULTS = config["results"].rstrip("/")
SQUARE_MM = config["square"]["size_mm"]
PATCH_MM = config["scans"]["size_mm"]
GENERATED = config["specimen"] is not None
# Of the coupling: the study's own, and the paper's to compare it with.
VARIANTS = ["placed", "levelled"] if config["coupling"] == "placed" else ["levelled"]
CONTACT_MODULUS_MPA = study_modulus(config["material"])
# The cases that are solved beside the study; none of them, no table.
CASES = {
    "grinding": config["grinding"]
    and {**config["grinding"], "poisson": study_poisson(config["material"])},
    "hardness_MPa": config["hardness"],
}
if not any(CASES.values()):
    CASES = {}

ALL_PATCHES = list(PATCHES.index)
WORN_PATCHES = [patch for patch in ALL_PATCHES if PATCHES.t1[patch]]
REPEATED_PATCHES = [patch for patch in ALL_PATCHES if PATCHES["repeat"][patch]]
MESH = f"{RESULTS}/specimen/mesh.stl" if GENERATED else config["inputs"]["mesh"]
MESH_UNIT = "mm" if GENERATED else config["inputs"]["mesh_unit"]
SCAN_FOLDER = f"{RESULTS}/specimen/scans" if GENERATED else config["inputs"]["scan_folder"]
COUNTERFACE_SCAN = (config["counterface"] or {}).get("scan", [])
# The active stone, where there is a mesh of it, and the poses of a gesture.
SECOND_STONE = counterface_mesh(config, f"{RESULTS}/specimen")
COUNTERFACE_MESH = SECOND_STONE["mesh"] if SECOND_STONE else []
POSES = poses_of(config)
SECOND = f"{RESULTS}/macroscale/second_stone.h5" if SECOND_STONE else []
if SECOND_STONE:
    SECOND_STONE["reach_mm"] = reach_of(config)
# What is pressed at the macroscale: the mesh alone, or the scans laid on it.
PLACED = config["coupling"] == "placed"
COMPOSITE = f"{RESULTS}/macroscale/composite.h5" if PLACED and SCANNED else []
FACE = f"{RESULTS}/macroscale/surface.h5"
PRESSED_FACE = COMPOSITE or FACE
# The paper's square stays on its mean plane, and a flat presses it.
LOAD = {
    "force_N": load_force(config["load"], SQUARE_MM),
    "through": load_point(config["load"], SQUARE_MM) if PLACED else None,
}
# The hand errs about its point of force, and wanders around it.
FORCE_POINT_MM = math.hypot(
    config["uncertainty"]["force_point_mm"], (config["gesture"] or {}).get("wander_mm", 0.0)
)
GRID = {
    "grid": config["macroscale"]["grid"],
    "face_mm": config["macroscale"]["face_mm"] if PLACED else None,
    "radius_mm": (config["counterface"] or {}).get("radius_mm") if PLACED else None,
}
REFERENCE = bool(COMPOSITE) and config["reference_draws"] is not None
COUNTERFACE = f"{RESULTS}/surfaces/counterface.h5" if COUNTERFACE_SCAN else []
# No patch has an underscore in its name.
DETECTION = f"{RESULTS}/registered/of_repeats.h5" if REPEATED_PATCHES else []
if not GENERATED:
    check_files(config, PATCHES, ", ".join(filter(None, [CONFIG_FILES, config["patches"]])))


def code(script):
    """Hash of the code that `script` runs on: a parameter, so that its change is a reason to rerun."""
    return source_hash(ROOT / "workflow/scripts" / script)


def scans_at(epoch, patches):
    """The scans of the patches at `epoch` ("t0", "t1" or "repeat")."""
    return [f"{SCAN_FOLDER}/{PATCHES[epoch][patch]}" for patch in patches]


def surfaces(epoch, patches):
    """The prepared scans of the patches at `epoch` ("T0", "T1" or "repeat")."""
    return [f"{RESULTS}/surfaces/{patch}_{epoch}.h5" for patch in patches]


def registered(patches):
    """The height changes of the patches."""
    return [f"{RESULTS}/registered/{patch}.h5" for patch in patches]


def contacts(patches):
    """The microscale contacts of the patches."""
    return [f"{RESULTS}/microscale/{patch}.h5" for patch in patches]


def other_contacts(patches):
    """Those of the variant that the study's own is compared with, if there is one."""
    return [f"{RESULTS}/microscale/{name}/{patch}.h5" for name in VARIANTS[1:] for patch in patches]


def batches(patches):
    """The patches of each job that takes several, by the end of the job's name."""
    size = int(PER_JOB or max(FEW, math.ceil(len(ALL_PATCHES) / JOBS)))
    parts = [patches[start : start + size] for start in range(0, len(patches), size)]
    return {"" if len(parts) == 1 else f"_{i}": part for i, part in enumerate(parts, start=1)}


def listed(patches):
    """The patches of a job in a few words."""
    return f"patches {patches[0]} to {patches[-1]}" if len(patches) > 1 else f"patch {patches[0]}"


def crops_of(patches):
    """Centre [y, x] in mm of the piece to cut from each patch's scan, or None for a whole scan."""
    crops = PATCHES.loc[patches, ["crop_y_mm", "crop_x_mm"]]
    return [None if y != y else [float(y), float(x)] for y, x in crops.itertuples(index=False)]


def columns(*names):
    """Some columns of the patch table: what a script reads of it. A note reruns nothing."""
    return PATCHES[list(names)].to_dict("list")


PLACES = columns("patch", "x_mm", "y_mm", "rotation_deg")
SCAN_USES = scan_files(PATCHES, SCAN_FOLDER, COUNTERFACE_SCAN or None)
SCANS = sorted({str(use.path) for use in SCAN_USES})


# What the page shows: of each file its caption, its category and its title.
SHOWN = {}


def table(name, category):
    """A table of `gst.tables`, with its place on the page and in the report."""
    caption, title = f"tables/{name}.rst", TABLES[name].title
    file = f"{RESULTS}/{TABLES[name].file}"
    SHOWN[file] = str(CAPTIONS / caption), category, title
    place = {"caption": f"../report/{caption}", "category": category}
    return report(file, labels={"what": f"table: {title}"}, **place)
