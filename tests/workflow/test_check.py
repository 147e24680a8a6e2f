"""`gst check` of measured files: what it finds, and faults that are accepted."""

import re
import shutil

import numpy as np
import pytest
from click.testing import CliRunner

from gst.cli import main
from gstlib.errors import NOTE

from .conftest import in_memory


@pytest.fixture
def check(measured, monkeypatch, caplog):
    """`gst check` of the measured files: its exit code, and all that it says."""

    def check():
        monkeypatch.chdir(measured.folder)
        caplog.set_level(NOTE)
        caplog.clear()
        result = CliRunner().invoke(main, ["check", measured.config])
        assert isinstance(result.exception, SystemExit | None)
        return result.exit_code, result.output + caplog.text

    return check


def test_good_files(measured, check):
    measured.change(load={"force_N": 550.0, "at_mm": [3.2, 2.0]})
    code, text = check()
    assert code == 0, text
    plane = in_memory(measured).contact.interface.plane
    # of the mesh alone
    tilt = float(re.search(r"tilted by ([\d.]+) mrad", text)[1])
    assert tilt == pytest.approx(1e3 * np.hypot(plane.slope_y, plane.slope_x), rel=0.2)
    for words in ("x 3.2, y 2 mm", "E* = 10346 MPa", "64 × 64 points", "1 note"):
        assert words in text
    names = {file.name for file in measured.results.iterdir()}
    assert names == {"check.png", ".gst_outputs"}


def test_exchanged_epochs_are_told(measured, check):
    scans = measured.folder / "data/scans"
    for after in [*scans.glob("*_T1.plu")]:
        before = after.with_name(after.name.replace("T1", "T0"))
        before.rename(scans / "kept")
        after.rename(before)
        (scans / "kept").rename(after)
    code, text = check()
    assert code == 2
    assert "Exchange t0 and t1" in text


def test_an_accepted_fault_is_told_by_the_check_and_by_the_step(measured, check):
    scans = measured.folder / "data/scans"
    shutil.copy(scans / "5_T0.plu", scans / "5_T1.plu")
    table = "results-measured/tables/inputs.csv"
    assert "accept: [same_scan:5]" in measured.run(table, code=1)
    measured.change(accept=["same_scan:5"])
    told = "ACCEPTED FAULT: data/scans/5_T0.plu, data/scans/5_T1.plu"
    assert told in measured.run(table)
    code, text = check()
    assert code == 0
    assert "1 accepted fault" in text


def test_a_missing_mesh_and_a_cut_scan_are_told_at_once(measured, check):
    (measured.folder / "data/mesh.stl").unlink()
    scan = measured.folder / "data/scans/7_T0.plu"
    scan.write_bytes(scan.read_bytes()[:3000])
    code, text = check()
    assert code == 2
    for words in ("2 problems", "data/mesh.stl", "7_T0.plu"):
        assert words in text
