"""The error of two scales: one contact of the whole square against the contacts of the patches.

The study presses the face on a coarse grid and each patch by itself. Both are shortcuts, which one
contact of the whole square with all its detail does not need. On a synthetic specimen, it is the
contact of the true surface, and shows all errors (mesh, positions, noise, coupling). On a measured
stone, it is the contact of the composite surface, and shows the error of the coupling alone.
Several draws of the detail show the influence of the unscanned parts on the results.
"""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.contact import Contact, Interface, Load, contact_at_pressure
from gstlib.coupling.embedding import placed_faces
from gstlib.coupling.placement import ALL
from gstlib.macroscale.composite import compose
from gstlib.surfaces.filtering import s_filtered
from gstlib.surfaces.footprints import (
    PatchPosition,
    check_size,
    footprint_weights,
    spline_of,
)
from gstlib.surfaces.grid import described, make_surface, spacing_of
from gstlib.surfaces.leveling import Plane, remove_plane
from gstlib.validation.masks import mask_counts, mask_scores

__all__ = [
    "drawn_surfaces",
    "patches_of_reference",
    "placed_whole",
    "solve_realisations",
    "solve_reference",
    "two_scales_table",
]

# Tolerance of the contact of the whole square, whose points the tables count to the last digit.
# Measured on the default specimen: at 1e-4, 102 of 155,424 points in contact differ from 1e-10, and
# another processor's rounding changes 2. At 1e-7, 0.05 points are expected to change, at 1e-8 0.01,
# at 1e-9 0.0002. This is the change of gaps and pressures times the density of points near the
# threshold. 1e-9 takes 5 s more CPU than 1e-4. (Started from the pressure of the draw before, a
# draw takes three times as long as from coarser grids.)
_TOLERANCE = 1e-9
_COUNTS = ["hits", "predicted", "touching", "points"]
_VARIABLES = {
    "contact": ("1", "in contact in the single-scale contact"),
    "pressure": ("MPa", "mean pressure in the single-scale contact"),
}


def drawn_surfaces(
    face: xr.Dataset,
    composite: xr.Dataset,
    scans: Mapping[str, xr.Dataset],
    *,
    draws: int,
    s_filter_um: float | None,
    seed: int,
) -> Iterator[xr.DataArray]:
    """The composite surface (y, x), mm, of the square at the scans' resolution, by draw.

    `face` and `scans` are the inputs from which `gstlib.macroscale.composite.compose_surface` made
    the `composite` on the macroscale grid. Detail between the scans is drawn from `seed`.
    """
    size_mm = float(face.size_mm)
    count = round(size_mm / spacing_of(scans[composite.patch.values[0]].height)[0])
    fine = make_surface(np.zeros((count, count)), size_mm / count)
    for draw in range(draws):
        yield compose(
            spline_of(face.height),
            _laid(composite, scans, s_filter_um),
            float(composite.patch_mm),
            fine,
            composite.density,
            np.random.default_rng([seed, 3, draw]),
        )


def _laid(
    composite: xr.Dataset, scans: Mapping[str, xr.Dataset], s_filter_um: float | None
) -> Iterator[tuple[PatchPosition, Plane, np.ndarray]]:
    """Position, plane and filtered heights of each scan, for `compose`."""
    for patch, place in _places(composite).items():
        at = composite.sel(patch=patch)
        plane = Plane(float(at.offset), float(at.slope_y), float(at.slope_x))
        yield place, plane, s_filtered(scans[patch].height, s_filter_um).values


def _places(patches: xr.Dataset) -> dict[str, PatchPosition]:
    """Position of each patch."""
    return {
        patch: PatchPosition.from_dataset(patches.sel(patch=patch))
        for patch in patches.patch.values
    }


