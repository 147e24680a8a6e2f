"""The `.plu` format of Sensofar and Leica confocal profilers: reads and writes height maps.

The paper's instrument writes it, and so does the synthetic specimen. SurfaceTopography reads it,
too, but takes longer to import than this reader takes for fifty scans. The layout agrees with
measured files (format version of 2012) and Gwyddion's sensofar.c.
"""

import contextlib
import struct
from datetime import datetime
from pathlib import Path

import numpy as np

from gstlib.errors import FaultError, refuse
from gstlib.io.files import UnreadableError, write_whole
from gstlib.io.stage import RawMap, stage_attrs

__all__ = ["read_plu", "write_plu"]

# The instrument's own mark of an unmeasured point.
_UNMEASURED_UM = 1000001.0

_HEADER = 508  # bytes, with the rows and columns of the first layer
_LARGEST_SIDE = 1 << 16
# The lowest and the highest height, or marks for missing ones. They follow the heights.
_ENDS = struct.Struct("<2f")
# Names of the instruments and of the DCM 3D's objectives, by their numbers in the format.
_INSTRUMENTS = {
    0: "PLu", 1: "PLu 2300 XGA", 2: "PLu 2300 XGA T5", 3: "PLu 2300 SXGA", 4: "PLu 3300",
    5: "DCM 3D", 6: "PLu neox", 7: "DCM 3D rev. 2", 9: "S neox", 10: "DCM8", 11: "PLu Apex",
}  # fmt: skip
_OBJECTIVES = {
    14: "Nikon CFI Plan Interferential 10X", 32: "Leica HCX FL Plan 2.5X",
    33: "Leica HC PL Fluotar EPI 5X", 34: "Leica HC PL Fluotar EPI 10X",
    35: "Leica HC PL Fluotar EPI 20X", 36: "Leica HC PL Fluotar EPI 50X",
    37: "Leica HC PL Fluotar EPI 50X HNA", 38: "Leica HC PL Fluotar EPI 100X",
}  # fmt: skip

# Measurement type, algorithm, method, objective and area type of a measured Leica DCM 3D file.
_TYPE_TOPOGRAPHY = 3
_CONFIGURATION = (_TYPE_TOPOGRAPHY, 1, 0, 34, 3)
_VERSION_2012, _DCM_3D_REV_2 = 251, 7
# Written files do not depend on the clock.
_WRITTEN, _WRITTEN_SECONDS = b"Thu Jan  1 00:00:00 1970", 0


def read_plu(path: Path) -> RawMap:
    """Read the first topography of a `.plu`, as a reader of `gstlib.io.scans`.

    Raises
    ------
    InputError
        The file is shorter than its header states, or contains no topography, or its lowest or
        highest height differs from the stated one.
    """
    content = path.read_bytes()
    _check_size(content, _HEADER)
    (kind,) = struct.unpack_from("<I", content, 428)
    ny, nx = struct.unpack_from("<2I", content, 500)
    is_map = min(ny, nx) > 0 and max(ny, nx) < _LARGEST_SIDE
    if kind != _TYPE_TOPOGRAPHY or not is_map:
        raise UnreadableError(
            f"contains a measurement of type {kind} with {ny} × {nx} points: not a .plu "
            f"topography (type {_TYPE_TOPOGRAPHY})",
            "Export the whole topography, or correct the file's ending.",
        )
    end = _HEADER + 4 * ny * nx
    _check_size(content, end + _ENDS.size)
    stored = np.frombuffer(content, "<f4", ny * nx, _HEADER).reshape(ny, nx)
    with np.errstate(invalid="ignore"):  # some bytes are no numbers
        heights = stored.astype(float)
    heights[heights == _UNMEASURED_UM] = np.nan
    _check_ends(path, heights, _ENDS.unpack_from(content, end))
    dx, dy, x, y = struct.unpack_from("<4f", content, 404)
    (objective,) = struct.unpack_from("<I", content, 440)
    layers, version, instrument = content[489:492]
    attrs = {
        "vendor": "Sensofar",
        "objective": _OBJECTIVES.get(objective, f"no. {objective}"),
    }
    # Older and later versions store something else instead of the instrument.
    if 0 < version <= _VERSION_2012 and instrument in _INSTRUMENTS:
        attrs = {"instrument": _INSTRUMENTS[instrument], **attrs}
    words, *_ = content[:128].partition(b"\0")
    date = words.decode("latin-1").strip()
    with contextlib.suppress(ValueError):
        date = str(datetime.strptime(date, "%a %b %d %H:%M:%S %Y"))
    attrs["acquired"] = date
    # in µm: the two measured files are then at 6 and 58 mm, within the travel of such a stage
    attrs |= stage_attrs(x, y, 1e-3)
    if layers > 1:
        attrs["layer"] = f"layer0, the first of {layers} height maps"
    return heights, (dy, dx), 1e-3, attrs


