"""A `.plu` file is read back by the library that reads the instrument's own."""

import numpy as np
from gstlib.io.plu import write_plu


def test_pattern_and_sizes_come_back_as_they_were(tmp_path):
    from SurfaceTopography.IO.PLU import PLUReader

    heights = np.arange(15.0).reshape(3, 5) * 1e-3
    heights[0, 4] = np.nan
    write_plu(tmp_path / "a.plu", heights, (0.002, 0.00166), comment="a comment")
    topography = PLUReader(str(tmp_path / "a.plu")).topography()
    # in µm, masked where unmeasured: the library has them as [x, y]
    found = np.ma.filled(topography.heights().astype(float), np.nan).T
    np.testing.assert_array_equal(found, (heights * 1e3).astype(np.float32))
    assert topography.nb_grid_pts == (5, 3)
    np.testing.assert_allclose(topography.physical_sizes, (5 * 1.66, 3 * 2.0), rtol=1e-7)
    assert topography.unit == "µm"
    assert topography.info["raw_metadata"]["comment"] == "a comment"
