"""Accuracy of a pressure field, recomputed here: independent of every code that is measured.

The displacement is a plain zero-padded convolution with Love's kernel (Johnson, *Contact Mechanics*
(1985), eq. 3.25), by scipy.fft on twice the grid; on a periodic surface, each wave of the pressure
times 2/(E*|q|) (ch. 13.2). Nothing of gstlib is used.
"""

from typing import NamedTuple

import numpy as np
import scipy.fft


class Accuracy(NamedTuple):
    """How well one pressure field solves one contact problem.

    Attributes
    ----------
    gap_error : float
        The largest of abs(gap) where p > 0 and of −gap anywhere, over the r.m.s. height.
    force_error : float
        abs(mean pressure / asked − 1) under load control; NaN under displacement control.
    negative_pressure : float
        −min p over max p, or 0.
    contact_fraction : float
        Share of elements with p > 0.
    """

    gap_error: float
    force_error: float
    negative_pressure: float
    contact_fraction: float


def kernel(shape, spacing, modulus):
    """Displacement (mm) from 1 MPa on a square element, for offsets 0..ny−1 and 0..nx−1."""
    # corners of the elements, between which the potential of a corner differs
    b, a = (spacing * (np.arange(count + 1) - 0.5) for count in shape)
    b = b[:, None]
    corner = a * np.arcsinh(b / np.abs(a)) + b * np.arcsinh(a / np.abs(b))
    return np.diff(np.diff(corner, axis=0), axis=1) / (np.pi * modulus)


def displacement(pressure, spacing, modulus):
    """Displacement (mm) under a pressure (MPa), both (ny, nx)."""
    ny, nx = pressure.shape
    quadrant = kernel((ny + 1, nx + 1), spacing, modulus)
    # Wrapped: offset −i stands at 2·n − i. The offset n itself is never used.
    counts = np.arange(2 * ny), np.arange(2 * nx)
    offsets = (np.minimum(count, len(count) - count) for count in counts)
    wrapped = quadrant[np.ix_(*offsets)]
    padded = wrapped.shape
    spectrum = scipy.fft.rfft2(wrapped)
    spectrum *= scipy.fft.rfft2(pressure, padded)
    return scipy.fft.irfft2(spectrum, padded)[:ny, :nx]


def periodic_displacement(pressure, spacing, modulus):
    """Displacement (mm) from its mean under a pressure (MPa) that repeats itself, both (ny, nx)."""
    ny, nx = pressure.shape
    along_y = scipy.fft.fftfreq(ny, spacing)
    along_x = scipy.fft.rfftfreq(nx, spacing)
    wave_number = 2 * np.pi * np.hypot(along_y[:, None], along_x)
    wave_number[0, 0] = np.inf
    spectrum = scipy.fft.rfft2(pressure) * (2 / (modulus * wave_number))
    return scipy.fft.irfft2(spectrum, pressure.shape)


def evaluate(
    pressure, heights, spacing, modulus, *, load=None, far_field=None, periodic=False
):
    """Accuracy of a pressure under load control (`load`, MPa) or displacement control (mm).

    Under load control the displacement is not prescribed: the one that suits the field best is
    taken, which is the middle between the largest opening in contact and the least one anywhere.
    """
    pressure = np.asarray(pressure, dtype=float)
    if not np.isfinite(pressure).all():
        return Accuracy(np.inf, np.inf, np.inf, np.nan)
    sunk = periodic_displacement if periodic else displacement
    opening = sunk(pressure, spacing, modulus) + (heights.max() - heights)
    contact = pressure > 0
    largest = opening[contact].max() if contact.any() else opening.min()
    if far_field is None:
        far_field = (largest + opening.min()) / 2
    error = max(largest - far_field, far_field - opening.min())
    return Accuracy(
        gap_error=float(error / heights.std()),
        force_error=float(abs(pressure.mean() / (load or np.nan) - 1)),
        negative_pressure=float(
            max(0.0, -pressure.min()) / max(pressure.max(), 1e-300)
        ),
        contact_fraction=float(contact.mean()),
    )
