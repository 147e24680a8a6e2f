"""Scans: orientation, spacing and unmeasured points as in the file; bad files are refused."""

import logging
import math

import numpy as np
import pytest
from scan_files import (
    FORMATS,
    gwy_bytes,
    plu_bytes,
    plux_members,
    vk4_bytes,
    write_gsf,
    write_sur,
    write_x3p,
    write_xyz,
    zipped,
)

from gstlib.errors import InputError
from gstlib.io.plu import write_plu
from gstlib.io.scans import check_size, cut_scan, read_scan
from gstlib.surface import make_surface, spacing_of

# Not square, odd, and no symmetry: every mistake of axes shows.
NY, NX, DY, DX = 5, 7, 1.66e-3, 0.83e-3
# what matrices do not say
KNOWN = {"unit": "um", "spacing_mm": 1e-3}


@pytest.fixture
def heights():
    heights = 1e-3 * np.random.default_rng(1).normal(size=(NY, NX))
    heights[1, 5] = math.nan
    return heights


def _refused(path, match, **kwargs):
    with pytest.raises(InputError, match=match) as caught:
        read_scan(path, **kwargs)
    assert path.name in str(caught.value)


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_surface(tmp_path, heights, name):
    sample = FORMATS[name]
    path = tmp_path / f"a{sample.ending}"
    spacing = (DX, DX) if sample.square else (DY, DX)
    sample.write(path, heights, spacing)
    scan = read_scan(path, **sample.options(DX))
    expected = heights
    if not sample.unmeasured:
        lowest = np.nanmin(heights)
        expected = np.nan_to_num(heights, nan=lowest) - lowest
    assert scan.dims == ("y", "x")
    np.testing.assert_allclose(scan.values, expected, atol=2e-9)  # NaN where NaN
    assert spacing_of(scan) == pytest.approx(spacing, rel=1e-6)
    assert scan.attrs["file"] == path.name
    assert sample.attrs.items() <= scan.attrs.items()
    assert all(isinstance(value, str) for value in scan.attrs.values())


def test_plu_as_the_project_writes_it(tmp_path, heights):
    write_plu(tmp_path / "a.plu", heights, (DY, DX))
    scan = read_scan(tmp_path / "a.plu", unit="mm", spacing_mm=1.0)  # its own count, not these
    np.testing.assert_allclose(scan.values, heights, rtol=1e-6)
    assert spacing_of(scan) == (DY, DX)


@pytest.mark.parametrize("kind", "DFLI")
def test_x3p_of_all_types(tmp_path, heights, kind):
    write_x3p(tmp_path / "a.x3p", heights, (DY, DX), kind=kind)
    np.testing.assert_allclose(read_scan(tmp_path / "a.x3p").values, heights, atol=1.1e-7)


def test_sur_of_16_bits(tmp_path, heights):
    write_sur(tmp_path / "a.sur", heights, (DY, DX), bits=16)
    np.testing.assert_allclose(read_scan(tmp_path / "a.sur").values, heights, atol=3e-7)


@pytest.mark.parametrize("unit", ["µm", "μm"])  # micro sign, Greek letter
@pytest.mark.parametrize("padding", ["", 13 * " "])
def test_sur_with_units_in_utf_8(tmp_path, heights, unit, padding):
    micrometres = (unit + padding).encode("utf-8")
    write_sur(tmp_path / "a.sur", heights, (DY, DX), micrometres=micrometres)
    scan = read_scan(tmp_path / "a.sur")
    np.testing.assert_allclose(scan.values, heights, atol=1e-9)
    assert spacing_of(scan) == pytest.approx((DY, DX))


@pytest.mark.parametrize("name", ["a.sur", "a.bin"])
def test_compressed_sur(tmp_path, heights, name):
    write_sur(tmp_path / "b.sur", heights, (DY, DX))
    content = (tmp_path / "b.sur").read_bytes()
    (tmp_path / name).write_bytes(content.replace(b"DIGITAL SURF", b"DSCOMPRESSED"))
    _refused(tmp_path / name, "compressed file of Digital Surf.*without compression")


def _gwy(layers, spacing):
    return gwy_bytes({1: layers[1], 0: layers[0]}, spacing)  # stored in the wrong order


