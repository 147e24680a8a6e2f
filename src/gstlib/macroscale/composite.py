"""The stone's surface at every scale: the mesh, the scans on it, and detail between them.

The mesh shows the shape of the stone and lacks the short waves, which decide where a flat touches.
A scan contains them, but not the tilt of its patch, because the back of a mould is not flat. Each
levelled scan is therefore placed on the plane of the mesh's surface under its outline. Between the
outlines, a random field is added to the mesh's surface. It has the spectrum of the detail that only
the scans show.

Compared with one contact of the whole square at the scans' resolution, these planes matter most for
a prediction inside a patch (docs/explanation/evidence.md).
"""

# ASSUME: Statistics of detail between scans. Detail that was not scanned is Gaussian and isotropic,
# with the same statistics all over the face. Waves longer than a patch have the spectral density of
# waves as long as a patch. Reason: A scan does not contain waves longer than its patch.
# ASSUME: Errors of the mesh. The height error of each vertex is about the error with which the
# other vertices predict it. Errors of different vertices are independent. Reason: No other measure
# of these errors is available for one mesh.
# ASSUME: Overlapping scans. If outlines overlap, the surface there is the mean of their scans.
# Reason: All of them show the same surface.

from collections.abc import Iterable, Mapping
from dataclasses import asdict

import numpy as np
import pandas as pd
import scipy
import xarray as xr

from gstlib.surfaces.filtering import radial_frequency, s_filtered
from gstlib.surfaces.footprints import (
    PatchPosition,
    check_size,
    half_extent,
    on_patch,
    places_of,
    spline_of,
    square_of,
)
from gstlib.surfaces.grid import axis_coordinates, described, spacing_of
from gstlib.surfaces.leveling import Plane, fit_plane, remove_plane
from gstlib.surfaces.spectrum import radial_spectrum

__all__ = [
    "compose",
    "compose_grid",
    "compose_surface",
    "draw_mesh_errors",
    "plane_under",
]

# Points of the composite along each side of a macroscale element, and along a patch for its plane.
_PER_ELEMENT = 4
_PLANE_POINTS = 24
# Draws for a standard deviation of the planes, which is then known to a tenth.
_PLANE_DRAWS = 50
# Sides, in patches, of the field on which the tilt of detail is measured.
_TILT_PATCHES = 24
# Unit and long name of each variable of the surface and of its patches.
_VARIABLES = {
    "height": ("mm", "height of the composite surface"),
    "density": ("mm4", "power spectral density beyond the mesh"),
    "scan": ("mm", "levelled scan on a coarse grid"),
    "patch_mm": ("mm", "side of a patch"),
    "x_mm": ("mm", "centre along x"),
    "y_mm": ("mm", "centre along y"),
    "rotation_deg": ("degree", "turn"),
    "offset": ("mm", "height of the plane"),
    "slope_y": ("1", "slope of the plane along y"),
    "slope_x": ("1", "slope of the plane along x"),
    "tilt_mrad": ("mrad", "tilt of the mesh's plane"),
    "tilt_error_mrad": ("mrad", "standard error of the tilt along each axis"),
    "known": ("1", "whether the mesh gives the plane better than levelling"),
}


def plane_under(
    spline: "scipy.interpolate.RectBivariateSpline",
    place: PatchPosition,
    patch_mm: float,
) -> Plane:
    """Least-squares plane of a surface under an outline, along the axes of the scan there."""
    heights = on_patch(spline, place, 2 * (_PLANE_POINTS,), patch_mm)
    along = axis_coordinates(_PLANE_POINTS, patch_mm / _PLANE_POINTS)
    along -= (along[0] + along[-1]) / 2
    return fit_plane(heights, along, along)


