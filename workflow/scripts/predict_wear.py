"""Wear a batch of patches by Archard's law, as the losses of other patches predict."""

from pathlib import Path

from gst.batches import files_of
from gst.logs import run_script
from gst.provenance import provenance
from gstlib.contact import Contact
from gstlib.io.store import Stored, read_dataset, write_dataset
from gstlib.wear.archard import WornSquare
from gstlib.wear.fit import predict_wear


def main(
    square: Path,
    fitted: Path | list,
    contacts: Path,
    depths: Path,
    *,
    patches: list[str],
    interlayer: dict[str, float] | None,
    pressure_cap: float | None,
) -> None:
    """The folder stays empty where wear is not predicted."""
    files, coefficient = files_of(contacts, patches), read_dataset(fitted) if fitted else None
    worn = WornSquare.from_datasets(read_dataset(square), coefficient, interlayer)
    settings = {"pressure_cap": pressure_cap, "interlayer": interlayer}
    depths.mkdir(exist_ok=True)
    pressed = Stored(files, then=Contact.from_dataset)
    for patch, found in predict_wear(pressed, worn, pressure_cap=pressure_cap):
        made = provenance([square, *([fitted] if fitted else []), files[patch]], settings)
        write_dataset(depths / f"{patch}.h5", found, made)


if "snakemake" in globals():
    run_script(snakemake, main)
