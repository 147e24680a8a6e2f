"""Measured files through readers, gridding and preparation (skipped where they are absent).

What the files are, and whose, is in the PROVENANCE.md beside them; none is part of the project.
"""

import struct
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.ndimage import gaussian_filter, map_coordinates

from gstlib.bem import HalfSpace
from gstlib.contact import solve_at_pressure
from gstlib.inspection import inspect_file
from gstlib.io.meshes import read_mesh
from gstlib.io.patches import read_patches
from gstlib.io.scans import check_size, cut_scan, read_scan
from gstlib.preprocess.gridding import Frame, grid_mesh
from gstlib.preprocess.leveling import remove_plane
from gstlib.preprocess.scan import prepare_scan
from gstlib.surface import spacing_of

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"the measured files are not beside the project ({DATA})"
)

AS_SCANNED = {
    "mould_invert": False,
    "mould_flip": None,
    "maximum_unmeasured": 0.05,
    "outlier_half_width": 5,
    "outlier_share": 0.01,
}
POINTS = {
    "unit": "um",
    "scatter_spacing_mm": 0.01,
    "scatter_extent_mm": (0.0, 2.55, 0.0, 1.91),
}


@pytest.mark.parametrize(
    ("name", "spacing"),
    [
        ("surfacetopography-mit/plu-1.plu", 1.66e-3),
        ("surfalize-gpl3/leica-dcm3d-test_1.plu", 0.332e-3),
    ],
)
def test_plu_is_read_as_its_bytes_say(name, spacing):
    content = (DATA / name).read_bytes()
    rows, columns = struct.unpack_from("<II", content, 500)
    raw = np.frombuffer(content, "<f4", rows * columns, 508).reshape(rows, columns)
    scan = read_scan(DATA / name)
    assert scan.shape == (576, 768)
    np.testing.assert_allclose(scan.values, raw.astype(float) * 1e-3, rtol=1e-9)
    assert spacing_of(scan) == (spacing, spacing)


def test_flat_machined_surface():
    scan = cut_scan(read_scan(DATA / "surfacetopography-mit/plu-1.plu"), (0, 0), 0.85)
    check_size(scan, 0.85)
    assert scan.shape == (512, 512)
    prepared = prepare_scan(scan, **AS_SCANNED)
    assert prepared.attrs["unmeasured"] == 0
    assert prepared.attrs["tilt_x_mrad"] == pytest.approx(7.675, abs=0.01)
    assert prepared.attrs["Sq_after_um"] == pytest.approx(0.019, abs=0.002)


def test_leica_grooves():
    prepared = prepare_scan(read_scan(DATA / "surfalize-gpl3/leica-dcm3d-test_1.plu"), **AS_SCANNED)
    assert prepared.attrs["instrument"] == "DCM 3D rev. 2"
    assert prepared.attrs["Sq_after_um"] == pytest.approx(5.14, abs=0.05)


@pytest.mark.parametrize(
    ("name", "options", "size", "pressure"),
    [
        # 512 × 512 points: the paper's patch
        ("surfacetopography-mit/plu-1.plu", {}, 0.85, 22.0),
        # the paper's hardest pressed patch
        ("surfalize-gpl3/leica-dcm3d-test_1.plu", {}, 0.19, 76.07),
        ("surfacetopography-mit/al3d-1.al3d", {}, 0.08, 76.07),
        ("pebble-usewear/confoc_3d.xyz", POINTS, 0.85, 22.0),
        ("pebble-usewear/confoc_3d_grid10um.xyz", {"unit": "um"}, 0.85, 22.0),
    ],
)
def test_contact_of_measured_patches(name, options, size, pressure):
    piece = cut_scan(read_scan(DATA / name, **options), (0, 0), size)
    height = prepare_scan(piece, **AS_SCANNED).height
    state, field = solve_at_pressure(
        height,
        source=name,
        contact_modulus_MPa=12820.0,
        target_pressure_MPa=pressure,
        tolerance=1e-8,
    )
    assert float(field.mean()) == pytest.approx(pressure, rel=1e-3)
    operator = HalfSpace(height.shape, spacing_of(height), 12820.0)
    interpenetration = state.displacement - (height.values.max() - height.values)
    gap = operator.displacement(field.values) - interpenetration
    contact = field.values > 0
    assert (field.values >= 0).all()
    assert np.abs(gap[contact]).max() <= 1e-6 * interpenetration.max()
    assert gap[~contact].min(initial=0.0) >= -1e-6 * interpenetration.max()
    assert 0.001 < state.contact_fraction < 1


