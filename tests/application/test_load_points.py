"""Load points on the map, and whether the truth lies where the study says."""

import numpy as np
import pytest
import xarray as xr

from gst.page.load_points import load_points, truth_met
from gst.page.results import Results
from gstlib.io.store import write_dataset

MIDDLE, SPREAD = np.array([2.0, 3.0]), np.array([[0.09, 0.03], [0.03, 0.04]])
WIDE = 0.3  # variance of the draws before they are weighed
HEADINGS = "stage,quantity,patch,unit,true,recovered,error\n"


def drawn(folder, *, adopted=1, count=20_000):
    """A use whose draws are spread wide, and whose weights make them the wanted ones."""
    generator = np.random.default_rng(0)
    x, y = generator.multivariate_normal(MIDDLE, WIDE * np.eye(2), count).T
    off = np.stack([x, y], axis=1) - MIDDLE
    away = np.linalg.inv(SPREAD) - np.eye(2) / WIDE
    weight = np.exp(-np.einsum("ki,ij,kj->k", off, away, off) / 2)
    columns = {"x_mm": x, "y_mm": y, "weight": weight / weight.sum()}
    about = {"units": "mm", "long_name": "of a test"}
    use = xr.Dataset({name: ("draw", each, about) for name, each in columns.items()})
    file = folder / "use.h5"
    write_dataset(file, use.assign_attrs(adopted=adopted, answer="pressed"))
    return file


def test_the_region_holds_95_percent_of_the_draws_by_weight(tmp_path):
    study = Results({"use": drawn(tmp_path)})
    found = load_points(study, (2.5, 2.5))
    assert found["points"]["inferred"] == pytest.approx(MIDDLE, abs=0.03)
    assert found["points"]["given"] == [2.5, 2.5]
    long, short, turn = found["region"]
    # of a normal distribution, 5.99 is the 95 % quantile of the squared distance
    values, axes = np.linalg.eigh(SPREAD)
    assert [short, long] == pytest.approx(np.sqrt(5.99 * values), rel=0.07)
    wanted = np.degrees(np.arctan2(*axes[::-1, 1]))
    assert (turn - wanted + 90) % 180 - 90 == pytest.approx(0, abs=4)


def test_points_inside_and_outside_the_region(tmp_path):
    truth = tmp_path / "truth.csv"
    rows = "use,load_point_x,,mm,2.1,2,0\nuse,load_point_y,,mm,3.1,3,0\n"
    truth.write_text(HEADINGS + rows)
    study = Results({"use": drawn(tmp_path), "truth.csv": truth})
    found = load_points(study, (2.0, 3.0))  # y, x
    assert found["points"]["given"] == [3.0, 2.0]
    assert found["points"]["true"] == [2.1, 3.1]
    assert found["held"] == {"given": False, "true": True}


def test_a_use_that_is_not_adopted_has_no_region(tmp_path):
    study = Results({"use": drawn(tmp_path, adopted=0)})
    nothing = {"points": {}, "region": None, "held": {}}
    assert load_points(study, None) == nothing
    assert load_points(Results({}), None) == nothing


def test_true_values_are_counted_that_lie_within_their_intervals(tmp_path):
    radius = f"{HEADINGS}use,radius,,mm,170,150,-20\n"
    others = """coupling,pressure,a,MPa,5,6,1
coupling,pressure,b,MPa,5,9,4
wear,mean_depth,a,um,5,9,4"""
    files = {
        "truth.csv": radius + others,
        "patch_intervals.csv": "patch,pressure_MPa,low_MPa,high_MPa\na,6,4,7\nb,9,8,11\n",
        "use.csv": "parameter,low,high\nload_point_x,1,2\nradius,120,180\n",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    study = Results({name: tmp_path / name for name in files})
    met = {"load point": (0, 1), "pressure": (1, 2), "radius": (1, 1)}
    assert truth_met(study, {"true": False}) == met
    assert truth_met(Results({}), {}) == {}
    del met["load point"]
    assert truth_met(study, {}) == met
    # without a reference contact
    (tmp_path / "truth.csv").write_text(radius)
    del met["pressure"]
    assert truth_met(study, {}) == met
