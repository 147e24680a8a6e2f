"""Is the contact with a smooth active tool what wear sees, where the tool is rough?

    python benchmarks/strikes.py [--seeds 8001 8002] [--processes 2]
    python benchmarks/strikes.py --tables

Loaded patches of synthetic stones are pressed by a smooth face, and again and again by rough ones,
whose waves are those of the stone down to two scan points: by another piece of the tool at each
strike ("elsewhere"), or by one piece that comes down beside itself, by a normal distance with a
standard deviation of 20 µm along each axis ("again"). Wear sees the mean of the pressures. Rows go
to `results/strikes.csv`; `--tables` prints the table of docs/explanation/evidence.md from them.
"""

import warnings

import numpy as np
import pandas as pd
from power import CONFIG
from runner import RESULTS, means, run_stones
from specimens import merged, specimen_config, specimen_studies, worn_patches

from gstlib.bem import ContactWarning, solve_contact
from gstlib.specimen.randomness import ROLL_OFF_MM, self_affine_field, stream

ROWS = RESULTS / "strikes.csv"
SEEDS, PATCHES = [8001, 8002], 10
# R.m.s. heights of the tool's face within a patch, and how often it strikes.
ROUGHNESSES_UM, STRIKES = (1.0, 3.0, 5.0), 40
POSITIONS = "elsewhere", "again"
BESIDE_MM = 0.02
SCANS = {"scan_points": 256, "scan_spacing_um": 3.32}


def solved(contact, rough=0.0, **options):
    """The contact of a patch with a face (mm) on it, in place of a smooth one."""
    heights, spacing = contact.interface.for_solver
    options = {"contact_modulus": contact.modulus} | options
    with warnings.catch_warnings():
        warnings.simplefilter(
            "ignore", ContactWarning
        )  # its surroundings are in its heights
        return solve_contact(
            heights + rough,
            spacing,
            mean_pressure=contact.load.mean_pressure,
            **options,
        )


def faces(patch, seed, shape, spacing, positions):
    """Pieces (mm, r.m.s. 1) of a rough tool, one for each strike."""
    generator = stream(seed, patch, positions)
    count = 2 * max(shape)
    face = self_affine_field(
        generator,
        count,
        spacing,
        hurst_exponent=0.8,
        roll_off=ROLL_OFF_MM,
        longest=max(shape) * spacing,
        shortest=4 * spacing,
    )
    face = (face / face.std()).astype(float)
    for _ in range(STRIKES):
        if positions == "elsewhere":
            move = generator.integers(0, count, 2)
        else:
            move = np.rint(generator.normal(0, BESIDE_MM / spacing, 2)).astype(int)
        yield np.roll(face, move, (0, 1))[: shape[0], : shape[1]]


def agreement(worn, *ranked):
    """MCC of a mask with as many points, those of the largest first value, and then second one."""
    order = np.lexsort([values.ravel() for values in ranked[::-1]])
    count = int(worn.sum())
    share = count / worn.size
    hit = worn.ravel()[order[-count:]].mean()
    return float((hit - share) / (1 - share))


def stone(seed):
    """The study of one stone."""
    config = merged(specimen_config(CONFIG), {"specimen": SCANS, "interlayer": None})
    ((_, study),) = specimen_studies(config, worn_patches(config), seed, ("summits",))
    return study


def loaded_contacts(study):
    """Contacts of loaded patches of one stone, as a study solves them."""
    loaded = study.pressures.query("pressure_MPa > 1").patch[:PATCHES]
    return {patch: study.contacts[patch] for patch in loaded}


def rows_of(seed):
    """A row for each patch of one stone, roughness and kind of positions."""
    rows = [
        row
        for patch, contact in loaded_contacts(stone(seed)).items()
        for row in struck(contact, patch, seed)
    ]
    return pd.DataFrame(rows).round(4)


def struck(contact, patch, seed):
    """The rows of one patch."""
    smooth = solved(contact)
    height = contact.interface.height.values
    spacing = contact.interface.for_solver[1][1]
    for positions in POSITIONS:
        pieces = list(faces(patch, seed, height.shape, spacing, positions))
        for rms in ROUGHNESSES_UM:
            fields = np.stack(
                [solved(contact, 1e-3 * rms * piece).pressure for piece in pieces]
            )
            first, second = (half.mean(axis=0) for half in np.split(fields, 2))
            # the more heavily loaded half of what the second half of the strikes touches
            worn = second > np.median(second[second > 0])
            yield {
                "seed": seed,
                "patch": patch,
                "rms_um": rms,
                "positions": positions,
                "pressure_MPa": contact.load.mean_pressure,
                "smooth_contact": smooth.contact_fraction,
                "strike_contact": float((fields > 0).mean()),
                "touched": float((second > 0).mean()),
                "correlation_strike": correlation(smooth.pressure, fields[0]),
                "correlation_smooth": correlation(smooth.pressure, second),
                "correlation_halves": correlation(first, second),
                "mcc_smooth": agreement(worn, smooth.pressure, -smooth.gap),
                "mcc_halves": agreement(worn, first),
                "mcc_height": agreement(worn, height),
            }


def correlation(one, other):
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])


def summary(rows):
    """Means over the patches."""
    rows = rows.assign(area_ratio=rows.strike_contact / rows.smooth_contact)
    return means(rows, ["positions", "rms_um"], "patches")


if __name__ == "__main__":
    run_stones(__doc__, ROWS, rows_of, lambda rows: [summary(rows).round(3)], SEEDS)
