"""The registering script, called as a function: what it says of a patch."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from gstlib.io.store import read_dataset, write_dataset
from gstlib.surface import make_surface

SCRIPT = Path(__file__).parents[2] / "workflow/scripts/register_patches.py"


@pytest.fixture(scope="module")
def main():
    spec = importlib.util.spec_from_file_location("register_patches", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.main


def surface(folder, name, replaced):
    """A stored surface, the same each time, with the points of `replaced` not its own."""
    heights = make_surface(np.random.default_rng(0).normal(0, 1e-3, replaced.shape), 2e-3)
    masks = {
        mask: (("y", "x"), values, {"units": "1", "long_name": mask})
        for mask, values in {"filled": replaced, "outlier": np.zeros_like(replaced)}.items()
    }
    write_dataset(folder / name, xr.Dataset({"height": heights} | masks), {})


def test_a_patch_with_too_many_holes_is_told_and_does_not_stop_the_others(main, tmp_path, caplog):
    half = np.zeros((64, 64), dtype=bool)
    half[::2] = True
    none = np.zeros_like(half)
    for name, replaced in {"7_T0": half, "7_T1": ~half, "8_T0": none, "8_T1": none}.items():
        surface(tmp_path, f"{name}.h5", replaced)
    files = {
        patch: tuple(tmp_path / f"{patch}{end}.h5" for end in ("_T0", "_T1", ""))
        for patch in ("7", "8")
    }
    main(files, maximum_shift_mm=0.03, minimum_points=2)
    (warning,) = (record for record in caplog.records if record.levelname == "WARNING")
    for word in ("patch 7:", "50 %", "covers 100 %", "nothing is said"):
        assert word in warning.getMessage()
    found = {patch: read_dataset(tmp_path / f"{patch}.h5") for patch in files}
    assert found["7"].attrs["registration_found"]
    assert np.isnan(found["7"].change).all()
    assert np.isfinite(found["8"].change).all()
