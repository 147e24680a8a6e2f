"""One scan pressed on a flat, without a study."""

import warnings
from pathlib import Path

import xarray as xr

from gstlib.bem.errors import ContactError, ContactWarning
from gstlib.bem.loading import LoadPath, load_path
from gstlib.errors import InputError
from gstlib.io.scans import read_scan
from gstlib.preprocess.scans import prepare_scan

__all__ = ["press_scan"]

_STEPS = 20


def press_scan(
    path: Path,
    *,
    pressure: float,
    modulus: float,
    periodic: bool = False,
    unit: str | None = None,
    spacing_um: float | None = None,
) -> tuple[xr.DataArray, LoadPath, list[str]]:
    """Clean, level and press a scan up to a mean pressure.

    `pressure` and `modulus` are in MPa; a `periodic` surface repeats itself; `unit` and
    `spacing_um` are as in `gstlib.io.scans.read_scan`. The result is what was pressed (y, x), mm,
    its contact, and what was hardly meant.
    """
    height = prepare_scan(read_scan(path, unit=unit, spacing_um=spacing_um))["height"]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ContactWarning)
        try:
            contact = load_path(
                height,
                contact_modulus=modulus,
                target_pressure=pressure,
                steps=_STEPS,
                periodic=periodic,
            )
        except ContactError as error:
            raise InputError(
                path, str(error), "Look at its picture: gst inspect."
            ) from error
    return height, contact, [str(warning.message) for warning in caught]
