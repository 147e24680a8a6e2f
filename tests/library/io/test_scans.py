"""Scans: orientation, spacing and unmeasured points as in the file; bad text is refused."""

import math
import zipfile

import numpy as np
import pytest
import scipy.io
import xarray as xr
from numpy.testing import assert_allclose, assert_array_equal
from scan_files import (
    CONFIG,
    FORMATS,
    HEIGHTS,
    SPACING,
    STEP,
    lines_of,
    members_of,
    refused,
    replaced,
    write_plu_at,
    write_sur,
    write_x3p,
    zipped,
)

from gstlib.io.plu import write_plu
from gstlib.io.scans import read_scan
from gstlib.io.stage import stage_of
from gstlib.surfaces.grid import spacing_of

DESCRIBED = {
    "plu": {"objective": "Leica HC PL Fluotar EPI 10X"},
    "plux": {"instrument": "S neox"},
    "sur": {"instrument": "a profiler"},
    "x3p": {"instrument": "a profiler"},
}


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_gives_the_same_surface(sample, name):
    path, options = sample(name)
    scan = read_scan(path, **options)
    assert scan.dims == ("y", "x")
    assert_allclose(scan, HEIGHTS, atol=2e-9)  # NaN where NaN
    spacing = (STEP / 1e3, STEP / 1e3) if options == CONFIG else SPACING
    assert spacing_of(scan) == pytest.approx(spacing, rel=1e-6)
    assert DESCRIBED.get(name, {}).items() <= scan.attrs.items()


def test_a_plu_is_read_back_by_the_library_that_reads_the_instruments_own(tmp_path):
    from SurfaceTopography import read_topography

    write_plu(tmp_path / "a.plu", HEIGHTS, SPACING)
    topography = read_topography(str(tmp_path / "a.plu"))
    # in µm, masked where unmeasured: the library has them as [x, y]
    stored = np.ma.filled(topography.heights().astype(float), math.nan).T
    assert_array_equal(stored, (HEIGHTS * 1e3).astype(np.float32))
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
def test_an_array_has_the_rows_of_the_map_and_is_the_only_one(tmp_path, ending):
    path = tmp_path / f"a.{ending}"
    SAVE[ending](path, {"z": HEIGHTS})
    assert_allclose(1e3 * read_scan(path, **CONFIG), HEIGHTS)
    if ending != "npy":
        several = path.with_stem("b")
        SAVE[ending](several, {"x": HEIGHTS, "z": HEIGHTS})
        refused(several, "2 arrays", **CONFIG)


# --- x3p ----------------------------------------------------------------------------------------


@pytest.fixture
def rewritten(tmp_path):
    """An .x3p of the heights with texts of its index and names of its members changed."""

    def rewritten(*changes, rename=str, **members):
        path = tmp_path / "a.x3p"
        write_x3p(path, HEIGHTS)
        content = members_of(path)
        content["main.xml"] = replaced(content["main.xml"].decode(), *changes)
        content |= {f"bindata/{name}.bin": values for name, values in members.items()}
        path.write_bytes(zipped({rename(name): data for name, data in content.items()}))
        return path

    return rewritten


HEIGHT_AXIS = (
    "<AxisType>A</AxisType><DataType>D</DataType>"
    "<Increment>1.0</Increment><Offset>0.0</Offset>"
)
VALID = (
    "</PointDataLink>",
    "</PointDataLink><ValidPointsLink>bindata/valid.bin</ValidPointsLink>",
)
LINK = "<DataLink><PointDataLink>bindata/data.bin</PointDataLink></DataLink>"


def test_x3p_is_read_however_it_was_written(rewritten):
    """In a folder, by a program for Windows, with a date of no standard and an empty offset."""
    path = rewritten(
        ("2021-04-19T11:40:13", "23 Sep 2009"),
        ("<Offset>0.0</Offset>", "<Offset/>"),
        rename=lambda name: f"./Land/{name}".replace("/", "\\"),
    )
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("Land/bindata/", "")
        archive.writestr("__MACOSX/land/._main.xml", b"\0\5\x16\7")
    scan = read_scan(path)
    assert_allclose(scan, HEIGHTS)
    assert "acquired" not in scan.attrs


def test_x3p_with_its_heights_in_the_index(rewritten):
    column = HEIGHTS.reshape(-1, 1) / 1e3
    listed = lines_of(column, cell="<Datum> {} </Datum>", unmeasured="<Datum/>")
    path = rewritten((LINK, f"<DataList>{listed}</DataList>"))
    assert_allclose(read_scan(path), HEIGHTS)


