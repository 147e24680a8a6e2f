"""Texture parameters of surfaces whose own are known in closed form, and their invariants."""

import math
import warnings

import numpy as np
import pytest
import xarray as xr
from gstlib.change.texture import _measured_rectangle, _scale_limited, texture_rows
from gstlib.surfaces.grid import make_surface
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import norm

UM = 1e-3  # mm
SIZE = 256
FILTERS = {"s_filter_um": 8.0, "l_filter_um": 100.0}


def surface(heights_um, spacing_um=1.0):
    return make_surface(np.asarray(heights_um) * UM, np.asarray(spacing_um) * UM)


def parameters(heights_um, spacing_um=1.0, s_filter_um=1e-3, l_filter_um=None):
    """Parameters by symbol; by default the filters are so short and so long that all passes."""
    (row,) = texture_rows(
        surface(heights_um, spacing_um), None, s_filter_um=s_filter_um, l_filter_um=l_filter_um
    )
    return {column.partition("_")[0]: value for column, value in list(row.items())[3:]}


def waves(size, count):
    """Phases of `count` whole waves along an axis, symmetric about its middle."""
    return 2 * np.pi * count * (np.arange(size) + 0.5) / size


def correlated(correlation, size=SIZE, seed=0):
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
    assert found["Sku"] == pytest.approx(2.25)
    wave_number = 2 * np.pi * count / (2 * SIZE)
    assert found["Sdq"] == pytest.approx(amplitude * wave_number / math.sqrt(2), rel=3e-3)
    assert found["Sdr"] == pytest.approx(100 * found["Sdq"] ** 2 / 2, rel=0.01)


def test_material_ratio_curve_of_a_normal_distribution():
    """By numerical integration: the middle 40 % are the flattest."""
    # each height stands twice, opposite about the middle of the map, so that there is no plane
    count = SIZE**2 // 2
    half = norm.ppf((np.random.default_rng(0).permutation(count) + 0.5) / count)
    found = parameters(np.concatenate([half, half[::-1]]).reshape(SIZE, SIZE))
    slope = quad(lambda share: (share - 0.5) * norm.isf(share), 0.3, 0.7)[0] * 12 / 0.4**3

    def material(share):
        """Above the height that a share of the area exceeds."""
        return norm.pdf(norm.isf(share)) - share * norm.isf(share)

    share = norm.sf(-slope / 2)
    assert found["Sk"] == pytest.approx(-slope, rel=1e-3)
    assert found["Smr1"] == pytest.approx(100 * share, abs=0.05)
    assert found["Smr2"] == pytest.approx(100 - 100 * share, abs=0.05)
    assert found["Spk"] == pytest.approx(2 * material(share) / share, rel=1e-3)
    assert found["Svk"] == pytest.approx(2 * material(share) / share, rel=1e-3)
    # void below c is material above c, plus c less the mean height
    void = material(0.1) + norm.isf(0.1)
    assert found["Vmp"] == pytest.approx(material(0.1), rel=5e-4)
    assert found["Vmc"] == pytest.approx(material(0.8) - material(0.1), rel=5e-4)
    assert found["Vvv"] == pytest.approx(material(0.2), rel=5e-4)
    assert found["Vvc"] == pytest.approx(void - material(0.2), rel=5e-4)


@pytest.mark.parametrize("every", [(2, 1), (1, 3)])
def test_rectangular_points_cost_nothing(every):
    heights = correlated(lambda y, x: np.exp(-(y**2 + (x / 2) ** 2) / 10**2), size=2 * SIZE)
    square = parameters(heights, **FILTERS)
    with warnings.catch_warnings(action="error"):
        rectangular = parameters(heights[:: every[0], :: every[1]], every, **FILTERS)
    for name, value in square.items():
        assert rectangular[name] == pytest.approx(value, rel=0.02, abs=0.005), name


def test_grooves_across_the_whole_map_have_no_aspect_ratio():
    found = parameters(np.tile(np.cos(waves(SIZE, 8)), (SIZE, 1)))
    assert math.isnan(found["Str"])
    # correlated as the cosine itself
    assert found["Sal"] == pytest.approx(math.acos(0.2) / (2 * np.pi) * SIZE / 8, rel=0.05)


