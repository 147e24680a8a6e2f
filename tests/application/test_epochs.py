"""Faults of T1 that do not match their T0: all at once, with how they would match."""

import numpy as np
import pandas as pd
import pytest
from gst.check.epochs import UNMATCHED, epochs_on_each_other
from gst.config.reading import complete
from gstlib.specimen.randomness import smooth_field
from gstlib.study import Study
from gstlib.surfaces.grid import make_surface

COUNT, SPACING, PATCHES = 64, 0.01, ["a", "b", "c"]


def surface(seed):
    """Heights of 2 µm with waves of a tenth of a millimetre."""
    waves = smooth_field(np.random.default_rng(seed), COUNT, SPACING, 0.1)
    return 2e-3 * np.asarray(waves, dtype=float)


def check(laid, before=()):
    """What is wrong with patches whose T1 are their T0 as `laid` lays them."""
    scans = {}
    for seed, patch in enumerate(PATCHES):
        noise = 1e-5 * np.random.default_rng(10 + seed).standard_normal((COUNT, COUNT))
        t0 = dict(before).get(patch, surface(seed))
        scans[patch, "T0"] = t0
        scans[patch, "T1"] = laid.get(patch, lambda heights: heights)(t0) + noise
    config = complete({"scans": {"size_mm": COUNT * SPACING, "mould": {"invert": False}}})
    table = pd.DataFrame({"patch": PATCHES, "x_mm": 1.0, "y_mm": [1.0, 2.0, 3.0]})
    table = table.assign(
        crop_x_mm=np.nan,
        crop_y_mm=np.nan,
        rotation_deg=0.0,
        t0=table.patch + "_T0",
        t1=table.patch + "_T1",
    )
    study = Study(
        config,
        table,
        read_mesh=lambda: None,
        read_scan=lambda *of: make_surface(scans[of], SPACING).assign_attrs(file="scan"),
    )
    return epochs_on_each_other(study)[0]


@pytest.mark.parametrize(
    ("laid", "how"),
    [
        (
            lambda heights: -heights[:, ::-1],
            "with the sign of its heights changed, reversed along x",
        ),
        (lambda heights: heights[::-1], "reversed along y"),
        (lambda heights: np.rot90(heights), "turned by 90°"),
    ],
)
def test_t1_that_were_all_scanned_otherwise_are_one_fault(laid, how):
    """The fault says how the file has to be laid, which the config may reverse, too."""
    (fault,) = check(dict.fromkeys(PATCHES, laid))
    assert (fault.name, fault.patches) == (UNMATCHED, tuple(PATCHES))
    assert fault.problem.endswith(f" only {how}")


def test_a_t1_that_was_scanned_otherwise_is_named():
    (fault,) = check({"b": lambda heights: -heights})
    assert (fault.name, fault.patches) == (UNMATCHED, ("b",))


def test_t1_that_match_nothing_are_one_fault_only_if_none_matches(caplog):
    unlike = {patch: lambda _: surface(99) for patch in PATCHES}
    (fault,) = check(unlike)
    assert (fault.name, fault.patches) == (UNMATCHED, ())
    assert caplog.text.count("not found") == 0
    assert check({"b": unlike["b"]}) == []
    assert caplog.text.count("not found") == 1


def test_a_t1_between_two_patches_is_no_mistake_of_names(caplog):
    waves = smooth_field(np.random.default_rng(7), 3 * COUNT, SPACING, 0.1)[:COUNT] * 2e-3
    before = {"a": waves[:, :COUNT], "b": waves[:, 80 : 80 + COUNT]}
    assert check({"a": lambda _: waves[:, 52 : 52 + COUNT]}, before) == []
    assert caplog.text.count("not found") == 1
    # if it shows most of the other patch, it is one
    (fault,) = check({"a": lambda _: waves[:, 72 : 72 + COUNT]}, before)
    assert fault.patches == ("a",)


def test_t1_of_another_patch_is_a_fault_of_its_own_patch():
    first, other = check({"a": lambda _: surface(1), "b": lambda _: surface(0)})
    assert (first.patches, other.patches) == (("a",), ("b",))
    assert "on T0 of patch b" in first.problem
