"""Small files of every format of scans, from the formats' public descriptions.

Each writer takes a file name, heights (ny, nx) in mm with NaN where unmeasured, and the spacing
(dy, dx) in mm. `claim` is the shape (ny, nx) that the header announces, where it lies. Sources:
.plu and .plux: the table of bytes of measured files; .sur: Digital Surf's 512-byte header, as in
Gwyddion's surffile; .x3p: ISO 25178-72; .sdf: ISO 25178-71; .al3d, .vk4: Gwyddion's descriptions
of Alicona's tags and of Keyence's offset table; .gwy and .gsf: Gwyddion's user guide.
"""

import io
import struct
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np


def _claimed(heights, claim):
    return heights.shape if claim is None else claim


def zipped(members, method=zipfile.ZIP_DEFLATED):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", method) as archive:
        for name, content in members.items():
            # always the same date, so that the same heights give the same bytes
            archive.writestr(zipfile.ZipInfo(name), content, compress_type=method)
    return buffer.getvalue()


def plu_bytes(layers, spacing, claim=None):
    """`layers`: maps of one shape."""
    ny, nx = _claimed(layers[0], claim)
    dy, dx = (step * 1e3 for step in spacing)
    header = bytearray(500)
    header[:19] = b"2021-04-19 11:40:13"
    struct.pack_into("<III", header, 388, ny % 2**32, nx % 2**32, nx % 2**32)
    struct.pack_into("<ffff", header, 400, 0.0, dx, dy, 0.0)
    struct.pack_into("<I", header, 428, 3)
    struct.pack_into("<I", header, 440, 34)
    struct.pack_into("<I", header, 444, 3)
    header[489], header[490], header[491], header[492] = len(layers), 251, 7, 0
    content = bytes(header)
    for heights in layers:
        values = np.where(np.isnan(heights), 1000001.0, heights * 1e3).astype("<f4")
        limits = struct.pack("<ff", values.min(), values.max())
        content += struct.pack("<II", ny % 2**32, nx % 2**32) + values.tobytes() + limits
    return content


def write_plu(path, heights, spacing, claim=None):
    path.write_bytes(plu_bytes([heights], spacing, claim))


def plux_members(layers, spacing, claim=None):
    ny, nx = _claimed(layers[0], claim)
    names = [f"LAYER_{count}.raw" for count in range(len(layers))]
    index = (
        "<?xml version='1.0'?><xml><GENERAL><AUTHOR/><DATE>2021-04-19 11:40:13</DATE>"
        f"<IMAGE_SIZE_X>{nx}</IMAGE_SIZE_X><IMAGE_SIZE_Y>{ny}</IMAGE_SIZE_Y>"
        f"<FOV_X>{spacing[1] * 1e3!r}</FOV_X><FOV_Y>{spacing[0] * 1e3!r}</FOV_Y></GENERAL>"
        "<INFO><SIZE>1</SIZE><ITEM_0><NAME>Device</NAME><VALUE>S neox</VALUE></ITEM_0></INFO>"
        + "".join(
            f"<LAYER_{count}><FILENAME_Z>{name}</FILENAME_Z></LAYER_{count}>"
            for count, name in enumerate(names)
        )
        + "</xml>"
    )
    members = {"index.xml": index.encode(), "recipe.txt": b"<xml><RECIPE>1</RECIPE></xml>"}
    for name, heights in zip(names, layers, strict=True):
        members[name] = (heights * 1e3).astype("<f4").tobytes()
    return members


def write_plux(path, heights, spacing, claim=None):
    path.write_bytes(zipped(plux_members([heights], spacing, claim)))


