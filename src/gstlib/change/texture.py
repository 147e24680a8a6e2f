"""Areal surface texture of a patch before and after use, ISO 25178-2.

Most parameters are computed by surfalize (Schell, Zwahr & Lasagni 2024, Nanomaterials 14:1076).
They are meaningful only with their filters (ISO 25178-3). The F-operator removes the least-squares
plane, the S-filter removes waves shorter and the L-filter waves longer than its nesting index. Both
filters are Gaussian (ISO 16610-61).
"""

import logging
import warnings
from collections.abc import Mapping

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.errors import NOTE, InputError
from gstlib.surfaces.filtering import low_pass
from gstlib.surfaces.grid import MM_TO_UM, spacing_of, spacing_of_heights
from gstlib.surfaces.leveling import remove_plane

__all__ = ["measure_texture", "texture_rows"]

_log = logging.getLogger(__name__)

# Columns of the table: the symbols of the standard, and units. Volumes are per projected area.
_COLUMNS = [
    "Sa_um",
    "Sq_um",
    "Sz_um",
    "Ssk",
    "Sku",
    "Sdq",
    "Sdr_percent",
    "Sal_um",
    "Str",
    "Sk_um",
    "Spk_um",
    "Svk_um",
    "Smr1_percent",
    "Smr2_percent",
    "Vmp_um3_per_um2",
    "Vmc_um3_per_um2",
    "Vvc_um3_per_um2",
    "Vvv_um3_per_um2",
]

# Defaults of ISO 25178-3: material ratios (%) that separate peaks from core and core from dales.
_PEAKS, _DALES = 10.0, 80.0
# The equivalent line belongs to the flattest part of the material ratio curve, this wide (%).
_LINE_WIDTH = 40.0
# Classes of the material ratio curve. With this number, the line is accurate to 1e-4.
_CLASSES = 2001
# A number of points this close to a whole number counts as whole.
_ROUNDING = 1e-6
# The shortest wave of a grid has two points; a little more, for rounding.
_NYQUIST = 2.01


def measure_texture(
    scans: Mapping[str, xr.Dataset],
    changes: Mapping[str, xr.Dataset],
    *,
    s_filter_um: float,
    l_filter_um: float | None,
) -> pd.DataFrame:
    """Areal texture of each patch before and after use, and the change (ISO 25178-2).

    `scans` are the scans at T0, `changes` the height changes of the patches with a T1. The filters
    are given by their nesting indices, None for no L-filter. The rows are those of `texture_rows`.

    Examples
    --------
    >>> import gstlib, numpy as np
    >>> wave = np.cos(2 * np.pi * (np.arange(64) + 0.5) / 16) * np.ones((64, 1))
    >>> scan = gstlib.make_surface(1e-3 * wave, spacing=1e-3).to_dataset(name="height")
    >>> table = gstlib.measure_texture({"7": scan}, {}, s_filter_um=0.1, l_filter_um=None)
    >>> table[["epoch", "Sq_um"]].round(3).values.tolist()
    [['T0', 0.707]]
    """
    rows, noisy = [], []
    for patch in scans:
        scan, change = scans[patch], changes.get(patch)
        of_patch = texture_rows(
            scan.height, change, s_filter_um=s_filter_um, l_filter_um=l_filter_um
        )
        if change is not None and len(of_patch) == 1:
            _log.log(
                NOTE,
                "patch %s: T1 was not found on T0, or covers too little of it. The texture is "
                "measured at T0 alone",
                patch,
            )
        rows += [{"patch": patch, **row} for row in of_patch]
        # Of scans from `prepare_scan`: the shortest waves that exceed the noise of single points.
        shortest_um = scan.attrs.get("shortest_trusted_um", 0.0)
        finest_um = _NYQUIST * MM_TO_UM * max(spacing_of(scan.height))
        if not shortest_um <= max(s_filter_um, finest_um):
            noisy.append(patch)
    if noisy:
        _log.warning(
            "on %d of %d scans, noise has more than half the power at some wavelengths above "
            "texture.s_filter_um (%g µm), first on patch %s. Raise the filter to "
            "shortest_trusted_um in preprocessing.csv",
            len(noisy),
            len(scans),
            s_filter_um,
            noisy[0],
        )
    return pd.DataFrame(rows)


def texture_rows(
    t0: xr.DataArray,
    registered: xr.Dataset | None,
    *,
    s_filter_um: float,
    l_filter_um: float | None,
) -> list[dict[str, str | float]]:
    """The rows of one patch: T0, T1 and the change, all over the same area, or T0 alone.

    Parameters
    ----------
    t0 : (y, x) xarray.DataArray
        Heights before use, mm, no NaN.
    registered : xarray.Dataset or None
        From `gstlib.change.change.register_patch`; None without a T1.
    s_filter_um, l_filter_um : float
        Nesting indices of the filters: waves of this length pass at half their height. None for no
        L-filter (an S-F surface instead of an S-L surface).

    Returns
    -------
    list of dict
        ``epoch`` (``T0``, ``T1``, ``change``: T1 minus T0), ``size_x_mm`` and ``size_y_mm`` of the
        evaluated rectangle, and the parameters from ``Sa_um`` to ``Vvv_um3_per_um2``. Sal is NaN if
        the autocorrelation does not decay within the map, and Str if it does not decay in every
        direction. T1 is compared if it was registered to T0 and covers a rectangle as long and as
        wide as the longest nesting index. Otherwise the only row is T0, over its whole area.
    """
    spacing = spacing_of(t0)
    epochs = {"T0": t0}
    if registered is not None and registered.attrs["registration_found"]:
        window = _measured_rectangle(np.isfinite(registered["t1"].values))
        # The sides of the standard's evaluation area have at least the nesting index of the
        # L-filter.
        least = (l_filter_um or s_filter_um) / MM_TO_UM
        if (np.multiply(t0[window].shape, spacing) >= least).all():
            epochs = {"T0": t0[window], "T1": registered["t1"][window]}
    table = pd.DataFrame(index=_COLUMNS)
    for epoch, surface in epochs.items():
        table[epoch] = _parameters(surface, s_filter_um, l_filter_um)
    if "T1" in table:
        table["change"] = table.T1 - table.T0
    size_y, size_x = np.multiply(epochs["T0"].shape, spacing)
    return [
        {"epoch": epoch, "size_x_mm": size_x, "size_y_mm": size_y, **values}
        for epoch, values in table.to_dict().items()
    ]


