"""The studies that the growth is measured on are studies that the workflow takes."""

import subprocess
import sys

from scale import CONFIG, steps, write_study

from gst.check.checking import check_study
from gst.config.reading import read_config, read_study
from gstlib.specimen import pebble, scanning

# A step of the workflow, without the workflow: it holds 320 MB for a moment.
STEP = """
from types import SimpleNamespace

from gst.run.logs import run_script

rule = SimpleNamespace(input={{}}, output={{}}, params={{}}, log=[{log!r}], config={{}})
run_script(rule, lambda: b"x" * 320_000_000)
"""


def test_study_is_valid(tmp_path, monkeypatch):
    folder = tmp_path / "study"
    patches = 2500
    write_study(patches, folder, scans=False)
    monkeypatch.chdir(folder)
    assert len(read_study(read_config(CONFIG), CONFIG)) == patches
    assert len(list((folder / "data/scans").iterdir())) == 2 * patches


def test_its_files_can_be_read(tmp_path, monkeypatch, capsys):
    for module, name in ((pebble, "_CONCAVITY_MM"), (scanning, "_POOR_FRACTION")):
        # they are changed, and put back
        monkeypatch.setattr(module, name, getattr(module, name))
    write_study(9, tmp_path, scans=True)
    monkeypatch.chdir(tmp_path)
    check_study(CONFIG)
    assert "9 of 0.85 mm" in capsys.readouterr().out


def test_steps_used(tmp_path):
    """As the step itself says it, in the last line of its log."""
    script = tmp_path / "step.py"
    log = tmp_path / "made.log"
    script.write_text(STEP.format(log=str(log)))
    subprocess.run([sys.executable, script], check=True)
    used = steps(tmp_path)
    assert list(used.index) == ["made"]
    assert used.cpu_s["made"] > 0
    assert used.memory_mb["made"] > 300
