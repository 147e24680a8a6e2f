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

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from age import record

from gstlib.io.tables import read_table, write_table
from gstlib.specimen.randomness import self_affine_field
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane
from gstlib.validation.inference import Draws, mean_of, rank_correlation
from gstlib.validation.nulls import Places, p_value, swapped_mcc

ROWS = Path(__file__).parents[1] / "benchmarks/results/chance.csv"
LEVEL = 0.05
# Points along a patch's side; the waves are made on a larger map, of which it is a piece.
POINTS, WIDE = 100, 512
LONGEST_WAVES = 10, 20, 40, 80, 160, 320, 640  # points
PREDICTED, LOST = (0.02, 0.3), (0.01, 0.3)  # shares of the patch
SIDE, PATCHES, DISTANCES = 5, 12, 2.0
JITTER = 1e-9  # for the smooth fields' Cholesky factor
IN_STATISTICS = 6, 12, 25


def highest(field: np.ndarray, share: float) -> np.ndarray:
    """The highest points (ny, nx) of a field, a share of all."""
    return field > np.quantile(field, 1 - share)


def waves(rng: np.random.Generator) -> list[dict[str, float]]:
    """Two unrelated levelled maps for each patch."""
    every, longest = np.ones((POINTS, POINTS), bool), float(rng.choice(LONGEST_WAVES))
    places = {}
    for patch in map(str, range(PATCHES)):
        masks = []
        for share in (PREDICTED, LOST):
            wide = self_affine_field(rng, WIDE, 1.0, hurst_exponent=0.8, roll_off=longest)
            piece = make_surface(wide[:POINTS, :POINTS].astype(float), 1e-3)
            level = remove_plane(piece)[0].values
            masks.append(highest(level, float(np.exp(rng.uniform(*np.log(share))))))
        places[patch] = Places.of(*masks, every)
    nulls = [swapped_mcc(patch, places) for patch in places]
    return [{"p_value": p_value(float(null[0]), null[1:])} for null in nulls]


def neighbours(rng: np.random.Generator) -> list[dict[str, float]]:
    """Two unrelated fields over patches of a square."""
    places = np.stack(np.meshgrid(np.arange(SIDE), np.arange(SIDE)), axis=-1).reshape(-1, 2)
    places = places[rng.permutation(len(places))[:PATCHES]]
    distance = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
    factor = np.linalg.cholesky(
        np.exp(-((distance / DISTANCES) ** 2)) + JITTER * np.eye(PATCHES)
    )
    of_patches = (factor @ rng.standard_normal((PATCHES, 2))).T
    columns = dict(
        zip(("x_mm", "y_mm", "pressure", "loss"), (*places.T, *of_patches), strict=True)
    )
    found = rank_correlation(pd.DataFrame(columns), "pressure", "loss", Draws(rng, 2))
    return [{"p_value": found.p_value}]


def mean(count: int) -> Callable[[np.random.Generator], list[dict[str, float]]]:
    """The mean over so many patches of normal numbers, which is 0."""

    def held(rng: np.random.Generator) -> list[dict[str, float]]:
        found = mean_of(rng.standard_normal(count), Draws(rng, 999))
        return [{"held": float(found.low <= 0 <= found.high)}]

    return held


CASES: dict[str, Callable[[np.random.Generator], list[dict[str, float]]]] = {
    "waves": waves,
    "neighbours": neighbours,
    **{f"mean of {count}": mean(count) for count in IN_STATISTICS},
}


def rates(rows: pd.DataFrame) -> pd.DataFrame:
    """Claims at `LEVEL` by case, or how many intervals hold."""
    rows = rows.assign(claim=(rows.p_value <= LEVEL).where(rows.p_value.notna()))
    found = rows.groupby("case", sort=False)[["claim", "held"]].agg(["mean", "count"])
    return found.astype(float).round(3)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=3000, help="of each case")
    parser.add_argument("--rows", type=Path, default=ROWS)
    parser.add_argument("--tables", action="store_true", help="from the rows alone")
    options = parser.parse_args()
    if not options.tables:
        found: list[dict[str, Any]] = []
        for number, (name, draw) in enumerate(CASES.items()):
            rows: list[dict[str, float]] = []
            while len(rows) < options.trials:
                rows += draw(np.random.default_rng([number, len(rows)]))
            found += [{"case": name} | row for row in rows]
            print(f"{name}: done", flush=True)
        columns = ["case", "p_value", "held"]
        write_table(options.rows, pd.DataFrame(found, columns=columns))
        record(options.rows)
    print(rates(read_table(options.rows)).to_string())


if __name__ == "__main__":
    main()
