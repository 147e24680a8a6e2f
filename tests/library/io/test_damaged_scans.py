"""Scans that are damaged: refused with a reason, or read as a plausible surface."""

import io
import math
import struct
import zipfile

import numpy as np
import pytest
from gstlib.errors import InputError
from gstlib.io.plu import PLU_UNMEASURED_UM, write_plu
from gstlib.io.scans import read_scan
from gstlib.surfaces.grid import spacing_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scan_files import FORMATS, refused, write_sur, zipped

SPACING = (1.66e-3, 0.83e-3)
each_format = pytest.mark.parametrize("name", FORMATS)


def _read(path, sample):
    return read_scan(path, **sample.options(1e-3))


def _written(folder, name, heights, spacing=SPACING):
    sample = FORMATS[name]
    path = folder / f"a{sample.ending}"
    sample.write(path, heights, spacing)
    return path, sample


@each_format
def test_truncated(tmp_path, heights, name):
    path, sample = _written(tmp_path, name, heights)
    content = path.read_bytes()
    for length in (0, 1, 4, 40, len(content) // 2, len(content) - 60):
        path.write_bytes(content[:length])
        cut = "is empty|bytes are less than a .plu header|take 656 bytes, but the file has"
        refused(path, cut if sample.ending == ".plu" else None, **sample.options(1e-3))


@pytest.mark.parametrize("unmeasured", [True, False])
@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content[:900] + content[901:],
        lambda content: content[:900] + content[940:],
        lambda content: content[:900] + b"\1" + content[900:],
        lambda content: content[:900] + content[860:],
        lambda content: content[:508] + content[504:],
    ],
)
def test_plu_with_bytes_missing_or_added(tmp_path, damage, unmeasured):
    """What stands behind the heights is then not their lowest and highest, or the mark of none."""
    path, heights = tmp_path / "a.plu", np.random.default_rng(2).normal(size=(20, 30)) * 1e-3
    heights[10, 5:9] = math.nan if unmeasured else 0
    write_plu(path, heights, SPACING)
    content = path.read_bytes() + bytes(300)  # a picture follows
    mark, end = PLU_UNMEASURED_UM, len(content) - 308
    for ends in ("stated", (-mark, mark), (mark, mark)):  # as in measured files
        if ends != "stated":
            content = content[:end] + struct.pack("<2f", *ends) + content[end + 8 :]
        path.write_bytes(content)
        np.testing.assert_allclose(read_scan(path).values, heights, rtol=1e-6)
        path.write_bytes(damage(content))
        refused(path, "holds heights from .* but states .* damaged")


@pytest.mark.parametrize(
    ("order", "kept"),
    [
        (slice(None), -1),
        (slice(None, None, -1), -3),
        (np.arange(35).reshape(5, 7).T.ravel(), -1),
        (np.arange(35).reshape(5, 7)[:, ::-1].ravel(), -4),
    ],
)
def test_points_that_end_within_a_line_of_the_grid(tmp_path, heights, order, kept):
    """Nothing else is missing: the file is cut, whatever way its points run."""
    path = tmp_path / "a.xyz"
    FORMATS["xyz"].write(path, np.nan_to_num(heights), SPACING)
    lines = np.array(path.read_text().splitlines(keepends=True))[order]
    path.write_text("".join(lines))
    assert np.isfinite(_read(path, FORMATS["xyz"]).values).all()
    path.write_text("".join(lines[:kept]))
    refused(path, "the last line of its grid .*cut", unit="um")
    path.write_text("".join(np.delete(lines, 12)))  # one that is not measured
    assert np.isnan(_read(path, FORMATS["xyz"]).values).sum() == 1


def test_points_with_a_line_cut_or_joined(tmp_path, heights):
    path = tmp_path / "a.xyz"
    FORMATS["xyz"].write(path, heights, SPACING)
    whole = path.read_text()
    path.write_text(whole[:-4])
    refused(path, "ends within a line", unit="um")
    path.write_text(whole.replace("\n", " ", 1))
    refused(path, "rows of 6 and of 3 cells", unit="um")


@each_format
def test_content_of_another_format(tmp_path, heights, name):
    path, sample = _written(tmp_path, name, heights)
    text = {".csv", ".txt", ".asc", ".xyz"}
    for other in {f.ending for f in FORMATS.values()} - {sample.ending}:
        if not {other, sample.ending} <= text:
            (tmp_path / f"b{other}").write_bytes(path.read_bytes())
            refused(tmp_path / f"b{other}", unit="um", spacing_um=1.0)


@pytest.mark.parametrize("claim", [(2**31 - 1, 2**31 - 1), (5, 8), (0, 7)])
def test_header_that_announces_another_shape(tmp_path, heights, claim):
    write_sur(tmp_path / "a.sur", heights, SPACING, claim=claim)
    refused(tmp_path / "a.sur")
    path, _ = _written(tmp_path, "plu", heights)
    content = bytearray(path.read_bytes())
    struct.pack_into("<2I", content, 500, *claim)
    path.write_bytes(content)
    refused(path, "truncated|not a .plu")


