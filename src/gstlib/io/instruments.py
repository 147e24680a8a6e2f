"""Height maps of instruments, read through SurfaceTopography.

It gives heights as [ix, iy] in a unit that differs per file; here they become rows along y, columns
along x, in the order of the file, in mm. A file is opened by the one reader that its ending or its
first bytes ask for: to try them all, as the library can, would let readers of formats without such
a mark make a map of anything. SurfaceTopography: Röttger et al. 2022, Surf. Topogr.: Metrol. Prop.
10:035032. Importing this module imports the library, which takes a second or two.
"""

import io
import logging
import struct
import warnings
import zipfile
from pathlib import Path

import numpy as np
from SurfaceTopography.IO import open_topography, readers
from SurfaceTopography.IO.Reader import ChannelInfo, MagicMatch, ReaderBase
from SurfaceTopography.Support.UnitConversion import get_unit_conversion_factor

from gstlib.errors import InputError
from gstlib.io.archives import is_archive, size_unpacked
from gstlib.io.bounds import bounded
from gstlib.io.height_map import HeightMap, Unsaid, plain_text

__all__ = ["read_instrument_file"]

# Formats that this project has checked, by the ending of their files.
_FORMATS = {
    ".al3d": "al3d",
    ".apx": "plu",
    ".gwy": "gwy",
    ".plu": "plu",
    ".plux": "plux",
    ".sdf": "sdf",
    ".sur": "sur",
    ".vk3": "vk",
    ".vk4": "vk",
    ".vk6": "vk",
    ".vk7": "vk",
    ".x3p": "x3p",
}
# Text is read elsewhere; these two have no mark of their own and take any bytes for heights.
_NEVER = {"asc", "hgt", "nms", "xyz"}

# A .plu has no magic number: more points a side than this and it is something else.
_LARGEST_PLU_SIDE = 1 << 16
# Objects of Digital Surf files that hold no heights: binary, intensity and colour images, spectra.
_SUR_NO_HEIGHTS = {3, 10, 12, 20, 21}
# Where their header has its units, so many of so many bytes.
_SUR_UNITS, _SUR_UNIT_COUNT, _SUR_UNIT_BYTES = 180, 6, 16
_X3P_BYTES = {"I": 2, "L": 4, "F": 4, "D": 8}
# Magic, two tags, and the comment that follows the counted tags of an Alicona file; a tag.
_AL3D_HEADER, _AL3D_TAG = 17 + 2 * 52 + 256, 52

_MEASURE_AGAIN = "Export or copy the scan again."


def read_instrument_file(path: Path, unsaid: Unsaid) -> HeightMap:
    """Read the first height map of an instrument's file; see `gstlib.io.scans.read_scan`."""
    size = size_unpacked(path) if is_archive(path) else path.stat().st_size
    if path.suffix.lower() in (".plu", ".apx"):
        _check_plu(path)
    with bounded(path, size), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of odd dates and numbers; what matters is checked
        reader = _open(path)
        try:
            _check_structure(path, reader)
            channel, layers = _heights_of(path, reader)
            return _read_channel(path, channel, layers, unsaid)
        except (InputError, MemoryError):
            raise
        except Exception as error:  # the readers raise whatever their parsers raise
            raise InputError(
                path,
                f"its heights cannot be read ({_first_line(error)}): the file is truncated or "
                "damaged",
                _MEASURE_AGAIN,
            ) from error


def _open(path: Path) -> ReaderBase:
    with path.open("rb") as file:
        start = file.read(512)
    if start.startswith(b"DSCOMPRESSED"):
        raise InputError(
            path,
            "is a compressed file of Digital Surf, which is not understood here",
            "Save it without compression (in MountainsMap or the instrument's software), or export "
            "it as .x3p or as text.",
        )
    formats = _candidates(path, start)
    if not formats:
        raise InputError(
            path,
            "cannot be read as a height map: neither its ending nor its first bytes are of a "
            "format that is known here",
            "Export the scan in the instrument's own format (.plu, .plux, .al3d, .sur, ...).",
        )
    failures = []
    for name in formats:
        try:
            source = _sur_in_latin_1(path) if name == "sur" else str(path)
            return open_topography(source, format=name)
        except MemoryError:
            raise
        except Exception as error:  # the readers raise whatever their parsers raise
            failures.append(error)
    raise InputError(
        path,
        f"cannot be read as a height map of the format {formats[0]} ({_first_line(failures[0])}): "
        "it is truncated or damaged, or of another format",
        "Export the scan in the instrument's own format (.plu, .plux, .al3d, .sur, ...).",
    ) from failures[0]


def _sur_in_latin_1(path: Path) -> io.BytesIO:
    """The file with its units in Latin-1, as its reader wants them; some programs write UTF-8."""
    content = bytearray(path.read_bytes())
    for unit in range(_SUR_UNIT_COUNT):
        start = _SUR_UNITS + unit * _SUR_UNIT_BYTES
        place = slice(start, start + _SUR_UNIT_BYTES)
        try:
            text = content[place].decode("utf-8").replace("μ", "µ").encode("latin-1")
        except UnicodeError:
            continue  # Latin-1 already, or no unit
        content[place] = text + content[place][len(text) :]
    return io.BytesIO(content)


def _candidates(path: Path, start: bytes) -> list[str]:
    suffix = path.suffix.lower()
    if suffix in _FORMATS:
        return [_FORMATS[suffix]]
    return [
        reader.format()
        for reader in readers
        if reader.format() not in _NEVER
        and (
            reader.can_read(start) is MagicMatch.YES
            or (suffix[1:] in reader.file_extensions() and reader.can_read(start) != MagicMatch.NO)
        )
    ]


