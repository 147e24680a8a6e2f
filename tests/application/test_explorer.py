"""The draws that a page takes for its explorer."""

import json

import numpy as np
import pandas as pd
import xarray as xr
from in_memory import InMemory

from gst.page.load_points import draws_to_explore
from gstlib.conditions import Law


def study_of(*, draws=2000, patches=3, adopted=1, graded=False):
    """A study with made-up draws; and the draws."""
    generator = np.random.default_rng(0)
    x, y = generator.uniform(0, 5, (2, draws))
    columns = {"x_mm": x, "y_mm": y, "weight": np.full(draws, 1 / draws)}
    if not graded:
        columns["wear_coefficient"] = generator.uniform(0.005, 0.01, draws)
    variables = {name: ("draw", each) for name, each in columns.items()}
    pressure = generator.uniform(0, 90, (patches, draws))
    variables["pressure"] = ("patch", "draw"), pressure
    numbers = np.arange(patches)
    names = [f"P{number}" for number in numbers]
    use = xr.Dataset(variables, {"patch": names}, {"adopted": adopted})
    losses = pd.DataFrame({"patch": names, "loss_um": numbers / 10})
    files = {"use.h5": use, "predicted_losses": losses}
    places = {"patch": names, "wear_grade": numbers}
    return InMemory(files, places=places, patch_mm=0.8), use


def test_the_numbers_are_those_of_the_draws():
    study, use = study_of()
    taken = draws_to_explore(study, {"threshold_MPa": 0.0, "exponent": 2.0})
    assert taken["measured"] == [0.0, 0.1, 0.2]
    assert taken["near_mm"] == 0.4
    np.testing.assert_allclose(taken["x_mm"], use.x_mm, atol=1e-3)
    pressure = use.pressure.values.T
    equivalent = Law(exponent=2.0).equivalent(pressure)
    loss = use.wear_coefficient.values[:, np.newaxis] * equivalent
    # half a digit
    np.testing.assert_allclose(taken["pressure"], pressure, rtol=0, atol=0.0051)
    np.testing.assert_allclose(taken["loss"], loss, rtol=0, atol=0.00051)


def test_many_patches_take_fewer_draws_evenly():
    study, use = study_of(patches=60)
    taken = draws_to_explore(study, {})
    assert len(json.dumps(taken)) < 300_000
    np.testing.assert_allclose(taken["x_mm"], use.x_mm[::6], atol=1e-3)
    assert np.shape(taken["loss"]) == (len(taken["x_mm"]), 60)


def test_grades_stand_in_place_of_losses():
    study, _ = study_of(graded=True)
    taken = draws_to_explore(study, {})
    assert taken["measured"] == [0, 1, 2]
    assert "loss" not in taken


def test_a_use_that_the_study_does_not_adopt_is_not_explored():
    study, _ = study_of(adopted=0)
    assert draws_to_explore(study, {}) is None
    assert draws_to_explore(InMemory({}), {}) is None
