"""Scans: orientation, spacing and unmeasured points as in the file; bad files are refused."""

import math
import struct

import numpy as np
import pytest

from gstlib.errors import InputError
from gstlib.io.plu import write_plu
from gstlib.io.scans import check_size, cut_scan, read_scan
from gstlib.surface import make_surface, spacing_of

# Not square, and no symmetry: every mistake of axes shows.
NY, NX, DY, DX = 5, 8, 1.66e-3, 0.83e-3


@pytest.fixture
def heights():
    heights = 1e-3 * np.random.default_rng(1).normal(size=(NY, NX))
    heights[1, 6] = math.nan
    return heights


def plu_bytes(heights_um, dy_um, dx_um):
    """A .plu as in the table of its bytes, written apart from `write_plu`."""
    ny, nx = heights_um.shape
    header = bytearray(500)
    header[:19] = b"2021-04-19 11:40:13"
    struct.pack_into("<III", header, 388, ny, nx, nx)
    struct.pack_into("<ffff", header, 400, 0.0, dx_um, dy_um, 0.0)
    struct.pack_into("<I", header, 428, 3)
    struct.pack_into("<I", header, 440, 34)
    struct.pack_into("<I", header, 444, 3)
    header[489], header[490], header[491], header[492] = 1, 251, 7, 0
    values = np.where(np.isnan(heights_um), 1000001.0, heights_um).astype("<f4")
    limits = struct.pack("<ff", np.nanmin(heights_um), np.nanmax(heights_um))
    return bytes(header) + struct.pack("<II", ny, nx) + values.tobytes() + limits


def test_plu_by_its_bytes(tmp_path, heights):
    path = tmp_path / "a.plu"
    path.write_bytes(plu_bytes(heights * 1e3, DY * 1e3, DX * 1e3))
    scan = read_scan(path)
    assert scan.dims == ("y", "x")
    assert scan.shape == (NY, NX)
    np.testing.assert_allclose(scan.values, heights, rtol=1e-6)  # NaN where NaN
    assert spacing_of(scan) == pytest.approx((DY, DX), rel=1e-7)
    assert scan.attrs["objective"] == "Leica HC PL Fluotar EPI 10X"
    assert all(isinstance(value, str) for value in scan.attrs.values())


def test_plu_as_the_project_writes_it(tmp_path, heights):
    write_plu(tmp_path / "a.plu", heights, (DY, DX))
    scan = read_scan(tmp_path / "a.plu", unit="mm")  # its own unit counts, not this one
    np.testing.assert_allclose(scan.values, heights, rtol=1e-6)
    assert spacing_of(scan) == (DY, DX)
    assert scan.attrs["file"] == "a.plu"


def _write_xyz(path, heights, order):
    rows, columns = np.indices(heights.shape)
    points = np.stack(
        [DX * 1e3 * (columns + 0.5), DY * 1e3 * (rows + 0.5), heights * 1e3], axis=-1
    ).reshape(-1, 3)[order]
    np.savetxt(path, points[np.isfinite(points[:, 2])], fmt="%.6f")


@pytest.mark.parametrize("shuffled", [False, True])
def test_gridded_points(tmp_path, heights, shuffled):
    order = np.arange(heights.size)
    if shuffled:
        order = np.random.default_rng(2).permutation(order)
    _write_xyz(tmp_path / "a.xyz", heights, order)
    scan = read_scan(tmp_path / "a.xyz", unit="um")
    np.testing.assert_allclose(scan.values, heights, atol=1e-9)
    assert spacing_of(scan) == pytest.approx((DY, DX))


def test_scattered_points_are_exact_on_a_plane(tmp_path):
    points = np.random.default_rng(3).uniform(-0.1, 1.1, size=(400, 2))
    height = 0.3 + 0.02 * points[:, 0] - 0.01 * points[:, 1]
    np.savetxt(tmp_path / "a.xyz", np.column_stack([points, height, height]), delimiter=",")
    scan = read_scan(
        tmp_path / "a.xyz", unit="mm", scatter_spacing_mm=0.05, scatter_extent_mm=(0.2, 0.8, 0, 1)
    )
    assert scan.shape == (20, 12)
    expected = 0.3 + 0.02 * (scan.x + 0.2) - 0.01 * scan.y
    np.testing.assert_allclose(scan.values, expected.transpose("y", "x").values, atol=1e-12)


def _refused(path, match, **kwargs):
    with pytest.raises(InputError, match=match) as caught:
        read_scan(path, **kwargs)
    assert path.name in str(caught.value)