def test_alicona():
    path = DATA / "surfacetopography-mit/al3d-1.al3d"
    scan = read_scan(path)
    # Offset of the heights and length of a row, from the file's own header.
    raw = np.frombuffer(path.read_bytes(), "<f4", 296 * 200, 1261).reshape(296, 200)
    np.testing.assert_allclose(scan.values, raw.astype(float) * 1e3, rtol=1e-9)
    assert spacing_of(scan) == pytest.approx((0.438027e-3, 0.438027e-3))
    assert prepare_scan(scan, **AS_SCANNED).attrs["Sq_after_um"] < 1


def test_confocal_map_gridded_here_and_beforehand():
    folder = DATA / "pebble-usewear"
    ready = read_scan(folder / "confoc_3d_grid10um.xyz", unit="um")
    assert ready.shape == (191, 255)
    assert spacing_of(ready) == pytest.approx((0.01, 0.01))
    assert 1e3 * float(ready.std()) == pytest.approx(69.5, abs=0.1)
    gridded = read_scan(folder / "confoc_3d.xyz", **POINTS)
    assert gridded.shape == ready.shape
    # Delaunay triangulations of lattice-like points are not unique.
    assert np.sqrt(np.mean((gridded.values - ready.values) ** 2)) < 1e-4


@pytest.fixture(scope="module")
def pebble():
    return read_mesh(DATA / "pebble-mesh-3dhop/lithic_tool_model_full.ply")


@pytest.fixture(scope="module")
def marker():
    """The two quads that mark the place of the map: corners (2, 4, 3), normal."""
    content = (DATA / "pebble-mesh-3dhop/lithic_tool_roi_cf.ply").read_bytes()
    start = content.index(b"end_header\n") + len(b"end_header\n")
    vertices = np.frombuffer(content, "<f4", 14 * 8, start).reshape(14, 8).astype(float)
    return vertices[:8, :3].reshape(2, 4, 3), vertices[4, 3:6]


@pytest.fixture(scope="module")
def square():
    config = ROOT / "config" / "pebble.yaml"
    return yaml.safe_load(config.read_text(encoding="utf-8"))["square"]


@pytest.fixture(scope="module")
def frame(square):
    values = square["frame"]
    return Frame(values["origin_mm"], values["x_axis"], values["normal"])


@pytest.fixture(scope="module")
def use_face(pebble, frame):
    return grid_mesh(pebble, frame, size_mm=5.0, shape=(100, 100), margin_mm=1.0)


@pytest.fixture(scope="module")
def patches():
    return read_patches(
        ROOT / "config" / "patches_pebble.tsv",
        schema=ROOT / "workflow" / "schemas" / "patches.schema.yaml",
        size_mm=5.0,
        patch_size_mm=0.85,
    )


def map_centre(patches):
    """Centre of the map in the square's frame, from the patches cut from it."""
    return np.array([patches.x_mm.mean(), patches.y_mm.mean()])


def test_square_of_the_pebble(use_face):
    level, plane = remove_plane(use_face)
    assert abs(plane.offset) < 0.05  # the origin lies on the surface
    assert max(abs(plane.tilt_x_mrad), abs(plane.tilt_y_mrad)) < 50
    assert 0.02 < float(level.std()) < 0.1
    assert use_face.attrs["mesh_edge_mm"] == pytest.approx(0.19, abs=0.01)


def test_config_agrees_with_the_marker(marker, frame, patches):
    quads, normal = marker
    assert np.dot(frame.normal, normal) > np.cos(np.radians(0.1))
    # The map lies within the marker, seen along the normal.
    x, y = frame.to_frame(quads[0])[:, :2].T
    corners = np.stack([x, y], axis=1) - map_centre(patches)
    following = np.roll(corners, -1, axis=0)
    turns = corners[:, 0] * following[:, 1] - corners[:, 1] * following[:, 0]
    assert (np.sign(turns) == np.sign(turns[0])).all()
    # The square lies around the marker: centred on it, but for what it takes to hold the map.
    marker_centre = frame.to_frame(quads.reshape(-1, 3))[:, :2].mean(axis=0)
    np.testing.assert_allclose(marker_centre, [2.5, 2.5 + 0.65], atol=0.05)
    # The surface, at z = 0, lies between its two copies.
    assert frame.to_frame(quads[0])[:, 2].min() > 0 > frame.to_frame(quads[1])[:, 2].max()