@pytest.mark.parametrize(
    ("ending", "content", "layer"),
    [
        (".plu", plu_bytes, "layer0, the first of 2 height maps"),
        (".plux", lambda *args: zipped(plux_members(*args)), "Layer 0, the first of 2 height maps"),
        (".vk4", vk4_bytes, "Default, the first of 2 height maps"),
        (".gwy", _gwy, "Map 0, the first of 2 height maps"),
    ],
)
def test_first_of_several_layers(tmp_path, heights, caplog, ending, content, layer):
    heights = np.nan_to_num(heights)
    path = tmp_path / f"a{ending}"
    path.write_bytes(content([heights, 0.5 * heights], (DY, DX)))
    with caplog.at_level(logging.WARNING, logger="gstlib"):
        scan = read_scan(path)
    np.testing.assert_allclose(scan.values - scan.values.min(), heights - heights.min(), atol=2e-9)
    assert scan.attrs["layer"] == layer
    assert f"{path}: read is {layer}" in caplog.text


@pytest.mark.parametrize("shuffled", [False, True])
def test_gridded_points(tmp_path, heights, shuffled):
    order = np.arange(heights.size)
    if shuffled:
        order = np.random.default_rng(2).permutation(order)
    write_xyz(tmp_path / "a.xyz", heights, (DY, DX), order=order)
    scan = read_scan(tmp_path / "a.xyz", unit="um")
    np.testing.assert_allclose(scan.values, heights, atol=1e-9)
    assert spacing_of(scan) == pytest.approx((DY, DX))


def test_points_that_say_their_units(tmp_path, heights):
    write_xyz(tmp_path / "b.xyz", heights, (DY, DX))
    text = (tmp_path / "b.xyz").read_text()
    header = "# Channel: Z\n# Lateral units: µm\n# Value units: nm\n"
    (tmp_path / "a.xyz").write_text(header + text, encoding="utf-8")
    scan = read_scan(tmp_path / "a.xyz", unit="mm")
    np.testing.assert_allclose(scan.values, heights * 1e-3, atol=1e-12)
    assert spacing_of(scan) == pytest.approx((DY, DX))
    (tmp_path / "a.xyz").write_text(header.replace("nm", "V") + text, encoding="utf-8")
    _refused(tmp_path / "a.xyz", r"units \['V'\]", unit="um")


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


def test_scattered_points_need_a_spacing_and_a_unit(tmp_path):
    np.savetxt(tmp_path / "a.xyz", np.random.default_rng(3).uniform(size=(50, 3)))
    _refused(tmp_path / "a.xyz", "does not say its unit")
    _refused(tmp_path / "a.xyz", "50 points are scattered", unit="mm")
    _refused(tmp_path / "a.xyz", "makes 0 × 0 elements", unit="mm", scatter_spacing_mm=5.0)
    _refused(tmp_path / "a.xyz", "elements.*unit", unit="m", scatter_spacing_mm=1e-4)
    # memory for the grid would have no bound
    _refused(tmp_path / "a.xyz", "elements of 50 points", unit="mm", scatter_spacing_mm=5e-3)
    _refused(tmp_path / "a.xyz", "unknown scan unit", unit="parsec")


def test_points_on_a_line_and_a_far_point(tmp_path):
    line = np.arange(20.0)
    np.savetxt(tmp_path / "a.xyz", np.column_stack([line, line, line]))
    _refused(tmp_path / "a.xyz", "no surface can be laid", unit="um", scatter_spacing_mm=1e-3)
    # a grid of 60000 × 60000 places for a handful of points is no grid
    x, y = (axis.ravel() for axis in np.meshgrid([0, 1, 60000], [0, 1, 60000]))
    np.savetxt(tmp_path / "a.xyz", np.column_stack([x, y, x]), fmt="%g")
    _refused(tmp_path / "a.xyz", "9 points are scattered", unit="nm")


@pytest.mark.parametrize("separator", [" ", "\t", ";"])
def test_points_with_decimal_commas_and_unmeasured_heights(tmp_path, heights, separator):
    write_xyz(tmp_path / "a.xyz", np.nan_to_num(heights, nan=9.0), (DY, DX))
    text = (tmp_path / "a.xyz").read_text().replace(" ", separator)
    if separator != " ":
        text = text.replace(".", ",")
    for mark in ("NaN", "BAD", "---", "" if separator != " " else "nan"):
        unmeasured = text.replace("9000,000000000", mark).replace("9000.000000000", mark)
        (tmp_path / "a.xyz").write_text("# Sq 1.5, rounded\n" + unmeasured)
        scan = read_scan(tmp_path / "a.xyz", unit="um")
        np.testing.assert_allclose(scan.values, heights, atol=1e-9)
        assert spacing_of(scan) == pytest.approx((DY, DX))


