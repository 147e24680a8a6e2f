"""A rough surface in numbers, each by its definition::

    r.m.s. height      √⟨(h − ⟨h⟩)²⟩
    r.m.s. slope       √⟨|∇h|²⟩
    r.m.s. curvature   √⟨(∇²h/2)²⟩, of the mean curvature
    Nayak's α          m₀ m₄/m₂² with m₀ = ⟨h²⟩, m₂ = ⟨|∇h|²⟩/2, m₄ = 3⟨(∇²h)²⟩/8

m₂ and m₄ are the second and fourth moments of a profile's spectrum, averaged over all directions
(M. S. Longuet-Higgins, Phil. Trans. A 249 (1957) 321; P. R. Nayak, J. Lubr. Technol. 93 (1971)
398). α is at least 1.5, and grows with the width of the spectrum. Derivatives of a periodic surface
are computed from its waves, others as differences between neighbours.

The spectrum is the power of a wave vector q (rad/mm) on an area::

    C(q) = |∫ h exp(−iq·r) d²r|²/A   (mm⁴), so that ⟨h²⟩ = ∫ C d²q/(2π)²
"""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy

if TYPE_CHECKING:
    import pandas as pd

from .errors import checked_array
from .fields import as_given

__all__ = ["Roughness", "measure_roughness", "measure_spectrum", "slope_of"]


@dataclass(frozen=True)
class Roughness:
    """A surface in numbers, which the module defines.

    Attributes
    ----------
    height : float
        R.m.s. height about the mean (mm).
    slope : float
        R.m.s. slope h′.
    curvature : float
        R.m.s. mean curvature (1/mm).
    """

    height: float
    slope: float
    curvature: float

    @property
    def nayak(self) -> float:
        """Nayak's bandwidth parameter α."""
        return 6 * (self.height * self.curvature) ** 2 / self.slope**4


def measure_roughness(heights, spacing=None, *, periodic: bool = False) -> Roughness:
    """Statistics of a surface.

    Parameters
    ----------
    heights : array_like, shape (ny, nx)
        Heights (mm), NaN or −inf where missing, unless periodic. A plane in them counts.
    spacing : float or (float, float)
        As in `gstlib.bem.solve_contact`.
    periodic : bool
        The surface repeats itself.

    Examples
    --------
    An egg-box of 1 µm at 0.1 mm has an r.m.s. slope of √2 π/100:

    >>> import numpy as np
    >>> wave = np.cos(2 * np.pi * np.arange(32) / 32)
    >>> egg_box = measure_roughness(1e-3 * np.outer(wave, wave), 0.1 / 32, periodic=True)
    >>> round(egg_box.slope, 6), round(egg_box.nayak, 6)
    (0.044429, 1.5)
    """
    heights, spacing, _ = as_given(heights, spacing)
    heights = np.asarray(heights, dtype=float)
    dy, dx = np.broadcast_to(np.asarray(spacing, dtype=float), 2)
    if periodic:
        waves = np.abs(np.fft.fft2(heights - heights.mean())) ** 2 / heights.size**2
        squared = _wave_numbers(heights.shape, (dy, dx)) ** 2
        height, slope, laplacian = (
            math.sqrt((squared**power * waves).sum()) for power in range(3)
        )
        return Roughness(height, slope, laplacian / 2)
    measured = np.where(np.isfinite(heights), heights, math.nan)
    along_y = np.diff(measured, 2, axis=0)[:, 1:-1] / dy**2
    along_x = np.diff(measured, 2, axis=1)[1:-1] / dx**2
    curvature = math.sqrt(np.nanmean((along_y + along_x) ** 2)) / 2
    return Roughness(float(np.nanstd(measured)), slope_of(heights, (dy, dx)), curvature)


def measure_spectrum(
    heights, spacing=None, *, periodic: bool = False
) -> "pd.DataFrame":
    """Power spectrum of a surface, averaged over directions in rings of equal width.

    Parameters
    ----------
    heights : array_like, shape (ny, nx)
        Heights (mm), finite. Their mean is subtracted, but no plane.
    spacing, periodic
        As in `measure_roughness`. A surface that does not repeat itself fades out to its border, by
        Hann's window, and keeps its power.

    Returns
    -------
    DataFrame
        ``wave_number_per_mm`` is the mean q in a ring (rad/mm), ``density_mm4`` the mean C, and
        ``waves`` the number of waves in it. All waves of the grid count, so that the sum of C times
        waves, over the area, is the variance of a periodic surface (Parseval).

    Raises
    ------
    ContactInputError
        Heights are not finite.
    """
    import pandas as pd  # here: solving needs it not

    heights, spacing, _ = as_given(heights, spacing)
    heights = checked_array("heights", heights)
    steps = np.broadcast_to(np.asarray(spacing, dtype=float), 2)
    heights = heights - heights.mean()
    if not periodic:
        along_y, along_x = (
            scipy.signal.windows.hann(n, sym=False) for n in heights.shape
        )
        window = np.outer(along_y, along_x)
        heights = heights * window / math.sqrt((window**2).mean())
    density = np.abs(np.fft.fft2(heights)) ** 2 * steps.prod() / heights.size
    wave_number = _wave_numbers(heights.shape, steps)
    width = 2 * math.pi / (steps * heights.shape).min()
    waves = pd.DataFrame(
        {"wave_number_per_mm": wave_number.ravel(), "density_mm4": density.ravel()}
    )
    waves = waves[1:]  # without the mean, which is no wave
    rings = waves.groupby(np.rint(waves.wave_number_per_mm / width).astype(int))
    return rings.mean().assign(waves=rings.size()).reset_index(drop=True)


def _wave_numbers(shape, spacing):
    """|q| (rad/mm) of each wave of a grid, as `numpy.fft.fft2` orders them."""
    y, x = (np.fft.fftfreq(n, step) for n, step in zip(shape, spacing, strict=True))
    return 2 * math.pi * np.hypot(y[:, None], x)


def slope_of(
    heights: np.ndarray, spacing: tuple[float, float], every: int = 1
) -> float:
    """R.m.s. slope of heights (mm), by differences between neighbours with a finite height.

    Along every line, or `every` so many.
    """
    total = 0.0
    for axis, step in enumerate(spacing):
        if heights.shape[axis] < 2:
            continue
        lines = heights[::every] if axis else heights[:, ::every]
        with np.errstate(invalid="ignore"):  # −inf less −inf
            difference = np.diff(lines, axis=axis)
        squared = float(np.einsum("ij,ij->", difference, difference))
        if not math.isfinite(squared):
            difference = difference[np.isfinite(difference)]
            squared = float(np.einsum("i,i->", difference, difference))
        total += squared / (max(difference.size, 1) * step**2)
    return math.sqrt(total)
