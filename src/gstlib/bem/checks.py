"""Checks of what callers pass in: one place for each quantity, one wording for each fault."""

import math

import numpy as np

from .errors import InvalidContactInput

__all__ = [
    "checked_heights",
    "checked_level",
    "checked_limit",
    "checked_modulus",
    "checked_spacing",
    "checked_tolerance",
    "checked_workers",
]


def checked_spacing(spacing) -> tuple[float, float]:
    """Sides (dy, dx) of an element (mm), from one number or two; both positive and finite."""
    try:
        sides = tuple(float(s) for s in np.broadcast_to(spacing, 2))
    except (TypeError, ValueError):
        raise InvalidContactInput(
            f"spacing must be a number or (dy, dx) in mm, got {spacing!r}"
        ) from None
    if not all(0 < side < math.inf for side in sides):
        raise InvalidContactInput(f"spacing must be positive and finite (mm), got {spacing}")
    return sides


def checked_modulus(contact_modulus) -> float:
    """Contact modulus (MPa): positive and finite."""
    modulus = _number("contact_modulus", contact_modulus, "MPa")
    if not 0 < modulus < math.inf:
        raise InvalidContactInput(
            f"contact_modulus must be positive and finite (MPa), got {contact_modulus}"
        )
    return modulus


def checked_workers(workers) -> int:
    """Number of threads: an integer of at least 1."""
    if not isinstance(workers, (int, np.integer)) or workers < 1:
        raise InvalidContactInput(f"workers must be an integer of at least 1, got {workers!r}")
    return int(workers)


def checked_tolerance(tolerance) -> float:
    """Tolerance on the residual: positive, and below that of no contact at all."""
    number = _number("tolerance", tolerance, "relative to the displacement")
    if not 0 < number < 1:
        raise InvalidContactInput(f"tolerance must be positive and below 1, got {tolerance}")
    return number


def checked_level(name: str, value, unit: str) -> float:
    """A displacement or a pressure: finite and not negative."""
    number = _number(name, value, unit)
    if not 0 <= number < math.inf:
        raise InvalidContactInput(f"{name} must be finite and not negative ({unit}), got {value}")
    return number


def checked_limit(pressure_limit) -> float:
    """Ceiling on the pressure (MPa): positive, infinite for none."""
    limit = _number("pressure_limit", pressure_limit, "MPa")
    if not limit > 0:
        raise InvalidContactInput(f"pressure_limit must be positive (MPa), got {pressure_limit}")
    return limit


def checked_heights(heights) -> np.ndarray:
    """Heights as an (ny, nx) float array without a hole."""
    try:
        array = np.asarray(heights, dtype=float)
    except (TypeError, ValueError) as error:
        raise InvalidContactInput(f"heights are not an array of numbers: {error}") from None
    if array.ndim != 2 or array.size == 0:
        raise InvalidContactInput(f"heights must be a (ny, nx) array, got shape {array.shape}")
    bad = np.count_nonzero(~np.isfinite(array))
    if bad:
        raise InvalidContactInput(
            f"heights hold {bad} values that are NaN or infinite: fill unmeasured points first"
        )
    return array


def _number(name, value, unit):
    try:
        return float(value)
    except (TypeError, ValueError):
        raise InvalidContactInput(f"{name} must be a number ({unit}), got {value!r}") from None
