"""The coupling of the scales: what the macroscale contact gives to each patch.

The force on a patch is the sum of the macroscale contact forces in its footprint; elements cut by
the footprint's edge count by the share of their area inside. Footprints that tile a region thus
share out its force without loss, wherever they lie. The forces outside the footprint press the
patch down with its surroundings, and it tilts as the stone does. So does the whole square at the
scans' resolution in the face around it (`placed_faces` serves both).
"""

# ASSUME: the x and y of a patch are those of its centre; the paper gives the place by its x and y.

from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.bem import HalfSpace, Layer
from gstlib.contact import faces_of, turned_over
from gstlib.geometry import Place, footprint_weights, on_patch, places_of, rotated, spline_of
from gstlib.preprocess.filtering import s_filtered
from gstlib.preprocess.leveling import remove_plane
from gstlib.surface import spacing_of

__all__ = [
    "couple_scales",
    "patch_pressures",
    "place_patch",
    "placed_faces",
    "prepare_faces",
    "surroundings",
]


def patch_pressures(
    pressure: xr.DataArray, patches: pd.DataFrame, *, size_mm: float
) -> pd.DataFrame:
    """Nominal pressure of each patch from the macroscale contact pressure.

    Parameters
    ----------
    pressure : (ny, nx) xarray.DataArray
        Contact pressure at the target, MPa, in the square's frame (mm); the face may go beyond it.
    patches : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg``.
    size_mm : float
        Side of a patch.

    Returns
    -------
    pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg``; ``force_N``, the force on the footprint;
        ``pressure_MPa``, over its nominal area; ``peak_pressure_MPa``, largest pressure of an
        element in it.
    """
    area, values, rows = np.prod(spacing_of(pressure)), pressure.values, []
    for place in places_of(patches).values():
        weights = footprint_weights(pressure, place, size_mm)
        force = float((values * weights).sum() * area)
        peak = float(values[weights > 0].max(initial=0.0))
        rows.append((force, force / size_mm**2, peak))
    found = "force_N", "pressure_MPa", "peak_pressure_MPa"
    table = patches[["patch", "x_mm", "y_mm", "rotation_deg"]].reset_index(drop=True)
    return table.join(pd.DataFrame(rows, columns=found))


def couple_scales(
    contact: xr.Dataset, square_contact: xr.Dataset, patches: pd.DataFrame, *, patch_mm: float
) -> pd.DataFrame:
    """Pressure of each patch: the macroscale forces in its outline over its area (section 2.3).

    `contact` is that of the stone at rest, `square_contact` that of the square alone on its mean
    plane, the paper's, and `patch_mm` the side of a patch. The result is that of `patch_pressures`
    with ``square_pressure_MPa``, the pressure by the square alone.
    """
    pressures = patch_pressures(contact.pressure, patches, size_mm=patch_mm)
    alone = patch_pressures(square_contact.pressure, patches, size_mm=patch_mm)
    return pressures.assign(square_pressure_MPa=alone.pressure_MPa)


def surroundings(
    pressure: xr.DataArray,
    place: Place,
    shape: tuple[int, int],
    *,
    size_mm: float,
    contact_modulus_MPa: float,
    layer: Layer | None = None,
) -> np.ndarray:
    """Displacement of a patch by the macroscale pressures outside its outline.

    `pressure` (y, x) is the macroscale contact pressure, MPa; of an element that the edge cuts, the
    share of its area outside counts. A `layer` may be in front of the stone. The result is of
    `shape`, that of the scan, in mm, positive into the stone.
    """
    inside = footprint_weights(pressure, place, size_mm)
    square = HalfSpace(pressure.shape, spacing_of(pressure), contact_modulus_MPa, layer=layer)
    displaced = pressure.copy(data=square.displacement(pressure.values * (1 - inside)))
    return on_patch(spline_of(displaced), place, shape, size_mm)


def prepare_faces(
    height: xr.DataArray,
    face: xr.DataArray | None,
    *,
    s_filter_um: float | None,
    source: str | Path,
) -> tuple[xr.DataArray, xr.DataArray | None]:
    """A prepared scan and that of the active stone's own face, as they are pressed on each other.

    `height` (y, x) is the patch's, `face` (y, x) that of the active stone, None where it was not
    scanned; `source` is the patch's file, for messages. Both go through the S-filter, and the face
    is turned over.
    """
    level = s_filtered(height, s_filter_um)
    if face is None:
        return level, None
    filtered = s_filtered(face, s_filter_um)
    return level, turned_over(filtered, height, source="counterface", patch_source=source)


def place_patch(
    height: xr.DataArray,
    face: xr.DataArray | None,
    composite: xr.Dataset,
    contact: xr.Dataset,
    patch: str,
) -> xr.Dataset:
    """A patch as it lies on the stone at rest, among the pressures around it.

    Parameters
    ----------
    height, face
        From `prepare_faces`.
    composite : xarray.Dataset
        The surface with the places and planes of its patches, from
        `gstlib.composite.compose_surface`.
    contact : xarray.Dataset
        Its contact at the target pressure.
    patch : str

    Returns
    -------
    xarray.Dataset
        That of `placed_faces`.
    """
    at = composite.sel(patch=patch)
    slopes = float(at.slope_y), float(at.slope_x)
    size_mm = float(composite.patch_mm)
    return placed_faces(height, face, contact, Place.of(at), size_mm=size_mm, slopes=slopes)


def placed_faces(
    height: xr.DataArray,
    face: xr.DataArray | None,
    contact: xr.Dataset,
    place: Place,
    *,
    size_mm: float,
    slopes: tuple[float, float] = (0.0, 0.0),
) -> xr.Dataset:
    """A finer surface as it lies in the contact of a larger one that contains it.

    Parameters
    ----------
    height : (y, x) xarray.DataArray
        The finer surface, mm.
    face : (y, x) xarray.DataArray, optional
        A scan of what is pressed on it, mm, turned over.
    contact : xarray.Dataset
        Of the larger one.
    place : Place
        Where the finer one lies on it.
    size_mm : float
        Its side.
    slopes : (float, float)
        Of its plane on the larger surface, along its own axes.

    Returns
    -------
    xarray.Dataset
        That of `gstlib.contact.faces_of`: the plane tilted as the larger surface is at rest; in
        ``counterface`` the face that is pressed on the larger one there (a scan of that face lies
        on its plane); ``surroundings``, what the pressures around it displace.
    """
    ny, nx = height.shape
    displaced = surroundings(
        contact.pressure,
        place,
        (ny, nx),
        size_mm=size_mm,
        contact_modulus_MPa=float(contact.contact_modulus),
    )
    if contact.counterface.values.any():
        over = on_patch(spline_of(contact.counterface), place, (ny, nx), size_mm)
        posed = height.copy(data=over)
        face = posed if face is None else face + (posed - remove_plane(posed)[0])
    tilt = rotated(float(contact.slope_y), float(contact.slope_x), -place.rotation_deg)
    lies = slopes[0] + tilt[0], slopes[1] + tilt[1]
    return faces_of(height, face, slopes=lies, surroundings=displaced)
