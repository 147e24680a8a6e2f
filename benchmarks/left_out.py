"""What changes on a patch if something that the study states or leaves out is otherwise.

    python benchmarks/left_out.py [--seeds 8001 8002] [--processes 2]
    python benchmarks/left_out.py --tables

Of the patches of benchmarks/strikes.py: with the paper's contact modulus; with a cap on the
pressure; and worn on the same place again and again by a tool that wears as much as the stone. Rows
go to `results/left_out.csv`; `--tables` prints the table of docs/explanation/evidence.md from them.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from strikes import loaded_contacts, run, solved

from gstlib.contact import Contact
from gstlib.wear.archard import wear_contact

ROWS = Path(__file__).parent / "results/left_out.csv"
OTHERWISE = {
    "E* 12,820 MPa": {"contact_modulus": 12820.0},
    "cap of 2 GPa": {"pressure_cap": 2000.0},
    "cap of 1 GPa": {"pressure_cap": 1000.0},
}
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


def rows_of(seed: int) -> list[dict]:
    return [
        {"seed": seed, "patch": patch} | row
        for patch, contact in loaded_contacts(seed).items()
        for row in changed(contact)
    ]


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """Means over the patches."""
    groups = rows.groupby("changed", sort=False)
    found = groups.mean(numeric_only=True).drop(columns="seed")
    return found.assign(patches=groups.size()).reset_index()


if __name__ == "__main__":
    run(__doc__, rows_of, ROWS, summary)
