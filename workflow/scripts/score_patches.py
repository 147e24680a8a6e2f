"""Score predicted contact against measured loss, patch by patch and over the patches."""

from pathlib import Path

from gst.logs import run_script
from gstlib.contact import LAID
from gstlib.io.store import Stored
from gstlib.io.tables import read_pressures, read_table, studied_files, write_table
from gstlib.study import score_patches
from gstlib.validation.scoring import Chance, Scoring
from gstlib.validation.summary import predictors

READ = *LAID, "pressure", "gap", "displacement"


def main(
    contacts: list[Path],
    others: list[Path],
    registered: list[Path],
    pressures: Path,
    microscale: Path,
    exposure: Path,
    patches: Path,
    gains: Path,
    summary: Path,
    variants: Path,
    *,
    worn: list[str],
    compared: list[str],
    validation: dict[str, float],
    worst: list[str],
    seed: int,
) -> None:
    by_variant = {
        variant: Stored(studied_files(pressures, worn, files), READ)
        for variant, files in zip(compared, [contacts, others], strict=False)
    }
    changes = Stored(dict(zip(worn, registered, strict=True)), ["change", "loss", "gain"])
    predicted = predictors(
        read_table(microscale, ["patch", "mean_pressure_MPa", "stiffness_MPa_per_um"]),
        read_pressures(pressures),
        read_table(exposure, ["patch", "exposure_N_per_mm"]) if exposure else None,
    )
    scoring = Scoring(*(validation[name] for name in Scoring._fields))
    chance = Chance(seed, validation["shifts"], validation["resamples"])
    tables = score_patches(by_variant, changes, predicted, scoring, chance, worst=worst)
    files = {"patches": patches, "gains": gains, "summary": summary, "variants": variants}
    for name, file in files.items():
        write_table(file, tables[name])


if "snakemake" in globals():
    run_script(snakemake, main)
