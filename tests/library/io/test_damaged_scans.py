"""Scans that are damaged: refused with a reason, or read as a plausible surface."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from numpy.testing import assert_allclose
from scan_files import CONFIG, FORMATS, HEIGHTS, damaged, lines_of, refused, write_sur

from gstlib.errors import InputError
from gstlib.io.plu import write_plu
from gstlib.io.scans import read_scan
from gstlib.surfaces.grid import spacing_of

UNMEASURED = 1000001.0  # in a .plu
each_format = pytest.mark.parametrize("name", FORMATS)


@pytest.fixture
def rough():
    return np.random.default_rng(2).normal(size=(20, 30)) * 1e-3


# --- Bytes that are missing, added or lost ------------------------------------------------------


@each_format
def test_a_cut_file_is_refused(sample, name):
    path, options = sample(name)
    content = path.read_bytes()
    for length in (0, 1, 40, len(content) // 2, len(content) - 60):
        path.write_bytes(content[:length])
        refused(path, **options)


@pytest.mark.parametrize("start_of_rest", [901, 860])
@pytest.mark.parametrize("is_stated", [True, False])
def test_plu_with_bytes_missing_or_added(sample, rough, start_of_rest, is_stated):
    """What stands behind the heights is then not their lowest and highest, or the mark of none."""
    path, _ = sample("plu", rough)
    content = path.read_bytes()
    if not is_stated:  # as in measured files
        content = content[:-8] + struct.pack("<2f", -UNMEASURED, UNMEASURED)
    content += bytes(300)  # a picture follows
    path.write_bytes(content)
    assert_allclose(read_scan(path), rough, rtol=1e-6)
    path.write_bytes(content[:900] + content[start_of_rest:])
    refused(path, "holds heights from .* but states .* damaged")


ADDED = [
    (70, b"\1"),  # in the header
    (900, b"7" * 8),
    (-1, bytes(400)),
]


@pytest.mark.parametrize("name", ["sur", "sur, compressed", "sdf"])
@pytest.mark.parametrize(("place", "new"), ADDED)
def test_bytes_added_to_a_binary_file(sample, rough, name, place, new):
    """What stands behind the heights is then no further object, and no text."""
    path, _ = sample(name, rough)
    content = path.read_bytes()
    path.write_bytes(content[:place] + new + content[place:])
    refused(path)
    path.write_bytes(content + new)
    refused(path, f"{len(new)} unexpected bytes follow its heights")


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("sur", b"DIGITAL SURF and a further object"),
        ("sdf", b"\n< OperatorName > Tom Jones < / OperatorName >\n*"),
    ],
)
def test_what_may_follow_heights_is_read_over(sample, rough, name, more):
    path, _ = sample(name, rough)
    path.write_bytes(path.read_bytes() + more)
    assert_allclose(read_scan(path), rough, atol=2e-9)


@pytest.mark.parametrize(("at", "change"), [(100, 1), (104, -2)])
def test_a_sur_with_heights_beyond_those_that_it_states(sample, rough, at, change):
    """Unmeasured heights are 2 below the lowest (at byte 100), saturated 1 above the highest."""
    rough[3, 4] = math.nan
    path, _ = sample("sur", rough)
    content = bytearray(path.read_bytes())
    (stated,) = struct.unpack_from("<i", content, at)
    struct.pack_into("<i", content, at, stated + change)
    path.write_bytes(content)
    refused(path, "holds heights from .* but states .* damaged")


@pytest.mark.parametrize(("first", "count"), [(40, 15), (40, 200)])
def test_a_lost_block_is_not_read_as_heights(sample, rough, first, count):
    """Zeros in one row through the file, from within a line of the map to within another."""
    rough.flat[first : first + count] = 0
    path, _ = sample("sdf", rough)
    refused(path, f"{count} consecutive heights, from number {first + 1} on, are 0")


ZEROS = {
    "whole lines": np.s_[4:6],
    "a spot": np.s_[3:9, 4:16],
    "a few points": np.s_[5, 3:12],
    "flat ground": np.s_[:, :28],
}


@pytest.mark.parametrize("zeros", ZEROS.values(), ids=ZEROS)
def test_zeros_that_a_lost_block_does_not_leave_are_read(sample, rough, zeros):
    rough[zeros] = 0
    path, _ = sample("plu", rough)
    assert_allclose(read_scan(path), rough, rtol=1e-6)


# --- Text ---------------------------------------------------------------------------------------


def test_numbers_that_lost_digits_or_were_given_some(write):
    """All are written with as many decimals, but the one that is damaged."""
    text = lines_of(np.random.default_rng(2).normal(size=(40, 30)))
    number = text.split(",")[280]
    read_scan(write("a.csv", text), **CONFIG)
    for odd in (number[:-1], number + "3"):
        damaged = write("a.csv", text.replace(number, odd))
        refused(damaged, "of its numbers have 4 decimals, and 1 others", **CONFIG)


PLACES = np.arange(35).reshape(5, 7)


@pytest.mark.parametrize("order", [PLACES, PLACES.T, PLACES[:, ::-1]])
def test_points_that_end_within_a_line_of_the_grid(sample, order):
    """Nothing else is missing: the file is cut, whatever way its points run."""
    path, options = sample("xyz", np.nan_to_num(HEIGHTS))
    lines = np.array(path.read_text().splitlines(keepends=True))[order.ravel()]
    path.write_text("".join(np.delete(lines, 12)))  # one that is not measured
    assert np.isnan(read_scan(path, **options)).sum() == 1
    path.write_text("".join(lines)[:-4])
    refused(path, "ends within a line", **options)
    path.write_text("".join(lines[:-3]))
    refused(path, "the last line of its grid .*cut", **options)


# --- Maps that nobody can have measured ---------------------------------------------------------


def test_a_picture_or_a_profile_is_not_read_as_a_map(sample):
    path, _ = sample("plu")
    content = bytearray(path.read_bytes())
    content[428] = 1
    path.write_bytes(content)
    refused(path, "type 1 with 5 × 7 points: not a .plu topography")
    write_sur(path.with_suffix(".sur"), HEIGHTS, kind=12)
    refused(path.with_suffix(".sur"), "does not contain a map of heights")


@each_format
def test_nothing_measured_and_one_row_are_no_map(sample, name):
    path, options = sample(name, math.nan * HEIGHTS)
    refused(path, "no point is measured|row of numbers|is empty", **options)
    sample(name, np.nan_to_num(HEIGHTS).reshape(1, -1))
    refused(path, **options)


ABSURD = [(1e-7, 1.0), (math.nan, 1.0), (-1e-3, 1.0), (0.4, 1.0), (1e-3, 1e4)]


@pytest.mark.parametrize(("spacing", "factor"), ABSURD)
def test_absurd_sizes_are_of_a_wrong_unit(tmp_path, spacing, factor):
    """Fields above 50 mm, points below 1 nm or above 0.5 mm apart, and heights over 10 mm."""
    tiled = np.tile(HEIGHTS * factor, (20, 20))  # 140 points along x
    write_plu(tmp_path / "a.plu", tiled, spacing)
    refused(tmp_path / "a.plu", "its unit is wrong.*The unit is in the file")


@pytest.mark.parametrize("name", ["a.al3d", "a.bin", "a.hgt", "a.nms"])
def test_unknown_content(write, name):
    # as many bytes as a square map of 16-bit heights has: one format has no other mark
    path = write(name, "what no instrument wrote" * 192)
    refused(path, "cannot be read as a height map", **CONFIG)
    refused(path.with_stem("no"), "no such file")


# --- Anything -----------------------------------------------------------------------------------


@each_format
def test_whatever_happens_to_a_file(sample, name):
    path, options = sample(name)
    content = path.read_bytes()

    @settings(max_examples=15, derandomize=True, database=None, deadline=None)
    @given(damaged(content))
    def check(other):
        path.write_bytes(other)
        try:
            scan = read_scan(path, **options)
        except InputError:
            return
        dy, dx = spacing_of(scan)
        assert 1e-6 <= min(dy, dx) <= max(dy, dx) <= 0.5
        assert max(scan.shape[0] * dy, scan.shape[1] * dx) <= 50
        assert not np.isinf(scan).any()
        assert scan.max() - scan.min() <= 10
        assert "\0" not in "".join(scan.attrs.values())

    check()