def compose_surface(
    face: xr.Dataset,
    patches: pd.DataFrame,
    scans: Mapping[str, xr.Dataset],
    *,
    patch_mm: float,
    s_filter_um: float | None,
    placement_um: float,
    seed: int,
) -> xr.Dataset:
    """The composite surface, averaged over the elements of the macroscale grid.

    Parameters
    ----------
    face : xarray.Dataset
        The mesh's ``height`` (y, x), mm, and its left-out errors, from
        `gstlib.macroscale.face.grid_macroscale`.
    patches : pandas.DataFrame
        ``patch, x_mm, y_mm, rotation_deg``.
    scans : mapping of str to xarray.Dataset
        The prepared T0 scans by patch, with ``height`` (y, x), mm. Each is looked up once.
    patch_mm : float
        Side of a patch.
    s_filter_um : float, optional
        Nesting index of the S-filter that the scans pass.
    placement_um : float
        Standard deviation of a patch's position along each axis.
    seed : int
        Seed of the random detail and of the draws for the planes' errors.

    Returns
    -------
    xarray.Dataset
        ``height`` (y, x) mm, and ``counterface`` and ``size_mm`` of `face`. Each patch has ``x_mm,
        y_mm, rotation_deg``, and its plane ``offset`` (mm), ``slope_y, slope_x`` along its axes.
        ``tilt_mrad`` is the tilt of the mesh's plane, and ``tilt_error_mrad`` its standard error
        along each axis. ``known`` is False if levelling is at least as accurate, and the slopes are
        then 0. ``scan`` (patch, v, u) mm contains the scans on a coarse grid. ``density``
        (frequency) mm⁴ is the power spectral density of the detail that only the scans show.
        ``patch_mm`` is the side of a patch.

    Raises
    ------
    InputError
        A scan is not as large as a patch.

    Examples
    --------
    A scan has waves of 0.2 mm, which a flat mesh does not show. Most of the detail has them:

    >>> import gstlib
    >>> flat = gstlib.make_surface(np.zeros((20, 20)), 0.1)
    >>> face = xr.Dataset({"height": flat, "counterface": flat, "size_mm": 2.0})
    >>> corners = {"vertex_y": [0, 0, 2, 2], "vertex_x": [0, 2, 0, 2], "left_out_error": 4 * [0]}
    >>> face = face.assign({name: ("vertex", values) for name, values in corners.items()})
    >>> waves = np.tile(1e-3 * np.cos(np.pi / 4 * np.arange(32)), (32, 1))
    >>> scan = gstlib.make_surface(waves, 0.025).to_dataset(name="height")
    >>> patches = pd.DataFrame({"patch": ["a"], "x_mm": 1.0, "y_mm": 1.0, "rotation_deg": 0.0})
    >>> settings = {"patch_mm": 0.8, "s_filter_um": None, "placement_um": 10.0, "seed": 1}
    >>> composite = gstlib.compose_surface(face, patches, {"a": scan}, **settings)
    >>> round(float(composite.density.idxmax("frequency")), 6)  # 1/mm
    5.0
    """
    from skimage.transform import resize_local_mean

    places = places_of(patches)
    spline = spline_of(face.height)
    element = max(spacing_of(face.height))
    points = int(np.ceil(patch_mm * _PER_ELEMENT / element))
    coarse, densities, planes = [], [], []
    count = 0
    for patch, place in places.items():
        height = s_filtered(scans[patch].height, s_filter_um)
        check_size(height, patch_mm, f"patch {patch}")
        # Of the first scan, because densities need the same frequencies.
        count = count or min(height.shape)
        under = height.copy(data=on_patch(spline, place, height.shape, patch_mm))
        beyond = height.values - remove_plane(under)[0].values
        even = resize_local_mean(beyond, (count, count))
        frequency, density = radial_spectrum(even, 2 * (patch_mm / count,))
        densities.append(density)
        coarse.append(resize_local_mean(height.values, (points, points)))
        planes.append(asdict(plane_under(spline, place, patch_mm)) | place._asdict())
    spectrum = xr.DataArray(
        np.mean(densities, axis=0),
        {"frequency": ("frequency", frequency, {"units": "1/mm"})},
    )
    generator = np.random.default_rng([seed, 0])
    table = pd.DataFrame(planes)
    error = _plane_errors(face, places, spectrum, patch_mm, placement_um, generator)
    table["tilt_mrad"] = 1e3 * np.hypot(table.slope_y, table.slope_x)
    table["tilt_error_mrad"] = error
    table["known"] = table.tilt_mrad > np.sqrt(2) * error
    table.loc[~table.known, ["slope_y", "slope_x"]] = 0.0
    adopted = map(Plane, table.offset, table.slope_y, table.slope_x)
    laid = zip(places.values(), adopted, coarse, strict=True)
    variables = {
        "height": compose_grid(face.height, laid, patch_mm, spectrum, seed),
        "density": spectrum,
        "scan": (("patch", "v", "u"), np.array(coarse)),
        "patch_mm": patch_mm,
        **{name: ("patch", table[name]) for name in table},
    }
    composite = xr.Dataset(variables, {"patch": list(places)})
    of_face = {"counterface": face.counterface, "size_mm": face.size_mm}
    return described(composite, _VARIABLES).assign(of_face)


def compose(
    spline: "scipy.interpolate.RectBivariateSpline",
    scans: Iterable[tuple[PatchPosition, Plane, np.ndarray]],
    patch_mm: float,
    grid: xr.DataArray,
    density: xr.DataArray,
    seed: int | np.random.Generator,
) -> xr.DataArray:
    """Heights (y, x), mm, of the composite surface on the points of any `grid`.

    Inside an outline it is the scan on its plane. Elsewhere it is the surface of `spline` with
    random detail of this `density`.
    """
    y, x = grid.y.values, grid.x.values
    height = spline(y, x)
    generator = np.random.default_rng(seed)
    height += _random_field(density, height.shape, max(spacing_of(grid)), generator)
    laid = np.zeros_like(height)
    count = np.zeros(height.shape, np.uint8)
    for place, plane, scan in scans:
        reach = float(half_extent(patch_mm, place.rotation_deg))
        rows, columns = (
            slice(*np.searchsorted(axis, [centre - reach, centre + reach]))
            for axis, centre in ((y, place.y_mm), (x, place.x_mm))
        )
        v, u = place.seen(y[rows, None], x[columns])
        inside = np.maximum(abs(v), abs(u)) <= patch_mm / 2
        at = [
            (axis / patch_mm + 0.5) * points - 0.5
            for axis, points in zip(np.broadcast_arrays(v, u), scan.shape, strict=True)
        ]
        values = scipy.ndimage.map_coordinates(scan, at, order=1, mode="nearest")
        values += plane.offset + plane.slope_y * v + plane.slope_x * u
        laid[rows, columns] += np.where(inside, values, 0)
        count[rows, columns] += inside
    np.divide(laid, count, out=height, where=count > 0)
    return grid.copy(data=height)


