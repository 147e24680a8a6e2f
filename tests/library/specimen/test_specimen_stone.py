"""The stone: its spectrum, its two parts as one surface, its closed mesh, and its wear."""

import dataclasses

import numpy as np
import pytest

from gstlib.specimen.pebble import OUTER_SIZE_MM
from gstlib.specimen.randomness import self_affine_field
from gstlib.specimen.stone import Stone
from gstlib.surfaces.spectrum import radial_spectrum


@pytest.mark.parametrize(
    ("hurst", "count", "spacing"), [(0.3, 256, 0.01), (0.95, 300, 0.013)]
)
def test_density_has_the_hurst_exponent_and_is_flat_above_the_roll_off(
    hurst, count, spacing
):
    generator = np.random.default_rng(1)

    def rings(roll_off, low, high):
        waves = {"hurst_exponent": hurst, "roll_off": roll_off}
        field = self_affine_field(generator, count, spacing, **waves)
        frequency, density = radial_spectrum(field, (spacing, spacing))
        inside = (low <= frequency) & (frequency <= high)
        return frequency[inside], density[inside]

    frequency, density = rings(0.5, 4, 35)
    slope, _ = np.polyfit(np.log(frequency), np.log(density), 1)
    assert -slope / 2 - 1 == pytest.approx(hurst, abs=0.06)
    _, density = rings(0.1, 2, 9)
    assert density.mean() == pytest.approx(0.1**2, rel=0.25)


@pytest.fixture(scope="module")
def stone(parameters):
    return Stone(parameters, 5.0)


def test_means_over_the_face_are_those_of_the_true_surface_in_the_square(
    stone, specimen
):
    """With all its waves: the surface of the reference, over each element; and the waves around."""
    grid, around = 50, 40
    face = stone.face_means(grid, around)
    inside = slice(around, around + grid)
    # each point of the reference to the element in which it lies
    element = (specimen.surface.x.values / 0.1).astype(int)
    true = specimen.surface.assign_coords(y=element, x=element)
    true = true.groupby("y").mean().groupby("x").mean()
    detail = face[inside, inside] - stone.macroscale_means(grid)
    # the points in an element are not quite in its middle
    error = face[inside, inside] - true.values
    assert error.std() < 0.1 * detail.std()
    # around it, the waves go on, and detail as rough as within
    places = (np.arange(grid + 2 * around) - around + 0.5) * 0.1
    beyond = face - stone.macroscale(places)
    beyond[inside, inside] = np.nan
    assert np.nanstd(beyond) == pytest.approx(detail.std(), rel=0.15)
    assert abs(np.nanmean(beyond)) < 1e-4


def test_mesh_is_closed_and_as_large_as_the_stone(specimen):
    mesh = specimen.mesh
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2  # no handles
    assert mesh.volume > 0.3 * np.prod(OUTER_SIZE_MM)  # its faces look out
    np.testing.assert_allclose(mesh.extents, OUTER_SIZE_MM, atol=0.2)


@pytest.mark.parametrize("noise_um", [0.0, 2.0])
def test_mesh_vertices_lie_on_the_true_surface_but_for_the_noise(parameters, noise_um):
    """The frame of the square: origin at (+2.5, +2.5), axes along -x and -y of the mesh."""
    stone = Stone(dataclasses.replace(parameters, mesh_noise_um=noise_um), 5.0)
    vertices, _ = stone.mesh()
    inside = (np.abs(vertices[:, :2]).max(axis=1) < 2.5) & (vertices[:, 2] > -5)
    x, y = 2.5 - vertices[inside, :2].T
    error = vertices[inside, 2] - stone.waves(y, x) - stone.shape(y, x)
    assert error.std() * 1e3 == pytest.approx(noise_um, rel=0.2, abs=1e-6)


def test_wear_and_chips_follow_height_but_not_all_of_it(stone, monkeypatch):
    height = stone.macroscale(stone.grid)
    depth = stone.worn_by_rules()
    high = height > np.quantile(height, 0.8)
    low = height < np.quantile(height, 0.2)
    worn = depth * 1e3 > 0.5
    assert depth.min() == 0
    assert 0.01 < worn.mean() < 0.3
    assert 0.8 > worn[high].mean() > 3 * worn[~high].mean() > 0
    monkeypatch.setattr("gstlib.specimen.stone._CHIPS_PER_MM2", 0.0)
    chipped = depth > stone.worn_by_rules()
    assert chipped[high].mean() > 3 * chipped[low].mean()