def test_scattered_points_need_a_spacing_and_a_unit(tmp_path):
    np.savetxt(tmp_path / "a.xyz", np.random.default_rng(3).uniform(size=(50, 3)))
    _refused(tmp_path / "a.xyz", "does not say its unit")
    _refused(tmp_path / "a.xyz", "50 points are scattered", unit="mm")
    _refused(tmp_path / "a.xyz", "makes 0 × 0 elements", unit="mm", scatter_spacing_mm=5.0)
    _refused(tmp_path / "a.xyz", "elements.*unit", unit="m", scatter_spacing_mm=1e-4)
    _refused(tmp_path / "a.xyz", "unknown scan unit", unit="parsec")


def test_text_that_is_no_points(tmp_path):
    (tmp_path / "a.xyz").write_text("x y z\n1 2 three\n")
    _refused(tmp_path / "a.xyz", "cannot be read as columns x, y, z", unit="um")
    (tmp_path / "a.xyz").write_text("1 2 3\n1 3 3\n")
    _refused(tmp_path / "a.xyz", "only 2 points", unit="um")


def test_missing_and_empty(tmp_path):
    _refused(tmp_path / "a.plu", "no such file")
    (tmp_path / "a.plu").write_bytes(b"")
    _refused(tmp_path / "a.plu", "empty")


@pytest.mark.parametrize(("length", "match"), [(100, "header.*truncated"), (600, "truncated")])
def test_truncated_plu(tmp_path, heights, length, match):
    (tmp_path / "a.plu").write_bytes(plu_bytes(heights * 1e3, 1.66, 1.66)[:length])
    _refused(tmp_path / "a.plu", match)


def test_what_is_no_plu(tmp_path):
    (tmp_path / "a.plu").write_bytes(b"GIF89a, as it were. " * 100)
    _refused(tmp_path / "a.plu", "not a .plu")


@pytest.mark.parametrize("name", ["a.al3d", "a.sur", "a.bin", "noending"])
def test_unknown_content(tmp_path, name):
    (tmp_path / name).write_bytes(b"nothing that any instrument wrote " * 50)
    _refused(tmp_path / name, "cannot be read as a height map")


@pytest.mark.parametrize(
    ("spacing", "factor", "match"),
    [
        (10.0, 1.0, "field of 80 mm.*unit"),
        (1e-7, 1.0, "too close.*unit"),
        (1e-3, 1e4, "heights range over.*unit"),
    ],
)
def test_absurd_sizes(tmp_path, heights, spacing, factor, match):
    write_plu(tmp_path / "a.plu", heights * factor, spacing)
    _refused(tmp_path / "a.plu", match)


def test_nothing_measured(tmp_path, heights):
    path = tmp_path / "a.plu"
    path.write_bytes(
        plu_bytes(heights * 1e3, 1.66, 1.66)[:508]
        + np.full(NY * NX + 2, 1000001.0, "<f4").tobytes()
    )
    _refused(path, "not one point is measured")


def test_profile_is_refused(tmp_path):
    (tmp_path / "a.txt").write_text("".join(f"{i} {i % 3}\n" for i in range(20)))
    _refused(tmp_path / "a.txt", "profile|cannot be read|spacing", unit="um")


class TestCut:
    scan = make_surface(np.arange(30.0 * 40).reshape(30, 40), 0.1, file="map.plu")

    def test_piece_is_where_it_should_be(self):
        piece = cut_scan(self.scan, centre=(1.0, -0.5), size_mm=1.0)
        assert piece.shape == (10, 10)
        np.testing.assert_array_equal(piece.values, self.scan.values[5:15, 25:35])
        assert piece.x[0] == pytest.approx(0.05)
        assert piece.attrs["file"] == "map.plu"

    def test_centre_of_the_scan(self):
        piece = cut_scan(self.scan, centre=(0, 0), size_mm=2.0)
        np.testing.assert_array_equal(piece.values, self.scan.values[5:25, 10:30])

    def test_pieces_side_by_side_share_nothing_and_leave_nothing(self):
        left, right = (cut_scan(self.scan, (x, 0), 1.5) for x in (-0.75, 0.75))
        together = np.hstack([left.values, right.values])
        np.testing.assert_array_equal(together, self.scan.values[8:23, 5:35])

    def test_piece_that_sticks_out(self):
        with pytest.raises(InputError, match=r"map\.plu: .*sticks out by 0\.4 mm"):
            cut_scan(self.scan, centre=(0, 1.4), size_mm=1.0)


def test_size_of_a_scan():
    check_size(make_surface(np.zeros((512, 512)), 1.66e-3), 0.85)
    with pytest.raises(
        InputError, match=r"b\.plu: the scan is 0\.9562 × 0\.8499 mm.*0\.85 × 0\.85"
    ):
        check_size(make_surface(np.zeros((512, 576)), 1.66e-3, file="b.plu"), 0.85)
