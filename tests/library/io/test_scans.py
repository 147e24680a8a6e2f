"""Scans: orientation, spacing and unmeasured points as in the file; bad text is refused."""

import math
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from gstlib.errors import NOTE, InputError
from gstlib.io.plu import write_plu
from gstlib.io.scans import cut_scan, read_scan
from gstlib.io.stage import stage_of
from gstlib.surfaces.grid import make_surface, spacing_of
from scan_files import (
    FORMATS,
    plux_members,
    refused,
    write_plu_at,
    write_sur,
    write_x3p,
    write_xyz,
    zipped,
)

DY, DX = 1.66e-3, 0.83e-3
# what matrices do not say
KNOWN = {"unit": "um", "spacing_um": 1.0}


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_surface(tmp_path, heights, name):
    sample = FORMATS[name]
    path = tmp_path / f"a{sample.ending}"
    spacing = (DX, DX) if sample.square else (DY, DX)
    sample.write(path, heights, spacing)
    scan = read_scan(path, **sample.options(DX))
    assert scan.dims == ("y", "x")
    np.testing.assert_allclose(scan.values, heights, atol=2e-9)  # NaN where NaN
    assert spacing_of(scan) == pytest.approx(spacing, rel=1e-6)
    assert scan.attrs["file"] == path.name
    assert sample.attrs.items() <= scan.attrs.items()
    assert all(isinstance(value, str) for value in scan.attrs.values())


