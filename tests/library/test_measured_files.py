"""Measured files through readers, gridding and preparation (skipped where they are absent).

What the files are, and whose, is in the PROVENANCE.md beside them; none is part of the project.
"""

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.ndimage import gaussian_filter, map_coordinates

from gstlib.bem import HalfSpace
from gstlib.contact import contact_at_pressure
from gstlib.inputs import inspect_file
from gstlib.io.meshes import read_mesh
from gstlib.io.patches import read_patches
from gstlib.io.scans import read_scan
from gstlib.preprocess.frame import Frame
from gstlib.preprocess.gridding import grid_mesh
from gstlib.preprocess.leveling import remove_plane
from gstlib.study import prepare_scan
from gstlib.surface import spacing_of

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"the measured files are not beside the project ({DATA})"
)

MAP = DATA / "pebble-usewear/confoc_3d_grid10um.xyz"
PLU = DATA / "surfacetopography-mit/plu-1.plu"
LEICA = DATA / "surfalize-gpl3/leica-dcm3d-test_1.plu"
ALICONA = DATA / "surfacetopography-mit/al3d-1.al3d"


def prepared(scan, size_mm):
    return prepare_scan(
        scan,
        crop=(0, 0),
        scans={"size_mm": size_mm, "mould": {"invert": False, "flip": None}},
        preprocessing={
            "maximum_unmeasured": 0.05,
            "outlier_rule": "window",
            "outlier_half_width": 5,
            "outlier_share": 0.01,
        },
    )


@pytest.mark.parametrize(
    ("path", "shape", "start", "unit_mm", "spacing"),
    [
        (PLU, (576, 768), 508, 1e-3, 1.66e-3),
        (LEICA, (576, 768), 508, 1e-3, 0.332e-3),
        # where its heights start is in its own header
        (ALICONA, (296, 200), 1261, 1e3, 0.438027e-3),
    ],
)
def test_scans_are_read_as_their_bytes_say(path, shape, start, unit_mm, spacing):
    raw = np.frombuffer(path.read_bytes(), "<f4", shape[0] * shape[1], start).reshape(shape)
    scan = read_scan(path)
    np.testing.assert_allclose(scan.values, raw.astype(float) * unit_mm, rtol=1e-9)
    assert spacing_of(scan) == pytest.approx((spacing, spacing), rel=1e-6)


def test_flat_machined_surface_and_leica_grooves():
    flat = prepared(read_scan(PLU), 0.85)
    assert flat.height.shape == (512, 512)  # the paper's patch
    assert flat.attrs["unmeasured"] == 0
    assert flat.attrs["tilt_x_mrad"] == pytest.approx(7.675, abs=0.01)
    assert flat.attrs["Sq_after_um"] == pytest.approx(0.019, abs=0.002)
    grooves = prepared(read_scan(LEICA), 0.19)
    assert grooves.attrs["instrument"] == "DCM 3D rev. 2"
    assert grooves.attrs["Sq_after_um"] == pytest.approx(5.21, abs=0.05)


@pytest.mark.parametrize(
    ("path", "unit", "size", "pressure"),
    [
        (PLU, None, 0.85, 22.0),
        (LEICA, None, 0.19, 76.07),  # the paper's hardest pressed patch
        (ALICONA, None, 0.08, 76.07),
        (MAP, "um", 0.85, 22.0),
    ],
)
def test_contact_of_measured_patches(path, unit, size, pressure):
    height = prepared(read_scan(path, unit=unit), size).height
    contact = contact_at_pressure(
        height.to_dataset(name="height"),
        source=path,
        contact_modulus_MPa=12820.0,
        target_pressure_MPa=pressure,
        tolerance=1e-8,
    )
    field = contact.pressure.values
    assert field.mean() == pytest.approx(pressure, rel=1e-3)
    operator = HalfSpace(height.shape, spacing_of(height), 12820.0)
    interpenetration = float(contact.displacement) - (height.values.max() - height.values)
    gap = operator.displacement(field) - interpenetration
    assert (field >= 0).all()
    assert np.abs(gap[field > 0]).max() <= 1e-6 * interpenetration.max()
    assert gap[field == 0].min(initial=0.0) >= -1e-6 * interpenetration.max()
    assert 0.001 < float(contact.contact_fraction) < 1


@pytest.mark.parametrize(
    ("name", "vertices", "faces", "extents"),
    [
        ("pebble-mesh-3dhop/lithic_tool_model_full.ply", 223643, 447278, [44.5, 55.4, 48.5]),
        ("lithics3d-gpl2/demoFlake1.stl", 75967, 151930, [33.9, 64.1, 74.4]),
        ("grasselli-mit/example_surface.stl", 8599, 16672, [21.7, 27.6, 2.30]),
    ],
)
def test_nothing_of_a_mesh_is_lost(name, vertices, faces, extents):
    mesh = read_mesh(DATA / name)
    assert (len(mesh.vertices), len(mesh.faces)) == (vertices, faces)
    assert mesh.extents == pytest.approx(extents, abs=0.06)


@pytest.fixture(scope="module")
def use_face():
    config = yaml.safe_load((ROOT / "config/pebble.yaml").read_text(encoding="utf-8"))
    given = config["square"]["frame"]
    return grid_mesh(
        read_mesh(DATA / "pebble-mesh-3dhop/lithic_tool_model_full.ply"),
        Frame(given["origin_mm"], given["x_axis"], given["normal"]),
        size_mm=5.0,
        shape=(100, 100),
        margin_mm=1.0,
    ).height


@pytest.fixture(scope="module")
def patches():
    return read_patches(
        ROOT / "config" / "patches_pebble.tsv",
        schema=ROOT / "workflow" / "schemas" / "patches.schema.yaml",
        size_mm=5.0,
        patch_size_mm=0.85,
    )


def test_square_of_the_pebble(use_face):
    level, plane = remove_plane(use_face)
    assert abs(plane.offset) < 0.05  # the origin lies on the surface
    assert max(abs(plane.tilt_x_mrad), abs(plane.tilt_y_mrad)) < 50
    assert 0.02 < float(level.std()) < 0.1
    assert use_face.attrs["mesh_edge_mm"] == pytest.approx(0.19, abs=0.01)


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
    scan = read_scan(MAP, unit="um")
    stone = np.flipud(remove_plane(scan)[0].values)
    # To the resolution of the mesh (edges of 0.19 mm), which also filters the square.
    stone = gaussian_filter(stone, 0.1 / 0.01)
    filtered = gaussian_filter(use_face.values, 0.1 / 0.05)
    centre_x, centre_y = patches.x_mm.mean(), patches.y_mm.mean()
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


def test_inspection():
    facts, heights = inspect_file(MAP, unit="um")
    expected = {"points_x": 255, "points_y": 191, "spacing_x_um": 10, "Sq_um": 49.3}
    assert {key: facts[key] for key in expected} == pytest.approx(expected, rel=1e-3)
    assert heights.shape == (191, 255)
