"""What changes on a patch if something that the study states or leaves out is otherwise.

    python benchmarks/left_out.py [--seeds 8001 8002] [--processes 2]
    python benchmarks/left_out.py --tables

Of the patches of benchmarks/strikes.py: with the paper's contact modulus; with a cap on the
pressure; and worn on the same place again and again by a tool that wears as much as the stone. Of
its stones: against a tool of two radii, 1.56 to 1 like the paper's, of the same geometric mean, in
three directions: the share of the patches' force that lies on other patches. Rows go to
`results/left_out.csv`; `--tables` prints the table of docs/explanation/evidence.md from them.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from power import merged
from strikes import loaded_contacts, run, solved, stone
from use import two_radii

from gstlib.conditions import study_radius
from gstlib.contact import Contact
from gstlib.macroscale.active_tool import rounded_counterface
from gstlib.study import Study
from gstlib.wear.archard import wear_contact

ROWS = Path(__file__).parent / "results/left_out.csv"
OTHERWISE = {
    "E* 12,820 MPa": {"contact_modulus": 12820.0},
    "cap of 2 GPa": {"pressure_cap": 2000.0},
    "cap of 1 GPa": {"pressure_cap": 1000.0},
}
# How far the longer of two radii is turned from x.
ANGLES_DEG = 0.0, 60.0, 120.0
# Wear coefficient times sliding: half a micrometre at 25 MPa.
KAPPA = 2e-5  # mm/MPa


def changed(contact: Contact) -> Iterator[dict]:
    """A row for each thing that is otherwise on one patch."""
    stated = solved(contact)
    for name, options in OTHERWISE.items():
        other = solved(contact, **options)
        common = np.count_nonzero(stated.contact & other.contact)
        both = np.count_nonzero(stated.contact) + np.count_nonzero(other.contact)
        ratio = other.contact_fraction / stated.contact_fraction
        yield {"changed": name, "contact_ratio": ratio, "f1": 2 * common / both}
    pressure = contact.load.mean_pressure
    alone, both = (
        wear_contact(
            contact, "", mean_pressure=pressure, mean_loss=faces * KAPPA * pressure
        ).depth
        / faces
        for faces in (1, 2)
    )
    yield {
        "changed": "the tool wears, too",
        "deepest_ratio": both.max() / alone.max(),
        "map_difference": np.sqrt(np.mean((both - alone) ** 2) / np.mean(alone**2)),
    }


def against_two_radii(study: Study) -> Iterator[dict]:
    """A row for each direction of a tool of two radii in place of the round one, use as stated."""
    radii, middle = two_radii(study_radius(study.config)), study.config["square"]["size_mm"] / 2
    read = {name: getattr(study, name) for name in ("read_mesh", "read_scan")}

    def forces(composite: xr.Dataset) -> pd.Series:
        other = Study(merged(study.config, {"use": None}), study.patches, **read)
        other.composite = composite
        return other.pressures.force_N

    round_tool = forces(study.composite)
    for angle in ANGLES_DEG:
        over = rounded_counterface(study.composite.height, radii, (middle, middle), angle)
        moved = forces(study.composite.assign(counterface=over)) - round_tool
        share = abs(moved).sum() / 2 / round_tool.sum()
        yield {"patch": f"all, {angle:g}°", "changed": "two radii", "force_moved": share}


def rows_of(seed: int) -> list[dict]:
    study = stone(seed)
    rows = [
        {"patch": patch} | row
        for patch, contact in loaded_contacts(study).items()
        for row in changed(contact)
    ]
    return [{"seed": seed} | row for row in [*rows, *against_two_radii(study)]]


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Means over the patches."""
    groups = rows.groupby("changed", sort=False)
    found = groups.mean(numeric_only=True).drop(columns="seed")
    return found.assign(patches=groups.size()).reset_index()


if __name__ == "__main__":
    run(__doc__, rows_of, ROWS, summary)
