"""Small files of every format of scans, from the formats' public descriptions.

Each writer takes a file name and heights (ny, nx) in mm, NaN where unmeasured. Their points are DY
and DX apart, or STEP in a matrix. Sources: .plux: the table of bytes of measured files; .sur:
Digital Surf's 512-byte header, as in Gwyddion's surffile, and its compressed form, as surfalize
reads it; .x3p and .sdf: ISO 25178-72 and -71.
"""

import io
import math
import struct
import zipfile
import zlib
from functools import partial

import numpy as np
import pytest
from hypothesis import strategies as st

from gstlib.errors import InputError
from gstlib.io.plu import write_plu
from gstlib.io.scans import read_scan

DY, DX = SPACING = 1.66e-3, 0.83e-3  # mm
# What a config says of a matrix in text.
STEP = 1.5  # µm
# Not square, odd, and no symmetry: every mistake of axes shows.
HEIGHTS = 1e-3 * np.random.default_rng(1).normal(size=(5, 7))
HEIGHTS[1, 5] = math.nan
CONFIG = {"unit": "um", "spacing_um": STEP}


def refused(path, match=None, read=read_scan, **options):
    """The scan is not read, and the error names its file in a sentence."""
    with pytest.raises(InputError, match=match) as caught:
        read(path, **options)
    assert path.name in str(caught.value)
    assert "\n" not in str(caught.value)


def replaced(content, *changes):
    """Text or bytes with changes (old, new)."""
    for old, new in changes:
        assert old in content
        content = content.replace(old, new)
    return content


def zipped(members, method=zipfile.ZIP_DEFLATED):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def members_of(archive):
    """Content of the members of a zip file, by name."""
    with zipfile.ZipFile(archive) as opened:
        return {name: opened.read(name) for name in opened.namelist()}


def write_plu_at(path, heights, spacing=SPACING, stage_mm=(0, 0)):
    """Bytes 412 to 420 of a measured `.plu` are its stage's x and y in µm."""
    write_plu(path, heights, spacing)
    content = bytearray(path.read_bytes())
    struct.pack_into("<2f", content, 412, *(1e3 * at for at in stage_mm))
    path.write_bytes(content)


def write_plux(path, heights):
    ny, nx = heights.shape
    index = (
        "<?xml version='1.0'?><xml><GENERAL><AUTHOR/><DATE>2021-04-19 11:40:13</DATE>"
        f"<IMAGE_SIZE_X>{nx}</IMAGE_SIZE_X><IMAGE_SIZE_Y>{ny}</IMAGE_SIZE_Y>"
        f"<FOV_X>{DX * 1e3!r}</FOV_X><FOV_Y>{DY * 1e3!r}</FOV_Y></GENERAL>"
        "<INFO><SIZE>1</SIZE><ITEM_0><NAME>Device</NAME><VALUE>S neox</VALUE></ITEM_0></INFO>"
        "<LAYER_0><FILENAME_Z>LAYER_0.raw</FILENAME_Z></LAYER_0></xml>"
    )
    members = {"index.xml": index, "recipe.txt": "<xml><RECIPE>1</RECIPE></xml>"}
    members["LAYER_0.raw"] = (heights * 1e3).astype("<f4").tobytes()
    path.write_bytes(zipped(members))


def write_x3p(path, heights, stage_mm=(0, 0)):
    """Heights in m, NaN where unmeasured."""
    ny, nx = heights.shape
    axes = "".join(
        f"<C{axis}><AxisType>{kind}</AxisType><DataType>D</DataType>"
        f"<Increment>{step!r}</Increment><Offset>{at / 1e3}</Offset></C{axis}>"
        for axis, kind, step, at in zip(
            "XYZ", "IIA", (DX / 1e3, DY / 1e3, 1.0), (*stage_mm, 0), strict=True
        )
    )
    index = (
        "<?xml version='1.0' encoding='UTF-8'?><p:ISO5436_2 xmlns:p='http://www.opengps.eu/2008/"
        f"ISO5436_2'><Record1><Revision>ISO5436 - 2000</Revision><FeatureType>SUR</FeatureType>"
        f"<Axes>{axes}</Axes></Record1><Record2><Date>2021-04-19T11:40:13</Date><Instrument>"
        "<Manufacturer>unknown</Manufacturer><Model>a profiler</Model><Version>unknown</Version>"
        "</Instrument></Record2><Record3><MatrixDimension>"
        f"<SizeX>{nx}</SizeX><SizeY>{ny}</SizeY><SizeZ>1</SizeZ></MatrixDimension><DataLink>"
        "<PointDataLink>bindata/data.bin</PointDataLink></DataLink></Record3></p:ISO5436_2>"
    )
    content = {
        "main.xml": index.encode(),
        "bindata/data.bin": (heights / 1e3).tobytes(),
    }
    path.write_bytes(zipped(content))


