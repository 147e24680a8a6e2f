"""How much wider the scores of chance are than those of shifts over a torus.

What leaves the patch at one edge comes in at the other, so that waves as long as the patch are
broken by the seam and agree less, in either direction, than they can where they lie. The variance
of the agreement of two unrelated fields follows from their autocorrelations (Clifford, Richardson
and Hémon 1989, Biometrics 45:123): taken without a seam and with it, they tell how much too narrow
the shifts' scores are.
"""

import numpy as np
import scipy.fft

__all__ = ["seam_factor"]

# ASSUME: autocorrelations are looked at up to half the patch's shorter side: few pairs of points
# are further apart, and their products are hardly known.
_FARTHEST = 0.5


def seam_factor(moved: np.ndarray, fixed: np.ndarray, valid: np.ndarray) -> float:
    """By what to stretch, about their mean, scores of `moved` shifted over a torus.

    Parameters
    ----------
    moved : (ny, nx) array_like
        What is shifted, known everywhere: a mask, or ranks.
    fixed, valid : (ny, nx) array_like of bool
        What it is compared with, and where that is known.

    Returns
    -------
    float
        Standard deviation of the sum of products without a seam over that with it; at least 1.
    """
    valid = np.asarray(valid, dtype=bool)
    moved, fixed = np.asarray(moved, dtype=float), np.asarray(fixed, dtype=float)
    if not valid.any():
        return 1.0
    moved = moved - moved.mean()
    fixed = np.where(valid, fixed - fixed[valid].mean(), 0)
    over_torus = scipy.fft.irfft2(
        np.conj(scipy.fft.rfft2(moved)) * scipy.fft.rfft2(fixed), moved.shape
    )
    shape = [2 * n for n in moved.shape]

    def lagged_sums(field: np.ndarray) -> np.ndarray:
        return scipy.fft.irfft2(np.abs(scipy.fft.rfft2(field, shape)) ** 2, shape)

    pairs = np.rint(lagged_sums(np.ones(moved.shape)))
    lag = np.hypot(*np.meshgrid(*(scipy.fft.fftfreq(n, 1 / n) for n in shape), indexing="ij"))
    near = lag <= _FARTHEST * min(moved.shape)
    variance = float((lagged_sums(moved)[near] / pairs[near] * lagged_sums(fixed)[near]).sum())
    spread = float(over_torus.std())
    return max(1.0, np.sqrt(max(variance, 0.0)) / spread) if spread > 0 else 1.0
