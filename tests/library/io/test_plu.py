"""A `.plu` file is read back by the library that reads the instrument's own."""

import numpy as np
from gstlib.io.plu import write_plu
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays


def read(path):
    from SurfaceTopography.IO.PLU import PLUReader

    return PLUReader(str(path)).topography()


def rows_and_columns(topography):
    """Heights in µm as (row, column), NaN where unmeasured: the library has them as [x, y]."""
    return np.ma.filled(topography.heights().astype(float), np.nan).T


def test_pattern_and_sizes_come_back_as_they_were(tmp_path):
    heights = np.arange(15.0).reshape(3, 5) * 1e-3
    heights[0, 4] = np.nan
    write_plu(tmp_path / "a.plu", heights, (0.002, 0.00166), comment="a comment")
    topography = read(tmp_path / "a.plu")
    np.testing.assert_array_equal(rows_and_columns(topography), (heights * 1e3).astype(np.float32))
    assert topography.nb_grid_pts == (5, 3)
    np.testing.assert_allclose(topography.physical_sizes, (5 * 1.66, 3 * 2.0), rtol=1e-7)
    assert topography.unit == "µm"
    assert topography.info["instrument"]["name"] == "DCM 3D rev. 2"
    assert topography.info["raw_metadata"]["comment"] == "a comment"
    assert (tmp_path / "a.plu").stat().st_size == 508 + 4 * 15 + 8


@settings(max_examples=25, deadline=None)
@given(
    arrays(
        np.float32,
        st.tuples(st.integers(1, 9), st.integers(1, 9)),
        elements=st.floats(-1000, 1000, width=32) | st.just(np.float32(np.nan)),
    )
)
def test_any_map_comes_back_exactly(tmp_path_factory, micrometres):
    path = tmp_path_factory.getbasetemp() / "any.plu"
    write_plu(path, micrometres.astype(float) * 1e-3, 0.001)
    np.testing.assert_array_equal(rows_and_columns(read(path)), micrometres)
