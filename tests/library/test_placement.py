"""Placement: a shared surface is found again where it was taken from; noise is found nowhere."""

import logging
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import trimesh
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st
from matplotlib.image import imread

from gstlib import figures
from gstlib.io.store import read_dataset, write_dataset
from gstlib.io.tables import read_table, write_table
from gstlib.placement import (
    AGREES,
    ALL,
    CANNOT_TELL,
    SHIFTED,
    found_places,
    place_patches,
    warnings_of,
)
from gstlib.preprocess.frame import Frame
from gstlib.preprocess.gridding import grid_mesh
from gstlib.specimen import SpecimenParameters, generate_specimen, score_truth, true_patches
from gstlib.surface import make_surface

ROOT = Path(__file__).parents[2]
SQUARE, SIZE, EDGE = 5.0, 0.85, 0.3144
TESTS = {"edge_mm": EDGE, "maximum_shift_um": 200.0, "significance": 0.01}


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


def place(square, patches, heights, **tests):
    found, maps = place_patches(
        square,
        patches,
        dict(zip(patches.patch, heights, strict=True)),
        size_mm=SIZE,
        generator=np.random.default_rng(0),
        **TESTS | tests,
    )
    return found.set_index("patch"), maps


NINE = [(y, x) for y in (1.2, 2.5, 3.8) for x in (1.2, 2.5, 3.8)]


@settings(max_examples=15, deadline=None)
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
    found, _ = place(stone.square(), table([(2.4, 2.5)], rotation), [patch])
    row = found.loc["1"]
    assert row.correlation > 0.9999
    assert row.p_value < 0.01
    assert row.shift_x_um == pytest.approx(shift_x, abs=1)
    assert row.shift_y_um == pytest.approx(shift_y, abs=1)
    assert row.verdict == (SHIFTED if row.shift_p_value < 0.01 else AGREES)
    if np.hypot(shift_x, shift_y) > 30:
        assert row.verdict == SHIFTED


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 1000), st.floats(0.01, 100), *[st.floats(-0.01, 0.01)] * 4)
def test_planes_offsets_and_the_scale_of_heights_do_not_matter(seed, scale, a, b, c, d):
    stone = Waves(seed)
    rng = np.random.default_rng(seed)
    patches = table(NINE[3:5])
    heights = [stone.patch(y + 0.05, x - 0.03) for y, x in NINE[3:5]]
    heights = [height + 1e-3 * rng.standard_normal(height.shape) for height in heights]
    square = stone.square()
    one, _ = place(square, patches, heights)
    other, _ = place(
        square + c * square.x + d * square.y + a,
        patches,
        [scale * (height + a * height.x + b * height.y + c) for height in heights],
    )
    pd.testing.assert_frame_equal(one, other, rtol=1e-5, atol=1e-5)


def test_patches_of_another_stone_are_found_nowhere():
    """No more of them correlate significantly than the level says, and none looks mirrored."""
    p_values, verdicts = [], []
    for seed in range(6):
        stone, other = Waves(seed), Waves(seed + 1000)
        heights = [other.patch(y, x) for y, x in NINE]
        found, _ = place(stone.square(), table(NINE), heights, significance=0.05)
        p_values += list(found.p_value.drop(index=ALL))
        verdicts += list(found.verdict.drop(index=ALL))
        assert (found.verdict[ALL], found.looks[ALL]) == (CANNOT_TELL, "")
    assert np.mean(np.array(p_values) < 0.05) < 0.13  # of 54: 0.05 ± 0.03 by chance
    assert 0.3 < np.median(p_values) < 0.7
    assert verdicts.count(SHIFTED) < 5


def test_a_shift_that_all_share_is_found_with_its_error():
    stone, rng = Waves(3), np.random.default_rng(1)
    own = rng.normal(0, 0.02, (len(NINE), 2))
    heights = [
        stone.patch(y + 0.06 + dy, x - 0.09 + dx)
        for (y, x), (dy, dx) in zip(NINE, own, strict=True)
    ]
    found, _ = place(stone.square(), table(NINE), heights)
    row = found.loc[ALL]
    assert (row.verdict, row.looks) == (SHIFTED, "as given")
    assert abs(row.shift_x_um + 90) < 3 * row.shift_x_error_um < 40
    assert abs(row.shift_y_um - 60) < 3 * row.shift_y_error_um < 40
    assert any("check square.frame" in text for text in warnings_of(found.reset_index()))


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
def test_a_mirrored_patch_is_noticed(wrong, looks):
    stone = Waves(5)
    heights = [stone.patch(y + 0.02, x) for y, x in NINE]
    heights = [height.copy(data=wrong(height.values)) for height in heights]
    found, _ = place(stone.square(), table(NINE), heights)
    assert found.looks[ALL] == looks
    told = [text for text in warnings_of(found.reset_index()) if "check scans.mould" in text]
    assert len(told) == (looks != "as given")
    assert all(looks in text for text in told)


