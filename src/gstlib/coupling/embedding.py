"""A finer surface in the contact of a larger one: a patch on the stone, or the square in its face.

The forces outside its outline press it down with its surroundings, and it tilts as the larger one
does.
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

    `pressure` (y, x) is the macroscale contact pressure, MPa; of an element that the edge cuts, the
    share of its area outside counts. A `layer` may be in front of the stone. The result is of
    `shape`, that of the scan, in mm, positive into the stone.
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
    """A prepared scan and that of the active tool's own face, as they are pressed on each other.

    `height` (y, x) is the patch's, `face` (y, x) that of the active tool, None where it was not
    scanned; `source` is the patch's file, for messages. Both go through the S-filter, and the face
    is turned over.
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
    """A patch as it lies on the stone at rest, among the pressures around it.

    Parameters
    ----------
    height, face
        From `prepare_faces`.
    composite : xarray.Dataset
        The surface with the places and planes of its patches, from
        `gstlib.macroscale.composite.compose_surface`.
    contact : Contact
        Its contact at the target pressure.
    patch : str
    """
    at = composite.sel(patch=patch)
    slopes = float(at.slope_y), float(at.slope_x)
    size_mm = float(composite.patch_mm)
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
    """A finer surface as it lies in the contact of a larger one that contains it.

    Parameters
    ----------
    height : (y, x) xarray.DataArray
        The finer surface, mm.
    face : (y, x) xarray.DataArray, optional
        A scan of what is pressed on it, mm, turned over.
    contact : Contact
        Of the larger one.
    place : PatchPosition
        Where the finer one lies on it.
    size_mm : float
        Its side.
    slopes : (float, float)
        Of its plane on the larger surface, along its own axes.

    Returns
    -------
    Interface
        Its plane is tilted as the larger surface is at rest; its counterface is what is pressed on
        the larger one there (a scan of that face lies on its plane); its surroundings are what the
        pressures around it displace.
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
        over = on_patch(spline_of(larger.counterface), place, (ny, nx), size_mm)
        posed = height.copy(data=over)
        face = posed if face is None else face + (posed - remove_plane(posed)[0])
    tilt = rotated(larger.plane.slope_y, larger.plane.slope_x, -place.rotation_deg)
    plane = Plane(0.0, slopes[0] + tilt[0], slopes[1] + tilt[1])
    over_it = xr.zeros_like(height) if face is None else face
    return Interface(height, over_it, plane, displaced)
