"""How often does the check of places see a mistake, and how often one where there is none?

    python benchmarks/placement.py [--seeds 6001 6002 …] [--processes 2]
    python benchmarks/placement.py --tables

Synthetic specimens are scanned where the patch table says, up to the errors of placing. Then a
mistake is made: one patch is laid in another orientation, or its scan is that of another place; two
scans are exchanged; the table is mirrored. The stones differ in mesh and places; all 25 patches are
used, or a few. Rows go to `results/placement.csv`: of how many studies a fault stopped, how many
had the fault that names the mistake, and which share of the right patches agreed. `--tables` prints
the rows alone.
"""

import logging
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from runner import RESULTS, means, pooled, run_script
from specimens import merged, specimen_config, specimen_studies

from gst.config.reading import read_study
from gstlib.coupling.comparison import AGREES
from gstlib.coupling.orientations import (
    AS_GIVEN,
    ORIENTATIONS,
    TABLES,
    as_measured,
    oriented,
)
from gstlib.coupling.placement import check_placement
from gstlib.errors import InputsError

ROWS = RESULTS / "placement.csv"
# The default specimen, with scans that are as coarse as the check makes them.
COARSE = {"scan_points": 64, "scan_spacing_um": 13.28, "unmeasured_size_um": 30.0}
# What differs from it, and the error of placing (µm), which each study states as it is.
STONES = {
    "default": ({}, 30.0),
    "mesh noise 3 µm": ({"mesh_noise_um": 3.0}, 30.0),
    "mesh edges 0.45 mm": ({"mesh_edge_mm": 0.45, "cut_off_wavelength_mm": 0.9}, 30.0),
    "placed to 60 µm": ({}, 60.0),
}
NONE, EXCHANGED, ELSEWHERE = "none", "two exchanged", "one elsewhere"
ORIENTED = [name for name in ORIENTATIONS if name != AS_GIVEN]
MIRRORED = [name for name in TABLES if name]
MISTAKES = [NONE, *ORIENTED, EXCHANGED, ELSEWHERE, *MIRRORED]
# All of these for all patches of the default stone, else some.
SOME = [NONE, ORIENTED[2], EXCHANGED, ELSEWHERE, MIRRORED[0]]
ALL, COUNTS = 25, (25, 8, 4, 3, 2)
SQUARE_MM = 5.0


class Mistaken(NamedTuple):
    """What a study states, the patches that are wrong in it, and what a fault must say of them."""

    table: pd.DataFrame
    scans: dict
    wrong: tuple[str, ...]  # empty if all are
    words: str


def of_stone(seed):
    """Rows of a specimen: each stone, number of patches and mistake."""
    logging.disable()
    rows = []
    generator = np.random.default_rng(seed)
    for stone, (changes, error_um) in STONES.items():
        config = specimen_config()
        patches = read_study(config, "config")
        specimen = COARSE | changes | {"placement_error_um": error_um}
        config = merged(config, {"specimen": specimen, "macroscale": {"face_mm": 7.0}})
        [(_, study)] = specimen_studies(config, patches, seed, ["summits"])
        scans = {
            patch: study.prepared[patch, "T0"][["height"]] for patch in patches.patch
        }
        for count in COUNTS if stone == "default" else COUNTS[:2]:
            is_all = stone == "default" and count == ALL
            chosen = np.sort(generator.choice(len(patches), count, replace=False))
            table = patches.iloc[chosen].reset_index(drop=True)
            for mistake in MISTAKES if is_all else SOME:
                made = mistaken(table, scans, mistake, generator)
                row = {"stone": stone, "patches": count, "mistake": mistake}
                rows.append(row | judged(study, made, error_um))
    return rows


def mistaken(table, scans, mistake, generator):
    """A study with a mistake, of the patches of a table."""
    own = {patch: scans[patch] for patch in table.patch}
    one, other = generator.permutation(list(own))[:2]
    if mistake in ORIENTED:
        height = scans[one].height
        laid = {"height": height.copy(data=oriented(height.values, mistake))}
        words = f"mesh {undoing(mistake)} ("
        return Mistaken(table, own | {one: xr.Dataset(laid)}, (one,), words)
    if mistake == EXCHANGED:
        own |= {one: scans[other], other: scans[one]}
        return Mistaken(table, own, (one, other), "each other's")
    if mistake == NONE:
        return Mistaken(table, own, (), NONE)
    if mistake == ELSEWHERE:
        unused = [patch for patch in scans if patch not in own] or [other]
        own[one] = scans[generator.choice(unused)]
        return Mistaken(table, own, (one,), "")
    x, y = as_measured(table.x_mm, table.y_mm, SQUARE_MM, mistake)
    words = f"mesh with {undoing_table(mistake)} ("
    return Mistaken(table.assign(x_mm=x, y_mm=y), own, (), words)


def undoing(mistake):
    """The orientation that undoes another one."""
    corner = np.arange(4).reshape(2, 2)
    laid = oriented(corner, mistake)
    return next(name for name in ORIENTATIONS if (oriented(laid, name) == corner).all())


def undoing_table(mistake):
    """The mistake of a table that undoes another one."""
    place = 0.1, 0.3
    wrong = as_measured(*place, 1.0, mistake)
    return next(
        name for name in TABLES if np.allclose(as_measured(*wrong, 1.0, name), place)
    )


def judged(study, made, error_um):
    """Whether a fault stops the study and names the mistake, or else which patches agree."""
    settings = study.settings["check_placement"] | {"placement_um": error_um}
    faults = []
    agrees = pd.Series(dtype=bool)
    try:
        placed = check_placement(study.face.height, made.table, made.scans, **settings)
        agrees = placed.set_index("patch").status[:-1] == AGREES
    except InputsError as error:
        faults = error.args[0]
    is_wrong = agrees.index.isin(made.wrong)
    wrong = {*made.wrong}
    return {
        "stopped": bool(faults),
        "named": any(
            {*fault.patches} == wrong and made.words in fault.problem
            for fault in faults
        ),
        "others_named": any({*fault.patches} - wrong for fault in faults),
        "right_agree": agrees[~is_wrong].mean(),
        "wrong_agree": bool(agrees[is_wrong].any()),
    }


def made(chosen):
    """The means over the specimens that are done."""
    seeds = [(seed,) for seed in chosen.seeds]
    for rows in pooled(of_stone, seeds, chosen.processes):
        rows = rows.astype({"right_agree": float})
        yield means(rows, ["stone", "patches", "mistake"], "studies")


if __name__ == "__main__":
    run_script(
        __doc__,
        ROWS,
        made,
        lambda rows: rows.round(3).to_string(index=False),
        seeds=[*range(6001, 6021)],
    )
