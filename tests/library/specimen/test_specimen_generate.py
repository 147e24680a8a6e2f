"""The specimen: reproducible, the same in memory and in files, one stone, true to its truth."""

import dataclasses

import numpy as np
import pytest
import scipy
from gstlib.errors import ConfigError, InputError
from gstlib.io.meshes import read_mesh
from gstlib.io.scans import read_scan
from gstlib.io.store import read_dataset
from gstlib.specimen.scanning import sample
from gstlib.specimen.stone import Stone
from gstlib.surfaces.footprints import PatchPosition
from gstlib.surfaces.grid import make_surface, spacing_of
from gstlib.surfaces.leveling import remove_plane
from scipy.ndimage import gaussian_filter


def bytes_of(folder):
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def place_of(at):
    return PatchPosition(*(at[name].item() for name in PatchPosition._fields))


SPACING = 0.01328
STEPS = (np.arange(64) - 31.5) * SPACING


def as_on_stone(scan, at):
    """Heights (mm) of a scan as it lies on the stone, its true plane removed."""
    slope_y, slope_x = (np.tan(1e-3 * at[f"plane_{axis}_mrad"].item()) for axis in "yx")
    return -scan.values[:, ::-1] - slope_y * STEPS[:, None] - slope_x * STEPS


def level(heights):
    return remove_plane(make_surface(heights, SPACING))[0].values


def test_a_seed_gives_the_same_bytes_and_another_seed_none_of_them(write, patches):
    first, again, other = (bytes_of(write(patches.iloc[:2], seed=seed)) for seed in (9, 9, 10))
    assert first == again
    assert other.keys() == first.keys()
    assert not [name for name in first if first[name] == other[name]]


def test_another_patch_table_changes_no_other_patch(make, patches, parameters, specimen):
    part = make(patches.iloc[[3, 1]], parameters)["summits"]
    assert part.stl == specimen.stl
    poor = specimen.truth.patch[specimen.truth.overlap < 0.7].values
    same = [scan for scan in part.scans if scan[1] == "T0" or scan[0] not in poor]
    assert len(same) >= 3
    for scan in same:
        assert part.scans[scan].identical(specimen.scans[scan])


def test_files_read_back_are_the_specimen_in_memory(write, patches, make, parameters, made):
    patches = patches.assign(t1=patches.t1.where(patches.patch != "7", ""))  # not after use
    folder, specimen = (
        write(patches, wear_placement="archard"),
        make(patches, parameters)["archard"],
    )
    mesh = read_mesh(folder / "mesh.stl")
    np.testing.assert_array_equal(mesh.vertices, specimen.mesh.vertices)
    np.testing.assert_array_equal(mesh.faces, specimen.mesh.faces)
    truth = read_dataset(folder / "truth.h5")
    assert truth.equals(specimen.truth)
    assert truth.equals(made["archard"].truth)  # wear is known without T1, too
    expected = {f"{patch}_{epoch}.plu" for patch, epoch in made["archard"].scans} - {"7_T1.plu"}
    assert {path.name for path in (folder / "scans").iterdir()} == expected
    for (patch, epoch), scan in specimen.scans.items():
        read = read_scan(folder / "scans" / f"{patch}_{epoch}.plu")
        assert read.equals(scan)
        assert spacing_of(read) == spacing_of(scan) == (SPACING, SPACING)
        assert scan.attrs.items() <= read.attrs.items()


def test_wear_elsewhere_changes_scans_after_use_alone(made):
    summits, other = made["summits"], made["archard"]
    assert other.stl is summits.stl
    for (patch, epoch), scan in summits.scans.items():
        assert other.scans[patch, epoch].identical(scan) == (epoch == "T0")
    same = {name for name in summits.truth if other.truth[name].equals(summits.truth[name])}
    assert set(summits.truth) - same == {"wear_depth", "plane_x_mrad", "plane_y_mrad"}


