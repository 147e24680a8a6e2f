"""Wear placed at random: the same wear, with no relation to the heights under it."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gstlib.errors import ConfigError
from gstlib.specimen.stone import make_stone
from gstlib.specimen.wear import wear_depth

SQUARE_MM = 5.0


def at_random(parameters, **changes):
    return dataclasses.replace(parameters, wear_placement="random", **changes)


@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_amount_and_shape_stay(parameters, seed):
    stone = make_stone(dataclasses.replace(parameters, seed=seed), SQUARE_MM)
    there = wear_depth(stone, dataclasses.replace(parameters, seed=seed))
    elsewhere = wear_depth(stone, at_random(parameters, seed=seed))
    spectra = [np.abs(np.fft.rfft2(depth.astype(float))) for depth in (there, elsewhere)]
    # the modulus of the spectrum is that of all shifts, and of hardly anything else
    np.testing.assert_allclose(*spectra, atol=1e-9 * spectra[0].max())
    assert (there != elsewhere).any()


def test_it_no_longer_follows_the_heights(parameters):
    """On average over specimens; on each, as far as few and broad waves allow."""
    relation = {"summits": [], "random": []}
    for seed in range(6):
        stone = make_stone(dataclasses.replace(parameters, seed=seed), SQUARE_MM)
        for placement, found in relation.items():
            p = dataclasses.replace(parameters, seed=seed, wear_placement=placement)
            found.append(np.corrcoef(wear_depth(stone, p).ravel(), stone.detail.ravel())[0, 1])
    mean, spread = np.mean(relation["random"]), np.std(relation["random"], ddof=1)
    assert abs(mean) < 3 * spread / np.sqrt(6)
    assert min(relation["summits"]) > 3 * np.abs(relation["random"]).max()


def test_only_scans_after_use_differ(specimen, make, patches, parameters):
    other = make(patches, at_random(parameters))
    for patch in patches.patch:
        before, after = (
            [files.scan(patch, epoch).read_bytes() for files in (specimen, other)]
            for epoch in ("T0", "T1")
        )
        assert before[0] == before[1]
        assert after[0] != after[1]


def test_unknown_placement_is_refused(parameters):
    with pytest.raises(ConfigError, match="wear_placement"):
        dataclasses.replace(parameters, wear_placement="valleys")
