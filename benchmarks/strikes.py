"""Is the contact with a smooth active tool what wear sees, where the tool is rough?

    python benchmarks/strikes.py [--seeds 8001 8002] [--processes 2]
    python benchmarks/strikes.py --tables

Loaded patches of synthetic stones are pressed by a smooth face, and again and again by rough ones,
whose waves are those of the stone down to two scan points: by another piece of the tool at each
strike ("elsewhere"), or by one piece that comes down beside itself, by a normal distance with a
standard deviation of 20 µm along each axis ("again"). Wear sees the mean of the pressures. Rows go
to `results/strikes.csv`; `--tables` prints the table of docs/explanation/evidence.md from them.
"""

import argparse
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd
from age import record
from power import CONFIG, merged, specimen_config, specimen_studies, worn_patches

from gstlib.bem import ContactState, ContactWarning, solve_contact
from gstlib.contact import Contact
from gstlib.io.tables import read_table, write_table
from gstlib.specimen.randomness import ROLL_OFF_MM, self_affine_field, stream
from gstlib.study import Study

ROWS = Path(__file__).parent / "results/strikes.csv"
SEEDS, PATCHES = (8001, 8002), 10
# R.m.s. heights of the tool's face within a patch, and how often it strikes.
ROUGHNESSES_UM, STRIKES = (1.0, 3.0, 5.0), 40
POSITIONS = "elsewhere", "again"
BESIDE_MM = 0.02
SCANS = {"scan_points": 256, "scan_spacing_um": 3.32}


def solved(contact: Contact, rough: np.ndarray | float = 0.0, **options: float) -> ContactState:
    """The contact of a patch with a face (mm) on it, in place of a smooth one."""
    heights, spacing = contact.interface.for_solver
    options = {"contact_modulus": contact.modulus} | options
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ContactWarning)  # its surroundings are in its heights
        return solve_contact(
            heights + rough, spacing, mean_pressure=contact.load.mean_pressure, **options
        )


def faces(
    name: tuple[str, ...], seed: int, shape: tuple[int, int], spacing: float, positions: str
):
    """Pieces (mm, r.m.s. 1) of a rough tool, one for each strike."""
    generator = stream(seed, *name, positions)
    count = 2 * max(shape)
    face = self_affine_field(
        generator,
        count,
        spacing,
        hurst_exponent=0.8,
        roll_off=ROLL_OFF_MM,
        longest=max(shape) * spacing,
        shortest=4 * spacing,
    )
    face = (face / face.std()).astype(float)
    for _ in range(STRIKES):
        if positions == "elsewhere":
            move = generator.integers(0, count, 2)
        else:
            move = np.rint(generator.normal(0, BESIDE_MM / spacing, 2)).astype(int)
        yield np.roll(face, move, (0, 1))[: shape[0], : shape[1]]


def agreement(worn: np.ndarray, *ranked: np.ndarray) -> float:
    """MCC of a mask with as many points, those of the largest first value, and then second one."""
    order = np.lexsort([values.ravel() for values in ranked[::-1]])
    count = int(worn.sum())
    share, hit = count / worn.size, worn.ravel()[order[-count:]].mean()
    return float((hit - share) / (1 - share))


def stone(seed: int) -> Study:
    """The study of one stone."""
    config = merged(specimen_config(CONFIG), {"specimen": SCANS, "interlayer": None})
    ((_, study),) = specimen_studies(config, worn_patches(config), seed, ("summits",))
    return study


def loaded_contacts(study: Study) -> dict[str, Contact]:
    """Contacts of loaded patches of one stone, as a study solves them."""
    loaded = study.pressures.query("pressure_MPa > 1").patch[:PATCHES]
    return {patch: study.contacts[patch] for patch in loaded}


def rows_of(seed: int) -> list[dict]:
    """A row for each patch of one stone, roughness and kind of positions."""
    return [
        row
        for patch, contact in loaded_contacts(stone(seed)).items()
        for row in struck(contact, patch, seed)
    ]


def struck(contact: Contact, patch: str, seed: int) -> Iterator[dict]:
    """The rows of one patch."""
    smooth, height = solved(contact), contact.interface.height.values
    spacing = contact.interface.for_solver[1][1]
    for positions in POSITIONS:
        pieces = list(faces((patch,), seed, height.shape, spacing, positions))
        for rms in ROUGHNESSES_UM:
            fields = [solved(contact, 1e-3 * rms * piece).pressure for piece in pieces]
            half = len(fields) // 2
            first, second = np.mean(fields[:half], axis=0), np.mean(fields[half:], axis=0)
            # the more heavily loaded half of what the second half of the strikes touches
            worn = second > np.median(second[second > 0])
            yield {
                "seed": seed,
                "patch": patch,
                "rms_um": rms,
                "positions": positions,
                "pressure_MPa": contact.load.mean_pressure,
                "smooth_contact": smooth.contact_fraction,
                "strike_contact": float(np.mean([field > 0 for field in fields])),
                "touched": float((second > 0).mean()),
                "correlation_strike": correlation(smooth.pressure, fields[0]),
                "correlation_smooth": correlation(smooth.pressure, second),
                "correlation_halves": correlation(first, second),
                "mcc_smooth": agreement(worn, smooth.pressure, -smooth.gap),
                "mcc_halves": agreement(worn, first),
                "mcc_height": agreement(worn, height),
            }


def correlation(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Means over the patches."""
    rows = rows.assign(area_ratio=rows.strike_contact / rows.smooth_contact)
    groups = rows.groupby(["positions", "rms_um"], sort=False)
    found = groups.mean(numeric_only=True).drop(columns="seed")
    return found.assign(patches=groups.size()).reset_index()


def run(
    what: str,
    rows_of: Callable[[int], list[dict]],
    file: Path,
    summary: Callable[[pd.DataFrame], pd.DataFrame],
) -> None:
    """Make the rows of both stones, unless only the tables are asked for, and print their means."""
    parser = argparse.ArgumentParser(description=what.splitlines()[0])
    parser.add_argument("--seeds", type=int, nargs="+", default=SEEDS)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--tables", action="store_true", help="from the rows alone")
    arguments = parser.parse_args()
    if not arguments.tables:
        with ProcessPoolExecutor(arguments.processes, get_context("spawn")) as pool:
            found = [row for rows in pool.map(rows_of, arguments.seeds) for row in rows]
        write_table(file, pd.DataFrame(found).round(4))
        record(file)
    print(summary(read_table(file)).round(3).to_string(index=False))


if __name__ == "__main__":
    run(__doc__, rows_of, ROWS, summary)
