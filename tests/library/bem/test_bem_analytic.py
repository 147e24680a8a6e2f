"""The solver against closed forms, with rates of convergence."""

import numpy as np
from bem_reference import MODULUS, centred, sphere

from gstlib.bem import solve_contact
from gstlib.bem.closed_forms import Sphere


def test_a_sphere_converges_to_hertzs_pressure_and_displacement():
    exact = Sphere(20.0, 10.0, MODULUS)
    errors = []
    for n in (48, 192):
        spacing = 2.6 * exact.contact_radius / n
        heights = sphere(n, spacing, exact.radius)
        mean = exact.force / (n * spacing) ** 2
        state = solve_contact(
            heights, spacing, MODULUS, mean_pressure=mean, tolerance=1e-8
        )
        misfit = state.pressure - exact.pressure(*centred(n, spacing))
        touch = state.displacement - heights.max()
        errors.append(
            (misfit.std() / exact.peak_pressure, abs(touch / exact.displacement - 1))
        )
    assert np.all(np.less(errors[1], (2e-3, 2e-4)))
    rates = np.log2(np.divide(*errors)) / 2
    assert np.all(rates > (0.9, 1.2))