def _heights_of(path: Path, reader: ReaderBase) -> tuple[ChannelInfo, int]:
    """The height map to read, and how many the file has."""
    maps = [c for c in reader.channels if c.dim == 2 and c.is_height_channel]
    if not maps:
        raise InputError(
            path,
            "holds no map of heights (but a profile, an image or nothing)",
            "Export the whole topography.",
        )
    # Gwyddion numbers its maps, but stores them in any order
    return min(maps, key=lambda channel: channel.tags.get("index", 0)), len(maps)


def _read_channel(path: Path, channel: ChannelInfo, layers: int, unsaid: Unsaid) -> HeightMap:
    if channel.physical_sizes is None:
        spacing = unsaid.spacing(path)
        topography = channel.topography(physical_sizes=(1.0, 1.0))
    else:
        topography = channel.topography()
        spacing = None
    unit = topography.unit
    factor = unsaid.unit_factor(path) if unit is None else get_unit_conversion_factor(unit, "mm")
    if spacing is None:
        nx, ny = topography.nb_grid_pts
        size_x, size_y = topography.physical_sizes
        spacing = (float(size_y) * factor / ny, float(size_x) * factor / nx)
    heights = np.ma.filled(np.ma.asarray(topography.heights(), dtype=float), np.nan)
    if heights.shape != tuple(channel.nb_grid_pts):
        raise InputError(
            path,
            f"its header announces {channel.nb_grid_pts} points, but {heights.shape} were read",
            _MEASURE_AGAIN,
        )
    attrs = _metadata(topography.info)
    if layers > 1:
        attrs["layer"] = f"{plain_text(channel.name)}, the first of {layers} height maps"
        logging.getLogger("gstlib").warning("%s: read is %s", path, attrs["layer"])
    return HeightMap(heights.T * factor, spacing, attrs)


def _metadata(info: dict) -> dict[str, str]:
    """What the file tells of the instrument, as text."""
    instrument = info.get("instrument") or {}
    raw = info.get("raw_metadata") or {}
    configuration = raw.get("measurement_configuration") if isinstance(raw, dict) else None
    found = {
        "instrument": instrument.get("name"),
        "vendor": instrument.get("vendor"),
        "objective": (configuration or {}).get("objective"),
        "acquired": info.get("acquisition_time"),
    }
    return {name: plain_text(value) for name, value in found.items() if value is not None}


def _check_plu(path: Path) -> None:
    """Hold a .plu file against the size of its first layer: 500 bytes of header, rows, columns."""
    size = path.stat().st_size
    with path.open("rb") as file:
        start = file.read(508)
    if len(start) < 508:
        raise InputError(
            path, f"{size} bytes are less than a .plu header: the file is truncated", _MEASURE_AGAIN
        )
    rows, columns = struct.unpack_from("<II", start, 500)
    if not (0 < rows < _LARGEST_PLU_SIDE and 0 < columns < _LARGEST_PLU_SIDE):
        raise InputError(
            path,
            f"its first layer announces {rows} × {columns} points: not a .plu topography",
            "Export the scan again, or correct the file's ending.",
        )
    needed = 508 + 4 * rows * columns
    if size < needed:
        raise InputError(
            path,
            f"{rows} × {columns} points take {needed} bytes, but the file has {size}: it is "
            "truncated",
            _MEASURE_AGAIN,
        )


def _check_structure(path: Path, reader: ReaderBase) -> None:
    """What the library's readers of some formats take on trust."""
    check = {
        "al3d": _check_al3d,
        "plux": _check_plux,
        "sur": _check_sur,
        "vk": _check_vk,
        "x3p": _check_x3p,
    }.get(reader.format())
    problem = check(path, reader.metadata) if check else None
    if problem:
        raise InputError(path, problem, _MEASURE_AGAIN)


def _check_al3d(path: Path, said: dict) -> str | None:
    tags = {tag["key"]: tag["value"] for tag in said["tags"]}
    if int(tags["DepthImageOffset"]) < _AL3D_HEADER + _AL3D_TAG * len(tags):
        return "its heights are said to lie in its header"
    return None


def _check_plux(path: Path, said: dict) -> str | None:
    general = said["index"]["GENERAL"]
    points = int(general["IMAGE_SIZE_X"]) * int(general["IMAGE_SIZE_Y"])
    layers = [layer for name, layer in said["index"].items() if name.startswith("LAYER_")]
    return _wrong_size(path, [layer["FILENAME_Z"] for layer in layers], 4 * points)


def _check_x3p(path: Path, said: dict) -> str | None:
    link, size = said["main"]["Record3"]["DataLink"], said["main"]["Record3"]["MatrixDimension"]
    item = _X3P_BYTES[said["main"]["Record1"]["Axes"]["CZ"]["DataType"]]
    return _wrong_size(path, [link["PointDataLink"]], item * size["SizeX"] * size["SizeY"])


def _wrong_size(path: Path, names: list[str], size: int) -> str | None:
    """A member with more bytes than points would be read row by row out of step."""
    with zipfile.ZipFile(path) as archive:
        for name in names:
            found = archive.getinfo(name).file_size
            if found != size:
                return f"its heights should take {size} bytes, but {name} has {found}"
    return None


def _check_sur(path: Path, said: dict) -> str | None:
    kind = said["header"]["type"]
    if kind in _SUR_NO_HEIGHTS:
        return f"holds an object of type {kind}, which is no surface"
    return None


def _check_vk(path: Path, said: dict) -> str | None:
    if said["height_data"]["header"]["compression"]:
        return "its heights are compressed, which is not understood here"
    return None


def _first_line(error: BaseException) -> str:
    lines = str(error).strip().splitlines()
    said = f"{type(error).__name__}: {plain_text(lines[0])}" if lines else type(error).__name__
    return said if error.__cause__ is None else f"{said} {_first_line(error.__cause__)}"
