"""Makes the generated specimen: mesh, scans before and after use, and the truth about them."""

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pandas as pd

import gstlib
from gstlib.errors import ConfigError, InputError
from gstlib.io.plu import write_plu
from gstlib.io.store import write_dataset
from gstlib.specimen.mesh import specimen_mesh, write_stl
from gstlib.specimen.parameters import SpecimenParameters
from gstlib.specimen.randomness import stream
from gstlib.specimen.scanning import Placement, mould, place_scans, sample, take_scan
from gstlib.specimen.stone import Stone, fit_plane, make_stone
from gstlib.specimen.truth import EPOCHS, truth_dataset
from gstlib.specimen.wear import wear_depth

__all__ = ["generate_specimen"]

# True heights are kept to about 1 nm: a tenth or less of any error they are compared with, and
# they compress twice as well.
_HEIGHT_STEP_MM = 2.0**-20


def generate_specimen(
    patches: pd.DataFrame,
    *,
    mesh: str | Path,
    scan_folder: str | Path,
    truth: str | Path,
    square_mm: float,
    grid: int,
    parameters: SpecimenParameters,
) -> None:
    """Make a specimen like a measured stone tool, and write it as measured files.

    The same arguments give the same bytes. A patch's scans depend on the seed and on the patch's
    own name and place, not on the other patches.

    Parameters
    ----------
    patches : pandas.DataFrame
        Nominal places: ``patch``, ``x_mm``, ``y_mm`` (centre, square frame), ``t0`` and ``t1``
        (file names; an empty or absent ``t1``: not scanned after use), optional ``rotation_deg``.
    mesh : path
        Binary STL to write, mm, use-face up (+z), square centred on x = y = 0. The square's frame
        has its origin at (square/2, square/2, 0), its x axis along -x and its y axis along -y.
    scan_folder : path
        Folder for the scans (``.plu``), moulds of the stone.
    truth : path
        HDF5 file to write; see `gstlib.specimen.truth`.
    square_mm : float
        Side of the analysed square.
    grid : int
        Elements along each side of the grid on which the true macroscale surface is kept.
    parameters : SpecimenParameters

    Raises
    ------
    InputError
        A scan would stick out of the surface.
    ConfigError
        The square is larger than the use-face.
    """
    p = parameters
    if square_mm + 2 * p.margin_mm > 0.5 * min(p.outer_size_mm[:2]):
        raise ConfigError(
            "square.size_mm",
            f"{square_mm} mm with a margin of {p.margin_mm} mm is more than half of the pebble's "
            f"width, {min(p.outer_size_mm[:2])} mm",
            "Make the square smaller or specimen.outer_size_mm larger.",
        )
    if patches.patch.astype(str).duplicated().any():
        raise InputError("patch table", "a patch stands twice in it", "Name each patch once.")

    stone = make_stone(p, square_mm)
    vertices, faces = specimen_mesh(
        stone, stream(p.seed, "mesh"), edge_mm=p.mesh_edge_mm, noise_um=p.mesh_noise_um
    )
    write_stl(mesh, vertices, faces)
    true_values = _scan_all(patches, stone, Path(scan_folder), p)
    names = [str(name) for name in patches.patch]
    dataset = truth_dataset(
        stone.macroscale_means(grid),
        square_mm,
        p.scan_points,
        p.scan_spacing_mm,
        names,
        true_values,
        wear_threshold_um=p.wear_threshold_um,
    )
    settings = {**asdict(p), "square_mm": square_mm, "grid": grid}
    write_dataset(
        truth,
        dataset,
        {
            "gstlib_version": gstlib.__version__,
            "settings": json.dumps(settings, sort_keys=True),
            "note": "a generated specimen: no measured stone",
        },
    )


