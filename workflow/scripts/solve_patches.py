"""Press each patch of a batch up to its own pressure, in every variant of the coupling.

The study's own variant, the first, is pressed step by step; the other at its pressure alone.
"""

from pathlib import Path

from gst.batches import files_of
from gst.logs import run_script
from gst.provenance import provenance
from gstlib.contact import Contact
from gstlib.io.store import Stored, read_dataset, write_dataset
from gstlib.io.tables import read_pressures
from gstlib.microscale.patches import Microscale, solve_patches


def main(
    t0: list[Path],
    counterface: Path,
    pressures: Path,
    composite: Path,
    contact: Path,
    contacts: Path,
    others: Path | None = None,
    *,
    patches: list[str],
    variants: list[str],
    contact_modulus_MPa: float,
    microscale: dict[str, float],
) -> None:
    stone = {}
    if composite:
        stone["composite"] = read_dataset(composite)
        stone["contact"] = Contact.from_dataset(read_dataset(contact))
    if counterface:
        stone["counterface"] = read_dataset(counterface).height
    around = [file for file in (counterface, composite, contact) if file]
    scans = files_of(t0, patches)
    folders = dict(zip(variants, [contacts, others], strict=False))
    settings = microscale | {"contact_modulus_MPa": contact_modulus_MPa}
    given = Stored(scans, ["height"]), read_pressures(pressures), Microscale(**settings)
    for patch, variant, found in solve_patches(*given, variants=variants, **stone):
        made = provenance([scans[patch], *around], settings | {"variant": variant})
        write_dataset(folders[variant] / f"{patch}.h5", found.to_dataset(), made)


if "snakemake" in globals():
    run_script(snakemake, main)
