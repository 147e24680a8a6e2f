"""How often do the tests find a relation where there is none? docs/explanation/evidence.md.

    python benchmarks/chance.py [--trials 3000] [--tables]

`benchmarks/power.py` asks this of whole studies; here each trial is drawn at random, so that there
are many. Its rows, one a trial, go to benchmarks/results/chance.csv:

- ``waves``: twelve patches, of each the highest points of a levelled self-affine map against the
  lowest of another, all with waves up to a length between a tenth of a patch and many times it; a
  row for each patch;
- ``neighbours``: Spearman's correlation of two fields over twelve patches, each field correlated
  over two distances between patches;
- ``mean of 6`` to ``mean of 25``: ``held``, whether the interval of a mean holds it.
"""

from functools import partial

import numpy as np
import pandas as pd
from runner import RESULTS, run_script
from scipy.spatial.distance import cdist

from gstlib.specimen.randomness import self_affine_field
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane
from gstlib.validation.inference import Draws, mean_of, rank_correlation
from gstlib.validation.nulls import Places, p_value, swapped_mcc

ROWS = RESULTS / "chance.csv"
LEVEL = 0.05
# Points along a patch's side; the waves are made on a larger map, of which it is a piece.
POINTS, WIDE = 100, 512
LONGEST_WAVES = 10, 20, 40, 80, 160, 320, 640  # points
PREDICTED, LOST = (0.02, 0.3), (0.01, 0.3)  # shares of the patch
SIDE, PATCHES, DISTANCES = 5, 12, 2.0
JITTER = 1e-9  # for the smooth fields' Cholesky factor
IN_STATISTICS = 6, 12, 25


def waves(rng):
    """Two unrelated levelled maps for each patch."""
    every = np.ones((POINTS, POINTS), bool)
    longest = float(rng.choice(LONGEST_WAVES))
    places = {}
    for patch in map(str, range(PATCHES)):
        masks = []
        for share in (PREDICTED, LOST):
            wide = self_affine_field(
                rng, WIDE, 1.0, hurst_exponent=0.8, roll_off=longest
            )
            piece = make_surface(wide[:POINTS, :POINTS].astype(float), 1e-3)
            level = remove_plane(piece)[0].values
            marked = np.exp(rng.uniform(*np.log(share)))
            masks.append(level > np.quantile(level, 1 - marked))
        places[patch] = Places.packed(*masks, every)
    nulls = [swapped_mcc(patch, places) for patch in places]
    return [{"p_value": p_value(float(null[0]), null[1:])} for null in nulls]


def neighbours(rng):
    """Two unrelated fields over patches of a square."""
    places = np.indices((SIDE, SIDE)).reshape(2, -1).T[:, ::-1]
    places = places[rng.permutation(len(places))[:PATCHES]]
    distance = cdist(places, places)
    covariance = np.exp(-((distance / DISTANCES) ** 2)) + JITTER * np.eye(PATCHES)
    fields = np.linalg.cholesky(covariance) @ rng.standard_normal((PATCHES, 2))
    names = ["x_mm", "y_mm", "pressure", "loss"]
    table = pd.DataFrame(np.hstack([places, fields]), columns=names)
    return [
        {"p_value": rank_correlation(table, "pressure", "loss", Draws(rng, 2)).p_value}
    ]


def mean(rng, count):
    """The mean over so many patches of normal numbers, which is 0."""
    estimate = mean_of(rng.standard_normal(count), Draws(rng, 999))
    return [{"held": float(estimate.low <= 0 <= estimate.high)}]


CASES = {"waves": waves, "neighbours": neighbours}
CASES |= {f"mean of {count}": partial(mean, count=count) for count in IN_STATISTICS}


def rates(rows):
    """Claims at `LEVEL` by case, or how many intervals hold."""
    rows = rows.assign(claim=(rows.p_value <= LEVEL).where(rows.p_value.notna()))
    table = rows.groupby("case", sort=False)[["claim", "held"]].agg(["mean", "count"])
    return table.astype(float).round(3)


def made(chosen):
    """The rows of all trials."""
    rows = []
    for number, (name, draw) in enumerate(CASES.items()):
        drawn = []
        while len(drawn) < chosen.trials:
            drawn += draw(np.random.default_rng([number, len(drawn)]))
        rows += [{"case": name} | row for row in drawn]
        print(f"{name}: done", flush=True)
    yield pd.DataFrame(rows, columns=["case", "p_value", "held"])


if __name__ == "__main__":
    run_script(__doc__, ROWS, made, lambda rows: rates(rows).to_string(), trials=3000)
