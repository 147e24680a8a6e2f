"""Press the whole square at the scans' resolution, once for each draw of what was not scanned.

On a synthetic specimen it is the true surface, of which there is one, in the true face at rest.
"""

from collections.abc import Iterator
from pathlib import Path

import xarray as xr

from gst.batches import files_of
from gst.logs import run_script
from gst.provenance import provenance
from gstlib.contact import Contact, Interface, contact_at_pressure
from gstlib.io.store import Stored, read_dataset, write_dataset
from gstlib.specimen.score import true_face
from gstlib.surfaces.footprints import places_of
from gstlib.validation.single_scale import composite_heights, patches_of_reference, press_whole


def main(
    face: Path,
    composite: Path,
    macroscale: Path,
    t0: list[Path],
    true_surface: Path,
    truth: Path,
    contact: Path,
    patches: Path,
    *,
    draws: int,
    s_filter_um: float | None,
    seed: int,
) -> None:
    mesh, around = read_dataset(face), Contact.from_dataset(read_dataset(macroscale))
    lying = read_dataset(truth).sel(epoch="T0") if truth else read_dataset(composite)
    table = lying[["x_mm", "y_mm", "rotation_deg"]].to_dataframe().reset_index()
    scans = Stored(files := files_of(t0, table.patch), ["height"])
    scan = scans[table.patch[0]].height
    inputs = [true_surface, truth] if truth else [face, composite, *files.values()]
    if truth:
        around = contact_at_pressure(
            Interface(true_face(lying), mesh.counterface),
            around.load,
            modulus=around.modulus,
            tolerance=around.tolerance,
            source=truth,
        )

    def surfaces() -> Iterator[xr.DataArray]:
        if truth:
            yield read_dataset(true_surface).height.astype(float)
            return
        for draw in range(draws):
            yield composite_heights(
                mesh, lying, scans, s_filter_um=s_filter_um, seed=seed, draw=draw
            )

    found = []
    settings = {"s_filter_um": s_filter_um, "seed": seed}
    for heights in surfaces():
        solved = press_whole(heights, around, source=inputs[0])
        if not found:
            write_dataset(contact, solved, provenance(inputs, settings))
        found.append(patches_of_reference(solved.pressure, places_of(table), scan))
    drawn = xr.concat(found, "draw")
    write_dataset(patches, drawn, provenance(inputs, settings | {"draws": len(found)}))


if "snakemake" in globals():
    run_script(snakemake, main)
