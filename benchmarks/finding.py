"""How well scans find their places on a stone: an overview, scans tied by the stage, by hand.

Twenty default specimens (`config/config.yaml`), with scans on the points that the page of
`gst place` compares, and the measured pebble where its files are. Places, turns and mirroring are
drawn. Scans of another stone, and of a smooth one, are to be said not to be found, and so is one
that was taken elsewhere than the others say.

    .venv/bin/python benchmarks/finding.py
"""

import resource
import time
from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd
import trimesh
import yaml
from runner import RESULTS, ROOT, options, pooled, save
from specimens import specimen_config

from gst.check.matching import match_map, match_together
from gst.check.nearby import match_near
from gst.config.patches import read_patches
from gst.setup.finding import view_of
from gst.setup.place_matching import located
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import cut_scan, read_scan
from gstlib.preprocess.mesh import grid_mesh
from gstlib.preprocess.scans import prepare_scan
from gstlib.specimen.randomness import SpecimenParameters
from gstlib.specimen.scanning import sample, take_scan
from gstlib.specimen.stone import Stone
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.frames import frame_from_points
from gstlib.surfaces.grid import coarser, make_surface, spacing_of

ROWS = RESULTS / "finding.csv"
DATA = ROOT.parent / "shared/data"
CONFIG = specimen_config()
SQUARE, AROUND = CONFIG["square"]["size_mm"], 1.5  # mm
OVERVIEW, PATCH, POINTS = (1.9, 2.5), 0.85, 160  # mm, and points along a patch
PATCHES, APART, OFF, TURNED = (
    6,
    1.0,
    0.5,
    10.0,
)  # mm, and how far off places by hand are
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
        self.heights = self.stone.heights().astype("f4")

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
    margin = 0.75 * PATCH
    while len(places) < PATCHES:
        at = rng.uniform(margin, SQUARE - margin, 2)
        if all(np.hypot(*(at - other[:2])) > APART for other in places):
            places.append(PatchPosition(*at, turn))
    return places


def of_stone(seed):
    """Rows of a specimen with its own scans, with those of another, smooth, and with one wrong."""
    rows = []
    rng = np.random.default_rng(seed)
    mirrored = bool(rng.integers(2))
    turn = rng.uniform(-180, 180)
    whole = PatchPosition(*rng.uniform(1.7, SQUARE - 1.7, 2), turn)
    places = scattered(rng, turn)
    at = np.array([place[:2] for place in places])
    v, u = PatchPosition(*at.mean(axis=0), turn).seen(*at.T)
    offsets = np.transpose([v, -u if mirrored else u])
    readings = np.array([offsets * signs for signs in product((1, -1), (1, -1))])
    hand = at + rng.uniform(-OFF, OFF, at.shape)
    turned = turn + rng.uniform(-TURNED, TURNED)
    by_hand = [PatchPosition(*place, turned) for place in hand]
    own = replace(PARAMETERS, seed=seed)
    stones = {
        "own": Specimen(own),
        "another": Specimen(replace(own, seed=100 + seed)),
        "smooth": Specimen(replace(own, macroscale_rms_um=SMOOTH_UM)),
    }
    names = map(str, range(99))
    ways = {"tied by the stage": (tied, readings), "by hand": (match_near, by_hand)}
    for name, stone in stones.items():
        surface = stones["own" if name == "another" else name].view
        scans = [stone.scan(next(names), place, mirrored) for place in places]
        large = stone.scan("overview", whole, mirrored, OVERVIEW)
        rows += timed("overview", seed, name, [whole], alone, surface, large)
        for way, (match, start) in ways.items():
            rows += timed(way, seed, name, places, match, surface, scans, start)
    wide = (
        SQUARE - 1.5 * PATCH
    )  # the last is taken half of this from its place along both axes
    margin = 0.75 * PATCH
    elsewhere = PatchPosition(*(at[-1] - margin + wide / 2) % wide + margin, turn)
    taken = *places[:-1], elsewhere
    scans = [stones["own"].scan(next(names), place, mirrored) for place in taken]
    for way, (match, start) in ways.items():
        surface = stones["own"].view
        *_, last = timed(
            way, seed, "one elsewhere", places, match, surface, scans, start
        )
        rows.append(last)
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
        off_y, off_x = 1e3 * np.subtract(match.place[:2], place[:2])
        turn = (match.place.rotation_deg - place.rotation_deg + 180) % 360 - 180
        yield {
            "how": how,
            "seed": seed,
            "scans": name,
            "found": match.is_found,
            "cpu_s": cpu_s,
            "certain": not match.is_uncertain,
            "off_um": np.hypot(off_y, off_x),
            "off_x_um": off_x,
            "off_y_um": off_y,
            "turn_deg": abs(turn),
            "correlation": match.correlation,
            "lead": match.lead,
            "stated_um": 1e3 * match.error_mm,
        }


