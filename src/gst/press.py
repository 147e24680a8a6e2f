"""One scan pressed on a flat, without a study."""

import warnings
from pathlib import Path

import xarray as xr

from gstlib.bem import ContactError, ContactWarning, LoadPath, load_path
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

    Parameters
    ----------
    path : Path
    pressure, modulus : float
        Mean pressure and contact modulus, MPa.
    periodic : bool
        Whether the surface repeats itself.
    unit, spacing_um
        As in `gstlib.io.scans.read_scan`.

    Returns
    -------
    height : (y, x) xarray.DataArray
        What was pressed, mm.
    contact : LoadPath
    doubts : list of str
        What was hardly meant.
    """
    height = prepare_scan(read_scan(path, unit=unit, spacing_um=spacing_um))["height"]
    with warnings.catch_warnings(record=True) as said:
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
            raise InputError(path, str(error), "Look at its picture: gst inspect.") from error
    return height, contact, [str(warning.message) for warning in said]
