"""What two scales cost: one contact of the whole square at the scans' resolution, and the patches'.

The study presses the square on a coarse grid and each patch by itself. Both are shortcuts. One
contact of the whole square with all its detail needs neither: on a generated specimen it is the
contact of the true surface, against which everything is counted (mesh, places, noise, coupling). On
a measured stone it is that of the composite surface, and tells what the coupling alone costs and,
over several draws of the detail, how far the results depend on what was not scanned.
"""

from collections.abc import Iterable, Mapping
from itertools import chain

import numpy as np
import pandas as pd
import xarray as xr
from scipy.ndimage import map_coordinates

from gstlib.composite import compose
from gstlib.contact import laid_height
from gstlib.coupling import Place, places_of, spline_of
from gstlib.io.results import columns_of
from gstlib.placement import ALL
from gstlib.preprocess.leveling import Plane
from gstlib.surface import make_surface, spacing_of
from gstlib.validation.scores import inside_rim, scores_of_sums

__all__ = ["TOLERANCE", "composite_heights", "patches_of_reference", "two_scales_table"]

# Of the contact of the whole square. With 1e-7 in its place, 3 points in contact of 10,000 change.
TOLERANCE = 1e-4


def composite_heights(
    surface: xr.Dataset,
    composite: xr.Dataset,
    scans: Iterable[xr.DataArray],
    *,
    seed: int,
    draw: int,
) -> xr.DataArray:
    """The composite surface (y, x), mm, at the scans' resolution.

    `composite` is that on the macroscale grid; `scans` are levelled, in the order of its patches,
    and each is used once. Detail between them is drawn from `seed` and `draw`.
    """
    scans = iter(scans)
    first = next(scans)
    scans = chain([first], scans)
    length = spacing_of(surface)[0] * len(surface.y)
    count = round(length / spacing_of(first)[0])

    table = composite[["x_mm", "y_mm", "rotation_deg", "offset", "slope_y", "slope_x"]]
    table = table.to_dataframe().reset_index()
    planes = table[["offset", "slope_y", "slope_x"]].itertuples(index=False)
    laid = (
        (place, Plane(*plane), scan.values)
        for place, plane, scan in zip(places_of(table).values(), planes, scans, strict=True)
    )
    heights = compose(
        spline_of(surface.height),
        laid,
        composite.attrs["patch_mm"],
        (count, count),
        length / count,
        composite.density,
        np.random.default_rng([seed, 3, draw]),
    )
    return make_surface(heights, length / count)


def patches_of_reference(
    pressures: Iterable[xr.DataArray], places: Mapping[str, Place], scan: xr.DataArray
) -> xr.Dataset:
    """What the single-scale contact is on each scan.

    Parameters
    ----------
    pressures : iterable of (y, x) xarray.DataArray
        Contact pressure of the whole square, MPa, by draw.
    places : mapping of str to Place
    scan : (y, x) xarray.DataArray
        One of the scans, whose grid they all have.

    Returns
    -------
    xarray.Dataset
        ``contact`` (draw, patch, y, x), bool; ``pressure`` (draw, patch), MPa, the mean over the
        scan. Of points outside the square the pressure is 0.
    """
    v, u = (scan[axis].values - scan[axis].values.mean() for axis in "yx")
    touching, mean = [], []
    for pressure in pressures:
        rows = []
        for place in places.values():
            at = [
                (places - pressure[axis].values[0]) / pressure[axis].attrs["spacing"]
                for places, axis in zip(place.points(v[:, None], u), "yx", strict=True)
            ]
            nearest = {
                "order": 0,
                "mode": "grid-constant",
                "cval": 0,
            }  # of the square's points
            rows.append(map_coordinates(pressure.values, np.broadcast_arrays(*at), **nearest))
        touching.append([values > 0 for values in rows])
        mean.append([values.mean() for values in rows])
    there = "in the single-scale contact"
    touch = {"units": "1", "long_name": f"in contact {there}"}
    mean_pressure = {"units": "MPa", "long_name": f"mean pressure {there}"}
    variables = {
        "contact": (("draw", "patch", "y", "x"), np.array(touching), touch),
        "pressure": (("draw", "patch"), np.array(mean), mean_pressure),
    }
    return xr.Dataset(variables, coords={"patch": list(places), "y": scan.y, "x": scan.x})


def two_scales_table(
    contacts: Mapping[str, Iterable[tuple[str, xr.Dataset]]],
    reference: xr.Dataset,
    *,
    rim: float,
) -> pd.DataFrame:
    """Contact of the patches against the single-scale contact, by variant.

    Parameters
    ----------
    contacts : mapping of str to iterable of (patch, xarray.Dataset)
        The patches' contacts by variant, each used once.
    reference : xarray.Dataset
        From `patches_of_reference`.
    rim : float
        Share of a side along each edge that is not scored.

    Returns
    -------
    pandas.DataFrame
        ``patch, variant, pressure_MPa, reference_pressure_MPa, contact_fraction,
        reference_contact_fraction, precision, recall, f1, iou``; contact and scores without the
        rim. Of each variant also ``highest_VARIANT``: the highest points of its surface, as many as
        are in contact in the reference. Rows `ALL` pool the points of all patches. Draws of the
        reference are pooled, and its pressure is their mean.
    """
    rows = []
    scored = inside_rim(reference.contact.shape[-2:], rim)
    for variant, of_patches in contacts.items():
        counts: dict[str, list[np.ndarray]] = {variant: [], f"highest_{variant}": []}
        known = []
        for patch, contact in of_patches:
            at = reference.sel(patch=patch)
            true = at.contact.values & scored
            heights = np.where(scored, laid_height(contact).values, -np.inf)
            order = np.argsort(-heights, axis=None, kind="stable")
            highest = np.zeros_like(true)
            for mask, draw in zip(highest, true, strict=True):
                mask.flat[order[: draw.sum()]] = True
            touching = np.broadcast_to((contact.pressure.values > 0) & scored, true.shape)
            for mask, found in zip((touching, highest), counts.values(), strict=True):
                of = (mask & true).sum(), mask.sum(), true.sum(), scored.sum() * len(true)
                found.append(np.array(of))
            pressure = float(np.ravel(contact.mean_pressure.values)[-1])
            known.append((patch, pressure, float(at.pressure.mean())))
        known.append((ALL, np.nan, np.nan))
        for name, found in counts.items():
            pooled = [*found, np.sum(found, axis=0)]
            for (patch, pressure, true_pressure), each in zip(known, pooled, strict=True):
                own = pressure if name == variant else np.nan
                _, predicted, touching, points = each
                scores = scores_of_sums(list(each), 3 * [np.nan], None)
                precision, recall, f1 = (
                    float(scores[score]) for score in ("precision", "recall", "f1")
                )
                areas = predicted / points, touching / points
                shown = precision, recall, f1, f1 / (2 - f1)
                rows.append((patch, name, own, true_pressure, *areas, *shown))
    return pd.DataFrame(rows, columns=columns_of("two_scales"))