def correlation(mesh_heights, scan_heights):
    """Pearson correlation over the map, a plane taken out of both."""
    ny, nx = scan_heights.shape
    y, x = np.indices((ny, nx)) - np.array([ny, nx]).reshape(2, 1, 1) / 2
    matrix = np.stack([np.ones(y.size), y.ravel(), x.ravel()], axis=1)
    rest = [
        v.ravel() - matrix @ np.linalg.lstsq(matrix, v.ravel())[0]
        for v in (mesh_heights, scan_heights)
    ]
    return float(np.corrcoef(*rest)[0, 1])


def test_map_is_where_the_patch_table_says(use_face, patches):
    scan = read_scan(DATA / "pebble-usewear/confoc_3d_grid10um.xyz", unit="um")
    stone = prepare_scan(scan, **AS_SCANNED | {"mould_flip": "y"}).height.values
    # To the resolution of the mesh (edges of 0.19 mm), which also filters the square.
    stone = gaussian_filter(stone, 0.1 / 0.01)
    filtered = gaussian_filter(use_face.values, 0.1 / 0.05)
    centre_x, centre_y = map_centre(patches)
    ny, nx = stone.shape
    y = centre_y + (np.arange(ny) - (ny - 1) / 2) * 0.01
    x = centre_x + (np.arange(nx) - (nx - 1) / 2) * 0.01

    def on_square(shift_y=0.0, shift_x=0.0):
        places = np.meshgrid(y + shift_y, x + shift_x, indexing="ij")
        return map_coordinates(filtered, [p / 0.05 - 0.5 for p in places], order=1)

    here = correlation(on_square(), stone)
    assert here > 0.95
    # Nowhere near is better, and no other way round comes close.
    for shift in (-0.1, 0.1):
        assert correlation(on_square(shift_x=shift), stone) < here
        assert correlation(on_square(shift_y=shift), stone) < here
    others = [stone[::-1], stone[:, ::-1], stone[::-1, ::-1]]
    assert max(correlation(on_square(), other) for other in others) < 0.6


def test_patches_of_the_pebble(patches):
    scan = read_scan(DATA / "pebble-usewear/confoc_3d.xyz", **POINTS)
    pieces = []
    for patch in patches.itertuples():
        piece = cut_scan(scan, (patch.crop_x_mm, patch.crop_y_mm), 0.85)
        check_size(piece, 0.85)
        prepared = prepare_scan(piece, **AS_SCANNED | {"mould_flip": "y"})
        assert 5 < prepared.attrs["Sq_after_um"] < 60
        pieces.append(piece.values)
    together = np.vstack([np.hstack(pieces[3:]), np.hstack(pieces[:3])])
    np.testing.assert_array_equal(together[:85], scan.values[:85])
    np.testing.assert_array_equal(together[85:], scan.values[-85:])


@pytest.mark.parametrize(
    ("name", "told", "expected"),
    [
        ("surfacetopography-mit/plu-1.plu", {}, {"points_x": 768, "spacing_x_um": 1.66}),
        ("surfalize-gpl3/leica-dcm3d-test_1.plu", {}, {"points_y": 576, "Sq_um": 5.17}),
        ("surfacetopography-mit/al3d-1.al3d", {}, {"points_x": 200, "points_y": 296}),
        ("pebble-usewear/confoc_3d_grid10um.xyz", {"unit": "um"}, {"points_x": 255}),
        (
            "pebble-usewear/confoc_3d.xyz",
            {"unit": "um", "spacing_um": 10.0},
            {"spacing_x_um": 10.0},
        ),
        ("grasselli-mit/example_surface.stl", {}, {"faces": 16672, "closed": "no"}),
        ("lithics3d-gpl2/demoFlake1.stl", {}, {"vertices": 75967, "closed": "yes"}),
        ("pebble-mesh-3dhop/lithic_tool_model_full.ply", {}, {"faces": 447278, "bodies": 1}),
    ],
)
def test_inspection(name, told, expected):
    facts, heights = inspect_file(DATA / name, **told)
    for key, value in expected.items():
        assert facts[key] == (value if isinstance(value, str) else pytest.approx(value, rel=1e-3))
    assert np.isfinite(heights.values).any()