def solve_realisations(
    surfaces: Iterable[xr.DataArray],
    contact: Contact,
    patches: xr.Dataset,
    scans: Mapping[str, xr.Dataset],
    *,
    source: str | Path = "reference",
) -> tuple[xr.Dataset, xr.Dataset]:
    """Press the whole square at the scans' resolution, once for each of its surfaces.

    Parameters
    ----------
    surfaces : iterable of (y, x) xarray.DataArray
        Heights of the square, mm, from `drawn_surfaces` or from a synthetic specimen.
    contact : Contact
        Contact of the face around it, as in `solve_reference`.
    patches : xarray.Dataset
        By ``patch``, their positions: ``x_mm, y_mm, rotation_deg``.
    scans : mapping of str to xarray.Dataset
        Scans of the patches, on one grid.
    source : path
        File of the surfaces, for messages.

    Returns
    -------
    whole : xarray.Dataset
        From `solve_reference`, for the first surface.
    patches : xarray.Dataset
        From `patches_of_reference`, by ``draw``.
    """
    places = _places(patches)
    scan = scans[next(iter(places))].height
    drawn: list[xr.Dataset] = []
    for heights in surfaces:
        solved = solve_reference(heights, contact, source=source)
        if not drawn:
            whole = solved
        drawn.append(patches_of_reference(solved.pressure, places, scan))
    return whole, xr.concat(drawn, "draw")


def solve_reference(
    heights: xr.DataArray, contact: Contact, *, source: str | Path = "reference"
) -> xr.Dataset:
    """One contact of the whole square at the scans' resolution, in the stone in equilibrium.

    `heights` (y, x) are the heights of the square, mm, and `contact` is the contact of the face
    around it. The square begins at (0, 0) in the coordinates of the face. It lies on the plane of
    the face, yields to the pressures outside, and carries its share of the force. The result has
    ``height`` mm, without its plane, and ``pressure`` MPa (y, x), in single precision.

    Examples
    --------
    A dome that rises by 2 µm touches on two fifths of the square:

    >>> import gstlib
    >>> face = Interface.on_flat(gstlib.make_surface(np.zeros((8, 8)), 0.5))
    >>> options = {"modulus": 1e4, "tolerance": 1e-6, "source": "face"}
    >>> contact = contact_at_pressure(face, gstlib.Load(2.0), **options)
    >>> y = np.linspace(-1, 1, 32)
    >>> dome = gstlib.make_surface(-1e-3 * np.add.outer(y**2, y**2), 0.1)
    >>> pressed = gstlib.solve_reference(dome, contact)
    >>> round(float((pressed.pressure > 0).mean()), 2)
    0.41
    """
    pressed, pressure_MPa = placed_whole(heights, contact)
    solved = contact_at_pressure(
        Interface.on_flat(pressed),
        Load(pressure_MPa),
        modulus=contact.modulus,
        tolerance=_TOLERANCE,
        source=source,
    ).to_dataset()
    level = remove_plane(heights)[0].assign_attrs(heights.attrs)
    return solved.assign(height=level)[["height", "pressure"]].astype(np.float32)


def placed_whole(heights: xr.DataArray, contact: Contact) -> tuple[xr.DataArray, float]:
    """The square as it lies in the stone in equilibrium, and its mean pressure.

    Parameters are as in `solve_reference`. The result is the surface (y, x), mm, to press on a
    flat, and the mean pressure on it, MPa. The surface lies on the plane of the face, less the
    counterface, and is displaced by the pressures outside.
    """
    size = spacing_of(heights)[0] * heights.sizes["y"]
    check_size(heights, size, "square")
    # A generated surface begins at its own first element, less than one element from the corner.
    middle = PatchPosition(*(float(heights[axis].mean()) for axis in "yx"))
    # One map instead of four, because each takes memory for this many points.
    pressed = placed_faces(heights, None, contact, middle, size_mm=size).pressed
    inside = footprint_weights(contact.pressure, middle, size)
    force = float(
        (contact.pressure.values * inside).sum() * np.prod(spacing_of(contact.pressure))
    )
    return pressed, force / size**2


