"""Score the predicted loss of the patches by the measured one, beside baselines."""

from pathlib import Path

from gst.batches import files_of
from gst.logs import run_script
from gst.tables import write_table
from gstlib.contact import Contact
from gstlib.io.store import Stored, read_dataset
from gstlib.io.tables import read_pressures, read_table
from gstlib.validation.summary import score_wear
from gstlib.wear.archard import WornSquare
from gstlib.wear.fit import Prediction

CHANGE = "change", "loss", "level_of_detection"


def main(
    contacts: list[Path],
    registered: list[Path],
    square: Path,
    interlayer: Path | list,
    depths: list[Path],
    pressures: Path,
    registration: Path,
    patches: Path,
    table: Path,
    profile: Path,
    summary: Path,
    *,
    worn: list[str],
    expected_most_worn: list[str],
    seed: int,
    resamples: int,
) -> None:
    path, losses = read_dataset(square), Stored(files_of(depths, worn))
    prediction = Prediction(losses)
    if path.sizes:
        layer = read_dataset(interlayer) if interlayer else None
        prediction = Prediction(losses, WornSquare(path, None).fitted_to, layer)
    found = score_wear(
        Stored(files_of(contacts, worn), then=Contact.from_dataset),
        Stored(files_of(registered, worn), CHANGE),
        prediction,
        read_pressures(pressures),
        read_table(registration),
        expected_most_worn=expected_most_worn,
        seed=seed,
        resamples=resamples,
    )
    files = {"patches": patches, "wear": table, "profile": profile, "summary": summary}
    for name, file in files.items():
        write_table(file, found[name])


if "snakemake" in globals():
    run_script(snakemake, main)
