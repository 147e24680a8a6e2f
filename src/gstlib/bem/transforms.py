"""Fourier transforms of lines by SciPy, or by ducc0 if the extra ``fast`` is installed.

Both descend from pocketfft and agree up to rounding. ducc0, which is under the GPL, uses more of a
processor's vector units (benchmarks/README.md reports the gain).
"""

import functools
import importlib.util
from types import SimpleNamespace

import scipy

__all__ = ["from_waves", "from_waves_inplace", "to_waves", "to_waves_inplace"]

HAS_DUCC0 = importlib.util.find_spec("ducc0") is not None
if HAS_DUCC0:
    import ducc0


@functools.cache
def _pocketfft():
    """SciPy's transforms, with the arguments of ducc0. When first used: their import is slow."""
    try:
        # Not public, but the transforms of scipy.fft bit for bit. They write into a given array.
        # Without the copies, a path of loads takes a seventh less.
        from scipy.fft._pocketfft import pypocketfft
    except ImportError:  # a SciPy that has moved them
        return SimpleNamespace(r2c=_r2c, c2r=_c2r, c2c=_c2c)
    return pypocketfft


def _r2c(lines, axes, forward, norm, out, threads):
    out[:] = scipy.fft.rfft(lines)


def _c2r(waves, axes, length, forward, norm, out, threads):
    out[:] = scipy.fft.irfft(waves, length)


def _c2c(lines, axes, forward, norm, out, threads):
    transform = scipy.fft.fft if forward else scipy.fft.ifft
    return transform(lines, overwrite_x=True)


def _library():
    return ducc0.fft if HAS_DUCC0 else _pocketfft()


def to_waves(lines, out):
    """Waves (m, n // 2 + 1) of real lines (m, n)."""
    _library().r2c(lines, (1,), True, 0, out, 1)


def from_waves(waves, out):
    """Real lines (m, n), n even, of waves (m, n // 2 + 1)."""
    _library().c2r(waves, (1,), out.shape[1], False, 2, out, 1)


def to_waves_inplace(lines):
    """Waves of complex lines (m, n), which are overwritten."""
    return _library().c2c(lines, (1,), True, 0, lines, 1)


def from_waves_inplace(waves):
    """Complex lines of waves (m, n), which are overwritten."""
    return _library().c2c(waves, (1,), False, 2, waves, 1)
