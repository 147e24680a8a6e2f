"""Scans: orientation, spacing and unmeasured points as in the file; bad text is refused."""

import math
import zipfile

import numpy as np
import pytest
import scipy.io
import xarray as xr
from scan_files import (
    FORMATS,
    members_of,
    refused,
    write_plu_at,
    write_sur,
    write_x3p,
    zipped,
)

from gstlib.errors import InputError
from gstlib.io.plu import write_plu
from gstlib.io.scans import cut_scan, read_scan
from gstlib.io.stage import stage_of
from gstlib.surfaces.grid import make_surface, spacing_of

DY, DX = 1.66e-3, 0.83e-3
NAN = math.nan


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
    assert sample.attrs.items() <= scan.attrs.items()


def test_a_plu_is_read_back_by_the_library_that_reads_the_instruments_own(
    tmp_path, heights
):
    from SurfaceTopography import read_topography

    write_plu(tmp_path / "a.plu", heights, (DY, DX))
    topography = read_topography(str(tmp_path / "a.plu"))
    # in µm, masked where unmeasured: the library has them as [x, y]
    stored = np.ma.filled(topography.heights().astype(float), NAN).T
    np.testing.assert_array_equal(stored, (heights * 1e3).astype(np.float32))
    assert topography.physical_sizes == pytest.approx((7 * 0.83, 5 * 1.66))
    assert topography.unit == "µm"


SAVE = {
    "npy": lambda path, arrays: np.save(path, arrays["z"]),
    "npz": lambda path, arrays: np.savez(path, **arrays),
    "mat": scipy.io.savemat,
    "h5": lambda path, arrays: xr.Dataset(
        {name: (("y", "x"), values) for name, values in arrays.items()}
    ).to_netcdf(path, engine="h5netcdf"),
}


@pytest.mark.parametrize("ending", SAVE)
def test_an_array_has_the_rows_of_the_map_and_is_the_only_one(
    tmp_path, heights, ending
):
    path = tmp_path / f"a.{ending}"
    SAVE[ending](path, {"z": heights})
    scan = read_scan(path, unit="mm", spacing_um=1.0)
    np.testing.assert_array_equal(scan, heights)
    if ending != "npy":
        several = path.with_stem("b")
        SAVE[ending](several, {"x": heights, "z": heights})
        refused(several, "2 arrays", unit="mm", spacing_um=1.0)


# --- x3p ----------------------------------------------------------------------------------------


def rewritten_x3p(path, heights, changes=(), rename=str, **members):
    """An .x3p of these heights with texts of its index and names of its members changed."""
    write_x3p(path, heights, (DY, DX))
    content = members_of(path)
    index = content["main.xml"].decode()
    for old, new in changes:
        assert old in index
        index = index.replace(old, new)
    content |= {"main.xml": index.encode()}
    content |= {f"bindata/{name}.bin": values for name, values in members.items()}
    path.write_bytes(zipped({rename(name): data for name, data in content.items()}))


HEIGHT_AXIS = (
    "<AxisType>A</AxisType><DataType>D</DataType>"
    "<Increment>1.0</Increment><Offset>0.0</Offset>"
)
VALID = (
    "</PointDataLink>",
    "</PointDataLink><ValidPointsLink>bindata/valid.bin</ValidPointsLink>",
)
LINK = "<DataLink><PointDataLink>bindata/data.bin</PointDataLink></DataLink>"


def test_x3p_is_read_however_it_was_written(tmp_path, heights):
    """In a folder, by a program for Windows, with a date of no standard and an empty offset."""
    path = tmp_path / "a.x3p"
    changes = [
        ("2021-04-19T11:40:13", "23 Sep 2009"),
        ("<Offset>0.0</Offset>", "<Offset/>"),
    ]
    rewritten_x3p(
        path, heights, changes, lambda name: f"./Land/{name}".replace("/", "\\")
    )
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("Land/bindata/", "")
        archive.writestr("__MACOSX/land/._main.xml", b"\0\5\x16\7")
    scan = read_scan(path)
    np.testing.assert_allclose(scan.values, heights)
    assert "acquired" not in scan.attrs


