"""A finer surface within the contact of a larger one: a patch, or the square in its face.

The forces outside its outline displace it with its surroundings, and it tilts like the larger
surface.
"""

from pathlib import Path

import numpy as np
import xarray as xr

from gstlib.bem.halfspace import HalfSpace
from gstlib.bem.layer import Layer
from gstlib.contact import Contact, Interface, turned_over
from gstlib.surfaces.filtering import s_filtered
from gstlib.surfaces.footprints import (
    PatchPosition,
    check_size,
    footprint_weights,
    on_patch,
    rotated,
    spline_of,
)
from gstlib.surfaces.grid import spacing_of
from gstlib.surfaces.leveling import Plane, remove_plane

__all__ = ["place_patch", "placed_faces", "prepare_faces", "surroundings"]


def surroundings(
    pressure: xr.DataArray,
    place: PatchPosition,
    shape: tuple[int, int],
    *,
    size_mm: float,
    contact_modulus_MPa: float,
    layer: Layer | None = None,
) -> np.ndarray:
    """Displacement of a patch by the macroscale pressures outside its outline.

    `pressure` (y, x) is the macroscale contact pressure, MPa. An element that the edge cuts counts
    by the fraction of its area outside. A `layer` may be in front of the stone. The result has the
    `shape` of the scan, in mm, positive into the stone.
    """
    inside = footprint_weights(pressure, place, size_mm)
    square = HalfSpace(
        pressure.shape, spacing_of(pressure), contact_modulus_MPa, layer=layer
    )
    displaced = pressure.copy(data=square.displacement(pressure.values * (1 - inside)))
    return on_patch(spline_of(displaced), place, shape, size_mm)


def prepare_faces(
    height: xr.DataArray,
    face: xr.DataArray | None,
    *,
    s_filter_um: float | None,
    source: str | Path,
) -> tuple[xr.DataArray, xr.DataArray | None]:
    """A prepared scan and a prepared scan of the active tool, as they are pressed on each other.

    `height` (y, x) is the scan of the patch; `face` (y, x) is the scan of the active tool, or None.
    `source` is the file of the patch, for messages. Both are S-filtered, and the face is turned
    over.
    """
    level = s_filtered(height, s_filter_um)
    if face is None:
        return level, None
    filtered = s_filtered(face, s_filter_um)
    return level, turned_over(
        filtered, height, source="counterface", patch_source=source
    )


def place_patch(
    height: xr.DataArray,
    face: xr.DataArray | None,
    composite: xr.Dataset,
    contact: Contact,
    patch: str,
) -> Interface:
    """A patch in the stone in equilibrium, among the pressures around it.

    Parameters
    ----------
    height, face
        From `prepare_faces`.
    composite : xarray.Dataset
        The surface with the positions and planes of its patches, from
        `gstlib.macroscale.composite.compose_surface`.
    contact : Contact
        Contact of the composite at the target pressure.
    patch : str

    Raises
    ------
    InputError
        The scan is not as large as a patch.
    """
    at = composite.sel(patch=patch)
    slopes = float(at.slope_y), float(at.slope_x)
    size_mm = float(composite.patch_mm)
    check_size(height, size_mm, f"patch {patch}")
    return placed_faces(
        height,
        face,
        contact,
        PatchPosition.from_dataset(at),
        size_mm=size_mm,
        slopes=slopes,
    )


def placed_faces(
    height: xr.DataArray,
    face: xr.DataArray | None,
    contact: Contact,
    place: PatchPosition,
    *,
    size_mm: float,
    slopes: tuple[float, float] = (0.0, 0.0),
) -> Interface:
    """A finer surface within the contact of a larger one that contains it.

    Parameters
    ----------
    height : (y, x) xarray.DataArray
        The finer surface, mm.
    face : (y, x) xarray.DataArray, optional
        A scan of the counterface, mm, turned over.
    contact : Contact
        Contact of the larger surface.
    place : PatchPosition
        Position of the finer surface on the larger one.
    size_mm : float
        Side of the finer surface, mm.
    slopes : (float, float)
        Slopes of its plane on the larger surface, along its own axes.

    Returns
    -------
    Interface
        Its plane is tilted like the larger surface in equilibrium. Its counterface is the part of
        the larger counterface above it, and ends where that ends; a scan of that face lies on its
        plane. Its surroundings are displacements by the pressures around it.
    """
    ny, nx = height.shape
    displaced = surroundings(
        contact.pressure,
        place,
        (ny, nx),
        size_mm=size_mm,
        contact_modulus_MPa=contact.modulus,
    )
    larger = contact.interface
    if larger.counterface.values.any():
        over = _counterface_over(larger.counterface, place, (ny, nx), size_mm)
        posed = height.copy(data=over)
        face = posed if face is None else face + (posed - remove_plane(posed)[0])
    tilt = rotated(larger.plane.slope_y, larger.plane.slope_x, -place.rotation_deg)
    plane = Plane(0.0, slopes[0] + tilt[0], slopes[1] + tilt[1])
    over_it = xr.zeros_like(height) if face is None else face
    return Interface(height, over_it, plane, displaced)


def _counterface_over(
    larger: xr.DataArray, place: PatchPosition, shape: tuple[int, ...], size_mm: float
) -> np.ndarray:
    """The part of a larger counterface above a patch (ny, nx), mm; NaN where it ends."""
    over = on_patch(spline_of(larger), place, shape, size_mm)
    missing = np.isnan(larger.values)
    if missing.any():
        share = larger.copy(data=missing.astype(float))
        over[on_patch(spline_of(share), place, shape, size_mm) > 0.5] = np.nan
    return over
