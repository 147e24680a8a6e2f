"""`gst export`: other programs' readers find in its files what the study holds."""

import json
import shutil

import meshio
import numpy as np
import pytest
import trimesh
from gstlib.io.files import sha256
from gstlib.io.scans import read_scan
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import read_table
from gstlib.surfaces.frames import FRAME, stored_frame
from gstlib.surfaces.grid import spacing_of
from SurfaceTopography.IO import open_topography
from surfalize import Surface

PATCH = "7"


@pytest.fixture(scope="module")
def exported(finished_tiny, tmp_path_factory):
    folder = tmp_path_factory.mktemp("export")
    # left of another config, with more patches
    other = finished_tiny.results / "surfaces/T0/9/99_T0.h5"
    other.parent.mkdir()
    shutil.copy(finished_tiny.results / f"surfaces/T0/1/{PATCH}_T0.h5", other)
    said = finished_tiny.gst("export", str(finished_tiny.results), "--to", str(folder))
    shutil.rmtree(other.parent)
    assert said.returncode == 0, said.stderr
    assert said.stdout == f"{folder}: {len(list(folder.iterdir()))} files\n"
    return folder


def test_what_is_left_of_another_study_is_not_exported(exported):
    assert list(exported.glob(f"{PATCH}_*"))
    assert not list(exported.glob("99_*"))


def stored(results):
    """The maps of a patch, mm, as the study holds them."""
    before = read_dataset(results / f"surfaces/T0/1/{PATCH}_T0.h5")
    found = read_dataset(results / f"change/1/{PATCH}.h5")
    wear = read_dataset(results / f"wear/1/{PATCH}.h5").depth
    return {
        "T0": before.height.where(~before.filled),
        "T1": found.t1,
        "loss": -found.change,
        "predicted_archard": wear.sel(model="archard"),
        "predicted_archard_capped": wear.sel(model="archard_capped"),
    }


@pytest.mark.parametrize(
    "name", ["T0", "T1", "loss", "predicted_archard", "predicted_archard_capped"]
)
def test_two_libraries_read_the_lengths(finished_tiny, exported, name):
    expected = stored(finished_tiny.results)[name]
    dy, dx = spacing_of(expected)
    path = exported / f"{PATCH}_{name}.x3p"
    one = Surface.load(path)  # µm; it checks the checksum, too
    other = open_topography(str(path)).topography()
    assert (one.step_y, one.step_x) == pytest.approx((dy * 1e3, dx * 1e3))
    assert (other.unit, other.pixel_size) == ("m", pytest.approx((dx / 1e3, dy / 1e3)))
    heights = np.ma.filled(other.heights(), np.nan).T
    for read, unit in ((one.data, 1e3), (heights, 1e-3), (read_scan(path).values, 1.0)):
        np.testing.assert_allclose(read, expected.values * unit, atol=1e-12)  # NaN where NaN
    assert bool(expected.isnull().any()) == (name in ("T0", "T1", "loss"))


def test_the_tool_keeps_its_coordinates_and_shows_the_patches(finished_tiny, exported):
    results = finished_tiny.results
    tool = trimesh.load(exported / "tool.ply", process=False)
    read = tool.metadata["_ply_raw"]["vertex"]["data"]
    stone = trimesh.load(results / "specimen/mesh.stl")
    assert tool.bounds == pytest.approx(stone.bounds, abs=1e-5)
    face = read_dataset(results / "macroscale/surface.h5", only=FRAME)
    x, y, z = stored_frame(face).to_frame(tool.vertices).T
    above, element = abs(z) < 1, 0.125
    places = read_table(results / "tables/patch_pressures.csv")
    for number, place in enumerate(places.itertuples(), start=1):
        away = np.maximum(abs(x - place.x_mm), abs(y - place.y_mm))
        assert place.rotation_deg == 0
        is_patch = read["scalar_patch"] == number
        assert is_patch[above & (away < 0.425 - element)].all()
        assert not is_patch[away > 0.425 + element].any()
        assert is_patch.any()


def test_two_libraries_read_the_tool(exported):
    one = meshio.read(exported / "tool.ply")
    other = trimesh.load(exported / "tool.ply", process=False)
    read = other.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_array_equal(one.points, other.vertices)
    np.testing.assert_array_equal(one.cells_dict["triangle"], other.faces)
    assert set(one.point_data) == set(read.dtype.names) - set("xyz")
    for name, values in one.point_data.items():
        np.testing.assert_array_equal(values, read[name])


# What is done to a study, or to the folder to export into, and what is then refused by name.
def _edit(file, change):
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


def _reseal(study, name):
    """Let the page's record fit a file that was changed."""
    digest = sha256(study.results / name)
    page = study.results / "logs/write_page.json"
    _edit(page, lambda record: record["outputs"].update({name: digest}))


def _foreign_mesh(study):
    mesh = study.folder.parent / "private.stl"
    shutil.copy(study.results / "specimen/mesh.stl", mesh)
    inputs = {"mesh": str(mesh), "mesh_unit": "mm", "scan_folder": None}
    provenance = study.results / "provenance.json"
    _edit(provenance, lambda record: record["config"].update(inputs=inputs))
    _reseal(study, "provenance.json")


def _name_elsewhere(study):
    """The name of a model becomes part of the name of a file."""
    file = f"wear/1/{PATCH}.h5"
    dataset = read_dataset(study.results / file)
    models = [f"/../../../{model}" for model in dataset.model.values]
    write_dataset(study.results / file, dataset.assign_coords(model=models))
    for record in (study.results / "logs").glob("*.json"):
        for part in ("inputs", "outputs"):

            def renew(content, part=part):
                if file in content[part]:
                    content[part][file] = sha256(study.results / file)

            _edit(record, renew)


def _unrecorded(study):
    _edit(
        study.results / "logs/solve_macroscale.json",
        lambda record: record["outputs"].pop("macroscale/contact.h5"),
    )


HOSTILE = {
    "mesh": (_foreign_mesh, "private.stl"),
    "name": (_name_elsewhere, "outside the export"),
    "unrecorded": (_unrecorded, "contact.h5"),
    "file of the user": (lambda study: (study.folder / "to/tool.ply").touch(), "tool.ply"),
    "link": (lambda study: (study.folder / "to/a.x3p").symlink_to("../private"), "a.x3p"),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_only_what_the_records_have_is_exported_and_nothing_is_replaced(tiny, what):
    (tiny.folder / "to").mkdir()
    spoil, said = HOSTILE[what]
    spoil(tiny)
    outside = {file for file in tiny.folder.parent.rglob("*") if file.parent.name != "to"}
    before = {file: file.lstat().st_size for file in (tiny.folder / "to").iterdir()}
    result = tiny.gst("export", str(tiny.results), "--to", str(tiny.folder / "to"))
    assert result.returncode == 2
    assert said in result.stderr
    assert "Traceback" not in result.stderr
    assert {file: file.lstat().st_size for file in before} == before
    assert outside == {file for file in tiny.folder.parent.rglob("*") if file.parent.name != "to"}