def test_plu_as_the_project_writes_it_needs_no_large_library(tmp_path, heights):
    write_plu(tmp_path / "a.plu", heights, (DY, DX))
    code = (
        "import sys; from gstlib.io.scans import read_scan; read_scan(sys.argv[1]);"
        "assert not {'SurfaceTopography', 'surfalize', 'scipy'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code, str(tmp_path / "a.plu")], check=True)
    scan = read_scan(tmp_path / "a.plu", unit="mm", spacing_um=1e3)  # its own count, not these
    np.testing.assert_allclose(scan.values, heights, rtol=1e-6)
    assert spacing_of(scan) == (DY, DX)
    assert scan.attrs["instrument"] == "DCM 3D rev. 2"
    assert scan.attrs["acquired"] == "1970-01-01 00:00:00"


@pytest.mark.parametrize(
    ("spacing", "warned"),
    [((1.8515e-3 * 60 / 59, 1.8515e-3 * 96 / 95), True), ((1.801e-3, 1.8e-3), False)],
)
def test_a_length_divided_by_one_point_too_few_is_warned_of(tmp_path, caplog, spacing, warned):
    write_plu(tmp_path / "a.plu", np.random.default_rng(1).random((60, 96)) * 1e-3, spacing)
    scan = read_scan(tmp_path / "a.plu")
    assert spacing_of(scan) == pytest.approx(spacing, rel=1e-5)
    assert ("1.8515 µm apart" in caplog.text) == warned
    assert bool(caplog.records) == warned


@pytest.mark.parametrize(
    ("ending", "layer"),
    [
        (".plu", "layer0, the first of 2 height maps"),
        (".plux", "Layer 0, the first of 2 height maps"),
    ],
)
def test_first_of_several_layers(tmp_path, heights, caplog, ending, layer):
    path = tmp_path / f"a{ending}"
    write_plu(path, heights, (DY, DX))
    content = bytearray(path.read_bytes())
    content[489] = 2  # layers; the second is never looked at
    layers = [heights, 0.5 * heights]
    path.write_bytes(content if ending == ".plu" else zipped(plux_members(layers, (DY, DX))))
    with caplog.at_level(NOTE, logger="gstlib"):
        scan = read_scan(path)
    np.testing.assert_allclose(scan.values, heights, atol=2e-9)
    assert scan.attrs["layer"] == layer
    assert f"{path}: only {layer}, is read" in caplog.text


def rewritten_x3p(path, heights, changes=(), rename=str, **members):
    """An .x3p of these heights with texts of its index and names of its members changed."""
    write_x3p(path, heights, (DY, DX))
    with zipfile.ZipFile(path) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    index = content["main.xml"].decode()
    for old, new in changes:
        assert old in index
        index = index.replace(old, new)
    content |= {"main.xml": index.encode()}
    content |= {f"bindata/{name}.bin": values for name, values in members.items()}
    path.write_bytes(zipped({rename(name): data for name, data in content.items()}))


HEIGHT_AXIS = (
    "<AxisType>A</AxisType><DataType>D</DataType><Increment>1.0</Increment><Offset>0.0</Offset>"
)
VALID = ("</PointDataLink>", "</PointDataLink><ValidPointsLink>bindata/valid.bin</ValidPointsLink>")
LINK = "<DataLink><PointDataLink>bindata/data.bin</PointDataLink></DataLink>"


@pytest.mark.parametrize(
    "zipping",
    [
        lambda name: f"land/{name}".replace("/", "\\"),  # as of some programs for Windows
        lambda name: f"./{name}".upper(),
    ],
)
def test_x3p_is_read_however_it_was_zipped(tmp_path, heights, zipping):
    rewritten_x3p(tmp_path / "a.x3p", heights, rename=zipping)
    with zipfile.ZipFile(tmp_path / "a.x3p", "a") as archive:
        for folder in ("land/", "land/bindata/", "__MACOSX/"):
            archive.writestr(folder, "")
        archive.writestr("__MACOSX/land/._main.xml", b"\0\5\x16\7")
    np.testing.assert_allclose(read_scan(tmp_path / "a.x3p").values, heights)


@pytest.mark.parametrize(("date", "empty"), [("", "<Offset></Offset>"), ("23 Sep 2009", "")])
def test_x3p_without_date_or_offset(tmp_path, heights, date, empty):
    changes = [("2021-04-19T11:40:13", date), ("<Offset>0.0</Offset>", empty)]
    rewritten_x3p(tmp_path / "a.x3p", heights, changes)
    scan = read_scan(tmp_path / "a.x3p")
    np.testing.assert_allclose(scan.values, heights)
    assert "acquired" not in scan.attrs


def test_x3p_with_its_heights_in_the_index(tmp_path, heights):
    datums = "".join(
        "<Datum/>" if np.isnan(z) else f"<Datum> {z / 1e3} </Datum>" for z in heights.ravel()
    )
    rewritten_x3p(tmp_path / "a.x3p", heights, [(LINK, f"<DataList>{datums}</DataList>")])
    np.testing.assert_allclose(read_scan(tmp_path / "a.x3p").values, heights)


@pytest.mark.parametrize(("axis", "kind", "offset_m"), [("I", "l", 0.0), ("a", "I", 5e-6)])
def test_x3p_in_steps(tmp_path, heights, axis, kind, offset_m):
    """A height is the offset and the increment times a step; a mask says which are measured."""
    steps = np.nan_to_num(np.round((heights / 1e3 - offset_m) / 1e-9))
    valid = ~np.isnan(heights)
    valid[0] = False
    scale = f"<Increment>1e-9</Increment><Offset>{offset_m}</Offset>"
    changes = [
        (HEIGHT_AXIS, f"<AxisType>{axis}</AxisType><DataType>{kind}</DataType>{scale}"),
        VALID,
    ]
    content = steps.astype({"i": "<i2", "l": "<i4"}[kind.lower()]).tobytes()
    mask = np.packbits(valid, bitorder="little").tobytes()
    rewritten_x3p(tmp_path / "a.x3p", heights, changes, data=content, valid=mask)
    expected = np.where(valid, heights, np.nan)
    np.testing.assert_allclose(read_scan(tmp_path / "a.x3p").values, expected, atol=0.51e-6)


@pytest.mark.parametrize(
    ("changes", "members"),
    [
        ([VALID], {"valid": b"\xff"}),
        ([], {"data": bytes(8)}),
        ([("<DataType>D</DataType>", "<DataType>F</DataType>")], {}),
        ([("bindata/data.bin", "bindata/other.bin")], {}),
        ([(LINK, "<DataList><Datum>0;0;1e-6</Datum></DataList>")], {}),
        ([(HEIGHT_AXIS, HEIGHT_AXIS.replace("1.0", "0"))], {}),
        ([("<FeatureType>SUR", "<FeatureType>PRF")], {}),
    ],
)
def test_x3p_that_cannot_be_right_is_refused(tmp_path, heights, changes, members):
    rewritten_x3p(tmp_path / "a.x3p", heights, changes, **members)
    with pytest.raises(InputError, match=r"a\.x3p"):
        read_scan(tmp_path / "a.x3p")


def test_x3p_whose_heights_were_changed(tmp_path, heights, caplog):
    """Nobody knows which is right, the heights or their sum; zeros in its place are none."""
    for digit, count in (("0", 0), ("a", 1)):
        stated = f"<MD5ChecksumPointData>{32 * digit}</MD5ChecksumPointData></DataLink>"
        rewritten_x3p(tmp_path / "a.x3p", heights, [("</DataLink>", stated)])
        read_scan(tmp_path / "a.x3p")
        assert len(caplog.messages) == count


class TestHeldHeights:
    """A number that an export wrote in place of unmeasured heights."""

    def read(self, tmp_path, heights_um):
        np.savetxt(tmp_path / "a.csv", heights_um, fmt="%.17g", delimiter=",")
        return read_scan(tmp_path / "a.csv", unit="um", spacing_um=1.0).values * 1e3

    def rough(self):
        """Like a scan in `.frt`: at 73 to 82 µm, with lone spikes."""
        heights = 77 + np.random.default_rng(1).normal(size=(60, 50))
        heights[7, 8], heights[20, 30], heights[21, 30] = -0.3, 16.0, 305.0
        return heights

    @pytest.mark.parametrize(("mark", "points"), [(0.0, 10), (-9999.0, 300), (1e9, 1200)])
    def test_far_from_the_others_it_is_unmeasured(self, tmp_path, caplog, mark, points):
        heights = self.rough()
        held = np.random.default_rng(2).permutation(heights.size).reshape(heights.shape) < points
        heights[held] = mark
        found = self.read(tmp_path, heights)
        np.testing.assert_array_equal(np.isnan(found), held)
        np.testing.assert_allclose(found[~held], heights[~held])
        assert f"a.csv: {points} points" in caplog.text

    def test_of_a_few_points_or_in_steps_it_is_a_height(self, tmp_path, caplog):
        spiked = self.rough()
        spiked[40, :9] = 0.0  # spikes: of the outlier rule
        two_levels = np.where(self.rough() > 78, 78.0, 60.0)
        steps = np.round(self.rough())
        for heights in (spiked, two_levels, steps):
            np.testing.assert_allclose(self.read(tmp_path, heights), heights)
        assert caplog.messages == []

    def test_among_the_others_it_is_a_height_and_warned_of(self, tmp_path, caplog):
        clipped = np.maximum(self.rough(), 76.0)
        zeros = self.rough() - 77
        zeros.flat[::100] = 0.0
        expected = {16.4: clipped, 1: zeros, 100: np.ones((60, 50))}
        for heights in expected.values():
            np.testing.assert_allclose(self.read(tmp_path, heights), heights)
        for share, message in zip(expected, caplog.messages, strict=True):
            assert f"{share} % of the points" in message


@pytest.mark.parametrize("separator", [" ", ";"])
def test_points_in_any_order_with_unmeasured_heights(tmp_path, heights, separator):
    path = tmp_path / "a.xyz"
    order = np.random.default_rng(2).permutation(heights.size)
    write_xyz(path, np.nan_to_num(heights, nan=9.0), (DY, DX), order=order)
    text = path.read_text().replace(" ", separator)
    if separator != " ":
        text = text.replace(".", ",")
    for mark in ("NaN", "" if separator != " " else "nan"):
        unmeasured = text.replace("9000,000000000", mark).replace("9000.000000000", mark)
        path.write_text("# Sq 1.5, rounded\n" + unmeasured)
        scan = read_scan(path, unit="um")
        np.testing.assert_allclose(scan.values, heights, atol=1e-9)
        assert spacing_of(scan) == pytest.approx((DY, DX))


def test_scattered_points_are_refused(tmp_path):
    path, line = tmp_path / "a.xyz", np.arange(20.0)
    few, wide = np.random.default_rng(3).uniform(size=(50, 3)), np.array([0, 1, 60000])
    for points, count in (
        (few, 50),
        (np.column_stack([line, line, line]), 20),
        # a grid of 60000 × 60000 places for a handful of points is no grid
        (np.column_stack([np.tile(wide, 3), np.repeat(wide, 3), np.tile(wide, 3)]), 9),
    ):
        np.savetxt(path, points, fmt="%g")
        refused(path, f"{count} points are scattered.*Gwyddion", unit="um")
    refused(path, "unknown scan unit", unit="parsec")


def test_unit_and_spacing_of_a_matrix_come_from_the_config(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("1,,3,nan\n5,BAD,---,8\n9,1,2,Bad\n")
    refused(path, "does not state its unit.*scans.unit", spacing_um=1.0)
    refused(path, "spacing of its points.*scans.spacing_um", unit="um")
    refused(path, "its unit.* or the spacing.*scans.unit.*scans.spacing_um")
    scan = read_scan(path, unit="um", spacing_um=1.66)
    nan = math.nan
    expected = np.array([[1, nan, 3, nan], [5, nan, nan, 8], [9, 1, 2, nan]])
    np.testing.assert_allclose(scan.values, expected * 1e-3)
    assert spacing_of(scan) == (1.66e-3, 1.66e-3)


@pytest.mark.parametrize("encoding", ["utf-16", "latin-1"])
def test_texts_in_other_encodings(tmp_path, encoding):
    text = "# Width: 4 µm\n# Height: 2 µm\n# Value units: nm\n1 2 3 4\n5 6 7 8\n"
    (tmp_path / "a.txt").write_bytes(text.encode(encoding))
    assert spacing_of(read_scan(tmp_path / "a.txt")) == (1e-3, 1e-3)


ESRI = "NCOLS 4\nNROWS 3\nXLLCENTER 0\nYLLCENTER 0\nCELLSIZE {cell}\n{rows}"
ROWS = "9 8 7 6\n5 -9999 4 3\n2 1 0 1\n"


def test_an_esri_grid_begins_with_its_highest_y(tmp_path):
    (tmp_path / "a.asc").write_text(ESRI.format(cell="0,01", rows=ROWS))
    scan = read_scan(tmp_path / "a.asc", unit="mm")
    np.testing.assert_array_equal(scan.values, [[2, 1, 0, 1], [5, math.nan, 4, 3], [9, 8, 7, 6]])
    assert spacing_of(scan) == pytest.approx((0.01, 0.01))
    refused(tmp_path / "a.asc", "does not state its unit")


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        ("a.xyz", "x y z\n1 2 three\n", "no row of numbers"),
        ("a.xyz", "# x y z\n1 2 3\n1 2 three\n", "from line 2 on, is not a table .*'three'"),
        ("a.csv", "1,2,3,4\n5,6,7\n", "the number of columns changed from 4 to 3 at row 2"),
        ("a.csv", "1,2,3,4\n5,6,7 µm,8\n", "7 µm.*at row 1, column 3.*Unmeasured"),
        ("a.csv", "x,y,z\n" + "0,0,1\n" * 9, "3 columns and 9 rows.*xyz"),
        ("a.csv", "1,2,3,4\0\n" * 3, "is not text"),
        ("a.asc", ESRI.format(cell="0.01", rows=ROWS[:8]), "holds 1 rows of 4 .* states 3 of 4"),
        ("a.asc", ESRI.format(cell="fine", rows=ROWS), "states no number for"),
    ],
)
def test_a_text_that_is_no_scan_is_refused(tmp_path, name, text, match):
    (tmp_path / name).write_text(text, encoding="utf-8")
    refused(tmp_path / name, match, **KNOWN if name == "a.csv" else {"unit": "um"})


