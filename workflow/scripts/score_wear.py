"""Score the predicted loss of the patches by the measured loss, beside baselines."""

from pathlib import Path

from gst.config.tables import write_table
from gst.run.contacts import contacts_of
from gst.run.logs import run_in_snakemake
from gst.run.stored import changes_of, dataset_of, files_of, table_of
from gstlib.coupling.pressures import covered
from gstlib.io.store import Stored
from gstlib.io.tables import read_pressures
from gstlib.use.laws import law_table
from gstlib.use.outcome import losses_of
from gstlib.validation.summary import score_wear
from gstlib.wear.archard import WornSquare
from gstlib.wear.fit import Prediction


def main(
    contacts: list[Path],
    registered: list[Path],
    square: Path,
    fitted: Path | list,
    depths: list[Path],
    pressures: Path,
    registration: Path,
    use: Path | list,
    laws: Path,
    *,
    worn: list[str],
    scoring: dict,
    **tables: Path,
) -> None:
    """`tables` are the files for the tables of `score_wear`, by name."""
    stone = WornSquare.from_datasets(dataset_of(square), dataset_of(fitted))
    prediction = Prediction.from_worn(Stored(files_of(depths, worn)), stone)
    measured = read_pressures(pressures), table_of(registration)
    scores = score_wear(
        contacts_of(contacts, worn),
        changes_of(registered, worn),
        prediction,
        *measured,
        **scoring,
    )
    for name, file in tables.items():
        write_table(file, scores[name])
    pressed, losses = losses_of(*measured)
    pressure = covered(pressed).to_numpy()
    write_table(
        laws, law_table(dataset_of(use), pressure, losses, seed=scoring["seed"])
    )


run_in_snakemake(main)
