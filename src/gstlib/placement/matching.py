"""A patch laid over the macroscale: around its nominal place, and far from it for chance."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from gstlib.placement.waves import FLIPS, POINTS

__all__ = ["DRAWS", "STRIDE", "Match", "lay_patch", "share_by_chance"]

# Peaks are some 10 points wide: for the maxima of all patches together every third point will do.
STRIDE = 3
DRAWS = 1999


@dataclass(frozen=True)
class Match:
    """A patch laid over its nominal place, around it, and far from it.

    Attributes
    ----------
    correlation : (8, k, k) ndarray
        With each of `VARIANTS` of the patch, over the trial shifts (y, x); where the footprint
        would leave the square, as at the nearest shift where it does not.
    inside : (k, k) ndarray of bool
        Where the footprint stays in the square.
    energy : float
        Mean square of the patch's waves, mm².
    highest : (n,) ndarray
        Highest correlation of each equal search far from the nominal place, in ascending order.
    searches : float
        How many independent ones they amount to.
    chance : (DRAWS, j, j) ndarray or None
        Correlations of such searches, at every `STRIDE`-th shift; None where there is no room.
    """

    correlation: np.ndarray
    inside: np.ndarray
    energy: float
    highest: np.ndarray
    searches: float
    chance: np.ndarray | None

    def as_given(self) -> np.ndarray:
        """Correlation of the patch as given; NaN where its footprint would leave the square."""
        return np.where(self.inside, self.correlation[0], np.nan)


def lay_patch(
    of_patch: np.ndarray,
    under: np.ndarray,
    at: np.ndarray,
    reach: int,
    generator: np.random.Generator,
) -> Match:
    """Lay a patch (8, waves) on the macroscale (waves, ny, nx), whose point `at` is nominal."""
    from scipy.ndimage import maximum_filter

    upright = of_patch[:FLIPS]
    energy = float(upright[0] @ upright[0])
    size = np.sqrt(energy * (under**2).sum(axis=0))
    everywhere = np.tensordot(upright, under, 1)
    everywhere = np.divide(everywhere, size, out=np.zeros_like(everywhere), where=size > 0)

    width = 2 * reach + 1
    asked = [np.arange(a - reach, a + reach + 1) for a in at]
    known = [np.clip(a, 0, n - 1) for a, n in zip(asked, everywhere.shape[1:], strict=True)]
    window = everywhere[:, known[0][:, None], known[1]]
    inside = np.equal(asked[0], known[0])[:, None] & np.equal(asked[1], known[1])

    # The same search about other places: none of its footprints may overlap much with where the
    # patch truly lies. Flips make more of them.
    # ASSUME: chance is the same all over the square, and for a patch and its mirror images.
    rows, columns = (np.arange(reach, n - reach) for n in everywhere.shape[1:])
    away = 2 * reach + POINTS // 2
    far = np.maximum(abs(rows - at[0])[:, None], abs(columns - at[1])) >= away
    highest, searches, chance = np.zeros(0), 0.0, None
    if far.any():
        highest = maximum_filter(everywhere, (1, width, width))[:, rows[0] :, columns[0] :]
        highest = np.sort(highest[:, : len(rows), : len(columns)][:, far], axis=None)
        # searches this far apart have little in common
        searches = FLIPS * far.sum() / (width + POINTS // 8) ** 2
        chance = _draws(everywhere, rows, columns, far, reach, generator)
    both = np.concatenate([window, -window])
    return Match(both, inside, energy, highest, float(searches), chance)


def _draws(
    everywhere: np.ndarray,
    rows: np.ndarray,
    columns: np.ndarray,
    far: np.ndarray,
    reach: int,
    generator: np.random.Generator,
) -> np.ndarray:
    """Windows (DRAWS, j, j) about far places drawn by chance, of any flip."""
    places = np.argwhere(far)[generator.integers(0, far.sum(), DRAWS)]
    flips = generator.integers(0, FLIPS, DRAWS)[:, None, None]
    along = np.arange(-reach, reach + 1, STRIDE)
    row = rows[places[:, 0]][:, None, None] + along[:, None]
    column = columns[places[:, 1]][:, None, None] + along
    return everywhere[flips, row, column]


def share_by_chance(correlation: float, matches: Iterable[Match]) -> float:
    """Share of searches in the wrong places, of all patches, that find such a correlation."""
    # ASSUME: chance is alike for all patches, so that their searches in wrong places add up.
    matches = [match for match in matches if match.searches]
    as_high = sum(
        match.searches * (1 - np.searchsorted(match.highest, correlation) / len(match.highest))
        for match in matches
    )
    return float((1 + as_high) / (1 + sum(match.searches for match in matches)))
