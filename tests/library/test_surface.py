import numpy as np
import pytest

from gstlib.surface import crop, make_surface, remove_mean, spacing_of


def test_element_centres_and_spacing():
    surface = make_surface(np.zeros((2, 3)), (0.1, 0.2), origin=(1.0, 2.0))
    assert surface.y.values == pytest.approx([1.05, 1.15])
    assert surface.x.values == pytest.approx([2.1, 2.3, 2.5])
    assert spacing_of(surface) == (0.1, 0.2)


def test_first_index_is_y():
    surface = make_surface([[1.0, 2.0], [3.0, 4.0]], 0.1)
    assert float(surface.isel(y=1, x=0)) == 3.0


def test_crop_keeps_the_elements_inside():
    surface = make_surface(np.arange(16.0).reshape(4, 4), 1.0)
    part = crop(surface, y=(1.0, 3.0), x=(0.0, 2.0))
    assert part.values.tolist() == [[4.0, 5.0], [8.0, 9.0]]
    assert spacing_of(part) == (1.0, 1.0)


def test_mean_ignores_unmeasured_points():
    levelled = remove_mean(make_surface([[1.0, 3.0], [np.nan, 2.0]], 1.0))
    assert levelled.values[0].tolist() == [-1.0, 1.0]
    assert levelled.attrs["units"] == "mm"


@pytest.mark.parametrize("spacing", [0.0, -1.0, np.nan, np.inf, (1.0, -1.0)])
def test_spacing_must_be_positive(spacing):
    with pytest.raises(ValueError, match="spacing"):
        make_surface(np.zeros((2, 2)), spacing)


def test_heights_must_be_a_map():
    with pytest.raises(ValueError, match="dimensions"):
        make_surface(np.zeros(4), 1.0)
