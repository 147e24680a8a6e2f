"""Measured files through readers, gridding and preparation (skipped where they are absent).

What the files are, and whose, is in the PROVENANCE.md beside them; none is part of the project.
"""

from pathlib import Path

import numpy as np
import pytest
import yaml
from gst.check.matching import match_map
from gst.config.patches import read_patches
from gstlib.coupling import orientations, placement
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import cut_scan, read_scan
from gstlib.io.stage import stage_of
from gstlib.preprocess.mesh import grid_mesh
from gstlib.preprocess.scans import prepare_patch
from gstlib.surfaces.frames import frame_from_points
from gstlib.surfaces.grid import spacing_of
from power import specimen_config
from sweep import study_of

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
    return prepare_patch(
        scan,
        crop=(0, 0),
        scans={"size_mm": size_mm, "mould": {"invert": False, "flip": None}},
        preprocessing={
            "maximum_unmeasured": 0.05,
            "outlier_rule": "window",
            "outlier_fraction": 0.01,
        },
    )


@pytest.mark.parametrize(
    ("path", "stage_mm"), [(PLU, (-0.05216003, -6.04268)), (LEICA, (-58.20761, -0.121776))]
)
def test_a_plu_says_where_its_stage_stood(path, stage_mm):
    """In µm: in mm, the stage of the second would have moved by 58 m."""
    assert stage_of(read_scan(path)) == pytest.approx(stage_mm, rel=1e-6)


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


def test_the_pebbles_coordinates_are_multiples_of_a_64th_of_a_millimetre(caplog):
    mesh = read_mesh(DATA / "pebble-mesh-3dhop/lithic_tool_model_full.ply")
    assert mesh.metadata["step_mm"] == 1 / 64
    assert (64 * mesh.vertices == np.round(64 * mesh.vertices)).all()
    assert "steps of 15.6 µm" in caplog.text


def test_the_map_of_the_pebble_is_found_on_its_face():
    """Where the patch table says, whose places were found by hand; its patches alone are not."""
    config = yaml.safe_load((ROOT / "config/pebble.yaml").read_text(encoding="utf-8"))
    mesh = read_mesh(DATA / "pebble-mesh-3dhop/lithic_tool_model_full.ply")
    frame = frame_from_points(config["square"]["points_mm"])
    grids = {"size_mm": 5.0, "grid": 100, "around": 120, "interpolation": "linear"}
    face = grid_mesh(mesh, frame, **grids).height
    scan = read_scan(MAP, unit="um")
    match = match_map(face, scan)
    patches = read_patches(ROOT / "config/patches_pebble.tsv", size_mm=5.0, patch_size_mm=0.85)
    assert match.found
    assert match.place[:2] == pytest.approx((patches.y_mm.mean(), patches.x_mm.mean()), abs=0.03)
    # it is reversed along y, as the config has it: along x, and turned by half a turn
    assert match.mirrored
    assert abs(match.place.rotation_deg) == pytest.approx(180, abs=1)
    assert not match_map(face, cut_scan(scan, (0.5, 0.8), 0.85)).found


@pytest.fixture(scope="module")
def pebble():
    """The study of the measured pebble."""
    files = "config/config.yaml", "config/pebble.yaml"
    return study_of(specimen_config(*(ROOT / file for file in files)), ROOT)


@pytest.mark.parametrize("mistake", orientations.TABLES)
def test_a_mistaken_table_of_the_pebble_is_named(pebble, mistake, caplog):
    table, settings = pebble.patches, pebble.settings["check_placement"]
    scans = {patch: pebble.prepared[patch, "T0"] for patch in table.patch}
    x, y = orientations.as_measured(table.x_mm, table.y_mm, 5.0, mistake)
    found = placement.check_placement(
        pebble.face.height,
        table.assign(x_mm=x, y_mm=y),
        scans,
        **settings | {"accept": [placement.FAULT]},
    )
    named = found.orientation.iloc[-1].removeprefix("with ")
    faults = [record for record in caplog.records if record.levelname == "ERROR"]
    assert len(faults) == bool(mistake)
    if mistake:
        right = orientations.as_measured(x, y, 5.0, named)
        np.testing.assert_allclose(right, (table.x_mm, table.y_mm))
    else:
        assert named == orientations.AS_GIVEN
