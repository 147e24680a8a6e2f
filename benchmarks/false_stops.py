"""Does a sound study stop, or believe a match that is wrong? For docs/explanation/evidence.md.

    python benchmarks/false_stops.py [--seeds 5201 5202 ...] [--config FILE …]
    python benchmarks/false_stops.py --tables

Synthetic stones of fresh seeds go through the study up to the inference of the use. All their files
are right, so no stage may stop. Use and statement are drawn apart: the load point of each lies up
to 1.5 mm from the middle of the square, and the radius is 80 to 400 mm. Every fourth stone has the
default study's own scans of 512 × 512 points. The others have 256 × 256 points, which are as far
apart as those on which the search of a registration runs in the default study; all else is as in
config/config.yaml and in the files of `--config`, such as benchmarks/correlated.yaml. The stone
`STOPPED` is added, with 512 × 512 points, because a wrong match stopped its study once.

Rows go to benchmarks/results/false_stops.csv as each stone is done. A stone that the file holds
already is not made again. There is a row for each patch and one, ``all``, for the study:

check, change, placement, use   the message with which the stage stops, empty if it does not: the
                 check is `gst check` on the stone's files, the others are stages of the study;
stated_*, worn_* the load point and radius that the study is told, and those that wore the stone;
found            whether the registration is believed;
error_um, turn_error_deg   of the registration against the true places of the two scans;
overlap          the true share of the area of T0 that T1 covers;
correlation, dale_depth_ratio, residual_um   as the registration states them;
false_loss, loss_recall   the share of the unworn points, and of those worn deeper than the
                 threshold of the specimen, that count as lost;
false_gain       the share of all points that count as gained;
above_noise      whether the loss of the patch counts;
status           of the placement of the patch;
answer           of the inference of the use;
cpu_s            of the whole study.

`--tables` prints from the rows alone how many studies stop, how many patches are found at a wrong
place, and how many are missed though T1 covers most of T0.
"""

import contextlib
import io
import logging
import shutil
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from runner import RESULTS, run_stones
from specimens import merged, specimen_config, study_of, worn_patches

from gst.check.checking import check_study
from gstlib.change.selection import exchanged_epochs
from gstlib.coupling.placement import ALL
from gstlib.errors import raise_unless_accepted
from gstlib.specimen.generate import make_specimen, write_specimen
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.grid import MM_TO_UM

ROWS = RESULTS / "false_stops.csv"
SEEDS = range(5201, 5241)
FARTHEST_MM, RADII_MM = 1.5, (80.0, 400.0)
COARSE = {"scan_points": 256, "scan_spacing_um": 3.32}
FINE = SEEDS[::4]
# The stone of a study that stopped, and what that study was told of its use.
STOPPED = 5101
OF_STOPPED = {"load": {"at_mm": [3.4, 1.7]}, "counterface": {"radius_mm": 120.0}}
STAGES = ["check", "change", "placement", "use"]
# A match is wrong beyond this error; a patch is missed if T1 covers more than this share of T0.
WRONG_UM, COVERED = 10.0, 0.6
# The columns of the rows after these, in their order.
_COLUMNS = """stated_x_mm stated_y_mm stated_radius_mm worn_x_mm worn_y_mm worn_radius_mm
found error_um turn_error_deg overlap correlation dale_depth_ratio residual_um
false_loss loss_recall false_gain above_noise status answer cpu_s"""


def drawn_use(generator):
    """A load point (y, x) from the middle of the square, mm, and a radius, mm."""
    way, share = generator.uniform([0, 0], [2 * np.pi, 1])
    off = FARTHEST_MM * np.sqrt(share) * np.array([np.sin(way), np.cos(way)])
    return off, float(np.exp(generator.uniform(*np.log(RADII_MM))))


def config_of(seed, files):
    """The config of the study of a stone, with the use that wore it."""
    config = specimen_config(*files)
    changes = {"specimen": {"seed": seed}, "reference_realisations": None}
    if seed == STOPPED:
        return merged(config, changes | OF_STOPPED)
    generator = np.random.default_rng([seed, 13])
    worn, worn_radius_mm = drawn_use(generator)
    stated, radius_mm = drawn_use(generator)
    changes["specimen"] |= ({} if seed in FINE else COARSE) | {
        "worn_off_middle_mm": tuple(map(float, worn)),
        "worn_radius_mm": worn_radius_mm,
    }
    y_mm, x_mm = config["square"]["size_mm"] / 2 + stated
    changes["load"] = {"at_mm": [float(x_mm), float(y_mm)]}
    return merged(config, changes | {"counterface": {"radius_mm": radius_mm}})


def message_of(stage):
    """The message with which a stage stops; None if it does not."""
    try:
        stage()
    except Exception as error:  # a stage that dies stops the study as well
        return " ".join(f"{type(error).__name__}: {error}".split())
    return None


def check_files(config, specimen):
    """What `gst check` does with the files of a specimen."""
    inputs = {"mesh": "mesh.stl", "mesh_unit": "mm", "scan_folder": "scans"}
    measured = {"specimen": None, "inputs": inputs, "patches": "patches.tsv"}
    maps = {name: Path(f"{name}.h5") for name in ("truth", "surface")}
    # Messages have the paths, and rows must not depend on where they were made.
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        Path("scans").mkdir()
        write_specimen(specimen, mesh="mesh.stl", scan_folder="scans", **maps)
        shutil.copy(config["patches"], "patches.tsv")
        text = yaml.safe_dump({**config, **measured, "results": "results"})
        Path("config.yaml").write_text(text, encoding="utf-8")
        with contextlib.redirect_stdout(io.StringIO()):
            check_study(Path("config.yaml"))