def test_x3p_with_its_heights_in_the_index(tmp_path, heights):
    cells = [
        "" if np.isnan(height) else f" {height / 1e3} " for height in heights.ravel()
    ]
    listed = "".join(f"<Datum>{cell}</Datum>" for cell in cells)
    rewritten_x3p(
        tmp_path / "a.x3p", heights, [(LINK, f"<DataList>{listed}</DataList>")]
    )
    np.testing.assert_allclose(read_scan(tmp_path / "a.x3p").values, heights)


def test_x3p_in_steps(tmp_path, heights):
    """A height is the offset and the increment times a step; a mask says which are measured."""
    steps = np.nan_to_num(np.round((heights / 1e3 - 5e-6) / 1e-9))
    valid = ~np.isnan(heights)
    valid[0] = False
    axis = HEIGHT_AXIS.replace("D<", "I<").replace("1.0", "1e-9").replace("0.0", "5e-6")
    rewritten_x3p(
        tmp_path / "a.x3p",
        heights,
        [(HEIGHT_AXIS, axis), VALID],
        data=steps.astype("<i2").tobytes(),
        valid=np.packbits(valid, bitorder="little").tobytes(),
    )
    expected = np.where(valid, heights, np.nan)
    np.testing.assert_allclose(
        read_scan(tmp_path / "a.x3p").values, expected, atol=0.51e-6
    )


@pytest.mark.parametrize(
    ("changes", "members"),
    [
        ([VALID], {"valid": b"\xff"}),
        ([], {"data": bytes(8 * 36)}),
        ([("bindata/data.bin", "bindata/other.bin")], {}),
        ([(HEIGHT_AXIS, HEIGHT_AXIS.replace("1.0", "0"))], {}),
        ([("<FeatureType>SUR", "<FeatureType>PRF")], {}),
        ([("<Axes>", "<Axes><Rotation><r11>-1</r11></Rotation>")], {}),
    ],
)
def test_x3p_that_cannot_be_right_is_refused(tmp_path, heights, changes, members):
    rewritten_x3p(tmp_path / "a.x3p", heights, changes, **members)
    refused(tmp_path / "a.x3p")


# --- Heights that stand for unmeasured points ---------------------------------------------------


def read_heights(tmp_path, heights_um):
    np.savetxt(tmp_path / "a.csv", heights_um, fmt="%.17g", delimiter=",")
    return read_scan(tmp_path / "a.csv", unit="um", spacing_um=1.0).values * 1e3


@pytest.fixture
def spiky():
    """Like a scan in `.frt`: at 73 to 82 µm, with lone spikes."""
    heights = 77 + np.random.default_rng(1).normal(size=(60, 50))
    heights[7, 8] = -0.3
    heights[20, 30] = 16.0
    heights[21, 30] = 305.0
    return heights


@pytest.mark.parametrize(("mark", "points"), [(0.0, 10), (-9999.0, 300)])
def test_a_height_far_from_the_others_is_unmeasured(
    tmp_path, caplog, spiky, mark, points
):
    order = np.random.default_rng(2).permutation(spiky.size)
    held = order.reshape(spiky.shape) < points
    measured = read_heights(tmp_path, np.where(held, mark, spiky))
    np.testing.assert_allclose(measured, np.where(held, np.nan, spiky))
    assert f"a.csv: {points} points" in caplog.text


def test_a_height_of_few_points_in_steps_or_among_the_others_is_measured(
    tmp_path, caplog, spiky
):
    spikes = spiky.copy()
    spikes[40, :9] = 0.0  # they are left to the outlier rule
    two_levels = np.where(spiky > 78, 78.0, 60.0)
    for heights in (spikes, two_levels, np.round(spiky)):
        np.testing.assert_allclose(read_heights(tmp_path, heights), heights)
    assert caplog.messages == []
    clipped = np.maximum(spiky, 76.0)
    np.testing.assert_allclose(read_heights(tmp_path, clipped), clipped)
    assert "16.4 % of the points" in caplog.text


# --- Points, matrices and grids in text ---------------------------------------------------------


