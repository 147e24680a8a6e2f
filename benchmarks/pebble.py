"""One real stone at two scales: a pebble's mesh, and a confocal map of a part of its surface.

The map is found on the mesh, cut into six patches, and the patches go through the study as scans of
their own. Their true relative planes are known: the map is one frame. The stone rests on its face
under the force of the default study. The reference is one contact of the whole square in it at
10 µm, over draws of what was not scanned. It is solved with the planes of the mesh, which shows
what the coupling costs, and with those of the map, which shows what the mesh's planes cost in
addition. Tables are printed; pictures go to build/pebble.png and
build/pebble_contact.png.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import trimesh
import xarray as xr
import yaml
from scipy.interpolate import RectBivariateSpline
from scipy.ndimage import gaussian_filter, map_coordinates
from scipy.optimize import minimize
from scipy.signal import fftconvolve

from gstlib.bem import contact_modulus
from gstlib.composite import compose_surface, plane_under
from gstlib.contact import Loading, contact_at_pressure, faces_of, load_force
from gstlib.coupling import couple_scales, place_patch, prepare_faces
from gstlib.face import grid_macroscale, square_alone
from gstlib.geometry import Place, places_of, spline_of
from gstlib.placement import place_patches
from gstlib.preprocess.leveling import remove_plane
from gstlib.reference import (
    composite_heights,
    patches_of_reference,
    press_whole,
    two_scales_table,
)
from gstlib.surface import make_surface

ROOT = Path(__file__).parents[1]
MESH = "pebble-mesh-3dhop/lithic_tool_model_full.ply"
REGION = "pebble-mesh-3dhop/lithic_tool_roi_cf.ply"
MAP = "pebble-usewear/confoc_3d_grid10um.xyz"
SPACING_MM, PATCH_MM, ROWS, COLUMNS = 0.01, 0.85, 2, 3
WIDE_MM, FACE_MM, GRID = 10.0, 18.0, 100
TURN_DEG = 3
# Standard deviation (mm) of the Gaussian that makes the map as smooth as the mesh: half an edge.
SMOOTH_MM = 0.09


def read_map(path: Path) -> xr.DataArray:
    """The confocal map, mm, as it was stored."""
    x, y, z = np.loadtxt(path).T * 1e-3
    row, column = (np.rint(axis / SPACING_MM - 0.5).astype(int) for axis in (y, x))
    heights = np.full((row.max() + 1, column.max() + 1), np.nan)
    heights[row, column] = z
    return make_surface(heights, SPACING_MM)


def marked_region(path: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centre of the marked region, a direction in it, and its normal, from two quads around it."""
    stored = path.read_bytes()
    start = stored.index(b"end_header\n") + len(b"end_header\n")
    upper, lower = (
        np.frombuffer(stored[start:], "<f4", 8 * 8).reshape(2, 4, 8)[..., :3].astype(float)
    )
    along = upper[0] - upper[1]
    normal = np.cross(along, upper[2] - upper[1])
    normal *= np.sign(normal @ (upper.mean(axis=0) - lower.mean(axis=0))) / np.linalg.norm(
        normal
    )
    along -= along @ normal * normal
    return (
        (upper.mean(axis=0) + lower.mean(axis=0)) / 2,
        along / np.linalg.norm(along),
        normal,
    )


def square_of(
    mesh: trimesh.Trimesh,
    centre: np.ndarray,
    x: np.ndarray,
    normal: np.ndarray,
    size_mm: float,
    **around: float | None,
) -> xr.Dataset:
    """The mesh's surface over a square about a centre, and around it."""
    origin = centre - size_mm / 2 * (x + np.cross(normal, x))
    points = [origin, origin + size_mm * x, origin + size_mm * np.cross(normal, x)]
    square, _ = grid_macroscale(
        mesh,
        points_mm=points,
        size_mm=size_mm,
        grid=GRID,
        interpolation="best",
        source=MESH,
        **around,
    )
    return square


