"""Placement: a shared surface is found again where it was taken from; noise is found nowhere."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from gstlib.placement import ALL, CANNOT_TELL, SHIFTED, place_patches
from gstlib.surface import make_surface

SQUARE, SIZE, EDGE = 5.0, 0.85, 0.3144
SETTINGS = {"edge_mm": EDGE, "maximum_shift_um": 200.0}


class Waves:
    """A surface of waves longer than 0.6 mm, known at every point."""

    def __init__(self, seed, count=60):
        rng = np.random.default_rng(seed)
        wavelength, direction = rng.uniform(0.6, 2.5, count), rng.uniform(0, 2 * np.pi, count)
        self.y, self.x = 2 * np.pi / wavelength * [np.sin(direction), np.cos(direction)]
        self.phase = rng.uniform(0, 2 * np.pi, count)
        self.height = wavelength**1.8 * 1e-3

    def __call__(self, y, x):
        y, x = np.broadcast_arrays(y, x)
        return (
            self.height * np.cos(y[..., None] * self.y + x[..., None] * self.x + self.phase)
        ).sum(axis=-1)

    def square(self, count=100):
        places = (np.arange(count) + 0.5) * SQUARE / count
        return make_surface(self(places[:, None], places), SQUARE / count)

    def patch(self, y, x, rotation_deg=0.0, points=64):
        turn = np.radians(rotation_deg)
        u = ((np.arange(points) + 0.5) / points - 0.5) * SIZE
        v = u[:, None]
        heights = self(
            y + np.cos(turn) * v + np.sin(turn) * u, x + np.cos(turn) * u - np.sin(turn) * v
        )
        return make_surface(heights, SIZE / points)


def table(places, rotation_deg=0.0):
    names = [str(number) for number in range(1, len(places) + 1)]
    y, x = np.transpose(places)
    return pd.DataFrame({"patch": names, "x_mm": x, "y_mm": y, "rotation_deg": rotation_deg})


def place(square, patches, heights, **changed):
    """The table by patch."""
    heights = dict(zip(patches.patch, heights, strict=True))
    found = place_patches(square, patches, heights, size_mm=SIZE, **SETTINGS | changed)
    return found.set_index("patch")


NINE = [(y, x) for y in (1.2, 2.5, 3.8) for x in (1.2, 2.5, 3.8)]


@settings(max_examples=10, deadline=None)
@given(
    st.integers(0, 1000),
    st.floats(-150, 150),
    st.floats(-150, 150),
    st.sampled_from([0.0, 0.0, -7.0, 90.0, 30.0]),
)
@example(404, 9.0, 0.0, 0.0)  # a ridge aslant, narrower than the map's points are apart
def test_a_shared_surface_is_found_where_it_was_taken_from(seed, shift_y, shift_x, rotation):
    stone = Waves(seed)
    patch = stone.patch(2.4 + shift_y * 1e-3, 2.5 + shift_x * 1e-3, rotation)
    found = place(stone.square(), table([(2.4, 2.5)], rotation), [patch])
    row = found.loc["1"]
    assert row.correlation > 0.9999
    assert row.shift_x_um == pytest.approx(shift_x, abs=1.5)
    assert row.shift_y_um == pytest.approx(shift_y, abs=1.5)
    assert row.verdict == SHIFTED or max(abs(shift_x), abs(shift_y)) < 30


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 1000), st.floats(0.01, 100), *[st.floats(-0.01, 0.01)] * 4)
def test_planes_offsets_and_the_scale_of_heights_do_not_matter(seed, scale, a, b, c, d):
    stone = Waves(seed)
    rng = np.random.default_rng(seed)
    patches = table(NINE[3:5])
    heights = [stone.patch(y + 0.05, x - 0.03) for y, x in NINE[3:5]]
    heights = [height + 1e-3 * rng.standard_normal(height.shape) for height in heights]
    square = stone.square()
    one = place(square, patches, heights)
    other = place(
        square + c * square.x + d * square.y + a,
        patches,
        [scale * (height + a * height.x + b * height.y + c) for height in heights],
    )
    pd.testing.assert_frame_equal(one, other, rtol=1e-4, atol=1e-4)


def test_patches_of_another_stone_are_found_nowhere(caplog):
    verdicts = []
    for seed in range(6):
        stone, other = Waves(seed), Waves(seed + 1000)
        caplog.clear()
        found = place(stone.square(), table(NINE), [other.patch(y, x) for y, x in NINE])
        verdicts += list(found.verdict.drop(index=ALL))
        assert (found.verdict[ALL], found.looks[ALL]) == (CANNOT_TELL, "")
        assert "check its x_mm and y_mm" in caplog.text
    # at a level of 0.01, 54 patches give one false alarm in two
    assert len(verdicts) - verdicts.count(CANNOT_TELL) <= 3


def disagreeing(stone, seed):
    """A square with errors of its own as long as the waves, a tenth of its roughness."""
    square, rng = stone.square(), np.random.default_rng(seed)
    own = gaussian_filter(rng.standard_normal(square.shape), 4, mode="wrap")
    return square + 0.1 * float(square.std()) * own / own.std()


def test_gross_errors_are_found_and_small_ones_raise_no_alarm():
    """Places stated with errors of 10 µm, and one patch of nine 170 µm off."""
    off, errors, alarms, found_out = [], [], 0, 0
    for seed in range(8):
        stone, rng = Waves(seed), np.random.default_rng(seed)
        own = rng.normal(0, 0.01, (len(NINE), 2))
        own[4] = [0.14, -0.1]
        heights = [stone.patch(y + dy, x + dx) for (y, x), (dy, dx) in zip(NINE, own, strict=True)]
        found = place(disagreeing(stone, seed), table(NINE), heights)
        found = found.drop(index=ALL)
        certain = found[found.verdict != CANNOT_TELL]
        true = 1e3 * own[[int(name) - 1 for name in certain.index]]
        off.append((certain[["shift_y_um", "shift_x_um"]] - true).to_numpy())
        errors.append(certain[["shift_y_error_um", "shift_x_error_um"]].to_numpy())
        alarms += (found.verdict.drop(index="5") == SHIFTED).sum()
        found_out += found.verdict["5"] == SHIFTED
    off, errors = np.concatenate(off), np.concatenate(errors)
    assert len(off) > 0.5 * 8 * 9
    assert alarms <= 4  # of 64
    assert found_out >= 6  # of 8
    assert np.mean(np.abs(off) < 2 * errors) > 0.85
    assert 0.5 < np.mean(np.abs(off) < errors) < 0.85


def test_a_shift_that_all_share_is_found_with_its_error(caplog):
    stone, rng = Waves(3), np.random.default_rng(1)
    own = rng.normal(0, 0.02, (len(NINE), 2))
    heights = [
        stone.patch(y + 0.06 + dy, x - 0.09 + dx)
        for (y, x), (dy, dx) in zip(NINE, own, strict=True)
    ]
    found = place(stone.square(), table(NINE), heights)
    row = found.loc[ALL]
    assert (row.verdict, row.looks) == (SHIFTED, "as given")
    assert abs(row.shift_x_um + 90) < 3 * row.shift_x_error_um < 40
    assert abs(row.shift_y_um - 60) < 3 * row.shift_y_error_um < 40
    assert (
        f"all patches together correlate best with the macroscale when shifted in x by "
        f"{row.shift_x_um:+.0f} ± {row.shift_x_error_um:.0f} µm" in caplog.text
    )
    patches = found.drop(index=ALL)
    assert row.shift_x_error_um == pytest.approx(patches.shift_x_um.std() / 3)


@pytest.mark.parametrize(
    ("wrong", "looks"),
    [
        (lambda h: h[:, ::-1], "reversed along x"),
        (lambda h: h[::-1], "reversed along y"),
        (lambda h: -h, "inverted"),
        (lambda h: -h[::-1, ::-1], "inverted and reversed along x and y"),
        (lambda h: h, "as given"),
    ],
)
def test_a_mirrored_patch_is_noticed(wrong, looks, caplog):
    stone = Waves(5)
    heights = [stone.patch(y + 0.02, x) for y, x in NINE]
    heights = [height.copy(data=wrong(height.values)) for height in heights]
    found = place(stone.square(), table(NINE), heights)
    assert found.looks[ALL] == looks
    assert (f"better {looks}: check scans.mould" in caplog.text) == (looks != "as given")


def test_a_table_whose_places_are_wrong_is_noticed(caplog):
    stone = Waves(6)
    heights = [stone.patch(y, x) for y, x in NINE]

    def warned(places):
        caplog.clear()
        place(stone.square(), table(places), heights)
        return "check its x_mm and y_mm" in caplog.text

    assert not warned(NINE)
    assert warned([(x, y) for y, x in NINE])  # those on the diagonal are right
    assert warned(NINE[4:] + NINE[:4])


def test_nothing_can_be_told_with_a_coarse_mesh_or_grid_or_in_a_small_square(caplog):
    stone = Waves(2)
    heights = [stone.patch(y, x) for y, x in NINE]
    # a mesh that holds no waves, and a square of few elements
    for square, edge in ((stone.square(), 0.6), (stone.square(10), EDGE)):
        found = place(square, table(NINE), heights, edge_mm=edge)
        assert (found.verdict == CANNOT_TELL).all()
        assert found.correlation.isna().all()
        assert found.shift_x_um.isna().all()
    assert caplog.text == ""
    # such shifts leave no place that is surely a wrong one, or no room at all
    for shift in (1000.0, 3000.0):
        found = place(stone.square(), table(NINE[4:5]), heights[4:5], maximum_shift_um=shift)
        assert (found.verdict == CANNOT_TELL).all()


def test_a_footprint_stays_in_the_square():
    """The true place is half out of the square; the one found is not."""
    stone = Waves(4)
    found = place(
        stone.square(),
        table([(0.43, 2.5), (2.5, 4.575)]),
        [stone.patch(0.33, 2.5), stone.patch(2.5, 4.65)],
    )
    assert not found.shift_y_um["1"] < -5.1
    assert not found.shift_x_um["2"] > 0.1