def test_scattered_points_are_refused(tmp_path):
    points = np.random.default_rng(3).uniform(size=(50, 3))
    np.savetxt(tmp_path / "a.xyz", points)
    refused(tmp_path / "a.xyz", "50 points are scattered.*Gwyddion", unit="um")
    refused(tmp_path / "a.xyz", "unknown scan unit", unit="parsec")


def test_unit_and_spacing_of_a_matrix_must_come_from_the_config(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("1,2,3,4\n5,6,7,8\n9,1,2,3\n")
    refused(path, "does not state its unit.*scans.unit", spacing_um=1.0)
    refused(path, "spacing of its points.*scans.spacing_um", unit="um")


def test_a_text_in_utf_16(tmp_path):
    text = "# Width: 4 µm\n# Height: 2 µm\n# Value units: nm\n1 2 3 4\n5 6 7 8\n"
    (tmp_path / "a.txt").write_text(text, encoding="utf-16")
    assert spacing_of(read_scan(tmp_path / "a.txt")) == (1e-3, 1e-3)


ESRI = "NCOLS 4\nNROWS 3\nXLLCENTER 0\nYLLCENTER 0\nCELLSIZE {cell}\n{rows}"
ROWS = "9 8 7 6\n5 -9999 4 3\n2 1 0 1\n"


def test_an_esri_grid_begins_with_its_highest_y(tmp_path):
    (tmp_path / "a.asc").write_text(ESRI.format(cell="1,5", rows=ROWS))
    scan = read_scan(tmp_path / "a.asc", unit="um")
    expected = np.array([[2, 1, 0, 1], [5, NAN, 4, 3], [9, 8, 7, 6]])
    np.testing.assert_allclose(1e3 * scan.values, expected)
    assert spacing_of(scan) == pytest.approx((1.5e-3, 1.5e-3))


@pytest.mark.parametrize(
    ("name", "text", "match"),
    [
        (
            "a.xyz",
            "# x y z\n1 2 3\n1 2 three\n",
            "from line 2 on, is not a table .*'three'",
        ),
        (
            "a.asc",
            ESRI.format(cell="0.01", rows=ROWS[:8]),
            "contains 1 rows of 4 .* states 3 of 4",
        ),
        ("a.asc", ESRI.format(cell="0.002", rows=ROWS), "different units"),
    ],
)
def test_a_text_that_is_no_scan_is_refused(tmp_path, name, text, match):
    (tmp_path / name).write_text(text)
    refused(
        tmp_path / name, match, unit="um", spacing_um=None if name == "a.xyz" else 1.0
    )


def test_a_sur_states_micrometres_in_another_coding(tmp_path, heights):
    """The sample is in Latin-1; this is the Greek letter in UTF-8."""
    write_sur(tmp_path / "a.sur", heights, (DY, DX))
    content = (tmp_path / "a.sur").read_bytes()
    assert content.count(b"\xb5m\0") == 2
    (tmp_path / "a.sur").write_bytes(content.replace(b"\xb5m\0", "μm".encode()))
    assert spacing_of(read_scan(tmp_path / "a.sur")) == pytest.approx((DY, DX))


# --- The stage ----------------------------------------------------------------------------------


@pytest.mark.parametrize("write", [write_plu_at, write_x3p, write_sur])
def test_where_the_stage_stood_is_read_in_mm(tmp_path, heights, write):
    path = tmp_path / f"a.{write.__name__.split('_')[1]}"
    write(path, heights, (DY, DX), stage_mm=(-58.2, 0.125))
    assert stage_of(read_scan(path)) == pytest.approx((-58.2, 0.125), rel=1e-6)
    write(path, heights, (DY, DX), stage_mm=(0, 0))  # as where it is not known
    assert stage_of(read_scan(path)) is None


# --- Pieces of scans ----------------------------------------------------------------------------


def test_a_whole_scan_has_the_size_of_a_patch():
    scan = make_surface(np.ones((30, 40)), 0.1, file="map.plu")
    with pytest.raises(InputError, match=r"map\.plu: the scan is 4 × 3 mm.*3 × 3"):
        cut_scan(scan, None, 3.0)
    assert cut_scan(scan[:, :30], None, 3.0).shape == (30, 30)
