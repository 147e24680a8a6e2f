"""What can go wrong in a contact problem, as exceptions and warnings of one small tree."""

__all__ = [
    "ContactError",
    "ConvergenceError",
    "DomainTooSmallWarning",
    "InvalidContactInput",
    "UnreachableTargetError",
]


class ContactError(Exception):
    """Base of every error raised by :mod:`gstlib.bem`."""


class InvalidContactInput(ContactError, ValueError):  # noqa: N818 - names the thing, as ValueError
    """The problem as stated has no meaning: a wrong shape, NaN, a negative load and so on."""


class ConvergenceError(ContactError):
    """The solver stopped before the asked tolerance; no field is returned.

    Attributes
    ----------
    residual : float
        Largest violation of the contact conditions reached, divided by the largest rigid
        interpenetration.
    iterations : int
        Iterations spent on the finest grid.
    """

    def __init__(self, residual: float, tolerance: float, iterations: int):
        self.residual = residual
        self.iterations = iterations
        super().__init__(
            f"contact not converged: residual {residual:.3g} after {iterations} iterations, "
            f"tolerance {tolerance:.3g} asked. Raise max_iterations, ask a tolerance above the "
            "rounding floor of about 1e-12, or check the heights for spikes."
        )


class UnreachableTargetError(ContactError):
    """The target pressure lies beyond the displacement that the caller allows.

    Attributes
    ----------
    mean_pressure : float
        Mean pressure (MPa) reached at `displacement`.
    displacement : float
        The largest far-field displacement allowed (mm).
    """

    def __init__(self, target_pressure: float, mean_pressure: float, displacement: float):
        self.mean_pressure = mean_pressure
        self.displacement = displacement
        super().__init__(
            f"target pressure {target_pressure:.6g} MPa is not reached: at the largest allowed "
            f"displacement of {displacement:.6g} mm the mean pressure is {mean_pressure:.6g} MPa. "
            "Allow a larger displacement, or check the units of heights and target."
        )


class DomainTooSmallWarning(UserWarning):
    """Contact reaches the border of the grid: the surface beyond it would carry load too."""
