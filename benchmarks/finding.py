"""How well scans find their places on a stone: an overview, scans tied by the stage, by hand.

Twenty default specimens (`config/config.yaml`), with scans on the points that the page of
`gst place` compares. Places, turns and mirroring are drawn. Scans of another stone, and of a smooth
one, are to be said not to be found, and so is one that was taken elsewhere than the others say.

    .venv/bin/python benchmarks/finding.py
"""

import resource
import time
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import trimesh
from runner import RESULTS, pooled, run_script
from specimens import specimen_config

from gst.check.matching import match_map, match_near, match_together
from gst.setup.finding import view_of
from gstlib.preprocess.scans import prepare_scan
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.specimen.scanning import sample, take_scan
from gstlib.specimen.stone import Stone
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.frames import frame_from_points
from gstlib.surfaces.grid import make_surface, spacing_of

ROWS = RESULTS / "finding.csv"
CONFIG = specimen_config()
SQUARE, AROUND = CONFIG["square"]["size_mm"], 1.5  # mm
OVERVIEW, PATCH, POINTS = (1.9, 2.5), 0.85, 160  # mm, and points along a patch
MARGIN = 0.75 * PATCH  # mm
PATCHES, APART, OFF, TURNED = 6, 1.0, 0.5, 10.0  # mm: how far off places by hand are
PARAMETERS = SpecimenParameters(
    **CONFIG["specimen"]
    | {"scan_points": POINTS, "scan_spacing_um": 1e3 * PATCH / POINTS}
)
SMOOTH_UM = 0.1  # roughness of the smooth stone, less than the noise of the mesh
WRONG_UM = 100