def test_points_between_commas_and_tabs(tmp_path, heights):
    write_xyz(tmp_path / "a.xyz", heights, (DY, DX))
    text = (tmp_path / "a.xyz").read_text()
    (tmp_path / "a.xyz").write_text(text.replace(" ", ",\t"))
    np.testing.assert_allclose(read_scan(tmp_path / "a.xyz", unit="um").values, heights, atol=1e-9)


def test_text_that_is_no_points(tmp_path):
    (tmp_path / "a.xyz").write_text("x y z\n1 2 three\n")
    _refused(tmp_path / "a.xyz", "cannot be read as columns x, y, z.*line 1 is 'x y z'", unit="um")
    (tmp_path / "a.xyz").write_text("# x y z\n1 2 3\n1 2 three\n")
    _refused(tmp_path / "a.xyz", "line 3 is '1 2 three'", unit="um")
    (tmp_path / "a.xyz").write_text("0,5 1,5 2,5\n" * 9)
    _refused(tmp_path / "a.xyz", "line 1 is '0,5 1,5 2,5'", unit="um")
    (tmp_path / "a.xyz").write_text("1 2\n" * 9)
    _refused(tmp_path / "a.xyz", "line 1 is '1 2'", unit="um")
    (tmp_path / "a.xyz").write_text("1 2 3\n1 3 3\n")
    _refused(tmp_path / "a.xyz", "only 2 points", unit="um")


