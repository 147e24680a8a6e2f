"""The specimen: the same in memory and in files, one stone, true to its truth."""

import dataclasses

import numpy as np
import pytest

from gstlib.errors import ConfigError, InputError
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import read_scan
from gstlib.io.store import read_dataset
from gstlib.specimen.generate import make_specimen, write_specimen
from gstlib.specimen.scanning import sample, take_scan
from gstlib.specimen.stone import Stone
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.grid import make_surface, spacing_of
from gstlib.surfaces.leveling import remove_plane

SPACING = 0.01328
STEPS = (np.arange(64) - 31.5) * SPACING


def as_on_stone(scan, true):
    """Heights (mm) of a scan as it lies on the stone, its true plane removed."""
    slope_y, slope_x = (
        np.tan(1e-3 * true[f"plane_{axis}_mrad"].item()) for axis in "yx"
    )
    return -scan.values[:, ::-1] - slope_y * STEPS[:, None] - slope_x * STEPS


def test_another_patch_table_changes_no_other_patch(patches, parameters, specimen):
    part = make_specimen(patches.iloc[[3, 1]], parameters, square_mm=5.0, grid=50)
    assert part.stl == specimen.stl
    poor = specimen.truth.patch[specimen.truth.overlap < 0.7].values
    same = [scan for scan in part.scans if scan[1] == "T0" or scan[0] not in poor]
    assert len(same) >= 3
    assert all(part.scans[scan].identical(specimen.scans[scan]) for scan in same)


def test_files_read_back_are_the_specimen_in_memory(
    tmp_path, patches, parameters, specimen
):
    """Made again, for the same arguments give the same specimen; patch 7 without T1."""
    patches = patches.replace("7_T1.plu", "")
    write_specimen(
        make_specimen(patches, parameters, square_mm=5.0, grid=50),
        mesh=tmp_path / "mesh.stl",
        scan_folder=tmp_path / "scans",
        truth=tmp_path / "truth.h5",
        surface=tmp_path / "surface.h5",
    )
    mesh = read_mesh(tmp_path / "mesh.stl")
    np.testing.assert_array_equal(mesh.vertices, specimen.mesh.vertices)
    np.testing.assert_array_equal(mesh.faces, specimen.mesh.faces)
    assert read_dataset(tmp_path / "truth.h5").equals(
        specimen.truth
    )  # known without T1, too
    scans = {f"{'_'.join(key)}.plu": scan for key, scan in specimen.scans.items()}
    del scans["7_T1.plu"]
    assert {path.name for path in (tmp_path / "scans").iterdir()} == scans.keys()
    for name, scan in scans.items():
        read = read_scan(tmp_path / "scans" / name)
        assert read.equals(scan)
        assert spacing_of(read) == (SPACING, SPACING)


def test_scan_is_the_truth_with_tilt_noise_spikes_and_holes(
    specimen, truth, parameters
):
    for patch in truth.patch.values:
        true = truth.sel(patch=patch, epoch="T0")
        noise = as_on_stone(specimen.scans[patch, "T0"], true) - true.height.values
        np.testing.assert_array_equal(np.isnan(noise), true.unmeasured.values)
        assert true.unmeasured.values.sum() == round(0.01 * noise.size)
        noise_um = (noise - np.nanmedian(noise)) * 1e3
        clean = ~true.outlier.values & ~true.unmeasured.values
        assert noise_um[clean].std() == pytest.approx(parameters.noise_um, rel=0.1)
        spikes = np.abs(noise_um[true.outlier.values])
        # 15 to 60 µm
        assert np.abs(spikes - 37.5).max() < 22.5 + 6 * parameters.noise_um
    assert truth.outlier.values.mean() == pytest.approx(
        parameters.spike_fraction, rel=0.2
    )
    differences = truth[["unmeasured", "plane_x_mrad"]].astype(float).diff("epoch")
    assert differences.any(["y", "x"]).all().to_array().all()


@pytest.mark.parametrize(("along_um", "across_um"), [(0, 0), (60, 0), (40, 20)])
def test_errors_correlate_over_their_lengths(parameters, along_um, across_um):
    """They fall exponentially in both directions, and have the same r.m.s. everywhere."""
    spacing_um = parameters.scan_spacing_um
    lengths_um = {
        "noise_length_along_um": along_um,
        "noise_length_across_um": across_um,
    }
    correlated = dataclasses.replace(
        parameters, noise_um=1e3, spike_fraction=0.0, **lengths_um
    )
    scan, _ = take_scan(np.zeros((1024, 1024)), "a", "T0", correlated)
    errors = scan.fillna(0.0).values
    measured_share = scan.notnull().mean().item()
    for lines, length_um in ((errors, across_um), (errors.T, along_um)):
        assert lines.std() == pytest.approx(np.sqrt(measured_share), rel=0.02)
        assert lines[[0, -1]].std(axis=1) == pytest.approx(1, rel=0.2)
        for lag in (1, 2, 4):
            expected = np.exp(-lag * spacing_um / length_um) if length_um else 0
            correlation = np.corrcoef(lines[lag:].ravel(), lines[:-lag].ravel())[0, 1]
            assert correlation == pytest.approx(expected, abs=0.02)


def test_t1_is_the_worn_stone(specimen, truth, parameters):
    stone = Stone(parameters, 5.0)
    true = truth.sel(patch="13", epoch="T1")
    place = PatchPosition(*(true[name].item() for name in PatchPosition._fields))
    fresh, lost = (
        sample(field, stone, place, 64, order=order, patch="13")
        for field, order in ((stone.heights, 3), (stone.worn_by_rules(), 1))
    )
    assert lost.max() > 1e-3
    level, _ = remove_plane(make_surface(fresh - lost, SPACING))
    left = as_on_stone(specimen.scans["13", "T1"], true) - level.values
    left = (left - np.nanmedian(left))[~(true.outlier | true.unmeasured).values]
    assert np.abs(left).max() * 1e3 < 6 * parameters.noise_um


def test_impossible_specimens_are_refused(patches, parameters):
    stone = Stone(parameters, 1.0)
    with pytest.raises(InputError, match=r"patch 5.*sticks out.*patch table"):
        sample(stone.detail, stone, PatchPosition(0.5, 0.0), 64, order=1, patch="5")
    with pytest.raises(ConfigError, match="half of the pebble"):
        make_specimen(patches, parameters, square_mm=41.0, grid=50)
    with pytest.raises(ConfigError, match=r"scan_spacing_um.*400.0 µm"):
        dataclasses.replace(parameters, scan_spacing_um=400.0)