class Specimen:
    """A specimen before use: its mesh, and scans of any size anywhere."""

    def __init__(self, parameters):
        self.parameters = parameters
        self.stone = Stone(parameters, SQUARE)
        whole = trimesh.Trimesh(*self.stone.mesh(), process=False)
        frame = frame_from_points(CONFIG["square"]["points_mm"])
        self.view = view_of(whole, frame, size_mm=SQUARE, around_mm=AROUND)
        self.heights = self.stone.heights

    def scan(self, name, place, mirrored, sides=(PATCH, PATCH)):
        """A prepared scan of a mould, or of the stone itself if it is not mirrored."""
        spacing = self.parameters.scan_spacing_mm
        ny, nx = (round(side / spacing) for side in sides)
        n = max(ny, nx)
        true = sample(self.heights, self.stone, place, n, order=3, patch=name)
        measured, _ = take_scan(true, name, "T0", self.parameters)
        heights = measured.values[(n - ny) // 2 :, (n - nx) // 2 :][:ny, :nx]
        heights = heights if mirrored else -heights[:, ::-1]
        raw = make_surface(heights, spacing_of(measured)[0])
        return prepare_scan(raw, maximum_unmeasured=0.9).height


def scattered(rng, turn):
    places = []
    while len(places) < PATCHES:
        at = rng.uniform(MARGIN, SQUARE - MARGIN, 2)
        if all(np.hypot(*(at - other[:2])) > APART for other in places):
            places.append(PatchPosition(*at, turn))
    return places


def of_stone(seed):
    """Rows of a specimen with its own scans, with those of another, smooth, and with one wrong."""
    rng = np.random.default_rng(seed)
    mirrored = bool(rng.integers(2))
    turn = rng.uniform(-180, 180)
    whole = PatchPosition(*rng.uniform(1.7, SQUARE - 1.7, 2), turn)
    places = scattered(rng, turn)
    at = np.array([place[:2] for place in places])
    v, u = PatchPosition(*at.mean(axis=0), turn).seen(*at.T)
    offsets = np.transpose([v, -u if mirrored else u])
    readings = np.array([offsets * signs for signs in product((1, -1), repeat=2)])
    hand = at + rng.uniform(-OFF, OFF, at.shape)
    turned = turn + rng.uniform(-TURNED, TURNED)
    by_hand = [PatchPosition(*place, turned) for place in hand]
    ways = {"tied by the stage": (tied, readings), "by hand": (match_near, by_hand)}
    # the last is taken half of this from its place along both axes
    wide = SQUARE - 2 * MARGIN
    elsewhere = PatchPosition(*(at[-1] - MARGIN + wide / 2) % wide + MARGIN, turn)
    own = replace(PARAMETERS, seed=seed)
    own, another, smooth = map(
        Specimen,
        (own, replace(own, seed=100 + seed), replace(own, macroscale_rms_um=SMOOTH_UM)),
    )
    names = map(str, range(99))
    rows = []
    for name, stone, surface, taken in (
        ("own", own, own.view, places),
        ("another", another, own.view, places),
        ("smooth", smooth, smooth.view, places),
        ("one elsewhere", own, own.view, [*places[:-1], elsewhere]),
    ):
        scans = [stone.scan(next(names), place, mirrored) for place in taken]
        if taken is places:
            large = stone.scan("overview", whole, mirrored, OVERVIEW)
            rows += timed("overview", seed, name, [whole], alone, surface, large)
        for way, (match, start) in ways.items():
            made = [*timed(way, seed, name, places, match, surface, scans, start)]
            rows += made if taken is places else made[-1:]
    return rows


def alone(surface, scan):
    return [match_map(surface, scan)]


def tied(surface, scans, readings):
    match, reading = match_together(surface, scans, readings)
    return match.each(readings[reading])


def timed(how, seed, name, places, work, *arguments):
    """A row for each scan: whether it is found, how far off, and the CPU time of all."""
    start = time.process_time()
    matches = work(*arguments)
    cpu_s = time.process_time() - start
    for place, match in zip(places, matches, strict=True):
        off_y, off_x, turn = np.subtract(match.place, place)
        yield {
            "how": how,
            "seed": seed,
            "scans": name,
            "found": match.is_found,
            "cpu_s": cpu_s,
            "certain": not match.is_uncertain,
            "off_um": 1e3 * np.hypot(off_y, off_x),
            "off_x_um": 1e3 * off_x,
            "off_y_um": 1e3 * off_y,
            "turn_deg": abs((turn + 180) % 360 - 180),
            "correlation": match.correlation,
            "lead": match.lead,
            "stated_um": 1e3 * match.error_mm,
        }


def summary(rows):
    """A row for each way and kind of scans; errors are those of the own scans that are found."""
    table = []
    for (how, name), group in rows.groupby(["how", "scans"], sort=False):
        placed = group[group.found]
        own = placed[placed.scans == "own"]
        wrong = own[own.off_um > WRONG_UM] if name == "own" else placed
        off = own[["off_x_um", "off_y_um"]].abs()
        held = off.le(1.96 * own.stated_um, axis=0)
        row = {
            "how": how,
            "scans": name,
            "mesh_edge_mm": PARAMETERS.mesh_edge_mm,
            "roughness_um": SMOOTH_UM
            if name == "smooth"
            else PARAMETERS.macroscale_rms_um,
            "number": len(group),
            "found_fraction": group.found.mean(),
            "not_certain": (~group.certain).sum(),
            "off_median_um": own.off_um.median(),
            "off_p95_um": own.off_um.quantile(0.95),
            "stated_rms_um": own.stated_um.pow(2).mean() ** 0.5,
            "true_rms_um": off.stack().pow(2).mean() ** 0.5,
            "held_fraction": held.stack().mean(),
            "found_and_wrong": len(wrong),
            "turn_median_deg": own.turn_deg.median(),
        }
        for column in ("correlation", "lead"):
            row[f"least_{column}"] = group[column].min()
            row[f"most_{column}"] = group[column].max()
        table.append(row | {"cpu_s": group.cpu_s.median()})
    return pd.DataFrame(table)


def made(chosen):
    """The summary of all stones."""
    seeds = [(seed,) for seed in chosen.seeds]
    *_, rows = pooled(of_stone, seeds, chosen.processes)
    # of processes that have ended
    peak_MB = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss // 1024
    yield summary(rows).assign(peak_memory_MB=peak_MB)


if __name__ == "__main__":
    run_script(
        __doc__,
        ROWS,
        made,
        lambda rows: rows.to_string(index=False),
        digits=3,
        seeds=[*range(20, 40)],
    )