def test_a_picture_is_not_read_as_heights(tmp_path, heights):
    write_sur(tmp_path / "a.sur", heights, SPACING, kind=12)
    refused(tmp_path / "a.sur", "holds no map of heights")


@each_format
def test_nothing_measured_flat_and_infinite(tmp_path, heights, name):
    path, sample = _written(tmp_path, name, np.full_like(heights, math.nan))
    refused(path, "not one point|no row|is empty", **sample.options(1e-3))
    path, sample = _written(tmp_path, name, np.full_like(heights, 0.001))
    assert np.ptp(_read(path, sample).values) == pytest.approx(0, abs=1e-12)
    if name.partition(",")[0] not in ("plu", "sur"):  # which cannot hold it
        heights[2, 3], heights[3, 2] = math.inf, -math.inf
        path, sample = _written(tmp_path, name, heights)
        assert np.isnan(_read(path, sample).values).sum() == 3


@each_format
@pytest.mark.parametrize("shape", [(1, -1), (-1, 1)])
def test_single_row_or_column(tmp_path, heights, name, shape):
    path, sample = _written(tmp_path, name, np.nan_to_num(heights).reshape(shape))
    refused(path, **sample.options(1e-3))


@pytest.mark.parametrize(
    ("spacing", "factor"),
    [*((step, 1.0) for step in (10.0, 1e-7, -1e-3, 0.0, math.nan, 1e30)), (1e-3, 1e4), (0.4, 1.0)],
)
def test_absurd_sizes(tmp_path, heights, spacing, factor):
    """A field of 50 mm, points 1 nm or 0.5 mm apart, heights over 10 mm: the unit is wrong."""
    path = tmp_path / "a.plu"
    tiled = np.tile(heights * factor, (20, 20))  # 140 points along x
    write_plu(path, tiled, spacing)
    refused(path, "its unit is wrong")


def test_a_profile_is_no_map(tmp_path, heights):
    refused(tmp_path / "a.plu", "no such file")
    path, _ = _written(tmp_path, "plu", heights)
    content = path.read_bytes()
    path.write_bytes(content[:428] + struct.pack("<I", 1) + content[432:])
    refused(path, "type 1 with 5 × 7 points: not a .plu topography")


@pytest.mark.parametrize("name", ["a.al3d", "a.bin", "noending", "a.hgt", "a.nms"])
def test_unknown_content(tmp_path, name):
    # as many bytes as a square map of 16-bit heights has: one format has no other mark
    (tmp_path / name).write_bytes(b"what no instrument wrote" * 3 * 4**3)
    said = "ending '.nms' is unknown.*.sur" if name == "a.nms" else "cannot be read as a height map"
    refused(tmp_path / name, said, unit="um", spacing_um=1.0)


# 32-bit words that mean trouble: extreme integers, infinity and NaN
WORDS = [struct.pack("<I", n) for n in (0, 1, 2**16, 2**31 - 1, 2**31, 2**32 - 1)] + [
    struct.pack("<f", value) for value in (math.nan, math.inf, -1.0, 1e-40, 1e30)
]
TEXTS = [b"nan", b"inf", b"-1", b"0", b"1e999", b"99999999999", b"\0", b",", b"\n", b"#", b"<a>"]


@st.composite
def damaged(draw, content):
    """A file after an accident; of an archive, to a member, which a checksum would protect."""
    if content.startswith(b"PK"):
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = {name: archive.read(name) for name in archive.namelist()}
        name = draw(st.sampled_from(sorted(members)))
        return zipped(members | {name: draw(damaged(members[name]))}, zipfile.ZIP_STORED)
    place = draw(st.integers(0, min(len(content), 600)) | st.integers(0, len(content)))
    lost = draw(st.sampled_from([0, 1, 4, 400, len(content)]))
    new = draw(st.sampled_from([b"", bytes(400), *WORDS, *TEXTS]) | st.binary(max_size=9))
    return content[:place] + new + content[place + lost :]


@each_format
def test_whatever_happens_to_a_file(tmp_path, heights, name):
    path, sample = _written(tmp_path, name, heights)
    content = path.read_bytes()

    @settings(max_examples=25, derandomize=True, database=None, deadline=None)
    @given(damaged(content))
    def check(damaged):
        path.write_bytes(damaged)
        try:
            scan = _read(path, sample)
        except InputError:
            return
        dy, dx = spacing_of(scan)
        assert min(scan.shape) >= 2
        assert 1e-6 <= min(dy, dx) <= max(dy, dx) <= 0.5
        assert max(scan.shape[0] * dy, scan.shape[1] * dx) <= 50
        assert not np.isinf(scan.values).any()
        assert np.nanmax(scan.values) - np.nanmin(scan.values) <= 10
        assert all(isinstance(value, str) and "\0" not in value for value in scan.attrs.values())

    check()
