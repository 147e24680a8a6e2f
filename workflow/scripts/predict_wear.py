"""Wear a batch of patches by Archard's law, as the losses of other patches predict."""

from pathlib import Path

from gst.run.logs import run_script
from gst.run.provenance import made_by
from gst.run.stored import contacts_of, dataset_of
from gstlib.io.store import read_dataset, write_dataset
from gstlib.wear.archard import WornSquare
from gstlib.wear.fit import predict_wear


def main(
    square: Path,
    fitted: Path | list,
    contacts: Path,
    depths: Path,
    *,
    patches: list[str],
    **settings: float | None,
) -> None:
    """The folder stays empty where wear is not predicted.

    `settings` are those of `predict_wear`.
    """
    worn = WornSquare.from_datasets(read_dataset(square), dataset_of(fitted))
    depths.mkdir(exist_ok=True)
    pressed = contacts_of(contacts, patches)
    for patch, depth in predict_wear(pressed, worn, **settings):
        write_dataset(depths / f"{patch}.h5", depth, made_by("predict_wear"))


if "snakemake" in globals():
    run_script(snakemake, main)
