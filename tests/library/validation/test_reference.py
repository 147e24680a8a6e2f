"""One contact of the whole square, read where the patches lie."""

import numpy as np
import pytest

from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.grid import make_surface
from gstlib.validation.single_scale import patches_of_reference


@pytest.mark.parametrize(
    ("columns", "place", "at"),
    [
        (33, PatchPosition(1.205, 0.805, 30.0), [16, 16]),
        # its x runs along y, its y against x
        (33, PatchPosition(1.205 - 0.05, 0.805 + 0.1, 90.0), [26, 21]),
        # on elements of 10 µm × 30 µm
        (11, PatchPosition(1.205 - 0.1, 0.805 - 0.03, 0.0), [26, 6]),
    ],
)
def test_a_scan_reads_the_reference_where_it_lies(columns, place, at):
    pressure = np.zeros((200, 200))
    pressure[120, 80] = 5.0  # y 1.205, x 0.805
    scan = make_surface(np.zeros((33, columns)), (0.01, 0.33 / columns))
    reference = patches_of_reference(make_surface(pressure, 0.01), {"a": place}, scan)
    np.testing.assert_array_equal(np.argwhere(reference.contact.values[0]), [at])
    assert float(reference.pressure[0]) == pytest.approx(5.0 / scan.size)