def test_a_table_whose_places_are_wrong_is_noticed():
    stone = Waves(6)
    heights = [stone.patch(y, x) for y, x in NINE]

    def told(places):
        found, _ = place(stone.square(), table(places), heights)
        return [text for text in warnings_of(found.reset_index()) if "x_mm and y_mm" in text]

    assert told(NINE) == []
    assert len(told([(x, y) for y, x in NINE])) == 1  # those on the diagonal are right
    assert len(told(NINE[4:] + NINE[:4])) == 1


def test_nothing_can_be_told_with_a_coarse_mesh_or_a_small_square(caplog):
    stone = Waves(2)
    heights = [stone.patch(y, x) for y, x in NINE]
    found, maps = place(stone.square(), table(NINE), heights, edge_mm=0.6)
    assert (found.verdict == CANNOT_TELL).all()
    assert found.waves.max() < 4
    assert found.shift_x_um.isna().all()
    assert maps.correlation.isnull().all()
    assert warnings_of(found.reset_index()) == []
    with caplog.at_level(logging.WARNING):
        found, _ = place(stone.square(), table(NINE[4:5]), heights[4:5], maximum_shift_um=1000.0)
    assert "lower placement.maximum_shift_um" in caplog.text
    assert found.verdict["1"] == CANNOT_TELL


def test_a_footprint_stays_in_the_square():
    """The true place lies half out of the square; what is found does not."""
    stone = Waves(4)
    patches = table([(0.43, 2.5), (2.5, 4.575)])
    heights = [stone.patch(0.33, 2.5), stone.patch(2.5, 4.65)]
    found, maps = place(stone.square(), patches, heights)
    corrected = found_places(patches, found.reset_index())
    half = SIZE / 2
    assert (corrected[["x_mm", "y_mm"]] >= half - 1e-6).all(axis=None)
    assert (corrected[["x_mm", "y_mm"]] <= SQUARE - half + 1e-6).all(axis=None)
    outside = maps.correlation.sel(patch="1", shift_y=slice(None, -20))
    assert outside.isnull().all()
    assert maps.correlation.sel(patch="1", shift_y=slice(0, None)).notnull().all()


def test_only_shifted_patches_are_moved():
    placement = pd.DataFrame(
        {
            "patch": ["2", "1", "3", ALL],
            "correlation": [0.9, 0.8, 0.1, 0.9],
            "shift_x_um": [100.0, 50.0, np.nan, 1.0],
            "shift_y_um": [-20.0, 5.0, np.nan, 1.0],
            "shift_x_error_um": [10.0, 40.0, np.nan, 1.0],
            "shift_y_error_um": [11.0, 40.0, np.nan, 1.0],
            "verdict": [SHIFTED, AGREES, CANNOT_TELL, AGREES],
            "looks": ["", "", "", "as given"],
        }
    )
    patches = table([(1.0, 2.0)] * 3)
    moved = found_places(patches, placement)
    assert list(moved.place) == ["nominal", "found", "nominal"]
    np.testing.assert_allclose(moved.x_mm, [2.0, 2.1, 2.0])
    np.testing.assert_allclose(moved.y_mm, [1.0, 0.98, 1.0])
    (text,) = warnings_of(placement)
    assert "patch 2" in text
    assert "x by +100 ± 10 µm and y by -20 ± 11 µm" in text