def write_sur(path, heights, spacing, claim=None, bits=32, micrometres=b"\xb5m"):
    """Steps along x in mm, along y in µm; heights in nm steps of which are stored."""
    ny, nx = _claimed(heights, claim)
    unit_nm = 1e-3 if bits == 32 else 0.5
    steps = np.round(heights * 1e6 / unit_nm)
    lowest = int(np.nanmin(steps)) if np.isfinite(steps).any() else 0
    values = np.where(np.isnan(steps), lowest - 2, steps)
    text = [b"X", b"Y", b"Z", *2 * [b"mm", micrometres, b"nm"]]
    header = struct.pack("<12sHHHH", b"DIGITAL SURF", 0, 1, 1, 2)
    header += struct.pack("<30s30s", b"a stone", b"a profiler")
    header += struct.pack("<HHHHH8xH", 0, 2, 0, int(np.isnan(steps).any()), 1, bits)
    highest = int(np.nanmax(values)) if values.size else 0
    header += struct.pack("<iiiiI", lowest, highest, nx, ny, (nx * ny) % 2**32)
    header += struct.pack("<fff", spacing[1], spacing[0] * 1e3, unit_nm)
    header += struct.pack("<" + 9 * "16s", *text) + struct.pack("<fff", 1, 1, 1)
    header += struct.pack("<HHH12x7Hf10x", 1, 0, 0, 13, 40, 11, 19, 4, 2021, 1, 1.0)
    comment = b"a comment"
    header += struct.pack("<HH128s3f34x", len(comment), 0, b"", 0, 0, 0)
    assert len(header) == 512
    path.write_bytes(header + comment + values.astype(f"<i{bits // 8}").tobytes())


def x3p_members(heights, spacing, claim=None, kind="D"):
    """`kind`: type of the stored heights, of ISO 25178-72; integers mark valid points apart."""
    ny, nx = _claimed(heights, claim)
    metres = heights * 1e-3
    scale, offset = (1.0, 0.0) if kind in "DF" else (1e-12 if kind == "L" else 2e-10, 1e-6)
    dtype = {"D": "<f8", "F": "<f4", "L": "<i4", "I": "<i2"}[kind]
    stored = metres
    if kind in "LI":
        stored = np.where(np.isnan(metres), 7, np.round((metres - offset) / scale))
    valid = np.packbits(np.isfinite(heights).ravel(), bitorder="little").tobytes()
    link = "" if kind in "DF" else "<ValidPointsLink>bindata/valid.bin</ValidPointsLink>"

    def axis(name, axis_type, data_type, increment, start):
        return (
            f"<{name}><AxisType>{axis_type}</AxisType><DataType>{data_type}</DataType>"
            f"<Increment>{increment!r}</Increment><Offset>{start!r}</Offset></{name}>"
        )

    main = (
        '<?xml version="1.0" encoding="UTF-8"?>'
        '<p:ISO5436_2 xmlns:p="http://www.opengps.eu/2008/ISO5436_2">'
        "<Record1><Revision>ISO5436 - 2000</Revision><FeatureType>SUR</FeatureType><Axes>"
        + axis("CX", "I", "L", spacing[1] * 1e-3, 0.0)
        + axis("CY", "I", "L", spacing[0] * 1e-3, 0.0)
        + axis("CZ", "A", kind, scale, offset)
        + "</Axes></Record1><Record2><Date>2021-04-19T11:40:13</Date><Instrument>"
        "<Manufacturer>a maker</Manufacturer><Model>a profiler</Model><Serial>1</Serial>"
        "<Version>2</Version></Instrument></Record2>"
        f"<Record3><MatrixDimension><SizeX>{nx}</SizeX><SizeY>{ny}</SizeY><SizeZ>1</SizeZ>"
        f"</MatrixDimension><DataLink><PointDataLink>bindata/data.bin</PointDataLink>{link}"
        "</DataLink></Record3></p:ISO5436_2>"
    )
    members = {"main.xml": main.encode(), "bindata/data.bin": stored.astype(dtype).tobytes()}
    return members | ({"bindata/valid.bin": valid} if link else {})


def write_x3p(path, heights, spacing, claim=None, kind="D"):
    path.write_bytes(zipped(x3p_members(heights, spacing, claim, kind)))


def write_al3d(path, heights, spacing, claim=None):
    ny, nx = _claimed(heights, claim)
    invalid = 1e10
    tags = {
        "Type": "SolidImage",
        "CreatingApplication": "a microscope",
        "Rows": ny,
        "Cols": nx,
        "PixelSizeXMeter": repr(spacing[1] * 1e-3),
        "PixelSizeYMeter": repr(spacing[0] * 1e-3),
        "InvalidPixelValue": invalid,
        "DepthImageOffset": 17 + 52 * 10 + 256,
    }

    def tag(key, value):
        return struct.pack("<20s30s2s", key.encode(), str(value).encode(), b"\r\n")

    content = b"AliconaImaging\x00\r\n" + tag("Version", 1) + tag("TagCount", len(tags))
    content += b"".join(tag(key, value) for key, value in tags.items())
    content += struct.pack("<254s2s", b"", b"\r\n")
    # rows are padded to 8 bytes
    rows = np.full((heights.shape[0], heights.shape[1] + heights.shape[1] % 2), 3.0, "<f4")
    rows[:, : heights.shape[1]] = np.where(np.isnan(heights), invalid, heights * 1e-3)
    path.write_bytes(content + rows.tobytes())


