"""Detection of a form, such as a polynomial, that was removed from one of two scans of a patch.

Software of instruments removes it to show the texture. If it is removed from T1 and not from T0,
the missing long waves look like wear. If it is removed from both, wear in long waves is lost, and
two scans cannot show this.
"""

import numpy as np
import xarray as xr
from numpy.polynomial.legendre import legvander2d

__all__ = ["form_height", "form_warning"]

_DEGREE = 4  # of what counts as form
_POINTS = 64  # along a side, which these waves do not need more of
# ASSUME: Removed form. Form was removed from a scan if it is less than a fifth as high as in the
# other scan, although the textures differ by less than a factor of two. Reason: In 400 pairs of
# synthetic stones, T1 had 0.38 to 1.4 times the form of T0. These stones were worn by nine tenths
# above their upper third and displaced by up to 40 of 128 elements. In the default study, T1 had
# 0.86 to 1.8 times the form of T0. Without a polynomial of degree 8, it had at most 0.1 times as
# much.
_MISSING = 0.2
_SAME_TEXTURE = 0.5


def form_height(height: xr.DataArray) -> tuple[float, float]:
    """R.m.s. heights (mm) of the polynomial of degree 4 without its plane, and of the remainder."""
    every = max(1, min(height.shape) // _POINTS)
    thinned = height.values[::every, ::every]
    along = [np.linspace(-1, 1, count) for count in thinned.shape]
    y, x = np.meshgrid(*along, indexing="ij")
    degrees = np.arange(_DEGREE + 1)
    degree = np.add.outer(degrees, degrees).ravel()
    is_used = degree <= _DEGREE
    every_power = legvander2d(y.ravel(), x.ravel(), [_DEGREE, _DEGREE])
    powers = every_power[:, is_used]
    is_form = degree[is_used] > 1
    heights = thinned.ravel()
    factors, *_ = np.linalg.lstsq(powers, heights, rcond=None)
    form = powers[:, is_form] @ factors[is_form]
    texture = heights - powers @ factors
    return float(form.std()), float(texture.std())


def form_warning(t0: xr.DataArray, t1: xr.DataArray) -> str | None:
    """A warning if the form of one of two level scans (mm) is missing in the other."""
    forms, textures = zip(*map(form_height, (t0, t1)), strict=True)
    is_alike = min(textures) >= _SAME_TEXTURE * max(textures)
    is_missing = min(forms) < _MISSING * max(forms)
    if not (is_alike and is_missing):
        return None
    lower, higher = ("T1", "T0") if forms[1] < forms[0] else ("T0", "T1")
    return (
        f"long waves of {lower} are {1e3 * min(forms):.2g} µm high (r.m.s.), and in {higher} "
        f"{1e3 * max(forms):.2g} µm, as if a form had been removed from {lower} alone. This would "
        "look like wear. Export both scans with at most a plane removed"
    )