class TestMatrices:
    def write(self, tmp_path, text, ending=".csv"):
        (tmp_path / f"a{ending}").write_text(text, encoding="utf-8")
        return tmp_path / f"a{ending}"

    def test_unit_and_spacing_come_from_the_config(self, tmp_path):
        path = self.write(tmp_path, "1 2 3 4\n5 6 7 8\n", ".txt")
        _refused(path, "does not say its unit.*scans.unit", spacing_mm=1e-3)
        _refused(path, "spacing of its points.*scans.spacing_um", unit="um")
        scan = read_scan(path, **KNOWN)
        np.testing.assert_allclose(
            scan.values, [[0.001, 0.002, 0.003, 0.004], [0.005, 0.006, 0.007, 0.008]]
        )
        assert spacing_of(scan) == (1e-3, 1e-3)

    def test_unmeasured_cells(self, tmp_path):
        path = self.write(tmp_path, "1,,3,nan\n5,BAD,---,8\n9,1,2,Bad\n")
        expected = [[1, 0, 3, 0], [5, 0, 0, 8], [9, 1, 2, 0]]
        scan = read_scan(path, **KNOWN)
        np.testing.assert_allclose(np.nan_to_num(scan.values), np.array(expected) * 1e-3)
        assert np.isnan(scan.values).sum() == 5

    @pytest.mark.parametrize("separator", [",", ";", "\t", " "])
    @pytest.mark.parametrize("cell", ["", "NaN", "BAD", "---"])
    @pytest.mark.parametrize("header", ["", "# Value units: µm\n", "Heights of a stone\n\n"])
    def test_unmeasured_rows_on_top(self, tmp_path, separator, cell, header):
        if separator == " " and not cell:
            pytest.skip("blanks separate no empty cells")
        heights = np.arange(1.0, 40 * 30 + 1).reshape(40, 30)
        heights[:2] = heights[2:4, :25] = heights[20] = np.nan
        rows = [separator.join(cell if v != v else f"{v:g}" for v in row) for row in heights]
        path = self.write(tmp_path, header + "# a comment\n".join(f"{row}\n" for row in rows))
        scan = read_scan(path, **KNOWN)
        np.testing.assert_allclose(scan.values, heights * 1e-3)

    def test_wide_and_many_unmeasured_rows_on_top(self, tmp_path):
        path = self.write(tmp_path, 300 * (1999 * ";" + "\n") + 1999 * "1,5;" + "2\n")
        scan = read_scan(path, **KNOWN)
        assert scan.shape == (301, 2000)
        assert np.isfinite(scan.values[-1]).all()
        assert np.isnan(scan.values[:-1]).all()

    def test_empty_row_that_may_end_a_header(self, tmp_path):
        # as a spreadsheet writes a title and a blank line over the heights
        text = "Heights,,,\n,,,\n1,2,3,4\n5,6,7,8\n9,9,9,9\n"
        _refused(self.write(tmp_path, text), "line 2 has no number.*header.*NaN", **KNOWN)
        scan = read_scan(self.write(tmp_path, text.replace("\n,,,", "")), **KNOWN)
        assert scan.shape == (3, 4)
        scan = read_scan(self.write(tmp_path, text.replace("\n,,,", "\n,,,NaN")), **KNOWN)
        assert scan.shape == (4, 4)
        # another number of cells is no row of this matrix
        scan = read_scan(self.write(tmp_path, text.replace("\n,,,", "\n,,")), **KNOWN)
        assert scan.shape == (3, 4)

    @pytest.mark.parametrize("corner", ["y/x", "0", ""])
    @pytest.mark.parametrize("step", [13.28, -0.001])
    def test_coordinates_beside_the_heights(self, tmp_path, corner, step):
        heights = np.random.default_rng(4).normal(size=(12, 15))
        lines = [[corner, *(f"{n * step:.4f}" for n in range(15))]]
        lines += [
            [f"{n * step:.4f}", *(f"{value:.4f}" for value in row)] for n, row in enumerate(heights)
        ]
        text = "".join(";".join(line) + "\n" for line in lines)
        _refused(self.write(tmp_path, text), "as coordinates do.*delete that row", **KNOWN)
        # one of the two alone may be chance
        for part in ("".join(text.splitlines(True)[1:]), text.replace(lines[5][0], "0.5")):
            assert read_scan(self.write(tmp_path, part), **KNOWN).shape[1] == 16

    @pytest.mark.parametrize("header", ["", "y/x" + ",".join(map(str, range(15))) + "\n"])
    def test_plane_has_no_coordinates(self, tmp_path, header):
        rows, columns = np.indices((12, 15))
        heights = 0.3 * rows - 0.2 * columns
        heights[1, 1] = heights[4, 7] = np.nan
        text = "".join(",".join(f"{value:.3f}" for value in row) + "\n" for row in heights)
        scan = read_scan(self.write(tmp_path, header + text), **KNOWN)
        np.testing.assert_allclose(scan.values, heights * 1e-3, atol=1e-12)

    def test_separator_at_the_end_of_each_line(self, tmp_path):
        path = self.write(tmp_path, "1;2;3;4;\r\n5;6;7;;\r\n")
        scan = read_scan(path, **KNOWN)
        assert scan.shape == (2, 4)
        assert np.isnan(scan.values[1, 3])

    def test_ragged(self, tmp_path):
        _refused(
            self.write(tmp_path, "1,2,3,4\n5,6,7\n"),
            "line 2 has 3 cells, the first row 4",
            **KNOWN,
        )

    @pytest.mark.parametrize("cell", ["seven", "1_0", "0x10", "7 µm"])
    def test_text_cell(self, tmp_path, cell):
        path = self.write(tmp_path, f"1,2,3,4\n5,6,{cell},8\n")
        _refused(path, "line 2 is no row of numbers", **KNOWN)

    def test_points_under_the_wrong_name(self, tmp_path):
        path = self.write(tmp_path, "x,y,z\n" + "0,0,1\n" * 9)
        _refused(path, "3 columns and 9 rows.*xyz", **KNOWN)

    def test_profile(self, tmp_path):
        path = self.write(tmp_path, "".join(f"{i} {i % 3}\n" for i in range(20)), ".txt")
        _refused(path, "profile", **KNOWN)

    def test_header_of_an_instrument_counts(self, tmp_path):
        header = "h=2 w=4\npixel size=1.5e-6 m\nheight conversion factor (-> m)=2e-9\n"
        path = self.write(tmp_path, header + "1 2 3 4\n5 6 7 8\n", ".txt")
        scan = read_scan(path, unit="mm", spacing_mm=1.0)
        np.testing.assert_allclose(scan.values[0], [2e-6, 4e-6, 6e-6, 8e-6])
        assert spacing_of(scan) == pytest.approx((1.5e-3, 1.5e-3))

    def test_half_a_header_is_completed(self, tmp_path):
        path = self.write(tmp_path, "# Value units: nm\n" + 3 * "1,2,3,4\n")
        _refused(path, "spacing of its points")
        scan = read_scan(path, spacing_mm=1e-3)
        np.testing.assert_allclose(scan.values[0], [1e-6, 2e-6, 3e-6, 4e-6])

    def test_header_that_contradicts(self, tmp_path):
        # heights in rows of another number than there are
        path = self.write(tmp_path, "h=7 w=4\npixel size=1e-6 m\n1 2 3 4\n5 6 7 8\n", ".txt")
        _refused(path, "header cannot be understood", **KNOWN)
        path = self.write(tmp_path, "# all lengths: (nm)\n" + 3 * "1,2,3,4\n")
        _refused(path, r"speaks of \['nm'\].*is um", **KNOWN)
        path = self.write(tmp_path, "# all lengths: (µm)\n" + 3 * "1,2,3,4\n")
        assert read_scan(path, **KNOWN).shape == (3, 4)

    @pytest.mark.parametrize(
        "text", ["no number at all\n" * 3, "# " + 2000 * " " + "\n1 2 3\n", "#\n" * 300]
    )
    def test_no_matrix(self, tmp_path, text):
        _refused(self.write(tmp_path, text, ".txt"), "no row of numbers", **KNOWN)

    def test_bytes_under_the_name_of_a_text(self, tmp_path):
        (tmp_path / "a.csv").write_bytes(bytes(range(256)) * 4)
        _refused(tmp_path / "a.csv", "is no text", **KNOWN)

    def test_other_encodings(self, tmp_path):
        for encoding in ("utf-16", "latin-1"):
            text = "# Width: 4 µm\n# Height: 2 µm\n# Value units: nm\n1 2 3 4\n5 6 7 8\n"
            (tmp_path / "a.txt").write_bytes(text.encode(encoding))
            assert spacing_of(read_scan(tmp_path / "a.txt")) == (1e-3, 1e-3)


