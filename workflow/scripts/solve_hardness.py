"""Solve the patches' contacts again with a ceiling on the pressure, and set both side by side.

One job for all patches: each takes less time than a job takes to start.

Inputs: the patches' contacts. Outputs: a folder with a contact HDF5 (the final state) for each;
hardness.csv. Settings: the patches, hardness. What a contact was solved with is in its file.
"""

from pathlib import Path

import pandas as pd

from gstlib.hardness import hardness_dataset, hardness_summary
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import write_table
from gstlib.logs import job_log, patch_by_patch
from gstlib.provenance import provenance


def main(
    contacts: dict[str, Path], folder: Path, table: Path, *, hardness_MPa: float, threads: int
) -> None:
    rows = []
    for patch, file in patch_by_patch(contacts):
        elastic = read_dataset(file)
        limited = hardness_dataset(elastic, source=file, hardness_MPa=hardness_MPa, workers=threads)
        settings = {"hardness_MPa": hardness_MPa}
        write_dataset(folder / f"{patch}.h5", limited, provenance([file], settings))
        rows.append({"patch": patch} | hardness_summary(elastic, limited))
    write_table(table, pd.DataFrame(rows))


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        main(
            dict(zip(snakemake.params.patches, map(Path, snakemake.input.contacts), strict=True)),
            Path(snakemake.output.limited),
            Path(snakemake.output.table),
            hardness_MPa=snakemake.params.hardness_MPa,
            threads=snakemake.threads,
        )
