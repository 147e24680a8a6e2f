"""A rough surface in numbers, each by its definition::

    r.m.s. height      √⟨(h − ⟨h⟩)²⟩
    r.m.s. slope       √⟨|∇h|²⟩
    r.m.s. curvature   √⟨(∇²h/2)²⟩, of the mean curvature
    Nayak's α          m₀ m₄/m₂² with m₀ = ⟨h²⟩, m₂ = ⟨|∇h|²⟩/2, m₄ = 3⟨(∇²h)²⟩/8

m₂ and m₄ are the second and fourth moments of a profile's spectrum, averaged over all directions
(M. S. Longuet-Higgins, Phil. Trans. A 249 (1957) 321; P. R. Nayak, J. Lubr. Technol. 93 (1971)
398). α is at least 1.5, and grows with the width of the spectrum. Derivatives of a periodic surface
are computed from its waves, others as differences between neighbours.
"""

import math
from dataclasses import dataclass

import numpy as np

from .fields import as_given

__all__ = ["Roughness", "measure_roughness", "slope_of"]


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
        y, x = (
            2 * math.pi * np.fft.fftfreq(n, step)
            for n, step in zip(heights.shape, (dy, dx), strict=True)
        )
        squared = np.add.outer(y**2, x**2)
        height, slope, laplacian = (
            math.sqrt((squared**power * waves).sum()) for power in range(3)
        )
        return Roughness(height, slope, laplacian / 2)
    measured = np.where(np.isfinite(heights), heights, math.nan)
    along_y = np.diff(measured, 2, axis=0)[:, 1:-1] / dy**2
    along_x = np.diff(measured, 2, axis=1)[1:-1] / dx**2
    curvature = math.sqrt(np.nanmean((along_y + along_x) ** 2)) / 2
    return Roughness(float(np.nanstd(measured)), slope_of(heights, (dy, dx)), curvature)


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
        difference = difference[np.isfinite(difference)]
        squared = float(np.einsum("i,i->", difference, difference))
        total += squared / (max(difference.size, 1) * step**2)
    return math.sqrt(total)
