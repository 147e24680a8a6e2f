"""Two measurements of one synthetic stone: T0, and T1 worn, displaced, tilted and noisy."""

import numpy as np
import pytest
import scipy.ndimage

from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane

SPACING = 1.66e-3


def self_affine(size, rng):
    """Periodic self-affine heights of unit r.m.s., with at least six waves a side."""
    frequency = np.fft.fftfreq(size) * size
    waves = np.hypot(frequency[:, None], frequency)
    amplitude = np.maximum(waves, 6.0) ** -1.8
    amplitude[0, 0] = 0.0
    noise = np.fft.fft2(rng.standard_normal((size, size)))
    heights = np.fft.ifft2(noise * amplitude).real
    return heights / heights.std()


def seen_by_a_scan(stone, size, shift, turn_deg):
    """The middle of a stone, where the scan lies off by `shift` (y, x elements) and is turned."""
    along = np.arange(size) - (size - 1) / 2
    y, x = np.meshgrid(along, along, indexing="ij")
    turn = np.radians(turn_deg)
    cosine, sine = np.cos(turn), np.sin(turn)
    centre = (len(stone) - 1) / 2
    rows = cosine * y + sine * x + shift[0] + centre
    columns = cosine * x - sine * y + shift[1] + centre
    return scipy.ndimage.map_coordinates(
        stone, [rows, columns], order=3, mode="grid-wrap"
    )


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
        seed=0,
        shift=(0, 0),
        turn_deg=0.0,
        *,
        size=128,
        wear=0.2,
        noise_um=0.1,
        spikes=0.002,
    ):
        rng = np.random.default_rng(seed)
        heights = self_affine(2 * size, rng)
        stone = 4e-3 * scipy.ndimage.gaussian_filter(heights, 0.8)
        middle = slice(size // 2, 3 * size // 2)
        top = np.quantile(stone[middle, middle], 1 - wear)
        worn = np.minimum(stone, top + 0.2 * (stone - top))
        before = measured(stone[middle, middle], 0.0, noise_um, spikes, rng)
        moved = seen_by_a_scan(worn, size, shift, turn_deg)
        after = measured(moved, 2e-3, noise_um, spikes, rng)
        return before, after, (worn - stone)[middle, middle]

    return make
