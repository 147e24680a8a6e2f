"""Small files of every format of scans, from the formats' public descriptions.

Each writer takes a file name, heights (ny, nx) in mm with NaN where unmeasured, and the spacing
(dy, dx) in mm. `claim` is a wrong shape (ny, nx) for the header to announce. Sources: .plux: the
table of bytes of measured files; .sur: Digital Surf's 512-byte header, as in Gwyddion's surffile.
"""

import io
import struct
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from gstlib.io.plu import write_plu


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


def write_plux(path, heights, spacing):
    path.write_bytes(zipped(plux_members([heights], spacing)))


def write_sur(path, heights, spacing, claim=None, kind=2):
    """Steps along x in mm, along y in µm; heights in nm, in steps of 1 pm."""
    ny, nx = heights.shape if claim is None else claim
    unit_nm = 1e-3
    steps = np.round(heights * 1e6 / unit_nm)
    lowest = int(np.nanmin(steps)) if np.isfinite(steps).any() else 0
    values = np.where(np.isnan(steps), lowest - 2, steps)
    text = [b"X", b"Y", b"Z", *2 * [b"mm", b"\xb5m", b"nm"]]
    header = struct.pack("<12sHHHH", b"DIGITAL SURF", 0, 1, 1, kind)
    header += struct.pack("<30s30s", b"a stone", b"a profiler")
    header += struct.pack("<HHHHH8xH", 0, 2, 0, int(np.isnan(steps).any()), 1, 32)
    highest = int(np.nanmax(values)) if values.size else 0
    header += struct.pack("<iiiiI", lowest, highest, nx, ny, (nx * ny) % 2**32)
    header += struct.pack("<fff", spacing[1], spacing[0] * 1e3, unit_nm)
    header += struct.pack("<" + 9 * "16s", *text) + struct.pack("<fff", 1, 1, 1)
    header += struct.pack("<HHH12x7Hf10x", 1, 0, 0, 13, 40, 11, 19, 4, 2021, 1, 1.0)
    comment = b"a comment"
    header += struct.pack("<HH128s3f34x", len(comment), 0, b"", 0, 0, 0)
    assert len(header) == 512
    path.write_bytes(header + comment + values.astype("<i4").tobytes())


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


@dataclass(frozen=True)
class Format:
    """How to write a sample, and what `read_scan` has to be told of it."""

    ending: str
    write: Callable
    options: Callable = lambda spacing: {}
    square: bool = False  # one spacing for both directions
    attrs: dict = field(default_factory=dict)


FORMATS = {
    "plu": Format(".plu", write_plu, attrs={"objective": "Leica HC PL Fluotar EPI 10X"}),
    "plux": Format(".plux", write_plux, attrs={"instrument": "S neox"}),
    "sur": Format(".sur", write_sur, attrs={"instrument": "a profiler"}),
    "xyz": Format(".xyz", write_xyz, lambda spacing: {"unit": "um"}),
    "txt, Gwyddion": Format(".txt", write_gwyddion_text),
} | {
    name: Format(
        ending,
        matrix_writer(*style),
        lambda spacing: {"unit": "um", "spacing_mm": spacing},
        square=True,
    )
    for name, ending, *style in [
        ("csv", ".csv", ",", ""),
        ("csv, decimal commas", ".csv", ";", "NaN", ","),
        ("txt", ".txt", " ", "BAD"),
        ("asc", ".asc", "\t", "---"),
    ]
}
