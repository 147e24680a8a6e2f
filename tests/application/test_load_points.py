"""Load points on the map, and whether the truth lies where the study says."""

import numpy as np
import pytest
import xarray as xr
from contacts import written
from in_memory import InMemory

from gst.page.load_points import load_points, truth_met

MIDDLE, SPREAD = np.array([2.0, 3.0]), np.array([[0.09, 0.03], [0.03, 0.04]])
WIDE = 0.3  # variance of the draws before they are weighed
HEADINGS = "stage,quantity,patch,unit,true,recovered,error\n"


def drawn(*, adopted=1, count=20_000):
    """A use whose draws are spread wide, and whose weights make them the wanted ones."""
    generator = np.random.default_rng(0)
    x, y = generator.multivariate_normal(MIDDLE, WIDE * np.eye(2), count).T
    off = np.stack([x, y], axis=1) - MIDDLE
    away = np.linalg.inv(SPREAD) - np.eye(2) / WIDE
    weight = np.exp(-np.einsum("ki,ij,kj->k", off, away, off) / 2)
    columns = {"x_mm": x, "y_mm": y, "weight": weight / weight.sum()}
    use = xr.Dataset({name: ("draw", each) for name, each in columns.items()})
    return {"use.h5": use.assign_attrs(adopted=adopted)}


def test_the_region_holds_95_percent_of_the_draws_by_weight():
    found = load_points(InMemory(drawn()), (2.5, 2.5))
    assert found["points"]["inferred"] == pytest.approx(MIDDLE, abs=0.03)
    assert found["points"]["given"] == [2.5, 2.5]
    long, short, turn = found["region"]
    # of a normal distribution, 5.99 is the 95 % quantile of the squared distance
    values, axes = np.linalg.eigh(SPREAD)
    assert [short, long] == pytest.approx(np.sqrt(5.99 * values), rel=0.07)
    wanted = np.degrees(np.arctan2(*axes[::-1, 1]))
    assert (turn - wanted + 90) % 180 - 90 == pytest.approx(0, abs=4)


def test_points_inside_and_outside_the_region():
    rows = "use,load_point_x,,mm,2.1,2,0\nuse,load_point_y,,mm,3.1,3,0\n"
    study = InMemory(drawn() | {"truth": written(HEADINGS + rows)})
    found = load_points(study, (2.0, 3.0))  # y, x
    assert found["points"]["given"] == [3.0, 2.0]
    assert found["points"]["true"] == [2.1, 3.1]
    assert found["held"] == {"given": False, "true": True}


@pytest.mark.parametrize("files", [drawn(adopted=0), {}])
def test_a_use_that_is_not_adopted_has_no_region(files):
    nothing = {"points": {}, "region": None, "held": {}}
    assert load_points(InMemory(files), None) == nothing


def test_true_values_are_counted_that_lie_within_their_intervals():
    radius = f"{HEADINGS}use,radius,,mm,170,150,-20\n"
    others = """coupling,pressure,a,MPa,5,6,1
coupling,pressure,b,MPa,5,9,4
wear,mean_depth,a,um,5,9,4"""
    tables = {
        "truth": written(radius + others),
        "patch_intervals": written(
            "patch,pressure_MPa,low_MPa,high_MPa\na,6,4,7\nb,9,8,11\n"
        ),
        "use": written("parameter,low,high\nload_point_x,1,2\nradius,120,180\n"),
    }
    met = {"load point": (0, 1), "pressure": (1, 2), "radius": (1, 1)}
    assert truth_met(InMemory(tables), {"true": False}) == met
    assert truth_met(InMemory({}), {}) == {}
    del met["load point"]
    assert truth_met(InMemory(tables), {}) == met
    # without a reference contact
    tables["truth"] = written(radius)
    del met["pressure"]
    assert truth_met(InMemory(tables), {}) == met
