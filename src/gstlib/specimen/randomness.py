"""Independent random streams, one for each thing, and smooth random fields.

Fields are made in double precision and rounded to single once: what processors and libraries differ
by, in the last bit of a power or a transform, is thereby gone, and the specimen is the same on all.
"""

import zlib

import numpy as np
import scipy.fft

__all__ = ["self_affine_field", "smooth_field", "stream"]


def stream(seed: int, *names: str) -> np.random.Generator:
    """The generator of the thing called `names`, independent of those of other things.

    Streams are told apart by name, not by order of use: another patch in the table changes nothing
    about the surface or about the patches that were there.
    """
    key = tuple(zlib.crc32(name.encode("utf-8")) for name in names)
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=key)))


def _radial_frequency(count: int, spacing: float) -> np.ndarray:
    """Spatial frequency, 1/length, of every term of a real 2-D FFT of `count`² points."""
    along_y, along_x = scipy.fft.fftfreq(count, spacing), scipy.fft.rfftfreq(count, spacing)
    return np.hypot(along_y[:, None], along_x[None, :])


def self_affine_field(
    generator: np.random.Generator,
    count: int,
    spacing: float,
    *,
    hurst_exponent: float,
    roll_off: float,
    longest: float = np.inf,
    shortest: float = 0.0,
) -> np.ndarray:
    """A periodic Gaussian field with a self-affine spectrum, in a band of wavelengths.

    The two-dimensional power spectral density is C (f/f_r)^(-2-2H) above the roll-off frequency
    f_r = 1/`roll_off` and C below it, with C = `roll_off`²; zero outside the band. C does not
    depend on count and spacing, so that fields of different grids and bands add up to one spectrum.

    Parameters
    ----------
    generator : numpy.random.Generator
    count : int
        Points along each side.
    spacing : float
        Distance of points; the unit of length of `roll_off`, `longest` and `shortest`.
    hurst_exponent : float
    roll_off, longest, shortest : float
        Wavelengths. The band is ``shortest <= wavelength < longest``.

    Returns
    -------
    (count, count) ndarray of float32
        Heights in a unit in which the density at roll-off is `roll_off`².
    """
    # white noise of unit variance has the density spacing²
    spectrum = scipy.fft.rfft2(_white_noise(generator, count))
    frequency = _radial_frequency(count, spacing)
    outside = frequency <= 1 / longest
    if shortest > 0:
        outside |= frequency > 1 / shortest
    spectrum *= np.maximum(frequency * roll_off, 1) ** (-1 - hurst_exponent)
    spectrum *= roll_off / spacing
    spectrum[outside] = 0
    return scipy.fft.irfft2(spectrum, s=(count, count), overwrite_x=True).astype(np.float32)


def smooth_field(
    generator: np.random.Generator, count: int, spacing: float, length: float
) -> np.ndarray:
    """A periodic Gaussian field, mean 0 and variance 1, smooth over about `length`.

    Parameters
    ----------
    generator : numpy.random.Generator
    count : int
        Points along each side.
    spacing, length : float
        Distance of points and correlation length, in one unit.

    Returns
    -------
    (count, count) ndarray of float32
    """
    spectrum = scipy.fft.rfft2(_white_noise(generator, count))
    frequency = _radial_frequency(count, spacing)
    spectrum *= np.exp(-((np.pi * length / 2 * frequency) ** 2))
    field = scipy.fft.irfft2(spectrum, s=(count, count), overwrite_x=True)
    field -= field.mean()
    deviation = field.std()
    return (field / deviation if deviation > 0 else field).astype(np.float32)


def _white_noise(generator: np.random.Generator, count: int) -> np.ndarray:
    """Drawn in single precision, in half the time."""
    return generator.standard_normal((count, count), dtype=np.float32).astype(float)