def correlations(
    surface: xr.DataArray, smooth: xr.DataArray, turn: float
) -> tuple[float, Place]:
    """Best correlation of a turned map with the surface, both levelled, and its place."""
    step = surface.y.attrs["spacing"]
    half = [smooth.sizes[axis] * SPACING_MM / 2 for axis in "yx"]
    reach = int(np.hypot(*half) / step) + 1
    y, x = np.meshgrid(*2 * (np.arange(-reach, reach + 1) * step,), indexing="ij")
    v, u = Place(0, 0, turn).seen(y, x)
    inside = (abs(v) <= half[0]) & (abs(u) <= half[1])
    at = [(axis + side) / SPACING_MM - 0.5 for axis, side in zip((v, u), half, strict=True)]
    map_ = map_coordinates(smooth.values, at, order=1, mode="nearest") * inside
    planes = np.stack([inside, y * inside, x * inside]).reshape(3, -1)
    planes = np.linalg.qr(planes.T)[0].T.reshape(3, *y.shape)
    map_ -= sum((map_ * plane).sum() * plane for plane in planes)

    def summed(weights: np.ndarray, heights: np.ndarray) -> np.ndarray:
        return fftconvolve(heights, weights[::-1, ::-1], mode="valid")

    energy = summed(inside * 1.0, surface.values**2)
    energy -= sum(summed(plane, surface.values) ** 2 for plane in planes)
    found = summed(map_, surface.values) / np.sqrt((map_**2).sum() * np.maximum(energy, 1e-12))
    row, column = np.unravel_index(found.argmax(), found.shape)
    centre = surface.y.values[row + reach], surface.x.values[column + reach]
    return float(found.max()), Place(*map(float, centre), turn)


def smoothed(heights: xr.DataArray) -> xr.DataArray:
    """The map as the mesh would see it."""
    return heights.copy(data=gaussian_filter(heights.values, SMOOTH_MM / SPACING_MM))


def under(spline: RectBivariateSpline, place: Place, shape: tuple[int, ...]) -> np.ndarray:
    """The mesh's surface at the points of the map."""
    v, u = ((np.arange(count) - (count - 1) / 2) * SPACING_MM for count in shape)
    return spline.ev(*place.points(v[:, None], u))


def refined(surface: xr.DataArray, heights: xr.DataArray, start: Place) -> tuple[float, Place]:
    """The same at any place and turn, from a good start."""
    spline, level = spline_of(surface), remove_plane(smoothed(heights))[0]

    def mismatch(place: np.ndarray) -> float:
        below = heights.copy(data=under(spline, Place(*place), heights.shape))
        return -np.corrcoef(remove_plane(below)[0].values.ravel(), level.values.ravel())[0, 1]

    steps = np.array([[0, 0, 0], [0.05, 0, 0], [0, 0.05, 0], [0, 0, 2.0]])
    best = minimize(
        mismatch,
        start,
        method="Nelder-Mead",
        options={"initial_simplex": np.array(start) + steps},
    )
    return -float(best.fun), Place(*map(float, best.x))


def find_map(surface: xr.DataArray, stored: xr.DataArray) -> tuple[xr.DataArray, Place]:
    """The map, turned over if necessary, and its position; prints what chance alone would find."""
    rows = []
    looks = {
        "as stored": stored,
        "reversed along y": stored.copy(data=stored.values[::-1]),
        "inverted": -stored,
        "inverted and reversed along y": -stored.copy(data=stored.values[::-1]),
    }
    for name, heights in looks.items():
        smooth = smoothed(heights)
        found = [correlations(surface, smooth, turn) for turn in range(0, 360, TURN_DEG)]
        rows.append((name, *max(found)))
    table = pd.DataFrame(rows, columns=["look", "correlation", "place"])
    best = table.loc[table.correlation.idxmax()]
    shown = table.join(pd.DataFrame(table.pop("place").tolist()))
    print(
        f"where the map lies on {WIDE_MM:g} mm:",
        shown.round(3).to_string(index=False),
        sep="\n",
    )
    return looks[best.look], best.place


