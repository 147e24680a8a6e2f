"""A bonded layer: against elasticity solved anew, published stiffnesses, and its limits."""

import numpy as np
import pytest
from bem_reference import self_affine
from gstlib.bem import ContactInputError, HalfSpace, Layer, solve_contact

RIGID = 1e9  # MPa, of what is behind the layer


@pytest.mark.parametrize("spacing", [0.02, 0.1, 0.5])
def test_the_kernel_sums_to_the_stiffness(spacing):
    """Under a uniform pressure far around, the layer is a bed of springs."""
    layer = Layer(20.0, 0.3, 0.1)
    count = int(layer.reach / spacing) + 3
    quadrant = layer.kernel((count, count), (spacing, spacing))
    total = 4 * quadrant[1:, 1:].sum() + 4 * quadrant[0, 1:].sum() + quadrant[0, 0]
    assert total == pytest.approx(1 / float(layer.stiffness(1e-6)), rel=1e-4)


# W. C. Hayes, L. M. Keer, G. Herrmann & L. F. Mockros, J. Biomech. 5 (1972) 541: force on a flat
# round punch of radius a over that on a half-space, by Poisson's ratio and a/t.
PUNCH = {(0.3, 0.2): 1.207, (0.3, 2.0): 4.335, (0.4, 1.0): 2.789, (0.5, 1.0): 3.609}


@pytest.mark.parametrize(("poisson", "ratio"), PUNCH)
def test_a_flat_punch_meets_the_published_stiffness(poisson, ratio):
    n, radius, depth = 64, 1.0, 1e-3
    layer, side = Layer(10.0, poisson, radius / ratio), 2.2 * radius / n
    at = (np.arange(n) - (n - 1) / 2) * side
    flat = np.where(np.hypot(at[:, None], at) < radius, 0.0, -10.0)
    state = solve_contact(flat, side, RIGID, displacement=depth, layer=layer)
    equal = np.sqrt(state.contact_fraction / np.pi) * n * side  # a disc as large as its elements
    force = state.pressure.sum() * side**2
    assert force / (2 * equal * layer.modulus * depth) == pytest.approx(
        PUNCH[poisson, ratio], rel=0.01
    )


def test_a_rough_contact_through_a_layer_is_certified_by_the_convolution():
    heights, spacing, layer = self_affine(96, seed=5), 0.01, Layer(300.0, 0.3, 0.05)
    state = solve_contact(heights, spacing, 1e4, mean_pressure=5.0, layer=layer, tolerance=1e-9)
    gap = HalfSpace(heights.shape, spacing, 1e4, layer=layer).displacement(state.pressure)
    gap += heights.max() - heights - state.displacement
    assert np.abs(gap[state.contact]).max() < 1e-9 * state.displacement
    assert gap.min() > -1e-9 * state.displacement
    bare = solve_contact(heights, spacing, 1e4, mean_pressure=5.0)
    assert state.contact_fraction > 2 * bare.contact_fraction


@pytest.mark.parametrize("wrong", [(0.0, 0.3, 0.1), (20.0, 0.6, 0.1), (20.0, 0.3, -1.0)])
def test_impossible_layers_are_refused(wrong):
    with pytest.raises(ContactInputError):
        Layer(*wrong)
