"""Read from the losses of the patches, or from grades of wear, how the tool was used."""

from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from gst.logs import run_script
from gst.provenance import provenance
from gst.tables import write_table
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import read_table
from gstlib.macroscale.face import without_curvature
from gstlib.use.evidence import Grades
from gstlib.use.infer import StatedUse, infer_use, losses_of, predicted_losses, use_table
from gstlib.use.sampling import Sampling


def main(
    face: Path,
    registration: Path,
    use: Path,
    table: Path,
    losses: Path | None = None,
    *,
    patches: dict[str, list],
    stated: dict[str, Any],
    sampling: dict[str, Any],
    modulus: float,
    patch_mm: float,
) -> None:
    """The file of the use has attributes alone where too few patches wore to tell."""
    whole = read_dataset(face, only=["height", "counterface", "size_mm"])
    told, drawn = StatedUse(**stated), Sampling(**sampling)
    places = pd.DataFrame(patches)
    if registration:
        known, wear = losses_of(places, read_table(registration))
    else:
        known, wear = places, Grades(places.wear_grade.to_numpy(dtype=int))
    settings = {"modulus": modulus, "patch_mm": patch_mm}

    def infer(face: xr.Dataset) -> xr.Dataset:
        return infer_use(face, known, wear, told, sampling=drawn, **settings)

    found = infer(whole)
    sources = [face, registration] if registration else [face]
    write_dataset(use, found, provenance(sources, settings | stated | sampling))
    predicted = None
    if losses is not None:
        predicted = predicted_losses(found, wear, drawn.seed)
        write_table(losses, predicted)
    answers = use_table(found, told, predicted)
    if not registration:  # the mesh is that of the worn tool
        other = use_table(infer(without_curvature(whole)), told)
        answers = answers.assign(mean_without_curvature=other["mean"])
    write_table(table, answers)


if "snakemake" in globals():
    run_script(snakemake, main)
