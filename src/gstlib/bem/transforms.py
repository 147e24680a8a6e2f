"""Fourier transforms of lines by SciPy, or by ducc0 if the extra ``fast`` is installed.

Both descend from pocketfft and agree up to rounding. ducc0, which is under the GPL, uses more of a
processor's vector units (benchmarks/README.md reports the gain).
"""

import functools
import importlib.util

import numpy as np
import scipy

__all__ = ["from_waves", "from_waves_inplace", "to_waves", "to_waves_inplace"]

HAS_DUCC0 = importlib.util.find_spec("ducc0") is not None
if HAS_DUCC0:
    import ducc0


@functools.cache
def _pocketfft():
    """SciPy's real transforms, forth and back. When first used: their import is slow."""
    try:
        # Not public, but the transforms of scipy.fft bit for bit. They write into a given array.
        # Without the copies, a path of loads takes a seventh less.
        from scipy.fft._pocketfft.pypocketfft import c2r, r2c
    except ImportError:  # a SciPy that has moved them

        def r2c(lines, axes, forward, inorm, out, workers):
            """Real transforms."""
            out[:] = scipy.fft.rfft(lines)

        def c2r(waves, axes, lastsize, forward, inorm, out, workers):
            """Real transforms backwards."""
            out[:] = scipy.fft.irfft(waves, lastsize)

    return r2c, c2r


def to_waves(lines: np.ndarray, out: np.ndarray) -> None:
    """Waves (m, n // 2 + 1) of real lines (m, n)."""
    if HAS_DUCC0:
        ducc0.fft.r2c(lines, axes=(1,), out=out)
    else:
        _pocketfft()[0](lines, (1,), True, 0, out, 1)


def from_waves(waves: np.ndarray, out: np.ndarray) -> None:
    """Real lines (m, n), n even, of waves (m, n // 2 + 1)."""
    if HAS_DUCC0:
        length = out.shape[1]
        ducc0.fft.c2r(
            waves, axes=(1,), lastsize=length, forward=False, inorm=2, out=out
        )
    else:
        _pocketfft()[1](waves, (1,), out.shape[1], False, 2, out, 1)


def to_waves_inplace(lines: np.ndarray) -> np.ndarray:
    """Waves of complex lines (m, n), which are overwritten."""
    if HAS_DUCC0:
        return ducc0.fft.c2c(lines, axes=(1,), out=lines)
    return scipy.fft.fft(lines, overwrite_x=True)


def from_waves_inplace(waves: np.ndarray) -> np.ndarray:
    """Complex lines of waves (m, n), which are overwritten."""
    if HAS_DUCC0:
        return ducc0.fft.c2c(waves, axes=(1,), forward=False, inorm=2, out=waves)
    return scipy.fft.ifft(waves, overwrite_x=True)
