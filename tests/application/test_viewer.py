"""A stone in a page: what is drawn is the stone, small enough to be sent."""

import base64
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from gst.page import viewer
from gst.setup.place_state import stone_of
from gstlib.errors import InputError


def sphere():
    return trimesh.creation.icosphere(subdivisions=5, radius=20.0)  # 20,480 faces


def unpack(text, kind):
    """Three numbers for each vertex or face."""
    return np.frombuffer(base64.b64decode(text), kind).reshape(-1, 3)


def test_a_coarse_stone_has_the_shape_of_the_stone():
    coarse = viewer.coarsen(sphere(), faces=4000)
    assert 2000 < len(coarse.faces) <= 4000
    assert np.linalg.norm(coarse.vertices, axis=1) == pytest.approx(20, abs=0.15)
    assert coarse.area == pytest.approx(sphere().area, rel=0.01)
    # No face is turned inwards: it would be drawn dark.
    outwards = (coarse.face_normals * coarse.triangles_center).sum(axis=1)
    assert outwards.min() > 0


def test_vertices_that_are_kept_stay_where_they_are():
    mesh = sphere()
    keep = mesh.vertices[:, 2] > 18
    coarse = viewer.coarsen(mesh, faces=4000, keep=keep)
    assert len(coarse.faces) <= 4000
    assert set(map(tuple, mesh.vertices[keep])) <= set(map(tuple, coarse.vertices))
    # more than may be left: it comes to an end
    whole = viewer.coarsen(mesh, faces=100, keep=np.ones_like(keep))
    assert len(whole.faces) == len(mesh.faces)


def test_the_data_are_the_stone():
    mesh = trimesh.creation.box((10.0, 30.0, 20.0))
    mesh.apply_translation((100.0, 0.0, -5.0))
    data = viewer.stone_data(mesh)
    offsets = unpack(data["vertices"], "<f4")
    np.testing.assert_allclose(offsets + data["centre"], mesh.vertices, atol=1e-5)
    np.testing.assert_array_equal(unpack(data["faces"], "<u4"), mesh.faces)
    longest_first = np.eye(3)[[1, 2, 0]]
    np.testing.assert_allclose(data["axes"], longest_first, atol=1e-9)


RED, BLUE = [255, 0, 0], [0, 0, 255]


@pytest.mark.parametrize("kind", ["vertices", "texture"])
def test_the_stone_has_the_colours_of_its_mesh(tmp_path, monkeypatch, kind):
    stone = trimesh.creation.icosphere(subdivisions=2, radius=10.0)
    is_up = stone.vertices[:, 2] > 0
    if kind == "vertices":
        stone.visual.vertex_colors = np.where(is_up[:, None], RED, BLUE)
    else:
        uv = np.column_stack([np.where(is_up, 0.99, 0.01), 0.5 + 0 * is_up])
        picture = Image.fromarray(np.uint8([[BLUE, RED]]))
        stone.visual = trimesh.visual.TextureVisuals(uv=uv, image=picture)
    monkeypatch.chdir(tmp_path)
    stone.export("stone.glb")
    config = Path("study.yaml")
    config.write_text("inputs: {mesh: stone.glb, mesh_unit: mm, scan_folder: .}")
    data = stone_of(config)
    red = unpack(data["colours"], np.uint8)[:, 0]
    np.testing.assert_array_equal(red > 128, unpack(data["vertices"], "<f4")[:, 2] > 0)


def test_the_scale_bar_is_as_long_as_it_says():
    if (node := shutil.which("node")) is None:
        pytest.skip("needs Node.js on the PATH")
    code = viewer.shipped("viewer.js")
    place = re.search(r"function placeScale\(\) {.*?\n  }", code, re.DOTALL)[0]
    script = f"const scale = {{ style: {{}} }}; const pixel = () => 0.03; {place} placeScale();"
    script += "console.log(scale.textContent, scale.style.width);"
    length, unit, width = subprocess.check_output(
        [node, "-e", script], text=True
    ).split()
    assert unit == "mm"
    assert float(length) == pytest.approx(0.03 * float(width.removesuffix("px")))


def test_the_scripts_are_those_of_the_trimesh_that_is_locked(tmp_path, monkeypatch):
    script = viewer.three_js()
    assert script.count("THREE") > 100
    monkeypatch.setattr(viewer.importlib.resources, "files", lambda package: tmp_path)
    with pytest.raises(InputError, match=r"requirements\.lock"):
        viewer.three_js()
