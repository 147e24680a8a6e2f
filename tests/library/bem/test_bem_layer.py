"""A bonded layer: against elasticity solved anew, published stiffnesses, and its limits."""

import numpy as np
import pytest
from bem_reference import self_affine
from gstlib.bem import ContactInputError, HalfSpace, Layer, solve_contact

RIGID = 1e9  # MPa, of what is behind the layer


def compliance(wave, layer, young, poisson):
    """Displacement of a wave of pressure on a layer bonded to a half-space, plane strain (mm/MPa).

    From the equations of elasticity: the amplitudes of two growing and two falling waves in the
    layer, and of two falling ones behind it.
    """
    q, t = wave, layer.thickness

    def fields(z, sign, e, nu):
        """U, W, normal and shear stress of the solutions 1 and z, times exp(sign·q·z)."""
        shear, kappa = e / 2 / (1 + nu), 3 - 4 * nu
        lame = 2 * shear * nu / (1 - 2 * nu)
        rows = []
        for u, du, w, dw in ((1, 0, -sign, 0), (z, 1, -sign * z + kappa / q, -sign)):
            growth = np.exp(sign * q * z)
            u, du = u * growth, (du + sign * q * u) * growth
            w, dw = w * growth, (dw + sign * q * w) * growth
            rows.append((u, w, lame * (q * u + dw) + 2 * shear * dw, shear * (du - q * w)))
        return rows

    own, behind = (layer.young, layer.poisson), (young, poisson)
    top = fields(0.0, -1, *own) + fields(0.0, 1, *own)
    bottom = fields(t, -1, *own) + fields(t, 1, *own)
    below = fields(0.0, -1, *behind)
    matrix = np.zeros((6, 6))
    matrix[0, :4] = [row[2] for row in top]
    matrix[1, :4] = [row[3] for row in top]
    matrix[2:, :4] = np.transpose(bottom)
    matrix[2:, 4:] = -np.transpose(below)
    amplitudes = np.linalg.solve(matrix, [-1, 0, 0, 0, 0, 0])
    return sum(a * row[1] for a, row in zip(amplitudes, top, strict=False))


@pytest.mark.parametrize("poisson", [0.0, 0.3, 0.49])
@pytest.mark.parametrize("waves", [0.05, 0.5, 2.0, 6.0])
def test_the_stiffness_is_that_of_elasticity(poisson, waves):
    layer = Layer(20.0, poisson, 0.3)
    wave = waves / layer.thickness
    exact = 1 / compliance(wave, layer, 100 * RIGID, 0.2)
    assert float(layer.stiffness(wave)) == pytest.approx(exact, rel=1e-5)


@pytest.mark.parametrize("young", [20.0, 300.0, 2000.0])
def test_compliances_of_layer_and_stone_nearly_add(young):
    """Adding them neglects how the stone gives way under the layer: an error of 2 E_m/E at most."""
    layer, stone, poisson = Layer(young, 0.3, 0.3), 19500.0, 0.24
    for waves in (0.05, 0.5, 2.0, 6.0):
        wave = waves / layer.thickness
        added = 1 / float(layer.stiffness(wave)) + 2 * (1 - poisson**2) / stone / wave
        exact = compliance(wave, layer, stone, poisson)
        assert added == pytest.approx(exact, rel=2 * young / stone)


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


def test_thick_is_a_half_space_and_stiff_is_not_there():
    heights, spacing = self_affine(48, seed=4), 0.01
    thick = solve_contact(heights, spacing, RIGID, mean_pressure=1.0, layer=Layer(30.0, 0.3, 50.0))
    alone = solve_contact(heights, spacing, 30.0 / (1 - 0.3**2), mean_pressure=1.0)
    np.testing.assert_allclose(thick.pressure, alone.pressure, atol=2e-3 * alone.pressure.max())
    stiff = solve_contact(heights, spacing, 1e4, mean_pressure=9.0, layer=Layer(1e10, 0.3, 0.1))
    bare = solve_contact(heights, spacing, 1e4, mean_pressure=9.0)
    np.testing.assert_allclose(stiff.pressure, bare.pressure, atol=2e-5 * bare.pressure.max())


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
