"""Two measurements of one synthetic stone: T0, and T1 worn, displaced, tilted and noisy."""

import numpy as np
import pytest
from stones import seen, waves

from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane

SPACING = 1.66e-3


def measured(heights, tilt, noise_um, spikes, rng):
    """A levelled scan of some heights (mm): tilted, noisy, and with a share of spikes."""
    y, x = SPACING * np.indices(heights.shape)
    noise = 1e-3 * noise_um * rng.standard_normal(heights.shape)
    spiky = 20e-3 * (rng.random(heights.shape) < spikes)
    plane = tilt * (x - 0.5 * y)
    surface = make_surface(heights + plane + noise + spiky, SPACING)
    return remove_plane(surface)[0]


@pytest.fixture(scope="session")
def remeasure():
    """Make (T0, T1, change in mm on T0's grid) of stone `seed`, T1 placed at `shift` (y, x)."""

    def make(
        seed=0, shift=(0, 0), turn_deg=0.0, *, wear=0.2, noise_um=0.1, spikes=0.002
    ):
        rng = np.random.default_rng(seed)
        stone = waves(seed, 0.012, 0.1, 4e-3)
        grid = {"spacing": (SPACING, SPACING), "shape": (128, 128)}
        fresh = seen(stone, **grid)
        top = np.quantile(fresh, 1 - wear)

        def worn(y, x):
            return np.minimum(stone(y, x), 0.8 * top + 0.2 * stone(y, x))

        before = measured(fresh, 0.0, noise_um, spikes, rng)
        moved = seen(worn, shift=SPACING * np.array(shift), turn_deg=turn_deg, **grid)
        after = measured(moved, 2e-3, noise_um, spikes, rng)
        return before, after, seen(worn, **grid) - fresh

    return make
