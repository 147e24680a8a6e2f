"""Writes height maps in the `.plu` format of Sensofar and Leica confocal profilers.

The layout follows the format as measured files have it (format version of 2012, hardware "DCM 3D
rev. 2", objective "Leica HC PL Fluotar EPI 10X"), so that any reader of such files takes them for
what the instrument would have written. Nothing in the file depends on the clock.
"""

import struct
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from gstlib.io.files import write_whole

__all__ = ["PLU_UNMEASURED_UM", "write_plu"]

# The instrument's own mark of an unmeasured point.
PLU_UNMEASURED_UM = 1000001.0

_TYPE_TOPOGRAPHY = 3
_OBJECTIVE_LEICA_10X = 34
_VERSION_2012 = 251
_HARDWARE_DCM_3D_REV_2 = 7
# Area type, algorithm and method as in a measured Leica DCM 3D file.
_ALGORITHM, _METHOD, _AREA_TYPE = 1, 0, 3
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def write_plu(
    path: str | Path,
    heights: np.ndarray,
    spacing: tuple[float, float] | float,
    *,
    comment: str = "",
    acquired: datetime = _EPOCH,
) -> None:
    """Write a height map, complete or not at all.

    Parameters
    ----------
    path : str or Path
        Target file; its folder is made if need be.
    heights : (ny, nx) array_like
        Heights in mm; NaN where unmeasured. Row i of the file is row i of the array, and heights
        are stored as float32 in µm.
    spacing : float or (dy, dx)
        Distance of points in mm.
    comment : str
        Up to 255 characters that the format holds beside the heights.
    acquired : datetime
        When the map was measured, with its time zone.

    Raises
    ------
    ValueError
        Not a map of two dimensions, an infinite height, or a height that the format reads as
        unmeasured.
    """
    write_whole(path, _encode(np.asarray(heights), spacing, comment, acquired))


def _encode(
    heights: np.ndarray, spacing: tuple[float, float] | float, comment: str, acquired: datetime
) -> bytes:
    if heights.ndim != 2 or heights.size == 0:
        raise ValueError(f"a height map has 2 dimensions and points, not shape {heights.shape}")
    if np.isinf(heights).any():
        raise ValueError("a height map holds finite heights, or NaN where unmeasured")
    values = (heights.astype(float) * 1e3).astype("<f4")
    if (values == np.float32(PLU_UNMEASURED_UM)).any():
        raise ValueError(f"a height of {PLU_UNMEASURED_UM} µm means unmeasured in this format")
    measured = values[np.isfinite(values)]
    lowest, highest = (
        (measured.min(), measured.max()) if measured.size else (PLU_UNMEASURED_UM,) * 2
    )
    ny, nx = values.shape
    dy, dx = (float(step) * 1e3 for step in np.broadcast_to(spacing, 2))
    header = struct.pack(
        "<128sI256s",
        acquired.ctime().encode("ascii"),
        int(acquired.timestamp()),
        # the last byte stays zero: the field is a C string
        comment.encode("utf-8")[:255],
    )
    # points along y, x and (tall) z; scale along y of a tall map; steps x, y; stage x, y; tall, z
    calibration = struct.pack("<3I7f", ny, nx, nx, 1.0, dx, dy, 0.0, 0.0, dx, 0.0)
    configuration = struct.pack(
        "<5I", _TYPE_TOPOGRAPHY, _ALGORITHM, _METHOD, _OBJECTIVE_LEICA_10X, _AREA_TYPE
    )
    scan = struct.pack("<5IdfII", ny, nx, ny, nx, 1, 2.0, float(highest - lowest), 1, 0)
    # restore, layers, version, hardware, images, 3 reserved, decimation
    tail = struct.pack("<5B3xI", 0, 1, _VERSION_2012, _HARDWARE_DCM_3D_REV_2, 0, 1)
    layer = struct.pack("<2I", ny, nx)
    stored = np.where(np.isnan(values), np.float32(PLU_UNMEASURED_UM), values)
    limits = struct.pack("<2f", lowest, highest)
    head = header + calibration + configuration + scan + tail + layer
    return head + stored.astype("<f4").tobytes() + limits
