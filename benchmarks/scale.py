"""How does a study grow with its number of patches?

    python benchmarks/scale.py [--patches 25 320 1000 2500] [--run 1000] [--cores 1]

Makes a study of measured files for each number, in a folder of its own: patches of 0.85 mm, 1 mm
apart, scanned at 64 x 64 points before and after use, on a square as large as they need, of a
pebble that is large enough for it. Writes benchmarks/results/scale.csv (with --output: elsewhere),
a column for each number:

plan_*     `make plan` of the fresh study;
run_*      the study itself, up to --run patches (of more only the plans are made), and tables_rows,
           the rows of all its tables together.

`cpu_s` is that of Snakemake and all its jobs, `peak_mb` of Snakemake's own process, `jobs_cpu_s`
and `largest_job_mb` of the steps, as their logs say. CPU times: what else the machine does disturbs
them less than wall times.
"""

import math
import re
import resource
import subprocess
import tempfile
import threading
import time
from itertools import product
from pathlib import Path

import pandas as pd
import yaml
from commands import snakemake_command
from runner import RESULTS, ROOT, options, save
from specimens import merged, specimen_config

from gst.config.patches import read_patches
from gst.config.reading import read_config_file
from gstlib.specimen import generate, pebble, scanning, stone
from gstlib.specimen.generate import make_specimen, write_specimen
from gstlib.specimen.randomness import SpecimenParameters

CONFIG = "config/scale.yaml"
TINY, SETTINGS = ROOT / "config/tiny.yaml", Path(__file__).with_suffix(".yaml")
ROWS = RESULTS / "scale.csv"
# The generated pebble, and the largest square that it holds.
PEBBLE_MM, LARGEST_SQUARE_MM = pebble.OUTER_SIZE_MM, 39.0
# The tiny study's macroscale, elements a mm.
GRID = 8


def write_study(patches, folder, *, scans):
    """A study of so many patches in `folder`; its files are empty unless `scans` are wanted."""
    side = math.ceil(math.sqrt(patches))
    rows = ["patch\tx_mm\ty_mm\tt0\tt1"]
    for number in range(1, patches + 1):
        y, x = divmod(number - 1, side)
        rows.append(f"{number}\t{x + 0.5}\t{y + 0.5}\t{number}_T0.plu\t{number}_T1.plu")
    (folder / "config").mkdir(parents=True)
    table = folder / "config/patches.tsv"
    table.write_text("\n".join(rows) + "\n")
    half = side / 2
    corners = [[half, half, 0.0], [-half, half, 0.0], [half, -half, 0.0]]
    config = merged(read_config_file(TINY), read_config_file(SETTINGS))
    of_side = {
        "square": {"size_mm": float(side), "points_mm": corners},
        "macroscale": {"grid": GRID * side, "face_mm": float(side)},
    }
    config = merged(config, of_side)
    (folder / CONFIG).write_text(yaml.safe_dump(config))
    (folder / "data/scans").mkdir(parents=True)
    if scans:
        # flat, as the face of a larger stone is over a few mm, and no scan lost: all can be studied
        pebble._CONCAVITY_MM = scanning._POOR_FRACTION = 0.0
        enlarge_pebble(max(1.0, side / LARGEST_SQUARE_MM))
        generated = specimen_config(TINY)
        places = read_patches(
            table, size_mm=side, patch_size_mm=generated["scans"]["size_mm"]
        )
        parameters = SpecimenParameters(**generated["specimen"])
        specimen = make_specimen(
            places, parameters, square_mm=float(side), grid=GRID * side
        )
        data = folder / "data"
        write_specimen(
            specimen,
            mesh=data / "mesh.stl",
            scan_folder=data / "scans",
            truth=data / "truth.h5",
            surface=data / "surface.h5",
        )
        return
    (folder / "data/mesh.stl").touch()
    for number, epoch in product(range(1, patches + 1), ("T0", "T1")):
        (folder / f"data/scans/{number}_{epoch}.plu").touch()


def enlarge_pebble(times):
    """Make the generated pebble larger than M12 was."""
    size = tuple(times * length for length in PEBBLE_MM)
    for module in (pebble, stone, generate):
        module.OUTER_SIZE_MM = size
    pebble._HALF_X, pebble._HALF_Y = size[0] / 2, size[1] / 2


def snakemake(folder, *arguments):
    """Run Snakemake there; how it went (wall and CPU s, peak MB), and its output."""
    command = snakemake_command(folder, CONFIG, *arguments)
    start = time.perf_counter()
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    process = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    used = {}
    watcher = threading.Thread(target=_watch, args=(process.pid, used))
    watcher.start()
    printed, _ = process.communicate()
    wall = time.perf_counter() - start
    watcher.join()
    if process.returncode:
        raise SystemExit(printed)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"wall_s": wall, "cpu_s": cpu} | used, printed


def _watch(pid, used):
    """Largest memory of one process, without its children, as long as it is there."""
    while True:
        try:
            status = Path(f"/proc/{pid}/status").read_text()
        except OSError:
            return
        peak = re.search(r"VmHWM:\s+(\d+)", status)
        if peak is None:  # ended, not waited for yet
            return
        used["peak_mb"] = int(peak[1]) / 1024
        time.sleep(0.05)


def plan(folder):
    """Jobs of a dry run, and what it takes."""
    used, printed = snakemake(folder, "--dry-run", "--quiet", "rules")
    return {"jobs": int(re.search(r"^total\s+(\d+)$", printed, re.MULTILINE)[1])} | used


def steps(logs):
    """CPU time (s) and peak memory (MB) of each step, from the last line of its log."""
    last = r"INFO took .*, (?P<cpu_s>\S+) s of CPU, (?P<memory_mb>\S+) MB of memory$"
    lines = {
        log.stem: log.read_text("utf-8").splitlines()[-1] for log in logs.rglob("*.log")
    }
    return pd.Series(lines).str.extract(last).astype(float)


def run(folder, cores):
    """The study itself."""
    used, _ = snakemake(folder, "--cores", str(cores))
    results = folder / "results-scale"
    jobs = steps(results / "logs")
    rows = {file.stem: len(pd.read_csv(file)) for file in results.glob("tables/*.csv")}
    return used | {
        "jobs_cpu_s": jobs.cpu_s.sum(),
        "largest_job_mb": jobs.memory_mb.max(),
        "studied": rows["microscale_summary"],
        "tables_rows": sum(rows.values()),
    }


def measure(patches, cores, *, in_full):
    """The column of so many patches."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "study"
        write_study(patches, folder, scans=in_full)
        column = {f"plan_{key}": value for key, value in plan(folder).items()}
        if in_full:
            column |= {f"run_{key}": value for key, value in run(folder, cores).items()}
            column["run_cpu_s_per_patch"] = column["run_cpu_s"] / patches
    return column


def main():
    chosen = options(__doc__, ROWS, patches=[25, 320, 1000, 2500], run=1000, cores=1)
    columns = {}
    for patches in chosen.patches if not chosen.tables else ():
        columns[patches] = measure(patches, chosen.cores, in_full=patches <= chosen.run)
        table = pd.DataFrame(columns).rename_axis("quantity").reset_index()
        save(chosen.output, table, digits=4)
    print(chosen.output.read_text("utf-8"))


if __name__ == "__main__":
    main()
