"""A stone in a page: what is drawn is the stone, small enough to be sent."""

import base64
import json
import re
import shutil
import subprocess
import zipfile

import numpy as np
import pytest
import trimesh
from gst.page import viewer
from gstlib.errors import InputError


def sphere():
    return trimesh.creation.icosphere(subdivisions=5, radius=20.0)  # 20,480 faces


def unpack(text, kind, columns):
    return np.frombuffer(base64.b64decode(text), kind).reshape(-1, columns)


def test_a_coarse_stone_has_the_shape_of_the_stone():
    coarse = viewer.coarsen(sphere(), faces=4000)
    assert 2000 < len(coarse.faces) <= 4000
    assert np.linalg.norm(coarse.vertices, axis=1) == pytest.approx(20, abs=0.15)
    assert coarse.area == pytest.approx(sphere().area, rel=0.01)
    # No face is turned inwards: it would be drawn dark.
    assert ((coarse.face_normals * coarse.triangles_center).sum(axis=1) > 0).all()
    assert viewer.coarsen(coarse, faces=len(coarse.faces)) is coarse


def test_vertices_that_are_kept_stay_where_they_are():
    mesh = sphere()
    keep = mesh.vertices[:, 2] > 18
    coarse = viewer.coarsen(mesh, faces=4000, keep=keep)
    assert len(coarse.faces) <= 4000
    there = {tuple(row) for row in np.asarray(coarse.vertices).tolist()}
    assert {tuple(row) for row in np.asarray(mesh.vertices)[keep].tolist()} <= there
    everything = np.ones(len(mesh.vertices), bool)  # more than may be left: it comes to an end
    assert len(viewer.coarsen(mesh, faces=100, keep=everything).faces) == len(mesh.faces)


def test_the_data_are_the_stone():
    mesh = trimesh.creation.box((10.0, 30.0, 20.0))
    mesh.apply_translation((100.0, 0.0, -5.0))
    data = json.loads(viewer.to_script(viewer.stone_data(mesh)))
    title = {"title": "</script><!--<script>"}
    assert "<" not in viewer.to_script(title)
    assert json.loads(viewer.to_script(title)) == title
    vertices = unpack(data["vertices"], "<f4", 3) + data["centre"]
    np.testing.assert_allclose(vertices, mesh.vertices, atol=1e-5)
    np.testing.assert_array_equal(unpack(data["faces"], "<u4", 3), mesh.faces)
    assert data["bounds"] == [[95, -15, -15], [105, 15, 5]]
    np.testing.assert_allclose(data["axes"], [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-9)


@pytest.mark.parametrize("pixel", [0.0013, 0.03, 0.7])
def test_the_scale_bar_is_as_long_as_it_says(pixel):
    """A pixel is so many mm."""
    if (node := shutil.which("node")) is None:
        pytest.skip("needs Node.js on the PATH")
    place = re.search(r"function placeScale\(\) {.*?\n  }", viewer.shipped("viewer.js"), re.DOTALL)[
        0
    ]
    script = f"const scale = {{ style: {{}} }}; const pixel = () => {pixel}; {place} placeScale();"
    script += "console.log(scale.textContent, scale.style.width);"
    said = subprocess.run([node, "-e", script], capture_output=True, text=True, check=True).stdout
    length, unit, width = said.split()
    assert unit == "mm"
    assert float(length) == pytest.approx(pixel * float(width.removesuffix("px")))
    assert 40 < float(width.removesuffix("px")) <= 120


def test_the_scripts_are_those_of_the_trimesh_that_is_locked(tmp_path, monkeypatch):
    script = viewer.three_js()
    assert script.count("THREE") > 100
    assert "<script" not in script
    monkeypatch.setattr(viewer.importlib.resources, "files", lambda package: tmp_path)
    (tmp_path / "resources/templates").mkdir(parents=True)
    with zipfile.ZipFile(tmp_path / viewer._TEMPLATE, "w") as archive:
        archive.writestr("viewer.html.template", "<script>something else</script>")
    with pytest.raises(InputError, match=r"requirements\.lock"):
        viewer.three_js()
