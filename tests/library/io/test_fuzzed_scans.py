"""Whatever happens to the bytes of a scan: a plausible surface, or an error that says why not.

A few dozen cases a format here, always the same ones. For many, and other ones each time:

    GST_FUZZ_EXAMPLES=2000 python -m pytest -s tests/library/io/test_fuzzed_scans.py

which prints, for each format, the cases, how many were refused and read, the slowest and the
growth of the process.
"""

import io
import math
import os
import struct
import time
import zipfile

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scan_files import FORMATS, zipped

from gstlib.errors import InputError
from gstlib.io.scans import read_scan
from gstlib.surface import spacing_of

MANY = "GST_FUZZ_EXAMPLES" in os.environ
EXAMPLES = int(os.environ.get("GST_FUZZ_EXAMPLES", "40"))
SPACING = (1.66e-3, 0.83e-3)

# 32-bit words that mean trouble: extremes of integers, and floats that are none
WORDS = [0, 1, 2**16, 2**31 - 1, 2**31, 2**32 - 1, 2**32 - 2] + [
    struct.unpack("<I", struct.pack("<f", value))[0]
    for value in (math.nan, math.inf, -1.0, 1e-40, 1e30)
]
TEXTS = [b"nan", b"inf", b"-1", b"0", b"1e999", b"99999999999", b"\0", b",", b"\n", b"#", b"<a>"]


@st.composite
def damage(draw, content):
    """The bytes, damaged in one to three ways; mostly where headers are."""
    for _ in range(draw(st.integers(1, 3))):
        last = max(len(content) - 1, 0)
        place = draw(st.one_of(st.integers(0, min(last, 600)), st.integers(0, last)))
        match draw(st.sampled_from(["cut", "flip", "word", "text", "zeros", "lose", "append"])):
            case "cut":
                content = content[:place]
            case "flip":
                flipped = bytearray(content or b"\0")
                flipped[place] ^= 1 << draw(st.integers(0, 7))
                content = bytes(flipped)
            case "word":
                word = draw(st.one_of(st.sampled_from(WORDS), st.integers(0, 2**32 - 1)))
                content = content[:place] + struct.pack("<I", word) + content[place + 4 :]
            case "text":
                text = draw(st.sampled_from(TEXTS))
                over = draw(st.sampled_from([0, len(text)]))
                content = content[:place] + text + content[place + over :]
            case "zeros":
                length = draw(st.integers(1, 400))
                content = content[:place] + bytes(length) + content[place + length :]
            case "lose":
                content = content[:place] + content[place + draw(st.integers(1, 60)) :]
            case "append":
                content += draw(st.binary(min_size=1, max_size=200))
    return content


@st.composite
def damaged_file(draw, content):
    """Damage to a file; of archives, often to a member, which a wrong checksum would protect."""
    if not content.startswith(b"PK") or draw(st.booleans()):
        return draw(damage(content))
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = draw(st.sampled_from(sorted(members)))
    members[name] = draw(damage(members[name]))
    return zipped(members, zipfile.ZIP_STORED)


def assert_plausible(scan):
    dy, dx = spacing_of(scan)
    assert scan.dims == ("y", "x")
    assert min(scan.shape) >= 2
    assert 1e-6 <= min(dy, dx) <= max(dy, dx) <= 0.5
    assert max(scan.shape[0] * dy, scan.shape[1] * dx) <= 50
    assert not np.isinf(scan.values).any()
    assert np.isfinite(scan.values).any()
    assert np.nanmax(scan.values) - np.nanmin(scan.values) <= 10
    assert all(isinstance(value, str) and "\0" not in value for value in scan.attrs.values())


def largest_resident():
    """MiB."""
    try:
        with open("/proc/self/status", encoding="ascii") as status:
            return next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1024
    except OSError:
        return math.nan


@pytest.mark.parametrize("name", FORMATS)
def test_any_bytes(tmp_path, name):
    sample = FORMATS[name]
    path = tmp_path / f"a{sample.ending}"
    heights = 1e-3 * np.random.default_rng(1).normal(size=(5, 7))
    heights[1, 5] = math.nan
    sample.write(path, heights, SPACING)
    content = path.read_bytes()
    options = sample.options(1e-3)
    if sample.ending == ".xyz":
        options["scatter_spacing_mm"] = 1e-3
    read_scan(path, **options)  # imports what it needs, outside of the measured time
    tally = {"refused": 0, "read": 0, "slowest": 0.0}
    before = largest_resident()

    @settings(
        max_examples=EXAMPLES,
        derandomize=not MANY,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(damaged_file(content))
    def check(damaged):
        path.write_bytes(damaged)
        start = time.process_time()
        try:
            scan = read_scan(path, **options)
        except InputError:
            tally["refused"] += 1
        else:
            assert_plausible(scan)
            tally["read"] += 1
        tally["slowest"] = max(tally["slowest"], time.process_time() - start)

    check()
    assert tally["refused"] > 0
    if MANY:
        print(
            f"\n{name}: {tally['refused'] + tally['read']} cases, {tally['refused']} refused, "
            f"{tally['read']} read, slowest {tally['slowest']:.3f} s of CPU, "
            f"process grown by {largest_resident() - before:.0f} MiB"
        )
