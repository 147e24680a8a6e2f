"""Scans whose long waves a filter removed are told as such."""

import numpy as np
import pandas as pd
import pytest
from gst.check.epochs import epochs_on_each_other
from gst.config.reading import complete
from gstlib.errors import FaultError
from gstlib.preprocess.scans import prepare_scan
from gstlib.study import Study
from gstlib.surfaces.filtering import low_pass
from gstlib.surfaces.grid import make_surface

POINTS, SPACING = 128, 0.85 / 128


def rough(seed):
    """Heights (mm) of a self-affine surface without waves that are longer than it."""
    count = 2 * POINTS
    waves = np.hypot(*np.meshgrid(*2 * [np.fft.fftfreq(count)], indexing="ij"))
    white = np.fft.fft2(np.random.default_rng(seed).normal(size=2 * (count,)))
    heights = np.fft.ifft2(white / np.maximum(waves, 2 / count) ** 1.8).real[:POINTS, :POINTS]
    return 3e-3 * (heights - heights.mean()) / heights.std()


def noise(seed):
    return 2e-5 * np.random.default_rng(seed).normal(size=2 * (POINTS,))


def worn(heights):
    upper = np.quantile(heights, 0.7)
    return np.minimum(heights, upper + 0.5 * (heights - upper).clip(0))


def without_waves(heights, length_um):
    return heights - low_pass(heights, 2 * (SPACING,), length_um * 1e-3)


BEFORE = [rough(seed) + noise(10 + seed) for seed in range(2)]
AFTER = [worn(rough(seed)) + noise(20 + seed) for seed in range(2)]


def problems_of(before, after):
    scans = {
        (str(patch), epoch): make_surface(heights, SPACING)
        for epoch, maps in (("T0", before), ("T1", after))
        for patch, heights in enumerate(maps)
    }
    names = [str(patch) for patch in range(len(before))]
    rows = {"patch": names, "x_mm": 1.0, "y_mm": 1.0, "rotation_deg": 0.0, "repeat": ""}
    files = {epoch.lower(): [f"{name}_{epoch}.plu" for name in names] for epoch in ("T0", "T1")}

    class Coarse(Study):
        def prepare(self, patch, epoch):
            return prepare_scan(scans[patch, epoch])

    config = complete({}) | {"use": None, "traces": {"minimum_points": 8}}
    study = Coarse(
        config, pd.DataFrame(rows | files), read_mesh=lambda: None, read_scan=lambda *of: None
    )
    return epochs_on_each_other(study)[0]


def test_sound_scans_have_no_problem():
    assert problems_of(BEFORE, AFTER) == []


@pytest.mark.parametrize("length_um", [60, 80, 150, 250])
@pytest.mark.parametrize("epoch", ["T0", "T1"])
def test_a_scan_without_its_long_waves_is_told_as_such(caplog, length_um, epoch):
    """It fits in the short ones alone, where its dales are as deep."""
    before, after = BEFORE, AFTER
    if epoch == "T0":
        before = [without_waves(heights, length_um) for heights in before]
    else:
        after = [without_waves(heights, length_um) for heights in after]
    found = problems_of(before, after)
    for problem in found:
        assert isinstance(problem, FaultError)
        assert f"_{epoch}.plu" in problem.source
        assert "filter" in problem.problem
    # a warning, if it is found all the same
    told = sum("form had been" in text or "filter" in text for text in caplog.messages)
    assert len(found) + told == 2