def test_scan_is_the_truth_with_tilt_noise_spikes_and_holes(specimen, truth, parameters):
    for patch in truth.patch.values:
        at = truth.sel(patch=patch, epoch="T0")
        noise = as_on_stone(specimen.scans[patch, "T0"], at) - at.height.values
        np.testing.assert_array_equal(np.isnan(noise), at.unmeasured.values)
        assert at.unmeasured.values.sum() == round(0.01 * noise.size)
        noise = (noise - np.nanmedian(noise)) * 1e3
        clean = ~at.outlier.values & ~at.unmeasured.values
        assert noise[clean].std() == pytest.approx(parameters.noise_um, rel=0.1)
        assert np.abs(noise[clean]).max() < 6 * parameters.noise_um
        spikes = np.abs(noise[at.outlier.values])
        assert (np.abs(spikes - 37.5) < 22.5 + 6 * parameters.noise_um).all()  # 15 to 60 µm
    assert truth.outlier.values.mean() == pytest.approx(parameters.spike_fraction, rel=0.2)
    noise_and_tilt = truth[["unmeasured", "plane_x_mrad"]].astype(float).diff("epoch")
    assert noise_and_tilt.any(["y", "x"]).all().to_array().all()


def test_mesh_and_scans_agree_where_they_overlap(make, patches, parameters):
    """Un-moulded, freed of spikes and low-passed, a scan has the heights of the paper's mesh."""
    fine = dataclasses.replace(parameters, mesh_edge_mm=0.3144, cut_off_wavelength_mm=0.6)
    made = make(patches, fine)["summits"]
    vertices = made.mesh.vertices
    use_face = vertices[(np.abs(vertices[:, :2]).max(axis=1) < 3) & (vertices[:, 2] > -5)]
    # the frame: origin at (+2.5, +2.5), axes along -x and -y of the mesh
    mesh_height = scipy.interpolate.LinearNDInterpolator(2.5 - use_face[:, :2], use_face[:, 2])
    pairs = []
    for patch in patches.patch:
        at = made.truth.sel(patch=patch, epoch="T0")
        place = place_of(at)
        turned = np.exp(1j * np.deg2rad(place.rotation_deg)) * (STEPS + 1j * STEPS[:, None])
        true = level(mesh_height(place.x_mm + turned.real, place.y_mm + turned.imag))
        scanned = as_on_stone(made.scans[patch, "T0"], at)
        scanned = np.where(at.outlier | at.unmeasured, true, scanned)
        smooth = [gaussian_filter(field, 0.15 / SPACING).ravel() for field in (scanned, true)]
        assert np.std(np.subtract(*smooth)) < 2e-3
        pairs.append(smooth)
    assert np.corrcoef(*np.concatenate(pairs, axis=1))[0, 1] > 0.9


def test_t1_is_the_worn_stone(specimen, truth, parameters):
    stone = Stone(parameters, 5.0)
    surface = stone.macroscale(stone.grid, stone.grid) + stone.detail
    at = truth.sel(patch="13", epoch="T1")
    fresh, lost = (
        sample(field, stone, place_of(at), 64, order=order, patch="13")
        for field, order in ((surface, 3), (stone.worn_by_rules(), 1))
    )
    assert lost.max() > 1e-3
    left = as_on_stone(specimen.scans["13", "T1"], at) - level(fresh - lost)
    left = (left - np.nanmedian(left))[~(at.outlier | at.unmeasured).values]
    assert np.abs(left).max() * 1e3 < 6 * parameters.noise_um


def test_what_cannot_be_made_is_refused(make, patches, parameters):
    with pytest.raises(InputError, match=r"patch 5.*sticks out.*patch table"):
        make(patches.iloc[:1].assign(x_mm=0.0), parameters)
    with pytest.raises(ConfigError, match="half of the pebble"):
        make(patches, parameters, square_mm=41.0)
    with pytest.raises(ConfigError, match=r"scan_spacing_um.*400.0 µm"):
        dataclasses.replace(parameters, scan_spacing_um=400.0)
