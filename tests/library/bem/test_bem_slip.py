import numpy as np
import pytest
from bem_reference import MODULUS, self_affine, sphere

from gstlib.bem import InvalidContactInput, solve_contact
from gstlib.bem.analytic import MindlinSphere, Sphere
from gstlib.bem.slip import solve_slip

pytestmark = pytest.mark.filterwarnings("ignore::gstlib.bem.DomainTooSmallWarning")

ROUGH = self_affine(64, seed=7)
SPACING = 0.85 / 64


def slip_of(heights, spacing, mean_pressure, **arguments):
    normal = solve_contact(heights, spacing, MODULUS, mean_pressure=mean_pressure, tolerance=1e-9)
    options = {"friction": 0.5, "tangential_ratio": 0.6, "poisson": 0.24, "tolerance": 1e-9}
    return solve_slip(heights, spacing, MODULUS, normal=normal, **(options | arguments))


@pytest.mark.parametrize("ratio", [0.3, 0.8])
def test_sphere_against_cattaneo_and_mindlin(ratio):
    normal = Sphere(20.0, 10.0, MODULUS)
    exact = MindlinSphere(normal, 0.4, ratio * 0.4 * 20.0, 0.24)
    errors = []
    for n in (48, 96):
        spacing = 2.6 * normal.contact_radius / n
        area = (n * spacing) ** 2
        state = slip_of(
            sphere(n, spacing, 10.0), spacing, 20.0 / area, friction=0.4, tangential_ratio=ratio
        )
        assert state.mean_traction * area == pytest.approx(exact.tangential_force, rel=1e-9)
        at = (np.arange(n) - (n - 1) / 2) * spacing
        traction = exact.traction(at, at[:, None])
        errors.append(np.sqrt(((state.traction - traction) ** 2).mean()) / traction.max())
        radius = np.sqrt(np.count_nonzero(state.stick) * spacing**2 / np.pi)
    assert radius == pytest.approx(exact.stick_radius, rel=0.02)
    assert state.tangential_displacement == pytest.approx(exact.tangential_displacement, rel=2e-3)
    assert errors[1] < 0.01
    assert errors[1] < 0.65 * errors[0]


def test_coulomb_holds_on_a_rough_surface():
    state = slip_of(ROUGH, SPACING, 40.0)
    limit = 0.5 * state.normal.pressure
    assert state.mean_traction == pytest.approx(0.6 * 0.5 * 40.0, rel=1e-9)
    assert np.all(state.traction <= limit)
    assert state.traction.min() > -1e-6 * limit.max()
    np.testing.assert_array_equal(state.traction[state.slip], limit[state.slip])
    assert not np.any(state.stick & state.slip)
    assert np.array_equal(state.stick | state.slip, state.normal.contact)
    assert state.stick.any()
    assert state.slip.any()


def test_the_two_ends_of_the_tangential_load():
    none, all_of_it = (slip_of(ROUGH, SPACING, 40.0, tangential_ratio=r) for r in (0, 1))
    assert none.mean_traction == none.tangential_displacement == 0
    assert not none.slip.any()
    assert not all_of_it.stick.any()
    np.testing.assert_allclose(all_of_it.traction, 0.5 * all_of_it.normal.pressure)


@pytest.mark.parametrize(
    "change",
    [{"friction": 0}, {"tangential_ratio": 1.1}, {"tangential_ratio": -0.1}, {"poisson": 0.6}],
)
def test_bad_input_is_refused(change):
    with pytest.raises(InvalidContactInput):
        slip_of(ROUGH, SPACING, 40.0, **change)


def test_a_ceiling_is_refused():
    normal = solve_contact(ROUGH, SPACING, MODULUS, mean_pressure=40.0, pressure_limit=3000.0)
    with pytest.raises(InvalidContactInput, match="limit"):
        solve_slip(
            ROUGH,
            SPACING,
            MODULUS,
            normal=normal,
            friction=0.5,
            tangential_ratio=0.5,
            poisson=0.24,
        )


@pytest.mark.parametrize(
    ("heights", "message"),
    [
        (self_affine(64, seed=8), "other heights"),
        (ROUGH[:32], r"\(64, 64\), the heights \(32, 64\)"),
    ],
)
def test_the_contact_of_another_surface_is_refused(heights, message):
    normal = solve_contact(ROUGH, SPACING, MODULUS, mean_pressure=40.0)
    with pytest.raises(InvalidContactInput, match=message):
        solve_slip(
            heights,
            SPACING,
            MODULUS,
            normal=normal,
            friction=0.5,
            tangential_ratio=0.5,
            poisson=0.24,
        )


def test_no_normal_load_is_refused():
    with pytest.raises(InvalidContactInput, match="no load"):
        slip_of(ROUGH, SPACING, 0.0)
