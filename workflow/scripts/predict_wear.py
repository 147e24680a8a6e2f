"""Predict the wear of a batch of patches by Archard's law from the losses of the other patches."""

from pathlib import Path

from gst.run.contacts import contacts_of
from gst.run.logs import run_in_snakemake
from gst.run.stored import dataset_of, write_result
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
    """The folder stays empty if wear is not predicted.

    `settings` are arguments of `predict_wear`.
    """
    worn = WornSquare.from_datasets(dataset_of(square), dataset_of(fitted))
    depths.mkdir(exist_ok=True)
    pressed = contacts_of(contacts, patches)
    for patch, depth in predict_wear(pressed, worn, **settings):
        write_result(depths / f"{patch}.h5", depth, "predict_wear")


run_in_snakemake(main)
