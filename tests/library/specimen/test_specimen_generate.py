"""The specimen as files: reproducible, one stone in mesh and scans, true to its truth."""

import dataclasses

import numpy as np
import pandas as pd
import pytest
import scipy.interpolate
import scipy.ndimage
import trimesh
from scipy.interpolate import LinearNDInterpolator

from gstlib.errors import ConfigError, InputError
from gstlib.specimen import SpecimenParameters, true_patches, true_surface
from gstlib.specimen.scanning import Placement, mould, sample
from gstlib.specimen.stone import fit_plane, make_stone
from gstlib.specimen.wear import wear_depth
from gstlib.surface import spacing_of

SQUARE_MM = 5.0


def bytes_of(files):
    return {
        path.relative_to(files.folder).as_posix(): path.read_bytes()
        for path in sorted(files.folder.rglob("*"))
        if path.is_file()
    }


def read_unmoulded(path):
    """Heights (mm) of a scan as it lies on the stone."""
    from SurfaceTopography.IO.PLU import PLUReader

    heights = PLUReader(str(path)).topography().heights().astype(float)
    return -np.ma.filled(heights, np.nan).T[:, ::-1] * 1e-3


def level(heights):
    steps = [np.arange(n, dtype=float) for n in heights.shape]
    return heights - fit_plane(heights, *steps)[2]


# --- reproducible ------------------------------------------------------------------------------


def test_same_seed_same_bytes(make, patches, parameters, specimen):
    assert bytes_of(make(patches, parameters)) == bytes_of(specimen)


def test_other_seed_other_everything(make, patches, parameters, specimen):
    other = bytes_of(make(patches, dataclasses.replace(parameters, seed=10)))
    first = bytes_of(specimen)
    assert other.keys() == first.keys()
    assert not [name for name in first if first[name] == other[name]]


def test_another_patch_table_changes_no_other_patch(make, patches, parameters, specimen):
    # without poor overlaps, whose choice is among the patches there are
    parameters = dataclasses.replace(parameters, poor_overlap_share=0.0)
    whole = bytes_of(make(patches, parameters))
    part = bytes_of(make(patches.iloc[[3, 1]], parameters))
    assert len(part) == 2 + 4
    del part["truth.h5"]
    assert part == {name: whole[name] for name in part}


def test_unscanned_t1_gives_no_file(make, patches, parameters):
    names = bytes_of(make(patches.iloc[:2].assign(t1=["5_T1.plu", ""]), parameters))
    assert set(names) == {
        "mesh.stl",
        "truth.h5",
        "scans/5_T0.plu",
        "scans/5_T1.plu",
        "scans/7_T0.plu",
    }


# --- one stone ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fine(make, patches, parameters):
    """A specimen whose mesh and cut-off are the paper's, and the mesh in the square's frame."""
    files = make(
        patches,
        dataclasses.replace(parameters, mesh_edge_mm=0.3144, cut_off_wavelength_mm=0.6),
    )
    vertices = trimesh.load(files.mesh).vertices
    use_face = vertices[(np.abs(vertices[:, :2]).max(axis=1) < 3) & (vertices[:, 2] > -5)]
    # the frame: origin at (+2.5, +2.5), axes along -x and -y of the mesh
    return files, LinearNDInterpolator(2.5 - use_face[:, :2], use_face[:, 2])


@pytest.mark.parametrize("patch", ["5", "7", "13", "16"])
def test_mesh_and_scan_agree_where_they_overlap(fine, truth, patch, parameters):
    """Un-moulded, freed of spikes and low-passed, a scan has the mesh's heights."""
    files, mesh_height = fine
    heights = read_unmoulded(files.scan(patch, "T0"))
    at = truth.sel(patch=patch, epoch="T0")
    bad = at.outlier.values | at.unmeasured.values
    good = ~bad
    points = np.stack([*np.nonzero(good)], axis=1)
    heights[bad] = scipy.interpolate.NearestNDInterpolator(points, heights[good])(
        np.stack([*np.nonzero(bad)], axis=1)
    )
    tilt = [at[f"tilt_{axis}_mrad"].item() for axis in "yx"]
    n, spacing = len(heights), parameters.scan_spacing_mm
    steps = (np.arange(n) - (n - 1) / 2) * spacing
    heights -= 1e-3 * (tilt[0] * steps[:, None] + tilt[1] * steps)

    turn = np.deg2rad(at.rotation_deg.item())
    x = at.x_mm.item() + np.cos(turn) * steps - np.sin(turn) * steps[:, None]
    y = at.y_mm.item() + np.sin(turn) * steps + np.cos(turn) * steps[:, None]
    mesh = mesh_height(x, y)

    smooth, difference = (
        scipy.ndimage.gaussian_filter(field, 0.15 / spacing, mode="nearest")
        for field in (heights, heights - mesh)
    )
    assert np.std(difference) < 2e-3
    assert np.corrcoef(smooth.ravel(), (smooth - difference).ravel())[0, 1] > 0.9


