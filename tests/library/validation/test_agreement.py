"""Scores of masks by hand and against brute force, and what each convention means."""

import math

import numpy as np
import pytest
from gstlib.validation.masks import mask_counts, mask_scores
from hypothesis import given, settings
from hypothesis.extra.numpy import arrays

masks = arrays(bool, (4, 5))


def scores(predicted, observed, valid=None):
    valid = np.ones(observed.shape, dtype=bool) if valid is None else valid
    found = mask_scores(*mask_counts(predicted, observed, valid))
    return {name: float(value) for name, value in found.items()}


def test_scores_by_hand():
    predicted = np.array([[1, 1, 1, 0, 0, 0, 0, 1]], dtype=bool)
    observed = np.array([[1, 1, 0, 1, 1, 0, 0, 1]], dtype=bool)
    valid = np.array([[1, 1, 1, 1, 1, 1, 1, 0]], dtype=bool)
    expected = {"precision": 2 / 3, "recall": 2 / 4, "f1": 4 / 7}
    expected["mcc"] = (2 * 2 - 1 * 2) / math.sqrt(3 * 4 * 3 * 4)
    # three points in four of seven: all of them could be right
    expected["attainable_mcc"] = (3 * 3) / math.sqrt(3 * 4 * 4 * 3)
    assert scores(predicted, observed, valid) == pytest.approx(expected)


@settings(deadline=None)
@given(masks, masks, masks)
def test_mcc_is_the_correlation_of_the_masks_and_no_mask_of_its_area_does_better(
    predicted, observed, valid
):
    p, o = predicted[valid], observed[valid]
    found = scores(predicted, observed, valid)
    if not 0 < o.sum() < o.size:
        assert math.isnan(found["mcc"])
        return
    if 0 < p.sum() < p.size:
        assert found["mcc"] == pytest.approx(np.corrcoef(p, o)[0, 1])
        order = np.argsort(~o, kind="stable")  # as many points, those that did wear first
        best = np.zeros(p.shape, dtype=bool)
        best[order[: p.sum()]] = True
        assert found["attainable_mcc"] == pytest.approx(np.corrcoef(best, o)[0, 1])
        assert found["mcc"] <= found["attainable_mcc"] + 1e-12
    else:
        assert found["mcc"] == 0
