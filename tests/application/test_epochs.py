"""Faults of T1 that do not match their T0: all at once, with how they would match."""

import numpy as np
import pandas as pd
import pytest

from gst.check.epochs import UNMATCHED, epochs_on_each_other
from gst.config.reading import complete
from gstlib import self_affine_field
from gstlib.preprocess.scans import prepare_scan
from gstlib.specimen.randomness import smooth_field
from gstlib.study import Study
from gstlib.surfaces.filtering import low_pass
from gstlib.surfaces.grid import make_surface

COUNT, SPACING, PATCHES = 64, 0.01, "ab"


def noisy(heights):
    return heights + 1e-5 * np.random.default_rng(1).standard_normal(heights.shape)


def surface(seed, columns=COUNT):
    """Heights of 2 µm with waves of a tenth of a millimetre."""
    waves = smooth_field(np.random.default_rng(seed), columns, SPACING, 0.1)[:COUNT]
    return 2e-3 * np.asarray(waves, dtype=float)


BEFORE = {patch: surface(seed) for seed, patch in enumerate(PATCHES)}


def check(after=(), before=(), spacing=SPACING):
    """The faults of patches, of which some scans are other ones than usual."""
    before = BEFORE | dict(before)
    worn = {patch: noisy(heights) for patch, heights in (before | dict(after)).items()}
    scans = {"T0": before, "T1": worn}

    class Prepared(Study):
        def prepare(self, patch, epoch):
            return prepare_scan(make_surface(scans[epoch][patch], spacing))

    table = pd.DataFrame({"patch": [*PATCHES], "t0": ["a_t0", "b_t0"], "repeat": ""})
    table = table.assign(x_mm=1.0, y_mm=1.0, rotation_deg=0.0, t1=["a_t1", "b_t1"])
    config = complete({"scans": {"mould": {"invert": False}}}) | {"use": None}
    study = Prepared(config, table, read_mesh=lambda: None, read_scan=lambda *_: None)
    faults, _ = epochs_on_each_other(study)
    return faults


@pytest.mark.parametrize(
    ("lay", "how"),
    [
        (lambda h: -h[:, ::-1], "inverted and reversed along x"),
        (np.rot90, "turned by -90°"),  # in the file, which is flipped since
    ],
)
def test_t1_that_were_all_scanned_otherwise_are_one_fault(lay, how):
    (fault,) = check({patch: lay(heights) for patch, heights in BEFORE.items()})
    assert (fault.name, fault.patches) == (UNMATCHED, tuple(PATCHES))
    assert fault.problem.endswith(f" only {how}")


def test_t1_that_match_nothing_are_one_fault_only_if_none_matches(caplog):
    unlike = dict.fromkeys(PATCHES, surface(99))
    (fault,) = check(unlike)
    assert (fault.name, fault.patches) == (UNMATCHED, ())
    assert caplog.text.count("not found") == 0
    assert check({"b": unlike["b"]}) == []
    assert caplog.text.count("not found") == 1


def test_a_t1_between_two_patches_is_no_mistake_of_names(caplog):
    waves = surface(7, 3 * COUNT)
    before = {"a": waves[:, :COUNT], "b": waves[:, 80 : 80 + COUNT]}
    assert check({"a": waves[:, 52 : 52 + COUNT]}, before) == []
    assert caplog.text.count("not found") == 1
    # if it shows most of the other patch, it is one
    (fault,) = check({"a": waves[:, 72 : 72 + COUNT]}, before)
    assert fault.patches == ("a",)


def rough(seed, spacing):
    """Heights (mm) of a self-affine surface without waves that are longer than it."""
    heights = self_affine_field(
        np.random.default_rng(seed), 128, spacing, hurst_exponent=0.8, roll_off=0.85
    )
    return noisy(3e-3 * heights / heights.std())


@pytest.mark.parametrize(
    ("epoch", "length_mm"), [("T0", 0.06), ("T1", 0.06), ("T1", 0.25)]
)
def test_a_scan_without_its_long_waves_is_told_as_such(caplog, epoch, length_mm):
    """It fits in the short ones alone, where its dales are as deep."""
    spacing = 0.85 / 128
    before = {patch: rough(seed, spacing) for seed, patch in enumerate(PATCHES)}
    after = {}
    for patch, heights in before.items():  # worn
        upper = np.quantile(heights, 0.7)
        after[patch] = np.minimum(heights, (heights + upper) / 2)
    assert check(after, before, spacing) == []
    scans = before if epoch == "T0" else after
    scans["b"] = scans["b"] - low_pass(scans["b"], (spacing, spacing), length_mm)
    faults = check(after, before, spacing)
    assert all(fault.source.startswith(f"b_{epoch.lower()}") for fault in faults)
    # a warning, if it is found all the same
    warnings = sum("form had been" in text for text in caplog.messages)
    assert len(faults) + warnings == 1
