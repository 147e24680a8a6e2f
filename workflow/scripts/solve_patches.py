"""Press each patch up to its own pressure, in every variant of the coupling.

The study's own variant, the first, is pressed step by step; the other at its pressure alone.
"""

from pathlib import Path

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
    contacts: list[Path],
    others: list[Path],
    *,
    patches: list[str],
    variants: list[str],
    **settings,
) -> None:
    stone = {}
    if composite:
        stone = {
            "composite": read_dataset(composite),
            "contact": Contact.from_dataset(read_dataset(contact)),
        }
    scans = dict(zip(patches, t0, strict=True))
    of_variants = zip(variants, [contacts, others], strict=False)
    files = {variant: dict(zip(patches, given, strict=True)) for variant, given in of_variants}
    around = [file for file in (counterface, composite, contact) if file]
    solved = solve_patches(
        Stored(scans, ["height"]),
        read_pressures(pressures),
        Microscale(**settings),
        variants=variants,
        counterface=read_dataset(counterface).height if counterface else None,
        **stone,
    )
    for patch, variant, found in solved:
        made = provenance([scans[patch], *around], settings | {"variant": variant})
        write_dataset(files[variant][patch], found.to_dataset(), made)


if "snakemake" in globals():
    run_script(snakemake, main)
