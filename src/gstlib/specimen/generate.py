"""The synthetic specimen: mesh, scans before and after use, and the truth about them.

The truth is a dataset. Maps of scans have the dims ``(patch, epoch, y, x)`` or ``(patch, y, x)``
(then on the T0 scan). They are oriented like the stone, not like the mould. The macroscale surface
has the dims ``(macroscale_y, macroscale_x)``.
"""

import io
import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from gstlib.errors import ConfigError
from gstlib.io.files import write_whole
from gstlib.io.plu import write_plu
from gstlib.io.store import write_dataset
from gstlib.specimen.law import LAWS, load_point_of, wear_depth
from gstlib.specimen.pebble import OUTER_SIZE_MM
from gstlib.specimen.randomness import SpecimenParameters, rounded
from gstlib.specimen.scanning import (
    place_again,
    place_scans,
    poor_overlaps,
    sample,
    take_scan,
)
from gstlib.specimen.stone import MARGIN_MM, Stone, surface_at
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.grid import axis_coordinates, described, make_surface, spacing_of
from gstlib.surfaces.leveling import remove_plane

if TYPE_CHECKING:
    import trimesh

__all__ = ["Specimen", "counterface_stl", "make_specimen", "stone_stl"]
__all__ += ["within_square", "write_specimen"]

# Depth (µm) from which a point counts as worn, which preparation can distinguish from noise.
_WEAR_THRESHOLD_UM = 0.5

# ASSUME: Radius of a generated active tool. A generated active tool has the radius of the active
# tool in the default study. Reason: The tool then matches the prior of that study.
_ACTIVE_RADIUS_MM = 200.0

# True properties of the surface and of each patch: units and meaning.
_TRUTH = {
    "macroscale_height": (
        "mm",
        "mean over each element of the surface without wavelengths below the cut-off, plane not "
        "removed",
    ),
    "face_height": ("mm", "mean over each element of the face before use"),
    "x_mm": ("mm", "true centre of the scan along x"),
    "y_mm": ("mm", "true centre of the scan along y"),
    "rotation_deg": ("degree", "true turn of the scan, x towards y"),
    "plane_x_mrad": (
        "mrad",
        "angle along x of the true surface, which levelling removes",
    ),
    "plane_y_mrad": (
        "mrad",
        "angle along y of the true surface, which levelling removes",
    ),
    "outlier": ("1", "spike at a measured point"),
    "unmeasured": ("1", "point without a value"),
    "nominal_x_mm": ("mm", "nominal centre along x"),
    "nominal_y_mm": ("mm", "nominal centre along y"),
    "overlap": ("1", "share of the T0 scan's area inside the T1 scan"),
    "height": ("mm", "true height at T0, all wavelengths, least-squares plane removed"),
    "wear_depth": ("mm", "depth lost from T0 to T1"),
}


class Specimen(NamedTuple):
    """A synthetic specimen in memory, exactly as its files are read.

    Attributes
    ----------
    stl : bytes
        Binary STL of the mesh: mm, use-face up (+z), the square centred on x = y = 0.
    scans : dict of (patch, epoch) to (n, n) xarray.DataArray
        Moulds as measured, mm, NaN if unmeasured, as from `gstlib.io.scans.read_scan`. A patch that
        was not scanned after use does not have ``"T1"``. A patch that was scanned twice before use
        has ``"repeat"``.
    truth : xarray.Dataset
        The truth about both.
    surface : (n, n) xarray.DataArray
        The true surface of the square before use, mm, at the scans' spacing.
    """

    stl: bytes
    scans: dict[tuple[str, str], xr.DataArray]
    truth: xr.Dataset
    surface: xr.DataArray

    @property
    def mesh(self) -> "trimesh.Trimesh":
        """The mesh of the STL file, equal vertices merged, as from `gstlib.io.meshes.read_mesh`."""
        import trimesh

        mesh = trimesh.load_mesh(io.BytesIO(self.stl), file_type="stl", process=False)
        mesh.merge_vertices()
        return mesh


def counterface_stl(parameters: SpecimenParameters, square_mm: float) -> bytes:
    """Binary STL of a similar active tool, use-face up, from ``counterface_seed``.

    It is bent to a round shape, because two dished stones would touch only at their rims.
    """
    assert parameters.counterface_seed is not None
    own = replace(parameters, seed=parameters.counterface_seed)
    return stone_stl(Stone(own, square_mm), _ACTIVE_RADIUS_MM)


