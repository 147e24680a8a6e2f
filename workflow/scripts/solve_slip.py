"""Load the patches' contacts tangentially: where do they stick, and where do they slip?

One job for all patches: each takes less time than a job takes to start.

Inputs: the patches' contacts. Outputs: a folder with a slip HDF5 for each; slip.csv. Settings: the
patches, friction, tangential over sliding force, Poisson's ratio. What a contact was solved with
is in its file.
"""

from pathlib import Path

import pandas as pd

from gstlib.grinding import slip_dataset, slip_summary
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import write_table
from gstlib.logs import job_log, patch_by_patch
from gstlib.provenance import provenance


def main(
    contacts: dict[str, Path], slips: Path, table: Path, *, threads: int, **settings: float
) -> None:
    rows = []
    for patch, file in patch_by_patch(contacts):
        slip = slip_dataset(read_dataset(file), source=file, workers=threads, **settings)
        write_dataset(slips / f"{patch}.h5", slip, provenance([file], settings))
        rows.append({"patch": patch} | slip_summary(slip))
    write_table(table, pd.DataFrame(rows))


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            dict(zip(snakemake.params.patches, map(Path, snakemake.input.contacts), strict=True)),
            Path(snakemake.output.slips),
            Path(snakemake.output.table),
            threads=snakemake.threads,
            friction=snakemake.params.friction,
            tangential_ratio=snakemake.params.tangential_ratio,
            poisson=snakemake.params.poisson,
        )
