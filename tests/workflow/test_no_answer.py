"""A stage that cannot answer says so, and the stages behind it go on; in memory, on tiny scans."""

import numpy as np
import pytest
from gst.config.tables import write_table
from gst.page.verdict import verdict
from gstlib.io.tables import read_table
from gstlib.use.infer import UNKNOWN
from specimens import merged

from .conftest import in_memory

HIGHEST = {"selection": {"minimum_pressure_MPa": 1e6}}
LAYER = {"young_MPa": 50.0, "poisson": 0.4, "thickness_um": 60.0}


def unlike(t0, t1):
    """Another surface."""
    return t1.copy(data=np.random.default_rng(t1.size).normal(0, 2e-3, t1.shape))


def unworn(t0, t1):
    return t0 + np.random.default_rng(1).normal(0, 2e-5, t0.shape)


ALL = ["5", "7", "10", "11", "13", "16"]
VARIANTS = {
    "no T1 matches its T0": (ALL, unlike, {}),
    "no T1 of a study with an interlayer": (["7", "13"], unlike, {"interlayer": LAYER}),
    "one T1 matches its T0": (["7", "10", "13"], {"10": unlike, "13": unlike}, {}),
    "no patch is pressed": (["5", "11"], {}, {}),
    "nothing was lost": (["7", "10", "13"], unworn, {"interlayer": LAYER}),
    "T1 is T0": (ALL, lambda t0, t1: t0, {}),
    "no patch is selected": (["7", "10", "13"], {}, HIGHEST),
    "no T1 of a study as in the paper": (["7", "13"], unlike, {"coupling": "paper"}),
    "there is no T1": (["7", "13"], None, {}),
    "there is one patch": (["13"], {}, {}),
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_table_is_made_where_a_stage_has_no_answer(variant, finished_tiny, config, tmp_path):
    patches, change, settings = VARIANTS[variant]
    study = in_memory(finished_tiny, merged(config, settings))
    study.patches = study.patches[study.patches.patch.isin(patches)].reset_index(drop=True)
    study.worn, read = patches if change is not None else [], study.read_scan
    changed = change if isinstance(change, dict) else dict.fromkeys(patches, change)

    def read_changed(patch, epoch):
        scan = read(patch, epoch)
        is_changed = epoch == "T1" and patch in changed
        return changed[patch](read(patch, "T0"), scan) if is_changed else scan

    study.read_scan = read_changed
    assert study.use is None or study.use.attrs["answer"].startswith(UNKNOWN)
    tables = {f"validation_{name}": table for name, table in study.scored().items()}
    tables["wear"] = tables.pop("validation_wear")
    tables["wear_profile"] = tables.pop("validation_profile")
    tables |= {"registration": study.registration, "placement": study.placement}
    for name, table in tables.items():
        write_table(tmp_path / f"{name}.csv", table)
        tables[name] = read_table(tmp_path / f"{name}.csv")
    assert len(tables["validation_summary"]) >= 2
    intervals = study.pressures.assign(low_MPa=0.0, high_MPa=1.0)
    tables |= {"patch_pressures": study.selected, "patch_intervals": intervals}
    said = verdict(tables, force_N=550.0, square_mm=5.0)
    assert not any("nan" in of for line in said.lines for of in line)
