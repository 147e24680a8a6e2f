"""Bad input: all problems at once, in clear errors, by `make check` and before a run begins."""

import re
import shutil

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from gst.cli import main
from gstlib.errors import NOTE

from .conftest import in_memory


@pytest.fixture
def check(monkeypatch, caplog):
    """`gst check` of a study: its exit code, and all that it says."""

    def check(study, *options):
        monkeypatch.chdir(study.folder)
        caplog.set_level(NOTE)
        caplog.clear()
        result = CliRunner().invoke(main, ["check", study.config, *options])
        assert isinstance(result.exception, SystemExit | None)
        return result.exit_code, result.output + caplog.text

    return check


def absent(words, text):
    """The words that a text lacks, and a traceback that it has."""
    return [word for word in words if word not in text] + ["Traceback"] * (
        "Traceback" in text
    )


def test_good_files(measured, check):
    measured.change(load={"force_N": 550.0, "at_mm": [3.2, 2.0]})
    code, text = check(measured)
    assert code == 0, text
    plane = in_memory(measured).contact.interface.plane
    (tilt,) = map(
        float, re.findall(r"tilted by ([\d.]+) mrad", text)
    )  # of the mesh alone
    assert tilt == pytest.approx(1e3 * np.hypot(plane.slope_y, plane.slope_x), rel=0.2)
    assert (
        absent(("x 3.2, y 2 mm", "E* = 10346 MPa", "64 × 64 points", "1 note"), text)
        == []
    )
    names = {file.name for file in measured.results.iterdir()}
    assert names == {"check.png", ".gst_outputs"}


def test_exchanged_epochs_are_told(measured, check):
    scans = measured.folder / "data/scans"
    for after in [*scans.glob("*_T1.plu")]:
        before = after.with_name(after.name.replace("T1", "T0"))
        before.rename(scans / "kept")
        after.rename(before)
        (scans / "kept").rename(after)
    code, text = check(measured)
    assert (
        code,
        absent(["patches more rose than fell", "Exchange t0 and t1"], text),
    ) == (2, [])


def test_an_accepted_fault_is_told_by_the_check_and_by_the_step(measured, check):
    scans = measured.folder / "data/scans"
    shutil.copy(scans / "5_T0.plu", scans / "5_T1.plu")
    table = "results-measured/tables/inputs.csv"
    assert "accept: [same_scan:5]" in measured.run(table).stderr
    measured.change(accept=["same_scan:5"])
    assert (
        "ACCEPTED FAULT: data/scans/5_T0.plu, data/scans/5_T1.plu"
        in measured.succeed(table)
    )
    code, text = check(measured)
    assert (code, absent(["1 accepted fault"], text)) == (0, [])


def test_everything_wrong_with_the_files_is_reported_at_once(measured, check):
    truncated, mesh = (
        measured.folder / f"data/{name}" for name in ("scans/7_T0.plu", "mesh.stl")
    )
    truncated.write_bytes(truncated.read_bytes()[:3000])
    trimesh.load_mesh(mesh).apply_scale(1e-3).export(mesh)
    words = "2 problems", "mesh_unit", "truncated", "data/mesh.stl", "7_T0.plu"
    code, text = check(measured)
    assert (code, absent(words, text)) == (2, [])
    mesh.unlink()
    words = "data/mesh.stl does not exist", "7_T0.plu"
    assert absent(words, check(measured)[1]) == []