def stone_stl(stone: Stone, radius_mm: float = math.inf) -> bytes:
    """Binary STL of the mesh of a stone, bent to a radius."""
    import trimesh

    vertices, faces = stone.mesh()
    vertices[:, 2] -= (vertices[:, :2] ** 2).sum(axis=1) / (2 * radius_mm)
    stl: Any = trimesh.Trimesh(vertices, faces, process=False).export(file_type="stl")
    return stl


def make_specimen(
    patches: pd.DataFrame,
    parameters: SpecimenParameters,
    *,
    square_mm: float,
    grid: int,
    around: int = 0,
    wear: Callable[[Stone], np.ndarray] | None = None,
) -> Specimen:
    """Make a specimen. The same arguments give the same specimen.

    The scans of a patch depend on the seed and on its own name and position, not on the other
    patches. But a fixed fraction of all T1 scans is badly misplaced.

    Parameters
    ----------
    patches : pandas.DataFrame
        The patch table. An empty ``t1`` means that the patch was not scanned after use. An empty or
        missing ``repeat`` means that it was not scanned again before use.
    parameters : SpecimenParameters
    square_mm : float
        Side of the analysed square. Its frame has its origin at (square/2, square/2, 0) of the
        mesh, its x axis along -x and its y axis along -y.
    grid : int
        Number of elements along each side of the grid of the true macroscale surface.
    around : int
        Number of elements of the face on every side of the square.
    wear : callable, optional
        Returns the depth lost by the stone. The default is ``gstlib.specimen.law.wear_depth`` with
        the placement in the parameters.

    Raises
    ------
    InputError
        A scan would extend beyond the surface.
    ConfigError
        The square is larger than the use-face.

    Examples
    --------
    A coarse specimen with a single patch, scanned before and after use:

    >>> import gstlib
    >>> lengths = {"mesh_edge_mm": 3.0, "cut_off_wavelength_mm": 1.2, "unmeasured_size_um": 60.0}
    >>> scanned = {"scan_points": 32, "scan_spacing_um": 25.0, "wear_placement": "summits"}
    >>> parameters = gstlib.SpecimenParameters(7, None, **lengths, **scanned)
    >>> patch = {"patch": "a", "x_mm": 1.0, "y_mm": 1.0, "rotation_deg": 0.0}
    >>> patches = pd.DataFrame([patch | {"t0": "a_T0.plu", "t1": "a_T1.plu"}])
    >>> specimen = gstlib.make_specimen(patches, parameters, square_mm=2.0, grid=20)
    >>> sorted(specimen.scans), specimen.mesh.is_watertight, specimen.truth.wear_depth.shape
    ([('a', 'T0'), ('a', 'T1')], True, (1, 32, 32))
    """
    p = parameters
    width = min(OUTER_SIZE_MM[:2])
    if square_mm + 2 * MARGIN_MM > 0.5 * width:
        raise ConfigError(
            "square.size_mm",
            f"{square_mm} mm with a margin of {MARGIN_MM} mm is more than half of the pebble's "
            f"width, {width} mm",
            "Make the square smaller.",
        )
    stone = Stone(p, square_mm)
    stl = stone_stl(stone)
    depth = wear(stone) if wear else wear_depth(stone, p.wear_placement)
    poor = poor_overlaps(list(patches.patch), p.seed)
    scans: dict[tuple[str, str], xr.DataArray] = {}
    truths = []
    for row in patches.itertuples():
        nominal = PatchPosition(row.y_mm, row.x_mm, row.rotation_deg)
        t0, t1 = place_scans(
            row.patch, nominal, p, square_mm=square_mm, poor_overlap=row.patch in poor
        )
        visits = {"T0": (t0, row.t0), "T1": (t1, row.t1)}
        if again := getattr(row, "repeat", ""):
            visits["repeat"] = place_again(row.patch, t0, p), again
        at_points = partial(sample, stone=stone, points=p.scan_points, patch=row.patch)
        heights, seen = {}, []
        for epoch, (place, file) in visits.items():
            heights[epoch] = at_points(stone.heights, place=place, order=3)
            if epoch == "T1":
                heights[epoch] -= at_points(depth, place=place, order=1)
            scan, masks = take_scan(heights[epoch], row.patch, epoch, p)
            seen.append(xr.Dataset(place._asdict() | masks))
            if file:
                scans[row.patch, epoch] = scan.assign_attrs(file=file)
        level, _ = remove_plane(make_surface(heights["T0"], p.scan_spacing_mm))
        shifts = t0.seen(t1.y_mm, t1.x_mm)
        of_patch = {
            "nominal_x_mm": nominal.x_mm,
            "nominal_y_mm": nominal.y_mm,
            # the relative rotation is neglected
            "overlap": np.maximum(1 - np.abs(shifts) / p.scan_size_mm, 0.0).prod(),
            # rounded heights compress twice as well
            "height": (("y", "x"), rounded(level.values)),
            "wear_depth": (("y", "x"), rounded(at_points(depth, place=t0, order=1))),
        }
        true = xr.concat(seen[:2], "epoch").assign(of_patch)
        truths.append(dict(true.variables))
    truth = _truth(patches, stone, grid, around, truths)
    return Specimen(stl, scans, truth, within_square(stone.heights, stone))


