"""The errors of the contact solver, and the checks of its arguments."""

import math

import numpy as np

__all__ = [
    "ContactError",
    "ContactInputError",
    "ContactWarning",
    "ConvergenceError",
    "TippingError",
    "as_number",
    "checked_array",
    "checked_fraction",
    "checked_number",
    "checked_poisson",
    "checked_spacing",
    "checked_steps",
    "checked_tolerance",
]


class ContactError(Exception):
    """Base of every error raised by `gstlib.bem`.

    Examples
    --------
    >>> import numpy as np
    >>> import gstlib
    >>> try:
    ...     gstlib.solve_contact(np.zeros((4, 4)), 0.1, 1e4, mean_pressure=-1.0)
    ... except gstlib.ContactError as error:
    ...     print(error)
    mean_pressure must be finite and not negative (MPa), got -1.0
    """


class ContactInputError(ContactError, ValueError):
    """The problem is not valid: a wrong shape, NaN, a negative load and so on."""


class TippingError(ContactInputError):
    """A force acts through a point at which the contact cannot balance it."""


class ContactWarning(UserWarning):
    """The contact is right for the given values, but they are doubtful."""


class ConvergenceError(ContactError):
    """The solver stopped before the tolerance was met, and no field is returned.

    Examples
    --------
    No pressure in double precision has so small a residual:

    >>> import numpy as np
    >>> import gstlib
    >>> rough = 1e-3 * np.random.default_rng(0).standard_normal((8, 8))
    >>> try:
    ...     gstlib.solve_contact(rough, 0.01, 1e4, mean_pressure=500.0, tolerance=1e-20)
    ... except gstlib.ConvergenceError as error:
    ...     print("after 500 iterations" in str(error))
    True
    """


def as_number(name: str, value: object, unit: str) -> float:
    """Any number, NaN and infinity included."""
    try:
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise ContactInputError(
            f"{name} must be a number ({unit}), got {value!r}"
        ) from None


def checked_poisson(name: str, value: object) -> float:
    """Poisson's ratio, in (-1, 0.5]."""
    number = as_number(name, value, "dimensionless")
    if not -1 < number <= 0.5:
        raise ContactInputError(f"{name} must lie in (-1, 0.5], got {value}")
    return number


def checked_fraction(name: str, value: object) -> float:
    """A share, in [0, 1]."""
    number = as_number(name, value, "dimensionless")
    if not 0 <= number <= 1:
        raise ContactInputError(f"{name} must lie in [0, 1], got {value}")
    return number


def checked_number(
    name: str, value: object, unit: str, *, positive: bool = False
) -> float:
    """A finite number that is not negative or, if required, positive."""
    number = as_number(name, value, unit)
    if not 0 <= number < math.inf or (positive and number == 0):
        wanted = "positive and finite" if positive else "finite and not negative"
        raise ContactInputError(f"{name} must be {wanted} ({unit}), got {value}")
    return number


def checked_spacing(spacing: object) -> tuple[float, float]:
    """Sides (dy, dx) of an element (mm), both positive and finite; one number for a square."""
    sides = np.ravel(np.asarray(spacing, dtype=object))
    if sides.size not in (1, 2):
        raise ContactInputError(
            f"spacing must be one number or two, (dy, dx) (mm), got {spacing}"
        )
    dy, dx = (
        checked_number("spacing", side, "mm", positive=True)
        for side in np.broadcast_to(sides, 2)
    )
    return dy, dx


def checked_tolerance(tolerance: object) -> float:
    """Tolerance on the residual: below 1, which is the residual of no contact at all."""
    number = checked_number(
        "tolerance", tolerance, "relative to the displacement", positive=True
    )
    if not number < 1:
        raise ContactInputError(f"tolerance must be below 1, got {tolerance}")
    return number


def checked_steps(steps: object) -> int:
    """A number of steps, at least 1."""
    if not isinstance(steps, int | np.integer) or steps < 1:
        raise ContactInputError(
            f"steps must be an integer of at least 1, got {steps!r}"
        )
    return int(steps)


def checked_array(
    name: str, values, shape: tuple[int, int] | None = None, *, holes: bool = False
) -> np.ndarray:
    """An (ny, nx) array of finite real numbers, with the given shape if there is one.

    If `holes` is true, −inf may mark elements without surface, but not all of them.
    """
    if np.ma.is_masked(values) or np.iscomplexobj(values):
        kind = "complex" if np.iscomplexobj(values) else "masked"
        raise ContactInputError(
            f"{name} has {kind} values: give finite real numbers everywhere"
        )
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise ContactInputError(
            f"{name} must be an array of numbers: {error}"
        ) from None
    if array.ndim != 2 or array.size == 0:
        raise ContactInputError(
            f"{name} must be a (ny, nx) array, got shape {array.shape}"
        )
    if shape is not None and array.shape != shape:
        raise ContactInputError(f"{name} has shape {array.shape}, the surface {shape}")
    missing = holes & np.isneginf(array)
    bad = np.count_nonzero(~(np.isfinite(array) | missing))
    if bad:
        raise ContactInputError(
            f"{name} has {bad} values that are NaN or infinite: fill unmeasured points first"
        )
    if missing.all():
        raise ContactInputError(
            f"{name} are −inf everywhere: there is no surface to touch"
        )
    return array
