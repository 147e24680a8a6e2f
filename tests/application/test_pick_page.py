"""The page to pick the square: it holds the stone, and asks nothing of any network."""

import json
import re

import pytest
import trimesh
from click.testing import CliRunner
from gst.cli import main

TABLE = "patch\tx_mm\ty_mm\tt0\n7\t1.5\t2.5\ta.plu\n"


@pytest.fixture
def mesh(tmp_path):
    path = tmp_path / "Stein & <b>.ply"
    trimesh.creation.icosphere(subdivisions=3, radius=20.0).export(path)
    return path


def pick(*arguments):
    return CliRunner().invoke(main, ["pick", *(str(argument) for argument in arguments)])


def data_of(page):
    return json.loads(re.search(r"^const data = (.*);$", page, re.MULTILINE)[1])


def test_the_page_holds_the_stone_and_the_patches(mesh, tmp_path):
    (tmp_path / "patches.tsv").write_text(TABLE)
    page = tmp_path / "page.html"
    options = ("--unit", "cm", "--size", "8", "--patches", tmp_path / "patches.tsv")
    result = pick(mesh, *options, "--output", page)
    assert result.exit_code == 0, result.output
    text = page.read_text()
    data = data_of(text)
    assert data["stone"]["bounds"] == [[-200] * 3, [200] * 3]
    assert (data["name"], data["unit"], data["size"]) == (mesh.name, "cm", 8)
    assert data["patches"] == [{"name": "7", "x": 1.5, "y": 2.5, "turn": 0}]
    assert "<title>Pick the square on Stein &amp; &lt;b&gt;.ply" in text
    assert not re.search(r"@[A-Z_]+@", text)
    assert not re.search(r"""(src|href)=["']?http""", text.split("<script>")[0])


def test_the_unit_to_copy_is_that_of_a_file_which_states_its_own(tmp_path):
    trimesh.creation.icosphere(subdivisions=2, radius=0.02).export(tmp_path / "stone.glb")
    assert pick(tmp_path / "stone.glb", "--output", tmp_path / "page.html").exit_code == 0
    data = data_of((tmp_path / "page.html").read_text())
    assert data["unit"] == "m"
    assert data["stone"]["bounds"][1] == pytest.approx([20] * 3, rel=1e-4)


def test_a_name_is_text_wherever_it_stands(tmp_path):
    """Even one with a mark of the template in it, or what opens a script or a comment."""
    path = tmp_path / "@DATA@@NOTE@<!--<script><img src=x>.stl"
    trimesh.creation.icosphere(subdivisions=1, radius=20.0).export(path)
    page = tmp_path / "page.html"
    assert pick(path, "--output", page).exit_code == 0
    text = page.read_text()
    assert data_of(text)["name"] == path.name
    assert "<title>Pick the square on @DATA@@NOTE@&lt;!--&lt;script&gt;&lt;img" in text
    for markup in ("<img", "<!--<"):
        assert markup not in text


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (("--output", "stone.ply"), "stone.ply"),
        (("--size", "0"), "--size"),
        (("--patches", "none.tsv"), "none.tsv"),
        (("--unit", "um"), "mesh_unit"),
    ],
)
def test_what_cannot_be_meant_is_refused(mesh, tmp_path, monkeypatch, options, named):
    monkeypatch.chdir(tmp_path)
    before = mesh.read_bytes()
    result = pick(mesh, *options)
    assert result.exit_code == 2
    assert named in result.stderr
    assert [file.name for file in tmp_path.iterdir()] == [mesh.name]
    assert mesh.read_bytes() == before
