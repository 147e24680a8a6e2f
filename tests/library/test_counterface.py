"""Two rough faces: which point lies on which, and that it does not matter who presses whom."""

import numpy as np
import pytest

from gstlib.contact import pressed_height, solve_at_pressure
from gstlib.counterface import turned_over
from gstlib.errors import InputError
from gstlib.surface import make_surface

FILES = {"source": "counterface.h5", "patch_source": "7_T0.h5"}


def rough(seed, shape=(20, 24), spacing=0.01):
    return make_surface(0.002 * np.random.default_rng(seed).standard_normal(shape), spacing)


def pressed(lower, upper):
    """Pressure where `upper` is turned over onto `lower`."""
    faces = lower.to_dataset(name="height")
    faces["counterface"] = turned_over(upper, lower, **FILES)
    height = pressed_height(faces)
    _, pressure = solve_at_pressure(
        height,
        source="faces",
        contact_modulus_MPa=12820.0,
        target_pressure_MPa=40.0,
        tolerance=1e-10,
    )
    return pressure.values


def test_who_presses_whom_does_not_matter():
    """Seen from above its own face, each has the pressures of the other, mirrored along x."""
    a, b = rough(1), rough(2)
    onto_a, onto_b = pressed(a, b), pressed(b, a)
    assert (onto_a > 0).any()
    np.testing.assert_allclose(onto_a, onto_b[:, ::-1], atol=1e-6 * onto_a.max())


def test_a_summit_of_the_counterface_lies_on_the_mirrored_place():
    flat = make_surface(np.zeros((20, 24)), 0.01)
    summit = flat.copy()
    summit[3, 5] = 0.001
    pressure = pressed(flat, summit)
    assert np.unravel_index(pressure.argmax(), pressure.shape) == (3, 24 - 1 - 5)


def test_without_a_counterface_the_patch_alone_is_pressed():
    a = rough(1)
    assert pressed_height(a.to_dataset(name="height")).identical(a.rename("height"))


@pytest.mark.parametrize("other", [rough(2, shape=(20, 23)), rough(2, spacing=0.0101)])
def test_another_grid_is_refused(other):
    with pytest.raises(
        InputError, match=r"counterface\.h5: .*7_T0\.h5 has 24 × 20 points every 0.01"
    ):
        turned_over(other, rough(1), **FILES)
