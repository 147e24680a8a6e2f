"""How well scans find their places on a stone: an overview, scans tied by the stage, by hand.

Twenty synthetic stones, and the measured pebble where its files are. A stone is rough with a mesh
of edges of 0.2 mm that has 3 µm of noise; places, turns and mirroring are drawn. Scans of another
stone, and of a smooth one, are to be said not to be found, and so is one that was taken elsewhere
than the others say.

    .venv/bin/python benchmarks/finding.py --output benchmarks/results/finding.csv
"""

import argparse
import itertools
import resource
import time
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import scipy
import yaml
from age import record

from gst.patches import read_patches
from gst.place_matching import located
from gstlib import self_affine_field
from gstlib.coupling.matching import match_map, match_near, match_together
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import cut_scan, read_scan
from gstlib.preprocess.mesh import grid_mesh
from gstlib.surfaces.footprints import Place
from gstlib.surfaces.frames import frame_from_points
from gstlib.surfaces.grid import coarser, make_surface

ROOT = Path(__file__).parents[1]
DATA = ROOT.parent / "shared/data"
FINE, STEP, EDGE, FACE = 0.02, 0.05, 0.2, 9.0  # mm
OVERVIEW, PATCH, OFF = (1.9, 2.5), (0.85, 0.85), 0.5  # mm, and how far off places by hand are
PATCHES, APART = 6, 1.0


def stone(seed):
    """A rough and rounded surface on fine elements, mm."""
    count = round(FACE / FINE)
    waves = {"hurst_exponent": 0.8, "roll_off": 2.0}
    rough = self_affine_field(np.random.default_rng(seed), 512, FINE, **waves)[:count, :count]
    y, x = np.indices(rough.shape) * FINE - FACE / 2
    return 0.03 * rough / rough.std() - (y**2 + x**2) / 2 / 60


def mesh(fine, seed=0):
    """What a mesh shows of it, with its noise."""
    at = (np.arange(round(FACE / STEP)) + 0.5) * STEP / FINE - 0.5
    smooth = scipy.ndimage.gaussian_filter(fine, EDGE / 2 / FINE)
    seen = scipy.ndimage.map_coordinates(smooth, np.meshgrid(at, at, indexing="ij"), order=1)
    noise = np.random.default_rng(seed).normal(size=seen.shape)
    noise = scipy.ndimage.gaussian_filter(noise, 2)
    return make_surface(seen + 0.003 * noise / noise.std(), STEP, mesh_edge_mm=EDGE)


def scan(fine, place, mirrored, sides, spacing=0.01):
    """A map of it, tilted."""
    v, u = ((np.arange(n := round(side / spacing)) - (n - 1) / 2) * spacing for side in sides)
    y, x = place.points(v[:, None], (-u if mirrored else u)[None, :])
    heights = scipy.ndimage.map_coordinates(fine, [y / FINE - 0.5, x / FINE - 0.5], order=3)
    return make_surface(heights + 0.02 * v[:, None] + 3, spacing)


def scattered(rng, turn):
    places = []
    while len(places) < PATCHES:
        at = rng.uniform(2.0, FACE - 2.0, 2)
        if all(np.hypot(*(at - other[:2])) > APART for other in places):
            places.append(Place(*at, turn))
    return places


def of_stone(seed):
    """Rows of a stone with its own scans, with those of another, smooth, and with one wrong."""
    rows = []
    rng, fine = np.random.default_rng(seed), stone(seed)
    smooth = scipy.ndimage.gaussian_filter(fine, 40)
    of = {"own": fine, "another": stone(100 + seed), "smooth": smooth}
    surfaces = {"own": mesh(fine, seed), "smooth": mesh(smooth, seed)}
    mirrored, turn = bool(rng.integers(2)), rng.uniform(-180, 180)
    whole = Place(*rng.uniform(2.0, FACE - 2.0, 2), turn)
    places = scattered(rng, turn)
    at = np.array([place[:2] for place in places])
    middle = at.mean(axis=0)
    v, u = Place(*middle, turn).seen(*at.T)
    offsets = np.transpose([v, -u if mirrored else u])
    readings = np.array([offsets * signs for signs in product((1, -1), (1, -1))])
    hand = at + rng.uniform(-OFF, OFF, at.shape)
    turned = turn + rng.uniform(-10, 10)
    by_hand = [Place(*place, turned) for place in hand]
    for name, surface_of in of.items():
        surface = surfaces.get(name, surfaces["own"])
        scans = [scan(surface_of, place, mirrored, PATCH) for place in places]
        large = scan(surface_of, whole, mirrored, OVERVIEW)
        rows += timed("overview", seed, name, [whole], alone, surface, large)
        rows += timed("tied by the stage", seed, name, places, tied, surface, scans, readings)
        rows += timed("by hand", seed, name, places, match_near, surface, scans, by_hand)
    wide = FACE - 4.0  # the last is taken half of this from its place along both axes
    elsewhere = Place(*(at[-1] - 2.0 + wide / 2) % wide + 2.0, turn)
    mixed = [scan(fine, place, mirrored, PATCH) for place in (*places[:-1], elsewhere)]
    for how, work, by in (
        ("tied by the stage", tied, readings),
        ("by hand", match_near, by_hand),
    ):
        of_each = timed(how, seed, "one elsewhere", places, work, surfaces["own"], mixed, by)
        rows += [*of_each][-1:]
    return rows