@pytest.mark.parametrize("micro", ["µ".encode("latin-1"), "µ".encode(), "μ".encode(), b"\xe6"])
def test_a_sur_states_micrometres_in_any_coding(tmp_path, heights, micro):
    """Latin-1, UTF-8, the Greek letter in UTF-8, and that of MS-DOS."""
    path = tmp_path / "a.sur"
    write_sur(path, heights, (DY, DX))
    content = path.read_bytes()
    unit = b"\xb5m".ljust(16, b"\0")
    assert content.count(unit) == 2
    path.write_bytes(content.replace(unit, (micro + b"m").ljust(16, b"\0")))
    scan = read_scan(path)
    np.testing.assert_allclose(scan.values, heights, atol=2e-9)
    assert spacing_of(scan) == pytest.approx((DY, DX), rel=1e-6)


# --- The stage ----------------------------------------------------------------------------------


@pytest.mark.parametrize("write", [write_plu_at, write_x3p, write_sur])
def test_where_the_stage_stood_is_read_in_mm(tmp_path, heights, write):
    path = tmp_path / f"a.{write.__name__.split('_')[1]}"
    for stage_mm in ((-58.2, 0.125), (-58.2, 0.0), (0.0, 0.125)):
        write(path, heights, (DY, DX), stage_mm=stage_mm)
        assert stage_of(read_scan(path)) == pytest.approx(stage_mm, rel=1e-6)
    write(path, heights, (DY, DX), stage_mm=(0, 0))  # as where it is not known
    assert stage_of(read_scan(path)) is None


