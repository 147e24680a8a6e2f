"""How does a study grow with its number of patches?

    python benchmarks/scale.py [--patches 25 250 2500] [--run 250] [--cores 2]

Makes a study of measured files for each number, in a folder of its own: patches of 0.85 mm, 1 mm
apart, scanned at 64 x 64 points before and after use, on a square as large as they need. Writes
benchmarks/results/scale.csv (with --output: elsewhere), a column for each number:

plan_*     `make plan` of the fresh study;
coupled_*  the same once the scales are coupled and every patch is studied: the largest plan there
           is. Empty files stand for what was done until then;
run_*      the study itself, up to --run patches (of more only the plans are made), and tables_rows,
           the rows of all its tables together.

`cpu_s` and `peak_mb` are of Snakemake's own process, `jobs_cpu_s` of the jobs. CPU times: what else
the machine does disturbs them less than wall times.
"""

import argparse
import math
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import pandas as pd
import yaml

from gstlib.io.patches import read_patches
from gstlib.specimen.generate import generate_specimen
from gstlib.specimen.parameters import SpecimenParameters

ROOT = Path(__file__).parents[1]
CONFIG = "config/scale.yaml"
RESULTS = "results-scale"
# The tiny study's macroscale, elements a mm.
GRID = 8


def write_study(patches: int, folder: Path, *, scans: bool) -> None:
    """A study of so many patches in `folder`; its files are empty unless `scans` are wanted."""
    side = math.ceil(math.sqrt(patches))
    rows = ["patch\tx_mm\ty_mm\tt0\tt1"]
    for number in range(1, patches + 1):
        y, x = divmod(number - 1, side)
        rows.append(f"{number}\t{x + 0.5}\t{y + 0.5}\t{number}_T0.plu\t{number}_T1.plu")
    (folder / "config").mkdir(parents=True)
    table = folder / "config/patches.tsv"
    table.write_text("\n".join(rows) + "\n")
    default, tiny = (
        yaml.safe_load((ROOT / "config" / f"{name}.yaml").read_text())
        for name in ("config", "tiny")
    )
    # flat, as the face of a larger stone is over a few mm, and no scan lost: all can be studied
    made = default["specimen"] | tiny["specimen"] | {"concavity_mm": 0.0, "poor_overlap_share": 0.0}
    larger = max(1.0, side / 18)
    made["outer_size_mm"] = [larger * size for size in made["outer_size_mm"]]
    config = tiny | {
        "results": RESULTS,
        "patches": "config/patches.tsv",
        "specimen": None,
        "inputs": {"mesh": "data/mesh.stl", "mesh_unit": "mm", "scan_folder": "data/scans"},
        "square": {"size_mm": float(side), "frame": {"origin_mm": [side / 2, side / 2, 0.0]}},
        "macroscale": tiny["macroscale"] | {"grid": GRID * side, "maximum_displacement_um": 2000.0},
        "selection": {"minimum_pressure_MPa": 0.01, "minimum_overlap": 0.1},
        "hardness": 5000.0,
    }
    (folder / CONFIG).write_text(yaml.safe_dump(config))
    (folder / "data/scans").mkdir(parents=True)
    if scans:
        generate_specimen(
            read_patches(
                table,
                schema=ROOT / "workflow/schemas/patches.schema.yaml",
                size_mm=side,
                patch_size_mm=default["scans"]["size_mm"],
            ),
            mesh=folder / "data/mesh.stl",
            scan_folder=folder / "data/scans",
            truth=folder / "data/truth.h5",
            square_mm=float(side),
            grid=GRID * side,
            parameters=SpecimenParameters(**made),
        )
        return
    (folder / "data/mesh.stl").touch()
    for number in range(1, patches + 1):
        for epoch in ("T0", "T1"):
            (folder / f"data/scans/{number}_{epoch}.plu").touch()


