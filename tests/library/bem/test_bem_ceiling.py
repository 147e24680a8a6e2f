"""The cap on pressure, p ≤ H."""

import numpy as np
import pytest
from bem_reference import MODULUS, dense_matrix, self_affine
from gstlib.bem import solve_contact
from scipy.optimize import lsq_linear

SMALL = self_affine(20, seed=5, length=0.04, rms=0.002, roll_off=0.02)
SPACING = 0.002


@pytest.mark.parametrize("limit", [200.0, 500.0, 2000.0, np.inf])
def test_agrees_with_doubly_bounded_least_squares(limit):
    # min ½ pᵀKp − pᵀw is the least-squares problem of Bemporad & Paggi (2015): with K = LLᵀ,
    # min |Lᵀp − L⁻¹w|² over 0 ≤ p ≤ H.
    factor = np.linalg.cholesky(dense_matrix(SMALL.shape, SPACING))
    overlap = 0.004 - (SMALL.max() - SMALL.ravel())
    expected = lsq_linear(
        factor.T, np.linalg.solve(factor, overlap), (0, limit), method="bvls", tol=1e-14
    ).x
    settings = {"pressure_cap": limit, "tolerance": 1e-11}
    state = solve_contact(SMALL, SPACING, MODULUS, displacement=0.004, **settings)
    np.testing.assert_allclose(state.pressure.ravel(), expected, atol=1e-8 * expected.max())
    assert np.array_equal(state.contact.ravel(), expected > 1e-9 * expected.max())
    assert state.pressure.max() <= limit
    loaded = solve_contact(SMALL, SPACING, MODULUS, mean_pressure=state.mean_pressure, **settings)
    np.testing.assert_allclose(loaded.pressure, state.pressure, atol=1e-6 * expected.max())
    assert loaded.mean_pressure == pytest.approx(state.mean_pressure, rel=1e-12)


@pytest.mark.parametrize("mean_pressure", np.logspace(-2, 0, 8))
def test_converges_where_nearly_all_is_at_the_limit(mean_pressure):
    y, x = np.mgrid[:12, :19]
    heights = -0.01 * ((y - 6) ** 2 + (x - 9.5) ** 2)
    for excess in np.logspace(-4, -2, 12):
        limit = mean_pressure * (1 + excess)
        state = solve_contact(
            heights, 0.1, 1e3, mean_pressure=mean_pressure, pressure_cap=limit, tolerance=1e-9
        )
        assert state.residual <= 1e-9
        assert state.pressure.max() <= limit
        assert state.mean_pressure == pytest.approx(mean_pressure, rel=1e-12)
