"""A stage that cannot answer says so, and the stages behind it go on; in memory, on tiny scans."""

import numpy as np
import pytest
from specimens import merged

from gst.config.tables import write_table
from gst.page.results import Results
from gst.page.verdict import verdict
from gstlib.use.infer import UNKNOWN

from .conftest import in_memory


def unlike(t0, t1):
    """Another surface."""
    return t1.copy(data=np.random.default_rng(t1.size).normal(0, 2e-3, t1.shape))


LAYER = {"interlayer": {"young_MPa": 50.0, "poisson": 0.4, "thickness_um": 60.0}}
# The patches, those with another T1 and how it is made, and settings.
VARIANTS = {
    "no T1 matches its T0": ("5 7 13", "5 7 13", unlike, LAYER),
    "one T1 matches its T0": ("7 10 13", "10 13", unlike, {}),
    "no T1 of a study as in the paper": ("7 13", "7 13", unlike, {"coupling": "paper"}),
    "nothing was lost": ("5 7 10 11 13 16", "5 7 10 11 13 16", lambda t0, t1: t0, {}),
    "no patch is pressed": ("5 11", "", None, {}),
    "no patch is selected": (
        "7",
        "",
        None,
        {"selection": {"minimum_pressure_MPa": 1e6}},
    ),
    "there is no T1": ("7 13", None, None, {}),
    "there is one patch": ("13", "", None, {}),
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_table_is_made_where_a_stage_has_no_answer(
    variant, finished_tiny, config, tmp_path
):
    names, changed, change, settings = VARIANTS[variant]
    patches = names.split()
    study = in_memory(finished_tiny, merged(config, settings))
    study.patches = study.patches[study.patches.patch.isin(patches)].reset_index(
        drop=True
    )
    study.worn = [] if changed is None else patches
    read = study.read_scan

    def read_changed(patch, epoch):
        scan = read(patch, epoch)
        is_changed = epoch == "T1" and patch in changed.split()
        return change(read(patch, "T0"), scan) if is_changed else scan

    study.read_scan = read_changed
    assert study.use is None or study.use.attrs["answer"].startswith(UNKNOWN)
    tables = {f"validation_{name}": table for name, table in study.scored().items()}
    assert len(tables["validation_summary"]) >= 2
    tables["registration"] = study.registration
    for name in ("validation_summary", "validation_patches", "registration"):
        write_table(tmp_path / f"{name}.csv", tables[name])
    limits = study.pressures.assign(low_MPa=0.0, high_MPa=1.0)
    others = {"placement": study.placement, "patch_pressures": study.selected}
    for name, table in (others | {"patch_intervals": limits}).items():
        table.to_csv(tmp_path / f"{name}.csv", index=False)
    files = {file.stem: file for file in tmp_path.glob("*.csv")}
    answer = verdict(Results(files, force_N=550.0, size_mm=5.0), study.config)
    assert not any("nan" in part for line in answer.lines for part in line)
