"""Before anything is scanned: a tiny study of a mesh alone, and one of the proposed places."""

import lxml.html
import numpy as np
import pandas as pd
import pytest
import trimesh
import xarray as xr
from gstlib.coupling.pressures import patch_pressures
from gstlib.io.meshes import read_mesh
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.surfaces.footprints import square_of
from gstlib.surfaces.frames import FRAME, stored_frame

from .conftest import fresh
from .expected import assert_as_expected

GESTURE = {"load_point_scatter_mm": 0.5, "poses": 6}


@pytest.fixture(scope="module")
def where(tmp_path_factory):
    study = fresh(tmp_path_factory.mktemp("mesh_only"))
    study.change(results="results-where", patches=None, gesture=GESTURE)
    study.succeed()
    return study


def test_the_study_is_as_expected(where):
    assert_as_expected(where.results, "where")


def test_what_needs_scans_is_left_out(where):
    tables = {"inputs", "gridding", "macroscale_path", "places"}
    assert {name.removesuffix(".csv") for name in where.tables()} == tables
    assert not list(where.results.glob("specimen/scans/*"))
    assert where.planned() == set()


def test_places_hold_the_exposure_of_their_footprints(where):
    places = read_table(where.results / "tables/places.csv")
    found = read_dataset(where.results / "gesture/exposure.h5", only=["exposure", "touched"])
    for place in places.itertuples():
        # whole elements well inside, and all that the place reaches
        inner, outer = (
            found.where(
                (abs(found.x - place.x_mm) < half) & (abs(found.y - place.y_mm) < half), drop=True
            )
            for half in (0.3, 0.5)
        )
        low, high = (float(of.exposure.sum()) * 0.125**2 / 0.85**2 for of in (inner, outer))
        assert low <= place.exposure_N_per_mm * (1 + 1e-4) <= high * (1 + 1e-3) + 1e-9
        assert float(inner.touched.max()) <= place.touched + 1e-4
    assert (places.touched[places.kind == "control"] == 0).all()
    assert places.exposure_N_per_mm[0] > 5 * places.exposure_N_per_mm[7]


def test_the_tool_keeps_its_coordinates_and_has_the_fields(where):
    tool = trimesh.load(where.results / "tool.ply", process=False)
    read = tool.metadata["_ply_raw"]["vertex"]["data"]
    mesh = read_mesh(where.results / "specimen/mesh.stl", unit="mm")
    points = np.column_stack([read[axis] for axis in "xyz"])
    ours = {tuple(point) for point in points}
    assert all(tuple(vertex) in ours for vertex in mesh.vertices.astype(np.float32))
    contact = read_dataset(where.results / "macroscale/contact.h5", only=["pressure"])
    gesture = read_dataset(where.results / "gesture/exposure.h5", only=["exposure"])
    frame = stored_frame(read_dataset(where.results / "macroscale/surface.h5", only=FRAME))
    x, y, z = frame.to_frame(points).T
    middle = (abs(x - 2.5) < 4) & (abs(y - 2.5) < 4) & (abs(z) < 1)
    at = {axis: xr.DataArray(of[middle], dims="p") for axis, of in (("x", x), ("y", y))}
    fields = {"pressure_MPa": contact.pressure, "exposure_N_per_mm": gesture.exposure}
    for name, field in fields.items():
        expected = field.sel(at, method="nearest").values
        same = np.isclose(read[f"scalar_{name}"][middle], expected, rtol=1e-5)
        assert same.mean() > 0.99  # on the line between two elements, either is right
        assert read[f"scalar_{name}"].max() > 0
        assert (read[f"scalar_{name}"][z < -2] == 0).all()


