"""`gst export`: other programs' readers find in its files what the study holds."""

import json
import shutil

import meshio
import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from PIL import Image
from SurfaceTopography.IO import open_topography
from surfalize import Surface

from gstlib.io.files import sha256
from gstlib.io.scans import read_scan
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import read_table
from gstlib.surfaces.frames import FRAME, stored_frame
from gstlib.surfaces.grid import spacing_of

PATCH = "7"
STONE = 185, 178, 166


@pytest.fixture(scope="module")
def exported(finished_tiny, tmp_path_factory):
    folder = tmp_path_factory.mktemp("export")
    # left of another config, with more patches
    other = finished_tiny.results / "surfaces/T0/9/99_T0.h5"
    other.parent.mkdir()
    shutil.copy(finished_tiny.results / f"surfaces/T0/1/{PATCH}_T0.h5", other)
    finished_tiny.gst("export", finished_tiny.results, "--to", folder)
    shutil.rmtree(other.parent)
    assert not list(folder.glob("99_*"))
    return folder


def stored(results):
    """The maps of a patch, mm, as the study holds them."""
    before = read_dataset(results / f"surfaces/T0/1/{PATCH}_T0.h5")
    change = read_dataset(results / f"change/1/{PATCH}.h5")
    wear = read_dataset(results / f"wear/1/{PATCH}.h5").depth
    return {
        "T0": before.height.where(~before.filled),
        "T1": change.t1,
        "loss": -change.change,
        "detection_limit": change.level_of_detection,
        "predicted_archard_capped": wear.sel(model="archard_capped"),
    }


@pytest.mark.parametrize("name", ["T0", "T1", "loss", "predicted_archard_capped"])
def test_two_libraries_read_the_lengths(finished_tiny, exported, name):
    expected = stored(finished_tiny.results)[name]
    dy, dx = spacing_of(expected)
    path = exported / f"{PATCH}_{name}.x3p"
    one = Surface.load(path)  # µm; it checks the checksum, too
    other = open_topography(str(path)).topography()
    assert (one.step_y, one.step_x) == pytest.approx((dy * 1e3, dx * 1e3))
    assert other.unit == "m"
    assert other.pixel_size == pytest.approx((dx / 1e3, dy / 1e3))
    heights = np.ma.filled(other.heights(), np.nan).T
    values = expected.values  # NaN where NaN
    assert_allclose(one.data, values * 1e3, atol=1e-12)
    assert_allclose(heights, values * 1e-3, atol=1e-12)
    assert_allclose(read_scan(path).values, values, atol=1e-12)


@pytest.mark.parametrize(
    "name", ["loss", "detection_limit", "predicted_archard_capped"]
)
def test_the_grids_lie_where_the_patches_do(finished_tiny, exported, name):
    """In µm from the square's corner; the rows run from north to south."""
    results = finished_tiny.results
    expected = stored(results)[name]
    file = exported / f"{PATCH}_{name}.asc"
    lines = file.read_text().splitlines()
    head = {key.lower(): float(value) for key, value in map(str.split, lines[:6])}
    cells = np.loadtxt(lines[6:])[::-1]
    heights = np.where(cells == head["nodata_value"], np.nan, cells)
    assert head["cellsize"] == pytest.approx(1e3 * spacing_of(expected)[0])
    assert_placed(results, expected, heights, (head["xllcorner"], head["yllcorner"]))
    read = read_scan(file, unit="um")
    assert_allclose(read.values, 1e-3 * heights, rtol=1e-12)


def assert_placed(results, expected, heights, corner):
    """Heights and the lower left corner of a grid, µm, are those of the patch."""
    assert_allclose(1e-3 * heights, expected.values, rtol=1e-5, atol=1e-9)
    places = read_table(results / "tables/patch_pressures.csv").set_index("patch")
    side_mm = spacing_of(expected)[0] * len(expected)
    at = places.loc[PATCH, ["x_mm", "y_mm"]] - side_mm / 2
    assert corner == pytest.approx(tuple(1e3 * at))


@pytest.mark.slow
def test_a_gis_reads_the_grids(finished_tiny, exported):
    """Rasterio, which reads with GDAL as QGIS does, is in the environment of the checks."""
    rasterio = pytest.importorskip("rasterio", reason="make test-all installs it")
    results = finished_tiny.results
    with rasterio.open(exported / f"{PATCH}_loss.asc") as grid:
        heights = grid.read(1, masked=True).filled(np.nan)[::-1]
        corner = grid.bounds.left, grid.bounds.bottom
    assert_placed(results, stored(results)["loss"], heights, corner)


