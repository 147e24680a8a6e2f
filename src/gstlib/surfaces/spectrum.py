"""The power spectrum of a surface, and the shortest wavelength at which it exceeds the noise.

Noise that differs from point to point has the same power at all wavelengths, while the heights of
stone have less and less power towards short ones. The spectrum of a scan therefore ends in a floor.
"""

import itertools

import numpy as np
import scipy
import xarray as xr

from gstlib.surfaces.grid import spacing_of
from gstlib.surfaces.leveling import remove_plane

__all__ = ["radial_spectrum", "shortest_trusted"]

# ASSUME: Noise floor of a scan. The noise floor of a scan is the mean power of its shortest
# wavelengths, half an octave. Wavelengths count as trusted if their power is at least twice the
# floor. A spectrum that still falls by more than this at its end has no floor. Reason: Half of the
# power is then noise. Errors that correlate between neighbouring points have no such floor, and
# only a repeat shows them.
_OVER_NOISE = 2.0
_HALF_OCTAVE = np.sqrt(2.0)


def radial_spectrum(
    heights: np.ndarray, spacing: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Power spectral density (mm⁴) of a map (ny, nx), mm, over all directions.

    Its frequencies (1/mm) are the multiples of one over the shorter side, up to half the sampling
    rate of the wider spacing (dy, dx). Hann's window makes the map periodic.
    """
    side = min(np.multiply(heights.shape, spacing))
    window = np.outer(*(np.hanning(count + 2)[1:-1] for count in heights.shape))
    window /= np.sqrt((window**2).mean())
    power = np.abs(scipy.fft.fft2((heights - heights.mean()) * window)) ** 2
    y, x = map(scipy.fft.fftfreq, heights.shape, spacing)
    ring = np.rint(np.hypot(y[:, None], x) * side).astype(int).ravel()
    mean = np.bincount(ring, power.ravel()) / np.bincount(ring)
    rings = np.arange(1, int(side / (2 * max(spacing))) + 1)
    return rings / side, mean[rings] * np.prod(spacing) / heights.size


def shortest_trusted(surface: xr.DataArray) -> float:
    """Shortest wavelength (mm) at which the heights of a surface exceed the noise of its points.

    `surface` (y, x) has heights in mm and no NaN. The result is twice the spacing if the spectrum
    has no floor, and NaN if no wavelength exceeds it.

    Examples
    --------
    White noise of 0.1 µm on a wave of 20 µm that is 1 µm high:

    >>> import numpy as np
    >>> from gstlib.surfaces.grid import make_surface
    >>> noise = 1e-4 * np.random.default_rng(1).standard_normal((256, 256))
    >>> wave = 1e-3 * np.sin(2 * np.pi * np.arange(256) / 20)
    >>> round(1e3 * shortest_trusted(make_surface(wave + noise, spacing=1e-3)))
    16
    """
    spacing = spacing_of(surface)
    level, _ = remove_plane(surface)
    frequency, density = radial_spectrum(level.values, spacing)
    # The longest band has at least one frequency.
    ends = frequency[-1] / _HALF_OCTAVE ** np.arange(2 * np.log2(len(frequency) / 3))
    bands = [
        (1 / high, density[(frequency > low) & (frequency <= high)].mean())
        for high, low in itertools.pairwise(ends)
    ]
    if len(bands) < 2:  # too few points for a spectrum
        return np.nan
    (finest, floor), *longer = bands
    if longer[0][1] > _OVER_NOISE * floor:
        return finest
    exceeding = [length for length, power in longer if power > _OVER_NOISE * floor]
    return min(exceeding, default=np.nan)