def test_the_page_says_where_to_scan(where):
    page = (where.results / "index.html").read_text(encoding="utf-8")
    assert page.index("Scan E1") < page.index('id="viewer"') < page.index("Where to scan</h2>")
    (listed,) = lxml.html.fromstring(page).xpath('//table[@id="patch-table"]')
    _, *rows = [[cell.text_content().strip() for cell in row] for row in listed.iter("tr")]
    places = read_table(where.results / "tables/places.csv")
    for shown, place in zip(rows, places.itertuples(), strict=True):
        assert shown[:2] == [place.place, place.kind]
        values = place.x_mm, place.y_mm, place.exposure_N_per_mm, 100 * place.touched
        assert [float(cell) for cell in shown[2:]] == pytest.approx(values, rel=6e-3)
    assert (where.results / "figures/places.pdf").read_bytes().startswith(b"%PDF")


def test_check_says_what_will_be_proposed(where):
    checked = where.gst("check", where.config)
    assert checked.returncode == 0, checked.stderr
    assert "8 places of 0.85 mm" in checked.stdout


def test_the_proposed_places_are_a_patch_table_as_expected(where):
    """The specimen's scans are taken there; what was proposed as exposed bears the load."""
    where.change(results="results-then", patches="results-where/tables/places.csv", use=None)
    tables = [f"results-then/tables/{name}.csv" for name in ("registration", "patch_intervals")]
    where.succeed("results-then/tables/patch_pressures.csv", *tables)
    pressures = read_table(where.results / "tables/patch_pressures.csv").set_index("patch")
    assert pressures.force_N["E1"] > 0
    assert pressures.force_N.filter(regex="^C").sum() < 0.05 * pressures.force_N.sum()
    assert (where.results / "specimen/scans/E1_T1.plu").exists()
    assert_as_expected(where.results, "then", "patch_intervals", "patch_pressures")


def test_grades_of_wear_tell_how_a_tool_was_used_as_expected(where, tmp_path_factory):
    """Grades that the contact at a point gives; the study is told another one."""
    study = fresh(tmp_path_factory.mktemp("artefact"))
    stored = where.folder / "results-where/macroscale/contact.h5"  # whatever ran before
    square = square_of(read_dataset(stored).pressure, 5.0)
    y, x = np.meshgrid(*2 * [np.arange(0.5, 5.0, 1.0)], indexing="ij")
    places = pd.DataFrame({"patch": np.arange(25), "x_mm": x.ravel(), "y_mm": y.ravel()})
    places = places.assign(rotation_deg=0.0)
    pressed = patch_pressures(square, places, size_mm=0.85).pressure_MPa
    places["wear_grade"] = np.searchsorted([0.5, 20, 60], pressed)
    places.to_csv(study.folder / "config/grades.csv", index=False)
    used = {"draws": 60, "rounds": 10}
    told = {"force_N": 550.0, "at_mm": [3.4, 1.8]}
    study.change(patches="config/grades.csv", gesture=GESTURE, load=told, use=used)
    assert study.gst("check", study.config).returncode == 0
    study.succeed()
    table = read_table(study.results / "tables/use.csv").set_index("parameter")
    assert table.effective_sample_size.iloc[0] >= 40
    assert_as_expected(study.results, "grades", "use")
    for name, stated in zip(("load_point_x", "load_point_y"), told["at_mm"], strict=True):
        assert table.prior[name] == stated
        assert table.high[name] - table.low[name] < 2 * 1.96 * table.stated_error[name]
    assert not table.posterior_mean_without_curvature["load_point_x":"radius"].isna().any()
    contact = read_dataset(study.results / "macroscale/contact.h5")
    pressed_at = table["posterior_mean"] if table.adopted.iloc[0] else table.prior
    point = float(contact.load_point_x), float(contact.load_point_y)
    assert point == pytest.approx(tuple(pressed_at[["load_point_x", "load_point_y"]]), rel=1e-4)


def test_grades_without_a_gesture_are_refused(study):
    study.change(patches="config/patches_artefact.tsv", gesture=None)
    said = study.gst("check", study.config)
    assert said.returncode != 0
    assert "grades of wear" in said.stdout + said.stderr