def test_an_offset_in_one_of_two_units_is_no_place(tmp_path, heights):
    write_sur(tmp_path / "a.sur", heights, (DY, DX), stage_mm=(2.0, 1.0))
    content = (tmp_path / "a.sur").read_bytes()
    # steps along x in mm, x itself in µm
    other = content[:228] + b"\xb5m".ljust(16, b"\0") + content[244:]
    (tmp_path / "a.sur").write_bytes(other)
    assert stage_of(read_scan(tmp_path / "a.sur")) is None


# --- Pieces of scans ----------------------------------------------------------------------------

SCAN = make_surface(np.arange(30.0 * 40).reshape(30, 40), 0.1, file="map.plu")


def test_a_piece_that_sticks_out_and_a_scan_of_another_size_are_refused():
    with pytest.raises(InputError, match=r"map\.plu: .*x = 0, y = 1\.4 mm sticks out by 0\.4"):
        cut_scan(SCAN, centre=(1.4, 0), size_mm=1.0)
    with pytest.raises(InputError, match=r"map\.plu: the scan is 4 × 3 mm.*3 × 3"):
        cut_scan(SCAN, None, 3.0)
    assert cut_scan(SCAN[:, :30], None, 3.0).equals(SCAN[:, :30])


def test_a_unit_that_the_file_states_is_not_the_config_s(tmp_path):
    """Heights of a metre are in a wrong unit, whoever states it."""
    tall = np.random.default_rng(1).normal(size=(8, 8)) * 1e3
    write_plu(tmp_path / "a.plu", tall, 1e-3)
    np.savetxt(tmp_path / "a.csv", tall, delimiter=",")
    for name, stated in (("a.plu", True), ("a.csv", False)):
        with pytest.raises(InputError) as refused:
            read_scan(tmp_path / name, unit="mm", spacing_um=1.0)
        assert refused.value.remedy.startswith("Check scans.unit") != stated
