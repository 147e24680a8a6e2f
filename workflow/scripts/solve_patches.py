"""Press each patch up to its own pressure, in every variant of the coupling.

The study's own variant, the first, is pressed step by step; the others at their pressure alone.
"""

from pathlib import Path

from gst.logs import patch_by_patch, run_script
from gst.provenance import provenance
from gstlib.contact import contact_at_pressure
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import read_pressures
from gstlib.study import PRESSURES, levelled_patch, place_patch, solve_patch


def main(
    t0: list[Path],
    counterface: Path,
    pressures: Path,
    composite: Path,
    square: Path,
    contacts: list[Path],
    others: list[Path],
    *,
    patches: list[str],
    variants: list[str],
    s_filter_um: float | None,
    **settings: float,
) -> None:
    table = read_pressures(pressures).set_index("patch")
    face = read_dataset(counterface, only=["height"]) if counterface else None
    if composite:
        composed = read_dataset(composite)
        pressed = read_dataset(square, only=["pressure"]).isel(step=-1)
    written = [contacts, others][: len(variants)]
    files = dict(zip(patches, zip(t0, *written, strict=True), strict=True))
    for patch, (surface, *results) in patch_by_patch(files):
        height = read_dataset(surface, only=["height"])
        levelled = levelled_patch(height, face, s_filter_um=s_filter_um, source=surface)
        for variant, result in zip(variants, results, strict=True):
            used = settings | {"target_pressure_MPa": float(table[PRESSURES[variant]][patch])}
            faces, inputs = levelled, [surface, *([counterface] if counterface else [])]
            if variant == "placed":
                faces = place_patch(levelled, composed, pressed, patch)
                inputs += [composite, square]
            if variant == variants[0]:
                solved = solve_patch(faces, source=surface, **used)
            else:
                names = "contact_modulus_MPa", "target_pressure_MPa", "tolerance"
                used = {name: used[name] for name in names}
                solved = contact_at_pressure(faces, source=surface, **used)
            attrs = used | {"variant": variant, "s_filter_um": s_filter_um}
            write_dataset(result, solved, provenance(inputs, attrs))


if "snakemake" in globals():
    run_script(snakemake, main)
