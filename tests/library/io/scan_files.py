"""Small files of every format of scans, from the formats' public descriptions.

Each writer takes a file name, heights (ny, nx) in mm with NaN where unmeasured, and the spacing
(dy, dx) in mm. `claim` is a wrong shape (ny, nx) for the header to announce. Sources: .plux: the
table of bytes of measured files; .sur: Digital Surf's 512-byte header, as in Gwyddion's surffile,
and its compressed form, as surfalize reads it; .x3p and .sdf: ISO 25178-72 and -71.
"""

import io
import struct
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import pytest
from gstlib.errors import InputError
from gstlib.io.plu import write_plu
from gstlib.io.scans import read_scan


def refused(path, match=None, **options):
    """The scan is not read, and the error names its file."""
    with pytest.raises(InputError, match=match) as caught:
        read_scan(path, **options)
    assert path.name in str(caught.value)


def zipped(members, method=zipfile.ZIP_DEFLATED):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        for name, content in members.items():
            # always the same date, so that the same heights give the same bytes
            archive.writestr(zipfile.ZipInfo(name), content, compress_type=method)
    return buffer.getvalue()


def plux_members(layers, spacing):
    ny, nx = layers[0].shape
    index = (
        "<?xml version='1.0'?><xml><GENERAL><AUTHOR/><DATE>2021-04-19 11:40:13</DATE>"
        f"<IMAGE_SIZE_X>{nx}</IMAGE_SIZE_X><IMAGE_SIZE_Y>{ny}</IMAGE_SIZE_Y>"
        f"<FOV_X>{spacing[1] * 1e3!r}</FOV_X><FOV_Y>{spacing[0] * 1e3!r}</FOV_Y></GENERAL>"
        "<INFO><SIZE>1</SIZE><ITEM_0><NAME>Device</NAME><VALUE>S neox</VALUE></ITEM_0></INFO>"
    )
    members = {"index.xml": b"", "recipe.txt": b"<xml><RECIPE>1</RECIPE></xml>"}
    for n, heights in enumerate(layers):
        index += f"<LAYER_{n}><FILENAME_Z>LAYER_{n}.raw</FILENAME_Z></LAYER_{n}>"
        members[f"LAYER_{n}.raw"] = (heights * 1e3).astype("<f4").tobytes()
    return members | {"index.xml": f"{index}</xml>".encode()}


def write_plu_at(path, heights, spacing, stage_mm):
    """Bytes 412 to 420 of a measured `.plu` are its stage's x and y in µm."""
    write_plu(path, heights, spacing)
    content = bytearray(path.read_bytes())
    struct.pack_into("<2f", content, 412, *(1e3 * at for at in stage_mm))
    path.write_bytes(content)


def write_plux(path, heights, spacing):
    path.write_bytes(zipped(plux_members([heights], spacing)))


def write_x3p(path, heights, spacing, folder="", revision="ISO5436 - 2000", stage_mm=(0, 0)):
    """Heights in m, NaN where unmeasured."""
    ny, nx = heights.shape
    axes = "".join(
        f"<C{axis}><AxisType>{kind}</AxisType><DataType>D</DataType>"
        f"<Increment>{step!r}</Increment><Offset>{at / 1e3}</Offset></C{axis}>"
        for axis, kind, step, at in zip(
            "XYZ", "IIA", (spacing[1] / 1e3, spacing[0] / 1e3, 1.0), (*stage_mm, 0), strict=True
        )
    )
    index = (
        "<?xml version='1.0' encoding='UTF-8'?><p:ISO5436_2 xmlns:p='http://www.opengps.eu/2008/"
        f"ISO5436_2'><Record1><Revision>{revision}</Revision><FeatureType>SUR</FeatureType>"
        f"<Axes>{axes}</Axes></Record1><Record2><Date>2021-04-19T11:40:13</Date><Instrument>"
        "<Manufacturer>unknown</Manufacturer><Model>a profiler</Model><Version>unknown</Version>"
        "</Instrument></Record2><Record3><MatrixDimension>"
        f"<SizeX>{nx}</SizeX><SizeY>{ny}</SizeY><SizeZ>1</SizeZ></MatrixDimension><DataLink>"
        "<PointDataLink>bindata/data.bin</PointDataLink></DataLink></Record3></p:ISO5436_2>"
    )
    content = {"main.xml": index.encode(), "bindata/data.bin": (heights / 1e3).tobytes()}
    path.write_bytes(zipped({f"{folder}{name}": data for name, data in content.items()}))


def write_sdf(path, heights, spacing):
    """Heights in µm as doubles, the lowest of which stands for unmeasured."""
    ny, nx = heights.shape
    header = struct.pack("<8s10s12s12s", b"bISO-1.0", b"a profiler", *2 * [b"190420211140"])
    header += struct.pack("<2H4d3B", nx, ny, spacing[1] / 1e3, spacing[0] / 1e3, 1e-6, -1, 0, 7, 0)
    values = np.where(np.isnan(heights), np.finfo(float).min, heights * 1e3)
    path.write_bytes(header + values.astype("<f8").tobytes())


