"""The cap on pressure, p ≤ H."""

import numpy as np
import pytest
from bem_reference import MODULUS, dense_matrix, self_affine
from scipy.optimize import lsq_linear

from gstlib.bem import solve_contact

SMALL = self_affine(14, seed=5, length=0.028, rms=0.002, roll_off=0.02)
SPACING = 0.002


@pytest.mark.parametrize("limit", [200.0, 2000.0])
def test_agrees_with_doubly_bounded_least_squares(limit):
    # min ½ pᵀKp − pᵀw is the least-squares problem of Bemporad & Paggi (2015): with K = LLᵀ,
    # min |Lᵀp − L⁻¹w|² over 0 ≤ p ≤ H.
    factor = np.linalg.cholesky(dense_matrix(SMALL.shape, SPACING))
    overlap = 0.004 - (SMALL.max() - SMALL.ravel())
    right = np.linalg.solve(factor, overlap)
    bounded = lsq_linear(factor.T, right, (0, limit), method="bvls", tol=1e-14)
    expected = bounded.x.reshape(SMALL.shape)
    peak = expected.max()
    options = {"pressure_cap": limit, "tolerance": 1e-11}
    state = solve_contact(SMALL, SPACING, MODULUS, displacement=0.004, **options)
    np.testing.assert_allclose(state.pressure, expected, atol=1e-8 * peak)
    assert state.pressure.max() <= limit


@pytest.mark.parametrize("excess", np.logspace(-4, -2, 6))
def test_converges_where_nearly_all_is_at_the_limit(excess):
    y, x = np.mgrid[:12, :19]
    heights = -0.01 * ((y - 6) ** 2 + (x - 9.5) ** 2)
    for mean in (0.01, 0.1, 1.0):
        load = {"mean_pressure": mean, "pressure_cap": mean * (1 + excess)}
        state = solve_contact(heights, 0.1, 1e3, tolerance=1e-9, **load)
        assert state.residual <= 1e-9
        assert state.pressure.max() <= load["pressure_cap"]
        assert state.mean_pressure == pytest.approx(mean, rel=1e-12)
