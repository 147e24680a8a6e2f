import numpy as np
import pytest
from gstlib.surface import make_surface, spacing_of


def test_element_centres_and_spacing():
    surface = make_surface([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], (0.1, 0.2))
    assert surface.y.values == pytest.approx([0.05, 0.15])
    assert surface.x.values == pytest.approx([0.1, 0.3, 0.5])
    assert spacing_of(surface) == (0.1, 0.2)
    assert float(surface.isel(y=1, x=0)) == 4.0


@pytest.mark.parametrize("spacing", [0.0, -1.0, np.nan, np.inf, (1.0, -1.0)])
def test_what_is_no_surface_is_refused(spacing):
    with pytest.raises(ValueError, match="spacing"):
        make_surface(np.zeros((2, 2)), spacing)
    with pytest.raises(ValueError, match="dimensions"):
        make_surface(np.zeros(4), 1.0)