def test_gsf_units(tmp_path, heights):
    path = tmp_path / "a.gsf"
    write_gsf(path, heights, (DY, DX), units=None)
    _refused(path, "does not say its unit")
    np.testing.assert_allclose(read_scan(path, unit="m").values, heights, atol=1e-9)
    write_gsf(path, heights * 1e9, (DY * 1e6, DX * 1e6), units=("µm", "nm"))
    scan = read_scan(path, unit="m")
    np.testing.assert_allclose(scan.values, heights, atol=1e-9)
    assert spacing_of(scan) == pytest.approx((DY, DX))
    write_gsf(path, heights, (DY, DX), units=("m", "V"))
    _refused(path, "'V' is no length")


def test_missing_and_empty(tmp_path):
    _refused(tmp_path / "a.plu", "no such file")
    (tmp_path / "a.plu").write_bytes(b"")
    _refused(tmp_path / "a.plu", "empty")


@pytest.mark.parametrize(("length", "match"), [(100, "header.*truncated"), (600, "truncated")])
def test_truncated_plu(tmp_path, heights, length, match):
    (tmp_path / "a.plu").write_bytes(plu_bytes([heights], (DY, DX))[:length])
    _refused(tmp_path / "a.plu", match)


def test_what_is_no_plu(tmp_path):
    (tmp_path / "a.plu").write_bytes(b"GIF89a, as it were. " * 100)
    _refused(tmp_path / "a.plu", "not a .plu")


@pytest.mark.parametrize("name", ["a.al3d", "a.sur", "a.bin", "noending", "a.hgt"])
def test_unknown_content(tmp_path, name):
    # as many bytes as a square map of 16-bit heights has: one format has no other mark
    (tmp_path / name).write_bytes(b"what no instrument wrote" * 3 * 4**3)
    _refused(tmp_path / name, "cannot be read as a height map", unit="um", spacing_mm=1e-3)


def test_known_content_without_its_ending(tmp_path, heights):
    FORMATS["al3d"].write(tmp_path / "a.scan", heights, (DY, DX))
    np.testing.assert_allclose(read_scan(tmp_path / "a.scan").values, heights, atol=1e-9)


@pytest.mark.parametrize(
    ("spacing", "factor", "match"),
    [
        (10.0, 1.0, "field of 70 mm.*unit"),
        (1e-7, 1.0, "too close.*unit"),
        (1e-3, 1e4, "heights range over.*unit"),
    ],
)
def test_absurd_sizes(tmp_path, heights, spacing, factor, match):
    write_plu(tmp_path / "a.plu", heights * factor, spacing)
    _refused(tmp_path / "a.plu", match)


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