def cut(heights: xr.DataArray, place: Place) -> tuple[dict[str, xr.DataArray], pd.DataFrame]:
    """Patches of the map, not levelled, and their places on the square; row by row."""
    side = round(PATCH_MM / SPACING_MM)
    first = 0, (heights.sizes["x"] - COLUMNS * side) // 2  # the summits lie at the first rows
    scans, places = {}, []
    for number in range(ROWS * COLUMNS):
        row, column = (
            start + place_ * side
            for start, place_ in zip(first, divmod(number, COLUMNS), strict=True)
        )
        piece = heights.values[row : row + side, column : column + side]
        middle = [
            (start + side / 2 - count / 2) * SPACING_MM
            for start, count in zip((row, column), heights.shape, strict=True)
        ]
        y, x = place.points(*map(np.array, middle))
        scans[str(number + 1)] = make_surface(piece, SPACING_MM)
        places.append((str(number + 1), float(x), float(y), place.rotation_deg))
    return scans, pd.DataFrame(places, columns=["patch", "x_mm", "y_mm", "rotation_deg"])


def planes_table(
    surface: xr.DataArray,
    heights: xr.DataArray,
    place: Place,
    scans: dict,
    patches: pd.DataFrame,
) -> tuple[xr.DataArray, pd.DataFrame]:
    """The map laid on the mesh as a whole, and planes of its patches by the mesh and by the map."""
    spline = spline_of(surface)
    below = heights.copy(data=under(spline, place, heights.shape))
    beyond = remove_plane(heights - below)[1]
    whole = heights - beyond.heights(heights)
    rows = []
    for patch, at in places_of(patches).items():
        v, u = place.seen(at.y_mm, at.x_mm)
        own, mesh = remove_plane(scans[patch])[1], plane_under(spline, at, PATCH_MM)
        offset = own.offset - beyond.offset - beyond.slope_y * v - beyond.slope_x * u
        slopes = own.slope_y - beyond.slope_y, own.slope_x - beyond.slope_x
        rows.append((patch, mesh.offset, mesh.slope_y, mesh.slope_x, offset, *slopes))
    difference = remove_plane(whole - below)[0].values
    print(
        f"mesh and map differ by {1e3 * difference.std():.1f} µm r.m.s., smoothed map by "
        f"{1e3 * (remove_plane(smoothed(whole) - below)[0].values).std():.1f} µm"
    )
    names = [
        f"{of}_{name}" for of in ("mesh", "map") for name in ("offset", "slope_y", "slope_x")
    ]
    return whole, pd.DataFrame(rows, columns=["patch", *names])


def planes_agree(planes: pd.DataFrame, composite: xr.Dataset) -> None:
    """Print how far the planes of mesh and map agree."""
    mesh, map_ = (
        1e3 * planes[[f"{of}_slope_y", f"{of}_slope_x"]].values for of in ("mesh", "map")
    )
    errors, shared = mesh - map_, (mesh - map_).mean(axis=0)
    print(
        f"slopes: map {np.sqrt((map_**2).mean()):.1f} mrad r.m.s. along each axis, "
        f"r = {np.corrcoef(mesh.ravel(), map_.ravel())[0, 1]:.4f}, "
        f"error {np.sqrt((errors**2).mean()):.1f} mrad r.m.s. along each axis "
        f"({np.sqrt(((errors - shared) ** 2).sum() / (errors.size - 2)):.1f} less their mean), "
        f"stated {np.sqrt((composite.tilt_error_mrad**2).mean()):.1f}; offsets "
        f"{1e3 * (planes.mesh_offset - planes.map_offset).std():.1f} µm"
    )


def scored(solved: dict[str, dict[str, xr.Dataset]], against: xr.Dataset) -> pd.DataFrame:
    """Contact against the reference, and the lowest and highest F1 among its draws."""

    def table(draws: slice) -> pd.DataFrame:
        return two_scales_table(solved, against.isel(draw=draws))

    each = np.array([table(slice(draw, draw + 1)).f1 for draw in range(against.sizes["draw"])])
    pooled = table(slice(None))
    return pooled.assign(lowest=np.fmin.reduce(each), highest=np.fmax.reduce(each))


