"""Check a study without running it: `make check CONFIG=...`.

Reads the config, the patch table and every measured file, says all that is wrong with them, and
what a run would do. Exit code 0 if the study can be run, 1 if not.
"""

import argparse
import logging
import math
import sys
from collections.abc import Iterable
from pathlib import Path

import pandas as pd
from snakemake.utils import update_config

from gstlib.config import (
    alternative_contact_modulus,
    check_config,
    check_files,
    check_interpreter,
    faulty_sections,
    measured_files,
    study_contact_modulus,
)
from gstlib.errors import ConfigError, GstError, InputsError
from gstlib.estimate import estimate_study, machine_speed
from gstlib.inputs import Inputs, ScanFile, check_inputs
from gstlib.io.config_file import read_config_file
from gstlib.io.patches import read_patches, readable_patches

ROOT = Path(__file__).parents[1]
DEFAULT = ROOT / "config/config.yaml"
SCHEMAS = ROOT / "workflow/schemas"


def read_config(path: Path) -> dict:
    """The config as Snakemake merges it: the default's values where `path` states none."""
    try:
        config, own = read_config_file(DEFAULT), read_config_file(path)
    except ConfigError as error:
        raise SystemExit(f"\nERROR: {error}") from None
    update_config(config, own)
    return config


def scan_files(config: dict, patches: pd.DataFrame) -> list[ScanFile]:
    """Every scan of the study that exists."""
    folder = Path(config["inputs"]["scan_folder"])
    scans = [
        ScanFile(
            folder / getattr(row, epoch),
            row.patch,
            epoch.upper(),
            None if row.crop_x_mm != row.crop_x_mm else (row.crop_x_mm, row.crop_y_mm),
        )
        for row in patches.itertuples()
        for epoch in ("t0", "t1")
        if getattr(row, epoch)
    ]
    if config["counterface"] is not None:
        scans.append(ScanFile(Path(config["counterface"]["scan"]), "counterface", ""))
    return [scan for scan in scans if scan.path.is_file()]


def read_table(
    config: dict, faulty: set[str], problems: list[GstError]
) -> tuple[pd.DataFrame | None, pd.DataFrame]:
    """The patch table, None with a fault added to the problems; and the rows that name scans."""
    path, schema = config["patches"], SCHEMAS / "patches.schema.yaml"
    if "patches" in faulty:
        return None, pd.DataFrame()
    try:
        patches = read_patches(
            path,
            schema=schema,
            size_mm=math.inf if "square" in faulty else config["square"]["size_mm"],
            patch_size_mm=0.0 if "scans" in faulty else config["scans"]["size_mm"],
        )
    except GstError as error:
        problems.append(error)
        return None, readable_patches(path, schema=schema)
    return patches, patches


def check(config: dict, source: str) -> tuple[list[GstError], pd.DataFrame | None, Inputs | None]:
    """All problems, the patch table and what the files hold, as far as each can be had."""
    problems: list[GstError] = []
    schema = SCHEMAS / "config.schema.yaml"
    for look in (
        lambda: check_interpreter(sys.executable),
        lambda: check_config(config, schema, source=source),
    ):
        try:
            look()
        except GstError as error:
            problems.append(error)
    # What a fault in one section leaves sound is looked at all the same.
    faulty = faulty_sections(config, schema)
    patches, named = read_table(config, faulty, problems)
    found = None
    if config["inputs"] is not None and not faulty & {"inputs", "counterface"}:
        try:
            check_files(measured_files(config, named), source=f"{source}, {config['patches']}")
        except GstError as error:
            problems.append(error)
        mesh = config["inputs"]["mesh"]
        can_mesh = Path(mesh).is_file() and not faulty & {"square", "macroscale"}
        can_scans = not faulty & {"scans", "preprocessing"}
        found = check_inputs(
            mesh if can_mesh else None,
            scan_files(config, named) if can_scans else [],
            mesh_unit=config["inputs"]["mesh_unit"],
            square=config["square"],
            macroscale=config["macroscale"],
            scan_settings=config["scans"],
            maximum_unmeasured=config["preprocessing"]["maximum_unmeasured"] if can_scans else 0.0,
        )
        problems += found.problems
    return problems, patches, found


