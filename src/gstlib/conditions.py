"""What a study is given: elastic constants and load, as its config has them."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from gstlib.bem import contact_modulus

__all__ = ["load_force", "load_point", "study_modulus", "study_poisson"]


def study_modulus(material: Mapping) -> float:
    """The contact modulus (MPa) of the config's section ``material``: as given, or computed."""
    if (given := material["contact_modulus_MPa"]) is not None:
        return float(given)
    names = ("young_1_MPa", "poisson_1", "young_2_MPa", "poisson_2")
    return contact_modulus(*(material[name] for name in names))


def study_poisson(material: Mapping) -> float:
    """Poisson's ratio of two like stones as compliant tangentially as the study's two are.

    The mean of both ratios weighted by the stones' shear compliance 1/G = 2 (1 + ν)/E: with it,
    (2 − ν)/(2 (1 − ν)) is the sum of (2 − ν)/(4G) over the sum of (1 − ν)/(2G), tangential over
    normal compliance (Johnson, Contact Mechanics, §7.2).
    """
    # ASSUME: where the two tools differ, their tangential compliances add; Dundurs' β, by which
    # tangential tractions press unlike bodies apart, is neglected.
    poisson = [material["poisson_1"], material["poisson_2"]]
    young = [material["young_1_MPa"], material["young_2_MPa"]]
    weights = [(1 + ratio) / modulus for ratio, modulus in zip(poisson, young, strict=True)]
    return float(np.average(poisson, weights=weights))


def load_force(load: Mapping[str, Any], size_mm: float) -> float:
    """The force (N) of the section ``load`` of the config, on a square of this side."""
    if (force := load["force_N"]) is not None:
        return float(force)
    return float(load["pressure_MPa"]) * size_mm**2


def load_point(load: Mapping[str, Any], size_mm: float) -> tuple[float, float]:
    """Where (y, x), mm, the force acts: where the section says, or in the middle of the square."""
    x, y = load["at_mm"] or 2 * [size_mm / 2]
    return float(y), float(x)