def _parameters(
    surface: xr.DataArray, s_filter_um: float, l_filter_um: float | None
) -> list[float]:
    """Parameters of a surface (mm) after its filters, in the order of `_COLUMNS`."""
    try:  # here, for its import costs a second, which every job of the study would pay
        from surfalize import Surface
    except ImportError as error:
        problem = "surfalize, which measures it, is not installed"
        raise InputError(
            "texture", problem, "Install it: pip install 'gstlib[texture]'"
        ) from error

    heights = _scale_limited(surface, s_filter_um, l_filter_um)
    dy, dx = (step * MM_TO_UM for step in spacing_of(surface))
    # Waves that pass the S-filter vary over its nesting index. So two points in that length give
    # the same autocorrelation as all points, at a fraction of the cost.
    halves = (s_filter_um / (2 * step) for step in (dy, dx))
    every_y, every_x = (max(1, int(points + _ROUNDING)) for points in halves)
    values = _material_ratio(heights)
    with warnings.catch_warnings(action="ignore"):
        # Warnings about different steps in x and y, which do not affect these parameters; and about
        # NaN, if the autocorrelation does not decay within the map.
        evaluated = Surface(heights, dx, dy)
        sparse = Surface(heights[::every_y, ::every_x], every_x * dx, every_y * dy)
        values |= {"Sal": sparse.Sal(), "Str": sparse.Str()}
        for symbol in ("Sa", "Sq", "Sz", "Ssk", "Sku", "Sdq", "Sdr"):
            values[symbol] = getattr(evaluated, symbol)()
    return [values[column.partition("_")[0]] for column in _COLUMNS]


def _material_ratio(heights: np.ndarray) -> dict[str, float]:
    """Sk family and volumes, from the material ratio curve (ISO 25178-2, annex B).

    surfalize sums these areas class by class. With its 10,000 classes, it agrees within 0.3 %, but
    doubles the cost of all parameters. With 2001 classes, its Svk is 12 % too high if a few points
    are deep. Here, these areas are means over the heights.
    """
    ratio = np.linspace(0, 100, _CLASSES)
    curve = np.quantile(heights, 1 - ratio / 100)
    starts = ratio[ratio <= 100 - _LINE_WIDTH]
    ends = starts + _LINE_WIDTH
    # The secant of the smallest gradient of the falling curve.
    rise = np.interp(ends, ratio, curve) - curve[: starts.size]
    first = int(np.argmax(rise))
    last = np.searchsorted(ratio, ends[first], side="right")
    slope, top = np.polyfit(ratio[first:last], curve[first:last], 1)
    line = [top, top + 100 * slope]
    smr1, smr2 = np.interp(line, curve[::-1], ratio[::-1])
    levels = np.interp([smr1, smr2, _PEAKS, _DALES], ratio, curve)
    peaks, _, material, core = (
        np.maximum(heights - level, 0).mean() for level in levels
    )
    _, dales, void, deep = (np.maximum(level - heights, 0).mean() for level in levels)
    return {
        "Sk": -100 * slope,
        # Triangles of the same areas over the same fractions.
        "Spk": 200 * peaks / smr1 if smr1 > 0 else 0.0,
        "Svk": 200 * dales / (100 - smr2) if smr2 < 100 else 0.0,
        "Smr1": smr1,
        "Smr2": smr2,
        "Vmp": material,
        "Vmc": core - material,
        "Vvc": void - deep,
        "Vvv": deep,
    }


def _scale_limited(
    surface: xr.DataArray, s_filter_um: float, l_filter_um: float | None
) -> np.ndarray:
    """Heights (µm) without their plane, and without the waves that the filters remove."""
    spacing = [MM_TO_UM * step for step in spacing_of_heights(surface)]
    level, _ = remove_plane(surface)
    heights = low_pass(level.values * MM_TO_UM, spacing, s_filter_um)
    if l_filter_um is not None:
        heights = heights - low_pass(heights, spacing, l_filter_um)
    return heights


def _measured_rectangle(measured: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns of a rectangle in which every point is measured; empty if there is none.

    The measured region (ny, nx) is convex, such as the overlap of two scans. The side of the
    rectangle with the most unmeasured points is removed until all points are measured.
    """
    top, left, (bottom, right) = 0, 0, measured.shape
    while not (region := measured[top:bottom, left:right]).all():
        sides = region[0], region[-1], region[:, 0], region[:, -1]
        worst = np.argmax([1 - side.mean() for side in sides])
        top, bottom = top + (worst == 0), bottom - (worst == 1)
        left, right = left + (worst == 2), right - (worst == 3)
    return slice(top, bottom), slice(left, right)
