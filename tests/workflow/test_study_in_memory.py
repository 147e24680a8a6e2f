"""`gstlib.study.Study` on the tiny study's files: every setting counts.

That the workflow passes on what the config says, and nothing else: test_measured.py. What the
library makes of it is tested with the library.
"""

import numpy as np
import pytest
from conftest import in_memory
from gst.sweep import merged, outcomes


@pytest.fixture(scope="module")
def own(finished_tiny):
    return in_memory(finished_tiny)


@pytest.mark.parametrize(
    ("changes", "moved"),
    [
        ({"material": {"contact_modulus_MPa": None}}, "mean(mcc)"),
        ({"macroscale": {"grid": 30}}, "pressure_MPa"),
        ({"coupling": "levelled"}, "pressure_MPa"),
        ({"microscale": {"s_filter_um": 50.0}}, "mean(mcc)"),
        ({"preprocessing": {"outlier_rule": "window"}}, "mean(mcc)"),
        ({"traces": {"minimum_points": 6}}, "mean(mcc)"),
        ({"texture": {"l_filter_um": 150.0}}, "mean_change(Sq_um)"),
    ],
)
def test_a_changed_value_moves_the_outcomes(own, finished_tiny, config, changes, moved):
    before, after = map(outcomes, (own, in_memory(finished_tiny, merged(config, changes))))
    one, other = (t.result[t.output == moved].to_numpy() for t in (before, after))
    assert not np.allclose(one, other, rtol=1e-4)