def within_square(surface: np.ndarray, stone: Stone) -> xr.DataArray:
    """The part of the surface that covers the square, in whole elements."""
    first = int(np.searchsorted(stone.grid, 0.0))
    count = int(stone.square_mm / stone.spacing)
    part = slice(first, first + count)
    name = "true height before use"
    return surface_at(stone.grid[part], surface[part, part], long_name=name)


def write_specimen(
    made: Specimen,
    *,
    mesh: str | Path,
    scan_folder: str | Path,
    truth: str | Path,
    surface: str | Path,
) -> None:
    """Write a specimen as measured files; the same specimen gives the same bytes.

    `mesh` is the binary STL file to write, and `scan_folder` the folder of the scans (``.plu``).
    `truth` and `surface` are HDF5 files: the truth about mesh and scans, and the true surface
    before use.
    """
    note = "generated by gstlib: not a measured stone"
    write_whole(mesh, made.stl)
    for scan in made.scans.values():
        path = Path(scan_folder) / scan.attrs["file"]
        write_plu(path, scan.values, spacing_of(scan), comment=note)
    write_dataset(truth, made.truth, {"note": note})
    single = made.surface.astype(np.float32).to_dataset(name="height")
    write_dataset(surface, single, {"note": note})


def _truth(
    patches: pd.DataFrame, stone: Stone, grid: int, around: int, of_patches: list[dict]
) -> xr.Dataset:
    """The truth about a specimen, from the truths `of_patches`."""
    p = stone.parameters
    spacing = stone.square_mm / grid
    along_square = axis_coordinates(grid, spacing)
    along_face = axis_coordinates(grid + 2 * around, spacing) - around * spacing
    along_scan = axis_coordinates(p.scan_points, p.scan_spacing_mm)
    of_square, of_face = ("macroscale_y", "macroscale_x"), ("face_y", "face_x")
    variables: dict[str, Any] = {
        "macroscale_height": (of_square, stone.macroscale_means(grid)),
        "face_height": (of_face, stone.face_means(grid, around)),
    }
    for name in _TRUTH.keys() - variables.keys():
        # popped: the maps are large
        values = [patch.pop(name) for patch in of_patches]
        variables[name] = xr.Variable.concat(values, "patch")
    of_axes = {"macroscale_": along_square, "face_": along_face, "": along_scan}
    coordinates = {
        f"{prefix}{axis}": (f"{prefix}{axis}", along, {"units": "mm"})
        for prefix, along in of_axes.items()
        for axis in "yx"
    }
    truth = xr.Dataset(
        {name: variables[name] for name in _TRUTH},
        {"patch": list(patches.patch), "epoch": ["T0", "T1"]} | coordinates,
        {"wear_threshold_um": _WEAR_THRESHOLD_UM},
    )
    if p.wear_placement in LAWS:
        truth.attrs["use_y_mm"], truth.attrs["use_x_mm"] = load_point_of(stone)
        truth.attrs["use_radius_mm"] = p.worn_radius_mm
    return described(truth, _TRUTH)