def vk4_bytes(layers, spacing, claim=None):
    """Heights in steps of 1 pm above the lowest; the format has no unmeasured points."""
    ny, nx = _claimed(layers[0], claim)
    offsets = np.zeros(18, "<u4")  # settings, colours (2), light (3), height (3), ...
    offsets[0] = 12 + 72
    conditions = np.zeros(76, "<u4")
    conditions[:8] = [304, 2021, 4, 19, 11, 40, 13, 120]
    conditions[42:45] = [*np.clip(np.nan_to_num(spacing[::-1]) * 1e9 + 0.5, 0, 2**31), 1]
    images, position = b"", 12 + 72 + 304
    for count, heights in enumerate(layers):
        offsets[6 + count] = position + len(images)
        values = np.round((heights - np.nanmin(heights)) * 1e9).astype("<u4").tobytes()
        size = (4 * nx * ny) % 2**32
        images += struct.pack("<7I", nx % 2**32, ny % 2**32, 32, 0, size, 0, 0) + bytes(768)
        images += values
    start = b"VK4_" + bytes([1, 0, 0, 0]) + bytes(4)
    return start + offsets.tobytes() + conditions.tobytes() + images


def write_vk4(path, heights, spacing, claim=None):
    path.write_bytes(
        vk4_bytes([np.nan_to_num(heights, nan=float(np.nanmin(heights)))], spacing, claim)
    )


def _gwy_object(name, items):
    body = b"".join(key.encode() + b"\0" + value for key, value in items.items())
    return name.encode() + b"\0" + struct.pack("<I", len(body)) + body


def _gwy_field(values, sizes, unit, shape):
    si = b"o" + _gwy_object("GwySIUnit", {"unitstr": b"s" + unit.encode() + b"\0"})
    metres = b"o" + _gwy_object("GwySIUnit", {"unitstr": b"sm\0"})
    return b"o" + _gwy_object(
        "GwyDataField",
        {
            "xres": b"i" + struct.pack("<i", shape[1]),
            "yres": b"i" + struct.pack("<i", shape[0]),
            "xreal": b"d" + struct.pack("<d", sizes[1]),
            "yreal": b"d" + struct.pack("<d", sizes[0]),
            "si_unit_xy": metres,
            "si_unit_z": si,
            "data": b"D" + struct.pack("<I", values.size) + values.astype("<f8").tobytes(),
        },
    )


def gwy_bytes(layers, spacing, claim=None):
    """`layers`: {number: heights}, stored in that order, each masked where unmeasured."""
    items = {}
    for number, heights in layers.items():
        shape = _claimed(heights, claim)
        sizes = [n * step * 1e-3 for n, step in zip(heights.shape, spacing, strict=True)]
        metres, mask = (
            np.where(np.isnan(heights), 0.0, heights) * 1e-3,
            np.isnan(heights).astype(float),
        )
        items[f"/{number}/data/title"] = b"s" + f"Map {number}".encode() + b"\0"
        items[f"/{number}/data"] = _gwy_field(metres, sizes, "m", shape)
        items[f"/{number}/mask"] = _gwy_field(mask, sizes, "", shape)
    return b"GWYP" + _gwy_object("GwyContainer", items)


def write_gwy(path, heights, spacing, claim=None):
    path.write_bytes(gwy_bytes({0: heights}, spacing, claim))


def write_gsf(path, heights, spacing, claim=None, units=("m", "m")):
    ny, nx = _claimed(heights, claim)
    size_y, size_x = (n * step * 1e-3 for n, step in zip(heights.shape, spacing, strict=True))
    header = (
        f"Gwyddion Simple Field 1.0\nXRes = {nx}\nYRes = {ny}\nXReal = {size_x!r}\n"
        f"YReal = {size_y!r}\nTitle = a stone\n"
    )
    if units is not None:
        header += f"XYUnits = {units[0]}\nZUnits = {units[1]}\n"
    header = header.encode()
    padding = bytes(4 - len(header) % 4)
    path.write_bytes(header + padding + (heights * 1e-3).astype("<f4").tobytes())


