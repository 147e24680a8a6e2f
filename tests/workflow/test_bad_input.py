"""Bad input ends in one clear error with file, value and remedy, and leaves nothing half made."""

import numpy as np
import pytest
import trimesh


def fails_with(study, *words, target=()):
    """The study fails, says all the `words` in one error, and leaves no output behind."""
    result = study.run(*target)
    said = result.stdout + result.stderr
    assert result.returncode != 0, said
    for word in words:
        assert word in said, f"{word!r} not in:\n{said}"
    assert "Traceback" not in said
    assert not [
        file for file in study.results.rglob("*") if file.suffix in (".h5", ".csv", ".part")
    ]


def edit_patches(study, old, new):
    table = study.folder / "config/patches_tiny.tsv"
    text = table.read_text()
    assert old in text
    table.write_text(text.replace(old, new, 1))


def test_unknown_key(study):
    study.change(macroscale={"steppes": 3})
    fails_with(study, "changed.yaml", "steppes", "remove or correct")


def test_every_problem_at_once(study):
    study.change(macroscale={"grid": -4}, material={"young_1_MPa": -19500.0})
    fails_with(study, "macroscale.grid", "-4", "material.young_1_MPa", "-19500")


def test_negative_modulus(study):
    study.change(material={"contact_modulus_MPa": -12820.0})
    fails_with(study, "changed.yaml", "material.contact_modulus_MPa", "-12820", "config/README.md")


def test_neither_specimen_nor_inputs(study):
    study.change(specimen=None)
    fails_with(study, "specimen", "inputs", "exactly one")


def test_patch_outside_the_square(study):
    edit_patches(study, "\t0.50\t", "\t0.30\t")
    fails_with(study, "patches_tiny.tsv", "patch 5", "sticks out", "0.125 mm")


def test_two_patches_of_one_id(study):
    edit_patches(study, "\n7\t", "\n5\t")
    fails_with(study, "patches_tiny.tsv", "patch 5", "same id")


def test_missing_files(measured):
    (measured.folder / "data/scans/7_T0.plu").unlink()
    (measured.folder / "data/mesh.stl").unlink()
    fails_with(measured, "data/mesh.stl", "data/scans/7_T0.plu", "do not exist", "correct")


SURFACE = ("results-measured/macroscale/surface.h5",)


@pytest.mark.parametrize("keep", [0, 60, 10_000])
def test_empty_or_truncated_mesh(measured, keep):
    mesh = measured.folder / "data/mesh.stl"
    mesh.write_bytes(mesh.read_bytes()[:keep])
    fails_with(measured, "data/mesh.stl", target=SURFACE)


def test_mesh_in_metres(measured):
    mesh = measured.folder / "data/mesh.stl"
    trimesh.load_mesh(mesh).apply_scale(1e-3).export(mesh)
    fails_with(measured, "data/mesh.stl", "metres", "mesh_unit", target=SURFACE)


def test_square_outside_the_mesh(measured):
    measured.change(square={"frame": {"origin_mm": [300.0, 0.0, 0.0]}})
    fails_with(measured, "data/mesh.stl", "square.frame", target=SURFACE)


PREPARED = ("results-measured/surfaces/5_T0.h5",)


def test_scan_of_the_wrong_size(measured):
    measured.change(scans={"size_mm": 0.5})
    fails_with(measured, "5_T0.plu", "0.8499", "0.5 × 0.5 mm", "scans.size_mm", target=PREPARED)


def test_scan_full_of_holes(measured):
    from gstlib.io.plu import PLU_UNMEASURED_UM

    scan = measured.folder / "data/scans/5_T0.plu"
    content = bytearray(scan.read_bytes())
    rows, columns = np.frombuffer(content, "<u4", 2, 500)
    heights = np.frombuffer(content, "<f4", rows * columns, 508)
    heights[: len(heights) // 2] = PLU_UNMEASURED_UM
    scan.write_bytes(content)
    fails_with(measured, "5_T0.plu", "unmeasured", "maximum_unmeasured", target=PREPARED)


def test_target_pressure_out_of_reach(study, finished_tiny):
    study.change(
        macroscale={"target_pressure_MPa": 5000.0, "maximum_displacement_um": 100.0}, hardness=None
    )
    surface = study.results / "macroscale/surface.h5"
    result = study.run(str(surface.relative_to(study.folder)))
    assert result.returncode == 0, result.stderr
    result = study.run("results-tiny/macroscale/contact.h5")
    assert result.returncode != 0
    for word in ("surface.h5", "5000 MPa", "0.1 mm", "Lower target_pressure_MPa"):
        assert word in result.stderr + result.stdout
    assert not (study.results / "macroscale/contact.h5").exists()
    assert not (study.results / "tables/macroscale_path.csv").exists()
