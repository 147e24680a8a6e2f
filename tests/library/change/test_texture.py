"""Texture parameters of surfaces whose own are known in closed form, and their invariants."""

import math

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import quad
from scipy.stats import norm

from gstlib.change.texture import measure_texture, texture_rows
from gstlib.specimen.randomness import self_affine_field
from gstlib.surfaces.grid import make_surface

UM = 1e-3  # mm
SIZE = 256
FILTERS = {"s_filter_um": 8.0, "l_filter_um": 100.0}
# So short and so long that all passes.
OPEN = {"s_filter_um": 1e-3, "l_filter_um": None}


def surface(heights_um, spacing_um=1.0):
    return make_surface(np.asarray(heights_um) * UM, np.asarray(spacing_um) * UM)


def parameters(heights_um, spacing_um=1.0, filters=OPEN):
    """Parameters by symbol."""
    (row,) = texture_rows(surface(heights_um, spacing_um), None, **filters)
    columns = list(row)[3:]
    return {column.partition("_")[0]: row[column] for column in columns}


def waves(size, count):
    """Phases of `count` whole waves along an axis, symmetric about its middle."""
    return 2 * np.pi * count * (np.arange(size) + 0.5) / size


def rough(size=128):
    waves = {"hurst_exponent": 0.8, "roll_off": 20.0}
    return self_affine_field(np.random.default_rng(0), size, 1.0, **waves).astype(float)


def test_egg_box():
    phase = waves(2 * SIZE, 4)
    texture = parameters(3.0 * np.cos(phase[:, None]) * np.cos(phase))
    assert (texture["Sq"], texture["Sku"]) == pytest.approx((3.0 / 2, 2.25))
    steepest = 3.0 * (phase[1] - phase[0])
    assert texture["Sdq"] == pytest.approx(steepest / math.sqrt(2), rel=3e-3)
    assert texture["Sdr"] == pytest.approx(100 * texture["Sdq"] ** 2 / 2, rel=0.01)


def test_material_ratio_curve_of_a_normal_distribution():
    """By numerical integration: the middle 40 % are the flattest."""
    # each height stands twice, opposite about the middle of the map, so that there is no plane
    count = SIZE**2 // 2
    order = np.random.default_rng(0).permutation(count)
    half = norm.ppf((order + 0.5) / count)
    heights = np.concatenate([half, half[::-1]])
    texture = parameters(heights.reshape(SIZE, SIZE))

    def moment(share):
        return (share - 0.5) * norm.isf(share)

    def material(share):
        """Above the height that a share of the area exceeds."""
        return norm.pdf(norm.isf(share)) - share * norm.isf(share)

    slope = quad(moment, 0.3, 0.7)[0] * 12 / 0.4**3
    share = norm.sf(-slope / 2)
    peaks = 2 * material(share) / share
    assert texture["Sk"] == pytest.approx(-slope, rel=1e-3)
    assert texture["Smr1"] == pytest.approx(100 * share, abs=0.05)
    assert texture["Smr2"] == pytest.approx(100 - 100 * share, abs=0.05)
    assert (texture["Spk"], texture["Svk"]) == pytest.approx((peaks, peaks), rel=1e-3)
    # void below c is material above c, plus c less the mean height
    void = material(0.1) + norm.isf(0.1)
    volumes = {
        "Vmp": material(0.1),
        "Vmc": material(0.8) - material(0.1),
        "Vvv": material(0.2),
        "Vvc": void - material(0.2),
    }
    assert texture | volumes == pytest.approx(texture, rel=5e-4)


def test_neither_datum_nor_tilt_nor_axes_matter():
    heights = np.exp(0.5 * rough())
    y, x = np.indices(heights.shape)
    texture = parameters(heights, filters=FILTERS)
    expected = pytest.approx(texture, rel=1e-6, abs=1e-6)
    for same in (1e3 + heights + 0.1 * y - 0.05 * x, heights.T):
        assert parameters(same, filters=FILTERS) == expected


def test_fraction_of_a_wave_that_passes_both_filters():
    """A wave of 32 µm on elements that are not square; whole waves, so that it has no plane."""
    heights = np.tile(np.cos(waves(512, 16)), (512, 1))
    filters = {"s_filter_um": 16.0, "l_filter_um": 64.0}
    passed = 2**-0.25 * (1 - 2**-4)
    texture = parameters(heights, (0.5, 1.0), filters)
    assert texture["Sq"] == pytest.approx(passed / math.sqrt(2), rel=0.01)


def registered(after, is_reliable=1):
    return xr.Dataset({"t1": after}, attrs={"registration_found": is_reliable})


def test_both_epochs_are_measured_over_the_same_area():
    before = surface(rough(SIZE))
    after = 2 * before + 5 * UM
    after[:40] = after[:, -30:] = np.nan
    t0, t1, change = texture_rows(before, registered(after), **FILTERS)
    assert [row["epoch"] for row in (t0, t1, change)] == ["T0", "T1", "change"]
    assert [t0] == texture_rows(before[40:, :-30], None, **FILTERS)
    assert (t1["size_y_mm"], t1["size_x_mm"]) == pytest.approx((216 * UM, 226 * UM))
    assert t1["Sq_um"] == pytest.approx(2 * t0["Sq_um"])
    for column in list(t0)[3:]:
        assert change[column] == pytest.approx(t1[column] - t0[column])


@pytest.mark.parametrize(("is_reliable", "covered"), [(0, SIZE), (1, 95), (1, 0)])
def test_without_a_comparison_t0_stands_alone_and_whole(is_reliable, covered):
    """Not registered, less than the L-filter's 100 µm, or no overlap."""
    before = surface(rough(SIZE))
    after = before.copy()
    after[:, covered:] = np.nan
    rows = texture_rows(before, registered(after, is_reliable), **FILTERS)
    assert rows == texture_rows(before, None, **FILTERS)
    assert (rows[0]["epoch"], rows[0]["size_x_mm"]) == ("T0", SIZE * UM)


@pytest.mark.parametrize(
    ("spacing_um", "trusted_um", "is_noisy"),
    [(1, 4, False), (1, 9, True), (1, np.nan, True), (5, 10, False), (5, 14, True)],
)
def test_noise_that_passes_the_filter_is_reported(
    caplog, spacing_um, trusted_um, is_noisy
):
    """A grid that has no waves as short as the filter is not at fault."""
    heights = surface(np.random.default_rng(1).standard_normal((40, 40)), spacing_um)
    scan = heights.to_dataset(name="height")
    scan.attrs["shortest_trusted_um"] = trusted_um
    measure_texture({"7": scan}, {}, s_filter_um=8.0, l_filter_um=None)
    assert ("patch 7" in caplog.text) == is_noisy
