import numpy as np
import pytest
from bem_reference import MODULUS, dense_matrix, self_affine

from gstlib.bem import HalfSpace, solve_contact
from gstlib.bem.preconditioner import Preconditioner
from gstlib.bem.window import Window

pytestmark = pytest.mark.filterwarnings("ignore::gstlib.bem.DomainTooSmallWarning")


def prepared(contact, spacing):
    window = Window(HalfSpace(contact.shape, spacing, MODULUS), np.flatnonzero(contact))
    preconditioner = Preconditioner(window)
    preconditioner.fit(np.ones(np.count_nonzero(contact), bool))
    return preconditioner


@pytest.mark.parametrize(("seed", "mean_pressure"), [(1, 20.0), (2, 60.0), (3, 200.0), (4, 1000.0)])
def test_on_islands_it_is_definite_and_better_than_the_short_range_alone(seed, mean_pressure):
    n = 64
    heights = self_affine(n, seed=seed, roll_off=0.1)
    contact = solve_contact(heights, 0.85 / n, MODULUS, mean_pressure=mean_pressure).contact
    matrix = dense_matrix(contact.shape, 0.85 / n)[np.ix_(contact.ravel(), contact.ravel())]
    preconditioner = prepared(contact, 0.85 / n)
    units = np.eye(len(matrix))
    full = np.array([preconditioner(unit) for unit in units])
    short = np.array([preconditioner.short_range(unit) for unit in units])
    np.testing.assert_allclose(full, full.T, atol=1e-6 * full.max())
    conditions = []
    for inverse in (full, short):
        factor = np.linalg.cholesky(0.5 * (inverse + inverse.T))  # raises if not definite
        eigenvalues = np.linalg.eigvalsh(factor.T @ matrix @ factor)
        conditions.append(eigenvalues.max() / eigenvalues.min())
    assert conditions[0] < 0.7 * conditions[1]
    assert conditions[0] < 8


def test_uniform_is_its_answer_to_a_uniform_displacement():
    contact = np.random.default_rng(3).random((50, 40)) < 0.3
    preconditioner = prepared(contact, 0.01)
    answer = preconditioner(np.ones(np.count_nonzero(contact)))
    np.testing.assert_allclose(preconditioner.uniform, answer, rtol=1e-5)


def test_a_nearly_equal_set_is_not_prepared_again():
    contact = np.ones((30, 30), bool)
    preconditioner = prepared(contact, 0.01)
    before = preconditioner.uniform
    free = np.ones(900, bool)
    free[:40] = False
    preconditioner.fit(free)
    assert preconditioner.uniform is before
    free[:60] = False
    preconditioner.fit(free)
    assert preconditioner.uniform is not before
    assert np.all(preconditioner.uniform[:60] == 0)