def test_mesh_vertices_lie_on_the_true_surface(make, patches, parameters):
    exact = dataclasses.replace(parameters, mesh_noise_um=0.0)
    files = make(patches.iloc[:1], exact)
    vertices = trimesh.load(files.mesh).vertices
    inside = (np.abs(vertices[:, :2]).max(axis=1) < 2.5) & (vertices[:, 2] > -5)
    x, y = 2.5 - vertices[inside, 0], 2.5 - vertices[inside, 1]
    stone = make_stone(exact, SQUARE_MM)
    np.testing.assert_allclose(
        vertices[inside, 2], stone.waves(y, x) + stone.shape(y, x), atol=2e-6
    )


def test_scan_is_the_truth_with_tilt_noise_spikes_and_holes(specimen, truth, parameters):
    for patch in truth.patch.values:
        at = truth.sel(patch=patch, epoch="T0")
        heights = read_unmoulded(specimen.scan(patch, "T0"))
        np.testing.assert_array_equal(np.isnan(heights), at.unmeasured.values)
        assert at.unmeasured.values.sum() == round(parameters.unmeasured_share * heights.size)
        steps = np.arange(len(heights)) * parameters.scan_spacing_mm
        slope_y, slope_x = (np.tan(1e-3 * at[f"plane_{axis}_mrad"].item()) for axis in "yx")
        plane = slope_y * steps[:, None] + slope_x * steps
        noise = heights - plane - at.height.values
        noise -= np.nanmedian(noise)
        clean = ~at.outlier.values & ~at.unmeasured.values
        assert noise[clean].std() * 1e3 == pytest.approx(parameters.noise_um, rel=0.1)
        assert np.abs(noise[clean]).max() * 1e3 < 6 * parameters.noise_um
        spikes = np.abs(noise[at.outlier.values]) * 1e3
        low, high = parameters.spike_height_um
        assert spikes.min() > low - 6 * parameters.noise_um
        assert spikes.max() < high + 6 * parameters.noise_um


def test_true_placement_is_about_the_nominal_one(truth, parameters):
    for axis in "xy":
        error = truth[f"{axis}_mm"].sel(epoch="T0") - truth[f"nominal_{axis}_mm"]
        assert 0 < np.abs(error).max() < 5e-3 * parameters.placement_error_um
    overlap = truth.overlap.values
    assert sorted(overlap < 0.7) == [False] * 4 + [True]
    assert overlap.min() > 0.15


def test_rotated_patch_is_sampled_rotated(parameters):
    stone = make_stone(parameters, SQUARE_MM)
    grid = stone.grid()
    field = np.add.outer(3 * grid, grid)  # 3 y + x
    heights = sample(field, stone, Placement(2.0, 3.0, 90.0), 5, order=1, patch="a")
    # turned by 90 degrees the scan's x runs along the square's y, its y along minus the square's x
    steps = (np.arange(5) - 2) * stone.spacing
    np.testing.assert_allclose(heights, 11 + 3 * steps[None, :] - steps[:, None], atol=1e-9)


def test_mould_is_its_own_inverse_and_flips_along_x():
    heights = np.arange(6.0).reshape(2, 3)
    assert mould(heights).tolist() == [[-2, -1, 0], [-5, -4, -3]]
    np.testing.assert_array_equal(mould(mould(heights)), heights)


# --- wear --------------------------------------------------------------------------------------


def test_wear_only_lowers(truth, parameters):
    depth = truth.wear_depth.values
    assert depth.min() == 0
    worn = (depth * 1e3 > parameters.wear_threshold_um).mean()
    assert 0.01 < worn < 0.3