def test_x3p_in_steps(rewritten):
    """A height is the offset and the increment times a step; a mask says which are measured."""
    steps = np.nan_to_num(np.round((HEIGHTS / 1e3 - 5e-6) / 1e-9))
    valid = ~np.isnan(HEIGHTS)
    valid[0] = False
    axis = HEIGHT_AXIS.replace("D<", "I<").replace("1.0", "1e-9").replace("0.0", "5e-6")
    path = rewritten(
        (HEIGHT_AXIS, axis),
        VALID,
        data=steps.astype("<i2").tobytes(),
        valid=np.packbits(valid, bitorder="little").tobytes(),
    )
    expected = np.where(valid, HEIGHTS, math.nan)
    assert_allclose(read_scan(path), expected, atol=0.51e-6)


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
def test_x3p_that_cannot_be_right_is_refused(rewritten, changes, members):
    refused(rewritten(*changes, **members))


# --- Heights that stand for unmeasured points ---------------------------------------------------


@pytest.fixture
def read_back(write):
    """The heights (µm) of a text of heights."""

    def read_back(heights_um):
        path = write("a.csv", lines_of(heights_um, cell="{:.17g}"))
        return 1e3 * read_scan(path, **CONFIG)

    return read_back


# Like a scan in `.frt`: at 73 to 82 µm, with lone spikes.
SPIKY = 77 + np.random.default_rng(1).normal(size=(60, 50))
SPIKY[[7, 20, 21], [8, 30, 30]] = -0.3, 16.0, 305.0


@pytest.mark.parametrize(("mark", "points"), [(0.0, 10), (-9999.0, 300)])
def test_a_height_far_from_the_others_is_unmeasured(read_back, caplog, mark, points):
    order = np.random.default_rng(2).permutation(SPIKY.size)
    held = order.reshape(SPIKY.shape) < points
    measured = read_back(np.where(held, mark, SPIKY))
    assert_allclose(measured, np.where(held, math.nan, SPIKY))
    assert f"a.csv: {points} points" in caplog.text


def test_a_height_of_few_points_in_steps_or_among_the_others_is_measured(
    read_back, caplog
):
    spikes = SPIKY.copy()
    spikes[40, :9] = 0.0  # they are left to the outlier rule
    two_levels = np.where(SPIKY > 78, 78.0, 60.0)
    for heights in (spikes, two_levels, np.round(SPIKY)):
        assert_allclose(read_back(heights), heights)
    assert caplog.messages == []
    clipped = np.maximum(SPIKY, 76.0)
    assert_allclose(read_back(clipped), clipped)
    assert "16.4 % of the points" in caplog.text


# --- Points, matrices and grids in text ---------------------------------------------------------


def test_scattered_points_are_refused(write):
    points = write("a.xyz", lines_of(np.random.default_rng(3).uniform(size=(50, 3))))
    refused(points, "50 points are scattered.*Gwyddion", unit="um")
    refused(points, "unknown scan unit", unit="parsec")


ESRI = "NCOLS 4\nNROWS 3\nXLLCENTER 0\nYLLCENTER 0\nCELLSIZE {cell}\n{rows}"
ROWS = "9 8 7 6\n5 -9999 4 3\n2 1 0 1\n"


def test_an_esri_grid_begins_with_its_highest_y(write):
    path = write("a.asc", ESRI.format(cell="1,5", rows=ROWS))
    scan = read_scan(path, unit="um")
    expected = [[2, 1, 0, 1], [5, math.nan, 4, 3], [9, 8, 7, 6]]
    assert_allclose(1e3 * scan, expected)
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
def test_a_text_that_is_no_scan_is_refused(write, name, text, match):
    refused(write(name, text), match, **CONFIG)


# --- The stage ----------------------------------------------------------------------------------


@pytest.mark.parametrize("write", [write_plu_at, write_x3p, write_sur])
def test_where_the_stage_stood_is_read_in_mm(tmp_path, write):
    path = tmp_path / f"a.{write.__name__.split('_')[1]}"
    write(path, HEIGHTS, stage_mm=(-58.2, 0.125))
    assert stage_of(read_scan(path)) == pytest.approx((-58.2, 0.125), rel=1e-6)
    write(path, HEIGHTS)  # as where it is not known
    assert stage_of(read_scan(path)) is None