def picture(
    surface: xr.Dataset, whole: np.ndarray, place: Place, patches: pd.DataFrame, path: Path
) -> None:
    """The mesh's surface, the mesh where the map lies, the map, and what it shows beyond."""
    level = surface.height
    below = under(spline_of(level), place, whole.shape)
    limits = np.percentile(1e3 * level, [1, 99])
    figure, axes = plt.subplots(2, 2, figsize=(10, 8.4), layout="constrained")
    size = float(level.x[-1] + level.x[0])
    image = axes[0, 0].imshow(
        1e3 * level, origin="lower", extent=(0, size, 0, size), vmin=limits[0], vmax=limits[1]
    )
    turned = np.array([[-1, -1], [-1, 1], [1, 1], [1, -1], [-1, -1]]) * PATCH_MM / 2
    for patch, at in places_of(patches).items():
        y, x = at.points(*turned.T)
        axes[0, 0].plot(x, y, "w", lw=1)
        axes[0, 0].text(at.x_mm, at.y_mm, patch, color="w")
    extent = (0, whole.shape[1] * SPACING_MM, 0, whole.shape[0] * SPACING_MM)
    views = {"mesh under the map": below, "map": whole, "map less mesh": whole - below}
    axes[0, 0].set_title("mesh (µm; axes mm)")
    figure.colorbar(image, ax=axes[0, 0])
    for panel, (name, values) in zip(axes.flat[1:], views.items(), strict=True):
        span = limits if name != "map less mesh" else (-60, 60)
        image = panel.imshow(
            1e3 * values, origin="lower", extent=extent, vmin=span[0], vmax=span[1]
        )
        panel.set_title(name)
        figure.colorbar(image, ax=panel)
    figure.savefig(path, dpi=110)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=ROOT / "../shared/data")
    parser.add_argument("--size", type=float, default=4.5, help="side of the square, mm")
    parser.add_argument(
        "--shift",
        type=float,
        nargs=2,
        default=(1.0, 0.0),
        metavar=("X", "Y"),
        help="from the middle of the map to that of the square, mm; by default to where, of seven "
        "places tried, the patches carry most",
    )
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--out", type=Path, default=ROOT / "build/pebble.png")
    options = parser.parse_args()
    config = yaml.safe_load((ROOT / "config/config.yaml").read_text())
    constants = ("young_1_MPa", "poisson_1", "young_2_MPa", "poisson_2")
    modulus = contact_modulus(*(config["material"][name] for name in constants))
    force, middle = load_force(config["load"], options.size), 2 * (options.size / 2,)
    s_filter, seed = config["microscale"]["s_filter_um"], config["seed"]

    mesh = trimesh.load_mesh(options.data / MESH)
    centre, x, normal = marked_region(options.data / REGION)
    wide = square_of(mesh, centre, x, normal, WIDE_MM)
    heights, found = find_map(wide.height, read_map(options.data / MAP))
    offset = found.x_mm - WIDE_MM / 2, found.y_mm - WIDE_MM / 2
    across, turn = np.cross(normal, x), np.radians(found.rotation_deg)
    centre, x = (
        centre + offset[0] * x + offset[1] * across,
        np.cos(turn) * x + np.sin(turn) * across,
    )
    shift_x, shift_y = options.shift
    centre = centre + shift_x * x + shift_y * np.cross(normal, x)
    radius = config["counterface"]["radius_mm"]
    surface = square_of(
        mesh, centre, x, normal, options.size, face_mm=FACE_MM, radius_mm=radius
    )
    start = Place(options.size / 2 - shift_y, options.size / 2 - shift_x, 0.0)
    correlation, place = refined(surface.height, heights, start)
    print(f"refined: r = {correlation:.4f}, {place}")
    sq, error = (
        1e3 * float(np.sqrt((of**2).mean())) for of in (surface.height, surface.left_out_error)
    )
    print(
        f"square: Sq {sq:.1f} µm, {surface.height.attrs}, vertices left out err by {error:.1f} µm"
    )

    scans, patches = cut(heights, place)
    whole, planes = planes_table(surface.height, heights, place, scans, patches)
    level = {
        patch: remove_plane(scan)[0].to_dataset(name="height") for patch, scan in scans.items()
    }
    composites = [
        compose_surface(
            surface,
            patches,
            level,
            s_filter_um=s_filter,
            placement_um=config["uncertainty"]["placement_um"],
            seed=seed + draw,
            patch_mm=PATCH_MM,
        )
        for draw in range(options.draws)
    ]
    composite = composites[0]
    names = ["tilt_mrad", "tilt_error_mrad", "known"]
    print("planes, µm and mrad:")
    print(
        (planes.set_index("patch") * 1e3)
        .join(composite[names].to_dataframe())
        .round(1)
        .to_string()
    )
    planes_agree(planes, composite)
    print(
        place_patches(surface.height, patches, level, patch_mm=PATCH_MM)
        .round(2)
        .to_string(index=False)
    )

    by_mesh, *contacts = (
        contact_at_pressure(
            faces_of(each.height, surface.counterface),
            Loading.by_force(
                force, middle, each.height, contact_modulus_MPa=modulus, tolerance=1e-9
            ),
            source="face",
        )
        for each in (surface, *composites)
    )
    rests = np.hypot(by_mesh.slope_y, by_mesh.slope_x)
    print(
        f"at rest the mesh is tilted by {1e3 * float(rests):.1f} mrad against the square's plane"
    )
    alone = Loading(modulus, force / options.size**2, tolerance=1e-9)
    square = contact_at_pressure(square_alone(surface), alone, source="square")
    pressures = couple_scales(contacts[0], square, patches, patch_mm=PATCH_MM).set_index(
        "patch"
    )
    of_mesh = couple_scales(by_mesh, square, patches, patch_mm=PATCH_MM).set_index("patch")
    pressures["mesh alone"] = of_mesh.pressure_MPa
    drawn = [
        couple_scales(each, square, patches, patch_mm=PATCH_MM).pressure_MPa
        for each in contacts
    ]
    for statistic in (np.mean, np.min, np.max):
        pressures[f"composite, {statistic.__name__} of draws"] = statistic(drawn, axis=0)
    by_map = {
        name: ("patch", planes[f"map_{name}"].values)
        for name in ("offset", "slope_y", "slope_x")
    }
    variants = {"mesh's planes": composite, "map's planes": composite.assign(by_map)}
    reference = {}
    for name, of in variants.items():
        drawn = []
        for draw, contact in enumerate(contacts):
            heights_ = composite_heights(
                surface, of, level, s_filter_um=None, seed=seed, draw=draw
            )
            whole_contact = press_whole(heights_, contact)
            scan = level[patches.patch[0]].height
            drawn.append(patches_of_reference(whole_contact.pressure, places_of(patches), scan))
        reference[name] = xr.concat(drawn, "draw")
        each = reference[name].pressure
        for statistic in ("mean", "min", "max"):
            pressures[f"reference on {name}, {statistic}"] = getattr(each, statistic)(
                "draw"
            ).values
    shown = pressures.drop(columns=["x_mm", "y_mm", "rotation_deg", "force_N"])
    print("pressures, MPa:", shown.round(2).T.to_string(), sep="\n")

    scores = []
    for name, against in reference.items():
        at_own = {"levelled": pressures.square_pressure_MPa, "placed": pressures.pressure_MPa}
        at_reference = {
            variant: against.pressure.mean("draw").to_series() for variant in at_own
        }
        for which, by_variant in (("own", at_own), ("reference", at_reference)):
            solved = {"levelled": {}, "placed": {}}
            for patch, scan in level.items():
                height, _ = prepare_faces(scan.height, None, s_filter_um=s_filter, source="map")
                placed = place_patch(height, None, composite, contacts[0], patch)
                for variant, faces in (("levelled", faces_of(height)), ("placed", placed)):
                    pressure = float(by_variant[variant][patch])
                    solved[variant][patch] = contact_at_pressure(
                        faces, Loading(modulus, pressure, tolerance=1e-6), source=patch
                    )
            scores.append(scored(solved, against).assign(planes=name, pressure=which))
    table = pd.concat(scores)
    columns = ["planes", "pressure", "patch", "variant", "contact_fraction"]
    columns += ["reference_contact_fraction", "f1", "lowest", "highest"]
    shown = table[columns][table.reference_contact_fraction > 0].round(3)
    print("contact against the reference, draws pooled, and lowest and highest F1 of a draw:")
    print(shown.to_string(index=False))
    options.out.parent.mkdir(exist_ok=True)
    picture(surface, whole.values, place, patches, options.out)


if __name__ == "__main__":
    main()
