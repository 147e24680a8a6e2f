"""Solve what the config asks for: another contact modulus, a grinding force, a ceiling."""

from collections.abc import Mapping
from pathlib import Path

from gst.logs import run_script
from gstlib.cases import case_table, check_ceiling, modulus_rows, patch_rows
from gstlib.io.store import Stored, read_dataset
from gstlib.io.tables import read_pressures, studied_files, write_table


def main(
    macroscale: Path,
    contacts: list[Path],
    pressures: Path,
    table: Path,
    *,
    patches: list[str],
    patch_mm: float,
    other_modulus_MPa: float | None,
    grinding: Mapping[str, float] | None,
    hardness_MPa: float | None,
) -> None:
    by_patch = read_pressures(pressures)
    studied = studied_files(pressures, patches, contacts)
    if hardness_MPa is not None:
        check_ceiling(by_patch[by_patch.patch.isin(studied)], hardness_MPa)
    rows = []
    if other_modulus_MPa is not None:
        pressed = read_dataset(macroscale)
        settings = {"other_modulus_MPa": other_modulus_MPa, "patch_mm": patch_mm}
        rows += modulus_rows(pressed, by_patch, source=macroscale, **settings)
    rows += patch_rows(Stored(studied), grinding=grinding, hardness_MPa=hardness_MPa)
    write_table(table, case_table(rows))


if "snakemake" in globals():
    run_script(snakemake, main)
