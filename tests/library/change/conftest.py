"""Two measurements of one synthetic stone: T0, and T1 worn, displaced, tilted and noisy."""

import numpy as np
import pytest
import scipy.ndimage
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane

SPACING = 1.66e-3


def self_affine(size, rng, *, hurst=0.8, longest=3):
    """Periodic self-affine heights of unit r.m.s.; `longest` is the roll-off in waves a side."""
    wave = np.hypot(*np.meshgrid(*[np.fft.fftfreq(size) * size] * 2, indexing="ij"))
    amplitude = np.where(wave > 0, np.maximum(wave, longest) ** -(1 + hurst), 0)
    heights = np.fft.ifft2(np.fft.fft2(rng.standard_normal((size, size))) * amplitude).real
    return heights / heights.std()


def laid(stone, size, shift, rotation_deg):
    """The middle of a stone as a scan of (size, size) sees it, moved (y, x elements) and turned."""
    y, x = np.indices((size, size)) - (size - 1) / 2
    turn, centre = np.radians(rotation_deg), (len(stone) - 1) / 2
    rows = np.cos(turn) * y + np.sin(turn) * x + shift[0] + centre
    columns = -np.sin(turn) * y + np.cos(turn) * x + shift[1] + centre
    moved = scipy.ndimage.map_coordinates(stone, [rows, columns], order=3, mode="grid-wrap")
    return moved, SPACING * x, SPACING * y


@pytest.fixture(scope="session")
def remeasure():
    """Make (T0, T1, true change in mm on T0's grid), T1 placed at `shift` (y, x) elements."""
    size, whole = 256, 1024
    rng = np.random.default_rng(7)
    stone = 4e-3 * scipy.ndimage.gaussian_filter(self_affine(whole, rng, longest=8), 0.8)
    pits = self_affine(whole, rng, longest=60) > 2.7

    def make(shift, *, rotation_deg=0.0, wear=0.1, noise_um=0.2, tilt=1e-3, seed=0, other=False):
        rng = np.random.default_rng(seed)
        middle = slice((whole - size) // 2, (whole + size) // 2)
        top = np.quantile(stone[middle, middle], 1 - wear)
        worn = np.where(stone > top, top + 0.3 * (stone - top), stone)
        worn = np.where(pits, worn - 3e-3, worn) if wear else worn
        source = np.roll(worn, (whole // 2, whole // 3), (0, 1)) if other else worn
        moved, x, y = laid(source, size, shift, rotation_deg)
        t0, t1 = (
            make_surface(h + 1e-3 * noise_um * rng.standard_normal(h.shape), SPACING)
            for h in (stone[middle, middle], moved + tilt * (x - 0.5 * y))
        )
        t0, t1 = (remove_plane(surface)[0] for surface in (t0, t1))
        return t0, t1, (worn - stone)[middle, middle]

    return make


@pytest.fixture
def scans():
    """Make T0 and T1 of a small stone: worn, with spikes, noise and another tilt."""

    def make(seed, shift=(0.0, 0.0), turn_deg=0.0, size=128):
        rng = np.random.default_rng(seed)
        stone = 4e-3 * scipy.ndimage.gaussian_filter(self_affine(2 * size, rng, longest=6), 0.8)
        middle = slice(size // 2, 3 * size // 2)
        top = np.quantile(stone[middle, middle], 0.8)
        worn = np.minimum(stone, top + 0.2 * (stone - top))
        after, x, y = laid(worn, size, shift, turn_deg)
        spike = rng.random((2, size, size)) < 0.002
        noise = 0.1e-3 * rng.standard_normal((2, size, size)) + 20e-3 * spike
        heights = stone[middle, middle], after + 2e-3 * x - 1e-3 * y
        return [
            make_surface(h - h.mean() + n, SPACING) for h, n in zip(heights, noise, strict=True)
        ]

    return make
