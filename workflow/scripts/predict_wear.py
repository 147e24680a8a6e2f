"""Wear a batch of patches by Archard's law, as the losses of other patches predict."""

from pathlib import Path

from gst.batches import files_of
from gst.logs import run_script
from gst.provenance import provenance
from gstlib.bem import Layer
from gstlib.contact import Contact
from gstlib.io.store import read_dataset, write_dataset
from gstlib.wear.archard import Interlayer, WornSquare
from gstlib.wear.fit import wear_map


def main(
    square: Path,
    interlayer: Path | list,
    contacts: Path,
    depths: Path,
    *,
    patches: list[str],
    interlayer_layer: dict[str, float] | None,
    pressure_cap: float | None,
) -> None:
    """The folder stays empty where wear is not predicted."""
    path, layer, fitted = read_dataset(square), None, None
    depths.mkdir(exist_ok=True)
    if not path.sizes:
        return
    if interlayer_layer is not None:
        fitted, thickness_mm = read_dataset(interlayer), interlayer_layer["thickness_um"] * 1e-3
        layer = Layer(interlayer_layer["young_MPa"], interlayer_layer["poisson"], thickness_mm)
        layer = Interlayer(layer, fitted.pressure)
    worn, options = WornSquare(path, layer), {"pressure_cap": pressure_cap}
    settings = options | {"interlayer": interlayer_layer}
    for patch, file in files_of(contacts, patches).items():
        contact = Contact.from_dataset(read_dataset(file))
        found = wear_map(contact, worn, fitted, patch, **options)
        made = provenance([square, *([interlayer] if interlayer else []), file], settings)
        write_dataset(depths / f"{patch}.h5", found, made)


if "snakemake" in globals():
    run_script(snakemake, main)