def compose_grid(
    height: xr.DataArray,
    scans: Iterable[tuple[PatchPosition, Plane, np.ndarray]],
    patch_mm: float,
    density: xr.DataArray,
    seed: int | np.random.Generator,
) -> xr.DataArray:
    """`compose` on the mesh's surface, averaged over each element of the grid of `height`.

    It is NaN where `height` is.
    """
    ny, nx = height.shape
    fine = refined(height, _PER_ELEMENT)
    heights = compose(spline_of(height), scans, patch_mm, fine, density, seed).values
    means = heights.reshape(ny, _PER_ELEMENT, nx, _PER_ELEMENT).mean(axis=(1, 3))
    return height.copy(data=np.where(np.isnan(height.values), np.nan, means))


def refined(surface: xr.DataArray, parts: int) -> xr.DataArray:
    """A surface of zeros with each element of `surface` divided into so many parts a side."""
    axes = {}
    for axis, step in zip("yx", spacing_of(surface), strict=True):
        corner = float(surface[axis][0]) - step / 2
        count = parts * surface.sizes[axis]
        axes[axis] = corner + axis_coordinates(count, step / parts)
    return xr.DataArray(0.0, axes, ("y", "x"))


def draw_mesh_errors(
    face: xr.Dataset, grid: xr.DataArray, draws: int, generator: np.random.Generator
) -> np.ndarray:
    """Errors (draws, ny, nx), mm, that the mesh's surface may have at the points of a `grid`.

    At each vertex of the `face` its left-out error times a normal number, linear between vertices.
    """
    vertices = np.column_stack([face.vertex_y, face.vertex_x])
    drawn = generator.standard_normal((len(vertices), draws))
    known = vertices, face.left_out_error.values[:, None] * drawn
    at = np.stack(np.meshgrid(grid.y, grid.x, indexing="ij"), axis=-1)
    errors = scipy.interpolate.LinearNDInterpolator(*known)(at)
    outside = np.isnan(errors[..., 0])
    errors[outside] = scipy.interpolate.NearestNDInterpolator(*known)(at[outside])
    return np.moveaxis(errors, -1, 0)


def _plane_errors(
    face: xr.Dataset,
    places: Mapping[str, PatchPosition],
    density: xr.DataArray,
    patch_mm: float,
    placement_um: float,
    generator: np.random.Generator,
) -> np.ndarray:
    """Standard error (mrad) of each patch's tilt, by the mesh, the position and unseen waves."""
    slopes = []
    height = square_of(face.height, float(face.size_mm))
    for error in draw_mesh_errors(face, height, _PLANE_DRAWS, generator):
        spline = spline_of(height + error)
        shifts = placement_um * 1e-3 * generator.standard_normal((len(places), 2))
        planes = [
            plane_under(spline, PatchPosition(y + dy, x + dx, turn), patch_mm)
            for (y, x, turn), (dy, dx) in zip(places.values(), shifts, strict=True)
        ]
        slopes.append([(plane.slope_y, plane.slope_x) for plane in planes])
    step = patch_mm / _PLANE_POINTS
    field = _random_field(
        density, 2 * (_TILT_PATCHES * _PLANE_POINTS,), step, generator
    )
    along = axis_coordinates(_PLANE_POINTS, step) - patch_mm / 2
    blocks = field.reshape(2 * (_TILT_PATCHES, _PLANE_POINTS)).mean(axis=3)
    unseen = np.einsum("ijk,j->ik", blocks, along) / (along @ along)
    variance = np.var(slopes, axis=0, ddof=1).mean(axis=1)
    return 1e3 * np.sqrt(variance + (unseen**2).mean())


def _random_field(
    density: xr.DataArray,
    shape: tuple[int, ...],
    spacing: float,
    generator: np.random.Generator,
) -> np.ndarray:
    """A periodic Gaussian field (ny, nx), mm, of a power spectral density."""
    fast = [scipy.fft.next_fast_len(count, real=True) for count in shape]
    spectrum = scipy.fft.rfft2(generator.standard_normal(fast))
    at = radial_frequency(fast, spacing)
    at[0, 0] = np.inf  # no mean
    frequency = density.frequency.values
    powers = np.maximum(density.values, np.finfo(float).tiny)
    amplitude = np.interp(np.log(at), np.log(frequency), np.log(powers) / 2)
    spectrum *= np.where(at <= frequency[-1], np.exp(amplitude), 0) / spacing
    field = scipy.fft.irfft2(spectrum, fast, overwrite_x=True)
    return field[: shape[0], : shape[1]]
