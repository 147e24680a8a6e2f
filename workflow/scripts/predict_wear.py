"""Wear a batch of patches by Archard's law, as the losses of other patches foretell."""

from pathlib import Path

from gst.batches import files_of
from gst.logs import run_script
from gst.provenance import provenance
from gstlib.bem import Layer
from gstlib.contact import Contact
from gstlib.io.store import read_dataset, write_dataset
from gstlib.wear.archard import Mat, WornSquare
from gstlib.wear.fit import wear_map


def main(
    square: Path,
    mat: Path | list,
    contacts: Path,
    depths: Path,
    *,
    patches: list[str],
    mat_layer: dict[str, float] | None,
    hardness_MPa: float | None,
) -> None:
    """The folder stays empty where wear is not predicted."""
    path, layer, fitted = read_dataset(square), None, None
    depths.mkdir(exist_ok=True)
    if not path.sizes:
        return
    if mat_layer is not None:
        fitted, thickness_mm = read_dataset(mat), mat_layer["thickness_um"] * 1e-3
        layer = Layer(mat_layer["young_MPa"], mat_layer["poisson"], thickness_mm)
        layer = Mat(layer, fitted.pressure)
    worn, options = WornSquare(path, layer), {"hardness_MPa": hardness_MPa}
    settings = options | {"mat": mat_layer}
    for patch, file in files_of(contacts, patches).items():
        contact = Contact.from_dataset(read_dataset(file))
        found = wear_map(contact, worn, fitted, patch, **options)
        made = provenance([square, *([mat] if mat else []), file], settings)
        write_dataset(depths / f"{patch}.h5", found, made)


if "snakemake" in globals():
    run_script(snakemake, main)
