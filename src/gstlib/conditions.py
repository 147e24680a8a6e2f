"""The conditions of a study: elastic constants, load, and the law of wear."""

# ASSUME: Scale of other laws of wear. A threshold and an exponent act on the mean pressure of a
# patch. Inside a patch, the loss stays proportional to pressure. Reason: Losses are compared and
# experiments report pressures at this scale. Pressures of summits reach the strength of the rock
# and depend on the resolution.

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from gstlib.bem.halfspace import contact_modulus

__all__ = [
    "ARCHARD",
    "Law",
    "load_force",
    "resolved_load_point",
    "rounded_form",
    "study_modulus",
    "study_poisson",
    "study_radius",
]


class Law(NamedTuple):
    """How the loss of a patch grows with its pressure: as a power of the excess over a threshold.

    Attributes
    ----------
    threshold_MPa : float or (draws, 1) ndarray
        Pressure up to which a patch does not wear.
    exponent : float or (draws, 1) ndarray
        With 0, every patch above the threshold loses as much.
    """

    threshold_MPa: float | np.ndarray = 0.0
    exponent: float | np.ndarray = 1.0

    @property
    def is_archard(self) -> bool:
        """Whether the loss is in proportion to pressure."""
        return (
            np.ndim(self.threshold_MPa) == np.ndim(self.exponent) == 0 and self == Law()
        )

    def rate(self, pressure: Any) -> Any:
        """Loss at each pressure (MPa), up to a coefficient."""
        if self.is_archard:
            return pressure
        excess = np.maximum(np.asarray(pressure) - self.threshold_MPa, 0.0)
        return np.where(excess > 0, excess**self.exponent, 0.0)

    def equivalent(self, pressure: Any, before: Any = None) -> Any:
        """Pressures (MPa) at which Archard's law would remove as much.

        The mean over the patches, which are the last axis, is kept at the pressures `before` use.
        These are by default the pressures themselves. A wear coefficient therefore keeps its unit.

        Examples
        --------
        >>> Law(exponent=2.0).equivalent([1.0, 3.0])
        array([0.4, 3.6])
        """
        if self.is_archard:
            return pressure
        start = np.asarray(pressure if before is None else before)
        rates = self.rate(start).sum(axis=-1, keepdims=True)
        scale = start.sum(axis=-1, keepdims=True) / np.where(rates > 0, rates, np.inf)
        return scale * self.rate(pressure)


ARCHARD = Law()


def study_modulus(material: Mapping) -> float:
    """The contact modulus (MPa) of the config's section ``material``: as given, or computed."""
    if (modulus := material["contact_modulus_MPa"]) is not None:
        return float(modulus)
    names = ("young_1_MPa", "poisson_1", "young_2_MPa", "poisson_2")
    return contact_modulus(*(material[name] for name in names))


def study_poisson(material: Mapping) -> float:
    """Poisson's ratio of two like stones as compliant tangentially as the study's two are.

    The mean of both ratios is weighted by the stones' shear compliance 1/G = 2 (1 + ν)/E. The ratio
    of tangential to normal compliance is then (2 − ν)/(2 (1 − ν)). It equals the ratio of the
    sums of (2 − ν)/(4G) and of (1 − ν)/(2G) (Johnson, Contact Mechanics, §7.2).
    """
    # ASSUME: Tangential compliance of different stones. If the two stones differ, their tangential
    # compliances add. Dundurs' β, by which tangential tractions press unlike bodies apart, is
    # neglected. Reason: Normal and tangential contact can then be solved separately.
    poisson = np.array([material["poisson_1"], material["poisson_2"]])
    young = np.array([material["young_1_MPa"], material["young_2_MPa"]])
    return float(np.average(poisson, weights=(1 + poisson) / young))


def load_force(load: Mapping[str, Any], size_mm: float) -> float:
    """The force (N) of the section ``load`` of the config, on a square of this side."""
    if (force := load["force_N"]) is not None:
        return float(force)
    return float(load["pressure_MPa"]) * size_mm**2


def resolved_load_point(load: Mapping[str, Any], size_mm: float) -> tuple[float, float]:
    """The load point (y, x), mm: as in the section, or the middle of the square."""
    x, y = load["at_mm"] or 2 * [size_mm / 2]
    return float(y), float(x)


def rounded_form(
    config: Mapping[str, Any],
) -> tuple[float | Sequence[float] | None, float]:
    """Arguments of `gstlib.macroscale.active_tool.RoundedTool`. The paper's tool is a flat."""
    counterface = config["counterface"] or {}
    if config["coupling"] != "equilibrium":
        counterface = {}
    return counterface.get("radius_mm"), counterface.get("angle_deg", 0.0)


def study_radius(config: Mapping[str, Any]) -> float | None:
    """Radius of the active tool, mm; the geometric mean of two radii; None for a flat."""
    radius_mm, _ = rounded_form(config)
    if isinstance(radius_mm, Sequence):
        return float(np.sqrt(np.prod(radius_mm)))
    return radius_mm