@pytest.fixture(scope="module")
def generated(tmp_path_factory):
    """A generated pebble, small but at the default study's resolution: square, scans, true places.

    Its patches are stated 150 to 200 µm off where they were scanned.
    """
    settings = yaml.safe_load((ROOT / "config/config.yaml").read_text(encoding="utf-8"))["specimen"]
    small = {"outer_size_mm": [30.0, 24.0, 9.0], "concavity_mm": 0.05}
    coarse = {"scan_points": 64, "scan_spacing_um": 13.28, "unmeasured_size_um": 30.0}
    along = np.linspace(0.9, 4.1, 6)
    true = table([(y, x) for y in along for x in along])
    true = true.assign(t0=true.patch + "_T0.plu", t1="")
    folder = tmp_path_factory.mktemp("generated")
    generate_specimen(
        true,
        mesh=folder / "mesh.stl",
        scan_folder=folder,
        truth=folder / "truth.h5",
        square_mm=SQUARE,
        grid=20,
        parameters=SpecimenParameters(**settings | small | coarse),
    )
    square = grid_mesh(
        trimesh.load(folder / "mesh.stl"),
        Frame(origin=(2.5, 2.5, 0), x_axis=(-1, 0, 0), normal=(0, 0, 1)),
        size_mm=SQUARE,
        shape=(100, 100),
        margin_mm=1.0,
    )
    truth = read_dataset(folder / "truth.h5")
    heights = [truth.height.sel(patch=patch, drop=True).astype(float) for patch in true.patch]
    rng = np.random.default_rng(0)
    angle, length = rng.uniform(0, 2 * np.pi, len(true)), rng.uniform(0.15, 0.2, len(true))
    places = true_patches(truth)
    room = SIZE / 2, SQUARE - SIZE / 2
    stated = true.assign(
        x_mm=(places.x_mm - length * np.cos(angle)).clip(*room),
        y_mm=(places.y_mm - length * np.sin(angle)).clip(*room),
    )
    return square, stated, heights, truth


def test_large_errors_of_a_generated_specimen_are_recovered(generated):
    square, stated, heights, truth = generated
    places = true_patches(truth)
    found, _ = place(square, stated, heights, maximum_shift_um=300.0)
    told = (found.drop(index=ALL).verdict != CANNOT_TELL).to_numpy()
    shifts = found.drop(index=ALL)[told]
    true = np.stack([places[a] - stated[a] for a in ("x_mm", "y_mm")], axis=1)[told] * 1e3
    off = shifts[["shift_x_um", "shift_y_um"]].to_numpy() - true
    error = shifts[["shift_x_error_um", "shift_y_error_um"]].to_numpy()
    assert told.mean() > 0.3
    assert np.sqrt(np.mean(off**2)) < 0.6 * np.sqrt(np.mean(true**2))
    assert np.mean(np.abs(off) < 2 * error) > 0.85
    assert (shifts.verdict == SHIFTED).mean() > 0.6
    corrected = found_places(stated, found.reset_index())
    moved = (corrected.place == "found").to_numpy()
    before, after = (
        np.hypot(table.x_mm - places.x_mm, table.y_mm - places.y_mm)[moved]
        for table in (stated, corrected)
    )
    assert np.median(after) < 0.4 * np.median(before)


def test_placement_is_scored_against_the_truth(generated):
    *_, truth = generated
    names = truth.patch.values
    found = pd.DataFrame({"patch": [*names, ALL], "shift_x_um": 7.0, "shift_y_um": np.nan})
    rows = score_truth(truth, placement=found)
    assert set(rows.stage) == {"placement"}
    one = rows[rows.quantity == "shift_x"].set_index("patch")
    true = (truth.x_mm.sel(epoch="T0") - truth.nominal_x_mm).values * 1e3
    np.testing.assert_allclose(one.true[names].astype(float), true)
    # seven digits of the larger number: half a unit of the seventh is 5e-6 at tens of µm
    np.testing.assert_allclose(one.error.astype(float), 7 - true, rtol=0, atol=5e-6)
    assert list(one.unit.unique()) == ["um"]
    assert rows[rows.quantity == "shift_y"].recovered.isna().all()


@pytest.mark.parametrize("edge", [EDGE, 0.6])
def test_the_figure_shows_every_patch_and_up_to_three_in_detail(edge, tmp_path):
    stone = Waves(2)
    patches = table(NINE)
    heights = [stone.patch(y, x + 0.1) for y, x in NINE]
    found, maps = place(stone.square(), patches, heights, edge_mm=edge)
    write_table(tmp_path / "placement.csv", found.reset_index())
    write_dataset(tmp_path / "placement.h5", maps)
    figure = figures.placement_figure(
        stone.square(),
        patches,
        read_table(tmp_path / "placement.csv"),
        read_dataset(tmp_path / "placement.h5"),
        patch_size_mm=SIZE,
        source_note="generated specimen",
    )
    figures.save_figure(figure, tmp_path / "a.png", tmp_path / "a.svg")
    square = figure.axes[0]
    assert len(square.patches) == len(patches)
    titles = [axes.get_title() for axes in figure.axes if axes.get_title().startswith("patch ")]
    assert len(titles) == (3 if edge == EDGE else 0)
    assert imread(tmp_path / "a.png")[..., :3].min() < 0.3