def write_sdf(path, heights, spacing, claim=None):
    """The binary variant, with doubles in µm."""
    ny, nx = _claimed(heights, claim)
    header = struct.pack("<8s10s12s12s", b"bISO-1.0", b"a maker", b"190420211140", b"190420211140")
    header += struct.pack("<HH4d3B", nx % 2**16, ny % 2**16, *_sdf_scales(spacing), 0, 7, 0)
    path.write_bytes(header + (heights * 1e3).astype("<f8").tobytes())


def write_sdf_text(path, heights, spacing, claim=None):
    ny, nx = _claimed(heights, claim)
    scales = _sdf_scales(spacing)
    keys = ("Xscale", "Yscale", "Zscale", "Zresolution")
    lines = ["aISO-1.0", "ManufacID = a maker", f"NumPoints = {nx}", f"NumProfiles = {ny}"]
    lines += [f"{key} = {value!r}" for key, value in zip(keys, scales, strict=True)]
    lines += ["Compression = 0", "DataType = 7", "CheckType = 0", "*"]
    for row in heights * 1e3:
        lines.append(" ".join("BAD" if np.isnan(value) else f"{value:.9g}" for value in row))
    path.write_text("\n".join([*lines, "*", ""]))


def _sdf_scales(spacing):
    return spacing[1] * 1e-3, spacing[0] * 1e-3, 1e-6, 1e-9


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


def write_csv(path, heights, spacing):
    path.write_text(_matrix(heights, ",", ""))


def write_csv_commas(path, heights, spacing):
    """As spreadsheets write it where the comma is the decimal sign."""
    path.write_text(_matrix(heights, ";", "NaN").replace(".", ","))


def write_txt(path, heights, spacing):
    path.write_text(_matrix(heights, " ", "BAD"))


def write_asc(path, heights, spacing):
    path.write_text(_matrix(heights, "\t", "---"))


def write_gwyddion_text(path, heights, spacing):
    """As Gwyddion exports a matrix."""
    size_y, size_x = (n * step * 1e3 for n, step in zip(heights.shape, spacing, strict=True))
    header = f"# Channel: Z\n# Width: {size_x!r} µm\n# Height: {size_y!r} µm\n# Value units: m\n"
    path.write_text(header + _matrix(heights, "\t", "nan", 1e-3), encoding="utf-8")


@dataclass(frozen=True)
class Format:
    """How to write a sample, what `read_scan` has to be told of it, and what it can hold."""

    ending: str
    write: Callable
    options: Callable = lambda spacing: {}
    unmeasured: bool = True
    claims: bool = True
    square: bool = False  # one spacing for both directions
    attrs: dict = field(default_factory=dict)


def _unit_and_spacing(spacing):
    return {"unit": "um", "spacing_mm": spacing}


FORMATS = {
    "plu": Format(
        ".plu", write_plu, attrs={"objective": "Leica HC PL Fluotar EPI 10X", "vendor": "Sensofar"}
    ),
    "plux": Format(".plux", write_plux, attrs={"instrument": "S neox"}),
    "sur": Format(".sur", write_sur, attrs={"instrument": "a profiler"}),
    "x3p": Format(".x3p", write_x3p, attrs={"vendor": "a maker"}),
    "al3d": Format(".al3d", write_al3d, attrs={"vendor": "Alicona Imaging"}),
    "vk4": Format(".vk4", write_vk4, unmeasured=False, attrs={"vendor": "Keyence"}),
    "gwy": Format(".gwy", write_gwy),
    "gsf": Format(".gsf", write_gsf, attrs={"layer": "a stone"}),
    "sdf": Format(".sdf", write_sdf),
    "sdf text": Format(".sdf", write_sdf_text),
    "xyz": Format(".xyz", write_xyz, lambda spacing: {"unit": "um"}, claims=False),
    "csv": Format(".csv", write_csv, _unit_and_spacing, claims=False, square=True),
    "csv, decimal commas": Format(
        ".csv", write_csv_commas, _unit_and_spacing, claims=False, square=True
    ),
    "txt": Format(".txt", write_txt, _unit_and_spacing, claims=False, square=True),
    "asc": Format(".asc", write_asc, _unit_and_spacing, claims=False, square=True),
    "txt, Gwyddion": Format(".txt", write_gwyddion_text, claims=False),
}