def test_t1_is_the_worn_stone(specimen, truth, parameters):
    """Seen at the very same place without tilt, T1 less T0 is the wear, and nothing rises."""
    p = dataclasses.replace(parameters, noise_um=0.0, spike_share=0.0, unmeasured_share=0.0)
    stone, wear = make_stone(p, SQUARE_MM), wear_depth(make_stone(p, SQUARE_MM), p)
    grid = stone.grid()
    surface = stone.macroscale(grid, grid) + stone.detail
    at = truth.sel(patch="13", epoch="T1")
    place = Placement(at.x_mm.item(), at.y_mm.item(), at.rotation_deg.item())
    fresh = sample(surface, stone, place, p.scan_points, order=3, patch="13")
    lost = sample(wear, stone, place, p.scan_points, order=1, patch="13")
    assert lost.min() >= 0
    seen = read_unmoulded(specimen.scan("13", "T1"))
    good = ~(at.outlier | at.unmeasured).values
    steps = np.arange(p.scan_points) * p.scan_spacing_mm
    tilt = 1e-3 * (at.tilt_y_mrad.item() * steps[:, None] + at.tilt_x_mrad.item() * steps)
    left = seen - tilt - (fresh - lost)
    left -= np.nanmedian(left)
    assert np.abs(left[good]).max() * 1e3 < 6 * parameters.noise_um


def test_wear_follows_height_but_not_all_of_it(parameters):
    stone = make_stone(parameters, SQUARE_MM)
    grid = stone.grid()
    height = stone.macroscale(grid, grid)
    high = height > np.quantile(height, 0.8)
    depth = wear_depth(stone, parameters)
    worn = depth * 1e3 > parameters.wear_threshold_um
    assert worn[high].mean() > 3 * worn[~high].mean()
    assert worn[~high].any()
    assert worn[high].mean() < 0.8


def test_without_any_cause_nothing_wears_but_rare_summits(parameters):
    idle = dataclasses.replace(
        parameters, wear_share=1e-9, chips_per_mm2=0.0, valley_share=0.0, wear_chance_um=0.0
    )
    stone = make_stone(idle, SQUARE_MM)
    assert (wear_depth(stone, idle) > 0).mean() < 0.002


# --- truth and parameters ----------------------------------------------------------------------


def test_truth_offers_surface_and_patches(truth, patches, parameters):
    surface = true_surface(truth)
    assert surface.dims == ("y", "x")
    assert surface.shape == (50, 50)
    assert spacing_of(surface) == pytest.approx((0.1, 0.1))
    waves = level(surface.values)
    assert waves.std() * 1e3 == pytest.approx(parameters.macroscale_rms_um, rel=0.15)
    table = true_patches(truth)
    assert list(table.patch) == list(patches.patch)
    np.testing.assert_allclose(table.x_mm, patches.x_mm, atol=0.2)
    assert not np.allclose(true_patches(truth, "T1").x_mm, table.x_mm)


def test_patch_outside_the_surface_is_refused(make, parameters):
    outside = pd.DataFrame({"patch": ["a"], "x_mm": [0.0], "y_mm": [2.0], "t0": ["a.plu"]})
    with pytest.raises(InputError, match=r"patch a.*sticks out.*margin_mm"):
        make(outside, parameters)


def test_doubled_patch_is_refused(make, patches, parameters):
    with pytest.raises(InputError, match="twice"):
        make(pd.concat([patches, patches]), parameters)


def test_square_larger_than_the_stone_is_refused(make, patches, parameters):
    small = dataclasses.replace(parameters, outer_size_mm=(10.0, 8.0, 3.0))
    with pytest.raises(ConfigError, match="half of the pebble"):
        make(patches, small)


@pytest.mark.parametrize(
    "change",
    [
        {"cut_off_wavelength_mm": 3.0},
        {"scan_spacing_um": 400.0},
        {"spike_height_um": [60.0, 15.0]},
    ],
)
def test_contradictory_parameters_are_refused(parameters, change):
    values = dataclasses.asdict(parameters) | change
    with pytest.raises(ConfigError, match=next(iter(change)).split("_")[0]):
        SpecimenParameters(**values)


def test_unknown_parameter_is_refused(parameters):
    with pytest.raises(TypeError, match="colour"):
        SpecimenParameters(**dataclasses.asdict(parameters), colour="grey")
