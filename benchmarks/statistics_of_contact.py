"""Rough contact in numbers that others have published: periodic self-affine surfaces.

`.venv/bin/python benchmarks/statistics_of_contact.py` presses ten surfaces each of two shortest
waves (512² elements, Hurst exponent 0.8, roll-off at a quarter of the period), writes the rows, and
prints the tables of docs/explanation/solver.md; `--tables` prints them from the rows.
"""

import math
from itertools import product

import numpy as np
import pandas as pd
from runner import RESULTS, run_script

from gstlib.bem import load_path
from gstlib.bem.closed_forms import persson_contact_fraction
from gstlib.specimen.randomness import self_affine_field

ROWS = RESULTS / "statistics_of_contact.csv"
COUNT, HURST, ROLL_OFF, SEEDS = 512, 0.8, 0.25, 10
# Mean pressure over E* times the r.m.s. slope.
LOADS = 0.005, 0.01, 0.03, 0.1, 0.3, 1.0
# Area over these loads by Tamaas 2.9, one run, corrected for the perimeter, by the shortest wave in
# elements.
PUBLISHED = {
    4: dict(zip(LOADS, (2.095, 2.099, 2.040, 1.934), strict=False)),
    16: dict(zip(LOADS, (2.337, 2.291, 2.171, 2.004), strict=False)),
}


def measured(shortest, seed):
    """A row for each load on one surface; lengths in periods, pressures over E*."""
    heights = self_affine_field(
        np.random.default_rng(seed),
        COUNT,
        1 / COUNT,
        hurst_exponent=HURST,
        roll_off=ROLL_OFF,
        shortest=shortest / COUNT,
    )
    heights = heights - heights.mean()
    # Moments of the spectrum: of heights, slopes and curvatures (P. R. Nayak, 1971).
    along = 2 * np.pi * np.fft.fftfreq(COUNT, 1 / COUNT)
    squared = np.add.outer(along**2, along**2)
    waves = np.abs(np.fft.fft2(heights)) ** 2 / COUNT**4
    m0, m2, m4 = ((squared**power * waves).sum() for power in range(3))
    for load in LOADS:
        pressure = load * np.sqrt(m2)
        path = load_path(
            heights, 1 / COUNT, 1.0, target_pressure=pressure, steps=1, periodic=True
        )
        yield {
            "shortest": shortest,
            "seed": seed,
            "load": load,
            "nayak": 1.5 * m0 * m4 / m2**2,
            "contact": path.final.corrected_fraction,
            "stiffness": path.stiffness[0] / pressure * np.sqrt(m0),
            "gap": float(path.final.gap.mean()) / np.sqrt(m0),
        }


def summary(rows):
    """Means over the surfaces: area over load with its standard error, and what others found."""
    rows = rows.assign(kappa=rows.contact / rows.load, gamma=1 / rows.stiffness)
    groups = rows.groupby(["shortest", "load"])
    table = groups[["nayak", "contact", "kappa", "gamma", "gap"]].mean()
    table["error"] = groups.kappa.sem()
    table["published"] = [
        PUBLISHED[wave].get(load, math.nan) for wave, load in table.index
    ]
    table["deviation_percent"] = 100 * (table.kappa / table.published - 1)
    table["error_percent"] = 100 * table.error / table.kappa
    table["persson"] = [
        persson_contact_fraction(load, 1.0, 1.0) for _, load in table.index
    ]
    return table.reset_index()


def made(chosen):
    """The rows of all surfaces."""
    cases = product(PUBLISHED, range(SEEDS))
    yield pd.DataFrame([row for case in cases for row in measured(*case)]).round(6)


if __name__ == "__main__":
    run_script(
        __doc__, ROWS, made, lambda rows: summary(rows).round(4).to_string(index=False)
    )
