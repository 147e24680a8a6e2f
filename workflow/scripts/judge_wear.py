"""Judge the predicted loss of the patches by the measured one, beside rivals that know as much."""

from pathlib import Path

from gst.logs import run_script
from gst.tables import write_table
from gstlib.contact import Contact
from gstlib.io.store import Stored, read_dataset
from gstlib.io.tables import read_pressures, read_table
from gstlib.validation.summary import judge_wear
from gstlib.wear.archard import WornSquare

CHANGE = "change", "loss", "level_of_detection"


def main(
    contacts: list[Path],
    registered: list[Path],
    folder: Path,
    pressures: Path,
    registration: Path,
    patches: Path,
    table: Path,
    profile: Path,
    summary: Path,
    *,
    worn: list[str],
    expected_worst: list[str],
    seed: int,
    resamples: int,
) -> None:
    square, mat = folder / "whole_square.h5", folder / "whole_mat.h5"
    predicted = square.exists()
    found = judge_wear(
        Stored(dict(zip(worn, contacts, strict=True)), then=Contact.from_dataset),
        Stored(dict(zip(worn, registered, strict=True)), CHANGE),
        Stored({patch: folder / f"{patch}.h5" for patch in worn} if predicted else {}),
        read_pressures(pressures),
        read_table(registration),
        fitted_to=WornSquare(read_dataset(square), None).fitted_to if predicted else (),
        mat=read_dataset(mat) if mat.exists() else None,
        expected_worst=expected_worst,
        seed=seed,
        resamples=resamples,
    )
    files = {"patches": patches, "wear": table, "profile": profile, "summary": summary}
    for name, file in files.items():
        write_table(file, found[name])


if "snakemake" in globals():
    run_script(snakemake, main)