def test_neither_datum_nor_tilt_nor_axes_matter_and_upside_down_summits_are_dales():
    heights = np.exp(0.5 * rough())
    y, x = np.indices(heights.shape)
    before = parameters(heights, **FILTERS)
    moved = 1e3 + heights + 0.1 * y - 0.05 * x
    assert parameters(moved, **FILTERS) == pytest.approx(before, rel=1e-6, abs=1e-6)
    assert parameters(heights.T, **FILTERS) == pytest.approx(before, rel=1e-6, abs=1e-6)
    down = parameters(-heights, **FILTERS)
    assert down["Ssk"] == pytest.approx(-before["Ssk"])
    assert (down["Svk"], down["Spk"]) == pytest.approx((before["Spk"], before["Svk"]), rel=1e-2)
    assert down["Smr2"] == pytest.approx(100 - before["Smr1"], abs=0.1)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize(
    ("short", "long", "passed"),
    [(32.0, None, 0.5), (1e-3, 64.0, 1 - 2**-4), (16.0, 64.0, 2**-0.25 * (1 - 2**-4))],
)
def test_fraction_of_a_wave_that_passes_the_filters(axis, short, long, passed):
    """A wave of 32 µm on elements that are not square; whole waves, so that it has no plane."""
    spacing = (0.5, 1.0) if axis else (1.0, 0.5)
    heights = np.tile(np.cos(waves(256, 8)), (512, 1))
    before = surface(heights if axis else heights.T, spacing)
    middle = (slice(100, -100),) * 2
    after = _scale_limited(before, short, long)
    np.testing.assert_allclose(after[middle], passed * before.values[middle] / UM, atol=1e-3)


@settings(deadline=None)
@given(st.floats(-5, 5), st.tuples(st.floats(-150, 150), st.floats(-150, 150)))
@example(0.0, (300.0, 0.0))  # no overlap
def test_rectangle_is_within_the_overlap_and_fills_it(turn, shift):
    """Of a turned and shifted square and the first one."""
    y, x = np.indices((200, 200)) - 199 / 2
    cosine, sine = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    rows, columns = cosine * y + sine * x + shift[0], cosine * x - sine * y + shift[1]
    measured = (np.abs(rows) <= 100) & (np.abs(columns) <= 100)
    rectangle = _measured_rectangle(measured)
    assert measured[rectangle].all()
    if min(measured[rectangle].shape) > 60:
        assert measured[rectangle].size > 0.7 * measured.sum()
    if turn == 0:
        assert measured[rectangle].size == measured.sum()


def registered(after, found=1):
    return xr.Dataset({"t1": after}, attrs={"registration_found": found})


def test_both_epochs_are_measured_over_the_same_area():
    before = surface(rough(size=256))
    after = 2 * before
    after[:40] = np.nan
    after[:, -30:] = np.nan
    rows = texture_rows(before, registered(after + 5 * UM), **FILTERS)
    assert [row["epoch"] for row in rows] == ["T0", "T1", "change"]
    assert {(row["size_y_mm"], row["size_x_mm"]) for row in rows} == {(216 * UM, 226 * UM)}
    assert rows[0] == texture_rows(before[40:, :-30], None, **FILTERS)[0]
    assert rows[1]["Sq_um"] == pytest.approx(2 * rows[0]["Sq_um"])
    for column in list(rows[0])[3:]:
        assert rows[2][column] == pytest.approx(rows[1][column] - rows[0][column])


@pytest.mark.parametrize(("found", "covered"), [(0, 256), (1, 0), (1, 95)])
def test_without_a_comparison_t0_stands_alone_and_whole(found, covered):
    """Not found, no overlap, or less than the L-filter's 100 µm."""
    before = surface(rough(size=256))
    after = before.copy()
    after[:, covered:] = np.nan
    rows = texture_rows(before, registered(after, found), **FILTERS)
    assert rows == texture_rows(before, None, **FILTERS)
    assert (rows[0]["epoch"], rows[0]["size_x_mm"]) == ("T0", 256 * UM)
