"""Warnings about doubtful input. The result is right for the given values."""

import math
import warnings

import numpy as np

from .errors import ContactWarning

__all__ = ["FULL", "fitted_plane", "warn_of_doubts"]

# The rim is suspect if it carries more of the force than this, and than so many times its share of
# the area. At 256², rough surfaces without waves as long as the grid have 3 to 16 % at a few per
# cent of contact, if they are alone. Pieces of larger surfaces have 11 to 37 %, and a flat punch
# has 21 %.
_MUCH_ON_RIM, _TIMES_ITS_AREA = 0.15, 2.0
# Above this contact fraction heights hardly matter. Rough stones touch on a few per cent.
FULL = 0.95
# Slopes of half-spaces are far below this.
_STEEP = 1.0
# If a plane makes up so much of the heights' variance, a scan was not levelled.
_TILTED = 0.9
# Doubts look at so many lines each way, to cost next to nothing.
_SAMPLED = 64


def warn_of_doubts(state, problem):
    """Warn of a contact that its caller hardly intended, in functions that a user calls."""
    relief = problem.relief
    flat = not relief.min(where=relief > -math.inf, initial=0.0)
    if flat or not state.mean_pressure:
        return
    doubts = []
    rim = state.rim_fraction
    if rim > max(_MUCH_ON_RIM, _TIMES_ITS_AREA * state.rim_area):
        doubts.append(
            f"{rim:.0%} of the force acts on the outer three elements of the grid, too much if "
            "the surface continues there. Lower the heights by the displacement of the surrounding "
            "pressures, or let the surface repeat itself (periodic=True)"
        )
    if state.contact_fraction > FULL:
        doubts.append(
            f"{state.contact_fraction:.0%} of the surface touches: are heights and spacing in mm, "
            "and the modulus in MPa?"
        )
    every = max(1, *(n // _SAMPLED for n in relief.shape))
    slope = _rms_slope(relief, problem.half_space.spacing, every)
    if slope > _STEEP:
        doubts.append(
            f"the r.m.s. slope is {slope:.2g}, but half-spaces are valid only far below 1: are "
            "heights and spacing in mm?"
        )
    _, share = fitted_plane(relief[::every, ::every], problem.half_space.spacing)
    if share > _TILTED and not any(state.tilt):
        doubts.append(
            "the heights are almost an inclined plane, so one side carries the force. Level them, "
            "or let the body tilt under a force (`load_point`)"
        )
    for doubt in doubts:
        warnings.warn(doubt, ContactWarning, stacklevel=3)


def _rms_slope(heights, spacing, every):
    """R.m.s. slope of heights (mm), by differences between neighbours with a finite height.

    Along one line of `every` so many.
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


def fitted_plane(heights, spacing):
    """Slopes (y, x) of the plane through the heights (mm), −inf left out, and its share in them.

    The share is the fraction of the heights' variance.
    """
    rows, columns = np.nonzero(np.isfinite(heights))
    if not rows.size:
        return np.zeros(2), 0.0
    values = heights[rows, columns]
    values = values - values.mean()
    points = np.stack((rows * spacing[0], columns * spacing[1]))
    points -= points.mean(axis=1, keepdims=True)
    squares = np.einsum("in,jn->ij", points, points)
    right = np.einsum("in,n->i", points, values)
    slopes = np.linalg.lstsq(squares, right)[0]
    variance = float(np.einsum("n,n->", values, values))
    return slopes, float(slopes @ right) / variance if variance else 0.0
