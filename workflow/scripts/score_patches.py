"""Score predicted contact against measured height loss, patch by patch and over the patches.

Inputs: contacts and registered height changes of the patches, microscale_summary.csv.
Outputs: validation_patches.csv, validation_gains.csv, validation_failures.csv,
validation_summary.csv. Settings: the patches, those expected to be the worst, and `validation`
of the config.
"""

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from gstlib.contact import pressed_height
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table, write_table
from gstlib.logs import job_log, patch_by_patch
from gstlib.validation.across import (
    EXTENTS,
    expected_worst,
    mean_gains,
    mean_recalls,
    mean_scores,
    rank_correlations,
)
from gstlib.validation.comparison import CONTACT, compare, score_patch, scores_of, warning_of
from gstlib.validation.failures import gap_bands, height_bands, split_loss
from gstlib.validation.gains import null_scores, weigh_patch
from gstlib.validation.rivals import RIVALS


def main(
    contacts: dict[str, Path],
    registered: dict[str, Path],
    microscale: Path,
    patches: Path,
    gains: Path,
    failures: Path,
    summary: Path,
    *,
    places: dict[str, Sequence[float]],
    worst: Sequence[str],
    seed: int,
    resamples: int,
    shifts: int,
    most_noise: float,
    height_quantiles: Sequence[float],
    gap_limits_um: Sequence[float],
    **lengths: float,
) -> None:
    scored, weighed, split, nulls = [], [], [], []
    for patch, file in patch_by_patch(contacts):
        contact, change = read_dataset(file), read_dataset(registered[patch])
        at = compare(pressed_height(contact), contact, change, **lengths)
        # a patch draws the same whichever others are in the study
        generator = np.random.default_rng([seed, *patch.encode()])
        scores = scores_of(at)
        nulls.append(null_scores(at, shifts=shifts, generator=generator))
        rows = weigh_patch(
            scores,
            at,
            nulls[-1],
            most_noise=most_noise,
            resamples=resamples,
            generator=generator,
        )
        scored.append({"patch": patch} | score_patch(at, scores, change))
        if warning := warning_of(scored[-1], most_noise):
            logging.getLogger("gstlib").warning("%s", warning)
        touching = at.predictions[CONTACT].mask
        bands = {
            "height": height_bands(contact["height"].values, at.valid, height_quantiles),
            "gap": gap_bands(touching, contact["gap"].values, at.valid, gap_limits_um),
        }
        weighed += [{"patch": patch} | row for row in rows]
        split += [
            {"patch": patch, "split": name} | row
            for name, masks in bands.items()
            for row in split_loss(touching, at.loss, at.valid, masks)
        ]
    scored, weighed, split = map(pd.DataFrame, (scored, weighed, split))
    columns = ["patch", "mean_pressure_MPa", "stiffness_MPa_per_um"]
    predicted = read_table(microscale, columns)[columns]
    both = scored.merge(predicted.rename(columns={"mean_pressure_MPa": "pressure_MPa"}), on="patch")
    both[["x_mm", "y_mm"]] = [places[patch] for patch in both.patch]
    chance = {"resamples": resamples, "generator": np.random.default_rng(seed)}
    parts = [
        mean_gains(scored, RIVALS, **chance),
        mean_scores(weighed, nulls, **chance),
        rank_correlations(both, places=("x_mm", "y_mm"), **chance),
        mean_recalls(split, **chance),
        expected_worst(both, worst, [*EXTENTS, "pressure_MPa", "contact_fraction"]),
    ]
    write_table(patches, scored)
    write_table(gains, weighed)
    write_table(failures, split)
    write_table(summary, pd.concat([part for part in parts if len(part)], ignore_index=True))


if "snakemake" in globals():
    with job_log(snakemake.log[0]):
        ids = snakemake.params.patches
        main(
            dict(zip(ids, map(Path, snakemake.input.contacts), strict=True)),
            dict(zip(ids, map(Path, snakemake.input.registered), strict=True)),
            Path(snakemake.input.microscale),
            Path(snakemake.output.patches),
            Path(snakemake.output.gains),
            Path(snakemake.output.failures),
            Path(snakemake.output.summary),
            places=snakemake.params.places,
            worst=snakemake.params.worst,
            **snakemake.params.validation,
        )
