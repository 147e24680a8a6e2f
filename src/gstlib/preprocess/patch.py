"""From the file of a scan to the clean surface of its patch."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path

import xarray as xr

from gstlib.io.scans import check_size, cut_scan, read_scan, read_settings
from gstlib.preprocess.mould import unmould
from gstlib.preprocess.scan import prepare_scan

__all__ = ["clean_scan"]

# several patches may be pieces of one scan
_read_once = lru_cache(maxsize=1)(read_scan)


def clean_scan(
    scan: Path,
    *,
    crop: Sequence[float] | None,
    patch_mm: float,
    scans: Mapping,
    preprocessing: Mapping,
) -> xr.Dataset:
    """Read a scan, cut the patch out of it and clean it.

    Parameters
    ----------
    scan : path
    crop : (x, y) or None
        Centre (mm) of the piece to cut; None for a whole scan.
    patch_mm : float
        Side of a patch.
    scans, preprocessing : mapping
        These sections of the config.

    Returns
    -------
    xarray.Dataset
        As of `gstlib.preprocess.scan.prepare_scan`, and ``measured`` (y, x), the heights (mm) that
        it was made from, un-moulded.
    """
    raw = _read_once(scan, **read_settings(scans))
    if crop is None:
        check_size(raw, patch_mm)
    else:
        raw = cut_scan(raw, crop, patch_mm)
    mould = scans["mould"]
    prepared = prepare_scan(
        raw, mould_invert=mould["invert"], mould_flip=mould["flip"], **preprocessing
    )
    prepared["measured"] = unmould(raw, invert=mould["invert"], flip_axis=mould["flip"])
    return prepared
