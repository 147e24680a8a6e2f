import sys
from pathlib import Path

import pytest

# `bem_reference.py` beside this file, importable whatever the import mode of pytest.
sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def always_threads(monkeypatch):
    """Threads on grids of any size, as on large ones."""
    for module in ("convolution", "halfspace"):
        monkeypatch.setattr(f"gstlib.bem.{module}.WORTH_THREADS", 1)
