"""Score predicted contact against measured loss, patch by patch and over the patches."""

from pathlib import Path

from gst.logs import patch_by_patch, run_script
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_pressures, read_table, studied_files, write_table
from gstlib.study import score_patches


def main(
    contacts: list[Path],
    others: list[Path],
    registered: list[Path],
    pressures: Path,
    microscale: Path,
    exposure: Path,
    patches: Path,
    gains: Path,
    summary: Path,
    variants: Path,
    *,
    worn: list[str],
    compared: list[str],
    validation: dict,
    worst: list[str],
    seed: int,
) -> None:
    changes = dict(zip(worn, registered, strict=True))
    by_variant = {
        variant: (
            (patch, read_dataset(file), read_dataset(changes[patch]))
            for patch, file in patch_by_patch(studied_files(pressures, worn, files))
        )
        for variant, files in zip(compared, [contacts, others], strict=False)
    }
    by_patch = read_pressures(pressures)
    if exposure:
        left = read_table(exposure, ["patch", "exposure_N_per_mm"])
        by_patch = by_patch.merge(left[["patch", "exposure_N_per_mm"]], on="patch")
    tables = score_patches(
        by_variant,
        by_patch,
        read_table(microscale),
        worst=worst,
        seed=seed,
        **validation,
    )
    for name, file in [
        ("patches", patches),
        ("gains", gains),
        ("summary", summary),
        ("variants", variants),
    ]:
        write_table(file, tables[name])


if "snakemake" in globals():
    run_script(snakemake, main)
