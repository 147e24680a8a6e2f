"""Measured meshes: what is read, the marker of the pebble, both ways to grid (skipped if absent).

What the files are, and whose, is in the PROVENANCE.md beside them; none is part of the project.
"""

from pathlib import Path

import numpy as np
import pytest
import yaml

from gstlib.io.meshes import read_mesh
from gstlib.preprocess.crosscheck import compare_gridding
from gstlib.preprocess.frame import Frame, find_frame
from gstlib.preprocess.gridding import grid_both_ways

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"
PEBBLE = DATA / "pebble-mesh-3dhop/lithic_tool_model_full.ply"
MARKER = DATA / "pebble-mesh-3dhop/lithic_tool_roi_cf.ply"
FLAKE = DATA / "lithics3d-gpl2/demoFlake1.stl"
ROCK = DATA / "grasselli-mit/example_surface.stl"

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"the measured meshes are not beside the project ({DATA})"
)


@pytest.fixture(scope="module")
def pebble():
    return read_mesh(PEBBLE)


@pytest.fixture(scope="module")
def square():
    config = ROOT / "config/pebble.yaml"
    return yaml.safe_load(config.read_text(encoding="utf-8"))["square"]


@pytest.mark.parametrize(
    ("path", "vertices", "faces", "extents"),
    [
        (PEBBLE, 223643, 447278, [44.5, 55.4, 48.5]),
        (FLAKE, 75967, 151930, [33.9, 64.1, 74.4]),
        (ROCK, 8599, 16672, [21.7, 27.6, 2.30]),
    ],
)
def test_nothing_is_lost(path, vertices, faces, extents):
    mesh = read_mesh(path)
    assert (len(mesh.vertices), len(mesh.faces)) == (vertices, faces)
    assert mesh.extents == pytest.approx(extents, abs=0.06)


def test_marker_gives_the_frame_of_the_config_but_for_its_turn(pebble, square):
    """The config's square has the axes of the confocal map, the marker's those of the marker."""
    given = find_frame(square, pebble)
    marked = {"size_mm": square["size_mm"], "frame": {"marker": str(MARKER)}}
    found = find_frame(marked, pebble)
    assert np.dot(found.normal, given.normal) > np.cos(np.radians(0.2))
    centre = given.to_frame(found.from_frame([[2.5, 2.5, 0.0]]))[0]
    # The config moved its square by 0.65 mm along y, so that it holds the whole map.
    np.testing.assert_allclose(centre[:2], [2.5, 2.5 + 0.65], atol=0.12)


def squarely(mesh, centre, reach=2.5):
    """A frame at the vertex nearest to `centre`, along the mean normal of the faces around."""
    near = np.linalg.norm(mesh.vertices - centre, axis=1).argmin()
    place = mesh.vertices[near]
    around = np.linalg.norm(mesh.triangles_center - place, axis=1) < reach
    normal = (mesh.face_normals * mesh.area_faces[:, None])[around].sum(axis=0)
    normal /= np.linalg.norm(normal)
    x_axis = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    x_axis /= np.linalg.norm(x_axis)
    return Frame(place - 2.5 * (x_axis + np.cross(normal, x_axis)), x_axis, normal)


@pytest.mark.parametrize("name", ["pebble", "flake", "rock"])
def test_both_ways_to_grid_agree(pebble, square, name):
    if name == "pebble":
        mesh, frame = pebble, find_frame(square, pebble)
    else:
        mesh = read_mesh(FLAKE if name == "flake" else ROCK)
        frame = squarely(mesh, mesh.centroid)
    gridded = grid_both_ways(mesh, frame, size_mm=5.0, shape=(100, 100), margin_mm=1.0)
    _, table = compare_gridding(gridded)
    print(f"{name}:\n{table.to_string()}")
    first, second = table.iloc[0], table.iloc[1]
    assert second.elements == first.elements == 10_000
    assert second.rms_difference_um < 0.1 * first.Sq_um
    assert second.correlation > 0.998