def summary(config: dict, patches: pd.DataFrame, found: Inputs | None, cores: int) -> str:
    """What a run would do."""
    square, worn = config["macroscale"]["grid"], int((patches.t1 != "").sum())
    points = scan_points(config, found)
    lines = [
        f"stone       {config['title']}"
        + (" (to be generated)" if config["specimen"] else f": {config['inputs']['mesh']}"),
        f"macroscale  {config['square']['size_mm']:g} mm square, {square} × {square} elements, "
        f"{config['macroscale']['steps']} steps to "
        f"{config['macroscale']['target_pressure_MPa']:g} MPa",
        f"stiffness   {_stiffness(config['material'])}",
        f"patches     {len(patches)} of {config['scans']['size_mm']:g} mm, "
        + (f"{points[0]} × {points[1]} points, " if points else "")
        + f"{config['microscale']['steps']} steps each; {worn} with a scan after use",
        f"cost        {_cost(config, patches, points, cores)}",
        f"results in  {config['results']}",
    ]
    if found is not None:
        lines[1:1] = _seen(found)
    return "\n".join(f"  {line}" for line in lines)


def scan_points(config: dict, found: Inputs | None) -> tuple[int, int] | None:
    """Most points of a scan along x and y; None if no scan could be read."""
    if config["specimen"]:
        return config["specimen"]["scan_points"], config["specimen"]["scan_points"]
    if found is None or not len(found.scans):
        return None
    return int(found.scans.points_x.max()), int(found.scans.points_y.max())


def _cost(config: dict, patches: pd.DataFrame, points: tuple[int, int] | None, cores: int) -> str:
    if points is None:
        return "not known: no scan could be read"
    cost = estimate_study(
        scan_points=points[0] * points[1],
        scans=int((patches.t0 != "").sum() + (patches.t1 != "").sum()),
        patches=len(patches),
        patch_steps=config["microscale"]["steps"],
        square_points=config["macroscale"]["grid"] ** 2,
        square_steps=config["macroscale"]["steps"],
        speed=machine_speed(),
    )
    return (
        f"about {_duration(cost.cpu_s / cores)} on {cores} cores, if every patch is studied; "
        f"{cost.memory_mb:.0f} MB a job"
    )


def _stiffness(material: dict) -> str:
    standard = alternative_contact_modulus(material)
    told = "" if standard is None else f", as given; {standard:.5g} MPa by the elastic constants"
    return f"E* = {study_contact_modulus(material):.5g} MPa{told}"


def _seen(found: Inputs) -> list[str]:
    """The measures by which one sees that mesh and scans were read in the right unit."""
    lines = []
    if found.mesh is not None:
        size = " × ".join(f"{found.mesh[f'size_{axis}_mm']:.4g}" for axis in "xyz")
        lines.append(
            f"mesh        {size} mm along its x, y, z; edges of "
            f"{found.mesh['mean_edge_mm']:.3g} mm on average"
        )
    if len(found.scans):
        unmeasured = 100 * found.scans.unmeasured
        lines.append(
            f"scans       Sq {_range(found.scans.Sq_um)} µm; from lowest to highest point "
            f"{_range(found.ranges_um)} µm; {_range(unmeasured)} % unmeasured"
        )
    return lines


def _range(values: Iterable[float]) -> str:
    low, high = (f"{value:.4g}" for value in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.0f} seconds"
    return f"{seconds / 60:.0f} minutes" if seconds < 6000 else f"{seconds / 3600:.1f} hours"


def draw(config: dict, patches: pd.DataFrame, found: Inputs, picture: Path) -> None:
    from gstlib import figures

    figure = figures.input_figure(
        found.square, patches, patch_size_mm=config["scans"]["size_mm"], source_note=None
    )
    figures.save_figure(figure, picture)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("config", type=Path)
    parser.add_argument("--cores", type=int, default=2, help="cores to estimate the time for")
    arguments = parser.parse_args()
    logging.basicConfig(format="%(levelname)s: %(message)s")
    config = read_config(arguments.config)
    problems, patches, found = check(config, str(arguments.config))
    faulty = faulty_sections(config, SCHEMAS / "config.schema.yaml")
    if patches is not None and not faulty:
        print(f"{arguments.config}\n{summary(config, patches, found, arguments.cores)}")
    if (
        patches is not None
        and found is not None
        and found.square is not None
        and (not faulty & {"results", "scans"})
    ):
        picture = Path(config["results"]) / "check.png"
        draw(config, patches, found, picture)
        print(f"  picture     {picture}: the square with its patches")
    if problems:
        print(f"\nERROR: {InputsError(problems)}", file=sys.stderr)
        return 1
    print("\nNothing is wrong with these inputs.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
