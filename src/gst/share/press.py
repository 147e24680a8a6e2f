"""One scan pressed on a flat, without a study."""

import logging
import warnings
from pathlib import Path

import xarray as xr

from gstlib.bem.errors import ContactError, ContactWarning
from gstlib.bem.loading import LoadPath, load_path
from gstlib.bem.state import ContactState
from gstlib.errors import InputError
from gstlib.io.scans import read_scan
from gstlib.preprocess.scans import prepare_scan

_log = logging.getLogger(__name__)

_STEPS = 20


def press_scan(
    path: Path,
    *,
    pressure: float,
    modulus: float,
    periodic: bool = False,
    unit: str | None = None,
    spacing_um: float | None = None,
) -> tuple[xr.Dataset, LoadPath]:
    """Clean, level and press a scan up to a mean pressure.

    `pressure` and `modulus` are in MPa; a `periodic` surface repeats itself; `unit` and
    `spacing_um` are as in `gstlib.io.scans.read_scan`. The result is the prepared scan, whose
    ``height`` was pressed, and its contact. Doubts about the contact are logged.
    """
    prepared = prepare_scan(read_scan(path, unit=unit, spacing_um=spacing_um))
    with warnings.catch_warnings():
        warnings.simplefilter("always", ContactWarning)
        warnings.showwarning = lambda message, *_: _log.warning("%s: %s", path, message)
        try:
            contact = load_path(
                prepared["height"],
                contact_modulus=modulus,
                target_pressure=pressure,
                steps=_STEPS,
                periodic=periodic,
            )
        except ContactError as error:
            raise InputError(
                path, str(error), "Look at its picture: gst inspect."
            ) from error
    return prepared, contact


def describe_press(prepared: xr.Dataset, final: ContactState, modulus: float) -> str:
    """The preparation of a scan, and its final contact."""
    facts = prepared.attrs
    return (
        f"cleaned     {facts['unmeasured']} unmeasured points and {facts['outliers']} outliers "
        f"of {prepared['height'].size} points filled from around them\n"
        f"levelled    by {facts['tilt_x_mrad']:.2f} mrad along x "
        f"and {facts['tilt_y_mrad']:.2f} mrad along y\n"
        f"contact     {final.contact_fraction:.3%} of the area at {final.mean_pressure:.4g} MPa, "
        f"peak pressure {final.pressure.values.max():.4g} MPa, modulus E* {modulus:g} MPa"
    )
