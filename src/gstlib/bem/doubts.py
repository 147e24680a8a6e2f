"""Warnings about doubtful input. The result is right for the given values."""

import math
import warnings

import numpy as np

from .errors import ContactWarning

__all__ = ["FULL", "warn_of_doubts"]

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
    share = _share_of_plane(relief[::every, ::every], problem.half_space.spacing)
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
    total, (dy, dx) = 0.0, spacing
    for lines, step in ((heights.T[::every], dy), (heights[::every], dx)):
        with np.errstate(invalid="ignore"):  # −inf less −inf
            slopes = np.diff(lines) / step
        slopes = slopes[np.isfinite(slopes)]
        total += np.square(slopes).sum() / max(slopes.size, 1)
    return math.sqrt(total)


def _share_of_plane(heights, spacing):
    """Share of the variance of the heights (mm) in a plane through them, −inf left out."""
    there = np.isfinite(heights)
    values = heights[there] - heights[there].mean()
    points = np.argwhere(there) * spacing
    points -= points.mean(axis=0)
    slopes = np.linalg.lstsq(points, values)[0]
    left = values - points @ slopes
    variance = np.square(values).sum()
    return 1 - np.square(left).sum() / variance if variance else 0.0