def summary(rows):
    """A row for each way and kind of scans; errors are those of the places that are found."""
    return pd.DataFrame(
        [
            summary_of(group, way, name)
            for (way, name), group in rows.groupby(["how", "scans"], sort=False)
        ]
    )


def summary_of(group, way, name):
    placed = group[group.found]
    row = {
        "how": way,
        "scans": name,
        "mesh_edge_mm": PARAMETERS.mesh_edge_mm,
        "roughness_um": SMOOTH_UM if name == "smooth" else PARAMETERS.macroscale_rms_um,
        "number": len(group),
        "found_fraction": group.found.mean(),
        "not_certain": (~group.certain).sum(),
        **dict.fromkeys(_ERRORS, np.nan),
        "found_and_wrong": len(placed),
        "turn_median_deg": np.nan,
        "least_correlation": group.correlation.min(),
        "most_correlation": group.correlation.max(),
        "least_lead": group.lead.min(),
        "most_lead": group.lead.max(),
        "cpu_s": group.cpu_s.median(),
    }
    if name == "own" and len(placed):
        off = placed[["off_x_um", "off_y_um"]].to_numpy()
        stated = placed.stated_um.to_numpy()
        held = abs(off) <= 1.96 * stated[:, None]
        errors = (
            placed.off_um.median(),
            placed.off_um.quantile(0.95),
            *map(rms, (stated, off)),
        )
        row |= dict(zip(_ERRORS, (*errors, held.mean()), strict=True))
        row["found_and_wrong"] = (placed.off_um > WRONG_UM).sum()
        row["turn_median_deg"] = placed.turn_deg.median()
    return row


_ERRORS = [
    "off_median_um",
    "off_p95_um",
    "stated_rms_um",
    "true_rms_um",
    "held_fraction",
]


def rms(values):
    return np.sqrt(np.mean(values**2))


def middle_of(surface, scans, readings):
    return [match_together(surface, scans, readings)[0]]


def of_pebble():
    """The measured pebble: its map on the whole stone and on its face, six pieces by the stage."""
    config = yaml.safe_load((ROOT / "config/pebble.yaml").read_text(encoding="utf-8"))
    patches = read_patches(
        ROOT / "config/patches_pebble.tsv", size_mm=5.0, patch_size_mm=0.85
    )
    frame = frame_from_points(config["square"]["points_mm"])
    whole = read_mesh(DATA / "pebble-mesh-3dhop/lithic_tool_model_full.ply")
    scan = read_scan(DATA / "pebble-usewear/confoc_3d_grid10um.xyz", unit="um")
    right = PatchPosition(patches.y_mm.mean(), patches.x_mm.mean())
    grids = {"size_mm": 5.0, "grid": 100, "around": 120, "interpolation": "linear"}
    face = grid_mesh(whole, frame, **grids).height
    rows = [*timed("map on its face", 0, "pebble", [right], alone, face, scan)]
    start = time.process_time()
    stone = located(whole, {}, overview=coarser(scan, 1), stages=None)
    cpu_s = time.process_time() - start
    match = stone.on_stone
    at = stone.frame.origin + match.place.x_mm * stone.frame.axes[0]
    ((x, y, _),) = frame.to_frame(
        np.array([at + match.place.y_mm * stone.frame.axes[1]])
    )
    off = {"off_um": 1e3 * np.hypot(y - right.y_mm, x - right.x_mm), "cpu_s": cpu_s}
    seen = timed("map on the whole stone", 0, "pebble", [right], list, [match])
    rows += [row | off for row in seen]
    offsets = np.array([*product((-0.45, 0.45), (-0.85, 0.0, 0.85))])
    pieces = [cut_scan(scan, offset, 0.85) for offset in offsets]
    readings = np.array([offsets * signs for signs in product((1, -1), (1, -1))])
    way = "six pieces by the stage, on its face"
    rows += timed(way, 0, "pebble", [right], middle_of, face, pieces, readings)
    table = pd.DataFrame(rows).assign(number=1)
    table["least_correlation"], table["least_lead"] = table.correlation, table.lead
    names = {
        "found": "found_fraction",
        "off_um": "off_median_um",
        "stated_um": "stated_rms_um",
    }
    return table.rename(columns=names)


def main():
    chosen = options(__doc__, ROWS, stones=20)
    if chosen.tables:
        print(pd.read_csv(chosen.output).to_string(index=False))
        return
    for rows in pooled(
        of_stone, [(seed,) for seed in range(20, 20 + chosen.stones)], chosen.processes
    ):
        table = summary(rows)
    if DATA.is_dir():
        table = pd.concat([table, of_pebble().reindex(columns=table.columns)])
    whom = resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN
    table["peak_memory_MB"] = max(
        resource.getrusage(who).ru_maxrss // 1024 for who in whom
    )
    print(table.to_string(index=False))
    save(chosen.output, table, digits=3)


if __name__ == "__main__":
    main()
