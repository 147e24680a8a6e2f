"""Before anything is scanned: a tiny study of a mesh alone, and one of the proposed places."""

import re

import numpy as np
import pandas as pd
import pytest

from gstlib.coupling.pressures import patch_pressures
from gstlib.io.store import read_dataset
from gstlib.io.tables import read_table
from gstlib.surfaces.footprints import square_of

from .conftest import fresh
from .expected import assert_as_expected

GESTURE = {"load_point_scatter_mm": 0.5, "poses": 6}


@pytest.fixture(scope="module")
def where(tmp_path_factory):
    study = fresh(tmp_path_factory.mktemp("mesh_only"))
    study.change(results="results-where", patches=None, gesture=GESTURE)
    study.run()
    return study


def test_the_study_is_as_expected_without_what_needs_scans(where):
    assert_as_expected(where.results, "where")
    tables = {"inputs.csv", "gridding.csv", "macroscale_path.csv", "places.csv"}
    assert set(where.tables()) == tables
    assert where.planned() == set()


def test_the_proposed_places_are_a_patch_table_as_expected(where):
    """The specimen's scans are taken there; the places proposed as exposed bear the load."""
    where.change(
        results="results-then", patches="results-where/tables/places.csv", use=None
    )
    names = "registration", "patch_intervals", "patch_pressures"
    where.run(*(f"results-then/tables/{name}.csv" for name in names))
    pressures = read_table(where.results / "tables/patch_pressures.csv")
    forces = pressures.set_index("patch").force_N
    assert forces["E1"] > 0
    assert forces.filter(regex="^C").sum() < 0.05 * forces.sum()
    assert_as_expected(where.results, "then", "patch_intervals", "patch_pressures")


def test_grades_of_wear_tell_how_a_tool_was_used_as_expected(where, tmp_path_factory):
    """Grades that the contact at a point gives; the study is told another one."""
    study = fresh(tmp_path_factory.mktemp("artefact"))
    stored = where.folder / "results-where/macroscale/contact.h5"  # whatever ran before
    square = square_of(read_dataset(stored).pressure, 5.0)
    y, x = np.mgrid[0.5:5, 0.5:5]
    places = {"patch": np.arange(25), "x_mm": x.ravel(), "y_mm": y.ravel()}
    places = pd.DataFrame(places | {"rotation_deg": 0.0})
    pressures = patch_pressures(square, places, size_mm=0.85).pressure_MPa
    places["wear_grade"] = np.searchsorted([0.5, 20, 60], pressures)
    places.to_csv(study.folder / "config/grades.csv", index=False)
    load = {"force_N": 550.0, "at_mm": [3.4, 1.8]}
    use = {"draws": 60, "rounds": 10}
    study.change(patches="config/grades.csv", gesture=GESTURE, load=load, use=use)
    study.run()
    assert_as_expected(study.results, "grades", "use")
    page = (study.results / "index.html").read_text("utf-8")
    on_map = re.findall(r"<title>Patch (\d+): grade (\d)</title>", page)
    assert [tuple(map(int, one)) for one in on_map] == list(
        enumerate(places.wear_grade)
    )
    table = read_table(study.results / "tables/use.csv").set_index("parameter")
    axes = ["load_point_x", "load_point_y"]
    assert list(table.prior[axes]) == load["at_mm"]
    contact = read_dataset(study.results / "macroscale/contact.h5")
    pressed_at = table["posterior_mean"] if table.adopted.iloc[0] else table.prior
    point = float(contact.load_point_x), float(contact.load_point_y)
    assert point == pytest.approx(tuple(pressed_at[axes]), rel=1e-4)
