"""Scores of masks by hand and against brute force, and what each convention means."""

import numpy as np
import pytest

from gstlib.validation.masks import mask_counts, mask_scores


def test_mcc_is_the_correlation_of_the_masks_and_no_mask_of_its_area_does_better():
    rng = np.random.default_rng(1)
    for share in rng.random(60).round(1):
        p, o = rng.random((2, 20)) < [[share], [0.4]]
        scores = mask_scores(*mask_counts(p, o))
        assert scores["f1"] == pytest.approx(2 * (p & o).sum() / (p.sum() + o.sum()))
        assert scores["recall"] == pytest.approx(p[o].mean())
        if 0 < p.sum() < p.size:
            assert scores["mcc"] == pytest.approx(np.corrcoef(p, o)[0, 1])
            best = np.zeros(p.size, dtype=bool)
            best[np.argsort(~o)[: p.sum()]] = True  # those that did wear first
            assert scores["attainable_mcc"] == pytest.approx(np.corrcoef(best, o)[0, 1])
        else:
            assert scores["mcc"] == 0
    assert np.isnan(mask_scores(*mask_counts(p, o & False))["mcc"])
