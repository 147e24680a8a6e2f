"""Texture parameters of surfaces whose own are known in closed form, and their invariants."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy.ndimage
import xarray as xr
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm
from SurfaceTopography import Topography

from gstlib.config import check_config
from gstlib.errors import ConfigError, InputError
from gstlib.figures import texture_figure
from gstlib.preprocess.leveling import remove_plane
from gstlib.surface import make_surface
from gstlib.validation.texture import (
    PARAMETERS,
    measured_rectangle,
    scale_limited,
    texture_parameters,
    texture_rows,
)

UM = 1e-3  # mm
SIZE = 256
# so short and so long that nothing is filtered
OPEN = {"s_filter_um": 1e-3, "l_filter_um": None}
FILTERS = {"s_filter_um": 8.0, "l_filter_um": 100.0}

# surfalize warns of elements that are not square: what is used of it is tested with such here
not_square = pytest.mark.filterwarnings("ignore:The surface has different pixel size")


def surface(heights_um, spacing_um=1.0):
    return make_surface(np.asarray(heights_um) * UM, np.asarray(spacing_um) * UM)


def parameters(heights_um, spacing_um=1.0, **filters):
    """Parameters by symbol, unfiltered unless told otherwise."""
    values = texture_parameters(surface(heights_um, spacing_um), **(OPEN | filters))
    assert list(values) == list(PARAMETERS.values())
    return {symbol: values[column] for symbol, column in PARAMETERS.items()}


def waves(size, count):
    """Phases of `count` whole waves along an axis, symmetric about its middle."""
    return 2 * np.pi * count * (np.arange(size) + 0.5) / size


def spread(quantile, seed=0):
    """Heights of a known distribution (by its quantile function), in random places.

    Each stands twice, opposite about the middle of the map, so that there is no plane to take off.
    """
    count = SIZE**2 // 2
    half = quantile((np.random.default_rng(seed).permutation(count) + 0.5) / count)
    return np.concatenate([half, half[::-1]]).reshape(SIZE, SIZE)


def correlated(correlation, size=256, seed=0):
    """A Gaussian field, of unit variance, with the autocorrelation of lags (y, x) in elements."""
    lags = np.fft.fftfreq(size) * size
    spectrum = np.abs(np.fft.fft2(correlation(lags[:, None], lags)))
    noise = np.fft.fft2(np.random.default_rng(seed).standard_normal((size, size)))
    return np.fft.ifft2(noise * np.sqrt(spectrum)).real


def rough(seed=0, size=128):
    return correlated(lambda y, x: np.exp(-np.hypot(y, x) / 12), size=size, seed=seed)


def test_egg_box():
    amplitude, count = 3.0, 4
    phase = waves(2 * SIZE, count)
    found = parameters(amplitude * np.cos(phase[:, None]) * np.cos(phase))
    assert found["Sq"] == pytest.approx(amplitude / 2)
    assert found["Sa"] == pytest.approx(4 * amplitude / np.pi**2, rel=1e-3)
    assert found["Sz"] == pytest.approx(2 * amplitude, rel=1e-3)
    assert found["Ssk"] == pytest.approx(0, abs=1e-6)
    assert found["Sku"] == pytest.approx(2.25)
    wave_number = 2 * np.pi * count / (2 * SIZE)
    assert found["Sdq"] == pytest.approx(amplitude * wave_number / math.sqrt(2), rel=3e-3)


def test_gradient_of_a_wave_converges_with_the_spacing():
    amplitude, wave_number = 2.0, 2 * np.pi * 4 / 128
    true = amplitude * wave_number / math.sqrt(2)
    errors = []
    for size in (64, 128, 256):
        spacing = 128 / size
        heights = np.broadcast_to(amplitude * np.cos(waves(size, 4)), (size, size))
        found = parameters(heights, spacing)["Sdq"]
        # of differences; that over the edge, which there is none of, would be nought
        factor = math.sin(wave_number * spacing / 2) / (wave_number * spacing / 2)
        assert found == pytest.approx(true * factor * math.sqrt(size / (size - 1)), rel=1e-9)
        errors.append(abs(found / true - 1))
    assert errors[-1] < 3e-3


@not_square
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("slope", [0.05, 0.7, 2.0])
def test_area_of_a_roof(slope, axis):
    """Two slopes, one flat interval between them at the ridge; elements that are not square."""
    spacing = (1.0, 0.5)
    profile = slope * spacing[axis] * np.abs(np.arange(SIZE) - (SIZE - 1) / 2)
    sloping = (SIZE - 2) / (SIZE - 1)
    found = parameters(np.moveaxis(np.tile(profile, (SIZE, 1)), 1, axis), spacing)
    true = 100 * sloping * (math.sqrt(1 + slope**2) - 1)
    assert found["Sdr"] == pytest.approx(true, rel=1e-6)
    assert found["Sdq"] == pytest.approx(slope * math.sqrt(sloping), rel=1e-6)


def test_heights_of_a_normal_distribution():
    found = parameters(spread(norm.ppf))
    assert found["Sa"] / found["Sq"] == pytest.approx(math.sqrt(2 / np.pi), rel=1e-3)
    assert found["Ssk"] == pytest.approx(0, abs=1e-3)
    assert found["Sku"] == pytest.approx(3, rel=5e-3)


def equivalent_line(quantile):
    """Height at 0 and at 100 % of the least-squares line over the middle 40 % of the area."""
    curve = lambda share: quantile(1 - share)  # noqa: E731
    slope = quad(lambda share: (share - 0.5) * curve(share), 0.3, 0.7)[0] * 12 / 0.4**3
    middle = quad(curve, 0.3, 0.7)[0] / 0.4
    return middle - 0.5 * slope, middle + 0.5 * slope


def beyond(quantile, level, share):
    """Mean height above `level`, which a share of the area exceeds."""
    return quad(lambda part: quantile(1 - part) - level, 0, share)[0]


def triangular(share):
    low = np.sqrt(2 * np.minimum(share, 0.5)) - 1
    return np.where(share < 0.5, low, 1 - np.sqrt(2 * (1 - np.maximum(share, 0.5))))


@pytest.mark.parametrize(
    ("quantile", "share_above"),
    [(norm.ppf, norm.sf), (triangular, lambda height: (1 - height) ** 2 / 2)],
    ids=["normal", "triangular"],
)
def test_core_summits_and_dales_of_symmetric_distributions(quantile, share_above):
    """By numerical integration; where the middle 40 % are the flattest."""
    found = parameters(spread(quantile))
    upper, lower = equivalent_line(quantile)
    share = float(share_above(upper))
    assert found["Sk"] == pytest.approx(upper - lower, rel=1e-3)
    assert found["Smr1"] == pytest.approx(100 * share, abs=0.05)
    assert found["Smr2"] == pytest.approx(100 - 100 * share, abs=0.05)
    height = 2 * beyond(quantile, upper, share) / share
    assert found["Spk"] == pytest.approx(height, rel=1e-3)
    assert found["Svk"] == pytest.approx(height, rel=1e-3)


def test_volumes_of_a_normal_distribution():
    found = parameters(spread(norm.ppf))

    def material(share):
        return norm.pdf(norm.isf(share)) - share * norm.isf(share)

    # void below c is material above c, plus c less the mean height
    void = material(0.1) + norm.isf(0.1)
    assert found["Vmp"] == pytest.approx(material(0.1), rel=5e-4)
    assert found["Vmc"] == pytest.approx(material(0.8) - material(0.1), rel=5e-4)
    assert found["Vvv"] == pytest.approx(material(0.2), rel=5e-4)
    assert found["Vvc"] == pytest.approx(void - material(0.2), rel=5e-4)


def test_a_uniform_distribution_is_all_core():
    found = parameters(spread(lambda share: 2 * share))
    assert found["Sq"] == pytest.approx(2 / math.sqrt(12), rel=1e-3)
    assert found["Sku"] == pytest.approx(1.8, rel=1e-3)
    assert found["Sk"] == pytest.approx(2, rel=5e-3)
    assert found["Spk"] + found["Svk"] == pytest.approx(0, abs=0.02)
    volumes = {"Vmp": 0.01, "Vmc": 0.63, "Vvc": 0.77, "Vvv": 0.04}
    assert {name: found[name] for name in volumes} == pytest.approx(volumes, rel=1e-2)


@pytest.mark.parametrize("length", [3, 6])
def test_autocorrelation_length_of_an_exponential_correlation(length):
    found = [
        parameters(correlated(lambda y, x: np.exp(-np.hypot(y, x) / length), seed=seed), 0.5)
        for seed in range(3)
    ]
    # the shortest of all directions, so a little below that of each
    assert np.mean([each["Sal"] for each in found]) == pytest.approx(
        0.5 * length * math.log(5), rel=0.1
    )
    assert min(each["Str"] for each in found) > 0.75


@pytest.mark.parametrize("turn", [0.0, 2.2])
def test_aspect_ratio_of_a_texture_with_a_direction(turn):
    def correlation(y, x):
        along, across = (
            x * math.cos(turn) + y * math.sin(turn),
            y * math.cos(turn) - x * math.sin(turn),
        )
        return np.exp(-((along / 16) ** 2) - (across / 4) ** 2)

    found = [parameters(correlated(correlation, seed=seed)) for seed in range(3)]
    assert np.mean([each["Str"] for each in found]) == pytest.approx(0.25, rel=0.15)
    assert np.mean([each["Sal"] for each in found]) == pytest.approx(
        4 * math.sqrt(math.log(5)), rel=0.05
    )


def test_points_left_out_of_the_autocorrelation_are_not_missed():
    """An S-filter of 8 µm leaves every fourth point; waves this long pass it whole."""
    heights = correlated(lambda y, x: np.exp(-(y**2 + (x / 2) ** 2) / 10**2))
    every, fourth = parameters(heights), parameters(heights, s_filter_um=8.0)
    for name in ("Sal", "Str"):
        assert fourth[name] == pytest.approx(every[name], rel=0.05)
        assert fourth[name] != every[name]


@not_square
@pytest.mark.parametrize("axis", [0, 1])
def test_grooves_across_the_whole_map_have_no_aspect_ratio(axis):
    spacing = (1.0, 0.5)
    heights = np.tile(np.cos(waves(SIZE, 8)), (SIZE, 1))
    found = parameters(np.moveaxis(heights, 1, axis), spacing)
    assert math.isnan(found["Str"])
    # correlated as the cosine itself
    wavelength = spacing[axis] * SIZE / 8
    assert found["Sal"] == pytest.approx(math.acos(0.2) / (2 * np.pi) * wavelength, rel=0.05)


@pytest.mark.parametrize("filters", [{}, FILTERS])
def test_a_tilted_plane_has_no_texture(filters):
    y, x = np.indices((SIZE, SIZE))
    found = parameters(30 + 0.3 * x - 0.1 * y, **filters)
    shape = ("Ssk", "Sku", "Sal", "Str", "Smr1", "Smr2")
    assert all(math.isnan(found[name]) for name in shape)
    assert all(found[name] == 0 for name in found if name not in shape)


def test_as_surfacetopography_has_it():
    """The two that another library has as well, in its own way."""
    heights = rough()
    other = Topography(heights, heights.shape).detrend("height")
    found = parameters(heights)
    assert found["Sq"] == pytest.approx(other.Sq(), rel=1e-3)
    assert found["Sdq"] == pytest.approx(other.rms_gradient(), rel=1e-2)


@settings(max_examples=8, deadline=None)
@given(
    seed=st.integers(0, 100),
    offset=st.floats(-1e3, 1e3),
    slopes=st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)),
)
def test_neither_datum_nor_tilt_nor_axes_matter(seed, offset, slopes):
    heights = rough(seed)
    y, x = np.indices(heights.shape)
    before = parameters(heights, **FILTERS)
    moved = offset + heights + slopes[0] * y + slopes[1] * x
    assert parameters(moved, **FILTERS) == pytest.approx(before, rel=1e-6, abs=1e-6)
    assert parameters(heights.T, **FILTERS) == pytest.approx(before, rel=1e-6, abs=1e-6)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 100), factor=st.floats(0.01, 100), zoom=st.floats(0.01, 100))
def test_heights_and_lengths_scale(seed, factor, zoom):
    heights = rough(seed)
    before = parameters(heights, **FILTERS)
    higher = parameters(factor * heights, **FILTERS)
    wider = parameters(heights, zoom, **{key: zoom * value for key, value in FILTERS.items()})
    for name, value in before.items():
        column = PARAMETERS[name]
        height = column.endswith(("_um", "_per_um2")) and name != "Sal"
        if name != "Sdr":  # no power of either
            power = factor if height or name == "Sdq" else 1
            assert higher[name] == pytest.approx(value * power, rel=1e-6), name
            power = {"Sal": zoom, "Sdq": 1 / zoom}.get(name, 1)
            assert wider[name] == pytest.approx(value * power, rel=1e-6), name
    assert wider["Sdr"] != pytest.approx(before["Sdr"]) or zoom == pytest.approx(1)


def test_upside_down_summits_are_dales():
    heights = np.exp(0.5 * rough())
    up, down = parameters(heights), parameters(-heights)
    assert up["Ssk"] > 0.3
    assert down["Ssk"] == pytest.approx(-up["Ssk"])
    assert (down["Svk"], down["Spk"]) == pytest.approx((up["Spk"], up["Svk"]), rel=1e-2)
    assert down["Smr2"] == pytest.approx(100 - up["Smr1"], abs=0.1)
    assert down["Sk"] == pytest.approx(up["Sk"], rel=1e-3)


def test_unmeasured_points_are_refused():
    heights = surface(rough())
    heights[3, 4:6] = np.nan
    heights.attrs["file"] = "7_T0.plu"
    with pytest.raises(InputError, match=r"7_T0\.plu: 2 of 16384 points have no height.*Fill"):
        texture_parameters(heights, **FILTERS)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(
    ("filters", "passed"),
    [
        ({"s_filter_um": 32.0, "l_filter_um": None}, 0.5),
        ({"s_filter_um": 16.0, "l_filter_um": None}, 2**-0.25),
        ({"s_filter_um": 1e-3, "l_filter_um": 32.0}, 0.5),
        ({"s_filter_um": 1e-3, "l_filter_um": 64.0}, 1 - 2**-4),
        ({"s_filter_um": 16.0, "l_filter_um": 64.0}, 2**-0.25 * (1 - 2**-4)),
    ],
)
def test_share_of_a_wave_that_passes_the_filters(axis, filters, passed):
    """A wave of 32 µm on elements that are not square; whole waves, so that it has no plane."""
    spacing = (0.5, 1.0) if axis else (1.0, 0.5)
    count = (256, 512)[axis == 0], (256, 512)[axis == 1]
    phase = waves(256, 8)
    heights = np.broadcast_to(np.cos(phase) if axis else np.cos(phase)[:, None], count[::-1])
    before = surface(heights, spacing)
    middle = (slice(100, -100),) * 2
    after = scale_limited(before, **filters)
    np.testing.assert_allclose(after.values[middle], passed * before.values[middle], atol=1e-3 * UM)


def convolved(heights, short, long):
    """Band of the heights (array) by convolution; beyond the edges stands their mirror image."""
    sigma = math.sqrt(math.log(2) / 2) / np.pi
    smooth = scipy.ndimage.gaussian_filter(heights, short * sigma, truncate=8)
    return smooth - scipy.ndimage.gaussian_filter(smooth, long * sigma, truncate=8)


def test_the_filter_is_a_gaussian_convolution_away_from_the_edges():
    heights = surface(rough(size=256))
    found = scale_limited(heights, s_filter_um=8.0, l_filter_um=40.0).values
    middle = (slice(70, -70),) * 2
    expected = convolved(heights.values, 8, 40)
    np.testing.assert_allclose(found[middle], expected[middle], atol=1e-4 * UM)


def self_affine(size, seed, hurst=0.8):
    """Periodic heights on which long waves rule."""
    frequency = np.fft.fftfreq(size)
    wave = np.hypot(frequency[:, None], frequency)
    amplitude = np.divide(1, wave ** (1 + hurst), out=np.zeros_like(wave), where=wave > 0)
    noise = np.fft.fft2(np.random.default_rng(seed).standard_normal((size, size)))
    heights = np.fft.ifft2(noise * amplitude).real
    return heights / heights.std()


def test_edges_cost_less_than_with_mirrored_hills():
    """Against the same place filtered within a larger map."""
    place = (slice(100, 400),) * 2
    errors, mirrored, shares = [], [], []
    for seed in range(4):
        whole = surface(self_affine(512, seed))
        inside = scale_limited(whole, **FILTERS)[place]
        found = scale_limited(whole[place], **FILTERS)
        errors.append(((found - inside) ** 2).mean() / inside.var())
        mirror = convolved(remove_plane(whole[place])[0].values, *FILTERS.values())
        mirrored.append(((mirror - inside) ** 2).mean() / inside.var())
        shares.append(found.std() / inside.std() - 1)
    assert math.sqrt(np.mean(errors)) < 0.7 * math.sqrt(np.mean(mirrored))
    assert abs(np.mean(shares)) < 0.05


def overlap(turn_deg, shift, size=200):
    """Where a turned and shifted square covers the first one."""
    y, x = np.indices((size, size)) - (size - 1) / 2
    turn = np.radians(turn_deg)
    rows = np.cos(turn) * y + np.sin(turn) * x + shift[0]
    columns = np.cos(turn) * x - np.sin(turn) * y + shift[1]
    return (np.abs(rows) <= size / 2) & (np.abs(columns) <= size / 2)


@settings(deadline=None)
@given(st.floats(-5, 5), st.tuples(st.floats(-150, 150), st.floats(-150, 150)))
def test_rectangle_lies_within_the_overlap_and_fills_it(turn, shift):
    measured = overlap(turn, shift)
    rectangle = measured_rectangle(measured)
    assert measured[rectangle].all()
    if min(measured[rectangle].shape) > 60:
        assert measured[rectangle].size > 0.7 * measured.sum()
    if turn == 0:
        assert measured[rectangle].size == measured.sum()


def test_rectangle_of_nothing_is_empty():
    assert np.zeros((5, 6))[measured_rectangle(np.zeros((5, 6), dtype=bool))].size == 0


def registered(after, found=1):
    return xr.Dataset({"t1": after}, attrs={"registration_found": found})


def test_both_epochs_are_measured_over_the_same_area():
    before = surface(rough(size=256))
    after = before.copy()
    after[:40] = np.nan
    after[:, -30:] = np.nan
    rows = texture_rows(before, registered(after + 5 * UM), **FILTERS)
    assert [row["epoch"] for row in rows] == ["T0", "T1", "change"]
    assert {(row["size_y_mm"], row["size_x_mm"]) for row in rows} == {(216 * UM, 226 * UM)}
    alone = texture_parameters(before[40:, :-30], **FILTERS)
    for column, value in alone.items():
        assert rows[0][column] == pytest.approx(value)
        assert rows[2][column] == pytest.approx(0, abs=1e-6)


def test_ground_summits_lower_the_core_and_leave_the_dales():
    before = surface(rough(size=256))
    after = before.clip(max=float(before.quantile(0.7)))
    change = pd.Series(texture_rows(before, registered(after), **FILTERS)[2]).drop("epoch")
    for column in ("Sq_um", "Sk_um", "Ssk", "Sz_um", "Smr2_percent", "Vmc_um3_per_um2"):
        assert change[column] < 0, column
    assert change["Svk_um"] > 0


@pytest.mark.parametrize("why", ["no T1", "not found", "no overlap", "narrow"])
def test_without_a_comparison_t0_stands_alone_and_whole(why):
    before = surface(rough(size=256))
    after = before.copy()
    if why == "no overlap":
        after[:] = np.nan
    if why == "narrow":  # less than the L-filter's 100 µm
        after[:, 95:] = np.nan
    t1 = None if why == "no T1" else registered(after, found=int(why != "not found"))
    rows = texture_rows(before, t1, **FILTERS)
    assert rows == [
        {"epoch": "T0", "size_x_mm": 256 * UM, "size_y_mm": 256 * UM}
        | texture_parameters(before, **FILTERS)
    ]


def test_figure_shows_each_patch_at_both_times():
    table = pd.DataFrame(
        {"patch": ["1", "1", "1", "2"], "epoch": ["T0", "T1", "change", "T0"]}
        | {column: [2.0, 1.5, -0.5, 3.0] for column in PARAMETERS.values()}
    )
    figure = texture_figure(table, source_note="generated specimen")
    assert "generated specimen" in [text.get_text() for text in figure.texts]
    assert len(figure.axes) == 6
    for axes in figure.axes:
        fell, rose, before = (line.get_ydata().tolist() for line in axes.lines)
        assert (fell, rose, before) == ([1.5], [], [2.0, 3.0])


def test_filters_that_let_nothing_pass_are_told(monkeypatch):
    root = Path(__file__).parents[3]
    monkeypatch.chdir(root)
    config = yaml.safe_load((root / "config/config.yaml").read_text(encoding="utf-8"))
    schema = root / "workflow/schemas/config.schema.yaml"
    check_config(config | {"texture": {"s_filter_um": 8.0, "l_filter_um": None}}, schema, "a.yaml")
    config["texture"] = {"s_filter_um": 8.0, "l_filter_um": 8.0}
    with pytest.raises(ConfigError, match=r"a\.yaml(.|\n)*'texture\.l_filter_um' is 8"):
        check_config(config, schema, "a.yaml")