def alone(surface, scan):
    return [match_map(surface, scan)]


def tied(surface, scans, readings):
    match, reading = match_together(surface, scans, readings)
    return match.each(readings[reading])


def timed(how, seed, name, places, work, *of):
    """A row for each scan: whether it is found, how far off, and the CPU time of all."""
    start = time.process_time()
    matches = work(*of)
    cpu_s = time.process_time() - start
    for place, match in zip(places, matches, strict=True):
        off = np.hypot(*np.subtract(match.place[:2], place[:2]))
        turn = (match.place.rotation_deg - place.rotation_deg + 180) % 360 - 180
        yield {
            "how": how,
            "seed": seed,
            "scans": name,
            "found": match.found,
            "cpu_s": cpu_s,
            "off_um": 1e3 * off,
            "turn_deg": abs(turn),
            "correlation": match.correlation,
            "lead": match.lead,
            "stated_um": 1e3 * match.error_mm,
        }


def summary(rows):
    """A row for each way and kind of scans; a wrong place is one off by more than 100 µm."""
    lines = []
    for (how, name), group in rows.groupby(["how", "scans"], sort=False):
        found = group[group.found]
        is_own = name == "own"
        lines.append(
            {
                "how": how,
                "scans": name,
                "number": len(group),
                "found_fraction": group.found.mean(),
                "within_20_um": (found.off_um < 20).sum() / len(group) if is_own else np.nan,
                "within_50_um": (found.off_um < 50).sum() / len(group) if is_own else np.nan,
                "found_and_wrong": (found.off_um > 100).sum() if is_own else len(found),
                "off_median_um": found.off_um.median() if is_own else np.nan,
                "off_p95_um": found.off_um.quantile(0.95) if is_own else np.nan,
                "stated_median_um": found.stated_um.median() if is_own else np.nan,
                "turn_median_deg": found.turn_deg.median() if is_own else np.nan,
                "least_correlation": group.correlation.min(),
                "most_correlation": group.correlation.max(),
                "least_lead": group.lead.min(),
                "most_lead": group.lead.max(),
                "cpu_s": group.cpu_s.median(),
            }
        )
    return pd.DataFrame(lines)


def middle_of(surface, scans, readings):
    return [match_together(surface, scans, readings)[0]]


def of_pebble():
    """The measured pebble: its map on the whole stone and on its face, six pieces by the stage."""
    config = yaml.safe_load((ROOT / "config/pebble.yaml").read_text(encoding="utf-8"))
    patches = read_patches(ROOT / "config/patches_pebble.tsv", size_mm=5.0, patch_size_mm=0.85)
    frame = frame_from_points(config["square"]["points_mm"])
    whole = read_mesh(DATA / "pebble-mesh-3dhop/lithic_tool_model_full.ply")
    scan = read_scan(DATA / "pebble-usewear/confoc_3d_grid10um.xyz", unit="um")
    right = Place(patches.y_mm.mean(), patches.x_mm.mean())
    grids = {"size_mm": 5.0, "grid": 100, "around": 120, "interpolation": "linear"}
    face = grid_mesh(whole, frame, **grids).height
    rows = [*timed("map on its face", 0, "pebble", [right], alone, face, scan)]
    start = time.process_time()
    found = located(whole, {}, overview=coarser(scan, 1), stages=None)
    cpu_s = time.process_time() - start
    match = found.on_stone
    at = found.frame.origin + match.place.x_mm * found.frame.axes[0]
    ((x, y, _),) = frame.to_frame(np.array([at + match.place.y_mm * found.frame.axes[1]]))
    seen = timed("map on the whole stone", 0, "pebble", [right], list, [match])
    rows += [
        row | {"off_um": 1e3 * np.hypot(y - right.y_mm, x - right.x_mm), "cpu_s": cpu_s}
        for row in seen
    ]
    offsets = np.array([*product((-0.45, 0.45), (-0.85, 0.0, 0.85))])
    pieces = [cut_scan(scan, offset, 0.85) for offset in offsets]
    readings = np.array([offsets * signs for signs in product((1, -1), (1, -1))])
    rows += timed(
        "six pieces by the stage, on its face",
        0,
        "pebble",
        [right],
        middle_of,
        face,
        pieces,
        readings,
    )
    return pd.DataFrame(rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--stones", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--output", type=Path, help="CSV of the summary")
    options = parser.parse_args()
    with ProcessPoolExecutor(options.workers) as pool:
        rows = [*itertools.chain(*pool.map(of_stone, range(20, 20 + options.stones)))]
    table = summary(pd.DataFrame(rows))
    if DATA.is_dir():
        pebble = of_pebble().rename(
            columns={"found": "found_fraction", "off_um": "off_median_um"}
        )
        pebble = pebble.assign(
            number=1,
            least_correlation=pebble.correlation,
            least_lead=pebble.lead,
            stated_median_um=pebble.stated_um,
        )
        table = pd.concat([table, pebble.reindex(columns=table.columns)])
    of_whom = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    table["peak_memory_MB"] = max(resource.getrusage(who).ru_maxrss // 1024 for who in of_whom)
    print(table.to_string(index=False))
    if options.output:
        table.to_csv(options.output, index=False, float_format="%.3g")
        record(options.output)


if __name__ == "__main__":
    main()