@pytest.mark.parametrize(
    ("name", "column"), [("pressure", "pressure_MPa"), ("loss", "loss_um")]
)
def test_the_tool_shows_its_colours_elsewhere(exported, name, column):
    """In m and linear colours, as GLB has them; beside them lies the scale."""
    (shown,) = trimesh.load(exported / f"tool_{name}.glb").geometry.values()
    tool = meshio.read(exported / "tool.ply")
    fields = tool.point_data
    assert shown.extents == pytest.approx(np.ptp(tool.points, axis=0) / 1e3, rel=1e-5)
    linear = shown.visual.vertex_attributes["color"][:, :3] / 255
    colours = 255 * trimesh.visual.color.linear_to_srgb(linear)
    step = 7  # half of one between the darkest linear colours
    highest = colours[fields[f"scalar_{column}"].argmax()]
    bar = np.asarray(Image.open(exported / f"tool_{name}.png").convert("RGB"))
    assert np.abs(bar - highest).max(axis=-1).min() < step
    is_stone = np.abs(colours - STONE).max(axis=1) < step
    assert is_stone[fields["scalar_patch"] == 0].all() == (name == "loss")
    assert not is_stone.all()


def test_the_methods_are_exported(exported):
    methods = (exported / "methods.txt").read_text("utf-8")
    assert "with 550 N" in methods
    assert "by Archard's law" in methods


def test_the_tool_keeps_its_coordinates_and_shows_pressure_and_patches(
    finished_tiny, exported
):
    results = finished_tiny.results
    tool = meshio.read(exported / "tool.ply")
    fields = tool.point_data
    mesh = trimesh.load(results / "specimen/mesh.stl")
    assert np.ptp(tool.points, axis=0) == pytest.approx(mesh.extents, abs=1e-5)
    face = read_dataset(results / "macroscale/surface.h5", only=FRAME)
    x, y, z = stored_frame(face).to_frame(tool.points).T
    is_above, element = abs(z) < 1, 0.125
    places = read_table(results / "tables/patch_pressures.csv")
    for number, place in enumerate(places.itertuples(), start=1):
        away = np.maximum(abs(x - place.x_mm), abs(y - place.y_mm))
        is_patch = fields["scalar_patch"] == number
        assert is_patch[is_above & (away < 0.425 - element)].all()
        assert not is_patch[away > 0.425 + element].any()
    pressure = fields["scalar_pressure_MPa"]
    contact = read_dataset(
        results / "macroscale/contact.h5", only=["pressure"]
    ).pressure
    assert pressure.max() == pytest.approx(float(contact.max()))
    assert (pressure[z < -2] == 0).all()


def _edit(file, change):
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


def _reseal(study, name):
    """Let the records fit a file that was changed."""
    digest = sha256(study.results / name)

    def renew(record):
        for part in ("inputs", "outputs"):
            if name in record[part]:
                record[part][name] = digest

    for record in (study.results / "logs").glob("*.json"):
        _edit(record, renew)


def _foreign_mesh(study):
    mesh = study.folder.parent / "private.stl"
    shutil.copy(study.results / "specimen/mesh.stl", mesh)
    inputs = {"mesh": str(mesh), "mesh_unit": "mm", "scan_folder": None}
    provenance = study.results / "provenance.json"
    _edit(provenance, lambda record: record["config"].update(inputs=inputs))
    _reseal(study, "provenance.json")


def _name_elsewhere(study):
    """The name of a model becomes part of the name of a file."""
    name = f"wear/1/{PATCH}.h5"
    dataset = read_dataset(study.results / name)
    models = [f"/../../../{model}" for model in dataset.model.values]
    write_dataset(study.results / name, dataset.assign_coords(model=models))
    _reseal(study, name)


# What is done to a study, or to the folder to export into, and what is then refused by name.
HOSTILE = {
    "private.stl": _foreign_mesh,
    "outside the export": _name_elsewhere,
    "tool.ply": lambda study: (study.folder / "to/tool.ply").symlink_to("../private"),
}


def files_in(folder):
    return {
        file: file.lstat().st_size for file in folder.rglob("*") if not file.is_dir()
    }


@pytest.mark.parametrize("problem", HOSTILE)
def test_only_what_the_records_have_is_exported_and_nothing_is_replaced(tiny, problem):
    target = tiny.folder / "to"
    target.mkdir()
    HOSTILE[problem](tiny)
    before = files_in(tiny.folder.parent)
    text = tiny.gst("export", tiny.results, "--to", target, code=2)
    assert problem in text
    assert "Traceback" not in text
    after = files_in(tiny.folder.parent)
    assert before.items() <= after.items()
    assert all(target in file.parents for file in after.keys() - before.keys())
