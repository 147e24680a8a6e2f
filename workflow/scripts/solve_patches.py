"""Press each patch, step by step, up to its own pressure: against a flat or a counterface."""

from pathlib import Path

from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import read_table
from gstlib.logs import patch_by_patch, run_script
from gstlib.provenance import provenance
from gstlib.study import solve_patch


def main(
    t0: list[Path],
    counterface: Path,
    pressures: Path,
    contacts: list[Path],
    *,
    patches: list[str],
    **settings: float,
) -> None:
    pressure_MPa = read_table(pressures, ["patch", "pressure_MPa"]).set_index("patch").pressure_MPa
    face = read_dataset(counterface, only=["height"]) if counterface else None
    files = dict(zip(patches, zip(t0, contacts, strict=True), strict=True))
    for patch, (surface, contact) in patch_by_patch(files):
        used = settings | {"target_pressure_MPa": float(pressure_MPa[patch])}
        height = read_dataset(surface, only=["height"])
        solved = solve_patch(height, face, source=surface, **used)
        inputs = [surface, counterface] if counterface else [surface]
        write_dataset(contact, solved, provenance(inputs, used))


if "snakemake" in globals():
    run_script(snakemake, main)
