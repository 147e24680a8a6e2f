"""The project's own tools, in any order, and beside whatever a user keeps in its folder."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_folders_of_tests_are_collected_together():
    folders = "tests/workflow/test_mesh_only.py", "tests/library/io", "tests/library/bem"
    command = [sys.executable, "-m", "pytest", "--collect-only", "-q", *folders]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