def judged(change, at):
    """A height change of a patch against the truth `at` it: its registration, and its loss."""
    stated = change.attrs
    t0, t1 = (PatchPosition.from_dataset(at.sel(epoch=epoch)) for epoch in ("T0", "T1"))
    true_um = MM_TO_UM * np.array(t0.seen(t1.y_mm, t1.x_mm))
    shift_um = stated["shift_y_um"], stated["shift_x_um"]
    is_known = np.isfinite(change.change.values)
    loss, depth = change.loss.values[is_known], at.wear_depth.values[is_known]
    deep = depth * MM_TO_UM > at.attrs["wear_threshold_um"]
    return {name: stated[name] for name in ("dale_depth_ratio", "residual_um")} | {
        "found": stated["registration_found"],
        "error_um": float(np.hypot(*(shift_um - true_um))),
        "turn_error_deg": abs(
            stated["rotation_deg"] - t1.rotation_deg + t0.rotation_deg
        ),
        "correlation": stated["detail_correlation"],
        "false_loss": loss[depth == 0].mean(),
        "loss_recall": loss[deep].mean() if deep.any() else np.nan,
        "false_gain": change.gain.values[is_known].mean(),
    }


def patch_rows(study, truth):
    """The registration of each patch; one that stops it leaves the study, as its message asks."""
    for patch in list(study.worn):
        at = truth.sel(patch=patch)
        row = {"patch": patch, "overlap": float(at.overlap)}
        row["change"] = message_of(partial(study.changes.__getitem__, patch))
        if row["change"]:
            study.worn.remove(patch)
        else:
            row |= judged(study.changes[patch], at)
        yield row


def stone_rows(seed, files):
    """The rows of one stone."""
    logging.disable()
    start = time.process_time()
    config = config_of(seed, files)
    parameters = SpecimenParameters(**config["specimen"])
    patches = worn_patches(specimen_config())
    size_mm = config["square"]["size_mm"]
    specimen = make_specimen(
        patches, parameters, square_mm=size_mm, grid=config["macroscale"]["grid"]
    )
    study = study_of(config, patches, specimen)
    rows = [*patch_rows(study, specimen.truth)]
    stages = {
        "check": partial(check_files, config, specimen),
        "change": lambda: raise_unless_accepted(
            exchanged_epochs(study.registration), config["accept"]
        ),
        "placement": lambda: study.placement,
        "use": lambda: study.use,
    }
    whole = {name: message_of(stage) for name, stage in stages.items()}
    if not whole["use"] and study.use is not None:
        whole["answer"] = study.use.attrs["answer"]
    worn = size_mm / 2 + np.array(parameters.worn_off_middle_mm)
    whole["stated_x_mm"], whole["stated_y_mm"] = config["load"]["at_mm"]
    whole["worn_y_mm"], whole["worn_x_mm"] = worn
    whole["stated_radius_mm"] = config["counterface"]["radius_mm"]
    whole["worn_radius_mm"] = parameters.worn_radius_mm
    whole["cpu_s"] = time.process_time() - start
    table = pd.DataFrame([{"patch": ALL} | whole, *rows])
    table = table.assign(seed=seed, scan_points=parameters.scan_points)
    above_noise = study.registration.set_index("patch").above_noise
    table["above_noise"] = table.patch.map(above_noise)
    if not whole["placement"]:
        table["status"] = table.patch.map(study.placement.set_index("patch").status)
    columns = ["seed", "scan_points", "patch", *STAGES, *_COLUMNS.split()]
    return table.reindex(columns=columns)


def summary(rows):
    """What the rows show, by the points of the scans.

    ``studies``, and those that ``stop`` at any stage; ``patches`` with a T1, those ``found``, and
    of these those at a ``wrong`` place; ``covered`` patches, whose T1 covers most of T0, and of
    these those ``missed``; ``largest_error_um`` of a patch that is found at the right place.
    """
    rows = rows.assign(stops=rows[STAGES].notna().any(axis=1), found=rows.found == 1)
    summaries = {}
    for points, group in rows.groupby("scan_points"):
        patches = group[group.patch != ALL]
        found, others = patches[patches.found], patches[~patches.found]
        is_wrong = found.error_um > WRONG_UM
        summaries[points] = {
            "studies": group.seed.nunique(),
            "stop": group.seed[group.stops].nunique(),
            "patches": len(patches),
            "found": len(found),
            "wrong": is_wrong.sum(),
            "covered": (patches.overlap > COVERED).sum(),
            "missed": (others.overlap > COVERED).sum(),
            "largest_error_um": found.error_um[~is_wrong].max(),
        }
    return pd.DataFrame(summaries).T


def stops(rows):
    """The messages with which studies stop."""
    messages = rows.set_index(["seed", "patch"])[STAGES].stack()
    return messages.dropna().rename("message").to_frame()


def tables(rows):
    return summary(rows), stops(rows)


if __name__ == "__main__":
    seeds = [STOPPED, *SEEDS]
    files = {"type": Path, "nargs": "*", "default": []}
    run_stones(__doc__, ROWS, stone_rows, tables, seeds, config=files)