def patches_of_reference(
    pressure: xr.DataArray, places: Mapping[str, PatchPosition], scan: xr.DataArray
) -> xr.Dataset:
    """The single-scale contact on each scan.

    Parameters
    ----------
    pressure : (y, x) xarray.DataArray
        Contact pressure of the whole square, MPa.
    places : mapping of str to PatchPosition
    scan : (y, x) xarray.DataArray
        One of the scans, which all have this grid.

    Returns
    -------
    xarray.Dataset
        ``contact`` (patch, y, x), bool; ``pressure`` (patch), MPa, the mean over the scan. The
        pressure is 0 at points outside the square.
    """
    v, u = (scan[axis].values - scan[axis].values.mean() for axis in "yx")
    touching, mean = [], []
    dy, dx = spacing_of(pressure)
    for place in places.values():
        y, x = np.broadcast_arrays(*place.points(v[:, None], u))
        rows = (y - pressure.y.values[0]) / dy
        columns = (x - pressure.x.values[0]) / dx
        values = scipy.ndimage.map_coordinates(
            pressure.values, [rows, columns], order=0, mode="grid-constant"
        )
        touching.append(values > 0)
        mean.append(values.mean(dtype=float))  # of numbers in single precision
    variables = {
        "contact": (("patch", "y", "x"), touching),
        "pressure": ("patch", mean),
    }
    coordinates = {"patch": [*places], "y": scan.y, "x": scan.x}
    return described(xr.Dataset(variables, coordinates), _VARIABLES)


def two_scales_table(
    contacts: Mapping[str, Mapping[str, Contact]], reference: xr.Dataset
) -> pd.DataFrame:
    """Compare the contacts of the patches with the single-scale contact, by variant.

    Parameters
    ----------
    contacts : mapping of str to mapping of str to Contact
        Contacts of the patches by variant; each is looked up once.
    reference : xarray.Dataset
        From `patches_of_reference`, by ``draw``.

    Returns
    -------
    pandas.DataFrame
        ``patch, variant, pressure_MPa, reference_pressure_MPa, contact_fraction,
        reference_contact_fraction, precision, recall, f1``. Each variant also has rows
        ``highest_VARIANT``: the highest points of its surface, as many as are in contact in the
        reference. Rows `ALL` pool the points of all patches. Draws of the reference are pooled, and
        its pressure is their mean.
    """
    rows = []
    for variant, of_patches in contacts.items():
        for patch, contact in of_patches.items():
            at = reference.sel(patch=patch)
            true, pressure_MPa = at.contact.values, float(at.pressure.mean())
            touching = np.broadcast_to(contact.pressure.values > 0, true.shape)
            # As many of the highest points as are in contact in each draw.
            order = np.argsort(-contact.interface.laid.values, axis=None, kind="stable")
            rank = np.argsort(order).reshape(contact.pressure.shape)
            highest = rank < true.sum(axis=(1, 2), keepdims=True)
            own = patch, variant, contact.mean_pressure, pressure_MPa
            other = patch, f"highest_{variant}", np.nan, pressure_MPa
            rows.append((*own, *mask_counts(touching, true)))
            rows.append((*other, *mask_counts(highest, true)))
    keys = ["patch", "variant", "pressure_MPa", "reference_pressure_MPa"]
    table = pd.DataFrame(rows, columns=[*keys, *_COUNTS])
    parts = []
    for name, of_variant in table.groupby("variant", sort=False):
        pooled = pd.DataFrame([of_variant[_COUNTS].sum()])
        parts += [of_variant, pooled.assign(patch=ALL, variant=name)]
    table = pd.concat(parts, ignore_index=True)
    scores = mask_scores(*table[_COUNTS].to_numpy().T)
    return table[keys].assign(
        contact_fraction=table.predicted / table.points,
        reference_contact_fraction=table.touching / table.points,
        **{name: scores[name] for name in ("precision", "recall", "f1")},
    )
