"""What is true about a generated specimen: kept beside it, so that every stage can be scored.

One file, ``truth.h5``. Maps of scans have the dims ``(patch, epoch, y, x)`` or ``(patch, y, x)``
(then on the T0 scan) and lie as on the stone, that is, un-moulded. The macroscale surface has the
dims ``(macroscale_y, macroscale_x)``.
"""

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.surface import axis_coordinates, make_surface

__all__ = ["EPOCHS", "true_patches", "true_surface", "truth_dataset"]

EPOCHS = ("T0", "T1")


def truth_dataset(
    macroscale: np.ndarray,
    square_mm: float,
    scan_points: int,
    scan_spacing_mm: float,
    patches: list[str],
    values: dict[str, tuple[tuple[str, ...], object, str, str]],
    **attrs,
) -> xr.Dataset:
    """Put the truth together.

    Parameters
    ----------
    macroscale : (n, n) ndarray
        Mean height of the macroscale surface over each element of the analysis grid, mm.
    square_mm : float
        Side of the square.
    scan_points, scan_spacing_mm
        Points along each side of a scan, and their distance.
    patches : list of str
        Names of the patches, in the order of the arrays.
    values : dict
        Name to (dims, array, units, long name).
    **attrs
        Attributes of the dataset.
    """
    count = len(macroscale)
    along_square = axis_coordinates(count, square_mm / count)
    along_scan = axis_coordinates(scan_points, scan_spacing_mm)
    coordinates = {
        "patch": ("patch", patches),
        "epoch": ("epoch", list(EPOCHS)),
        "macroscale_y": ("macroscale_y", along_square, {"units": "mm"}),
        "macroscale_x": ("macroscale_x", along_square, {"units": "mm"}),
        "y": ("y", along_scan, {"units": "mm", "spacing": scan_spacing_mm}),
        "x": ("x", along_scan, {"units": "mm", "spacing": scan_spacing_mm}),
    }
    variables = {
        "macroscale_height": (
            ("macroscale_y", "macroscale_x"),
            macroscale,
            {
                "units": "mm",
                "long_name": "mean over each element of the surface without wavelengths below the "
                "cut-off, plane not removed",
                "spacing": square_mm / count,
            },
        )
    }
    for name, (dims, array, units, long_name) in values.items():
        variables[name] = (dims, array, {"units": units, "long_name": long_name})
    return xr.Dataset(variables, coordinates, attrs)


def true_surface(truth: xr.Dataset) -> xr.DataArray:
    """The true macroscale surface (mm) on the analysis grid, as a surface; plane not removed."""
    height = truth["macroscale_height"]
    return make_surface(height.values, height.attrs["spacing"], long_name="true macroscale surface")


def true_patches(truth: xr.Dataset, epoch: str = "T0") -> pd.DataFrame:
    """True places of the scans of `epoch`: columns ``patch, x_mm, y_mm, rotation_deg``."""
    at = truth.sel(epoch=epoch)
    return pd.DataFrame(
        {
            "patch": at.patch.values.astype(str),
            "x_mm": at.x_mm.values,
            "y_mm": at.y_mm.values,
            "rotation_deg": at.rotation_deg.values,
        }
    )