def snakemake(folder: Path, *arguments: str) -> tuple[dict[str, float], str]:
    """Run Snakemake there; how it went (wall and CPU s, peak MB), and what it said."""
    command = [
        *(sys.executable, "-m", "snakemake", "--snakefile", str(ROOT / "Snakefile")),
        *("--directory", str(folder), *arguments, "--configfile", str(folder / CONFIG)),
    ]
    start = time.perf_counter()
    process = subprocess.Popen(
        command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    used: dict[str, float] = {}
    watcher = threading.Thread(target=_watch, args=(process.pid, used))
    watcher.start()
    said, _ = process.communicate()
    wall = time.perf_counter() - start
    watcher.join()
    if process.returncode:
        raise SystemExit(said)
    return {"wall_s": wall} | used, said


def _watch(pid: int, used: dict[str, float]) -> None:
    """CPU time and largest memory of one process, without its children, as long as it is there."""
    tick = os.sysconf("SC_CLK_TCK")
    while True:
        try:
            status = Path(f"/proc/{pid}/status").read_text()
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()
        except OSError:
            return
        peak = re.search(r"VmHWM:\s+(\d+)", status)
        if peak is None:  # ended, not waited for yet
            return
        used |= {
            "cpu_s": (int(fields[11]) + int(fields[12])) / tick,
            "peak_mb": int(peak[1]) / 1024,
        }
        time.sleep(0.05)


def plan(folder: Path, *arguments: str) -> dict[str, float]:
    """Jobs of a dry run, and what it takes."""
    used, said = snakemake(folder, "--dry-run", "--quiet", "rules", *arguments)
    return {"jobs": int(re.search(r"^total\s+(\d+)$", said, re.MULTILINE)[1])} | used


def pretend_coupled(folder: Path) -> None:
    """Empty files for all that comes before the microscale; every patch has some pressure."""
    _, said = snakemake(folder, "--summary")
    files = [line.split("\t")[0] for line in said.splitlines() if line.startswith(RESULTS)]
    for name in files:
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    patches = pd.read_csv(folder / "config/patches.tsv", sep="\t", dtype=str)
    pressures = patches[["patch"]].assign(pressure_MPa=10.0, in_study="yes")
    pressures.to_csv(folder / RESULTS / "tables/patch_pressures.csv", index=False)
    now = time.time()
    for name in files:
        os.utime(folder / name, (now, now))


def run(folder: Path, cores: int) -> dict[str, float]:
    """The study itself."""
    used, _ = snakemake(folder, "--cores", str(cores))
    results = folder / RESULTS
    jobs = pd.concat(
        pd.read_csv(file, sep="\t", usecols=["cpu_time"])
        for file in results.glob("benchmarks/**/*.tsv")
    )
    rows = {file.stem: len(pd.read_csv(file)) for file in results.glob("tables/*.csv")}
    return used | {
        "jobs": len(jobs),
        "jobs_cpu_s": jobs.cpu_time.sum(),
        "studied": rows["microscale_summary"],
        "tables_rows": sum(rows.values()),
    }


def measure(patches: int, cores: int, *, in_full: bool) -> dict[str, float]:
    """The row of so many patches."""
    row: dict[str, float] = {"patches": patches}
    with tempfile.TemporaryDirectory() as name:
        fresh, coupled = Path(name) / "fresh", Path(name) / "coupled"
        write_study(patches, fresh, scans=in_full)
        row |= {f"plan_{key}": value for key, value in plan(fresh).items()}
        write_study(patches, coupled, scans=False)
        pretend_coupled(coupled)
        found = plan(coupled, "--rerun-triggers", "mtime")
        row |= {f"coupled_{key}": value for key, value in found.items()}
        if in_full:
            row |= {f"run_{key}": value for key, value in run(fresh, cores).items()}
            row["run_wall_s_per_patch"] = row["run_wall_s"] / patches
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--patches", type=int, nargs="+", default=[25, 250, 2500])
    parser.add_argument("--run", type=int, default=250, help="most patches of a study that is run")
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--output", type=Path, default=ROOT / "benchmarks/results/scale.csv")
    options = parser.parse_args()
    rows = []
    for patches in options.patches:
        rows.append(measure(patches, options.cores, in_full=patches <= options.run))
        print(rows[-1], flush=True)
        table = (
            pd.DataFrame(rows)
            .T.rename_axis("quantity")
            .set_axis(options.patches[: len(rows)], axis=1)
        )
        table = table.drop(index="patches")
        table.to_csv(options.output, float_format="%.4g", lineterminator="\n")
    print(table)


if __name__ == "__main__":
    main()