def write_sdf(path, heights):
    """Heights in µm as doubles, the lowest of which stands for unmeasured."""
    ny, nx = heights.shape
    header = struct.pack(
        "<8s10s12s12s", b"bISO-1.0", b"a profiler", *2 * [b"190420211140"]
    )
    header += struct.pack("<2H4d3B", nx, ny, DX / 1e3, DY / 1e3, 1e-6, -1, 0, 7, 0)
    lowest = np.finfo(float).min
    values = np.where(np.isnan(heights), lowest, heights * 1e3)
    path.write_bytes(header + values.astype("<f8").tobytes())


SUR_HEADER = """< 12s 6x H 30x 30s 6x H 10x H5i 3f 48x 16s16s16s 16s16s16s
30x 7H 14x H 130x 2f 38x"""


def write_sur(path, heights, kind=2, compressed=False, micro=b"\xb5m", stage_mm=(0, 0)):
    """Steps along x in mm, along y in µm; heights in nm, in steps of 1 pm."""
    (ny, nx), (x, y) = heights.shape, stage_mm
    steps = np.round(heights * 1e9)
    unmeasured = np.isnan(steps)
    lowest = 0 if unmeasured.all() else int(np.nanmin(steps))
    values = np.where(unmeasured, lowest - 2, steps).astype("<i4")
    content, comment = values.tobytes(), b"a comment"
    if compressed:
        packed = zlib.compress(content)
        content = struct.pack("<III", 1, len(content), len(packed)) + packed
    header = struct.pack(
        SUR_HEADER,
        b"DSCOMPRESSED" if compressed else b"DIGITAL SURF",
        kind,
        b"a profiler",
        int(unmeasured.any()),
        *(32, lowest, values.max(initial=0), nx, ny, nx * ny),
        *(DX, DY * 1e3, 1e-3),
        *2 * [b"mm", micro, b"nm"],
        *(13, 40, 11, 19, 4, 2021, 1),  # the time
        len(comment),
        *(x, y * 1e3),
    )
    path.write_bytes(header + comment + content)


def write_xyz(path, heights):
    """Points in µm, the unmeasured ones left out."""
    rows, columns = np.argwhere(np.isfinite(heights)).T
    y, x = 1e3 * DY * (rows + 0.5), 1e3 * DX * (columns + 0.5)
    np.savetxt(path, np.c_[x, y, 1e3 * heights[rows, columns]], fmt="%.9f")


def lines_of(rows, mark=",", cell="{:.4f}", unmeasured="nan"):
    """Rows of numbers in text."""
    cells = ([unmeasured if v != v else cell.format(v) for v in row] for row in rows)
    return "".join(mark.join(row) + "\n" for row in cells)


def matrix_writer(separator, unmeasured, point="."):
    """Writer of heights in µm, between separators and with a decimal sign as some program's."""

    def write(path, heights):
        text = lines_of(1e3 * heights, separator, "{:.9g}", unmeasured)
        path.write_text(text.replace(".", point))

    return write


# 32-bit words that mean trouble: extreme integers, infinity and NaN
WORDS = [struct.pack("<I", number) for number in (1, 2**31 - 1, 2**31, 2**32 - 1)]
WORDS += [struct.pack("<f", number) for number in (math.nan, math.inf, 1e30)]
TEXTS = [b"nan", b"-1", b"1e999", b"99999999999", b"\0", b",", b"\n", b"#", b"<a>"]


@st.composite
def damaged(draw, content):
    """A file after an accident; of an archive, to a member, which a checksum would protect."""
    if content.startswith(b"PK"):
        members = members_of(io.BytesIO(content))
        name = draw(st.sampled_from(sorted(members)))
        members[name] = draw(damaged(members[name]))
        return zipped(members, zipfile.ZIP_STORED)
    in_header, anywhere = (st.integers(0, min(len(content), n)) for n in (600, 1 << 30))
    start = draw(in_header | anywhere)
    new = draw(st.sampled_from([b"", bytes(400), *WORDS, *TEXTS]))
    lost = draw(st.sampled_from([0, 1, 4, 400, len(content)]))
    return content[:start] + new + content[start + lost :]


# Writers by name, which begins with the ending of the file.
FORMATS = {
    "plu": write_plu_at,
    "plux": write_plux,
    "sur": write_sur,
    "sur, compressed": partial(write_sur, compressed=True, micro="μm".encode()),
    "x3p": write_x3p,
    "sdf": write_sdf,
    "xyz": write_xyz,
    "csv": matrix_writer(",", ""),
    "csv, decimal commas": matrix_writer(";", "NaN", ","),
    "txt": matrix_writer(" ", "BAD"),
    "asc": matrix_writer("\t", "---"),
}
OPTIONS = {"xyz": {"unit": "um"}} | dict.fromkeys(["csv", "txt", "asc"], CONFIG)