def _scan_all(
    patches: pd.DataFrame, stone: Stone, folder: Path, p: SpecimenParameters
) -> dict[str, tuple]:
    """Scan every patch at both epochs, write the scans, and return the truth about them.

    Truth at T1 is kept for a patch that is not scanned after use, too: its wear is there.
    """
    wear = wear_depth(stone, p)
    grid = stone.grid()
    surface = (stone.macroscale(grid, grid) + stone.detail).astype(np.float32)

    count, n = len(patches), p.scan_points
    per_epoch = {
        name: np.zeros((count, len(EPOCHS)))
        for name in (
            "x_mm",
            "y_mm",
            "rotation_deg",
            "tilt_x_mrad",
            "tilt_y_mrad",
            "plane_x_mrad",
            "plane_y_mrad",
        )
    }
    outlier = np.zeros((count, len(EPOCHS), n, n), dtype=bool)
    unmeasured = np.zeros_like(outlier)
    height = np.zeros((count, n, n), dtype=np.float32)
    depth = np.zeros_like(height)
    overlap = np.zeros(count)

    poor = _poor_overlaps(patches, p)
    steps = np.arange(n) * p.scan_spacing_mm
    for i, row in enumerate(patches.to_dict("records")):
        patch = str(row["patch"])
        turn = row.get("rotation_deg")
        nominal = Placement(
            float(row["x_mm"]), float(row["y_mm"]), 0.0 if pd.isna(turn) else float(turn)
        )
        places = place_scans(
            patch, nominal, p, square_mm=stone.square_mm, poor_overlap=patch in poor
        )
        for j, epoch in enumerate(EPOCHS):
            place = places[epoch]
            true = sample(surface, stone, place, n, order=3, patch=patch)
            if epoch == "T0":
                plane = fit_plane(true, steps, steps)[2]
                height[i] = _rounded(true - plane)
                depth[i] = _rounded(sample(wear, stone, place, n, order=1, patch=patch))
            else:
                true -= sample(wear, stone, place, n, order=1, patch=patch)
            scan = take_scan(true, patch, epoch, p)
            slope_y, slope_x, _ = fit_plane(true, steps, steps)
            tilts = {
                "tilt_x_mrad": scan.tilt_x_mrad,
                "tilt_y_mrad": scan.tilt_y_mrad,
                "plane_x_mrad": np.arctan(slope_x + scan.tilt_x_mrad * 1e-3) * 1e3,
                "plane_y_mrad": np.arctan(slope_y + scan.tilt_y_mrad * 1e-3) * 1e3,
            }
            for name, value in (vars(place) | tilts).items():
                per_epoch[name][i, j] = value
            outlier[i, j], unmeasured[i, j] = scan.outlier, scan.unmeasured
            name = row.get(epoch.lower())
            if isinstance(name, str) and name:
                write_plu(
                    folder / name,
                    mould(scan.height),
                    p.scan_spacing_mm,
                    comment="generated by gstlib: no measured stone",
                )
        overlap[i] = _overlap(places["T0"], places["T1"], p.scan_size_mm)

    one, maps = ("patch", "epoch"), ("patch", "epoch", "y", "x")
    meanings = {
        "x_mm": ("mm", "true centre of the scan along x"),
        "y_mm": ("mm", "true centre of the scan along y"),
        "rotation_deg": ("degree", "true turn of the scan, x towards y"),
        "tilt_x_mrad": ("mrad", "slope along x that the mould's tilt adds"),
        "tilt_y_mrad": ("mrad", "slope along y that the mould's tilt adds"),
        "plane_x_mrad": ("mrad", "angle along x of the tilted true surface: what levelling takes"),
        "plane_y_mrad": ("mrad", "angle along y of the tilted true surface: what levelling takes"),
    }
    values = {name: (one, per_epoch[name], *meanings[name]) for name in per_epoch}
    return values | {
        "nominal_x_mm": ("patch", patches.x_mm.to_numpy(float), "mm", "nominal centre along x"),
        "nominal_y_mm": ("patch", patches.y_mm.to_numpy(float), "mm", "nominal centre along y"),
        "overlap": ("patch", overlap, "1", "share of the T0 scan's area inside the T1 scan"),
        "outlier": (maps, outlier, "1", "spike at a measured point"),
        "unmeasured": (maps, unmeasured, "1", "point without a value"),
        "height": (
            ("patch", "y", "x"),
            height,
            "mm",
            "true height at T0, all wavelengths, least-squares plane removed",
        ),
        "wear_depth": (("patch", "y", "x"), depth, "mm", "depth lost from T0 to T1"),
    }


def _rounded(heights: np.ndarray) -> np.ndarray:
    return (np.round(heights / _HEIGHT_STEP_MM) * _HEIGHT_STEP_MM).astype(np.float32)


def _poor_overlaps(patches: pd.DataFrame, p: SpecimenParameters) -> set[str]:
    """The patches whose T1 scan is badly misplaced: a fixed share, drawn by chance."""
    names = sorted(patches.patch.astype(str))
    count = round(p.poor_overlap_share * len(names))
    chosen = stream(p.seed, "poor overlap").permutation(len(names))[:count]
    return {names[i] for i in chosen}


def _overlap(t0: Placement, t1: Placement, size_mm: float) -> float:
    """Share of the T0 scan's area inside the T1 scan; their relative turn is neglected."""
    turn = np.deg2rad(t0.rotation_deg)
    dx, dy = t1.x_mm - t0.x_mm, t1.y_mm - t0.y_mm
    along = (np.cos(turn) * dx + np.sin(turn) * dy, np.cos(turn) * dy - np.sin(turn) * dx)
    return float(np.prod([max(0.0, 1 - abs(shift) / size_mm) for shift in along]))
