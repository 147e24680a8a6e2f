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
        refused(path, **sample.options(1e-3))


@pytest.mark.parametrize("unmeasured", [True, False])
@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content[:900] + content[901:],
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


BINARY = ["sur", "sur, compressed", "sdf"]


@pytest.fixture
def rough():
    return np.random.default_rng(2).normal(size=(20, 30)) * 1e-3


@pytest.mark.parametrize("name", BINARY)
@pytest.mark.parametrize("place", [70, 900, -1])
@pytest.mark.parametrize("new", [b"\1", b"7" * 8, bytes(400)])
def test_bytes_added_to_a_binary_file(tmp_path, rough, name, place, new):
    """What stands behind the heights is then no further object, and no text."""
    path, _ = _written(tmp_path, name, rough)
    content = path.read_bytes()
    path.write_bytes(content[:place] + new + content[place:])
    refused(path)
    path.write_bytes(content + new)
    refused(path, f"{len(new)} bytes stand behind its heights that cannot follow them")


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("sur", b"DIGITAL SURF and a further object"),
        ("sur, compressed", b"DSCOMPRESSED and a further object"),
        ("sdf", b"\r\n"),
        ("sdf", b"\n< OperatorName > Tom Jones < / OperatorName >\n*"),
    ],
)
def test_what_may_follow_heights_is_read_over(tmp_path, rough, name, more):
    path, sample = _written(tmp_path, name, rough)
    path.write_bytes(path.read_bytes() + more)
    np.testing.assert_allclose(_read(path, sample).values, rough, atol=2e-9)


@pytest.mark.parametrize("name", BINARY[:2])
@pytest.mark.parametrize(("at", "may_be", "is_wrong"), [(100, 0, 1), (104, -1, -2)])
def test_a_sur_with_heights_beyond_those_that_it_states(
    tmp_path, rough, name, at, may_be, is_wrong
):
    """Unmeasured heights are 2 below the lowest (at byte 100), saturated 1 above the highest."""
    rough[3, 4] = math.nan
    path, sample = _written(tmp_path, name, rough)
    content = bytearray(path.read_bytes())
    (stated,) = struct.unpack_from("<i", content, at)
    for change in (may_be, is_wrong):
        struct.pack_into("<i", content, at, stated + change)
        path.write_bytes(content)
        if change == may_be:
            np.testing.assert_allclose(_read(path, sample).values, rough, atol=2e-9)
        else:
            refused(path, "holds heights from .* but states .* damaged")


def test_a_compressed_sur_that_does_not_unpack_to_what_it_states(tmp_path, rough):
    path, _ = _written(tmp_path, "sur, compressed", rough)
    content, start = path.read_bytes(), 512 + len(b"a comment")
    for at, change in ((start + 4, 4), (start + 4, -4), (len(content) - 1, 1)):
        damaged = bytearray(content)  # the size of the heights, or their checksum
        damaged[at] = (damaged[at] + change) % 256
        path.write_bytes(damaged)
        refused(path, "do not unpack to|incorrect data check")
    packed = len(content) - start - 12
    path.write_bytes(
        content[: start + 8] + struct.pack("<I", packed - 4) + content[start + 12 : -4]
    )
    refused(path, "do not unpack to")  # without its checksum


@pytest.mark.parametrize("name", ["plu", *BINARY])
def test_a_lost_block_is_not_read_as_heights(tmp_path, rough, name):
    """Zeros in one row through the file, from within a line of the map to within another."""
    for first, count in ((40, 15), (40, 200), (400, 200)):
        damaged = rough.ravel().copy()
        damaged[first : first + count] = 0
        path, _ = _written(tmp_path, name, damaged.reshape(rough.shape))
        refused(path, f"{count} heights one behind the other, from number {first + 1} on, are 0")


def test_zeros_that_a_lost_block_does_not_leave_are_read(tmp_path, rough):
    """Whole lines, unmeasured spots, a few points, flat ground, and a plane with a spike."""
    for part, value in (
        (np.s_[4:6], 0),
        (np.s_[3:9, 4:16], 0),
        (np.s_[5, 3:12], 0),
        (np.s_[7, 2:28], 1e-3),
        (np.s_[:], [*28 * [0], 1, 0]),
        (np.s_[:17], 0),
    ):
        heights = rough.copy()
        heights[part] = value
        path, sample = _written(tmp_path, "plu", heights)
        np.testing.assert_allclose(_read(path, sample).values, heights, rtol=1e-6)


@pytest.mark.parametrize("name", ["xyz", "csv", "csv, decimal commas"])
def test_numbers_that_lost_digits_or_were_given_some(tmp_path, name):
    """All are written with as many decimals, but the one that is damaged."""
    heights = np.random.default_rng(2).normal(size=(40, 30)).round(4)
    sample = FORMATS[name]
    path = tmp_path / f"a{sample.ending}"
    if name == "xyz":
        y, x = np.indices(heights.shape)
        rows, mark = np.column_stack([x.ravel(), y.ravel(), heights.ravel()]), " "
    else:
        rows, mark = heights, "," if name == "csv" else ";"
    np.savetxt(path, rows, fmt="%.4f", delimiter=mark)
    text = path.read_text().replace(".", "," if mark == ";" else ".")
    number = f"{heights[7, 9]:.4f}".replace(".", "," if mark == ";" else ".")
    assert text.count(number) == 1
    for written in (text, text.replace(number, "NaN")):
        path.write_text(written)
        _read(path, sample)
    for odd in (number[:-1], number + "3"):
        path.write_text(text.replace(number, odd))
        refused(path, "of its numbers have 4 decimals, and 1 others", **sample.options(1e-3))


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


def test_points_that_end_within_a_line_of_a_grid_with_gaps(tmp_path):
    """Elsewhere up to three of them are missing in a row, and at the end more than six."""
    path = tmp_path / "a.xyz"
    heights = np.random.default_rng(2).normal(size=(12, 20)) * 1e-3
    heights[3, 4:7] = heights[8, 9] = heights[9, 3:5] = math.nan
    for unmeasured, cut in ((3, False), (6, False), (7, True), (15, True)):
        heights[-1, 13:] = 1e-3
        heights[-1, 20 - unmeasured :] = math.nan
        FORMATS["xyz"].write(path, heights, SPACING)
        if cut:
            refused(path, f"lacks {unmeasured} of 20 points, and elsewhere at most 3", unit="um")
        else:
            scan = _read(path, FORMATS["xyz"])
            assert np.isnan(scan.values).sum() == 6 + unmeasured


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
