"""The stone: its spectrum, its two parts as one surface, its closed mesh, and its wear."""

import dataclasses

import numpy as np
import pytest
import scipy.fft
from gstlib.specimen.pebble import OUTER_SIZE_MM
from gstlib.specimen.randomness import self_affine_field
from gstlib.specimen.stone import Stone
from gstlib.surfaces.grid import make_surface
from gstlib.surfaces.leveling import remove_plane
from hypothesis import given, settings
from hypothesis import strategies as st


def radial_density(field, spacing):
    """Mean 2-D power spectral density in rings; frequencies and densities of the rings."""
    n = len(field)
    density = np.abs(scipy.fft.fft2(field)) ** 2 * spacing**2 / n**2
    frequency = np.hypot(*np.meshgrid(*[scipy.fft.fftfreq(n, spacing)] * 2))
    edges = np.geomspace(2 / (n * spacing), 0.5 / spacing, 25)
    rings = np.digitize(frequency, edges).ravel()
    count = np.bincount(rings, minlength=26)[1:25]
    total = np.bincount(rings, density.ravel(), minlength=26)[1:25]
    return np.sqrt(edges[1:] * edges[:-1]), total / np.maximum(count, 1)


@settings(max_examples=10, deadline=None)
@given(st.floats(0.3, 0.95), st.integers(0, 2**32), st.sampled_from([(256, 0.01), (300, 0.013)]))
def test_density_has_the_hurst_exponent_and_is_flat_above_the_roll_off(hurst, seed, grid):
    generator = np.random.default_rng(seed)
    field = self_affine_field(generator, *grid, hurst_exponent=hurst, roll_off=0.5)
    frequency, density = radial_density(field, grid[1])
    inside = (frequency > 4) & (frequency < 35)
    slope = np.polyfit(np.log(frequency[inside]), np.log(density[inside]), 1)[0]
    assert -slope / 2 - 1 == pytest.approx(hurst, abs=0.06)
    field = self_affine_field(generator, *grid, hurst_exponent=hurst, roll_off=0.1)
    frequency, density = radial_density(field, grid[1])
    flat = (frequency > 2) & (frequency < 9)
    assert density[flat].mean() == pytest.approx(0.1**2, rel=0.25)


@pytest.fixture(scope="module")
def stone(parameters):
    return Stone(parameters, 5.0)


def test_macroscale_part_has_the_height_asked_for_on_the_square(stone, parameters):
    at = np.linspace(0, 5, 301)
    level, _ = remove_plane(make_surface(stone.waves(at[:, None], at), 5 / 300))
    assert level.values.std() * 1e3 == pytest.approx(parameters.macroscale_rms_um, rel=0.02)


def test_means_over_the_face_are_those_of_the_true_surface_in_the_square(stone, made):
    """With all its waves: the surface of the reference, over each element; and the waves around."""
    grid, around = 50, 40
    face = stone.face_means(grid, around)
    inside = slice(around, around + grid)
    true = made["summits"].surface
    # each point of the reference to the element in which it lies
    element = (true.x.values / 0.1).astype(int)
    sums = np.zeros((grid, grid))
    np.add.at(sums, (element[:, None], element), true.values)
    means = sums / np.outer(*2 * [np.bincount(element, minlength=grid)])
    detail = face[inside, inside] - stone.macroscale_means(grid)
    # the points in an element are not quite in its middle
    assert (face[inside, inside] - means).std() < 0.1 * detail.std()
    # around it, the waves go on, and detail as rough as within
    places = (np.arange(grid + 2 * around) - around + 0.5) * 0.1
    beyond = face - stone.macroscale(places, places)
    beyond[inside, inside] = np.nan
    assert np.nanstd(beyond) == pytest.approx(detail.std(), rel=0.15)
    assert abs(np.nanmean(beyond)) < 1e-4


def test_mesh_is_closed_and_looks_out_and_its_use_face_up(specimen):
    mesh = specimen.mesh
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2  # no handles
    assert mesh.volume > 0.3 * np.prod(OUTER_SIZE_MM)
    np.testing.assert_allclose(mesh.extents, OUTER_SIZE_MM, atol=0.2)


def test_mesh_vertices_lie_on_the_true_surface_but_for_the_noise(parameters):
    for noise_um in (0.0, 2.0):
        stone = Stone(dataclasses.replace(parameters, mesh_noise_um=noise_um), 5.0)
        vertices, _ = stone.mesh()
        inside = (np.abs(vertices[:, :2]).max(axis=1) < 2.5) & (vertices[:, 2] > -5)
        x, y = 2.5 - vertices[inside, 0], 2.5 - vertices[inside, 1]
        error = vertices[inside, 2] - stone.waves(y, x) - stone.shape(y, x)
        assert error.std() * 1e3 == pytest.approx(noise_um, rel=0.2, abs=1e-6)


def test_wear_and_chips_follow_height_but_not_all_of_it(stone, monkeypatch):
    height, depth = stone.macroscale(stone.grid, stone.grid), stone.worn_by_rules()
    high, low = height > np.quantile(height, 0.8), height < np.quantile(height, 0.2)
    worn = depth * 1e3 > 0.5
    assert depth.min() == 0
    assert 0.01 < worn.mean() < 0.3
    assert 0.8 > worn[high].mean() > 3 * worn[~high].mean() > 0
    monkeypatch.setattr("gstlib.specimen.stone._CHIPS_PER_MM2", 0.0)
    chipped = depth > stone.worn_by_rules()
    assert chipped[high].mean() > 3 * chipped[low].mean()
