"""A bonded layer: against elasticity solved anew, published stiffnesses, and its limits."""

import math

import numpy as np
import pytest
from bem_reference import centred

from gstlib.bem import ContactInputError, Layer, solve_contact

RIGID = 1e9  # MPa, of what is behind the layer


@pytest.mark.parametrize("spacing", [0.02, 0.5])
def test_the_kernel_sums_to_the_stiffness(spacing):
    """Under a uniform pressure far around, the layer is a bed of springs."""
    layer = Layer(20.0, 0.3, 0.1)
    count = int(layer.reach / spacing) + 3
    quadrant = layer.kernel((count, count), (spacing, spacing))
    on_axis = quadrant[0, 1:].sum()
    beside = quadrant[1:, 1:].sum()
    total = quadrant[0, 0] + 4 * on_axis + 4 * beside
    assert total == pytest.approx(1 / float(layer.stiffness(1e-6)), rel=1e-4)


# W. C. Hayes, L. M. Keer, G. Herrmann & L. F. Mockros, J. Biomech. 5 (1972) 541: force on a flat
# round punch of radius a over that on a half-space, by Poisson's ratio and a/t.
PUNCH = {(0.3, 2.0): 4.335, (0.5, 1.0): 3.609}


@pytest.mark.parametrize(("poisson", "ratio"), PUNCH)
def test_a_flat_punch_meets_the_published_stiffness(poisson, ratio):
    n, radius, depth = 64, 1.0, 1e-3
    layer = Layer(10.0, poisson, radius / ratio)
    side = 2.2 * radius / n
    flat = np.where(np.hypot(*centred(n, side)) < radius, 0.0, -10.0)
    state = solve_contact(flat, side, RIGID, displacement=depth, layer=layer)
    area = state.contact.sum() * side**2
    equal = math.sqrt(area / math.pi)  # radius of a disc as large as its elements
    force = state.pressure.sum() * side**2
    stiffness = force / (2 * equal * layer.modulus * depth)
    assert stiffness == pytest.approx(PUNCH[poisson, ratio], rel=0.01)


def test_an_element_too_long_for_the_layer_is_refused():
    layer = Layer(20.0, 0.3, 1e-3)
    with pytest.raises(ContactInputError, match="too thin for elements"):
        solve_contact(np.eye(4), 0.05, RIGID, mean_pressure=1.0, layer=layer)