def _check_size(content: bytes, needed: int) -> None:
    if len(content) < needed:
        raise UnreadableError(
            f"takes {needed} bytes, but has {len(content)}: it is truncated",
            "Export or copy the scan again.",
        )


def _check_ends(path: Path, heights: np.ndarray, stated: tuple[float, float]) -> None:
    """Refuse heights with missing or added bytes, after which other bytes follow.

    The lowest and the highest height follow or, in both measured files, numbers for missing ones.
    """
    measured = heights[np.isfinite(heights)]
    if not measured.size:
        return
    lowest, highest = float(measured.min()), float(measured.max())
    none = {-_UNMEASURED_UM, _UNMEASURED_UM}
    if stated[0] not in none | {lowest} or stated[1] not in none | {highest}:
        problem = (
            f"holds heights from {lowest:g} to {highest:g} µm, but states {stated[0]:g} to "
            f"{stated[1]:g}: it is damaged"
        )
        refuse(FaultError("odd_scan", path, problem, "Export or copy the scan again."))


def write_plu(
    path: str | Path,
    heights: np.ndarray,
    spacing: tuple[float, float] | float,
    *,
    comment: str = "",
) -> None:
    """Write a height map, complete or not at all.

    Parameters
    ----------
    path : str or Path
        Target file. Its folder is created if it does not exist.
    heights : (ny, nx) array_like
        Heights in mm, NaN where unmeasured. Row i of the file is row i of the array, and heights
        are stored as float32 in µm.
    spacing : float or (dy, dx)
        Distance of points in mm.
    comment : str
        Up to 255 characters, stored beside the heights.

    Examples
    --------
    >>> import gstlib, pathlib, tempfile
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = pathlib.Path(folder.name) / "scan.plu"
    >>> gstlib.write_plu(path, [[0.0, 0.002], [0.001, np.nan]], 0.5)
    >>> gstlib.read_scan(path).round(6).values.tolist()
    [[0.0, 0.002], [0.001, nan]]
    """
    heights_um = np.asarray(heights, dtype=float) * 1e3
    values = heights_um.astype("<f4")
    stored = values.copy()
    stored[np.isnan(values)] = _UNMEASURED_UM
    is_measured = np.isfinite(values)
    measured = values[is_measured] if is_measured.any() else stored
    lowest, highest = float(measured.min()), float(measured.max())
    ny, nx = values.shape
    dy, dx = (float(step) * 1e3 for step in np.broadcast_to(spacing, 2))
    header = [
        # date, in words and in seconds; the comment, a C string, keeps its last byte zero
        struct.pack("<128sI256s", _WRITTEN, _WRITTEN_SECONDS, comment.encode()[:255]),
        # points along y, x and (tall) z; scale along y of a tall map; steps x, y; stage x, y;
        # tall, z
        struct.pack("<3I7f", ny, nx, nx, 1.0, dx, dy, 0.0, 0.0, dx, 0.0),
        struct.pack("<5I", *_CONFIGURATION),
        struct.pack("<5IdfII", ny, nx, ny, nx, 1, 2.0, highest - lowest, 1, 0),
        # restore, layers, version, hardware, images, 3 reserved, decimation
        struct.pack("<5B3xI", 0, 1, _VERSION_2012, _DCM_3D_REV_2, 0, 1),
        struct.pack("<2I", ny, nx),
    ]
    content = [*header, stored.tobytes(), _ENDS.pack(lowest, highest)]
    write_whole(path, b"".join(content))