def write_sur(path, heights, spacing, claim=None, kind=2, compressed=False, stage_mm=(0, 0)):
    """Steps along x in mm, along y in µm; heights in nm, in steps of 1 pm."""
    ny, nx = heights.shape if claim is None else claim
    unit_nm = 1e-3
    steps = np.round(heights * 1e6 / unit_nm)
    lowest = int(np.nanmin(steps)) if np.isfinite(steps).any() else 0
    values = np.where(np.isnan(steps), lowest - 2, steps)
    text = [b"X", b"Y", b"Z", *2 * [b"mm", b"\xb5m", b"nm"]]
    content = values.astype("<i4").tobytes()
    if compressed:
        packed = zlib.compress(content)
        content = struct.pack("<III", 1, len(content), len(packed)) + packed
    mark = b"DSCOMPRESSED" if compressed else b"DIGITAL SURF"
    header = struct.pack("<12sHHHH", mark, 0, 1, 1, kind)
    header += struct.pack("<30s30s", b"a stone", b"a profiler")
    header += struct.pack("<HHHHH8xH", 0, 2, 0, int(np.isnan(steps).any()), 1, 32)
    highest = int(np.nanmax(values)) if values.size else 0
    header += struct.pack("<iiiiI", lowest, highest, nx, ny, (nx * ny) % 2**32)
    header += struct.pack("<fff", spacing[1], spacing[0] * 1e3, unit_nm)
    header += struct.pack("<" + 9 * "16s", *text) + struct.pack("<fff", 1, 1, 1)
    header += struct.pack("<HHH12x7Hf", 1, 0, 0, 13, 40, 11, 19, 4, 2021, 1, 1.0)
    header += struct.pack("<I6x", len(content) if compressed else 0)
    comment = b"a comment"
    header += struct.pack("<HH128s3f34x", len(comment), 0, b"", stage_mm[0], stage_mm[1] * 1e3, 0)
    assert len(header) == 512
    path.write_bytes(header + comment + content)


def write_xyz(path, heights, spacing, order=slice(None)):
    """Points in µm, the unmeasured ones left out."""
    rows, columns = np.indices(heights.shape)
    x, y = (spacing[axis] * 1e3 * (n + 0.5) for axis, n in ((1, columns), (0, rows)))
    points = np.stack([x, y, heights * 1e3], axis=-1).reshape(-1, 3)[order]
    np.savetxt(path, points[np.isfinite(points[:, 2])], fmt="%.9f")


def _matrix(heights, separator, unmeasured, scale=1e3):
    return "".join(
        separator.join(unmeasured if np.isnan(v) else f"{v * scale:.9g}" for v in row) + "\n"
        for row in heights
    )


def matrix_writer(separator, unmeasured, point="."):
    """Writer of heights in µm, between separators and with a decimal sign as some program's."""

    def write(path, heights, spacing):
        path.write_text(_matrix(heights, separator, unmeasured).replace(".", point))

    return write


def write_gwyddion_text(path, heights, spacing):
    """As Gwyddion exports a matrix."""
    size_y, size_x = (n * step * 1e3 for n, step in zip(heights.shape, spacing, strict=True))
    header = f"# Channel: Z\n# Width: {size_x!r} µm\n# Height: {size_y!r} µm\n# Value units: m\n"
    path.write_text(header + _matrix(heights, "\t", "nan", 1e-3), encoding="utf-8")


def write_esri(path, heights, spacing):
    """An ESRI ASCII grid in µm, as GIS write it: the highest y first."""
    ny, nx = heights.shape
    header = f"ncols {nx}\nnrows {ny}\nxllcorner 431.5\nyllcorner -12.25\ndx {spacing[1] * 1e3!r}\n"
    header += f"dy {spacing[0] * 1e3!r}\nNODATA_value -32768\n"
    path.write_text(header + _matrix(heights[::-1], " ", "-32768"))


@dataclass(frozen=True)
class Format:
    """How to write a sample, and what `read_scan` must be given to read it."""

    ending: str
    write: Callable
    options: Callable = lambda spacing: {}
    square: bool = False  # one spacing for both directions
    attrs: dict = field(default_factory=dict)


FORMATS = {
    "plu": Format(".plu", write_plu, attrs={"objective": "Leica HC PL Fluotar EPI 10X"}),
    "plux": Format(".plux", write_plux, attrs={"instrument": "S neox"}),
    "sur": Format(".sur", write_sur, attrs={"instrument": "a profiler"}),
    "sur, compressed": Format(".sur", partial(write_sur, compressed=True)),
    "x3p": Format(".x3p", write_x3p, attrs={"instrument": "a profiler"}),
    "sdf": Format(".sdf", write_sdf),
    "xyz": Format(".xyz", write_xyz, lambda spacing: {"unit": "um"}),
    "asc, ESRI": Format(".asc", write_esri, lambda spacing: {"unit": "um"}),
    "txt, Gwyddion": Format(".txt", write_gwyddion_text),
} | {
    name: Format(
        ending,
        matrix_writer(*style),
        lambda spacing: {"unit": "um", "spacing_um": spacing * 1e3},
        square=True,
    )
    for name, ending, *style in [
        ("csv", ".csv", ",", ""),
        ("csv, decimal commas", ".csv", ";", "NaN", ","),
        ("txt", ".txt", " ", "BAD"),
        ("asc", ".asc", "\t", "---"),
    ]
}
